//! Energy and work of contacts of all pairs of points.

use crate::kernel::Neighbours;
use crate::network::PairRun;
use crate::state::Body;

/// Work of all pairs in a frame [J].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Work {
    /// Taken from the points by the whole force.
    pub(super) given: f64,
    /// And by its elastic part.
    pub(super) kept: f64,
}

/// Energy of all pairs of stiffness `k` [J]: now, and a step before.
pub(super) fn potentials(run: &PairRun, k: f64, room: &mut Neighbours, body: &Body) -> [f64; 2] {
    let before = potential(run, k, room, |mat| body.x[mat] - body.d[mat]);
    [potential(run, k, room, |mat| body.x[mat]), before]
}

/// Energy of all pairs of stiffness `k` at positions `x` [J].
pub(super) fn potential(
    run: &PairRun,
    k: f64,
    room: &mut Neighbours,
    x: impl Fn(usize) -> f64,
) -> f64 {
    let mut sum = 0.0;
    let law = run.pairs.link.law;
    room.touching(run, x, |_, e, _| sum += law.potential(k, e));
    sum
}

/// Work of the frame that has ended, by forces from where points were before it: `d` are the steps of the frames before
/// and of this one [m] (n_mat each). Where both are this one's, the frame was computed finer.
pub(super) fn work(
    run: &PairRun,
    by: [f64; 2],
    room: &mut Neighbours,
    body: &Body,
    d: [&[f64]; 2],
) -> Work {
    let link = run.pairs.link;
    let mut work = Work::default();
    let then = |mat: usize| body.x[mat] - body.d[mat];
    room.touching(run, then, |ends, e, along| {
        let step = link.stretch(ends, along, |mat| d[0][mat]);
        let stretch = 0.5 * link.stretch(ends, along, |mat| d[0][mat] + d[1][mat]);
        work.given += stretch * link.law.force(by, e, step);
        work.kept += stretch * link.law.elastic(by[0], e);
    });
    work
}
