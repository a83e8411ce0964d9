//! Checks that force and motion agree. Finds a motor wired the other way, a key pushed into its stop, and a sensor that
//! freezes.
//!
//! A hand may push against a force at any time, and a hand that holds still looks like a frozen sensor. So watching
//! alone proves nothing: it raises a suspicion, and a probe decides. For a few milliseconds the force differs from the
//! one that the piece asks for, and the key answers with the right sign, with the wrong sign, or not at all. After a
//! wrong answer the probe is repeated; only `WRONG_ANSWERS` wrong answers without a right one between them count as a
//! wrong motor. Two observations count without a probe, because no hand causes them: a force of newtons that pushes a
//! resting key further into its stop, and a position that keeps its last bit while the force changes by newtons.
//!
//! Time is counted in steps of about a millisecond, without a clock. Without a suspicion the force is unchanged, to the
//! last bit.

mod probe;
mod signs;

use crate::wire::MAX_AXES;
use probe::{Answer, Probe};
use signs::{AxisParameters, Signs, Suspicion};

/// Length of a step, if a tick is shorter [s].
const STEP: f64 = 1e-3;
/// An axis that tripped may push again after this time without the fault [s].
const RETRY_AFTER: f64 = 3.0;
/// Its force then fades in over this time [s].
const FADE: f64 = 0.5;
/// After this many trips only the player can let the axis push again.
const TRIPS_MAX: u32 = 3;
/// A sensor counts as alive for this time after it has moved [s].
const ALIVE: f64 = 0.5;
/// For each kind of suspicion: the pause after a probe without a finding, at first and at most [s]. The pause doubles
/// each time.
const PAUSES: [[f64; 2]; 3] = [[1.0, 4.0], [1.0, 4.0], [0.02, 1.0]];
/// After this time without a suspicion the pause starts again at its first value [s].
const PAUSE_RESET: f64 = 5.0;
/// Distance from the last probe beyond which the key counts as being at another place [m].
const SAME_PLACE: f64 = 2e-3;
/// Number of wrong answers, without a right one between them, that mean a motor wired the other way.
const WRONG_ANSWERS: u32 = 4;

/// Why the forces of an axis are held at zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trip {
    /// The force asked for is not finite.
    NotFinite,
    /// The key was too fast, or its position is not finite.
    Speed,
    /// The motor pushes in the opposite direction of its command.
    WrongWay,
    /// The key rests at its stop, and the force pushes it further.
    AtStop,
    /// The sensor shows the same position whatever the force.
    Frozen,
}

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
    pub(super) force: f64,
}

#[derive(Clone, Copy, Debug)]
enum Mode {
    Watching,
    Probing(Probe),
    Off {
        why: Trip,
        calm: u32,
        since_moved: u32,
    },
}

/// The check of one axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plausibility {
    built: AxisParameters,
    /// Ticks per step, and ticks since the last step.
    every: u32,
    ticks: u32,
    /// Greatest force [N].
    force: f64,
    /// Whether a suspicion is probed; otherwise only evident faults count.
    may_probe: bool,
    signs: Signs,
    mode: Mode,
    /// Progress of the fade to full force after a trip, 0 to 1.
    fade: f64,
    trips: u32,
    /// Whether a probe was ever answered the right way.
    confirmed: bool,
    /// Wrong answers since the last right one.
    wrong: u32,
    /// For each kind of suspicion: steps until it may be probed again, and how often a probe had no finding.
    pauses: [(i32, u32); 3],
    /// Position at the end of the last probe.
    probed_at: f64,
    /// Number of probes so far.
    probes: u64,
}

impl Plausibility {
    /// An axis that is sent a force every `period` [s].
    pub(super) fn new(built: AxisSpec, period: f64) -> Self {
        let every = (STEP / period).round().max(1.0);
        let traits = AxisParameters::new(built, every * period);
        Self {
            built: traits,
            every: every as u32,
            ticks: 0,
            force: built.force.max(0.0),
            may_probe: true,
            signs: Signs::default(),
            mode: Mode::Watching,
            fade: 1.0,
            trips: 0,
            confirmed: false,
            wrong: 0,
            pauses: [(0, 0); 3],
            probed_at: 0.0,
            probes: 0,
        }
    }

    /// Advance by a tick: `asked` is the force asked for now, `sent` the force of the previous tick, `position` the
    /// key's position if there is a new one. Returns the force to ask for instead.
    pub(super) fn tick(&mut self, asked: f64, sent: f64, position: Option<f64>) -> f64 {
        self.ticks = (self.ticks + 1).min(self.every);
        if let Some(x) = position
            && self.ticks == self.every
        {
            self.ticks = 0;
            self.step(x, sent, asked);
        }
        match self.mode {
            Mode::Off { .. } => 0.0,
            Mode::Probing(Probe {
                offset,
                replaces: true,
                ..
            }) => offset * self.fade,
            Mode::Probing(Probe {
                offset,
                kind,
                force,
                ..
            }) => {
                // More than the greatest force would be clamped and hide the probe; and while the sensor may be frozen,
                // the force must not grow.
                let limit = if kind == Suspicion::Still {
                    force.abs()
                } else {
                    self.force
                };
                (asked.clamp(-limit, limit) + offset) * self.fade
            }
            Mode::Watching if self.fade < 1.0 => asked * self.fade,
            Mode::Watching => asked,
        }
    }

    /// Why forces are off, if they are.
    pub(super) fn trip(&self) -> Option<Trip> {
        match self.mode {
            Mode::Off { why, .. } => Some(why),
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
            self.push_again();
        }
        self.trips = 0;
    }

    /// Forget earlier observations: a host that was stopped has missed motion and forces.
    fn restart(&mut self) {
        if self.trip().is_none() {
            self.mode = Mode::Watching;
            self.signs = Signs::default();
        }
    }

    fn push_again(&mut self) {
        self.mode = Mode::Watching;
        (self.fade, self.wrong, self.confirmed) = (0.0, 0, false);
        self.pauses = [(0, 0); 3];
        self.signs = Signs::default();
    }

    fn step(&mut self, x: f64, sent: f64, asked: f64) {
        let seconds = |seconds: f64| (seconds / self.built.step) as u32;
        let (calm_for, alive_for) = (seconds(RETRY_AFTER), seconds(ALIVE));
        self.fade = (self.fade + self.built.step / FADE).min(1.0);
        let quiet = -(seconds(PAUSE_RESET) as i32);
        for (left, passed) in &mut self.pauses {
            *left = (*left - 1).max(quiet);
            if *left == quiet {
                *passed = 0;
            }
        }
        self.signs.add(x, sent, &self.built);
        match &mut self.mode {
            Mode::Watching => self.watch(sent),
            Mode::Probing(probe) => {
                let answer = probe.step(&self.signs, sent, &self.built);
                let probe = *probe;
                self.apply_answer(probe, answer, sent);
            }
            Mode::Off {
                why,
                calm,
                since_moved,
            } => {
                *since_moved = if self.signs.is_still() {
                    since_moved.saturating_add(1)
                } else {
                    0
                };
                let agrees = match why {
                    Trip::Frozen => *since_moved < alive_for,
                    Trip::AtStop => self.signs.pushed_into_stop(asked, &self.built).is_none(),
                    _ => false,
                };
                *calm = if agrees { *calm + 1 } else { 0 };
                if *calm >= calm_for && self.trips < TRIPS_MAX {
                    self.push_again();
                }
            }
        }
    }

    fn watch(&mut self, sent: f64) {
        // An answer at one place says nothing about another place.
        if (self.signs.past[0] - self.probed_at).abs() > SAME_PLACE.max(4.0 * self.built.resolution)
        {
            self.pauses[Suspicion::Still as usize] = (0, 0);
        }
        if let Some(trip) = self.signs.evident_fault(sent, &self.built) {
            self.trip_with(trip);
        } else if self.may_probe
            && let Some((kind, direction)) = self.signs.suspicion(sent, self.confirmed, &self.built)
            && self.pauses[kind as usize].0 <= 0
        {
            self.probes += 1;
            self.mode = Mode::Probing(Probe::new(kind, direction, &self.signs, sent, &self.built));
        }
    }

    fn apply_answer(&mut self, probe: Probe, answer: Answer, sent: f64) {
        self.mode = match answer {
            Answer::Waiting => Mode::Probing(probe),
            Answer::Frozen if probe.unmoved => return self.trip_with(Trip::Frozen),
            Answer::Frozen => Mode::Probing(probe.repeated(&self.signs, sent, &self.built)),
            Answer::Wrong if self.wrong + 1 >= WRONG_ANSWERS => {
                return self.trip_with(Trip::WrongWay);
            }
            Answer::Wrong => {
                self.wrong += 1;
                Mode::Probing(probe.repeated_as_run())
            }
            Answer::Right | Answer::Unclear => Mode::Watching,
        };
        if matches!(self.mode, Mode::Watching) {
            let (left, passed) = &mut self.pauses[probe.kind as usize];
            let [first, longest] = PAUSES[probe.kind as usize];
            let pause = (first * f64::from(1 << (*passed).min(8))).min(longest);
            if answer == Answer::Right {
                (self.wrong, self.confirmed) = (0, true);
            }
            // After a wrong answer there is no pause: the next suspicion is probed at once.
            if self.wrong == 0 {
                (*left, *passed) = ((pause / self.built.step) as i32, *passed + 1);
            }
            self.probed_at = self.signs.past[0];
            self.signs.forget();
        }
    }

    fn trip_with(&mut self, why: Trip) {
        self.mode = Mode::Off {
            why,
            calm: 0,
            since_moved: 0,
        };
        self.trips += 1;
    }
}

/// The checks of all axes of a device.
pub(super) struct PlausibilityChecks {
    axes: [Plausibility; MAX_AXES],
    n: usize,
    /// The forces sent last [N], and the positions if they are new.
    sent: [f64; MAX_AXES],
    positions: Option<[f64; MAX_AXES]>,
}

impl PlausibilityChecks {
    /// The checks of axes with these properties, for forces sent every `period` [s].
    pub(super) fn new(built: &[AxisSpec], period: f64) -> Self {
        let nothing = AxisSpec {
            range: [0.0, 0.0],
            resolution: 0.0,
            inertia: None,
            force: 0.0,
        };
        let of = |axis| Plausibility::new(built.get(axis).copied().unwrap_or(nothing), period);
        Self {
            axes: std::array::from_fn(of),
            n: built.len().min(MAX_AXES),
            sent: [0.0; MAX_AXES],
            positions: None,
        }
    }

    /// Turn probes off: evident faults still trip, suspicions have no effect.
    pub(super) fn disable_probes(&mut self) {
        for axis in &mut self.axes {
            axis.may_probe = false;
        }
    }

    /// Note the positions of the axes.
    pub(super) fn observe(&mut self, positions: &[f64; MAX_AXES]) {
        self.positions = Some(*positions);
    }

    /// The forces to ask for instead of `asked` [N].
    pub(super) fn pass(&mut self, asked: &[f64]) -> [f64; MAX_AXES] {
        let positions = self.positions.take();
        let mut out = [0.0; MAX_AXES];
        for (axis, own) in self.axes[..self.n].iter_mut().enumerate() {
            let asked = asked.get(axis).copied().unwrap_or(0.0);
            let position = positions.map(|positions| positions[axis]);
            out[axis] = own.tick(asked, self.sent[axis], position);
        }
        out
    }

    /// Forget earlier observations, because motion and forces were missed.
    pub(super) fn restart(&mut self) {
        self.axes.iter_mut().for_each(Plausibility::restart);
    }

    /// Note the forces that were sent to the motors [N].
    pub(super) fn sent(&mut self, newtons: &[f64]) {
        self.sent[..newtons.len()].copy_from_slice(newtons);
    }

    /// Why the forces of an axis are off, if they are.
    pub(super) fn trip(&self, axis: usize) -> Option<Trip> {
        self.axes.get(axis).and_then(Plausibility::trip)
    }

    /// Let all axes push again, at the player's request.
    pub(super) fn release(&mut self) {
        self.axes.iter_mut().for_each(Plausibility::release);
    }
}

#[cfg(test)]
mod played;
#[cfg(test)]
mod playing_hands;
#[cfg(test)]
mod tests;
