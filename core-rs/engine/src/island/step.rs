//! One step of an island, in phases whose order is the physics:
//!
//! | phase            | reads                                         | writes                                      |
//! |------------------|-----------------------------------------------|---------------------------------------------|
//! | `set_inputs`     | glides, leads, gates, real hands at frame n   | scheme of the frame, gates, imposed motions |
//! | `apply_links`    | x, d                                          | forces of links, drives and inputs          |
//! | `apply_strikes`  | forces without written hands                  | ergons and pushes, as forces                |
//! | `solve_contacts` | all forces but those of contacts and friction | forces of contacts and friction             |
//! | `write_outputs_and_counters` | all forces, x, d                  | outputs, forces on hands, energy accounts   |
//! | `advance`        | all forces                                    | x, d of frame n + 1; a frame in finer steps |
//! | `update_ledger`        | x, d of frame n + 1                           | ledger                                      |
//!
//! Each phase takes a value that only the phase before it returns, so no other order compiles. A step does not lock or
//! panic, and it allocates only to record ergons.

use super::phases::{StepInProgress, set_inputs};
use super::{Fault, Island, energy_account};
use crate::interrupt;
use crate::kernel::thread_team::ThreadTeam;

/// Most steps between two polls for an interrupt.
const POLL_STEPS: usize = 16;
/// Most modules that these steps compute.
const POLL_MODULES: usize = 1 << 17;

/// Output buffer of the steps of a frame; only the first step of a frame is heard.
pub(super) struct StepOutputs<'a> {
    /// (n_frames · n_out)
    outputs: &'a mut [f64],
    n_out: usize,
    oversampling: usize,
}

impl StepOutputs<'_> {
    /// The output row of a step, counted from the first step of the first frame, if the step is heard.
    pub(super) fn row(&mut self, step: usize) -> Option<&mut [f64]> {
        let is_heard = step.is_multiple_of(self.oversampling);
        is_heard.then(|| &mut self.outputs[step / self.oversampling * self.n_out..][..self.n_out])
    }
}

impl Island {
    /// Compute `n_frames` frames, as [`Island::process`] plays them.
    pub(crate) fn compute(&mut self, out: &mut [f64], n_frames: usize, team: &mut ThreadTeam<'_>) -> Result<(), Fault> {
        let mut outputs = StepOutputs {
            outputs: out,
            n_out: self.n_out(),
            oversampling: self.oversampling as usize,
        };
        let (step_count, may_coast) = (n_frames * outputs.oversampling, self.can_coast());
        let can_step_eventless = self.can_step_eventless();
        let (mut steps_done, mut next_poll_step) = (0, 0);
        let module_count = self.script.scheme.n_mat() + self.script.scheme.n_lia;
        let poll_interval = (POLL_MODULES / module_count.max(1)).clamp(1, POLL_STEPS);
        while steps_done < step_count {
            if steps_done >= next_poll_step {
                interrupt::poll();
                next_poll_step = steps_done + poll_interval;
            }
            if may_coast {
                steps_done += self.coast(&mut outputs, steps_done..step_count)?;
            }
            if can_step_eventless {
                let step_range = (steps_done, step_count.min(steps_done + poll_interval));
                let eventless_steps = self.step_eventless(&mut outputs, step_range, team)?;
                if eventless_steps > 0 {
                    steps_done += eventless_steps;
                    continue;
                }
            }
            if steps_done < step_count {
                self.step(outputs.row(steps_done), team)?;
                steps_done += 1;
            }
        }
        Ok(())
    }

    /// One step.
    fn step(&mut self, outputs: Option<&mut [f64]>, team: &mut ThreadTeam<'_>) -> Result<(), Fault> {
        let (script, state) = (&*self.script, &mut self.state);
        let n = state.frame;
        let mut changing_scheme = state.parameters.changing_scheme.take();
        set_inputs(script, state, changing_scheme.as_deref_mut(), n);
        let mut frame = StepInProgress {
            n,
            script,
            scheme: changing_scheme.as_deref().unwrap_or(&script.scheme),
            state,
            team,
        };
        let links_applied = frame.apply_links();
        let strikes_applied = frame.apply_strikes(links_applied);
        let forces_complete = frame.solve_contacts(strikes_applied);
        frame.write_outputs_and_counters(&forces_complete, outputs);
        let move_result = frame.advance(forces_complete);
        frame.update_ledger(&move_result);
        state.parameters.changing_scheme = changing_scheme;
        state.frame += 1;
        if !move_result.is_plausible {
            return self.handle_fault();
        }
        if n.is_multiple_of(energy_account::CHECK_STEPS) {
            return self.check_energy_gains();
        }
        Ok(())
    }
}
