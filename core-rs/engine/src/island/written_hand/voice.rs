//! One voice of a key: its gestures in order, its free copy of the key, and the positions that it asks for.

mod answer;
mod join;
mod takeover;

pub(crate) use takeover::{VoiceTakeover, shared};

use super::ergons_for_view::Sparks;
use super::framed::{FramedGesture, Leg};
use super::free::frame_powers::FramePowers;
use super::free::{Buffers, FreeKey, FreeMotion};
use super::particle::Flight;
use crate::archive::{Archive, Damaged, State, state_of};
use crate::gesture::quintic::Knot;
use crate::gesture::report::GestureReport;
use crate::gesture::script::Touch;
use crate::island::inside;
use crate::island::record::Stream;
use crate::kernel;
use crate::kernel::KernelScratch;
use crate::scheme::Scheme;
use crate::state::{Body, Target};
use join::Joining;

/// A layer's free key counts as at rest below this, in metres and in metres a second: far below what is heard.
const STILL_BOUND: f64 = 1e-12;

/// The constant data of a voice.
#[derive(Clone, Debug)]
pub(crate) struct VoiceScript {
    /// Index of the key.
    pub(crate) key: usize,
    /// Struck MAT in the scene.
    pub(crate) struck: usize,
    pub(crate) free: FreeKey,
    /// Gestures by rising start, as indices into the timeline's.
    pub(crate) gestures: Vec<usize>,
    /// Whether the voice adds to another: its path is then a deviation, and the scene's key is not compared with it.
    pub(crate) is_layer: bool,
    /// Links that join the struck MAT to other parts, each with the MAT at its other end.
    pub(crate) outer_links: Vec<(usize, usize)>,
}

/// The state of a voice.
#[derive(Clone, Debug)]
pub(crate) struct Voice {
    free: FreeMotion,
    /// Imposed points inside the free key, at this frame.
    targets: Vec<Target>,
    buffers: Buffers,
    flight: Flight,
    pub(crate) sparks: Sparks,
    /// The gesture that runs.
    running: Option<RunningGesture>,
    /// Present if the key is held on its path in this frame: the ergon is known once all other forces are.
    tracked: Option<TrackedFrame>,
    /// Whether a path led the key to this frame.
    is_led: bool,
    /// Number of gestures begun (also those that only join so far).
    begun: usize,
    /// Position asked for at the present frame [m]; NaN: none.
    pub(crate) asked: f64,
}

impl State for Voice {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        archive.list(&mut self.targets)?;
        state_of!(self, archive, free, flight, running, tracked, is_led, begun, asked)
    }
}

#[derive(Clone, Debug, Default)]
struct RunningGesture {
    gesture: usize,
    leg: usize,
    cursor: usize,
    source: usize,
    joining: Option<Joining>,
    /// The strike of the present throw or grain is done until this frame, at which the key is to be at `target` [m].
    struck_until: u64,
    target: f64,
}

crate::archive::option!(RunningGesture, optional);
crate::archive::state!(RunningGesture {
    gesture,
    leg,
    cursor,
    source,
    joining,
    struck_until,
    target
});

/// A frame of a tracked key.
#[derive(Clone, Copy, Debug, Default)]
struct TrackedFrame {
    gesture: usize,
    source: u32,
    x: f64,
}

crate::archive::option!(TrackedFrame, optional);
crate::archive::state!(TrackedFrame { gesture, source, x });

/// What is asked of the key at a frame.
#[derive(Clone, Copy)]
enum Ask {
    /// Be at x at the next frame.
    Pass(f64),
    /// Be struck once, to pass x at frame `to`.
    Aim { to: u64, x: f64 },
}

/// The parts of the scene that a voice reads and changes.
pub(crate) struct Scene<'a> {
    pub(crate) scheme: &'a Scheme,
    pub(crate) body: &'a mut Body,
    pub(crate) targets: &'a mut Vec<Target>,
    pub(crate) gestures: &'a [FramedGesture],
    pub(crate) reports: &'a mut [GestureReport],
    pub(crate) stream: &'a mut Stream,
    pub(crate) bodies: &'a mut [inside::RunningBody],
    /// Sum of the deviations that layers add to each key [m]   (n_keys)
    pub(crate) layers: &'a [f64],
}

impl VoiceScript {
    /// The MAT of another part that pushes the key most, if any does.
    fn pushed_by(&self, body: &Body) -> Option<usize> {
        let link_push = |link: usize| body.link[link].abs();
        let strongest = self
            .outer_links
            .iter()
            .max_by(|a, b| link_push(a.0).total_cmp(&link_push(b.0)))?;
        (link_push(strongest.0) > 0.0).then_some(strongest.1)
    }
}

impl Voice {
    /// Whether the voice has anything to do at frame `n`. A layer sleeps before its own time, and after
    /// it as soon as its free key is at rest.
    pub(crate) fn is_awake(&self, script: &VoiceScript, gestures: &[FramedGesture], n: u64) -> bool {
        let is_due = |&i: &usize| (gestures[i].join_from..=gestures[i].last()).contains(&n);
        let i = script.free.struck;
        let key_moves = self.free.body.x[i].abs() + self.free.body.d[i].abs() * script.free.scheme.rate > STILL_BOUND;
        !script.is_layer || key_moves || script.gestures.iter().any(is_due)
    }

    /// The first frame, `n` or later, at which a gesture plays.
    pub(crate) fn due(&self, script: &VoiceScript, gestures: &[FramedGesture], n: u64) -> u64 {
        if self.running.is_some() {
            return n;
        }
        let voice_gestures = script.gestures.iter().map(|&index| &gestures[index]);
        let gestures_left = voice_gestures.filter(|gesture| gesture.last() >= n);
        let due_frames = gestures_left.map(|gesture| gesture.join_from.min(gesture.first).max(n));
        due_frames.min().unwrap_or(u64::MAX)
    }

    /// If the voice does nothing to the key: the frame at which it has to look at its next gesture; `None` if it may
    /// act now.
    pub(crate) fn idle_until(&self, script: &VoiceScript, gestures: &[FramedGesture]) -> Option<u64> {
        let is_idle = self.running.is_none()
            && self.tracked.is_none()
            && !self.is_led
            && self.asked.is_nan()
            && self.flight.is_over();
        let next_gesture = script
            .gestures
            .get(self.begun)
            .map(|&gesture_index| &gestures[gesture_index]);
        let next_frame = next_gesture.map_or(u64::MAX, |gesture| gesture.join_from.min(gesture.first));
        is_idle.then_some(next_frame)
    }

    /// Compute a frame in which it does nothing to the key, with the same result as [`Self::step`].
    pub(crate) fn step_idle(&mut self, script: &VoiceScript, reports: &mut [GestureReport], n: u64) {
        self.report_range(script, reports);
        if self.buffers.has_only_flow {
            return FreeKey::flow(&mut self.free);
        }
        let free_key = &script.free;
        free_key.forces(&mut self.free, n, &mut self.buffers.laws, &mut self.targets);
        free_key.strike_and_move(&mut self.free, n, 0.0, &mut self.targets);
    }

    /// For a free key at rest: advance by `frames`, which may be negative.
    pub(crate) fn shift_frames(&mut self, frames: i64) {
        self.free.shift_frames(frames);
    }

    /// Most frames between two kicks of a slow part of its free key.
    pub(crate) fn kick_every(&self) -> u32 {
        self.free.kick_every()
    }

    /// The deviation that a layer adds to its key now [m].
    pub(crate) fn deviation(&self, script: &VoiceScript) -> f64 {
        self.free.body.x[script.free.struck]
    }

    pub(crate) fn new(script: &VoiceScript, free: FreeMotion) -> Self {
        let laws = KernelScratch::new(&script.free.scheme);
        let buffers = Buffers {
            has_only_flow: script.free.has_only_flow(&free),
            coast: free.clone(),
            laws,
            targets: Vec::new(),
            frame_powers: FramePowers::new(&script.free),
        };
        Self {
            free,
            targets: Vec::new(),
            buffers,
            flight: Flight::default(),
            sparks: Sparks::default(),
            running: None,
            tracked: None,
            is_led: false,
            begun: 0,
            asked: f64::NAN,
        }
    }

    /// Reserve room for every imposed point inside the key, and for the struck MAT.
    pub(crate) fn reserve(&mut self, script: &VoiceScript) {
        for targets in [&mut self.targets, &mut self.buffers.targets] {
            targets.reserve(script.free.drives.len() + 1);
        }
    }

    /// Play frame `n`: compare, decide, strike, and move the free key to frame n + 1.
    pub(crate) fn step(&mut self, script: &VoiceScript, scene: &mut Scene<'_>, n: u64) {
        if self.buffers.has_only_flow && self.idle_until(script, scene.gestures).is_some_and(|until| until > n) {
            return self.step_idle(script, scene.reports, n);
        }
        self.compare(script, scene, n);
        script
            .free
            .forces(&mut self.free, n, &mut self.buffers.laws, &mut self.targets);
        self.flight.step(scene.body, script.struck);
        self.begin(script, scene, n);
        let frame_ask = self.requested_motion(scene.gestures, scene.scheme.rate, n);
        let asked_position = std::mem::replace(&mut self.asked, f64::NAN);
        let force = match frame_ask {
            Some(frame_ask) => self.answer(script, scene, n, &frame_ask, asked_position),
            None if self.is_led => {
                let force = script.free.release(&self.free);
                scene.body.push(script.struck, force);
                force
            }
            None => 0.0,
        };
        self.is_led = matches!(frame_ask, Some(Ask::Pass(_)));
        if self.is_led {
            let release_velocity = self.free.release_at_pull(script.free.struck);
            if release_velocity != 0.0 {
                let bodies = scene.bodies.iter_mut();
                bodies.for_each(|body| body.add_velocity(script.struck, release_velocity));
            }
        }
        if let Some(running) = self.running.as_ref().filter(|running| running.struck_until == n + 1) {
            self.asked = running.target;
        }
        script.free.strike_and_move(&mut self.free, n, force, &mut self.targets);
    }

    /// Compare the key with the position that was asked for, in the report.
    fn compare(&self, script: &VoiceScript, scene: &mut Scene<'_>, n: u64) {
        let Some(report) = self.report_range(script, scene.reports) else {
            return;
        };
        if !self.asked.is_nan() && !script.is_layer {
            let wanted_position = self.asked + scene.layers[script.key];
            let deviation = (scene.body.x[script.struck] - wanted_position).abs();
            report.squared_deviation_sum += deviation * deviation;
            report.n_compared_frames += 1;
            report.stop = n as f64 / scene.scheme.rate;
            if deviation > report.deviation_max {
                (report.deviation_max, report.deviation_max_instant) = (deviation, report.stop);
                report.pushed_by_mat = script.pushed_by(scene.body);
            }
        }
    }

    /// Add the free key's position to the report of the gesture that runs or ran last; returns that report, if there is
    /// one.
    fn report_range<'a>(
        &self,
        script: &VoiceScript,
        reports: &'a mut [GestureReport],
    ) -> Option<&'a mut GestureReport> {
        let running_gesture = self.running.as_ref().map(|running| running.gesture);
        let last_gesture = || {
            self.begun
                .checked_sub(1)
                .map(|begun_index| script.gestures[begun_index])
        };
        let report = &mut reports[running_gesture.or_else(last_gesture)?];
        let free_position = self.free.body.x[script.free.struck];
        report.position_min = report.position_min.min(free_position);
        report.position_max = report.position_max.max(free_position);
        Some(report)
    }

    /// Position, velocity and acceleration of the key that the gesture acts on: the free copy, or the scene's key if it
    /// is tracked.
    fn motion(&self, script: &VoiceScript, scene: &Scene<'_>, touch: Touch, n: u64) -> Knot {
        let (scheme, body, mat_index) = match touch {
            Touch::Open => (&*script.free.scheme, &self.free.body, script.free.struck),
            Touch::Tracked => (scene.scheme, &*scene.body, script.struck),
        };
        let (x, position_before) = (body.x[mat_index], body.x[mat_index] - body.d[mat_index]);
        let position_next = kernel::predict_position(scheme, body, mat_index);
        let frame_rate = scheme.rate;
        let [v_correction, a_correction] = match touch {
            Touch::Open => self.free.estimate_corrections(mat_index, self.is_led),
            Touch::Tracked => [0.0; 2],
        };
        let (v, a) = (
            (position_next - position_before) * (0.5 * frame_rate) + v_correction * frame_rate,
            (position_next - 2.0 * x + position_before + a_correction) * (frame_rate * frame_rate),
        );
        Knot {
            t: n as f64 / frame_rate,
            x,
            v,
            a,
        }
    }

    /// What the running gesture asks at frame `n`.
    fn requested_motion(&mut self, gestures: &[FramedGesture], rate: f64, n: u64) -> Option<Ask> {
        let running = self.running.as_mut()?;
        let gesture = &gestures[running.gesture];
        let target_frame = n + 1;
        let ask_time = target_frame as f64 / rate;
        if let Some(joining) = &running.joining {
            if ask_time < joining.end {
                return Some(Ask::Pass(joining.curve.evaluate(ask_time).0));
            }
            running.joining = None;
        }
        // The first frame of a gesture that was joined in time still belongs to its entry.
        if target_frame <= gesture.first {
            return Some(Ask::Pass(gesture.gesture.entry_at(ask_time)));
        }
        while target_frame > gesture.legs.get(running.leg)?.last() {
            running.leg += 1;
            running.cursor = 0;
            if running.leg == gesture.legs.len() {
                self.running = None;
                return None;
            }
        }
        match &gesture.legs[running.leg] {
            Leg::Path { path, entered, last } => match gesture.gesture.manner.grain {
                None if target_frame > *entered => Some(Ask::Pass(
                    path.evaluate_from(&mut running.cursor, ask_time.min(path.stop())).0,
                )),
                _ if n < running.struck_until => None,
                grain => {
                    let landing_frame = match grain {
                        Some(grain) => gesture.knot_after(n, grain, rate),
                        None => *entered,
                    };
                    let landing_frame = landing_frame.min(*last);
                    running.struck_until = landing_frame;
                    let ask_time = (landing_frame as f64 / rate).min(path.stop());
                    running.target = path.evaluate_from(&mut running.cursor, ask_time).0;
                    Some(Ask::Aim {
                        to: landing_frame,
                        x: running.target,
                    })
                }
            },
            Leg::Throw {
                from,
                to: landing_frame,
                x,
            } if n >= running.struck_until.max(*from) => {
                (running.struck_until, running.target) = (*landing_frame, *x);
                Some(Ask::Aim {
                    to: *landing_frame,
                    x: *x,
                })
            }
            Leg::Throw { .. } => None,
        }
    }
}

impl RunningGesture {
    fn new(gesture: usize, joining: Option<Joining>) -> Self {
        Self {
            gesture,
            leg: 0,
            cursor: 0,
            source: 0,
            joining,
            struck_until: 0,
            target: f64::NAN,
        }
    }
}
