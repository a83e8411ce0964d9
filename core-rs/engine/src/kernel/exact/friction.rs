//! Forces of dry friction, given all other forces: friction opposes sliding, and holds ends that stick.

use super::super::{force_to_reach, predict_position};
use crate::dry::Turned;
use crate::scheme::{LinkRun, LinkRunKind, Scheme};
use crate::state::{ImposedTarget, ModuleState};

/// Two ends with given positions slide if the distance between them changes by more than this in a frame [m]; less is
/// rounding.
pub(crate) const SLIDE_DISTANCE_MIN: f64 = 1e-14;
/// A step below this fraction of the largest change that friction makes to a step is rounding: the mass is at rest.
const REST_STEP_RATIO: f64 = 1e-12;

/// Force of one friction, given all other forces [N].
pub(super) fn force(
    scheme: &Scheme,
    gates: &[f64],
    targets: &[ImposedTarget],
    modules: &ModuleState,
    run: &LinkRun,
) -> f64 {
    let LinkRunKind::Dry {
        law: dry_law,
        velocity_factor,
    } = &run.kind
    else {
        return 0.0;
    };
    let (first_mat, second_mat) = (run.a, run.b);
    let gate_opening = run.gate.map_or(1.0, |gate| gates[gate]);
    let v = modules.d[second_mat] - modules.d[first_mat];
    let dry_law = dry_law.with(run.z);
    let level_at = |v: f64| gate_opening * dry_law.level_at(v * velocity_factor);
    let imposed_target = |i: usize| targets.iter().find(|target| target.mat == i);
    let free_move = |i: usize| match imposed_target(i) {
        Some(target) => (target.x - modules.x[i], 0.0),
        None => (predict_position(scheme, modules, i) - modules.x[i], scheme.w[i]),
    };
    let ((da, wa), (db, wb)) = (free_move(first_mat), free_move(second_mat));
    let free_step = db - da;
    let step_per_force = wa + wb;
    if step_per_force > 0.0 {
        let step_after = |friction_level: f64| Turned::after_step(v, free_step - v, step_per_force * friction_level).v;
        let mut v_next = step_after(level_at(v));
        if dry_law.falls() {
            v_next = step_after(level_at(0.5 * (v + v_next)));
            // If the sliding passes through rest, the level is that near rest, however short the passage is.
            if v * v_next < 0.0 && (free_step - v).abs() <= step_per_force * level_at(0.0) {
                v_next = 0.0;
            }
        }
        return (free_step - v_next) / step_per_force;
    }
    // Both ends are imposed or fixed.
    let friction_level = level_at(0.5 * (v + free_step));
    if free_step.abs() > SLIDE_DISTANCE_MIN {
        let slide_sign = free_step.signum();
        // If the sliding reverses within the frame, friction acts in one direction before and in the other after.
        let turn_share = if slide_sign * v < -SLIDE_DISTANCE_MIN {
            (v + free_step) / (free_step - v)
        } else {
            1.0
        };
        return slide_sign * friction_level * turn_share;
    }
    // The ends do not slide: friction gives the force that holds them, limited by its level.
    let holding_force = |i: usize| {
        imposed_target(i)
            .filter(|_| scheme.w[i] > 0.0)
            .map(|target| force_to_reach(scheme, modules, i, target.x))
    };
    match (holding_force(first_mat), holding_force(second_mat)) {
        (Some(push), _) => push.clamp(-friction_level, friction_level),
        (None, Some(push)) => (-push).clamp(-friction_level, friction_level),
        (None, None) => 0.0,
    }
}

/// Stop masses that friction against a fixed point has brought to rest, if only a step of the size of rounding is left.
pub(crate) fn stop_resting_masses(scheme: &Scheme, modules: &mut ModuleState) {
    for run in scheme.exact_runs.iter().filter(|run| run.is_dry()) {
        for (mass, other) in [(run.a, run.b), (run.b, run.a)] {
            let is_fixed = scheme.w[other] == 0.0 && modules.d[other] == 0.0;
            let mass_step = modules.d[mass];
            if is_fixed && mass_step != 0.0 && mass_step.abs() <= REST_STEP_RATIO * scheme.w[mass] * run.z {
                modules.x[mass] -= mass_step;
                modules.d[mass] = 0.0;
            }
        }
    }
}
