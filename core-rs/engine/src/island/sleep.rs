//! Sleep: an island that is no longer audible is not computed until its next event. Its state does not change, and its
//! outputs keep their last value.
//!
//! An island is quiet if its outputs and its motion are 90 dB below the strongest that they were. It sleeps if it was
//! quiet for a whole period of checks and did not gain energy from the period before: an oscillation that grows by
//! itself from silence is not stopped.

mod output_level;

use super::Island;
use super::bodies::RunningBody;
use crate::archive::{option, state};
use crate::network::Network;
use crate::scheme::Scheme;
use crate::state::ModuleState;
use output_level::OutputLevel;

/// Frames between two checks, on a grid from frame 0: more than a period of the lowest audible pitch at any rate in
/// use, so that the range of an output is that of its oscillation.
const CHECK_FRAMES: u64 = 4_096;
/// Checks in a period: a snapshot may meet a turning point, several do not.
const CHECKS_PER_PERIOD: u64 = 4;
/// Amplitude of what is quiet, relative to the strongest: -90 dB, below the noise of 15 bits when the rest is silent.
const QUIET_AMPLITUDE: f64 = 3.16e-5;
/// The same as a power.
const QUIET_POWER: f64 = 1e-9;
/// A step of this part of a position is rounding.
const ROUNDING_SHARE: f64 = 4.0 * f64::EPSILON;

/// The levels of an island so far, by which it is decided whether it sleeps.
#[derive(Clone, Debug)]
pub(super) struct SleepMonitor {
    /// (n_out)
    output_levels: Vec<OutputLevel>,
    /// The largest square of a step of each MAT so far [m²]   (n_mat)
    step_squares_max: Vec<f64>,
    /// The largest motion of each body so far   (n_bodies)
    body_motions_max: Vec<f64>,
    /// The largest energy of a MAT so far, as d²/w.
    mat_energy_max: f64,
    /// The largest sum of energies in this period of checks, and in the one before.
    period_energy_max: f64,
    previous_period_energy_max: f64,
    /// Whether the island was quiet at all checks of this period.
    is_period_quiet: bool,
    /// Whether the island sleeps.
    is_asleep: bool,
}

state!(SleepMonitor {
    output_levels,
    step_squares_max,
    body_motions_max,
    mat_energy_max,
    period_energy_max,
    previous_period_energy_max,
    is_period_quiet,
    is_asleep
});
option!(SleepMonitor, fixed);

impl SleepMonitor {
    fn new(network: &Network, n_bodies: usize) -> Self {
        let outputs = network.outputs().iter();
        Self {
            output_levels: outputs.map(|output| OutputLevel::new(output.order)).collect(),
            step_squares_max: vec![0.0; network.n_mat()],
            body_motions_max: vec![0.0; n_bodies],
            mat_energy_max: 0.0,
            period_energy_max: 0.0,
            previous_period_energy_max: 0.0,
            is_period_quiet: false,
            is_asleep: false,
        }
    }

    /// Records frames of sound, (n_frames · n_out).
    fn record_outputs(&mut self, sound: &[f64]) {
        for frame in sound.chunks_exact(self.output_levels.len().max(1)) {
            let outputs = self.output_levels.iter_mut().zip(frame);
            outputs.for_each(|(output, sample)| output.record(*sample));
        }
    }

    pub(super) fn is_asleep(&self) -> bool {
        self.is_asleep
    }

    /// It sleeps no more.
    pub(super) fn wake(&mut self) {
        self.is_asleep = false;
    }

    /// Writes the outputs while it sleeps into a frame (n_out).
    pub(super) fn write_held_outputs(&self, frame: &mut [f64]) {
        for (sample, output) in frame.iter_mut().zip(&self.output_levels) {
            *sample = output.last_value();
        }
    }

    /// Checks outputs, MATs and bodies; returns whether a period ends in which all checks were quiet. `check_index`
    /// counts the checks of a period from 1; the last is 0.
    fn check_quiet(
        &mut self,
        scheme: &Scheme,
        modules: &ModuleState,
        bodies: &[RunningBody],
        check_index: u64,
    ) -> bool {
        let mut is_quiet = true;
        for output in &mut self.output_levels {
            is_quiet &= output.is_quiet(QUIET_AMPLITUDE);
        }
        let mut energy_sum = 0.0;
        let mat_motions = modules.x.iter().zip(&modules.d).zip(&scheme.w);
        for (((x, d), w), square_max) in mat_motions.zip(&mut self.step_squares_max) {
            let step_square = d * d;
            *square_max = square_max.max(step_square);
            // Imposed points (w = 0) count no energy.
            let mat_energy = if *w > 0.0 { step_square / w } else { 0.0 };
            self.mat_energy_max = self.mat_energy_max.max(mat_energy);
            energy_sum += mat_energy;
            is_quiet &= step_square <= QUIET_POWER * *square_max || d.abs() <= ROUNDING_SHARE * x.abs();
        }
        energy_sum /= self.mat_energy_max.max(f64::MIN_POSITIVE);
        for (body, motion_max) in bodies.iter().zip(&mut self.body_motions_max) {
            let body_motion = body.motion_level();
            *motion_max = motion_max.max(body_motion);
            energy_sum += body_motion / motion_max.max(f64::MIN_POSITIVE);
            is_quiet &= body_motion <= QUIET_POWER * *motion_max;
        }
        self.period_energy_max = self.period_energy_max.max(energy_sum);
        self.is_period_quiet = is_quiet && (self.is_period_quiet || check_index == 1);
        if check_index != 0 {
            return false;
        }
        let has_faded = self.period_energy_max <= self.previous_period_energy_max;
        self.previous_period_energy_max = std::mem::take(&mut self.period_energy_max);
        self.is_period_quiet && has_faded
    }
}

impl Island {
    /// From here on, sleep when it is quiet.
    pub(crate) fn sleep_when_quiet(&mut self) {
        // Slow bodies are kicked only every `kick_interval` steps; such islands never sleep.
        let is_slow = |body: &RunningBody| matches!(body, RunningBody::Slow(slow) if slow.kick_interval() > 1);
        let state = &self.state;
        if !state.motion.bodies.iter().any(is_slow)
            && state.sources.voices.iter().all(|voice| voice.kick_interval() == 1)
        {
            self.sleep_monitor = Some(SleepMonitor::new(&self.network, state.motion.bodies.len()));
        }
    }

    /// Steps between two checks.
    fn check_interval_steps(&self) -> u64 {
        CHECK_FRAMES * u64::from(self.oversampling)
    }

    /// The step of the next check; never for an island that may not sleep.
    pub(super) fn next_quiet_check(&self) -> u64 {
        let check_interval_steps = self.check_interval_steps();
        let next_check = (self.state.frame / check_interval_steps + 1) * check_interval_steps;
        self.sleep_monitor.as_ref().map_or(u64::MAX, |_| next_check)
    }

    /// Records frames that were played, (n_frames · n_out). If a period of checks ends there, and the island sleeps
    /// from there on, returns the step until which it sleeps.
    pub(super) fn try_sleep(&mut self, sound: &[f64]) -> Option<u64> {
        let (step, check_interval_steps) = (self.state.frame, self.check_interval_steps());
        let state = &self.state;
        let sleep_monitor = self.sleep_monitor.as_mut()?;
        sleep_monitor.record_outputs(sound);
        if !step.is_multiple_of(check_interval_steps) {
            return None;
        }
        let current_scheme = state
            .parameters
            .changing_scheme
            .as_deref()
            .unwrap_or(&self.script.scheme);
        let may_sleep = sleep_monitor.check_quiet(
            current_scheme,
            &state.motion.modules,
            &state.motion.bodies,
            (step / check_interval_steps) % CHECKS_PER_PERIOD,
        );
        let wake_step = may_sleep.then(|| self.wake_step()).flatten();
        if let Some(sleep_monitor) = &mut self.sleep_monitor {
            sleep_monitor.is_asleep = wake_step.is_some();
        }
        wake_step
    }

    /// The step of the next event; `None` if it is in this frame, so that the island has to wake now. It wakes no
    /// earlier, because a session may know an event from that frame on only, and has to play what is rendered.
    pub(super) fn wake_step(&self) -> Option<u64> {
        let (step, steps_per_frame) = (self.state.frame, u64::from(self.oversampling));
        Some(self.next_event_step(step)).filter(|event_step| *event_step - step >= steps_per_frame)
    }
}
