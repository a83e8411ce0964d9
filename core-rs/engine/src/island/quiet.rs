//! Sleep: an island that nobody hears any more is stopped until its next event. Its clock stands still and its outputs
//! keep their last value.
//!
//! An island is quiet if its outputs and its motion are 90 dB below the strongest that they were. It sleeps if it was
//! quiet for a whole period of looks and did not gain energy from the period before: what grows by itself from silence
//! is left to grow.

mod output_level;

use super::Island;
use super::inside::RunningBody;
use crate::archive::{option, state};
use crate::network::Network;
use crate::scheme::Scheme;
use crate::state::Body;
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
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// What is known of how strongly an island moved.
#[derive(Clone, Debug)]
pub(super) struct Quiet {
    /// (n_out)
    outputs: Vec<OutputLevel>,
    /// The largest square of a step of each MAT so far [m²]   (n_mat)
    steps: Vec<f64>,
    /// The largest motion of each body so far   (n_bodies)
    bodies: Vec<f64>,
    /// The largest energy of a MAT so far, as d²/w.
    energy: f64,
    /// The largest sum of energies in this period of looks, and in the one before.
    period: f64,
    before: f64,
    /// Whether all looks of this period were quiet.
    is_quiet: bool,
    /// Whether the island sleeps.
    is_asleep: bool,
}

state!(Quiet {
    outputs,
    steps,
    bodies,
    energy,
    period,
    before,
    is_quiet,
    is_asleep
});
option!(Quiet, fixed);

impl Quiet {
    fn new(network: &Network, n_bodies: usize) -> Self {
        let outputs = network.outputs().iter();
        Self {
            outputs: outputs.map(|output| OutputLevel::new(output.order)).collect(),
            steps: vec![0.0; network.n_mat()],
            bodies: vec![0.0; n_bodies],
            energy: 0.0,
            period: 0.0,
            before: 0.0,
            is_quiet: false,
            is_asleep: false,
        }
    }

    /// Takes record of frames of sound, (n_frames · n_out).
    fn record(&mut self, sound: &[f64]) {
        for frame in sound.chunks_exact(self.outputs.len().max(1)) {
            let outputs = self.outputs.iter_mut().zip(frame);
            outputs.for_each(|(output, value)| output.record(*value));
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
    pub(super) fn hold(&self, frame: &mut [f64]) {
        for (value, output) in frame.iter_mut().zip(&self.outputs) {
            *value = output.value();
        }
    }

    /// Looks at outputs, MATs and bodies; whether a period of looks ends that were all quiet. `index` counts the looks
    /// of a period from 1; the last is 0.
    fn look(&mut self, scheme: &Scheme, body: &Body, bodies: &[RunningBody], index: u64) -> bool {
        let mut is_quiet = true;
        for output in &mut self.outputs {
            is_quiet &= output.is_quiet(QUIET_AMPLITUDE);
        }
        let mut energy_sum = 0.0;
        let mat_motions = body.x.iter().zip(&body.d).zip(&scheme.w);
        for (((x, d), w), largest) in mat_motions.zip(&mut self.steps) {
            let step_square = d * d;
            *largest = largest.max(step_square);
            // What is led has no energy of its own.
            let mat_energy = if *w > 0.0 { step_square / w } else { 0.0 };
            self.energy = self.energy.max(mat_energy);
            energy_sum += mat_energy;
            is_quiet &= step_square <= QUIET_POWER * *largest || d.abs() <= ROUNDING * x.abs();
        }
        energy_sum /= self.energy.max(f64::MIN_POSITIVE);
        for (body, largest) in bodies.iter().zip(&mut self.bodies) {
            let body_motion = body.motion();
            *largest = largest.max(body_motion);
            energy_sum += body_motion / largest.max(f64::MIN_POSITIVE);
            is_quiet &= body_motion <= QUIET_POWER * *largest;
        }
        self.period = self.period.max(energy_sum);
        self.is_quiet = is_quiet && (self.is_quiet || index == 1);
        if index != 0 {
            return false;
        }
        let has_faded = self.period <= self.before;
        self.before = std::mem::take(&mut self.period);
        self.is_quiet && has_faded
    }
}

impl Island {
    /// From here on, sleep when it is quiet.
    pub(crate) fn sleep_when_quiet(&mut self) {
        // Springs in space of slow bodies pull in a rhythm of their own.
        let is_slow = |body: &RunningBody| matches!(body, RunningBody::Slow(slow) if slow.kick_every() > 1);
        let state = &self.state;
        if !state.matter.bodies.iter().any(is_slow) && state.hands.voices.iter().all(|voice| voice.kick_every() == 1) {
            self.quiet = Some(Quiet::new(&self.network, state.matter.bodies.len()));
        }
    }

    /// Steps between two looks.
    fn look_steps(&self) -> u64 {
        CHECK_FRAMES * u64::from(self.oversampling)
    }

    /// The step of the next look; never for an island that may not sleep.
    pub(super) fn next_quiet_look(&self) -> u64 {
        let look_steps = self.look_steps();
        let next_look = (self.state.frame / look_steps + 1) * look_steps;
        self.quiet.as_ref().map_or(u64::MAX, |_| next_look)
    }

    /// Takes record of frames that were played, (n_frames · n_out). If that ends a period of looks after which the
    /// island sleeps, returns the step until which it does.
    pub(super) fn falls_asleep(&mut self, sound: &[f64]) -> Option<u64> {
        let (island_step, look_steps) = (self.state.frame, self.look_steps());
        let state = &self.state;
        let quiet = self.quiet.as_mut()?;
        quiet.record(sound);
        if !island_step.is_multiple_of(look_steps) {
            return None;
        }
        let scheme_now = state.values.scheme.as_deref().unwrap_or(&self.script.scheme);
        let may_sleep = quiet.look(
            scheme_now,
            &state.matter.body,
            &state.matter.bodies,
            (island_step / look_steps) % CHECKS_PER_PERIOD,
        );
        let wake_step = may_sleep.then(|| self.wakes_at()).flatten();
        if let Some(quiet) = &mut self.quiet {
            quiet.is_asleep = wake_step.is_some();
        }
        wake_step
    }

    /// The step of the next event; `None` if it is in this frame, so that the island has to wake now. It wakes no
    /// earlier, because a session may know an event from that frame on only, and has to play what is rendered.
    pub(super) fn wakes_at(&self) -> Option<u64> {
        let (island_step, steps_per_frame) = (self.state.frame, u64::from(self.oversampling));
        Some(self.due(island_step)).filter(|due| *due - island_step >= steps_per_frame)
    }
}
