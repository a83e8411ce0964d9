//! A probe: for some milliseconds the force differs from the piece's, and the response of the key is judged.

use super::observations::{AxisObservations, AxisParameters, Suspicion, VELOCITY_STEPS};

/// How the force of a probe grows.
struct ProbeShape {
    /// Growth [N/s].
    slope: f64,
    /// Greatest force [N]; at a stop in addition to the present force.
    force_max: f64,
    /// Longest duration [s].
    duration_max: f64,
}

/// The shape for each kind of suspicion.
const PROBE_SHAPES: [ProbeShape; 2] = [
    ProbeShape {
        slope: 1_000.0,
        force_max: 1.0,
        duration_max: 0.04,
    },
    ProbeShape {
        slope: 1_000.0,
        force_max: 3.0,
        duration_max: 0.008,
    },
];
/// Steps between two probes without an offset, so that the course of the key is known.
const SETTLE_STEPS: u32 = 2 * VELOCITY_STEPS as u32;
/// Least deviation from its course that counts as a response [m].
const RESPONSE_DEVIATION_MIN: f64 = 1e-4;

/// Factors of the displacement of a free key under the probe: a response is at least the first, a wrong response to a
/// probe of `Runaway` at most the second.
const RESPONSE_SHARES: (f64, f64) = (0.25, 2.5);

/// Least share of the displacement of a free key that counts as a response, for a key that rests at its stop: no hand
/// moves it meanwhile, and it may be heavy.
const STOP_RESPONSE_SHARE: f64 = 0.05;

/// The response of the key to a probe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ProbeResponse {
    /// No response yet.
    Waiting,
    /// The key went the way it was pushed.
    Right,
    /// The response could not be told.
    Unclear,
    /// The key went the other way.
    Wrong,
}

/// A probe under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probe {
    pub(super) suspicion: Suspicion,
    direction: f64,
    max_force: f64,
    /// Steps until it begins, and steps since then.
    steps_to_settle: u32,
    steps: u32,
    /// Its force now [N]; and whether that replaces the piece's force instead of being added to it.
    pub(super) force_offset: f64,
    pub(super) replaces_piece: bool,
    /// The course of the key without the probe: position, velocity, acceleration.
    unprobed_course: [f64; 3],
    /// The force at the beginning; and velocity and displacement of a free key under the difference from that force.
    pub(super) initial_force: f64,
    free_velocity: f64,
    free_displacement: f64,
}

impl Probe {
    pub(super) fn new(
        kind: Suspicion,
        direction: f64,
        observations: &AxisObservations,
        force: f64,
        axis: &AxisParameters,
    ) -> Self {
        let holding_force = if kind == Suspicion::PulledFromStop {
            force.abs()
        } else {
            0.0
        };
        let mut probe = Self {
            suspicion: kind,
            direction,
            max_force: PROBE_SHAPES[kind as usize].force_max + holding_force,
            steps_to_settle: 0,
            steps: 0,
            force_offset: 0.0,
            replaces_piece: false,
            unprobed_course: [0.0; 3],
            initial_force: 0.0,
            free_velocity: 0.0,
            free_displacement: 0.0,
        };
        probe.begin(observations, force, axis);
        probe
    }

    /// Another probe of the kind `Runaway` after a few steps, in the direction in which the key then moves. Until it is
    /// over, the piece's force does not act.
    pub(super) fn repeated_as_runaway(self) -> Self {
        Self {
            suspicion: Suspicion::Runaway,
            max_force: PROBE_SHAPES[Suspicion::Runaway as usize].force_max,
            steps_to_settle: SETTLE_STEPS,
            force_offset: 0.0,
            replaces_piece: true,
            ..self
        }
    }

    fn begin(&mut self, observations: &AxisObservations, force: f64, axis: &AxisParameters) {
        let (v, a) = (observations.velocity(axis), observations.acceleration(axis));
        self.unprobed_course = match self.suspicion {
            // The mean velocity over `VELOCITY_STEPS` steps is the velocity of half as many steps ago.
            Suspicion::Runaway => [
                observations.positions[0],
                v + 0.5 * VELOCITY_STEPS as f64 * axis.step_seconds * a,
                a,
            ],
            Suspicion::PulledFromStop => [observations.positions[0], 0.0, 0.0],
        };
        (self.steps, self.initial_force) = (0, force);
        (self.free_velocity, self.free_displacement) = (0.0, 0.0);
    }

    /// Advance by a step: `observations` has the position of the key, `sent_force` is the force sent.
    pub(super) fn step(
        &mut self,
        observations: &AxisObservations,
        sent_force: f64,
        axis: &AxisParameters,
    ) -> ProbeResponse {
        if self.steps_to_settle > 0 {
            self.steps_to_settle -= 1;
            if self.steps_to_settle == 0 {
                self.direction = if observations.velocity(axis) < 0.0 { -1.0 } else { 1.0 };
                self.begin(observations, sent_force, axis);
            }
            return ProbeResponse::Waiting;
        }
        let shape = &PROBE_SHAPES[self.suspicion as usize];
        self.steps += 1;
        let t = f64::from(self.steps) * axis.step_seconds;
        let pushing_force = if self.suspicion == Suspicion::PulledFromStop {
            // As long as the force does not push into the stop, the old force may hold the key there.
            self.direction * (self.direction * sent_force).max(0.0)
        } else {
            sent_force - self.initial_force
        };
        self.free_velocity += pushing_force / axis.mass * axis.step_seconds;
        self.free_displacement += self.free_velocity * axis.step_seconds;
        let [x, v, a] = self.unprobed_course;
        let deviation = observations.positions[0] - (x + (v + 0.5 * a * t) * t);
        let least_deviation = RESPONSE_DEVIATION_MIN.max(3.0 * axis.resolution);
        // Nothing can be told if the force hardly changed, if the sensor does not change, or if the deviation is a
        // small part of the displacement of a free key: a hand moves that much meanwhile.
        let free_path = self.free_displacement;
        let path_share = if self.suspicion == Suspicion::PulledFromStop {
            STOP_RESPONSE_SHARE
        } else {
            RESPONSE_SHARES.0
        };
        let is_clear = deviation.abs() >= least_deviation.max(path_share * free_path.abs()) && !observations.is_still();
        if is_clear && deviation * free_path > 0.0 && free_path.abs() >= 0.3 * least_deviation {
            return ProbeResponse::Right;
        }
        let is_moved_by_hand =
            self.suspicion == Suspicion::Runaway && deviation.abs() > RESPONSE_SHARES.1 * free_path.abs();
        if is_clear && deviation * free_path < 0.0 && free_path.abs() >= least_deviation && !is_moved_by_hand {
            return ProbeResponse::Wrong;
        }
        if t >= shape.duration_max {
            return ProbeResponse::Unclear;
        }
        let force_offset = self.direction * shape.slope * (t + axis.step_seconds);
        self.force_offset = force_offset.clamp(-self.max_force, self.max_force);
        ProbeResponse::Waiting
    }
}
