//! The MAT phase: all kinds by one formula, d += F·w − κ(x − rest) − ζd, x += d.

use std::sync::atomic::{AtomicBool, Ordering};

use super::mesh_partition::MeshPartition;
use super::thread_team::ThreadTeam;
use crate::maths::wide::wide;
use crate::scheme::Scheme;
use crate::state::{Body, Target};

/// Positions beyond this are treated as non-finite [m].
const RUNAWAY: f64 = 1e4;

/// Position of a MAT at the next frame by the forces summed so far [m].
pub(crate) fn predict(scheme: &Scheme, body: &Body, i: usize) -> f64 {
    let step = body.force[i] * scheme.w[i]
        - scheme.kappa[i] * (body.x[i] - scheme.rest[i])
        - scheme.zeta[i] * body.d[i];
    body.x[i] + (body.d[i] + step + body.inner.get(i).copied().unwrap_or(0.0))
}

/// Force that, added to the forces summed so far, brings a MAT to `x` [m] at the next frame [N].
pub(crate) fn needed(scheme: &Scheme, body: &Body, i: usize, x: f64) -> f64 {
    (x - predict(scheme, body, i)) / scheme.w[i]
}

/// Velocity of a MAT now, by the forces summed so far: (x̂[n+1] − x[n−1])/2T [m/s].
pub(crate) fn centred(scheme: &Scheme, body: &Body, i: usize) -> f64 {
    let before = body.x[i] - body.d[i];
    (predict(scheme, body, i) - before) * (0.5 * scheme.rate)
}

/// Move every MAT by one frame, and each MAT with a target onto the target. Returns whether all positions are sound.
pub(crate) fn advance(
    scheme: &Scheme,
    targets: &mut [Target],
    body: &mut Body,
    mesh_partition: Option<&MeshPartition>,
    team: &mut ThreadTeam<'_>,
) -> bool {
    for target in &mut *targets {
        target.previous = body.x[target.mat];
    }
    let mut within = match mesh_partition {
        Some(mesh_partition) => free_in_ranges(mesh_partition, team, scheme, body),
        None => free(scheme, body),
    };
    for target in targets {
        body.d[target.mat] = target.x - target.previous;
        body.x[target.mat] = target.x;
        within &= sound(target.x);
    }
    within
}

fn free(scheme: &Scheme, body: &mut Body) -> bool {
    let numbers = scheme.ties();
    let Body { x, d, force, .. } = body;
    if let Some(previous) = &mut body.previous {
        previous.swap(x, d);
        return move_from(numbers, force, [&previous.x, &previous.d], x, d);
    }
    move_all(numbers, force, x, d)
}

/// [`free`], with the ranges of a partition computed by a thread team.
fn free_in_ranges(
    mesh_partition: &MeshPartition,
    team: &mut ThreadTeam<'_>,
    scheme: &Scheme,
    body: &mut Body,
) -> bool {
    let numbers = scheme.ties();
    let Body { x, d, force, .. } = body;
    if let Some(previous) = &mut body.previous {
        previous.swap(x, d);
    }
    let previous = body.previous.as_deref();
    let within = AtomicBool::new(true);
    mesh_partition.ranges(team, [x, d], |mats, [x, d]| {
        let (numbers, force) = (numbers.map(|all| &all[mats.clone()]), &force[mats.clone()]);
        let is_within = match previous {
            Some(previous) => move_from(
                numbers,
                force,
                [&previous.x[mats.clone()], &previous.d[mats]],
                x,
                d,
            ),
            None => move_all(numbers, force, x, d),
        };
        if !is_within {
            within.store(false, Ordering::Relaxed);
        }
    });
    within.into_inner()
}

wide! {
    /// Move MATs in place: d += F·w − κ(x − rest) − ζd, x += d; `numbers` are w, κ, ζ and rest, (n) each. Returns
    /// whether all positions are sound.
    pub(super) fn move_all(
        numbers: [&[f64]; 4],
        force: &[f64],
        x: &mut [f64],
        d: &mut [f64],
    ) -> bool {
        let n = force.len();
        let [w, kappa, zeta, rest] = numbers.map(|numbers| &numbers[..n]);
        let (x, d) = (&mut x[..n], &mut d[..n]);
        let mut bad = 0_u64;
        for i in 0..n {
            let step = force[i] * w[i] - kappa[i] * (x[i] - rest[i]) - zeta[i] * d[i];
            d[i] += step;
            x[i] += d[i];
            bad |= u64::from(!sound(x[i]));
        }
        bad == 0
    }
}

wide! {
    /// [`move_all`] from positions and steps in `from`, which are not changed.
    pub(super) fn move_from(
        numbers: [&[f64]; 4],
        force: &[f64],
        from: [&[f64]; 2],
        x: &mut [f64],
        d: &mut [f64],
    ) -> bool {
        let n = force.len();
        let [w, kappa, zeta, rest] = numbers.map(|numbers| &numbers[..n]);
        let [previous, by] = from.map(|from| &from[..n]);
        let (x, d) = (&mut x[..n], &mut d[..n]);
        let mut bad = 0_u64;
        for i in 0..n {
            let step = force[i] * w[i] - kappa[i] * (previous[i] - rest[i]) - zeta[i] * by[i];
            d[i] = by[i] + step;
            x[i] = previous[i] + d[i];
            bad |= u64::from(!sound(x[i]));
        }
        bad == 0
    }
}

wide! {
    /// Move MATs by the fraction `part` of a frame; `d` stays the step of a full frame.
    pub(crate) fn fine_steps(
        part: f64,
        numbers: [&[f64]; 4],
        force: &[f64],
        x: &mut [f64],
        d: &mut [f64],
    ) {
        let n = force.len();
        let [w, kappa, zeta, rest] = numbers.map(|numbers| &numbers[..n]);
        let (x, d) = (&mut x[..n], &mut d[..n]);
        for i in 0..n {
            let step = force[i] * w[i] - kappa[i] * (x[i] - rest[i]) - zeta[i] * d[i];
            d[i] += part * step;
            x[i] += part * d[i];
        }
    }
}

/// Whether a position is finite and within [`RUNAWAY`]; false for NaN.
#[inline(always)]
pub(crate) fn sound(x: f64) -> bool {
    x.abs() <= RUNAWAY
}
