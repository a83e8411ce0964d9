//! All springs of a network in one pass.
//!
//! By vectors, the forces of all links are computed first and then summed at each MAT (`rows`, `vector`). Where that is
//! slower, or the processor has no such vectors, each force is added to its two ends at once, run by run or, where most
//! runs are single links, link by link (`lone`). All give the same bits.
//! The vector width is chosen once per pass rather than once per run, since the runs of a mesh are short.

mod lone;
mod rows;
mod vector;

use std::sync::Arc;

use super::pull::add_link_forces;
use crate::maths::wide::wide;
use crate::scheme::{ForceEnds, FusedSprings, Spring};
use rows::{CacheLine, Rows};

/// Which part of the forces is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ForcePart {
    Elastic,
    Viscous,
    Total,
}

/// How the springs of a mesh are computed, and the memory for it.
#[derive(Clone, Debug)]
pub(crate) struct SpringPass {
    /// `None`: one run or link after the other.
    rows: Option<Arc<Rows>>,
    /// Forces of all links in rows.
    link_forces: Vec<CacheLine>,
    /// Forces of one run   (longest run)
    run_forces: Vec<f64>,
    /// Forces of all links that are computed one by one.
    signed_forces: lone::SignedForces,
}

impl SpringPass {
    /// The pass for springs that pull on `mat_count` MATs.
    pub(crate) fn new(springs: &[Spring], mat_count: usize) -> Self {
        let rows = vector::are_supported().then(|| Rows::new(springs, mat_count)).flatten();
        let longest_run = springs.iter().map(|run| run.len).max().unwrap_or(0);
        Self {
            link_forces: rows.as_ref().map_or_else(Vec::new, Rows::zeroed_forces),
            run_forces: vec![0.0; if rows.is_some() { 0 } else { longest_run }],
            rows: rows.map(Arc::new),
            signed_forces: lone::SignedForces::new(),
        }
    }

    /// Set `force` to the sum of forces on each MAT [N] at positions and velocities (per step) `motion`. The runs are
    /// those of `new`; their numbers may have changed.
    pub(crate) fn compute_forces(
        &mut self,
        part: ForcePart,
        springs: &FusedSprings,
        motion: [&[f64]; 2],
        force: &mut [f64],
    ) {
        if let Some(rows) = &self.rows {
            vector::forces(rows, part, springs, motion, &mut self.link_forces, force);
            return;
        }
        if let Some(lone_links) = springs.lone_links() {
            lone::compute_forces(lone_links, part, motion, &mut self.signed_forces, force);
            return;
        }
        force.fill(0.0);
        let ([x, v], run_forces) = (motion, &mut self.run_forces);
        match part {
            ForcePart::Elastic => add_elastic_forces(springs, x, run_forces, force),
            ForcePart::Viscous => add_viscous_forces(springs, v, run_forces, force),
            ForcePart::Total => add_total_forces(springs, x, v, run_forces, force),
        }
    }
}

/// A value at both ends of every link of a run, (len) each.
#[inline(always)]
pub(crate) fn end_values<'a>(run: &Spring, x: &'a [f64]) -> (&'a [f64], &'a [f64]) {
    (&x[run.a..][..run.len], &x[run.b..][..run.len])
}

/// Add f(i) of every link to its end a and subtract it from its end b, but only at its `force_ends`.
#[inline(always)]
pub(crate) fn add_run_forces(run: &Spring, run_scratch: &mut [f64], force: &mut [f64], f: impl Fn(usize) -> f64) {
    let link_count = run.len;
    let (first_at_a, first_at_b) = match run.force_ends {
        ForceEnds::Both(first_at_a, first_at_b) => (first_at_a, first_at_b),
        ForceEnds::A(first_at_a) => {
            let force = &mut force[first_at_a..][..link_count];
            (0..link_count).for_each(|i| force[i] += f(i));
            return;
        }
        ForceEnds::B(first_at_b) => {
            let force = &mut force[first_at_b..][..link_count];
            (0..link_count).for_each(|i| force[i] -= f(i));
            return;
        }
    };
    // If the two ends do not overlap, one loop gives the same sums.
    if first_at_b >= first_at_a + link_count {
        let (lower_forces, upper_forces) = force.split_at_mut(first_at_b);
        add_to_both_ends(
            &mut lower_forces[first_at_a..][..link_count],
            &mut upper_forces[..link_count],
            f,
        );
    } else if first_at_a >= first_at_b + link_count {
        let (lower_forces, upper_forces) = force.split_at_mut(first_at_a);
        add_to_both_ends(
            &mut upper_forces[..link_count],
            &mut lower_forces[first_at_b..][..link_count],
            f,
        );
    } else {
        let run_scratch = &mut run_scratch[..link_count];
        for (i, run_scratch) in run_scratch.iter_mut().enumerate() {
            *run_scratch = f(i);
        }
        add_link_forces(run_scratch, force, first_at_a, first_at_b);
    }
}

#[inline(always)]
fn add_to_both_ends(fa: &mut [f64], fb: &mut [f64], link_force: impl Fn(usize) -> f64) {
    let link_count = fa.len();
    let fb = &mut fb[..link_count];
    for i in 0..link_count {
        let link_force = link_force(i);
        fa[i] += link_force;
        fb[i] -= link_force;
    }
}

wide! {
/// Add the elastic forces at positions `x`; `run_forces` is as long as the longest run.
fn add_elastic_forces(runs: &[Spring], x: &[f64], run_forces: &mut [f64], force: &mut [f64]) { for run in runs { let ((xa, xb), Spring { len, k, q, rest, .. }) = (end_values(run, x), *run); let (xa, xb) = (&xa[..len], &xb[..len]); if q == 0.0 { add_run_forces(run, run_forces, force, |i| k * (xb[i] - xa[i] - rest)); } else { add_run_forces(run, run_forces, force, |i| { let e = xb[i] - xa[i] - rest; k * e + q * (e * e * e) }); } } } }

wide! {
/// Add the dampers' forces at velocities `v` (per step).
fn add_viscous_forces(runs: &[Spring], v: &[f64], run_forces: &mut [f64], force: &mut [f64]) { for run in runs.iter().filter(|run| run.z != 0.0) { let ((va, vb), Spring { len, z, .. }) = (end_values(run, v), *run); let (va, vb) = (&va[..len], &vb[..len]); add_run_forces(run, run_forces, force, |i| z * (vb[i] - va[i])); } } }

wide! {
/// Add all forces at positions `x` and velocities `v` (per step).
fn add_total_forces( runs: &[Spring], x: &[f64], v: &[f64], run_forces: &mut [f64], force: &mut [f64], ) { for run in runs { let Spring { len, k, q, z, rest, .. } = *run; let ((xa, xb), (va, vb)) = (end_values(run, x), end_values(run, v)); let (xa, xb, va, vb) = (&xa[..len], &xb[..len], &va[..len], &vb[..len]); if q == 0.0 { add_run_forces(run, run_forces, force, |i| { k * (xb[i] - xa[i] - rest) + z * (vb[i] - va[i]) }); } else { add_run_forces(run, run_forces, force, |i| { let e = xb[i] - xa[i] - rest; k * e + q * (e * e * e) + z * (vb[i] - va[i]) }); } } } }

#[cfg(test)]
mod tests;
