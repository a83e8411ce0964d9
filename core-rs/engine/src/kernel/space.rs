//! Forces of links in space: distances and directions, the law, and its components, a pass each, so that each vectorises.

use super::pull::pull;
use crate::maths::wide::wide;
use crate::network::{AXES_MAX, SpaceLaw, SpaceLink, distance, inverse};
use crate::scheme::{Kind, Run, Scheme};
use crate::state::Body;

/// Scratch memory for a run of links in space   (longest run each).
#[derive(Clone, Debug, Default)]
pub(crate) struct SpaceScratch {
    /// Components of the unit vector from end to end.
    along: [Vec<f64>; AXES_MAX],
    /// Distance − rest [m].
    e: Vec<f64>,
    /// What the distance grows by a frame [m].
    step: Vec<f64>,
    /// One component of the forces [N].
    part: Vec<f64>,
}

impl SpaceScratch {
    pub(super) fn new(scheme: &Scheme) -> Self {
        let runs = scheme.runs.iter();
        let runs = runs.filter(|run| matches!(run.kind, Kind::Space(_)));
        let room = vec![0.0; runs.map(|run| run.len).max().unwrap_or(0)];
        Self {
            along: [room.clone(), room.clone(), room.clone()],
            e: room.clone(),
            step: room.clone(),
            part: room,
        }
    }
}

/// Add the forces of a run to the coordinates of its ends, and note how strongly each link pulls [N].
pub(super) fn forces(
    run: &Run,
    link: &SpaceLink,
    gates: &[f64],
    body: &mut Body,
    scratch: &mut SpaceScratch,
) {
    let n = run.len;
    if n == 1 {
        return single(run, link, gates, body);
    }
    let SpaceScratch {
        along: [along_x, along_y, along_z],
        e,
        step,
        part,
    } = scratch;
    let [along_x, along_y, along_z] = [along_x, along_y, along_z].map(|room| &mut room[..n]);
    let (e, step, part) = (&mut e[..n], &mut step[..n], &mut part[..n]);
    let Body {
        x,
        d,
        force,
        link: f,
        memory,
        ..
    } = body;
    let f = &mut f[run.first..run.first + n];
    let ends: [(usize, usize); AXES_MAX] =
        std::array::from_fn(|axis| run.pair(0, axis.min(link.n_axes - 1)));
    apart(x, ends[0], along_x);
    apart(x, ends[1], along_y);
    match link.n_axes {
        AXES_MAX => apart(x, ends[2], along_z),
        _ => along_z.fill(0.0),
    }
    lines(run.rest, [&mut *along_x, &mut *along_y, &mut *along_z], e);
    step.fill(0.0);
    for ((a, b), along) in ends.into_iter().zip([&*along_x, &*along_y, &*along_z]) {
        grow((&d[a..a + n], &d[b..b + n]), along, step);
    }
    if link.law.yields() {
        let memory = &mut memory[run.first..run.first + n];
        for (e, memory) in e.iter_mut().zip(memory) {
            *e = settle(link, run.k, *e, memory);
        }
    }
    match &link.law {
        SpaceLaw::Spring => springs([run.k, run.z], e, step, f),
        law => {
            for ((f, &e), &step) in f.iter_mut().zip(&*e).zip(&*step) {
                *f = law.force([run.k, run.z], e, step);
            }
        }
    }
    if let Some(gate) = run.gate {
        let open = gates[gate];
        f.iter_mut().for_each(|f| *f *= open);
    }
    let parts = ends.into_iter().zip([&*along_x, &*along_y, &*along_z]);
    for ((a, b), along) in parts.take(link.n_axes) {
        product(f, along, part);
        pull(part, force, a, b);
    }
}

/// Distance − rest [m] of a link whose rest length has grown by `memory` [m], which follows where it yields.
fn settle(link: &SpaceLink, k: f64, e: f64, memory: &mut f64) -> f64 {
    let settled = link.law.settled(k, e, *memory);
    *memory = e - settled;
    settled
}

/// [`forces`] of a run of one link, for which a pass each would cost ten times as much.
fn single(run: &Run, link: &SpaceLink, gates: &[f64], body: &mut Body) {
    let ends = (run.a, run.b);
    let (length, along) = link.line(ends, |mat| body.x[mat]);
    let step = link.stretch(ends, along, |mat| body.d[mat]);
    let mut e = length - run.rest;
    if link.law.yields() {
        e = settle(link, run.k, e, &mut body.memory[run.first]);
    }
    let mut f = link.law.force([run.k, run.z], e, step);
    if let Some(gate) = run.gate {
        f *= gates[gate];
    }
    body.link[run.first] = f;
    for ((a, b), along) in run.pairs(0).zip(along) {
        body.force[a] += f * along;
        body.force[b] -= f * along;
    }
}

wide! {
    /// What the ends of links are apart along an axis.
    fn apart(x: &[f64], ends: (usize, usize), apart: &mut [f64]) {
        let n = apart.len();
        let (xa, xb) = (&x[ends.0..][..n], &x[ends.1..][..n]);
        for i in 0..n {
            apart[i] = xb[i] - xa[i];
        }
    }
}

wide! {
    /// Distances − rest from what ends are apart, which become unit vectors.
    pub(super) fn lines(rest: f64, apart: [&mut [f64]; AXES_MAX], e: &mut [f64]) {
        let n = e.len();
        let [x, y, z] = apart;
        let (x, y, z) = (&mut x[..n], &mut y[..n], &mut z[..n]);
        for i in 0..n {
            let length = distance(x[i], y[i], z[i]);
            let inverse = inverse(length);
            e[i] = length - rest;
            x[i] *= inverse;
            y[i] *= inverse;
            z[i] *= inverse;
        }
    }
}

wide! {
    /// Add what distances grow a frame by the motion along one axis.
    fn grow(steps: (&[f64], &[f64]), along: &[f64], step: &mut [f64]) {
        let n = step.len();
        let (da, db, along) = (&steps.0[..n], &steps.1[..n], &along[..n]);
        for i in 0..n {
            step[i] += along[i] * (db[i] - da[i]);
        }
    }
}

wide! {
    fn springs(by: [f64; 2], e: &[f64], step: &[f64], f: &mut [f64]) {
        let n = f.len();
        let [k, z] = by;
        let (e, step) = (&e[..n], &step[..n]);
        for i in 0..n {
            f[i] = k * e[i] + z * step[i];
        }
    }
}

wide! {
    fn product(f: &[f64], along: &[f64], part: &mut [f64]) {
        let n = part.len();
        let (f, along) = (&f[..n], &along[..n]);
        for i in 0..n {
            part[i] = f[i] * along[i];
        }
    }
}
