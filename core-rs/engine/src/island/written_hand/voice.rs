//! One voice of a key: its gestures in order, its free copy of the key, and the positions that it requests.

mod answer;
mod join;
mod takeover;

pub(crate) use takeover::{VoiceTakeover, equal_gestures};

use super::ergons_for_view::Sparks;
use super::framed::{FramedGesture, FramedSegment};
use super::free::frame_powers::FramePowers;
use super::free::{FreeKey, FreeMotion, VoiceBuffers};
use super::particle::Particles;
use crate::archive::{Archive, Damaged, State, state_of};
use crate::gesture::quintic::Knot;
use crate::gesture::report::GestureReport;
use crate::gesture::script::Touch;
use crate::island::bodies;
use crate::island::record::ErgonStream;
use crate::kernel;
use crate::kernel::KernelScratch;
use crate::scheme::Scheme;
use crate::state::{ImposedTarget, ModuleState};
use join::JoiningCurve;

/// A layer's free key counts as at rest below this, in metres and in metres a second: far below what is heard.
const STILL_BOUND: f64 = 1e-12;

/// The constant data of a voice.
#[derive(Clone, Debug)]
pub(crate) struct VoiceScript {
    /// Index of the key.
    pub(crate) key_index: usize,
    /// Struck MAT in the scene.
    pub(crate) struck_mat: usize,
    pub(crate) free_key: FreeKey,
    /// Gestures by rising start, as indices into the timeline's.
    pub(crate) gesture_indices: Vec<usize>,
    /// Whether the voice adds to another: its path is then a deviation, and the scene's key is not compared with it.
    pub(crate) is_layer: bool,
    /// Links that join the struck MAT to other parts, each with the MAT at its other end.
    pub(crate) outer_links: Vec<(usize, usize)>,
}

/// The state of a voice.
#[derive(Clone, Debug)]
pub(crate) struct Voice {
    free_motion: FreeMotion,
    /// Imposed points inside the free key, at this frame.
    targets: Vec<ImposedTarget>,
    buffers: VoiceBuffers,
    particles: Particles,
    pub(crate) sparks: Sparks,
    /// The gesture that runs.
    running_gesture: Option<RunningGesture>,
    /// Present if the key is held on its path in this frame: the ergon is known once all other forces are.
    tracked_frame: Option<TrackedFrame>,
    /// Whether a path led the key to this frame.
    is_led: bool,
    /// Number of gestures begun (also those that only join so far).
    begun_count: usize,
    /// Position requested at the present frame [m]; NaN: none.
    pub(crate) requested_position: f64,
}

impl State for Voice {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        archive.list(&mut self.targets)?;
        state_of!(
            self,
            archive,
            free_motion,
            particles,
            running_gesture,
            tracked_frame,
            is_led,
            begun_count,
            requested_position
        )
    }
}

#[derive(Clone, Debug, Default)]
struct RunningGesture {
    gesture_index: usize,
    segment_index: usize,
    path_cursor: usize,
    point_cursor: usize,
    joining_curve: Option<JoiningCurve>,
    /// The strike of the present throw or grain is done until this frame, at which the key is to be at `strike_target`
    /// [m].
    strike_end_frame: u64,
    strike_target: f64,
}

crate::archive::option!(RunningGesture, optional);
crate::archive::state!(RunningGesture {
    gesture_index,
    segment_index,
    path_cursor,
    point_cursor,
    joining_curve,
    strike_end_frame,
    strike_target
});

/// A frame of a tracked key.
#[derive(Clone, Copy, Debug, Default)]
struct TrackedFrame {
    gesture_index: usize,
    source: u32,
    position: f64,
}

crate::archive::option!(TrackedFrame, optional);
crate::archive::state!(TrackedFrame {
    gesture_index,
    source,
    position
});

/// A request to the key at a frame.
#[derive(Clone, Copy)]
enum Request {
    /// Be at x at the next frame.
    Pass(f64),
    /// Be struck once, to pass x at frame `arrival_frame`.
    Aim { arrival_frame: u64, x: f64 },
}

/// The parts of the scene that a voice reads and changes.
pub(crate) struct VoiceScene<'a> {
    pub(crate) scheme: &'a Scheme,
    pub(crate) modules: &'a mut ModuleState,
    pub(crate) targets: &'a mut Vec<ImposedTarget>,
    pub(crate) gestures: &'a [FramedGesture],
    pub(crate) reports: &'a mut [GestureReport],
    pub(crate) ergon_stream: &'a mut ErgonStream,
    pub(crate) bodies: &'a mut [bodies::RunningBody],
    /// Sum of the deviations that layers add to each key [m]   (n_keys)
    pub(crate) layer_deviations: &'a [f64],
}

impl VoiceScript {
    /// The MAT of another part that pushes the key most, if any does.
    fn pushing_mat(&self, modules: &ModuleState) -> Option<usize> {
        let link_push = |link: usize| modules.link_forces[link].abs();
        let strongest_link = self
            .outer_links
            .iter()
            .max_by(|a, b| link_push(a.0).total_cmp(&link_push(b.0)))?;
        (link_push(strongest_link.0) > 0.0).then_some(strongest_link.1)
    }
}

impl Voice {
    /// Whether the voice has anything to do at frame `n`. A layer sleeps before its own time, and after
    /// it as soon as its free key is at rest.
    pub(crate) fn is_awake(&self, script: &VoiceScript, gestures: &[FramedGesture], n: u64) -> bool {
        let is_due = |&i: &usize| (gestures[i].join_frame..=gestures[i].last_frame()).contains(&n);
        let i = script.free_key.struck_mat;
        let is_key_moving = self.free_motion.modules.x[i].abs()
            + self.free_motion.modules.d[i].abs() * script.free_key.scheme.rate
            > STILL_BOUND;
        !script.is_layer || is_key_moving || script.gesture_indices.iter().any(is_due)
    }

    /// The first frame, `n` or later, at which a gesture plays.
    pub(crate) fn next_gesture_frame(&self, script: &VoiceScript, gestures: &[FramedGesture], n: u64) -> u64 {
        if self.running_gesture.is_some() {
            return n;
        }
        let voice_gestures = script.gesture_indices.iter().map(|&index| &gestures[index]);
        let gestures_left = voice_gestures.filter(|gesture| gesture.last_frame() >= n);
        let due_frames = gestures_left.map(|gesture| gesture.join_frame.min(gesture.first_frame).max(n));
        due_frames.min().unwrap_or(u64::MAX)
    }

    /// If the voice does nothing to the key: the frame at which its next gesture begins; `None` if it may act now.
    pub(crate) fn idle_end_frame(&self, script: &VoiceScript, gestures: &[FramedGesture]) -> Option<u64> {
        let is_idle = self.running_gesture.is_none()
            && self.tracked_frame.is_none()
            && !self.is_led
            && self.requested_position.is_nan()
            && self.particles.is_empty();
        let next_gesture = script
            .gesture_indices
            .get(self.begun_count)
            .map(|&gesture_index| &gestures[gesture_index]);
        let next_frame = next_gesture.map_or(u64::MAX, |gesture| gesture.join_frame.min(gesture.first_frame));
        is_idle.then_some(next_frame)
    }

    /// Compute a frame in which it does nothing to the key, with the same result as [`Self::step`].
    pub(crate) fn step_idle(&mut self, script: &VoiceScript, reports: &mut [GestureReport], n: u64) {
        self.report_range(script, reports);
        if self.buffers.has_only_flow {
            return FreeKey::step_flow(&mut self.free_motion);
        }
        let free_key = &script.free_key;
        free_key.sum_forces(&mut self.free_motion, n, &mut self.buffers.scratch, &mut self.targets);
        free_key.strike_and_move(&mut self.free_motion, n, 0.0, &mut self.targets);
    }

    /// For a free key at rest: advance by `frames`, which may be negative.
    pub(crate) fn shift_frames(&mut self, frames: i64) {
        self.free_motion.shift_frames(frames);
    }

    /// Most frames between two kicks of a slow part of its free key.
    pub(crate) fn kick_interval(&self) -> u32 {
        self.free_motion.kick_interval()
    }

    /// The deviation that a layer adds to its key now [m].
    pub(crate) fn deviation(&self, script: &VoiceScript) -> f64 {
        self.free_motion.modules.x[script.free_key.struck_mat]
    }

    pub(crate) fn new(script: &VoiceScript, free_motion: FreeMotion) -> Self {
        let scratch = KernelScratch::new(&script.free_key.scheme);
        let buffers = VoiceBuffers {
            has_only_flow: script.free_key.has_only_flow(&free_motion),
            trial_motion: free_motion.clone(),
            scratch,
            targets: Vec::new(),
            frame_powers: FramePowers::new(&script.free_key),
        };
        Self {
            free_motion,
            targets: Vec::new(),
            buffers,
            particles: Particles::default(),
            sparks: Sparks::default(),
            running_gesture: None,
            tracked_frame: None,
            is_led: false,
            begun_count: 0,
            requested_position: f64::NAN,
        }
    }

    /// Reserve room for every imposed point inside the key, and for the struck MAT.
    pub(crate) fn reserve(&mut self, script: &VoiceScript) {
        for targets in [&mut self.targets, &mut self.buffers.targets] {
            targets.reserve(script.free_key.drives.len() + 1);
        }
    }

    /// Play frame `n`: compare, decide, strike, and move the free key to frame n + 1.
    pub(crate) fn step(&mut self, script: &VoiceScript, scene: &mut VoiceScene<'_>, n: u64) {
        if self.buffers.has_only_flow
            && self
                .idle_end_frame(script, scene.gestures)
                .is_some_and(|until| until > n)
        {
            return self.step_idle(script, scene.reports, n);
        }
        self.compare_with_request(script, scene, n);
        script
            .free_key
            .sum_forces(&mut self.free_motion, n, &mut self.buffers.scratch, &mut self.targets);
        self.particles.step(scene.modules, script.struck_mat);
        self.begin_gestures(script, scene, n);
        let request = self.next_request(scene.gestures, scene.scheme.rate, n);
        let last_requested_position = std::mem::replace(&mut self.requested_position, f64::NAN);
        let force = match request {
            Some(motion_request) => {
                self.strike_as_requested(script, scene, n, &motion_request, last_requested_position)
            }
            None if self.is_led => {
                let force = script.free_key.release_force(&self.free_motion);
                scene.modules.push(script.struck_mat, force);
                force
            }
            None => 0.0,
        };
        self.is_led = matches!(request, Some(Request::Pass(_)));
        if self.is_led {
            let release_velocity = self.free_motion.apply_pull_release(script.free_key.struck_mat);
            if release_velocity != 0.0 {
                let bodies = scene.bodies.iter_mut();
                bodies.for_each(|body| body.add_velocity(script.struck_mat, release_velocity));
            }
        }
        if let Some(running_gesture) = self
            .running_gesture
            .as_ref()
            .filter(|running_gesture| running_gesture.strike_end_frame == n + 1)
        {
            self.requested_position = running_gesture.strike_target;
        }
        script
            .free_key
            .strike_and_move(&mut self.free_motion, n, force, &mut self.targets);
    }

    /// Compare the key with the requested position, in the report.
    fn compare_with_request(&self, script: &VoiceScript, scene: &mut VoiceScene<'_>, n: u64) {
        let Some(report) = self.report_range(script, scene.reports) else {
            return;
        };
        if !self.requested_position.is_nan() && !script.is_layer {
            let target_position = self.requested_position + scene.layer_deviations[script.key_index];
            let deviation = (scene.modules.x[script.struck_mat] - target_position).abs();
            report.squared_deviation_sum += deviation * deviation;
            report.n_compared_frames += 1;
            report.stop = n as f64 / scene.scheme.rate;
            if deviation > report.deviation_max {
                (report.deviation_max, report.deviation_max_instant) = (deviation, report.stop);
                report.pushed_by_mat = script.pushing_mat(scene.modules);
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
        let running_gesture = self
            .running_gesture
            .as_ref()
            .map(|running_gesture| running_gesture.gesture_index);
        let last_gesture = || {
            self.begun_count
                .checked_sub(1)
                .map(|begun_index| script.gesture_indices[begun_index])
        };
        let report = &mut reports[running_gesture.or_else(last_gesture)?];
        let free_position = self.free_motion.modules.x[script.free_key.struck_mat];
        report.position_min = report.position_min.min(free_position);
        report.position_max = report.position_max.max(free_position);
        Some(report)
    }

    /// Position, velocity and acceleration of the key that the gesture acts on: the free copy, or the scene's key if it
    /// is tracked.
    fn key_knot(&self, script: &VoiceScript, scene: &VoiceScene<'_>, touch: Touch, n: u64) -> Knot {
        let (scheme, modules, mat_index) = match touch {
            Touch::Open => (
                &*script.free_key.scheme,
                &self.free_motion.modules,
                script.free_key.struck_mat,
            ),
            Touch::Tracked => (scene.scheme, &*scene.modules, script.struck_mat),
        };
        let (x, position_before) = (modules.x[mat_index], modules.x[mat_index] - modules.d[mat_index]);
        let position_next = kernel::predict_position(scheme, modules, mat_index);
        let frame_rate = scheme.rate;
        let [v_correction, a_correction] = match touch {
            Touch::Open => self.free_motion.estimate_corrections(mat_index, self.is_led),
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

    /// The request of the running gesture at frame `n`.
    fn next_request(&mut self, gestures: &[FramedGesture], rate: f64, n: u64) -> Option<Request> {
        let running_gesture = self.running_gesture.as_mut()?;
        let gesture = &gestures[running_gesture.gesture_index];
        let target_frame = n + 1;
        let request_time = target_frame as f64 / rate;
        if let Some(joining) = &running_gesture.joining_curve {
            if request_time < joining.end_time {
                return Some(Request::Pass(joining.curve.evaluate(request_time).0));
            }
            running_gesture.joining_curve = None;
        }
        // The first frame of a gesture that was joined in time still belongs to its entry.
        if target_frame <= gesture.first_frame {
            return Some(Request::Pass(gesture.gesture.entry_at(request_time)));
        }
        while target_frame > gesture.segments.get(running_gesture.segment_index)?.last_frame() {
            running_gesture.segment_index += 1;
            running_gesture.path_cursor = 0;
            if running_gesture.segment_index == gesture.segments.len() {
                self.running_gesture = None;
                return None;
            }
        }
        match &gesture.segments[running_gesture.segment_index] {
            FramedSegment::Path {
                path,
                entry_frame,
                last_frame,
            } => match gesture.gesture.manner.grain {
                None if target_frame > *entry_frame => Some(Request::Pass(
                    path.evaluate_from(&mut running_gesture.path_cursor, request_time.min(path.end_time()))
                        .0,
                )),
                _ if n < running_gesture.strike_end_frame => None,
                grain => {
                    let landing_frame = match grain {
                        Some(grain) => gesture.next_knot_frame(n, grain, rate),
                        None => *entry_frame,
                    };
                    let landing_frame = landing_frame.min(*last_frame);
                    running_gesture.strike_end_frame = landing_frame;
                    let request_time = (landing_frame as f64 / rate).min(path.end_time());
                    running_gesture.strike_target =
                        path.evaluate_from(&mut running_gesture.path_cursor, request_time).0;
                    Some(Request::Aim {
                        arrival_frame: landing_frame,
                        x: running_gesture.strike_target,
                    })
                }
            },
            FramedSegment::Throw {
                strike_frame,
                landing_frame,
                x,
            } if n >= running_gesture.strike_end_frame.max(*strike_frame) => {
                (running_gesture.strike_end_frame, running_gesture.strike_target) = (*landing_frame, *x);
                Some(Request::Aim {
                    arrival_frame: *landing_frame,
                    x: *x,
                })
            }
            FramedSegment::Throw { .. } => None,
        }
    }
}

impl RunningGesture {
    fn new(gesture_index: usize, joining_curve: Option<JoiningCurve>) -> Self {
        Self {
            gesture_index,
            segment_index: 0,
            path_cursor: 0,
            point_cursor: 0,
            joining_curve,
            strike_end_frame: 0,
            strike_target: f64::NAN,
        }
    }
}
