//! Steps in which no gesture, push or ergon acts, of an island whose links pull once a step: of all phases of a step
//! only those are left that do something. The result is the same to the last bit as that of ordinary steps.

use super::coast::steps_to_event;
use super::fault::Fault;
use super::step::StepOutputs;
use super::{Island, energy_account};
use crate::kernel;
use crate::kernel::thread_team::ThreadTeam;

impl Island {
    /// Whether it may compute steps without events by themselves: links pull once a step, and events alone act on it.
    pub(super) fn can_step_eventless(&self) -> bool {
        let (script, motion) = (&*self.script, &self.state.motion);
        let has_only_links = script.scheme.exact_runs.is_empty()
            && script.scheme.proxies.is_empty()
            && motion.fine_links.is_none()
            && motion.modules.link_memories.is_empty();
        let has_no_bindings = script.port_bindings.is_empty() && script.sound_drives.is_empty();
        has_only_links && has_no_bindings && self.has_only_events()
    }

    /// Compute steps from `start_step` up to the next event, the next check of accounts or `end_step`; returns their
    /// number.
    pub(super) fn step_eventless(
        &mut self,
        outputs: &mut StepOutputs<'_>,
        (start_step, end_step): (usize, usize),
        team: &mut ThreadTeam<'_>,
    ) -> Result<usize, Fault> {
        let (script, state) = (&*self.script, &mut self.state);
        let first_frame = state.frame;
        let steps_to_check = first_frame.next_multiple_of(energy_account::CHECK_STEPS) - first_frame;
        let step_count = (end_step - start_step).min(steps_to_check as usize);
        let step_count = step_count.min(steps_to_event(script, &state.sources, first_frame));
        if step_count == 0 {
            return Ok(0);
        }
        let scheme = &script.scheme;
        let super::State {
            parameters,
            motion,
            sources,
            monitors,
            ..
        } = state;
        let super::MotionState {
            modules,
            bodies,
            scratch,
            targets,
            ..
        } = motion;
        targets.clear();
        let (mut steps_done, mut is_bounded) = (0, true);
        while steps_done < step_count && is_bounded {
            let n = first_frame + steps_done as u64;
            kernel::compute_link_forces(scheme, &parameters.gate_openings, modules, scratch, team);
            for (voice, voice_script) in sources.voices.iter_mut().zip(&script.voices) {
                voice.step_idle(voice_script, &mut sources.reports, n);
            }
            bodies
                .iter_mut()
                .for_each(|running_body| running_body.apply_strikes(n, modules));
            monitors.contact_peaks.record_forces(n, &modules.link_forces);
            if let Some(output_row) = outputs.row(start_step + steps_done) {
                kernel::write_outputs(scheme, modules, output_row);
                bodies
                    .iter()
                    .for_each(|running_body| running_body.add_outputs(output_row));
            }
            if let Some(gains) = &mut monitors.energy_gains {
                gains.step(scheme, &parameters.gate_openings, targets, modules);
            }
            for running_body in &mut *bodies {
                running_body.step(n, &modules.force, team);
            }
            is_bounded = kernel::advance_mats(scheme, targets, modules, scratch.mesh_partition.as_ref(), team);
            for running_body in &*bodies {
                running_body.set_ports(modules);
                is_bounded &= running_body.is_bounded();
            }
            steps_done += 1;
        }
        state.frame += steps_done as u64;
        if !is_bounded {
            self.handle_fault()?;
        }
        Ok(steps_done)
    }
}
