//! A pair of points that touches, and its friction.

use crate::network::{AXES_MAX, Pairwise, Sliding};
use crate::state::ContactHistory;

type Vector = [f64; AXES_MAX];

/// A pair that touches.
pub(crate) struct Contact {
    /// Distance − rest [m].
    pub(crate) e: f64,
    /// Force that pulls its ends together [N], and its elastic part.
    pub(crate) f: f64,
    pub(crate) elastic: f64,
    /// Direction from the one to the other, of length 1.
    pub(crate) along: Vector,
    /// What lies between them, and by how much that grew in the last step [m].
    pub(crate) apart: Vector,
    pub(crate) moved: Vector,
}

impl Contact {
    /// Its friction, where K and Z of the contact are these: none where it only pulls.
    #[inline(always)]
    pub(crate) fn sliding(&self, pairs: &Pairwise, [k, z]: [f64; 2]) -> Sliding {
        let pressed = pairs.link.law.pressed(k, self.e, self.elastic);
        let (limit, k) = pressed.map_or((0.0, 1.0), |[k, pull]| ((pull - self.f).max(0.0), k));
        Sliding {
            limit: pairs.friction * limit,
            by: [k, z],
            apart: self.apart,
            along: self.along,
            moved: self.moved,
        }
    }

    /// Force of friction that pulls the first point [N], which is remembered.
    pub(super) fn pull_across(
        &self,
        pairs: &Pairwise,
        by: [f64; 2],
        points: [u32; 2],
        history: &mut ContactHistory,
    ) -> Vector {
        let (force, anchor) = self.sliding(pairs, by).force(history.anchor(points));
        history.keep(points, anchor);
        force
    }
}
