//! Dry friction of points that touch, across the line between them: a spring that slips (Cundall and Strack, Géotechnique
//! 29, 1979), with a damper while it holds (Silbert et al., Physical Review E 64, 2001).
//!
//! The spring is as stiff as the contact is along its line, and the damper is that of the contact: a contact that holds is
//! as stiff along all axes, so the certificate of the contact holds for its friction too.

use super::space::{AXES_MAX, distance};

type Vector = [f64; AXES_MAX];

/// Two points that touch, at one instant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sliding {
    /// Greatest friction: the coefficient times the push of the contact [N].
    pub(crate) limit: f64,
    /// Stiffness [N/m] and damping a step [N/m].
    pub(crate) by: [f64; 2],
    /// From the first point to the second [m].
    pub(crate) apart: Vector,
    /// Along the line of the contact, of length 1.
    pub(crate) along: Vector,
    /// What `apart` grew by in the last step [m].
    pub(crate) moved: Vector,
}

impl Sliding {
    /// The force that pulls the first point [N], and what `apart` is where the spring has no force. `anchor` is that of the
    /// last frame; `None` where the points did not touch then.
    pub(crate) fn force(&self, anchor: Option<Vector>) -> (Vector, Vector) {
        let [k, z] = self.by;
        let mut stretch = anchor.map_or([0.0; AXES_MAX], |anchor| {
            self.across(difference(self.apart, anchor))
        });
        shorten(&mut stretch, self.limit / k);
        let across = self.across(self.moved);
        let mut force = std::array::from_fn(|axis| k * stretch[axis] + z * across[axis]);
        shorten(&mut force, self.limit);
        (force, difference(self.apart, stretch))
    }

    /// The part of a vector across the line of the contact.
    fn across(&self, vector: Vector) -> Vector {
        let along = dot(vector, self.along);
        std::array::from_fn(|axis| vector[axis] - along * self.along[axis])
    }
}

/// Make a vector as long as `most`, if it is longer.
fn shorten(vector: &mut Vector, most: f64) {
    let length = distance(vector[0], vector[1], vector[2]);
    if length > most {
        vector.iter_mut().for_each(|part| *part *= most / length);
    }
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The difference of two vectors.
pub(crate) fn difference(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|axis| a[axis] - b[axis])
}
