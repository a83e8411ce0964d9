//! Forces of links in space. Springs take one pass. Other laws take one pass each for distances and directions, for the
//! law, and for the components, so that each vectorises.

use super::pull::pull;
use crate::maths::wide::wide;
use crate::network::{AXES_MAX, SpaceLaw, SpaceLink, line};
use crate::scheme::{Kind, Run, Scheme};
use crate::state::Body;

/// Scratch memory for a run of links in space   (longest run each).
#[derive(Clone, Debug, Default)]
pub(crate) struct SpaceScratch {
    /// Components of the unit vector from end to end, then of the force [N].
    along: [Vec<f64>; AXES_MAX],
    /// Distance − rest [m].
    e: Vec<f64>,
    /// Change of the distance in the last step [m].
    step: Vec<f64>,
}

impl SpaceScratch {
    pub(super) fn new(scheme: &Scheme) -> Self {
        let runs = scheme.runs.iter();
        let runs = runs.filter(|run| matches!(run.kind, Kind::Space(_)));
        let room = vec![0.0; runs.map(|run| run.len).max().unwrap_or(0)];
        Self {
            along: [room.clone(), room.clone(), room.clone()],
            e: room.clone(),
            step: room,
        }
    }
}

/// Add the forces of a run to the coordinates of its ends, and store the force along each link [N].
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
    } = scratch;
    let [along_x, along_y, along_z] = [along_x, along_y, along_z].map(|room| &mut room[..n]);
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
    let motion = Ends::new(link.n_axes, &ends, [x, d], n);
    let open = run.gate.map_or(1.0, |gate| gates[gate]);
    if link.law == SpaceLaw::Spring {
        let by = [run.k, run.z, run.rest, open];
        springs(by, &motion, f, along_x, along_y, along_z);
    } else {
        let (e, step) = (&mut e[..n], &mut step[..n]);
        lines(run.rest, &motion, e, step, along_x, along_y, along_z);
        if link.law.yields() {
            let memory = &mut memory[run.first..run.first + n];
            for (e, memory) in e.iter_mut().zip(memory) {
                *e = update_rest(link, run.k, *e, memory);
            }
        }
        for ((f, &e), &step) in f.iter_mut().zip(&*e).zip(&*step) {
            *f = link.law.force([run.k, run.z], e, step) * open;
        }
        for along in [&mut *along_x, &mut *along_y, &mut *along_z] {
            scale(f, along);
        }
    }
    let parts = ends.into_iter().zip([along_x, along_y, along_z]);
    for ((a, b), part) in parts.take(link.n_axes) {
        pull(part, force, a, b);
    }
}

/// Positions and steps at the ends of a run of links, axis by axis, (n) each.
struct Ends<'a> {
    x: [[&'a [f64]; 2]; AXES_MAX],
    d: [[&'a [f64]; 2]; AXES_MAX],
}

impl<'a> Ends<'a> {
    /// Of `n` links, the first of which joins `ends`. Along an axis that the network does not have, both ends get the
    /// same positions.
    fn new(
        n_axes: usize,
        ends: &[(usize, usize); AXES_MAX],
        [x, d]: [&'a [f64]; 2],
        n: usize,
    ) -> Self {
        let vector = |all: &'a [f64], axis: usize, is_one: bool| {
            let (a, b) = ends[axis];
            [a, if is_one { a } else { b }].map(|first| &all[first..][..n])
        };
        Self {
            x: std::array::from_fn(|axis| vector(x, axis, axis >= n_axes)),
            d: std::array::from_fn(|axis| vector(d, axis, false)),
        }
    }

    /// The same values as slices of one length, so that the compiler drops bounds checks.
    #[inline(always)]
    fn cut(&self, n: usize) -> [[[&'a [f64]; 2]; AXES_MAX]; 2] {
        [self.x, self.d].map(|all| all.map(|ends| ends.map(|all| &all[..n])))
    }
}

/// Unit vector of the i-th link, its distance − rest, and the change of the distance in the last step.
#[inline(always)]
fn link_line(
    [x, d]: &[[[&[f64]; 2]; AXES_MAX]; 2],
    rest: f64,
    i: usize,
) -> ([f64; AXES_MAX], f64, f64) {
    let apart = |[a, b]: [&[f64]; 2]| b[i] - a[i];
    let (length, along) = line(x.map(apart));
    let step = 0.0 + along[0] * apart(d[0]) + along[1] * apart(d[1]) + along[2] * apart(d[2]);
    (along, length - rest, step)
}

/// Distance − rest [m] of a link whose rest length has grown by `memory` [m]; updates `memory` if the link yields.
fn update_rest(link: &SpaceLink, k: f64, e: f64, memory: &mut f64) -> f64 {
    let settled = link.law.after_yielding(k, e, *memory);
    *memory = e - settled;
    settled
}

/// [`forces`] of a run of one link, for which separate passes would cost ten times as much.
fn single(run: &Run, link: &SpaceLink, gates: &[f64], body: &mut Body) {
    let ends = (run.a, run.b);
    let (length, along) = link.line(ends, |mat| body.x[mat]);
    let step = link.stretch(ends, along, |mat| body.d[mat]);
    let mut e = length - run.rest;
    if link.law.yields() {
        e = update_rest(link, run.k, e, &mut body.memory[run.first]);
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
    /// Forces of springs and their components; `by`: K, Z, rest, and the opening of the gate.
    fn springs(
        by: [f64; 4],
        ends: &Ends<'_>,
        f: &mut [f64],
        x: &mut [f64],
        y: &mut [f64],
        z: &mut [f64],
    ) {
        let n = f.len();
        let (x, y, z) = (&mut x[..n], &mut y[..n], &mut z[..n]);
        let ends = ends.cut(n);
        let [stiff, viscous, rest, open] = by;
        for i in 0..n {
            let (along, e, step) = link_line(&ends, rest, i);
            let force = (stiff * e + viscous * step) * open;
            f[i] = force;
            x[i] = force * along[0];
            y[i] = force * along[1];
            z[i] = force * along[2];
        }
    }
}

wide! {
    /// Distances − rest, their change in the last step, and unit vectors.
    fn lines(
        rest: f64,
        ends: &Ends<'_>,
        e: &mut [f64],
        step: &mut [f64],
        x: &mut [f64],
        y: &mut [f64],
        z: &mut [f64],
    ) {
        let n = e.len();
        let (x, y, z, step) = (&mut x[..n], &mut y[..n], &mut z[..n], &mut step[..n]);
        let ends = ends.cut(n);
        for i in 0..n {
            let along;
            (along, e[i], step[i]) = link_line(&ends, rest, i);
            [x[i], y[i], z[i]] = along;
        }
    }
}

wide! {
    /// Turn components of unit vectors into components of forces.
    fn scale(f: &[f64], along: &mut [f64]) {
        for (along, f) in along.iter_mut().zip(f) {
            *along *= f;
        }
    }
}
