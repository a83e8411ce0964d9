//! A probe: for some milliseconds the force differs from the piece's, and the answer of the key is judged.

use super::signs::{AxisParameters, OVER, Signs, Suspicion};

/// For each kind of suspicion: the growth of a probe [N/s], its greatest force [N] (at a stop in addition to the
/// present force), and its longest duration [s].
const SHAPES: [(f64, f64, f64); 3] = [
    (100.0, 1.2, 0.04),
    (1_000.0, 1.0, 0.04),
    (1_000.0, 3.0, 0.008),
];
/// Steps between two probes without an offset, so that the course of the key is known.
const SETTLES: u32 = 2 * OVER as u32;
/// Least deviation from its course that counts as an answer [m].
const ANSWER: f64 = 1e-4;

/// Factors of the way of a free key under the probe: an answer is at least the first, a wrong answer to a probe of
/// `Run` at most the second.
const PART: (f64, f64) = (0.25, 2.5);

/// The answer of the key to a probe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// No answer yet.
    Waiting,
    /// The key went the way it was pushed.
    Right,
    /// The answer could not be told.
    Untold,
    /// The key went the other way.
    Wrong,
    /// The sensor did not change at all.
    Frozen,
}

/// A probe under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probe {
    pub(super) kind: Suspicion,
    way: f64,
    most: f64,
    /// Steps until it begins, and steps since then.
    settles: u32,
    steps: u32,
    /// Its force now [N]; and whether that replaces the piece's force instead of being added to it.
    pub(super) offset: f64,
    pub(super) instead: bool,
    /// The course of the key without the probe: position, velocity, acceleration.
    course: [f64; 3],
    /// The force at the beginning; and velocity and way of a free key under the difference from that force.
    pub(super) force: f64,
    driven: [f64; 2],
    /// The greatest change of the force that was really sent [N], and whether the sensor has changed.
    most_sent: f64,
    moved: bool,
    /// Whether the sensor did not change in the previous probe.
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

    /// The same probe once more, whose offset begins at zero again: a hand that yields to a growing force does not
    /// follow that jump.
    pub(super) fn repeated(self, signs: &Signs, force: f64, own: &AxisParameters) -> Self {
        Self {
            unmoved: true,
            ..Self::new(self.kind, self.way, signs, force, own)
        }
    }

    /// Another probe of the kind `Run` after a few steps, in the direction in which the key then moves. Until it is
    /// over, the piece's force does not act.
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
            // The mean velocity over `OVER` steps is the velocity of half as many steps ago.
            Suspicion::Run => [signs.past[0], v + 0.5 * OVER as f64 * own.step * a, a],
            Suspicion::Still | Suspicion::Stop => [signs.past[0], 0.0, 0.0],
        };
        (self.steps, self.force, self.driven) = (0, force, [0.0; 2]);
    }

    /// Advance by a step: `signs` has the position of the key, `sent` is the force sent.
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
            // As long as the force does not push into the stop, the old force may hold the key there.
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
        // Nothing can be told if the force hardly changed, if the sensor does not change, or if the deviation is a
        // small part of the way of a free key: a hand moves that much meanwhile.
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
