//! Which modes of the bodies in an island are computed: those that are heard, according to the pilot.

use crate::assembly::assemble::Assembled;
use crate::assembly::budget::Budget;
use crate::assembly::constants::QUIETER_STEP_DB;
use crate::assembly::truncate::{KeptModes, loudest_by_energy};
use crate::assembly::unit::IslandPlan;
use crate::island::bodies::BodyPlan;
use crate::island::modal::Modal;
use crate::maths::pow;
use crate::network::{Error, LinkKind};
use crate::plan::constants::PRUNE_TRIALS_MAX;
use crate::plan::trial::allowance::{Allowance, none_if_spent};
use crate::plan::trial::pilot_run::{Excerpt, PilotRun, is_affordable, play};
use crate::plan::trial::waveform_error::{ComparedSpans, difference_db};

/// The island without the modes that are not heard, together at most `error_max` loud [dB]: chosen by their energies,
/// then checked by playing.
pub(in crate::plan) fn prune(
    island: &Assembled,
    (contact_substeps, run): (usize, &PilotRun),
    (excerpt, budget, error_max): (Excerpt, &Budget, Option<f64>),
    allowance: &Allowance,
) -> Result<Assembled, Error> {
    let with_counted_cost = |mut island: Assembled, run: &PilotRun| {
        island.island_plan.counted_cost = Some(run.counted_cost.total_ns());
        island
    };
    let pruned_within = |error_allowed: Option<f64>| {
        let bodies = island.island_plan.bodies.iter().zip(&run.mode_amplitudes_squared);
        let pruned_modes = bodies.map(|(body, squares)| match body {
            BodyPlan::Modal(modal) => audible_modes(&island.island_plan, modal, squares, error_allowed, budget),
            BodyPlan::Mesh(_) | BodyPlan::Slow(_) => KeptModes::empty(),
        });
        with_counted_cost(island.clone().with_modes(contact_substeps, pruned_modes.collect()), run)
    };
    let count_modes = |island: &Assembled| island.island_plan.bodies.iter().map(BodyPlan::n_modes).sum::<usize>();
    let Some(error_max) = error_max else {
        return Ok(pruned_within(None));
    };
    if !is_affordable(&island.island_plan, 2 * excerpt.n_frames) {
        return Ok(pruned_within(Some(error_max)));
    }
    // The reference has no modes above hearing: leaving them out is no error.
    let reference = pruned_within(None);
    let reference_sound = if count_modes(&reference) == count_modes(island) {
        run.sound.clone()
    } else {
        let run = play(&reference.island_plan, contact_substeps, excerpt, allowance);
        let Some(run) = none_if_spent(run)? else {
            return Ok(reference);
        };
        run.sound
    };
    let spans = ComparedSpans::new(&island.island_plan, excerpt.n_frames);
    let mut error_allowed = error_max;
    for _ in 0..PRUNE_TRIALS_MAX {
        let mut pruned_island = pruned_within(Some(error_allowed));
        if count_modes(&pruned_island) == count_modes(&reference) {
            break;
        }
        let run = play(&pruned_island.island_plan, contact_substeps, excerpt, allowance);
        let Some(run) = none_if_spent(run)? else {
            break;
        };
        let dropped_loudness = difference_db(&run.sound, &reference_sound, &spans);
        if dropped_loudness <= error_max {
            let bodies = pruned_island.bodies.iter_mut();
            bodies.for_each(|body| body.left_out_db = body.left_out_db.map(|_| dropped_loudness));
            return Ok(with_counted_cost(pruned_island, &run));
        }
        error_allowed -= (dropped_loudness - error_max).max(QUIETER_STEP_DB);
    }
    Ok(reference)
}

/// The modes of a body that its outputs hear and its ports need.
fn audible_modes(
    island_plan: &IslandPlan,
    body: &Modal,
    amplitudes_squared: &[f64],
    error_allowed: Option<f64>,
    budget: &Budget,
) -> KeptModes {
    // All complex modes stay: the two parts of one can only be dropped together, and computing them costs less than a
    // pilot to choose among them.
    if body.complex_responses.is_some() {
        return KeptModes {
            modes: (0..body.modes.len()).collect(),
            left_out_db: None,
        };
    }
    let port_shapes = body.ports.iter().map(|port| port.shape.as_slice());
    let output_shapes = body.outputs.iter().map(|(_, shape)| shape.as_slice());
    let shape_rows: Vec<&[f64]> = port_shapes.chain(output_shapes).collect();
    let mut modes_kept = loudest_by_energy(
        &mode_excitations(body, amplitudes_squared),
        &shape_rows,
        error_allowed,
        budget,
        |mode| body.frequency(mode),
    );
    // Rigid motion of the body stays, however quiet it is.
    let rigid_modes = (0..body.modes.len()).filter(|&mode| body.compliance(mode).is_none());
    modes_kept.modes.extend(rigid_modes);
    modes_kept.modes.sort_unstable();
    modes_kept.modes.dedup();
    let Some(left_out_level) = budget.left_out_db_max() else {
        return modes_kept;
    };
    // Modes that are left out make the ports stiffer: that has to stay too small for a contact to notice.
    let stiffening_max = pow(10.0, left_out_level / 20.0);
    let mut dropped_modes: Vec<usize> = (0..body.modes.len())
        .filter(|mode| modes_kept.modes.binary_search(mode).is_err())
        .collect();
    for port in &body.ports {
        let port_stiffness = stiffest_link(island_plan, port.mat);
        let compliance_share = |mode: usize| {
            let compliance = body.compliance(mode).unwrap_or(0.0);
            port_stiffness * port.shape[mode] * port.shape[mode] * compliance
        };
        let mut lost_compliance: f64 = dropped_modes.iter().map(|&mode| compliance_share(mode)).sum();
        // The lowest modes yield most; those that do not move the port yield nothing.
        dropped_modes.retain(|&mode| {
            if lost_compliance <= stiffening_max || compliance_share(mode) == 0.0 {
                return true;
            }
            lost_compliance -= compliance_share(mode);
            modes_kept.modes.push(mode);
            false
        });
    }
    modes_kept.modes.sort_unstable();
    modes_kept
}

/// Ways in which modes get their energies: as the pilot measured, and as may happen later, by a strike at each place
/// that is ever struck and by a touch of each port that the pilot may have missed.
fn mode_excitations(body: &Modal, squares: &[f64]) -> Vec<Vec<f64>> {
    let energies_from = |shape: &Vec<f64>| -> Vec<f64> {
        let indexed_shape = shape.iter().enumerate();
        indexed_shape
            .map(|(mode, share)| share * share * body.compliance(mode).unwrap_or(0.0))
            .collect()
    };
    let is_measured = body.ports.len() == 1 && squares.iter().any(|square| *square > 0.0);
    let touched_ports = body.ports.iter().filter(|_| !is_measured);
    let struck_energies = body
        .struck_points
        .iter()
        .map(|struck_point| energies_from(&struck_point.shape));
    let touch_energies = touched_ports.map(|port| energies_from(&port.shape));
    let measured_energies = squares.iter().enumerate();
    let measured_energies = measured_energies.map(|(mode, square)| body.compliance(mode).map_or(0.0, |_| *square));
    struck_energies
        .chain(touch_energies)
        .chain([measured_energies.collect()])
        .collect()
}

/// Stiffness of the stiffest link on a MAT [N/m].
fn stiffest_link(island_plan: &IslandPlan, mat: usize) -> f64 {
    let link_runs = island_plan.network.runs().iter();
    let mat_runs = link_runs.filter(|run| [run.a, run.b].iter().any(|&end| (end..end + run.len).contains(&mat)));
    mat_runs
        .map(|run| match &run.kind {
            LinkKind::Lnl(law) => law.slope(0.0).abs(),
            LinkKind::Followed(followed) => {
                let law_slopes = followed.end_value_laws().map(|law| law.slope(0.0).abs());
                law_slopes.fold(0.0, f64::max)
            }
            _ => run.k,
        })
        .fold(0.0, f64::max)
}
