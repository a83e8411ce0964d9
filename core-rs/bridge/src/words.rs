//! Tables of the words that Python passes, and the engine's values.

use ergon_engine::generator::{Angles, Ends, Place, Rim, Shape, Spread};
use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{ErgonKind, Touch};
use ergon_engine::gesture::written::Approach;
use ergon_engine::network::{Contact, Side};
use ergon_engine::plan::Method;
use ergon_engine::simulation::OnFault;
use ergon_engine::timeline::{DriveKind, HandInterpolation};

/// A table of words.
pub(crate) type WordTable<T> = &'static [(&'static str, T)];

pub(crate) const STRING_ENDS: WordTable<Ends> = &[("fixed", Ends::Fixed), ("free", Ends::Free), ("left", Ends::Left)];
pub(crate) const PLATE_SHAPES: WordTable<Shape> =
    &[("hex", Shape::Hex), ("square", Shape::Square), ("disc", Shape::Disc)];
pub(crate) const PLATE_RIMS: WordTable<Rim> = &[("free", Rim::Free), ("fixed", Rim::Fixed)];
pub(crate) const BANK_SPREADS: WordTable<Spread> = &[("even", Spread::Even), ("random", Spread::Random)];
pub(crate) const BANK_PLACES: WordTable<Place> = &[
    ("line", Place::Line),
    ("spiral", Place::Spiral),
    (
        "galaxy",
        Place::Galaxy {
            hole: 0.3,
            angles: Angles::Even,
        },
    ),
];
pub(crate) const BANK_ANGLES: WordTable<Angles> = &[("even", Angles::Even), ("random", Angles::Random)];
pub(crate) const CONTACT_SIDES: WordTable<Side> = &[("below", Side::Below), ("above", Side::Above)];
pub(crate) const CONTACT_METHODS: WordTable<Contact> = &[
    ("plain", Contact::Plain),
    ("exact", Contact::Exact),
    ("magic", Contact::Magic),
];
pub(crate) const APPROACHES: WordTable<Approach> = &[
    ("smooth", Approach::Path(Curve::Smooth)),
    ("line", Approach::Path(Curve::Line)),
    ("hold", Approach::Path(Curve::Hold)),
    ("throw", Approach::Throw),
];
pub(crate) const GESTURE_TOUCHES: WordTable<Touch> = &[("open", Touch::Open), ("tracked", Touch::Tracked)];
pub(crate) const ERGON_KINDS: WordTable<ErgonKind> = &[("event", ErgonKind::Event), ("particle", ErgonKind::Particle)];
pub(crate) const HAND_INTERPOLATIONS: WordTable<HandInterpolation> =
    &[("hold", HandInterpolation::Hold), ("line", HandInterpolation::Line)];
pub(crate) const DRIVE_KINDS: WordTable<DriveKind> = &[("position", DriveKind::Position), ("force", DriveKind::Force)];
pub(crate) const FAULT_RESPONSES: WordTable<OnFault> = &[("stop", OnFault::Stop), ("mute", OnFault::Mute)];
pub(crate) const PLAN_METHODS: WordTable<Method> = &[
    ("ca", Method::Ca),
    ("modal", Method::Modal),
    ("ca2p", Method::Ca2p),
    ("bm4", Method::Bm4),
    ("ieq", Method::Ieq),
];
