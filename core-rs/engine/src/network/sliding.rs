//! Dry friction of points that touch, perpendicular to the line between them: a spring that slips (Cundall and Strack,
//! Géotechnique 29, 1979), with a damper while it holds (Silbert et al., Physical Review E 64, 2001).
//!
//! The spring and the damper have the stiffness and the damping of the contact along its line. A contact that holds is
//! thus equally stiff along all axes, so the certificate of the contact also holds for its friction.

use super::space::{AXES_MAX, distance};

type Vector = [f64; AXES_MAX];

/// Two points that touch, at one instant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sliding {
    /// Largest friction force: the coefficient times the push of the contact [N].
    pub(crate) limit: f64,
    /// Stiffness [N/m] and damping per step [N/m].
    pub(crate) k_and_z: [f64; 2],
    /// Vector from the first point to the second [m].
    pub(crate) offset: Vector,
    /// Unit vector along the line of the contact.
    pub(crate) direction: Vector,
    /// Change of `offset` in the last step [m].
    pub(crate) relative_step: Vector,
}

impl Sliding {
    /// The force that pulls the first point [N], and the new anchor: the value of `offset` at which the spring has no
    /// force. `anchor` is that of the last frame; `None` if the points did not touch then.
    pub(crate) fn force(&self, anchor: Option<Vector>) -> (Vector, Vector) {
        let [k, z] = self.k_and_z;
        let mut stretch = anchor.map_or([0.0; AXES_MAX], |anchor| {
            self.perpendicular_part(difference(self.offset, anchor))
        });
        shorten(&mut stretch, self.limit / k);
        let motion_across = self.perpendicular_part(self.relative_step);
        let mut friction_force = std::array::from_fn(|axis| k * stretch[axis] + z * motion_across[axis]);
        shorten(&mut friction_force, self.limit);
        (friction_force, difference(self.offset, stretch))
    }

    /// The component of a vector perpendicular to the line of the contact.
    fn perpendicular_part(&self, vector: Vector) -> Vector {
        let along_line = dot(vector, self.direction);
        std::array::from_fn(|axis| vector[axis] - along_line * self.direction[axis])
    }
}

/// Shorten a vector to the length `length_max` if it is longer.
fn shorten(vector: &mut Vector, length_max: f64) {
    let vector_length = distance(vector[0], vector[1], vector[2]);
    if vector_length > length_max {
        vector.iter_mut().for_each(|part| *part *= length_max / vector_length);
    }
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The difference of two vectors.
pub(crate) fn difference(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|axis| a[axis] - b[axis])
}
