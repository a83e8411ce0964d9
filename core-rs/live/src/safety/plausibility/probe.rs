//! A probe: a force that differs from the piece's for some milliseconds, and what the key answers.

use super::signs::{AxisParameters, OVER, Signs, Suspicion};

/// How fast a probe grows [N/s], how great it is at most [N] (at a stop beside the force that is there), and how long it
/// lasts at most [s].
const SHAPES: [(f64, f64, f64); 3] = [
    (100.0, 1.2, 0.04),
    (1_000.0, 1.0, 0.04),
    (1_000.0, 3.0, 0.008),
];
/// Between two probes the key goes by itself for so many steps, so that its course is known.
const SETTLES: u32 = 2 * OVER as u32;
/// A key that leaves its course by so much has answered [m].
const ANSWER: f64 = 1e-4;

/// And by so much of the way that a free key would go, but no more than so many times it.
const PART: (f64, f64) = (0.25, 2.5);

/// What a key said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// Nothing yet.
    Waiting,
    /// It went the way it was pushed.
    Right,
    /// It could not be told.
    Untold,
    /// It went the other way.
    Wrong,
    /// The sensor did not change at all.
    Frozen,
}

/// A probe that goes on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probe {
    pub(super) kind: Suspicion,
    way: f64,
    most: f64,
    /// Steps until it begins, and since then.
    settles: u32,
    steps: u32,
    /// What it adds to the piece's force now, or gives instead of it [N].
    pub(super) offset: f64,
    pub(super) instead: bool,
    /// The course of the key if nothing had changed: position, velocity, acceleration.
    course: [f64; 3],
    /// The force when it began, and velocity and way of a free key by what differs from it.
    pub(super) force: f64,
    driven: [f64; 2],
    /// The greatest change of the force that was really sent [N], and whether the sensor changed.
    most_sent: f64,
    moved: bool,
    /// The sensor did not change in the probe before.
    pub(super) unmoved: bool,
}

impl Probe {
    pub(super) fn new(
        kind: Suspicion,
        way: f64,
        signs: &Signs,
        force: f64,
        own: &AxisParameters,
    ) -> Self {
        let beside = if kind == Suspicion::Stop {
            force.abs()
        } else {
            0.0
        };
        let mut probe = Self {
            kind,
            way,
            most: SHAPES[kind as usize].1 + beside,
            settles: 0,
            steps: 0,
            offset: 0.0,
            instead: false,
            course: [0.0; 3],
            force: 0.0,
            driven: [0.0; 2],
            most_sent: 0.0,
            moved: false,
            unmoved: false,
        };
        probe.begin(signs, force, own);
        probe
    }

    /// The same once more, from no offset at once: a hand that goes along with a force that grows does not with that.
    pub(super) fn repeated(self, signs: &Signs, force: f64, own: &AxisParameters) -> Self {
        Self {
            unmoved: true,
            ..Self::new(self.kind, self.way, signs, force, own)
        }
    }

    /// The next one, soon, from however the key moves then; until it is over the piece's force does not act.
    pub(super) fn again(self) -> Self {
        Self {
            kind: Suspicion::Run,
            most: SHAPES[Suspicion::Run as usize].1,
            settles: SETTLES,
            offset: 0.0,
            instead: true,
            ..self
        }
    }

    fn begin(&mut self, signs: &Signs, force: f64, own: &AxisParameters) {
        let (v, a) = (signs.velocity(own), signs.acceleration(own));
        self.course = match self.kind {
            // The mean velocity over some steps is that of half of them ago.
            Suspicion::Run => [signs.past[0], v + 0.5 * OVER as f64 * own.step * a, a],
            Suspicion::Still | Suspicion::Stop => [signs.past[0], 0.0, 0.0],
        };
        (self.steps, self.force, self.driven) = (0, force, [0.0; 2]);
    }

    /// A step: the key is where `signs` has it, by the force `sent`.
    pub(super) fn step(&mut self, signs: &Signs, sent: f64, own: &AxisParameters) -> Answer {
        if self.settles > 0 {
            self.settles -= 1;
            if self.settles == 0 {
                self.way = if signs.velocity(own) < 0.0 { -1.0 } else { 1.0 };
                self.begin(signs, sent, own);
            }
            return Answer::Waiting;
        }
        let (slope, _, longest) = SHAPES[self.kind as usize];
        self.steps += 1;
        self.moved |= !signs.is_still();
        let t = f64::from(self.steps) * own.step;
        let push = if self.kind == Suspicion::Stop {
            // Until the force would push it into the stop, the key may be held there by the force.
            self.way * (self.way * sent).max(0.0)
        } else {
            sent - self.force
        };
        self.most_sent = self.most_sent.max((sent - self.force).abs());
        self.driven[0] += push / own.mass * own.step;
        self.driven[1] += self.driven[0] * own.step;
        let [x, v, a] = self.course;
        let off = signs.past[0] - (x + (v + 0.5 * a * t) * t);
        let enough = ANSWER.max(3.0 * own.resolution);
        // By a force that hardly changed, or a sensor that does not, nothing is told; nor by what is a small part of the
        // way that the force drives a free key, for so much a hand does meanwhile.
        let driven = self.driven[1];
        let told = off.abs() >= enough.max(PART.0 * driven.abs()) && !signs.is_still();
        if told && off * driven > 0.0 && driven.abs() >= 0.3 * enough {
            return Answer::Right;
        }
        let by_hand = self.kind == Suspicion::Run && off.abs() > PART.1 * driven.abs();
        if told && off * driven < 0.0 && driven.abs() >= enough && !by_hand {
            return Answer::Wrong;
        }
        if t >= longest {
            let shows = self.kind == Suspicion::Still && 2.0 * own.shows() <= self.most;
            let pushed = self.most_sent >= 0.75 * self.most;
            return if shows && pushed && !self.moved {
                Answer::Frozen
            } else {
                Answer::Untold
            };
        }
        let offset = self.way * slope * (t + own.step);
        self.offset = offset.clamp(-self.most, self.most);
        Answer::Waiting
    }
}
