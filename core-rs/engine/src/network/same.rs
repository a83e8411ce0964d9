//! Whether two networks are equal, so that one can continue from the state of the other.

use super::{Network, Part, Run};

impl Network {
    /// Whether modules, parameters, names and outputs are those of `other`. Initial positions and velocities may
    /// differ, and so may parts without modules.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let (mats, other_mats) = (&self.mats, &other.mats);
        let is_same_part = |a: usize, b: usize| self.part_at(a) == other.part_at(b);
        let is_same_run = |(run, other_run): (&Run, &Run)| {
            let run_ends = |run: &Run| (run.a, run.b, run.len, run.first);
            let numbers = |run: &Run| [run.k, run.z, run.rest];
            run_ends(run) == run_ends(other_run)
                && numbers(run) == numbers(other_run)
                && run.kind == other_run.kind
                && is_same_part(run.part, other_run.part)
        };
        let mut part_pairs = mats.part.iter().zip(&other_mats.part);
        mats.kind == other_mats.kind
            && [&mats.m, &mats.k, &mats.z, &mats.rest, &mats.weight]
                == [
                    &other_mats.m,
                    &other_mats.k,
                    &other_mats.z,
                    &other_mats.rest,
                    &other_mats.weight,
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
