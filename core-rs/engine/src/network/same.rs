//! Whether two networks are equal, so that one can continue from the state of the other.

use super::{Network, Part, Run};

impl Network {
    /// Whether modules, parameters, names and outputs are those of `other`. Initial positions and velocities may
    /// differ, and so may parts without modules.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let (this_side, other_side) = (&self.mats, &other.mats);
        let is_same_part = |a: usize, b: usize| self.part_at(a) == other.part_at(b);
        let is_same_run = |(this_side, other_side): (&Run, &Run)| {
            let run_ends = |is_same_run: &Run| (is_same_run.a, is_same_run.b, is_same_run.len, is_same_run.first);
            let numbers = |is_same_run: &Run| [is_same_run.k, is_same_run.z, is_same_run.rest];
            run_ends(this_side) == run_ends(other_side)
                && numbers(this_side) == numbers(other_side)
                && this_side.kind == other_side.kind
                && is_same_part(this_side.part, other_side.part)
        };
        let mut part_pairs = this_side.part.iter().zip(&other_side.part);
        this_side.kind == other_side.kind
            && [
                &this_side.m,
                &this_side.k,
                &this_side.z,
                &this_side.rest,
                &this_side.weight,
            ] == [
                &other_side.m,
                &other_side.k,
                &other_side.z,
                &other_side.rest,
                &other_side.weight,
            ]
            && part_pairs.all(|(&a, &b)| is_same_part(a as usize, b as usize))
            && self.proxies == other.proxies
            && self.following_masses == other.following_masses
            && self.runs.len() == other.runs.len()
            && self.runs.iter().zip(&other.runs).all(is_same_run)
            && self.outputs == other.outputs
            && self.names == other.names
    }

    /// Whether initial positions and velocities are also those of `other`.
    pub(crate) fn is_same_from_start(&self, other: &Self) -> bool {
        let (mats, other_mats) = (&self.mats, &other.mats);
        [&mats.x0, &mats.v0] == [&other_mats.x0, &other_mats.v0] && self.is_same(other)
    }

    fn part_at(&self, part: usize) -> Option<&Part> {
        self.parts.get(part)
    }
}
