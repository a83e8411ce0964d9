//! One voice of a key: its gestures in order, its free copy, and what it asks at each frame.

use super::free::{FreeKey, Room};
use super::particle::Flight;
use super::quintic::{Knot, Quintic};
use super::script::{Ergons, Gesture, Leg, Report, Touch};
use crate::plan::Plan;
use crate::simulation::record::{Record, Stream};
use crate::state::{Body, Target};
use crate::{kernel, maths};

/// Closer than this a key is where the gesture begins, and needs no joining curve [m].
const AGREES: f64 = 1e-9;
/// A joining curve shorter than this is worse than a late one [s]: 3 mm in 5 ms are 3,600 m/s².
const JOIN_MIN: f64 = 5e-3;

/// What never changes of a voice.
#[derive(Clone, Debug)]
pub(crate) struct VoiceScript {
    /// Index of the key.
    pub(crate) key: usize,
    /// Struck MAT in the scene.
    pub(crate) struck: usize,
    pub(crate) free: FreeKey,
    /// Gestures by rising start, as indices into the timeline's.
    pub(crate) gestures: Vec<usize>,
    /// The voice adds to another: its path is a deviation, and the scene's key is not held against it.
    pub(crate) layer: bool,
}

/// What moves of a voice.
#[derive(Clone, Debug)]
pub(crate) struct Voice {
    free: Body,
    /// Imposed points inside the free key, at this frame.
    targets: Vec<Target>,
    room: Room,
    flight: Flight,
    /// The gesture that runs.
    now: Option<Running>,
    /// Number of gestures begun (also those that only join so far).
    begun: usize,
    /// Where the key is wanted at the present frame [m]; NaN: nowhere.
    pub(crate) asked: f64,
}

#[derive(Clone, Debug)]
struct Running {
    gesture: usize,
    leg: usize,
    cursor: usize,
    source: usize,
    joining: Option<Joining>,
    /// The strike of the present throw, or of the present grain, is done until this frame.
    struck_until: u64,
}

/// A curve that leads onto a gesture's path, up to an instant [s].
#[derive(Clone, Debug)]
struct Joining {
    curve: Quintic,
    end: f64,
}

/// What is wanted of the key at a frame.
enum Ask {
    /// Be at x at the next frame.
    Pass(f64),
    /// Be struck once, to pass x at frame `to`.
    Aim { to: u64, x: f64 },
}

/// What a voice may touch of the scene.
pub(crate) struct Scene<'a> {
    pub(crate) plan: &'a Plan,
    pub(crate) body: &'a mut Body,
    pub(crate) targets: &'a mut Vec<Target>,
    pub(crate) gestures: &'a [Gesture],
    pub(crate) reports: &'a mut [Report],
    pub(crate) stream: &'a mut Stream,
}

impl Voice {
    pub(crate) fn new(script: &VoiceScript, free: Body) -> Self {
        let laws = script.free.plan.laws();
        let targets = Vec::with_capacity(script.free.drives.len());
        let room = Room {
            coast: free.clone(),
            laws,
            targets: targets.clone(),
        };
        Self {
            free,
            targets,
            room,
            flight: Flight::default(),
            now: None,
            begun: 0,
            asked: f64::NAN,
        }
    }

    /// Play frame `n`: compare, decide, strike, and move the free key to frame n + 1.
    pub(crate) fn step(&mut self, script: &VoiceScript, scene: &mut Scene<'_>, n: u64) {
        self.compare(script, scene, n);
        script
            .free
            .forces(&mut self.free, n, &mut self.room.laws, &mut self.targets);
        self.flight.step(scene.body, script.struck);
        self.begin(script, scene, n);
        let ask = self.ask(scene.gestures, scene.plan.rate, n);
        self.asked = f64::NAN;
        let force = match ask {
            Some(ask) => self.answer(script, scene, n, &ask),
            None => 0.0,
        };
        script
            .free
            .strike_and_move(&mut self.free, force, &mut self.targets);
    }

    /// Hold what was asked against what was done.
    fn compare(&self, script: &VoiceScript, scene: &mut Scene<'_>, n: u64) {
        let latest = self
            .now
            .as_ref()
            .map(|now| now.gesture)
            .or_else(|| self.begun.checked_sub(1).map(|last| script.gestures[last]));
        let Some(gesture) = latest else { return };
        let report = &mut scene.reports[gesture];
        let free = self.free.x[script.free.struck];
        report.low = report.low.min(free);
        report.high = report.high.max(free);
        if !self.asked.is_nan() && !script.layer {
            let off = (scene.body.x[script.struck] - self.asked).abs();
            report.square += off * off;
            report.compared += 1;
            report.stop = n as f64 / scene.plan.rate;
            if off > report.worst {
                (report.worst, report.worst_at) = (off, report.stop);
            }
        }
    }

    /// Position, velocity and acceleration of the key that the gesture is written for.
    fn motion(&self, script: &VoiceScript, scene: &Scene<'_>, touch: Touch, n: u64) -> Knot {
        let (plan, body, i) = match touch {
            Touch::Open => (&*script.free.plan, &self.free, script.free.struck),
            Touch::Tracked => (scene.plan, &*scene.body, script.struck),
        };
        let (x, before) = (body.x[i], body.x[i] - body.d[i]);
        let next = kernel::predict(plan, body, i);
        let rate = plan.rate;
        let (v, a) = (
            (next - before) * (0.5 * rate),
            (next - 2.0 * x + before) * (rate * rate),
        );
        Knot {
            t: n as f64 / rate,
            x,
            v,
            a,
        }
    }

    /// Begin the next gesture, or the curve that joins it, when its time has come.
    fn begin(&mut self, script: &VoiceScript, scene: &mut Scene<'_>, n: u64) {
        let rate = scene.plan.rate;
        while let Some(&index) = script.gestures.get(self.begun) {
            let gesture = &scene.gestures[index];
            let now = n as f64 / rate;
            let joined = self.now.as_ref().is_some_and(|now| now.gesture == index);
            if n >= gesture.first {
                self.begun += 1;
                scene.reports[index].start = now;
                if joined {
                    continue;
                }
                let late = self.late_joining(script, scene, gesture, n);
                scene.reports[index].first_point_missed = late.is_some();
                self.now = Some(Running::new(index, late));
                continue;
            }
            let left = gesture.start - now;
            let in_time = n >= gesture.join_from && left >= JOIN_MIN.min(gesture.join);
            if self.now.is_none() && in_time {
                let from = self.motion(script, scene, gesture.touch, n);
                let still =
                    (from.x - gesture.entry.x).abs() <= AGREES && (from.v / rate).abs() <= AGREES;
                if !still && gesture.join > 0.0 {
                    self.now = Some(Running::new(index, Some(Joining::new(from, gesture.entry))));
                }
            }
            return;
        }
    }

    /// The curve by which a gesture that begins elsewhere joins its own path after its start.
    fn late_joining(
        &self,
        script: &VoiceScript,
        scene: &Scene<'_>,
        gesture: &Gesture,
        n: u64,
    ) -> Option<Joining> {
        let Leg::Path { path, .. } = gesture.legs.first()? else {
            return None;
        };
        let from = self.motion(script, scene, gesture.touch, n);
        // Where one gesture ends as the next begins, off the grid of frames, the key has not quite
        // come to the point they share.
        let before = self
            .begun
            .checked_sub(2)
            .map(|before| &scene.gestures[script.gestures[before]]);
        let shared =
            before.is_some_and(|it| it.last() == n && (it.exit - gesture.entry.x).abs() <= AGREES);
        let agrees = shared
            || [path.at(from.t).0, gesture.entry.x]
                .iter()
                .any(|x| (from.x - x).abs() <= AGREES);
        if agrees || gesture.join == 0.0 {
            return None;
        }
        let t = (from.t + gesture.join).min(path.stop());
        let (x, v, a) = path.at(t);
        (t > from.t).then(|| Joining::new(from, Knot { t, x, v, a }))
    }

    /// What the running gesture asks at frame `n`.
    fn ask(&mut self, gestures: &[Gesture], rate: f64, n: u64) -> Option<Ask> {
        let now = self.now.as_mut()?;
        let gesture = &gestures[now.gesture];
        let target = n + 1;
        let t = target as f64 / rate;
        if let Some(joining) = &now.joining {
            if t < joining.end {
                return Some(Ask::Pass(joining.curve.at(t).0));
            }
            now.joining = None;
        }
        // The first frame of a gesture that was joined in time still belongs to its entry.
        if target <= gesture.first {
            return Some(Ask::Pass(gesture.entry_at(t)));
        }
        while target > gesture.legs.get(now.leg)?.last() {
            now.leg += 1;
            now.cursor = 0;
            if now.leg == gesture.legs.len() {
                self.now = None;
                return None;
            }
        }
        match &gesture.legs[now.leg] {
            Leg::Path { path, last } => match gesture.grain {
                None => Some(Ask::Pass(
                    path.at_from(&mut now.cursor, t.min(path.stop())).0,
                )),
                Some(_) if n < now.struck_until => None,
                Some(grain) => {
                    let to = (n + grain).min(*last);
                    now.struck_until = to;
                    let t = (to as f64 / rate).min(path.stop());
                    Some(Ask::Aim {
                        to,
                        x: path.at_from(&mut now.cursor, t).0,
                    })
                }
            },
            Leg::Throw { from, to, x } if n >= now.struck_until.max(*from) => {
                now.struck_until = *to;
                Some(Ask::Aim { to: *to, x: *x })
            }
            Leg::Throw { .. } => None,
        }
    }

    /// Strike the key so that it does what is asked; returns the force on the free key [N].
    fn answer(&mut self, script: &VoiceScript, scene: &mut Scene<'_>, n: u64, ask: &Ask) -> f64 {
        let Some(now) = self.now.as_mut() else {
            return 0.0;
        };
        let index = now.gesture;
        let gesture = &scene.gestures[index];
        let (free, local, struck) = (&script.free, script.free.struck, script.struck);
        let w = scene.plan.w[struck];
        let (asked, target) = match *ask {
            Ask::Pass(x) => (x, n + 1),
            Ask::Aim { to, x } => (x, to),
        };
        let source = gesture.source(&mut now.source, target);
        let wanted = match (ask, gesture.touch) {
            (Ask::Pass(x), Touch::Open) => (x - kernel::predict(&free.plan, &self.free, local)) / w,
            (Ask::Pass(x), Touch::Tracked) => {
                (x - kernel::predict(scene.plan, scene.body, struck)) / w
            }
            (&Ask::Aim { to, x }, Touch::Open) => free.aim(&self.free, n, to, x, &mut self.room),
            (&Ask::Aim { to, x }, Touch::Tracked) => {
                // Aim from where the loaded key is.
                for (local, &member) in free.members.iter().enumerate() {
                    self.free.x[local] = scene.body.x[member];
                    self.free.d[local] = scene.body.d[member];
                }
                free.forces(&mut self.free, n, &mut self.room.laws, &mut self.targets);
                free.aim(&self.free, n, to, x, &mut self.room)
            }
        };
        if matches!(ask, Ask::Pass(_)) || target == n + 1 {
            self.asked = asked;
        }
        let over = wanted.abs() > gesture.limit;
        let report = &mut scene.reports[index];
        report.missed += u64::from(over);
        let force = match (over, gesture.touch) {
            (false, _) => wanted,
            (true, Touch::Open) => maths::copysign(gesture.limit, wanted),
            // A tracked step that would need more leaves the key free.
            (true, Touch::Tracked) => 0.0,
        };
        if !force.is_finite() || force == 0.0 {
            return 0.0;
        }
        let rate = scene.plan.rate;
        let t = 1.0 / rate;
        let mass = t * t / w;
        report.n_ergons += 1;
        report.strongest = report.strongest.max(force.abs() * t / mass);
        report.force_max = report.force_max.max(force.abs());
        let before = scene.body.x[struck] - scene.body.d[struck];
        let velocity = (kernel::predict(scene.plan, scene.body, struck) - before) * (0.5 * rate);
        let mut record = Record::event(n as f64 / rate, struck, source, mass, velocity, force * t);
        match (ask, gesture.touch, gesture.ergons) {
            (Ask::Pass(x), Touch::Tracked, _) => {
                scene.targets.push(Target {
                    mat: struck,
                    x: *x,
                    was: 0.0,
                });
                // The free copy goes where the key goes.
                scene.stream.push(record);
                return (x - kernel::predict(&free.plan, &self.free, local)) / w;
            }
            (_, _, Ergons::Event) => scene.body.push(struck, force),
            (_, _, Ergons::Particle) => {
                match self.flight.launch(scene.plan, scene.body, struck, force) {
                    Some((mass, speed)) => (record.mass, record.speed) = (mass, speed),
                    None => scene.body.push(struck, force),
                }
            }
        }
        scene.stream.push(record);
        force
    }
}

impl Joining {
    fn new(from: Knot, to: Knot) -> Self {
        Self {
            curve: Quintic::joining(from, to),
            end: to.t,
        }
    }
}

impl Running {
    fn new(gesture: usize, joining: Option<Joining>) -> Self {
        Self {
            gesture,
            leg: 0,
            cursor: 0,
            source: 0,
            joining,
            struck_until: 0,
        }
    }
}
