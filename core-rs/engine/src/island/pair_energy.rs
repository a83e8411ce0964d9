//! Energy and work of contacts and attractions of all pairs of points.

use crate::kernel::{Neighbours, PairContact};
use crate::network::{PairRun, difference};
use crate::state::{Body, ContactHistory};

/// Work of all pairs in a frame [J].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Work {
    /// Taken from the points by the whole force.
    pub(super) total: f64,
    /// Taken from the points by its elastic part.
    pub(super) elastic: f64,
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
    let law = &run.pairs.link.law;
    room.touching(run, x, |_, e, _| sum += law.potential(k, e));
    sum
}

/// Work in the frame that has ended, by the forces at the positions before it. `d` are the steps of the frame before
/// and of this one [m] (n_mat each); if the frame was computed finer, both are those of this one.
pub(super) fn work(
    run: &PairRun,
    by: [f64; 2],
    room: &mut Neighbours,
    body: &Body,
    d: [&[f64]; 2],
    history: &ContactHistory,
) -> Work {
    let link = &run.pairs.link;
    let mut work = Work::default();
    let then = |mat: usize| body.x[mat] - body.d[mat];
    room.touching(run, then, |ends, e, along| {
        let step = link.stretch(ends, along, |mat| d[0][mat]);
        let stretch = 0.5 * link.stretch(ends, along, |mat| d[0][mat] + d[1][mat]);
        let (f, elastic) = (link.law.force(by, e, step), link.law.elastic(by[0], e));
        work.total += stretch * f;
        work.elastic += stretch * elastic;
        if run.pairs.friction > 0.0 {
            let moved = d.map(|d| link.between(ends, |mat| d[mat]));
            let contact = PairContact {
                e,
                f,
                elastic,
                along,
                apart: link.between(ends, then),
                moved: moved[0],
            };
            let across = contact.sliding(&run.pairs, by);
            let (force, _) = across.force(history.find(run.points(ends)));
            for (axis, force) in force.into_iter().enumerate() {
                work.total += 0.5 * (moved[0][axis] + moved[1][axis]) * force;
            }
        }
    });
    work
}

/// Elastic energy of friction in all touching pairs of stiffness `k` [J].
pub(super) fn held(run: &PairRun, k: f64, history: &ContactHistory, body: &Body) -> f64 {
    let link = &run.pairs.link;
    let pair_energy = |(points, anchor): ([u32; 2], [f64; 3])| {
        let ends = run.ends(points);
        let e = link.line(ends, |mat| body.x[mat]).0 - run.rest;
        if e >= 0.0 {
            return 0.0;
        }
        let Some([k, _]) = link.law.pressed(k, e, link.law.elastic(k, e)) else {
            return 0.0;
        };
        let stretch = difference(link.between(ends, |mat| body.x[mat]), anchor);
        let square: f64 = stretch.iter().map(|part| part * part).sum();
        0.5 * k * square
    };
    history.pairs().map(pair_energy).sum()
}
