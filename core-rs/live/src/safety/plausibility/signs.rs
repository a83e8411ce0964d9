//! The signs that watching a key gives: evident faults, and suspicions that have to be probed.

use super::AxisSpec;
use crate::safety::Trip;

/// Mass assumed for a device that does not report it: a light fader [kg].
const DEFAULT_MASS: f64 = 0.05;
/// Number of positions that are kept.
const PAST: usize = 2 * VELOCITY_STEPS + 1;
/// Number of steps over which velocity is taken.
pub(super) const VELOCITY_STEPS: usize = 4;

/// Part of the range beside a stop that counts as the stop.
const MARGIN: f64 = 0.02;
/// A key that moves less than this during the dwell is at rest [m].
const REST_TOLERANCE: f64 = 1e-4;
/// Time at rest at a stop after which it is a suspicion, and after which it is a fault [s].
const DWELL: [f64; 2] = [0.1, 0.15];
/// Least force that pulls the key away, for the suspicion, and that pushes it in, for the fault [N].
const PULLED_AWAY: f64 = 0.3;
const PUSHED_IN: f64 = 2.0;

/// Time for which a position keeps its last bit before a question is asked [s], and least force for that [N].
const STILL: f64 = 0.09;
const STILL_FORCE: f64 = 0.3;
/// Where no questions are asked, a position that keeps its last bit is a fault after `CHANGED_OVER` [s] if the force,
/// averaged over `SMOOTH` [s], changed by `CHANGED` [N] meanwhile.
const SMOOTH: f64 = 0.02;
const CHANGED: f64 = 1.0;
const CHANGED_OVER: f64 = 0.05;
/// The stiffest grip of a hand [N/m]; it gives the change of force that must show in the sensor.
const FIRMEST_GRIP: f64 = 5_000.0;

/// Least speed of a run [m/s].
const SLOW: f64 = 0.01;
/// Length at which the velocity of a run is first noted [m]; each further length is twice as long.
const RUN: f64 = 3e-4;
/// The growth of velocity from one length to the next that is a suspicion, and the least opposing force for it [N]. A
/// hand that begins a stroke smoothly reaches 2^(2/3) = 1.59, a constant push 1.41, a key that runs away 2.
const RUN_GROWTH: [(f64, f64); 2] = [(1.65, 0.1), (1.38, 0.8)];

/// It is also a suspicion if a key is accelerated against the force by this part of the force; and the least force for
/// that [N].
const COUNTER_ACCELERATION: (f64, f64) = (0.4, 0.8);

/// A possible fault, which a probe has to confirm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Suspicion {
    /// The key rests at a stop that the force pulls it away from.
    Stop,
    /// The key runs against the force, faster and faster.
    Run,
}

/// The properties of an axis, and values derived from them.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxisParameters {
    /// Length of a step [s].
    pub(super) step: f64,
    pub(super) mass: f64,
    pub(super) resolution: f64,
    range: [f64; 2],
    margin: f64,
    run: f64,
    slow: f64,
    /// Error of mass times acceleration by the sensor's resolution [N].
    noise: f64,
}

impl AxisParameters {
    pub(super) fn new(axis_spec: AxisSpec, step: f64) -> Self {
        let [lower_stop, upper_stop] = axis_spec.range;
        let mass = axis_spec.inertia.filter(|m| *m > 0.0).unwrap_or(DEFAULT_MASS);
        let velocity_span = VELOCITY_STEPS as f64 * step;
        Self {
            step,
            mass,
            noise: 3.0 * mass * axis_spec.resolution / (velocity_span * velocity_span),
            resolution: axis_spec.resolution,
            range: axis_spec.range,
            margin: MARGIN * (upper_stop - lower_stop),
            run: RUN.max(8.0 * axis_spec.resolution),
            slow: SLOW.max(2.0 * axis_spec.resolution / velocity_span),
        }
    }

    /// The least change of force that shows in the sensor through the firmest grip [N].
    pub(super) fn visible_force_change(&self) -> f64 {
        3.0 * self.resolution * FIRMEST_GRIP
    }

    fn steps(&self, seconds: f64) -> u32 {
        (seconds / self.step).ceil() as u32
    }

    /// 1 at the upper stop, -1 at the lower one, `None` elsewhere.
    fn side(&self, x: f64) -> Option<f64> {
        let [lower_stop, upper_stop] = self.range;
        if x >= upper_stop - self.margin {
            Some(1.0)
        } else {
            (x <= lower_stop + self.margin).then_some(-1.0)
        }
    }
}

/// A movement in one direction.
#[derive(Clone, Copy, Debug)]
struct Run {
    direction: f64,
    from: f64,
    next_length: f64,
    /// The velocity at the previous length [m/s].
    last_velocity: Option<f64>,
    suspicious: bool,
    /// Whether in this step it passed a second or later length, against a force of at least `COUNTER_ACCELERATION.1`.
    against: bool,
}

/// The recent observations of an axis.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Signs {
    /// Positions, the newest first.
    pub(super) past: [f64; PAST],
    n: usize,
    /// Number of steps with the same position, the smoothed force, and its least and greatest value in those steps.
    still: u32,
    smooth: f64,
    forces: [f64; 2],
    /// Number of steps at a stop, the side of the stop, and the position there.
    dwell: u32,
    side: f64,
    dwell_position: f64,
    run: Option<Run>,
}

impl Signs {
    /// Add a step: the position of the key, and the force that was sent before it.
    pub(super) fn add(&mut self, x: f64, sent: f64, axis: &AxisParameters) {
        if self.n == 0 {
            (self.past, self.smooth) = ([x; PAST], sent);
        }
        let is_unchanged = self.n > 0 && x.to_bits() == self.past[0].to_bits();
        self.n = (self.n + 1).min(PAST);
        self.past.copy_within(0..PAST - 1, 1);
        self.past[0] = x;
        let smooth_weight = if is_unchanged {
            (axis.step / SMOOTH).min(1.0)
        } else {
            1.0
        };
        self.smooth += (sent - self.smooth) * smooth_weight;
        self.still = if is_unchanged { self.still.saturating_add(1) } else { 0 };
        self.forces = if is_unchanged {
            [self.forces[0].min(self.smooth), self.forces[1].max(self.smooth)]
        } else {
            [self.smooth; 2]
        };
        let stop_side = axis.side(x);
        let is_resting = (x - self.dwell_position).abs() <= REST_TOLERANCE.max(2.0 * axis.resolution);
        if stop_side.is_some() && is_resting && self.dwell > 0 {
            self.dwell = self.dwell.saturating_add(1);
        } else {
            (self.dwell, self.dwell_position) = (u32::from(stop_side.is_some()), x);
        }
        self.side = stop_side.unwrap_or(0.0);
        self.follow_run(x, sent, axis);
    }

    /// The movement to a new position [m]; none if no position is known before it.
    pub(super) fn moved_to(&self, x: f64) -> f64 {
        if self.n == 0 { 0.0 } else { x - self.past[0] }
    }

    /// The velocity over the last steps [m/s].
    pub(super) fn velocity(&self, axis: &AxisParameters) -> f64 {
        (self.past[0] - self.past[VELOCITY_STEPS]) / (VELOCITY_STEPS as f64 * axis.step)
    }

    /// The acceleration over the last steps [m/s²].
    pub(super) fn acceleration(&self, axis: &AxisParameters) -> f64 {
        let span_time = VELOCITY_STEPS as f64 * axis.step;
        (self.past[0] - 2.0 * self.past[VELOCITY_STEPS] + self.past[2 * VELOCITY_STEPS]) / (span_time * span_time)
    }

    /// Whether the newest position equals the one before.
    pub(super) fn is_still(&self) -> bool {
        self.still > 0
    }

    /// Whether the position has kept its last bit for so long under `sent` [N] that the sensor may be frozen.
    pub(super) fn may_be_frozen(&self, sent: f64, axis: &AxisParameters) -> bool {
        self.still >= axis.steps(STILL) && sent.abs() >= STILL_FORCE
    }

    /// Whether the key is at one of its stops.
    pub(super) fn is_at_stop(&self) -> bool {
        self.side != 0.0
    }

    /// Restart all suspicions.
    pub(super) fn forget(&mut self) {
        (self.still, self.dwell, self.run) = (0, 0, None);
        self.forces = [self.smooth; 2];
    }

    /// Follow a movement in one direction, and judge whether it accelerates against the force.
    fn follow_run(&mut self, x: f64, sent: f64, axis: &AxisParameters) {
        let (key_velocity, inertial_force) = (self.velocity(axis), axis.mass * self.acceleration(axis));
        let run = match &mut self.run {
            Some(run) if run.direction * key_velocity > axis.slow => run,
            _ => {
                self.run = (key_velocity.abs() > axis.slow && self.n == PAST).then(|| Run {
                    direction: key_velocity.signum(),
                    from: x,
                    next_length: axis.run,
                    last_velocity: None,
                    suspicious: false,
                    against: false,
                });
                return;
            }
        };
        if run.direction * sent >= 0.0 {
            // A movement along the force is never suspicious.
            (run.from, run.next_length, run.last_velocity) = (x, axis.run, None);
        }
        run.against = false;
        run.suspicious = -run.direction * sent >= COUNTER_ACCELERATION.1
            && run.direction * inertial_force >= -COUNTER_ACCELERATION.0 * run.direction * sent + axis.noise;
        while run.direction * (x - run.from) >= run.next_length {
            let opposing_force = -run.direction * sent;
            run.against = run.last_velocity.is_some() && opposing_force >= COUNTER_ACCELERATION.1;
            let velocity_growth = run
                .last_velocity
                .map_or(0.0, |previous_velocity| key_velocity / previous_velocity);
            run.suspicious |= RUN_GROWTH
                .iter()
                .any(|&(growth, force)| velocity_growth >= growth && opposing_force >= force);
            (run.next_length, run.last_velocity) = (2.0 * run.next_length, Some(key_velocity));
        }
    }

    /// The side of the stop at which the key rests while `force` pushes it further in, if it does.
    pub(super) fn pushed_into_stop(&self, force: f64, axis: &AxisParameters) -> Option<f64> {
        let dwells_long = self.dwell >= axis.steps(DWELL[1]);
        (dwells_long && force * self.side >= PUSHED_IN).then_some(self.side)
    }

    /// A fault that is seen without an answer. A hand may hold a position to the last bit by chance while the force
    /// changes: where questions are asked (`asks`), they find a frozen sensor.
    pub(super) fn evident_fault(&self, sent: f64, asks: bool, axis: &AxisParameters) -> Option<Trip> {
        if self.pushed_into_stop(sent, axis).is_some() {
            return Some(Trip::AtStop);
        }
        let force_change = self.forces[1] - self.forces[0];
        let is_frozen =
            self.still >= axis.steps(CHANGED_OVER) && force_change >= CHANGED.max(axis.visible_force_change());
        (is_frozen && !asks && self.side == 0.0).then_some(Trip::Frozen)
    }

    /// A suspicion, and the direction in which to probe it; `confirmed`: whether a probe has shown the right direction
    /// of the motor before.
    pub(super) fn suspicion(
        &self,
        sent: f64,
        confirmed: bool,
        asks: bool,
        axis: &AxisParameters,
    ) -> Option<(Suspicion, f64)> {
        if self
            .run
            .is_some_and(|run| run.suspicious || (run.against && !confirmed))
        {
            return Some((Suspicion::Run, -sent.signum()));
        }
        // Without questions a chance answer would decide, so only what may hurt is probed.
        let pulled_away = if asks { PULLED_AWAY } else { PUSHED_IN };
        if self.dwell >= axis.steps(DWELL[0]) && -sent * self.side >= pulled_away {
            return Some((Suspicion::Stop, self.side));
        }
        None
    }
}
