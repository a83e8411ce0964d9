//! What a link in space measures: a length, along a direction.

use std::sync::Arc;

use super::{AXES_MAX, Facets};

/// What a link in space measures: a length, along a direction.
#[derive(Clone, Debug, PartialEq)]
pub enum Measure {
    /// The distance of its ends.
    Distance,
    /// The distance of its ends, below 0: a contact is closed where the distance is above −`rest`.
    Within,
    /// How far the second end is from a plane through the first, along its unit normal.
    Plane([f64; AXES_MAX]),
    /// How far the second end is from a surface that moves with the first, on either side.
    Surface(Arc<Facets>),
}

impl Measure {
    /// The length and the direction, from the vector between the ends.
    #[inline(always)]
    pub(crate) fn of(&self, [x, y, z]: [f64; AXES_MAX]) -> (f64, [f64; AXES_MAX]) {
        match self {
            Self::Plane(normal) => {
                return (normal[0] * x + normal[1] * y + normal[2] * z, *normal);
            }
            Self::Surface(facets) => return facets.nearest([x, y, z]),
            Self::Distance | Self::Within => {}
        }
        let (length, along) = line([x, y, z]);
        if *self == Self::Distance {
            (length, along)
        } else {
            (-length, along.map(|part| -part))
        }
    }
}

/// Length of a vector. The order of the sum is that of the inner loops: the same bits.
#[inline(always)]
pub(crate) fn distance(x: f64, y: f64, z: f64) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// Length of a vector, and its unit vector; 0 along all axes for points at one place.
#[inline(always)]
pub(crate) fn line([x, y, z]: [f64; AXES_MAX]) -> (f64, [f64; AXES_MAX]) {
    let length = distance(x, y, z);
    let inverse = inverse(length);
    (length, [x * inverse, y * inverse, z * inverse])
}

/// 1/length; 0 for points at one place, which have no line between them.
#[inline(always)]
pub(crate) fn inverse(length: f64) -> f64 {
    if length > 0.0 { 1.0 / length } else { 0.0 }
}
