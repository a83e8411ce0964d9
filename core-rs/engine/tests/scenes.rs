//! Tests of whole scenes: properties that hold whatever a scene contains.

#[path = "scenes/blocks.rs"]
mod blocks;
#[path = "scenes/coasting.rs"]
mod coasting;
#[path = "scenes/crews.rs"]
mod crews;
#[path = "scenes/damping.rs"]
mod damping;
#[path = "scenes/faults.rs"]
mod faults;
#[path = "scenes/gains.rs"]
mod gains;
#[path = "scenes/glides.rs"]
mod glides;
#[path = "scenes/hands.rs"]
mod hands;
#[path = "scenes/ledger.rs"]
mod ledger;
#[path = "scenes/live.rs"]
mod live;
#[path = "scenes/looks.rs"]
mod looks;
#[path = "scenes/pairwise.rs"]
mod pairwise;
#[path = "scenes/plans.rs"]
mod plans;
#[path = "scenes/resting.rs"]
mod resting;
#[path = "scenes/scene.rs"]
mod scene;
#[path = "scenes/seen_rates.rs"]
mod seen_rates;
#[path = "scenes/sleeping.rs"]
mod sleeping;
#[path = "scenes/sliding.rs"]
mod sliding;
#[path = "scenes/sounds_in.rs"]
mod sounds_in;
#[path = "scenes/space.rs"]
mod space;
#[path = "scenes/space_laws.rs"]
mod space_laws;
#[path = "scenes/sparks.rs"]
mod sparks;
#[path = "scenes/stiff.rs"]
mod stiff;
#[path = "scenes/surfaces.rs"]
mod surfaces;
#[path = "scenes/takeover.rs"]
mod takeover;
#[path = "scenes/tangles.rs"]
mod tangles;
#[path = "scenes/tearing.rs"]
mod tearing;
#[path = "scenes/turned.rs"]
mod turned;
