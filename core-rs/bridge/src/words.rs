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
pub(crate) type Words<T> = &'static [(&'static str, T)];

pub(crate) const ENDS: Words<Ends> = &[("fixed", Ends::Fixed), ("free", Ends::Free), ("left", Ends::Left)];
pub(crate) const SHAPES: Words<Shape> = &[("hex", Shape::Hex), ("square", Shape::Square), ("disc", Shape::Disc)];
pub(crate) const RIMS: Words<Rim> = &[("free", Rim::Free), ("fixed", Rim::Fixed)];
pub(crate) const SPREADS: Words<Spread> = &[("even", Spread::Even), ("random", Spread::Random)];
pub(crate) const PLACES: Words<Place> = &[
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
pub(crate) const ANGLES: Words<Angles> = &[("even", Angles::Even), ("random", Angles::Random)];
pub(crate) const SIDES: Words<Side> = &[("below", Side::Below), ("above", Side::Above)];
pub(crate) const CONTACTS: Words<Contact> = &[
    ("plain", Contact::Plain),
    ("exact", Contact::Exact),
    ("magic", Contact::Magic),
];
pub(crate) const WAYS: Words<Approach> = &[
    ("smooth", Approach::Path(Curve::Smooth)),
    ("line", Approach::Path(Curve::Line)),
    ("hold", Approach::Path(Curve::Hold)),
    ("throw", Approach::Throw),
];
pub(crate) const TOUCHES: Words<Touch> = &[("open", Touch::Open), ("tracked", Touch::Tracked)];
pub(crate) const ERGONS: Words<ErgonKind> = &[("event", ErgonKind::Event), ("particle", ErgonKind::Particle)];
pub(crate) const HAND_WAYS: Words<HandInterpolation> =
    &[("hold", HandInterpolation::Hold), ("line", HandInterpolation::Line)];
pub(crate) const DRIVES: Words<DriveKind> = &[("position", DriveKind::Position), ("force", DriveKind::Force)];
pub(crate) const ON_FAULT: Words<OnFault> = &[("stop", OnFault::Stop), ("mute", OnFault::Mute)];
pub(crate) const METHODS: Words<Method> = &[
    ("ca", Method::Ca),
    ("modal", Method::Modal),
    ("ca2p", Method::Ca2p),
    ("bm4", Method::Bm4),
    ("ieq", Method::Ieq),
];
