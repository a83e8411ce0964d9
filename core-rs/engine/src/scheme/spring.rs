//! Runs of springs in the form that the inner loops use.

use std::ops::{Deref, Range};

use super::lone_links::LoneLinks;

/// A run of hardening springs with dampers, f = k·e + q·e³ + z·(e − e⁻): numbers per step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spring {
    /// The MATs of its first link.
    pub(crate) a: usize,
    pub(crate) b: usize,
    pub(crate) len: usize,
    /// [N/m]
    pub(crate) k: f64,
    /// [N/m³]
    pub(crate) q: f64,
    /// Damping per step, z/T.
    pub(crate) z: f64,
    /// [m]
    pub(crate) rest: f64,
    pub(crate) force_ends: ForceEnds,
}

/// The ends to which a run adds its force, with the index of the first such MAT in the array of forces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ForceEnds {
    Both(usize, usize),
    A(usize),
    B(usize),
}

impl Spring {
    /// Some links of the run, adding their forces to the ends that `force_ends` gives; `None` if `links` is empty.
    pub(crate) fn part_of_run(&self, links: Range<usize>, pull: impl Fn(usize) -> ForceEnds) -> Option<Self> {
        (!links.is_empty()).then(|| Self {
            a: self.a + links.start,
            b: self.b + links.start,
            len: links.len(),
            force_ends: pull(links.start),
            ..*self
        })
    }
}

/// Springs that are computed in one pass: run by run, and link by link where most runs are single links.
#[derive(Clone, Debug, Default)]
pub(crate) struct Springs {
    runs: Vec<Spring>,
    lone_links: Option<LoneLinks>,
}

impl Springs {
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

impl Deref for Springs {
    type Target = [Spring];

    fn deref(&self) -> &[Spring] {
        &self.runs
    }
}
