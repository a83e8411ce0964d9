//! What links whose laws follow MATs store, and what a law that changes gives or takes.

use crate::law::Law;
use crate::network::Followed;
use crate::scheme::{Kind, Run, Scheme};

/// Energies of one link over a frame, in joules.
pub(super) struct Frame {
    /// ½(V(e[n]) + V(e[n−1])) by the law of frame n: what it was by the law before came in with the change.
    pub(super) held: f64,
    /// ½(V(e[n+1]) + V(e[n])) by the same law.
    pub(super) stored: f64,
    /// The elastic part of the force at frame n [N].
    pub(super) elastic: f64,
    /// What the damping adds to it where the link is stretched by `step` then [N].
    pub(super) drag: f64,
}

impl Frame {
    /// By the law of frame n, elongations e[n−1], e[n], e[n+1] [m], and the step that led to e[n+1].
    pub(super) fn new(law: &Law, rate: f64, [before, now, next]: [f64; 3], step: f64) -> Self {
        let [before, at, next] = [before, now, next].map(|e| law.potential(e));
        let elastic = law.spring(now);
        Self {
            held: 0.5 * (at + before),
            stored: 0.5 * (next + at),
            elastic,
            drag: law.force(now, step * rate) - elastic,
        }
    }
}

/// A run whose law follows MATs: what it follows, and frames a second as its law takes them.
pub(super) fn followed(run: &Run) -> Option<(&Followed, f64)> {
    match &run.kind {
        Kind::Followed { by, rate, .. } => Some((by, *rate)),
        _ => None,
    }
}

/// Room for the law of each run that follows MATs, in the order of the runs.
pub(super) fn laws(scheme: &Scheme) -> Vec<Law> {
    let runs = scheme.runs.iter().filter_map(followed);
    runs.map(|(by, _)| by.law().clone()).collect()
}
