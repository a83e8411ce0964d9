//! Words of the Python side and what they stand for in the engine.

use ergon_engine::generator::{Ends, Place, Rim, Shape, Spread};
use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{Ergons, Touch};
use ergon_engine::gesture::written::Approach;
use ergon_engine::network::{Contact, Side};
use ergon_engine::plan::Method;
use ergon_engine::simulation::OnFault;
use ergon_engine::timeline::{DriveKind, HandWay};

/// A table of words.
pub(crate) type Words<T, const N: usize> = [(&'static str, T); N];

pub(crate) const ENDS: Words<Ends, 3> = [
    ("fixed", Ends::Fixed),
    ("free", Ends::Free),
    ("left", Ends::Left),
];
pub(crate) const SHAPES: Words<Shape, 3> = [
    ("hex", Shape::Hex),
    ("square", Shape::Square),
    ("disc", Shape::Disc),
];
pub(crate) const RIMS: Words<Rim, 2> = [("free", Rim::Free), ("fixed", Rim::Fixed)];
pub(crate) const SPREADS: Words<Spread, 2> = [("even", Spread::Even), ("random", Spread::Random)];
pub(crate) const PLACES: Words<Place, 3> = [
    ("line", Place::Line),
    ("spiral", Place::Spiral),
    ("galaxy", Place::Galaxy { hole: 0.3 }),
];
pub(crate) const SIDES: Words<Side, 2> = [("below", Side::Below), ("above", Side::Above)];
pub(crate) const CONTACTS: Words<Contact, 3> = [
    ("plain", Contact::Plain),
    ("exact", Contact::Exact),
    ("magic", Contact::Magic),
];
pub(crate) const WAYS: Words<Approach, 4> = [
    ("smooth", Approach::Path(Curve::Smooth)),
    ("line", Approach::Path(Curve::Line)),
    ("hold", Approach::Path(Curve::Hold)),
    ("throw", Approach::Throw),
];
pub(crate) const TOUCHES: Words<Touch, 2> = [("open", Touch::Open), ("tracked", Touch::Tracked)];
pub(crate) const ERGONS: Words<Ergons, 2> =
    [("event", Ergons::Event), ("particle", Ergons::Particle)];
pub(crate) const HAND_WAYS: Words<HandWay, 2> = [("hold", HandWay::Hold), ("line", HandWay::Line)];
pub(crate) const DRIVES: Words<DriveKind, 2> = [
    ("position", DriveKind::Position),
    ("force", DriveKind::Force),
];
pub(crate) const ON_FAULT: Words<OnFault, 2> = [("stop", OnFault::Stop), ("mute", OnFault::Mute)];
pub(crate) const METHODS: Words<Method, 6> = [
    ("ca", Method::Ca),
    ("modal", Method::Modal),
    ("ca2p", Method::Ca2p),
    ("bm4", Method::Bm4),
    ("ieq", Method::Ieq),
    ("trapezoid", Method::Trapezoid),
];
