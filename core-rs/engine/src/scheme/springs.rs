//! Springs that are computed in one pass.

use std::ops::Deref;

use super::lone_links::LoneLinks;
use super::spring::Spring;

/// Springs that are computed in one pass: run by run, and link by link where most runs are single links.
#[derive(Clone, Debug, Default)]
pub(crate) struct FusedSprings {
    runs: Vec<Spring>,
    lone_links: Option<LoneLinks>,
}

impl FusedSprings {
    pub(crate) fn new(runs: Vec<Spring>) -> Self {
        Self {
            lone_links: LoneLinks::new(&runs),
            runs,
        }
    }

    /// Remove all runs but some.
    pub(crate) fn retain(&mut self, is_retained: impl FnMut(&Spring) -> bool) {
        let mut runs = std::mem::take(&mut self.runs);
        runs.retain(is_retained);
        *self = Self::new(runs);
    }

    /// Set stiffness [N/m] and damping per step of a run; damping that was 0 stays 0.
    pub(crate) fn set_k_and_z(&mut self, run: usize, [k, z]: [f64; 2]) {
        (self.runs[run].k, self.runs[run].z) = (k, z);
        if let Some(lone_links) = &mut self.lone_links {
            lone_links.set_k_and_z(run, [k, z]);
        }
    }

    /// The same links one by one, in the same order; `None` if runs are faster.
    pub(crate) fn lone_links(&self) -> Option<&LoneLinks> {
        self.lone_links.as_ref()
    }
}

impl Deref for FusedSprings {
    type Target = [Spring];

    fn deref(&self) -> &[Spring] {
        &self.runs
    }
}
