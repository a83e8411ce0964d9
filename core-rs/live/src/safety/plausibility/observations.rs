//! The signs that watching a key gives: evident faults, and suspicions that have to be probed.

use super::AxisSpec;
use crate::safety::TripCause;

/// Mass assumed for a device that does not report it: a light fader [kg].
const DEFAULT_MASS: f64 = 0.05;
/// Number of positions that are kept.
const POSITIONS_STORED: usize = 2 * VELOCITY_STEPS + 1;
/// Number of steps over which velocity is taken.
pub(super) const VELOCITY_STEPS: usize = 4;

/// Part of the range beside a stop that counts as the stop.
const STOP_MARGIN_SHARE: f64 = 0.02;
/// A key that moves less than this during the dwell is at rest [m].
const REST_TOLERANCE: f64 = 1e-4;
/// Time at rest at a stop after which it is a suspicion, and after which it is a fault [s].
const DWELL_SECONDS: [f64; 2] = [0.1, 0.15];
/// Least force that pulls the key away, for the suspicion, and that pushes it in, for the fault [N].
const PULL_FORCE_MIN: f64 = 0.3;
const PUSH_FORCE_MIN: f64 = 2.0;

/// Time for which a position keeps its last bit before a pulse test is made [s], and least force for that [N].
const STILL_SECONDS: f64 = 0.09;
const STILL_FORCE_MIN: f64 = 0.3;
/// Where no pulse tests are made, a position that keeps its last bit is a fault after `FORCE_CHANGE_SECONDS` [s] if the
/// force, averaged over `FORCE_SMOOTHING_SECONDS` [s], changed by `FORCE_CHANGE_MIN` [N] meanwhile.
const FORCE_SMOOTHING_SECONDS: f64 = 0.02;
const FORCE_CHANGE_MIN: f64 = 1.0;
const FORCE_CHANGE_SECONDS: f64 = 0.05;
/// The stiffest grip of a hand [N/m]; it gives the change of force that must show in the sensor.
const FIRMEST_GRIP: f64 = 5_000.0;

/// Least speed of a run [m/s].
const RUNAWAY_SPEED_MIN: f64 = 0.01;
/// Length at which the velocity of a run is first noted [m]; each further length is twice as long.
const RUNAWAY_LENGTH_MIN: f64 = 3e-4;
/// The growth of velocity from one length to the next that is a suspicion, and the least opposing force for it [N]. A
/// hand that begins a stroke smoothly reaches 2^(2/3) = 1.59, a constant push 1.41, a key that runs away 2.
const RUNAWAY_GROWTH: [(f64, f64); 2] = [(1.65, 0.1), (1.38, 0.8)];

/// It is also a suspicion if a key is accelerated against the force by this part of the force; and the least force for
/// that [N].
const COUNTER_ACCELERATION: (f64, f64) = (0.4, 0.8);

/// A possible fault, which a probe has to confirm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Suspicion {
    /// The key rests at a stop that the force pulls it away from.
    PulledFromStop,
    /// The key runs against the force, faster and faster.
    Runaway,
}

/// The properties of an axis, and values derived from them.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxisParameters {
    /// Length of a step [s].
    pub(super) step_seconds: f64,
    pub(super) mass: f64,
    pub(super) resolution: f64,
    range: [f64; 2],
    stop_margin: f64,
    runaway_length_min: f64,
    runaway_speed_min: f64,
    /// Error of mass times acceleration by the sensor's resolution [N].
    force_noise: f64,
}

impl AxisParameters {
    pub(super) fn new(axis_spec: AxisSpec, step: f64) -> Self {
        let [lower_stop, upper_stop] = axis_spec.range;
        let mass = axis_spec.inertia.filter(|m| *m > 0.0).unwrap_or(DEFAULT_MASS);
        let velocity_span = VELOCITY_STEPS as f64 * step;
        Self {
            step_seconds: step,
            mass,
            force_noise: 3.0 * mass * axis_spec.resolution / (velocity_span * velocity_span),
            resolution: axis_spec.resolution,
            range: axis_spec.range,
            stop_margin: STOP_MARGIN_SHARE * (upper_stop - lower_stop),
            runaway_length_min: RUNAWAY_LENGTH_MIN.max(8.0 * axis_spec.resolution),
            runaway_speed_min: RUNAWAY_SPEED_MIN.max(2.0 * axis_spec.resolution / velocity_span),
        }
    }

    /// The least change of force that shows in the sensor through the firmest grip [N].
    pub(super) fn visible_force_change(&self) -> f64 {
        3.0 * self.resolution * FIRMEST_GRIP
    }

    fn steps(&self, seconds: f64) -> u32 {
        (seconds / self.step_seconds).ceil() as u32
    }

    /// 1 at the upper stop, -1 at the lower one, `None` elsewhere.
    fn stop_side(&self, x: f64) -> Option<f64> {
        let [lower_stop, upper_stop] = self.range;
        if x >= upper_stop - self.stop_margin {
            Some(1.0)
        } else {
            (x <= lower_stop + self.stop_margin).then_some(-1.0)
        }
    }
}

/// A movement in one direction.
#[derive(Clone, Copy, Debug)]
struct Runaway {
    direction: f64,
    start_position: f64,
    next_length: f64,
    /// The velocity at the previous length [m/s].
    last_velocity: Option<f64>,
    is_suspicious: bool,
    /// Whether in this step it passed a second or later length, against a force of at least `COUNTER_ACCELERATION.1`.
    is_against_force: bool,
}

/// The recent observations of an axis.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AxisObservations {
    /// Positions, the newest first.
    pub(super) positions: [f64; POSITIONS_STORED],
    n_positions: usize,
    /// Number of steps with the same position, the smoothed force, and its least and greatest value in those steps.
    still_steps: u32,
    smoothed_force: f64,
    smoothed_range: [f64; 2],
    /// Number of steps at a stop, the side of the stop, and the position there.
    dwell_steps: u32,
    dwell_side: f64,
    dwell_position: f64,
    runaway: Option<Runaway>,
}

impl AxisObservations {
    /// Add a step: the position of the key, and the force that was sent before it.
    pub(super) fn add_step(&mut self, x: f64, sent_force: f64, axis: &AxisParameters) {
        if self.n_positions == 0 {
            (self.positions, self.smoothed_force) = ([x; POSITIONS_STORED], sent_force);
        }
        let is_unchanged = self.n_positions > 0 && x.to_bits() == self.positions[0].to_bits();
        self.n_positions = (self.n_positions + 1).min(POSITIONS_STORED);
        self.positions.copy_within(0..POSITIONS_STORED - 1, 1);
        self.positions[0] = x;
        let smooth_weight = if is_unchanged {
            (axis.step_seconds / FORCE_SMOOTHING_SECONDS).min(1.0)
        } else {
            1.0
        };
        self.smoothed_force += (sent_force - self.smoothed_force) * smooth_weight;
        self.still_steps = if is_unchanged {
            self.still_steps.saturating_add(1)
        } else {
            0
        };
        self.smoothed_range = if is_unchanged {
            [
                self.smoothed_range[0].min(self.smoothed_force),
                self.smoothed_range[1].max(self.smoothed_force),
            ]
        } else {
            [self.smoothed_force; 2]
        };
        let stop_side = axis.stop_side(x);
        let is_resting = (x - self.dwell_position).abs() <= REST_TOLERANCE.max(2.0 * axis.resolution);
        if stop_side.is_some() && is_resting && self.dwell_steps > 0 {
            self.dwell_steps = self.dwell_steps.saturating_add(1);
        } else {
            (self.dwell_steps, self.dwell_position) = (u32::from(stop_side.is_some()), x);
        }
        self.dwell_side = stop_side.unwrap_or(0.0);
        self.follow_runaway(x, sent_force, axis);
    }

    /// The movement to a new position [m]; none if no position is known before it.
    pub(super) fn displacement_to(&self, x: f64) -> f64 {
        if self.n_positions == 0 {
            0.0
        } else {
            x - self.positions[0]
        }
    }

    /// The velocity over the last steps [m/s].
    pub(super) fn velocity(&self, axis: &AxisParameters) -> f64 {
        (self.positions[0] - self.positions[VELOCITY_STEPS]) / (VELOCITY_STEPS as f64 * axis.step_seconds)
    }

    /// The acceleration over the last steps [m/s²].
    pub(super) fn acceleration(&self, axis: &AxisParameters) -> f64 {
        let span_time = VELOCITY_STEPS as f64 * axis.step_seconds;
        (self.positions[0] - 2.0 * self.positions[VELOCITY_STEPS] + self.positions[2 * VELOCITY_STEPS])
            / (span_time * span_time)
    }

    /// Whether the newest position equals the one before.
    pub(super) fn is_still(&self) -> bool {
        self.still_steps > 0
    }

    /// Whether the position has kept its last bit for so long under `sent_force` [N] that the sensor may be frozen.
    pub(super) fn may_be_frozen(&self, sent_force: f64, axis: &AxisParameters) -> bool {
        self.still_steps >= axis.steps(STILL_SECONDS) && sent_force.abs() >= STILL_FORCE_MIN
    }

    /// Whether the key is at one of its stops.
    pub(super) fn is_at_stop(&self) -> bool {
        self.dwell_side != 0.0
    }

    /// Restart all suspicions.
    pub(super) fn reset(&mut self) {
        (self.still_steps, self.dwell_steps, self.runaway) = (0, 0, None);
        self.smoothed_range = [self.smoothed_force; 2];
    }

    /// Follow a movement in one direction, and judge whether it accelerates against the force.
    fn follow_runaway(&mut self, x: f64, sent_force: f64, axis: &AxisParameters) {
        let (key_velocity, inertial_force) = (self.velocity(axis), axis.mass * self.acceleration(axis));
        let runaway = match &mut self.runaway {
            Some(run) if run.direction * key_velocity > axis.runaway_speed_min => run,
            _ => {
                self.runaway = (key_velocity.abs() > axis.runaway_speed_min && self.n_positions == POSITIONS_STORED)
                    .then(|| Runaway {
                        direction: key_velocity.signum(),
                        start_position: x,
                        next_length: axis.runaway_length_min,
                        last_velocity: None,
                        is_suspicious: false,
                        is_against_force: false,
                    });
                return;
            }
        };
        if runaway.direction * sent_force >= 0.0 {
            // A movement along the force is never suspicious.
            (runaway.start_position, runaway.next_length, runaway.last_velocity) = (x, axis.runaway_length_min, None);
        }
        runaway.is_against_force = false;
        runaway.is_suspicious = -runaway.direction * sent_force >= COUNTER_ACCELERATION.1
            && runaway.direction * inertial_force
                >= -COUNTER_ACCELERATION.0 * runaway.direction * sent_force + axis.force_noise;
        while runaway.direction * (x - runaway.start_position) >= runaway.next_length {
            let opposing_force = -runaway.direction * sent_force;
            runaway.is_against_force = runaway.last_velocity.is_some() && opposing_force >= COUNTER_ACCELERATION.1;
            let velocity_growth = runaway
                .last_velocity
                .map_or(0.0, |previous_velocity| key_velocity / previous_velocity);
            runaway.is_suspicious |= RUNAWAY_GROWTH
                .iter()
                .any(|&(growth, force)| velocity_growth >= growth && opposing_force >= force);
            (runaway.next_length, runaway.last_velocity) = (2.0 * runaway.next_length, Some(key_velocity));
        }
    }

    /// The side of the stop at which the key rests while `force` pushes it further in, if it does.
    pub(super) fn pushed_into_stop(&self, force: f64, axis: &AxisParameters) -> Option<f64> {
        let dwells_long = self.dwell_steps >= axis.steps(DWELL_SECONDS[1]);
        (dwells_long && force * self.dwell_side >= PUSH_FORCE_MIN).then_some(self.dwell_side)
    }

    /// A fault that is seen without a response. A hand may hold a position to the last bit by chance while the force
    /// changes: where pulse tests are made (`has_pulse_tests`), they find a frozen sensor.
    pub(super) fn evident_fault(
        &self,
        sent_force: f64,
        has_pulse_tests: bool,
        axis: &AxisParameters,
    ) -> Option<TripCause> {
        if self.pushed_into_stop(sent_force, axis).is_some() {
            return Some(TripCause::AtStop);
        }
        let force_change = self.smoothed_range[1] - self.smoothed_range[0];
        let is_frozen = self.still_steps >= axis.steps(FORCE_CHANGE_SECONDS)
            && force_change >= FORCE_CHANGE_MIN.max(axis.visible_force_change());
        (is_frozen && !has_pulse_tests && self.dwell_side == 0.0).then_some(TripCause::Frozen)
    }

    /// A suspicion, and the direction in which to probe it; `confirmed`: whether a probe has shown the right direction
    /// of the motor before.
    pub(super) fn suspicion(
        &self,
        sent_force: f64,
        confirmed: bool,
        has_pulse_tests: bool,
        axis: &AxisParameters,
    ) -> Option<(Suspicion, f64)> {
        if self
            .runaway
            .is_some_and(|run| run.is_suspicious || (run.is_against_force && !confirmed))
        {
            return Some((Suspicion::Runaway, -sent_force.signum()));
        }
        // Without pulse tests a chance response would decide, so only what may hurt is probed.
        let force_min = if has_pulse_tests {
            PULL_FORCE_MIN
        } else {
            PUSH_FORCE_MIN
        };
        if self.dwell_steps >= axis.steps(DWELL_SECONDS[0]) && -sent_force * self.dwell_side >= force_min {
            return Some((Suspicion::PulledFromStop, self.dwell_side));
        }
        None
    }
}
