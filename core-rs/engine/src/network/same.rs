//! Whether two networks are equal, so that one can continue from the state of the other.

use super::{Network, Part, Run};

impl Network {
    /// Whether modules, parameters, names and outputs are those of `other`. Initial positions and velocities may
    /// differ, and so may parts without modules.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let (mats, their) = (&self.mats, &other.mats);
        let parts = |a: usize, b: usize| self.part_at(a) == other.part_at(b);
        let run = |(mats, their): (&Run, &Run)| {
            let ends = |run: &Run| (run.a, run.b, run.len, run.first);
            let numbers = |run: &Run| [run.k, run.z, run.rest];
            ends(mats) == ends(their)
                && numbers(mats) == numbers(their)
                && mats.kind == their.kind
                && parts(mats.part, their.part)
        };
        let mut pairs = mats.part.iter().zip(&their.part);
        mats.kind == their.kind
            && [&mats.m, &mats.k, &mats.z, &mats.rest, &mats.weight]
                == [&their.m, &their.k, &their.z, &their.rest, &their.weight]
            && pairs.all(|(&a, &b)| parts(a as usize, b as usize))
            && self.proxies == other.proxies
            && self.following_masses == other.following_masses
            && self.runs.len() == other.runs.len()
            && self.runs.iter().zip(&other.runs).all(run)
            && self.outputs == other.outputs
            && self.names == other.names
    }

    /// Whether initial positions and velocities are also those of `other`.
    pub(crate) fn is_same_from_start(&self, other: &Self) -> bool {
        let (mats, their) = (&self.mats, &other.mats);
        [&mats.x0, &mats.v0] == [&their.x0, &their.v0] && self.is_same(other)
    }

    fn part_at(&self, part: usize) -> Option<&Part> {
        self.parts.get(part)
    }
}
