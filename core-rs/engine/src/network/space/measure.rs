//! What a link in space measures: a length, and its direction.

use std::sync::Arc;

use super::{AXES_MAX, Facets};

/// What a link in space measures: a length, and its direction.
#[derive(Clone, Debug, PartialEq)]
pub enum Measure {
    /// The distance of its ends.
    Distance,
    /// The negative distance of its ends: a contact is closed while their distance is above −`rest`.
    Within,
    /// Signed distance of the second end from a plane through the first, along the plane's unit normal.
    Plane([f64; AXES_MAX]),
    /// Distance of the second end from a surface that moves with the first, on either side.
    Surface(Arc<Facets>),
}

impl Measure {
    /// The length and the direction, from the vector between the ends.
    #[inline(always)]
    pub(crate) fn length_and_direction(&self, [x, y, z]: [f64; AXES_MAX]) -> (f64, [f64; AXES_MAX]) {
        match self {
            Self::Plane(normal) => {
                return (normal[0] * x + normal[1] * y + normal[2] * z, *normal);
            }
            Self::Surface(facets) => return facets.nearest([x, y, z]),
            Self::Distance | Self::Within => {}
        }
        let (line_length, direction) = length_and_unit_vector([x, y, z]);
        if *self == Self::Distance {
            (line_length, direction)
        } else {
            (-line_length, direction.map(|part| -part))
        }
    }
}

/// Length of a vector. The terms are summed in the order of the inner loops, so that the bits are equal.
#[inline(always)]
pub(crate) fn distance(x: f64, y: f64, z: f64) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// Length and unit vector of a vector; both are 0 if its ends are at one place.
#[inline(always)]
pub(crate) fn length_and_unit_vector([x, y, z]: [f64; AXES_MAX]) -> (f64, [f64; AXES_MAX]) {
    let vector_length = distance(x, y, z);
    let inverse = inverse(vector_length);
    (vector_length, [x * inverse, y * inverse, z * inverse])
}

/// 1/length; 0 for a length of 0.
#[inline(always)]
pub(crate) fn inverse(length: f64) -> f64 {
    if length > 0.0 { 1.0 / length } else { 0.0 }
}
