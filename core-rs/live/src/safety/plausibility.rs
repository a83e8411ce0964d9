//! Whether force and motion agree: a motor wired the other way, a key pushed into its stop, a sensor that freezes.
//!
//! A hand may push against a force at any time, and a hand that holds still looks like a frozen sensor. So nothing of
//! this is concluded from looking alone. What looks wrong is a suspicion, and a suspicion is answered by a probe: for a
//! few milliseconds the force differs from what the piece asks for, and the key answers with the right sign, with the
//! wrong sign, or not at all. A wrong sign is probed a second time, the other way round, before it counts. Only two
//! things count at once, for no hand does them: a force of newtons that pushes a resting key further into its stop, and
//! a position that keeps its last bit while the force changes by newtons.
//!
//! Time is counted in steps of about a millisecond; there is no clock. What is not suspected is left as it is, to the
//! last bit.

mod probe;
mod signs;

use crate::wire::MAX_AXES;
use probe::{Answer, Probe};
use signs::{AxisParameters, Signs, Suspicion};

/// Length of a step, if a tick is shorter [s].
const STEP: f64 = 1e-3;
/// An axis that tripped may push again after so long without the fault [s].
const CALM: f64 = 3.0;
/// It then takes so long to full force [s].
const FADE: f64 = 0.5;
/// After so many trips only the player lets it push again.
const TRIPS: u32 = 3;
/// A sensor that moves is alive for so long [s].
const ALIVE: f64 = 0.5;
/// A probe that found nothing wrong is followed by no other of its kind for so long at first, and at most [s]. The
/// pause doubles each time.
const PAUSES: [[f64; 2]; 3] = [[1.0, 4.0], [1.0, 4.0], [0.02, 1.0]];
/// After so long without a suspicion the first pause is the short one again [s].
const QUIET: f64 = 5.0;
/// Farther from a probe than this a key is elsewhere [m].
const ELSEWHERE: f64 = 2e-3;
/// So many wrong answers, and no right one between them, are a motor wired the other way.
const WRONG: u32 = 4;

/// Why forces of an axis are held at zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trip {
    /// A force was asked for that is no number.
    NotFinite,
    /// The key was too fast.
    Speed,
    /// The motor pushes against what it is told.
    WrongWay,
    /// The key rests at its stop, and the force pushes it further.
    AtStop,
    /// The sensor shows the same place whatever the force does.
    Frozen,
}

/// What an axis is, for [`Plausibility`].
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

/// One axis that is watched.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plausibility {
    built: AxisParameters,
    /// Ticks of a step, and those since the last one.
    every: u32,
    ticks: u32,
    /// Greatest force [N].
    force: f64,
    /// Whether a suspicion is probed; otherwise only what is evident counts.
    may_probe: bool,
    signs: Signs,
    mode: Mode,
    /// From a trip to full force, 0 to 1.
    fade: f64,
    trips: u32,
    /// Whether a probe was ever answered the right way.
    confirmed: bool,
    /// Wrong answers since the last right one.
    wrong: u32,
    /// Steps until a suspicion of each kind is probed again, and how often it was without a finding.
    pauses: [(i32, u32); 3],
    /// Where the last probe ended.
    probed_at: f64,
    /// Probes so far.
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

    /// One tick: the force that is `asked` for now, what was `sent` in the tick before, and where the key is by now, if
    /// that is new. Returns the force to ask for instead.
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
                instead: true,
                ..
            }) => offset * self.fade,
            Mode::Probing(Probe {
                offset,
                kind,
                force,
                ..
            }) => {
                // What is asked beyond the greatest force would hide the probe; and on a sensor that may be frozen no
                // force grows meanwhile.
                let most = if kind == Suspicion::Still {
                    force.abs()
                } else {
                    self.force
                };
                (asked.clamp(-most, most) + offset) * self.fade
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

    /// How many probes there were.
    #[cfg(test)]
    pub(super) fn probes(&self) -> u64 {
        self.probes
    }

    /// The player wants forces again, whatever was found.
    pub(super) fn release(&mut self) {
        if self.trip().is_some() {
            self.push_again();
        }
        self.trips = 0;
    }

    /// What was seen before says nothing of what follows: a host that was stopped has missed motion and forces.
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
        let (calm_for, alive_for) = (seconds(CALM), seconds(ALIVE));
        self.fade = (self.fade + self.built.step / FADE).min(1.0);
        let quiet = -(seconds(QUIET) as i32);
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
                self.answered(probe, answer, sent);
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
                    Trip::AtStop => self.signs.pushed_out(asked, &self.built).is_none(),
                    _ => false,
                };
                *calm = if agrees { *calm + 1 } else { 0 };
                if *calm >= calm_for && self.trips < TRIPS {
                    self.push_again();
                }
            }
        }
    }

    fn watch(&mut self, sent: f64) {
        // What a key answered at one place says nothing of it at another.
        if (self.signs.past[0] - self.probed_at).abs() > ELSEWHERE.max(4.0 * self.built.resolution)
        {
            self.pauses[Suspicion::Still as usize] = (0, 0);
        }
        if let Some(trip) = self.signs.evident(sent, &self.built) {
            self.off(trip);
        } else if self.may_probe
            && let Some((kind, way)) = self.signs.suspected(sent, self.confirmed, &self.built)
            && self.pauses[kind as usize].0 <= 0
        {
            self.probes += 1;
            self.mode = Mode::Probing(Probe::new(kind, way, &self.signs, sent, &self.built));
        }
    }

    fn answered(&mut self, probe: Probe, answer: Answer, sent: f64) {
        self.mode = match answer {
            Answer::Waiting => Mode::Probing(probe),
            Answer::Frozen if probe.unmoved => return self.off(Trip::Frozen),
            Answer::Frozen => Mode::Probing(probe.repeated(&self.signs, sent, &self.built)),
            Answer::Wrong if self.wrong + 1 >= WRONG => return self.off(Trip::WrongWay),
            Answer::Wrong => {
                self.wrong += 1;
                Mode::Probing(probe.again())
            }
            Answer::Right | Answer::Untold => Mode::Watching,
        };
        if matches!(self.mode, Mode::Watching) {
            let (left, passed) = &mut self.pauses[probe.kind as usize];
            let [first, longest] = PAUSES[probe.kind as usize];
            let pause = (first * f64::from(1 << (*passed).min(8))).min(longest);
            if answer == Answer::Right {
                (self.wrong, self.confirmed) = (0, true);
            }
            // What went the wrong way once is asked again at the next sign of it.
            if self.wrong == 0 {
                (*left, *passed) = ((pause / self.built.step) as i32, *passed + 1);
            }
            self.probed_at = self.signs.past[0];
            self.signs.forget();
        }
    }

    fn off(&mut self, why: Trip) {
        self.mode = Mode::Off {
            why,
            calm: 0,
            since_moved: 0,
        };
        self.trips += 1;
    }
}

/// All axes of a device.
pub(super) struct Watched {
    axes: [Plausibility; MAX_AXES],
    n: usize,
    /// What was sent last [N], and where the axes are, if that is new.
    sent: [f64; MAX_AXES],
    positions: Option<[f64; MAX_AXES]>,
}

impl Watched {
    /// Axes that are built so, sent a force every `period` [s].
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

    /// Nothing is added to the forces that are asked for: what is evident trips, what is suspected does not.
    pub(super) fn probe_nothing(&mut self) {
        for axis in &mut self.axes {
            axis.may_probe = false;
        }
    }

    /// Where the axes are now.
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

    /// Motion and forces were missed: no suspicion stands on what was seen before.
    pub(super) fn restart(&mut self) {
        self.axes.iter_mut().for_each(Plausibility::restart);
    }

    /// What then went to the motors [N].
    pub(super) fn sent(&mut self, newtons: &[f64]) {
        self.sent[..newtons.len()].copy_from_slice(newtons);
    }

    /// Why the forces of an axis are off, if they are.
    pub(super) fn trip(&self, axis: usize) -> Option<Trip> {
        self.axes.get(axis).and_then(Plausibility::trip)
    }

    /// The player wants forces again.
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
