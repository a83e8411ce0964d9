//! Runs of springs in the form that the inner loops use.

use std::ops::Range;

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
    pub(crate) fn links_of_run(&self, links: Range<usize>, force_ends: impl Fn(usize) -> ForceEnds) -> Option<Self> {
        (!links.is_empty()).then(|| Self {
            a: self.a + links.start,
            b: self.b + links.start,
            len: links.len(),
            force_ends: force_ends(links.start),
            ..*self
        })
    }
}
