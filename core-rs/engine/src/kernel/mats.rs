//! The update of MATs: all kinds by one formula, d += F·w − κ(x − rest) − ζd, x += d.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use super::mesh_partition::MeshPartition;
use super::thread_team::ThreadTeam;
use crate::maths::wide::wide;
use crate::scheme::Scheme;
use crate::state::{ImposedTarget, ModuleState, PreviousState};

/// Positions beyond this are treated as non-finite [m].
const POSITION_MAX: f64 = 1e4;

/// Position of a MAT at the next frame [m], given the forces summed so far.
pub(crate) fn predict_position(scheme: &Scheme, modules: &ModuleState, i: usize) -> f64 {
    let step_change = modules.force[i] * scheme.w[i]
        - scheme.kappa[i] * (modules.x[i] - scheme.rest[i])
        - scheme.zeta[i] * modules.d[i];
    modules.x[i] + (modules.d[i] + step_change + modules.free_port_motion.get(i).copied().unwrap_or(0.0))
}

/// Force that, added to the forces summed so far, brings a MAT to `x` [m] at the next frame [N].
pub(crate) fn force_to_reach(scheme: &Scheme, modules: &ModuleState, i: usize, x: f64) -> f64 {
    (x - predict_position(scheme, modules, i)) / scheme.w[i]
}

/// Velocity of a MAT at the current frame, given the forces summed so far: (x̂[n+1] − x[n−1])/2T [m/s].
pub(crate) fn centred_velocity(scheme: &Scheme, modules: &ModuleState, i: usize) -> f64 {
    let position_before = modules.x[i] - modules.d[i];
    (predict_position(scheme, modules, i) - position_before) * (0.5 * scheme.rate)
}

/// Move every MAT by one frame, and each MAT with a target to its target. Returns whether all positions are bounded.
pub(crate) fn advance_mats(
    scheme: &Scheme,
    targets: &mut [ImposedTarget],
    modules: &mut ModuleState,
    mesh_partition: Option<&MeshPartition>,
    team: &mut ThreadTeam<'_>,
) -> bool {
    for target in &mut *targets {
        target.previous = modules.x[target.mat];
    }
    let mut all_bounded = match mesh_partition {
        Some(mesh_partition) => advance_free_in_ranges(mesh_partition, team, scheme, modules),
        None => advance_free(scheme, modules),
    };
    for target in targets {
        modules.d[target.mat] = target.x - target.previous;
        modules.x[target.mat] = target.x;
        all_bounded &= is_bounded(target.x);
    }
    all_bounded
}

fn advance_free(scheme: &Scheme, modules: &mut ModuleState) -> bool {
    let ModuleState { x, d, force, .. } = modules;
    if let Some(previous_state) = &mut modules.previous_state {
        previous_state.swap(x, d);
    }
    let previous_state = modules.previous_state.as_deref();
    move_range(scheme, 0..force.len(), force, previous_state, [x, d])
}

/// [`advance_free`], with the ranges of a partition computed by a thread team.
fn advance_free_in_ranges(
    mesh_partition: &MeshPartition,
    team: &mut ThreadTeam<'_>,
    scheme: &Scheme,
    modules: &mut ModuleState,
) -> bool {
    let ModuleState { x, d, force, .. } = modules;
    if let Some(previous_state) = &mut modules.previous_state {
        previous_state.swap(x, d);
    }
    let previous_state = modules.previous_state.as_deref();
    let all_bounded = AtomicBool::new(true);
    mesh_partition.for_each_range(team, [x, d], |mats, moved| {
        if !move_range(scheme, mats, force, previous_state, moved) {
            all_bounded.store(false, Ordering::Relaxed);
        }
    });
    all_bounded.into_inner()
}

/// Move a range of MATs: in place, or from the positions and steps in `previous_state`. `force` holds the forces of all
/// MATs,
/// `moved` the positions and steps of the range. Returns whether all positions are bounded.
fn move_range(
    scheme: &Scheme,
    mats: Range<usize>,
    force: &[f64],
    previous_state: Option<&PreviousState>,
    moved: [&mut [f64]; 2],
) -> bool {
    let previous_range = |part_range: &Range<usize>| {
        previous_state.map(|previous_state| {
            [&previous_state.x, &previous_state.d].map(|mat_values| &mat_values[part_range.clone()])
        })
    };
    let [positions, last_steps] = moved;
    if scheme.equal_ranges.is_empty() {
        let (coefficients, force) = (
            scheme.mat_coefficients().map(|mat_values| &mat_values[mats.clone()]),
            &force[mats.clone()],
        );
        return match previous_range(&mats) {
            Some(previous_state) => move_from(coefficients, force, previous_state, positions, last_steps),
            None => move_all(coefficients, force, positions, last_steps),
        };
    }
    debug_assert!(scheme.are_ranges_valid(), "numbers change");
    let mut all_bounded = true;
    for equal_range in &scheme.equal_ranges {
        let part_range = equal_range.mats.start.max(mats.start)..equal_range.mats.end.min(mats.end);
        if part_range.is_empty() {
            continue;
        }
        let local_range = part_range.start - mats.start..part_range.end - mats.start;
        let (positions, last_steps) = (&mut positions[local_range.clone()], &mut last_steps[local_range]);
        all_bounded &= match previous_range(&part_range) {
            Some(previous_state) => move_equal_from(
                equal_range.coefficients,
                &force[part_range],
                previous_state,
                positions,
                last_steps,
            ),
            None => move_equal(equal_range.coefficients, &force[part_range], positions, last_steps),
        };
    }
    all_bounded
}

/// Move MATs in place: d += F·w − κ(x − rest) − ζd, x += d; `mat_coefficients` gives w, κ, ζ and rest of each. Returns
/// whether all positions are bounded.
#[inline(always)]
fn update(mat_coefficients: impl Fn(usize) -> [f64; 4], force: &[f64], x: &mut [f64], d: &mut [f64]) -> bool {
    let mat_count = force.len();
    let (x, d) = (&mut x[..mat_count], &mut d[..mat_count]);
    let mut diverged_flag = 0_u64;
    for i in 0..mat_count {
        let [w, kappa, zeta, rest_position] = mat_coefficients(i);
        let step_change = force[i] * w - kappa * (x[i] - rest_position) - zeta * d[i];
        d[i] += step_change;
        x[i] += d[i];
        diverged_flag |= u64::from(!is_bounded(x[i]));
    }
    diverged_flag == 0
}

/// [`update`] from positions and steps in `previous`, which are not changed.
#[inline(always)]
fn update_from(
    mat_coefficients: impl Fn(usize) -> [f64; 4],
    force: &[f64],
    previous: [&[f64]; 2],
    x: &mut [f64],
    d: &mut [f64],
) -> bool {
    let mat_count = force.len();
    let [previous_positions, previous_steps] = previous.map(|values| &values[..mat_count]);
    let (x, d) = (&mut x[..mat_count], &mut d[..mat_count]);
    let mut diverged_flag = 0_u64;
    for i in 0..mat_count {
        let [w, kappa, zeta, rest_position] = mat_coefficients(i);
        let step_change = force[i] * w - kappa * (previous_positions[i] - rest_position) - zeta * previous_steps[i];
        d[i] = previous_steps[i] + step_change;
        x[i] = previous_positions[i] + d[i];
        diverged_flag |= u64::from(!is_bounded(x[i]));
    }
    diverged_flag == 0
}

wide! {
    /// Move MATs in place; `coefficients` are w, κ, ζ and rest, (n) each. Returns whether all positions are bounded.
    pub(super) fn move_all(
        coefficients: [&[f64]; 4],
        force: &[f64],
        x: &mut [f64],
        d: &mut [f64],
    ) -> bool {
        let n = force.len();
        let [w, kappa, zeta, rest] = coefficients.map(|values| &values[..n]);
        update(|i| [w[i], kappa[i], zeta[i], rest[i]], force, x, d)
    }
}

wide! {
    /// [`move_all`] from positions and steps in `previous`, which are not changed.
    pub(super) fn move_from(
        coefficients: [&[f64]; 4],
        force: &[f64],
        previous: [&[f64]; 2],
        x: &mut [f64],
        d: &mut [f64],
    ) -> bool {
        let n = force.len();
        let [w, kappa, zeta, rest] = coefficients.map(|values| &values[..n]);
        update_from(|i| [w[i], kappa[i], zeta[i], rest[i]], force, previous, x, d)
    }
}

wide! {
    /// [`move_all`] of MATs with the same coefficients.
    pub(super) fn move_equal(
        coefficients: [f64; 4],
        force: &[f64],
        x: &mut [f64],
        d: &mut [f64],
    ) -> bool {
        update(|_| coefficients, force, x, d)
    }
}

wide! {
    /// [`move_from`] of MATs with the same coefficients.
    pub(super) fn move_equal_from(
        coefficients: [f64; 4],
        force: &[f64],
        previous: [&[f64]; 2],
        x: &mut [f64],
        d: &mut [f64],
    ) -> bool {
        update_from(|_| coefficients, force, previous, x, d)
    }
}

wide! {
    /// Move MATs by the fraction `frame_fraction` of a frame; `d` stays the step of a full frame.
    pub(crate) fn advance_by_fraction(
        frame_fraction: f64,
        coefficients: [&[f64]; 4],
        force: &[f64],
        x: &mut [f64],
        d: &mut [f64],
    ) {
        let n = force.len();
        let [w, kappa, zeta, rest] = coefficients.map(|values| &values[..n]);
        let (x, d) = (&mut x[..n], &mut d[..n]);
        for i in 0..n {
            let step_change = force[i] * w[i] - kappa[i] * (x[i] - rest[i]) - zeta[i] * d[i];
            d[i] += frame_fraction * step_change;
            x[i] += frame_fraction * d[i];
        }
    }
}

/// Whether a position is finite and within [`POSITION_MAX`]; false for NaN.
#[inline(always)]
pub(crate) fn is_bounded(x: f64) -> bool {
    x.abs() <= POSITION_MAX
}
