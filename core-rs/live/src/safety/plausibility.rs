//! Checks that force and motion agree. Finds a motor that pushes the wrong way or not at all, a key pushed into its
//! stop, a sensor that freezes, and a force or a position that comes late.
//!
//! A hand may push against a force at any time, and a hand that holds still looks like a frozen sensor. So watching
//! alone proves nothing: the force is changed for some milliseconds, and the response of the key decides. There are two
//! ways. [`confirmation`] makes faint pulse tests all the time, which hold for every hand but take 56 ms; [`lateness`]
//! says how much depends on their being in time. [`observations`] watches for a key that runs away, or rests at a stop
//! that the force pulls it away from, and a [`probe`] decides within 8 ms or 40 ms; only `WRONG_RESPONSES_MAX` wrong
//! responses without a right one between them end the force, and pulse tests without any other force then decide. Two
//! observations count without a response: a force of newtons that pushes a resting key further into its stop, and,
//! where no pulse tests are made, a position that keeps its last bit while the force changes by newtons.
//!
//! Time is counted in steps of about a millisecond, without a clock. But for pulses and probes the force is unchanged,
//! to the last bit.

mod confirmation;
mod lateness;
mod observations;
mod probe;
mod pulse_test;

use super::TripCause;
use crate::wire::MAX_AXES;
use confirmation::{Confirmation, JudgedStep, Phase, Verdict};
use observations::{AxisObservations, AxisParameters, Suspicion};
use probe::{Probe, ProbeResponse};

/// Length of a step, if a tick is shorter [s].
const STEP_SECONDS: f64 = 1e-3;
/// An axis that tripped may push again after this time without the fault [s].
const RETRY_SECONDS: f64 = 3.0;
/// Its force then fades in over this time [s].
const FADE_SECONDS: f64 = 0.5;
/// A sensor counts as alive for this time after it has moved [s].
const ALIVE_SECONDS: f64 = 0.5;
/// For each kind of suspicion: the pause after a probe without a finding, at first and at most [s]. The pause doubles
/// each time.
const PROBE_PAUSES_SECONDS: [[f64; 2]; 2] = [[1.0, 4.0], [0.02, 1.0]];
/// After this time without a suspicion the pause starts again at its first value [s].
const PAUSE_RESET_SECONDS: f64 = 5.0;
/// Number of wrong responses to probes, without a right one between them, that end the force.
const WRONG_RESPONSES_MAX: u32 = 4;
/// Longest time without the piece's force until a response decides [s].
const VERIFICATION_SECONDS: f64 = 2.0;

/// The properties of an axis, for [`Plausibility`].
#[derive(Clone, Copy, Debug)]
pub(super) struct AxisSpec {
    /// Least and greatest position.
    pub(super) range: [f64; 2],
    /// Step of the sensor.
    pub(super) resolution: f64,
    /// Moving mass [kg], if it is known.
    pub(super) inertia: Option<f64>,
    /// Greatest force [N].
    pub(super) force_max: f64,
    /// Delay that the device tells [s].
    pub(super) delay_seconds: f64,
    /// Work that its motor may do on a hand at once [J], and for long [W].
    pub(super) energy_max: f64,
    pub(super) power_max: f64,
}

#[derive(Clone, Copy, Debug)]
enum CheckMode {
    Watching,
    Probing(Probe),
    /// No force but that of pulse tests, whose responses decide; steps since then.
    Verifying(u32),
    Tripped {
        trip: TripCause,
        faultless_steps: u32,
        steps_since_motion: u32,
    },
}

/// The check of one axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plausibility {
    parameters: AxisParameters,
    /// Ticks per step, and ticks since the last step.
    ticks_per_step: u32,
    ticks_since_step: u32,
    /// Greatest force [N].
    force_max: f64,
    /// Whether a suspicion is probed; otherwise only evident faults count.
    may_probe: bool,
    observations: AxisObservations,
    mode: CheckMode,
    /// Progress of the fade to full force after a trip, 0 to 1.
    fade_progress: f64,
    /// Whether a probe was ever answered the right way.
    is_confirmed: bool,
    /// Wrong responses since the last right one.
    wrong_responses: u32,
    /// For each kind of suspicion: steps until it may be probed again, and how often a probe had no finding.
    pauses: [(i32, u32); 2],
    /// Number of probes so far.
    probes: u64,
    confirmation: Confirmation,
}

impl Plausibility {
    /// An axis that is sent a force every `period` [s].
    pub(super) fn new(axis_spec: AxisSpec, period: f64) -> Self {
        let step_ticks = (STEP_SECONDS / period).round().max(1.0);
        let parameters = AxisParameters::new(axis_spec, step_ticks * period);
        Self {
            parameters,
            ticks_per_step: step_ticks as u32,
            ticks_since_step: 0,
            force_max: axis_spec.force_max.max(0.0),
            may_probe: true,
            observations: AxisObservations::default(),
            mode: CheckMode::Watching,
            fade_progress: 1.0,
            is_confirmed: false,
            wrong_responses: 0,
            pauses: [(0, 0); 2],
            probes: 0,
            confirmation: Confirmation::new(axis_spec, &parameters),
        }
    }

    /// Advance by a tick: `requested_force` is the force that is requested now, `previous_force` the force of the
    /// previous tick, `position` the key's position if there is a new one. Returns the force to ask for instead.
    pub(super) fn tick(&mut self, requested_force: f64, previous_force: f64, position: Option<f64>) -> f64 {
        self.ticks_since_step = (self.ticks_since_step + 1).min(self.ticks_per_step);
        let pass_share = self.confirmation.update_pass_share(previous_force);
        if let Some(new_position) = position
            && self.ticks_since_step == self.ticks_per_step
        {
            self.ticks_since_step = 0;
            self.step(new_position, previous_force, requested_force);
        }
        let force = match self.mode {
            // A later stage trips.
            _ if !requested_force.is_finite() => requested_force,
            CheckMode::Tripped { .. } => 0.0,
            CheckMode::Verifying(_) => self.confirmation.add_pulses(0.0),
            CheckMode::Probing(Probe {
                force_offset: offset,
                replaces_piece: true,
                ..
            }) => offset * self.fade_progress,
            // The force that was sent is changed, because one that is asked for may be clamped and hide the probe.
            CheckMode::Probing(probe) if probe.suspicion == Suspicion::PulledFromStop => {
                (probe.initial_force + probe.force_offset) / pass_share
            }
            CheckMode::Probing(Probe {
                force_offset: offset, ..
            }) => (requested_force.clamp(-self.force_max, self.force_max) + offset) * self.fade_progress,
            CheckMode::Watching => {
                let force = self.confirmation.add_pulses(requested_force);
                if self.fade_progress < 1.0 {
                    force * self.fade_progress
                } else {
                    force
                }
            }
        };
        self.confirmation.note_force(force);
        force
    }

    /// Why forces are off, if they are.
    pub(super) fn trip(&self) -> Option<TripCause> {
        match self.mode {
            CheckMode::Tripped { trip, .. } => Some(trip),
            _ => None,
        }
    }

    /// Number of probes so far.
    #[cfg(test)]
    pub(super) fn probes(&self) -> u64 {
        self.probes
    }

    /// Let the axis push again, at the player's request, whatever was found.
    pub(super) fn release(&mut self) {
        if self.trip().is_some() {
            self.resume();
        }
    }

    /// Forget earlier observations: a host that was stopped has missed motion and forces.
    fn restart(&mut self) {
        if self.trip().is_none() {
            self.mode = CheckMode::Watching;
            self.observations = AxisObservations::default();
            self.confirmation.restart();
        }
    }

    fn resume(&mut self) {
        self.mode = CheckMode::Watching;
        (self.fade_progress, self.wrong_responses, self.is_confirmed) = (0.0, 0, false);
        self.pauses = [(0, 0); 2];
        self.confirmation.reset();
        self.observations = AxisObservations::default();
    }

    fn step(&mut self, x: f64, previous_force: f64, requested_force: f64) {
        let step_time = self.parameters.step_seconds;
        let steps_in = move |seconds: f64| (seconds / step_time) as u32;
        let (retry_steps, alive_steps) = (steps_in(RETRY_SECONDS), steps_in(ALIVE_SECONDS));
        self.fade_progress = (self.fade_progress + self.parameters.step_seconds / FADE_SECONDS).min(1.0);
        let quiet_limit = -(steps_in(PAUSE_RESET_SECONDS) as i32);
        for (steps_left, fruitless_probes) in &mut self.pauses {
            *steps_left = (*steps_left - 1).max(quiet_limit);
            if *steps_left == quiet_limit {
                *fruitless_probes = 0;
            }
        }
        let displacement = self.observations.displacement_to(x);
        self.observations.add_step(x, previous_force, &self.parameters);
        let verdict = self.confirmation.advance(JudgedStep {
            position: x,
            displacement,
            sent_force: previous_force,
            phase: match self.mode {
                CheckMode::Watching => Phase::Playing,
                CheckMode::Probing(_) => Phase::Probing,
                CheckMode::Verifying(_) => Phase::Verifying,
                CheckMode::Tripped { .. } => Phase::Off,
            },
            is_at_stop: self.observations.is_at_stop(),
            may_be_frozen: self.observations.may_be_frozen(previous_force, &self.parameters),
        });
        match verdict {
            Verdict::Continue => {}
            Verdict::Verify => self.start_verification(),
            Verdict::Right => {
                self.resume();
                self.confirmation.confirm();
            }
            Verdict::Fault(cause) => return self.trip_with(cause),
        }
        match &mut self.mode {
            CheckMode::Watching => self.watch(previous_force),
            CheckMode::Verifying(steps) => {
                *steps += 1;
                if *steps >= steps_in(VERIFICATION_SECONDS) {
                    self.trip_with(self.confirmation.unverified_fault());
                }
            }
            CheckMode::Probing(probe) => {
                let response = probe.step(&self.observations, previous_force, &self.parameters);
                let probe = *probe;
                self.apply_response(probe, response);
            }
            CheckMode::Tripped {
                trip,
                faultless_steps,
                steps_since_motion,
            } => {
                *steps_since_motion = if self.observations.is_still() {
                    steps_since_motion.saturating_add(1)
                } else {
                    0
                };
                let is_fault_over = match trip {
                    TripCause::Frozen => *steps_since_motion < alive_steps,
                    TripCause::AtStop => self
                        .observations
                        .pushed_into_stop(requested_force, &self.parameters)
                        .is_none(),
                    _ => false,
                };
                *faultless_steps = if is_fault_over { *faultless_steps + 1 } else { 0 };
                if *faultless_steps >= retry_steps {
                    self.resume();
                }
            }
        }
    }

    /// End the piece's force until a response is right.
    fn start_verification(&mut self) {
        self.confirmation.begin_verification();
        self.mode = CheckMode::Verifying(0);
    }

    fn watch(&mut self, previous_force: f64) {
        let has_pulse_tests = self.confirmation.has_pulse_tests;
        if let Some(evident_trip) = self
            .observations
            .evident_fault(previous_force, has_pulse_tests, &self.parameters)
        {
            self.trip_with(evident_trip);
        } else if self.may_probe
            && !self.confirmation.precedes_probes(self.observations.is_at_stop())
            && let Some((suspicion_kind, direction)) =
                self.observations
                    .suspicion(previous_force, self.is_confirmed, has_pulse_tests, &self.parameters)
            && self.pauses[suspicion_kind as usize].0 <= 0
        {
            self.probes += 1;
            self.confirmation.interrupt();
            self.mode = CheckMode::Probing(Probe::new(
                suspicion_kind,
                direction,
                &self.observations,
                previous_force,
                &self.parameters,
            ));
        }
    }

    fn apply_response(&mut self, probe: Probe, response: ProbeResponse) {
        self.mode = match response {
            ProbeResponse::Waiting => CheckMode::Probing(probe),
            ProbeResponse::Wrong if self.wrong_responses + 1 >= WRONG_RESPONSES_MAX => {
                return self.start_verification();
            }
            // A hand may leave the stop by chance: pulse tests decide, where they are made.
            ProbeResponse::Wrong
                if probe.suspicion == Suspicion::PulledFromStop
                    && self.wrong_responses > 0
                    && self.confirmation.has_pulse_tests =>
            {
                return self.start_verification();
            }
            ProbeResponse::Wrong => {
                self.wrong_responses += 1;
                CheckMode::Probing(probe.repeated_as_runaway())
            }
            ProbeResponse::Right | ProbeResponse::Unclear => CheckMode::Watching,
        };
        if matches!(self.mode, CheckMode::Watching) {
            if response == ProbeResponse::Right {
                self.is_confirmed = true;
                self.wrong_responses = 0;
            }
            let (pause_left, fruitless_probes) = &mut self.pauses[probe.suspicion as usize];
            let [first_pause, longest] = PROBE_PAUSES_SECONDS[probe.suspicion as usize];
            let pause_time = (first_pause * f64::from(1 << (*fruitless_probes).min(8))).min(longest);
            // After a wrong response there is no pause: the next suspicion is probed at once.
            if self.wrong_responses == 0 {
                (*pause_left, *fruitless_probes) = (
                    (pause_time / self.parameters.step_seconds) as i32,
                    *fruitless_probes + 1,
                );
            }
            self.observations.reset();
        }
    }

    fn trip_with(&mut self, trip: TripCause) {
        self.mode = CheckMode::Tripped {
            trip,
            faultless_steps: 0,
            steps_since_motion: 0,
        };
    }
}

/// The checks of all axes of a device.
pub(super) struct PlausibilityChecks {
    axes: [Plausibility; MAX_AXES],
    n_axes: usize,
    /// The forces sent last [N], and the positions if they are new.
    sent_forces: [f64; MAX_AXES],
    positions: Option<[f64; MAX_AXES]>,
}

impl PlausibilityChecks {
    /// The checks of axes with these properties, for forces sent every `period` [s].
    pub(super) fn new(axis_specs: &[AxisSpec], period: f64) -> Self {
        let blank_spec = AxisSpec {
            range: [0.0, 0.0],
            resolution: 0.0,
            inertia: None,
            force_max: 0.0,
            delay_seconds: 0.0,
            energy_max: 0.0,
            power_max: 0.0,
        };
        let checks_of = |axis| Plausibility::new(axis_specs.get(axis).copied().unwrap_or(blank_spec), period);
        Self {
            axes: std::array::from_fn(checks_of),
            n_axes: axis_specs.len().min(MAX_AXES),
            sent_forces: [0.0; MAX_AXES],
            positions: None,
        }
    }

    /// Turn probes off: evident faults still trip, suspicions have no effect.
    pub(super) fn disable_probes(&mut self) {
        for axis in &mut self.axes {
            axis.may_probe = false;
            axis.confirmation.has_pulse_tests = false;
        }
    }

    /// Note the positions of the axes.
    pub(super) fn observe(&mut self, positions: &[f64; MAX_AXES]) {
        self.positions = Some(*positions);
    }

    /// The forces to send instead of `requested_forces` [N].
    pub(super) fn check_forces(&mut self, requested_forces: &[f64]) -> [f64; MAX_AXES] {
        let positions = self.positions.take();
        let mut checked_forces = [0.0; MAX_AXES];
        for (axis, checks) in self.axes[..self.n_axes].iter_mut().enumerate() {
            let requested_force = requested_forces.get(axis).copied().unwrap_or(0.0);
            let position = positions.map(|positions| positions[axis]);
            checked_forces[axis] = checks.tick(requested_force, self.sent_forces[axis], position);
        }
        checked_forces
    }

    /// Forget earlier observations, because motion and forces were missed.
    pub(super) fn restart(&mut self) {
        self.axes.iter_mut().for_each(Plausibility::restart);
    }

    /// Note the forces that were sent to the motors [N].
    pub(super) fn note_sent_forces(&mut self, newtons: &[f64]) {
        self.sent_forces[..newtons.len()].copy_from_slice(newtons);
    }

    /// Why the forces of an axis are off, if they are.
    pub(super) fn trip(&self, axis: usize) -> Option<TripCause> {
        self.axes.get(axis).and_then(Plausibility::trip)
    }

    /// Let all axes push again, at the player's request.
    pub(super) fn release(&mut self) {
        self.axes.iter_mut().for_each(Plausibility::release);
    }
}

#[cfg(test)]
mod playing_hands;
#[cfg(test)]
mod simulated_key;
#[cfg(test)]
mod tests;
