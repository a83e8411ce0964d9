//! What the motion of a key shows by itself: what is evident, and what has to be probed.

use super::{AxisSpec, Trip};

/// A device that says nothing of its mass is taken for a light fader [kg].
const LIGHT: f64 = 0.05;
/// Positions that are kept.
const PAST: usize = 2 * OVER + 1;
/// Velocity is taken over so many steps.
pub(super) const OVER: usize = 4;

/// This part of the range beside a stop belongs to it.
const MARGIN: f64 = 0.02;
/// A key that moves less within the dwell rests [m].
const RESTS: f64 = 1e-4;
/// A key rests at its stop for so long before that is a suspicion, and before it is a fault [s].
const DWELL: [f64; 2] = [0.1, 0.15];
/// Above such a force [N].
const STOP_FORCE: f64 = 2.0;

/// A position that keeps its last bit for so long is a suspicion [s], above such a force [N].
const STILL: f64 = 0.09;
const STILL_FORCE: f64 = 0.3;
/// It is a fault where the force, averaged over so long [s], changed by so much [N] meanwhile, for so long at least [s].
const SMOOTH: f64 = 0.02;
const CHANGED: f64 = 1.0;
const CHANGED_OVER: f64 = 0.05;
/// The stiffest grip of a hand [N/m]: a force that changes by this many times the sensor's step shows in it.
const FIRM: f64 = 5_000.0;

/// A key that is slower does not run [m/s].
const SLOW: f64 = 0.01;
/// The first length of a run that is looked at [m]; each further one is twice as long.
const RUN: f64 = 3e-4;
/// The growth of the velocity from one length to the next that is a suspicion, above such a force [N]. A hand that
/// begins a stroke smoothly reaches 2^(2/3) = 1.59, a constant push 1.41; a key that runs away reaches 2.
const RUNS: [(f64, f64); 2] = [(1.65, 0.1), (1.38, 0.8)];

/// So is a key that is accelerated against the force by this part of it, above such a force [N].
const DRIVEN: (f64, f64) = (0.4, 0.8);

/// What the motion of a key may mean, and what a probe has to decide.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Suspicion {
    /// The position keeps its last bit under a force.
    Still,
    /// The key rests at a stop that the force pulls it away from.
    Stop,
    /// The key runs against the force, faster and faster.
    Run,
}

/// What an axis is, with what follows from it.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxisParameters {
    /// Of a step [s].
    pub(super) step: f64,
    pub(super) mass: f64,
    pub(super) resolution: f64,
    range: [f64; 2],
    margin: f64,
    run: f64,
    slow: f64,
    /// What the sensor's step makes of an acceleration [N].
    noise: f64,
}

impl AxisParameters {
    pub(super) fn new(built: AxisSpec, step: f64) -> Self {
        let [low, high] = built.range;
        let mass = built.inertia.filter(|m| *m > 0.0).unwrap_or(LIGHT);
        let over = OVER as f64 * step;
        Self {
            step,
            mass,
            noise: 3.0 * mass * built.resolution / (over * over),
            resolution: built.resolution,
            range: built.range,
            margin: MARGIN * (high - low),
            run: RUN.max(8.0 * built.resolution),
            slow: SLOW.max(2.0 * built.resolution / over),
        }
    }

    /// The least force whose change shows in the sensor through the firmest grip [N].
    pub(super) fn shows(&self) -> f64 {
        3.0 * self.resolution * FIRM
    }

    fn steps(&self, seconds: f64) -> u32 {
        (seconds / self.step).ceil() as u32
    }

    /// 1 at the upper stop, -1 at the lower one.
    fn side(&self, x: f64) -> Option<f64> {
        let [low, high] = self.range;
        if x >= high - self.margin {
            Some(1.0)
        } else {
            (x <= low + self.margin).then_some(-1.0)
        }
    }
}

/// A movement in one direction.
#[derive(Clone, Copy, Debug)]
struct Run {
    way: f64,
    from: f64,
    next: f64,
    /// The velocity at the length before [m/s].
    before: Option<f64>,
    suspicious: bool,
    /// Against a force of some newtons for two lengths.
    against: bool,
}

/// What was seen of an axis lately.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Signs {
    /// Positions, the newest first.
    pub(super) past: [f64; PAST],
    n: usize,
    /// Steps with the same position, and the least and greatest smoothed force in them.
    still: u32,
    smooth: f64,
    forces: [f64; 2],
    /// Steps at a stop, which stop, and where.
    dwell: u32,
    side: f64,
    at: f64,
    run: Option<Run>,
}

impl Signs {
    /// A step: where the key is, and the force that took it there.
    pub(super) fn add(&mut self, x: f64, sent: f64, own: &AxisParameters) {
        if self.n == 0 {
            (self.past, self.smooth) = ([x; PAST], sent);
        }
        let same = self.n > 0 && x.to_bits() == self.past[0].to_bits();
        self.n = (self.n + 1).min(PAST);
        self.past.copy_within(0..PAST - 1, 1);
        self.past[0] = x;
        let weight = if same {
            (own.step / SMOOTH).min(1.0)
        } else {
            1.0
        };
        self.smooth += (sent - self.smooth) * weight;
        self.still = if same {
            self.still.saturating_add(1)
        } else {
            0
        };
        self.forces = if same {
            [
                self.forces[0].min(self.smooth),
                self.forces[1].max(self.smooth),
            ]
        } else {
            [self.smooth; 2]
        };
        let side = own.side(x);
        let rests = (x - self.at).abs() <= RESTS.max(2.0 * own.resolution);
        if side.is_some() && rests && self.dwell > 0 {
            self.dwell = self.dwell.saturating_add(1);
        } else {
            (self.dwell, self.at) = (u32::from(side.is_some()), x);
        }
        self.side = side.unwrap_or(0.0);
        self.follow(x, sent, own);
    }

    /// The velocity over the last steps [m/s].
    pub(super) fn velocity(&self, own: &AxisParameters) -> f64 {
        (self.past[0] - self.past[OVER]) / (OVER as f64 * own.step)
    }

    /// The acceleration over the last steps [m/s²].
    pub(super) fn acceleration(&self, own: &AxisParameters) -> f64 {
        let step = OVER as f64 * own.step;
        (self.past[0] - 2.0 * self.past[OVER] + self.past[2 * OVER]) / (step * step)
    }

    /// Whether the newest position is the one before.
    pub(super) fn is_still(&self) -> bool {
        self.still > 0
    }

    /// Suspicions begin anew.
    pub(super) fn forget(&mut self) {
        (self.still, self.dwell, self.run) = (0, 0, None);
        self.forces = [self.smooth; 2];
    }

    /// A movement that grows as its force does.
    fn follow(&mut self, x: f64, sent: f64, own: &AxisParameters) {
        let (v, push) = (self.velocity(own), own.mass * self.acceleration(own));
        let run = match &mut self.run {
            Some(run) if run.way * v > own.slow => run,
            _ => {
                self.run = (v.abs() > own.slow && self.n == PAST).then(|| Run {
                    way: v.signum(),
                    from: x,
                    next: own.run,
                    before: None,
                    suspicious: false,
                    against: false,
                });
                return;
            }
        };
        if run.way * sent >= 0.0 {
            // With the force it may go as it likes.
            (run.from, run.next, run.before) = (x, own.run, None);
        }
        run.against = false;
        run.suspicious =
            -run.way * sent >= DRIVEN.1 && run.way * push >= -DRIVEN.0 * run.way * sent + own.noise;
        while run.way * (x - run.from) >= run.next {
            let against = -run.way * sent;
            run.against = run.before.is_some() && against >= DRIVEN.1;
            let grown = run.before.map_or(0.0, |before| v / before);
            run.suspicious |= RUNS
                .iter()
                .any(|&(growth, force)| grown >= growth && against >= force);
            (run.next, run.before) = (2.0 * run.next, Some(v));
        }
    }

    /// Which stop the key rests at while `force` pushes it further.
    pub(super) fn pushed_out(&self, force: f64, own: &AxisParameters) -> Option<f64> {
        let long = self.dwell >= own.steps(DWELL[1]);
        (long && force * self.side >= STOP_FORCE).then_some(self.side)
    }

    /// A fault that needs no probe.
    pub(super) fn evident(&self, sent: f64, own: &AxisParameters) -> Option<Trip> {
        if self.pushed_out(sent, own).is_some() {
            return Some(Trip::AtStop);
        }
        let changed = self.forces[1] - self.forces[0];
        let frozen = self.still >= own.steps(CHANGED_OVER) && changed >= CHANGED.max(own.shows());
        (frozen && self.side == 0.0).then_some(Trip::Frozen)
    }

    /// A fault that may be, and the way in which its probe pushes; `confirmed`: which way the motor pushes was seen before.
    pub(super) fn suspected(
        &self,
        sent: f64,
        confirmed: bool,
        own: &AxisParameters,
    ) -> Option<(Suspicion, f64)> {
        if self
            .run
            .is_some_and(|run| run.suspicious || (run.against && !confirmed))
        {
            return Some((Suspicion::Run, -sent.signum()));
        }
        if self.dwell >= own.steps(DWELL[0]) && -sent * self.side >= STOP_FORCE {
            return Some((Suspicion::Stop, self.side));
        }
        let still =
            self.still >= own.steps(STILL) && sent.abs() >= STILL_FORCE.max(0.5 * own.shows());
        (still && self.side == 0.0).then_some((Suspicion::Still, -sent.signum()))
    }
}
