//! Coasting: steps in which no contact closes. Masses fly or swing freely, bodies move by their modes or by the flow of
//! their linear springs, and nothing else is computed. After the blow of a hammer this is the case for seconds.
//!
//! The result is the same to the last bit as that of ordinary steps; only the test whether a finely computed contact
//! may close has a slightly wider margin.

use std::ops::Range;

use super::energy_account;
use super::fault::Fault;
use super::fine::OPEN_MARGIN;
use super::step::StepOutputs;
use super::{ExcitationSources, Island, Script, bodies, energy_rise};
use crate::kernel;
use crate::kernel::thread_team::ThreadTeam;
use crate::network::But;
use crate::scheme::{LinkRun, LinkRunKind, Scheme};
use crate::state::ModuleState;
use crate::timeline::{Drive, DriveSource};

/// Fewer steps are not worth coasting.
const COAST_STEPS_MIN: usize = 2;
/// Steps for which one bound on the swing of masses is valid: rounding adds less than about [`MOTION_BOUND_SLACK`] to
/// it.
const BOUND_STEPS: usize = 1024;
/// Steps until the next attempt at such a bound.
const RETRY_STEPS: usize = 32;
/// Share by which bounds on the swing are enlarged for rounding.
const MOTION_BOUND_SLACK: f64 = 1e-6;

impl Island {
    /// Whether it may coast: its masses are joined by contacts alone, its bodies are linear, and events alone act on
    /// it.
    pub(super) fn can_coast(&self) -> bool {
        let (scheme, motion) = (&self.script.scheme, &self.state.motion);
        let has_only_contacts = scheme.runs.iter().all(|run| contact_law(run).is_some())
            && scheme.fused_springs.is_empty()
            && scheme.exact_runs.is_empty()
            && scheme.proxies.is_empty()
            && scheme.weight.iter().all(|&weight| weight == 0.0);
        let has_contacts = !scheme.runs.is_empty() || motion.fine_links.is_some();
        has_only_contacts
            && has_contacts
            && motion.bodies.iter().all(bodies::RunningBody::can_coast)
            && self.has_only_events()
    }

    /// Whether events alone act on it, and nothing is checked after each step: it has no real hand, no drive but
    /// strikes, and no layer, gate, glide, guard, ledger or muted part.
    pub(super) fn has_only_events(&self) -> bool {
        let (script, parameters, monitors) = (&*self.script, &self.state.parameters, &self.state.monitors);
        let is_struck = |drive: &Drive| matches!(drive.source, DriveSource::Strikes { .. });
        let has_only_strikes = script.hand_bindings.is_empty()
            && script.drives.iter().all(is_struck)
            && !script.voices.iter().any(|voice_script| voice_script.is_layer);
        let is_constant =
            script.gates.is_empty() && parameters.changing_scheme.is_none() && parameters.velocity_factor >= 1.0;
        let is_unwatched =
            monitors.ledger.is_none() && monitors.guard.is_none() && monitors.muted_parts.iter().next().is_none();
        has_only_strikes && is_constant && is_unwatched
    }

    /// Coast over steps of a block for as long as no contact closes; returns the number of steps.
    pub(super) fn coast(&mut self, outputs: &mut StepOutputs<'_>, steps: Range<usize>) -> Result<usize, Fault> {
        let (script, state) = (&*self.script, &mut self.state);
        let (scheme, first_step) = (&script.scheme, state.frame);
        let mut fine_links = state.motion.fine_links.as_mut();
        let has_carried_force = fine_links.as_ref().is_some_and(|links| links.has_carried_force());
        if has_carried_force || !are_contacts_open(scheme, &state.motion.modules) {
            return Ok(0);
        }
        let gains = state.monitors.energy_gains.as_ref();
        if gains.is_some_and(|gains| !gains.is_idle()) {
            return Ok(0);
        }
        let steps_to_event = steps_to_event(script, &state.sources, first_step);
        let modal_bodies = state.motion.bodies.iter().filter_map(bodies::RunningBody::modal);
        let steps_ahead = modal_bodies.map(super::modal::RunningModal::frames_ahead);
        let energy_rise = state.monitors.energy_rise.as_ref();
        let steps_to_checks = [
            energy_rise.map(|_| energy_rise::EnergyRise::steps_to_check(first_step)),
            gains.map(|_| first_step.next_multiple_of(energy_account::CHECK_STEPS) - first_step),
        ];
        let steps_to_checks = steps_to_checks.into_iter().flatten().map(|steps| steps as usize);
        let coast_steps = steps_ahead.chain(steps_to_checks);
        let coast_steps = coast_steps.fold(steps_to_event.min(steps.len()), usize::min);
        if coast_steps < COAST_STEPS_MIN {
            return Ok(0);
        }
        // The motion without forces is needed here: forces of the step before are cleared.
        state.motion.modules.force.fill(0.0);
        let has_bodies = !state.motion.bodies.is_empty();
        let (mut steps_done, mut is_bounded, mut open_until_step, mut next_bound_attempt) = (0, true, 0, 0);
        while steps_done < coast_steps && is_bounded {
            let modules = &mut state.motion.modules;
            if steps_done >= open_until_step {
                let stays_open = fine_links.as_ref().is_none_or(|fine| fine.stays_open(scheme, modules));
                if !stays_open || !are_contacts_open(scheme, modules) {
                    break;
                }
                if steps_done >= next_bound_attempt && !has_bodies {
                    let bounds = |mat| motion_bounds(scheme, modules, mat);
                    let fine_links = fine_links.as_ref();
                    if cannot_close(scheme, bounds)
                        && fine_links.is_none_or(|links| links.cannot_close(scheme, bounds, MOTION_BOUND_SLACK))
                    {
                        open_until_step = steps_done + BOUND_STEPS;
                    }
                    next_bound_attempt = steps_done + RETRY_STEPS;
                }
            }
            if steps_done == 0 {
                fine_links.iter_mut().for_each(|links| links.set_open(modules));
                for run in &scheme.runs {
                    // With the sign of zero that an open contact's force has.
                    modules.link_forces[run.links()].fill(0.0 * contact_law(run).map_or(0.0, But::sign));
                }
            }
            let island_step = first_step + steps_done as u64;
            if let Some(output_row) = outputs.row(steps.start + steps_done) {
                kernel::write_outputs(scheme, modules, output_row);
                for running_body in &state.motion.bodies {
                    running_body.add_outputs_ahead(steps_done, output_row);
                }
                state.monitors.muted_parts.fade(island_step, scheme, output_row);
            }
            for (voice, voice_script) in state.sources.voices.iter_mut().zip(&script.voices) {
                voice.step_idle(voice_script, &mut state.sources.reports, island_step);
            }
            is_bounded = kernel::advance_mats(scheme, &mut [], modules, None, &mut ThreadTeam::alone());
            steps_done += 1;
            for running_body in &mut state.motion.bodies {
                is_bounded &= running_body.set_ports_ahead(steps_done, modules);
            }
        }
        let modal_bodies = state.motion.bodies.iter_mut();
        for modal in modal_bodies.filter_map(bodies::RunningBody::modal_mut) {
            modal.advance_ahead(steps_done);
        }
        state.frame += steps_done as u64;
        if !is_bounded {
            self.handle_fault()?;
        }
        Ok(steps_done)
    }
}

/// Steps from `step_now` before the first in which a gesture, a push or an ergon may act.
pub(super) fn steps_to_event(script: &Script, sources: &ExcitationSources, step_now: u64) -> usize {
    let strike_frame = script.strike_forces.get(sources.next_strike).map(|strike| strike.frame);
    let next_ergon = script.ergons.get(sources.next_ergon);
    let next_ergon = next_ergon.map(|(frame, _)| *frame);
    let voice_frames = sources.voices.iter().zip(&script.voices);
    let voice_frames = voice_frames
        .map(|(voice, voice_script)| voice.idle_end_frame(voice_script, &script.gestures).unwrap_or(step_now));
    let event_frames = strike_frame.into_iter().chain(next_ergon).chain(voice_frames);
    let event_frames = event_frames.chain(sources.has_pending_strikes().then_some(step_now));
    let event_steps = event_frames.map(|event_frame| event_frame.saturating_sub(step_now) as usize);
    event_steps.fold(usize::MAX, usize::min)
}

/// The contact that the links of a run are, if they are contacts.
fn contact_law(run: &LinkRun) -> Option<&But> {
    match &run.kind {
        LinkRunKind::But(but) => Some(but),
        _ => None,
    }
}

/// Whether no contact that is computed once a step pushes in this step.
fn are_contacts_open(scheme: &Scheme, modules: &ModuleState) -> bool {
    scheme.runs.iter().all(|run| {
        let contact_side = contact_law(run).map_or(0.0, But::sign);
        let is_closed = |i: usize| contact_side * (modules.x[run.b + i] - modules.x[run.a + i] - run.rest) > 0.0;
        !(0..run.len).any(is_closed)
    })
}

/// Whether no contact that is computed once a step closes for as long as its points move freely; `bounds` bounds the
/// distance of each from its rest position, and its step [m].
fn cannot_close(scheme: &Scheme, bounds: impl Fn(usize) -> [f64; 2]) -> bool {
    scheme.runs.iter().all(|run| {
        let contact_side = contact_law(run).map_or(0.0, But::sign);
        (0..run.len).all(|i| {
            let (first_mat, second_mat) = (run.a + i, run.b + i);
            let rest_elongation = scheme.rest[second_mat] - scheme.rest[first_mat] - run.rest;
            contact_side * rest_elongation + (bounds(first_mat)[0] + bounds(second_mat)[0]) * (1.0 + MOTION_BOUND_SLACK)
                < -OPEN_MARGIN
        })
    })
}

/// Bounds on the free motion of a MAT [m]: its distance from its rest position, and its step. Infinite if its poles
/// give no bound.
fn motion_bounds(scheme: &Scheme, modules: &ModuleState, mat: usize) -> [f64; 2] {
    let (kappa, b) = (scheme.kappa[mat], 1.0 - scheme.zeta[mat]);
    let x = modules.x[mat] - scheme.rest[mat];
    let position_before = x - modules.d[mat];
    let port_motion = modules.free_port_motion.get(mat).copied().unwrap_or(0.0);
    if modules.d[mat] == 0.0 && kappa * x == 0.0 && port_motion == 0.0 {
        return [x.abs(), 0.0];
    }
    if port_motion != 0.0 || b <= 0.0 || b > 1.0 || kappa < 0.0 {
        return [f64::INFINITY; 2];
    }
    // x[n+1] = 2h·x[n] − b·x[n−1]: poles h ± √(h² − b).
    let h = 0.5 * (1.0 + b - kappa);
    let imaginary_square = b - h * h;
    if imaginary_square > 0.0 {
        // Poles of magnitude √b: `decayed_position` is that a step before, less the decay of one step. Each pole is √κ
        // away from 1.
        let decayed_position = position_before * b.sqrt();
        let amplitude_square =
            (x * x + decayed_position * decayed_position - 2.0 * x * position_before * h) * b / imaginary_square;
        let amplitude = amplitude_square.max(0.0).sqrt();
        return [amplitude, amplitude * kappa.sqrt()];
    }
    let pole_offset = (-imaginary_square).sqrt();
    let [fast_pole, slow_pole] = [h - pole_offset, h + pole_offset];
    if fast_pole < 0.0 || slow_pole > 1.0 || pole_offset == 0.0 {
        return [f64::INFINITY; 2];
    }
    // x[n] = u·slowⁿ + v·fastⁿ.
    let u = slow_pole * (x - position_before * fast_pole) / (2.0 * pole_offset);
    let v = x - u;
    [
        u.abs() + v.abs(),
        u.abs() * (1.0 - slow_pole) + v.abs() * (1.0 - fast_pole),
    ]
}
