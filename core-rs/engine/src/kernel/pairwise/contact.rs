//! A pair of points that touch, and its friction.

use crate::network::{AXES_MAX, Pairwise, Sliding};
use crate::state::ContactHistory;

type Vector = [f64; AXES_MAX];

/// A pair of points that touch.
pub(crate) struct TouchingPair {
    /// Distance − rest [m].
    pub(crate) elongation: f64,
    /// Force that pulls its ends together [N], and its elastic part.
    pub(crate) force: f64,
    pub(crate) elastic_force: f64,
    /// Unit vector from the first point to the second.
    pub(crate) direction: Vector,
    /// The vector from the first point to the second, and its change in the last step [m].
    pub(crate) offset: Vector,
    pub(crate) relative_step: Vector,
}

impl TouchingPair {
    /// The friction of the pair, given K and Z of its contact; without a force if the contact only pulls.
    #[inline(always)]
    pub(crate) fn sliding(&self, pairs: &Pairwise, [k, z]: [f64; 2]) -> Sliding {
        let pressing_force = pairs
            .link
            .law
            .stiffness_and_pull(k, self.elongation, self.elastic_force);
        let (normal_force, contact_stiffness) =
            pressing_force.map_or((0.0, 1.0), |[k, pull]| ((pull - self.force).max(0.0), k));
        Sliding {
            limit: pairs.friction * normal_force,
            k_and_z: [contact_stiffness, z],
            offset: self.offset,
            direction: self.direction,
            relative_step: self.relative_step,
        }
    }

    /// Force of friction on the first point [N]; its anchor is stored in `history`.
    pub(super) fn friction_force(
        &self,
        pairs: &Pairwise,
        k_and_z: [f64; 2],
        points: [u32; 2],
        history: &mut ContactHistory,
    ) -> Vector {
        let (friction_force, anchor) = self.sliding(pairs, k_and_z).force(history.next_anchor(points));
        history.store(points, anchor);
        friction_force
    }
}
