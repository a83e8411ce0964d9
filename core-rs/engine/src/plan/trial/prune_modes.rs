//! Which modes of the bodies in an island are computed: those that are heard, according to the pilot.

use crate::island::inside::BodyPlan;
use crate::island::modal::Modal;
use crate::maths::pow;
use crate::network::{Error, LinkKind};
use crate::plan::IslandPlan;
use crate::plan::budget::Budget;
use crate::plan::constants::{PRUNE_TRIES, QUIETER};
use crate::plan::passes::assemble::Assembled;
use crate::plan::passes::truncate::{KeptModes, choose};
use crate::plan::trial::allowance::{Allowance, unless_spent};
use crate::plan::trial::pilot_run::{Excerpt, PilotRun, is_affordable, play};
use crate::plan::trial::waveform_error::{Spans, difference};

/// The island without the modes that are not heard, together at most `error_max` loud [dB]: chosen by their energies, then
/// checked by playing.
pub(in crate::plan) fn prune(
    island: &Assembled,
    (contact_substeps, run): (usize, &PilotRun),
    (excerpt, budget, error_max): (Excerpt, &Budget, Option<f64>),
    allowance: &Allowance,
) -> Result<Assembled, Error> {
    let counted = |mut island: Assembled, run: &PilotRun| {
        island.island_plan.counted_cost = Some(run.counted_cost.all());
        island
    };
    let with = |allowed: Option<f64>| {
        let bodies = island.island_plan.bodies.iter().zip(&run.squares);
        let pruned = bodies.map(|(body, squares)| match body {
            BodyPlan::Modal(modal) => keep(&island.island_plan, modal, squares, allowed, budget),
            BodyPlan::Mesh(_) | BodyPlan::Slow(_) => KeptModes::none(),
        });
        counted(island.clone().only(contact_substeps, pruned.collect()), run)
    };
    let count = |island: &Assembled| {
        island
            .island_plan
            .bodies
            .iter()
            .map(BodyPlan::n_modes)
            .sum::<usize>()
    };
    let Some(error_max) = error_max else {
        return Ok(with(None));
    };
    if !is_affordable(&island.island_plan, 2 * excerpt.n_frames) {
        return Ok(with(Some(error_max)));
    }
    // The reference has no modes above hearing: leaving them out is no error.
    let all = with(None);
    let sound = if count(&all) == count(island) {
        run.sound.clone()
    } else {
        let run = play(&all.island_plan, contact_substeps, excerpt, allowance);
        let Some(run) = unless_spent(run)? else {
            return Ok(all);
        };
        run.sound
    };
    let spans = Spans::new(&island.island_plan, excerpt.n_frames);
    let mut allowed = error_max;
    for _ in 0..PRUNE_TRIES {
        let mut fewer = with(Some(allowed));
        if count(&fewer) == count(&all) {
            break;
        }
        let run = play(&fewer.island_plan, contact_substeps, excerpt, allowance);
        let Some(run) = unless_spent(run)? else {
            break;
        };
        let loud = difference(&run.sound, &sound, &spans);
        if loud <= error_max {
            let bodies = fewer.bodies.iter_mut();
            bodies.for_each(|body| body.left_out = body.left_out.map(|_| loud));
            return Ok(counted(fewer, &run));
        }
        allowed -= (loud - error_max).max(QUIETER);
    }
    Ok(all)
}

/// The modes of a body that its outputs hear and its ports need.
fn keep(
    island_plan: &IslandPlan,
    body: &Modal,
    squares: &[f64],
    allowed: Option<f64>,
    budget: &Budget,
) -> KeptModes {
    // All complex modes stay: the two parts of one can only be dropped together, and computing them costs less than a
    // pilot to choose among them.
    if body.answers.is_some() {
        return KeptModes {
            modes: (0..body.modes.len()).collect(),
            left_out: None,
        };
    }
    let ports = body.ports.iter().map(|port| port.shape.as_slice());
    let listened = body.outputs.iter().map(|(_, shape)| shape.as_slice());
    let rows: Vec<&[f64]> = ports.chain(listened).collect();
    let mut modes_kept = choose(
        &excitations(body, squares),
        &rows,
        allowed,
        budget,
        |mode| body.frequency(mode),
    );
    // Rigid motion of the body stays, however quiet it is.
    let loose = (0..body.modes.len()).filter(|&mode| body.compliance(mode).is_none());
    modes_kept.modes.extend(loose);
    modes_kept.modes.sort_unstable();
    modes_kept.modes.dedup();
    let Some(db) = budget.left_out() else {
        return modes_kept;
    };
    // Modes that are left out make the ports stiffer: that has to stay too small for a contact to notice.
    let enough = pow(10.0, db / 20.0);
    let mut fallen: Vec<usize> = (0..body.modes.len())
        .filter(|mode| modes_kept.modes.binary_search(mode).is_err())
        .collect();
    for port in &body.ports {
        let stiff = stiffest(island_plan, port.mat);
        let compliance_share = |mode: usize| {
            let compliance = body.compliance(mode).unwrap_or(0.0);
            stiff * port.shape[mode] * port.shape[mode] * compliance
        };
        let mut lost: f64 = fallen.iter().map(|&mode| compliance_share(mode)).sum();
        // The lowest modes yield most; those that do not move the port yield nothing.
        fallen.retain(|&mode| {
            if lost <= enough || compliance_share(mode) == 0.0 {
                return true;
            }
            lost -= compliance_share(mode);
            modes_kept.modes.push(mode);
            false
        });
    }
    modes_kept.modes.sort_unstable();
    modes_kept
}

/// Ways in which modes get their energies: as the pilot measured, and as may happen later, by a strike at each place
/// that is ever struck and by a touch of each port that the pilot may have missed.
fn excitations(body: &Modal, squares: &[f64]) -> Vec<Vec<f64>> {
    let by = |shape: &Vec<f64>| -> Vec<f64> {
        let each = shape.iter().enumerate();
        each.map(|(mode, share)| share * share * body.compliance(mode).unwrap_or(0.0))
            .collect()
    };
    let is_measured = body.ports.len() == 1 && squares.iter().any(|square| *square > 0.0);
    let ports = body.ports.iter().filter(|_| !is_measured);
    let struck = body.struck.iter().map(|struck| by(&struck.shape));
    let touched = ports.map(|port| by(&port.shape));
    let indexed = squares.iter().enumerate();
    let indexed = indexed.map(|(mode, square)| body.compliance(mode).map_or(0.0, |_| *square));
    struck.chain(touched).chain([indexed.collect()]).collect()
}

/// Stiffness of the stiffest link on a MAT [N/m].
fn stiffest(island_plan: &IslandPlan, mat: usize) -> f64 {
    let runs = island_plan.network.runs().iter();
    let on = runs.filter(|run| {
        [run.a, run.b]
            .iter()
            .any(|&end| (end..end + run.len).contains(&mat))
    });
    on.map(|run| match &run.kind {
        LinkKind::Lnl(law) => law.slope(0.0).abs(),
        LinkKind::Followed(followed) => {
            let slopes = followed.corners().map(|law| law.slope(0.0).abs());
            slopes.fold(0.0, f64::max)
        }
        _ => run.k,
    })
    .fold(0.0, f64::max)
}
