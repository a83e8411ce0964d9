//! How a gesture begins: directly, if the key is where it begins, or by a curve that leads onto its path.

use super::{RunningGesture, Voice, VoiceScene, VoiceScript};
use crate::gesture::quintic::{Knot, Quintic};
use crate::island::written_hand::framed::{FramedGesture, FramedSegment};

/// A key closer than this to the beginning of a gesture needs no joining curve [m].
const JOINING_DISTANCE_MIN: f64 = 1e-9;
/// A joining curve shorter than this is worse than a late one [s]: 3 mm in 5 ms are 3,600 m/s².
const JOINING_SECONDS_MIN: f64 = 5e-3;

/// A curve that leads onto a gesture's path, up to an instant [s].
#[derive(Clone, Debug, Default)]
pub(super) struct JoiningCurve {
    pub(super) curve: Quintic,
    pub(super) end_time: f64,
}

crate::archive::option!(JoiningCurve, optional);
crate::archive::state!(JoiningCurve { curve, end_time });

impl JoiningCurve {
    fn new(start_state: Knot, end_state: Knot) -> Self {
        Self {
            curve: Quintic::between_knots(start_state, end_state),
            end_time: end_state.t,
        }
    }
}

impl Voice {
    /// Begin the next gesture, or the curve that joins it, when its time has come.
    pub(super) fn begin_gestures(&mut self, script: &VoiceScript, scene: &mut VoiceScene<'_>, frame: u64) {
        let frame_rate = scene.scheme.rate;
        while let Some(&gesture_index) = script.gesture_indices.get(self.begun_count) {
            let framed = &scene.gestures[gesture_index];
            let time_now = frame as f64 / frame_rate;
            let has_joined = self
                .running_gesture
                .as_ref()
                .is_some_and(|running_gesture| running_gesture.gesture_index == gesture_index);
            if frame >= framed.first_frame {
                self.begun_count += 1;
                scene.reports[gesture_index].start = time_now;
                if has_joined {
                    continue;
                }
                let late_curve = self.late_joining_curve(script, scene, framed, frame);
                scene.reports[gesture_index].is_first_point_missed = late_curve.is_some();
                self.running_gesture = Some(RunningGesture::new(gesture_index, late_curve));
                continue;
            }
            let time_left = framed.gesture.start - time_now;
            let is_in_time =
                frame >= framed.join_frame && time_left >= JOINING_SECONDS_MIN.min(framed.gesture.manner.join_seconds);
            if self.running_gesture.is_none() && is_in_time {
                let key_knot = self.key_knot(script, scene, framed.gesture.manner.touch, frame);
                let is_at_entry = (key_knot.x - framed.gesture.entry_knot.x).abs() <= JOINING_DISTANCE_MIN
                    && (key_knot.v / frame_rate).abs() <= JOINING_DISTANCE_MIN;
                if !is_at_entry && framed.gesture.manner.join_seconds > 0.0 {
                    self.running_gesture = Some(RunningGesture::new(
                        gesture_index,
                        Some(JoiningCurve::new(key_knot, framed.gesture.entry_knot)),
                    ));
                }
            }
            return;
        }
    }

    /// The curve by which a gesture joins its own path after its start, if the key is elsewhere.
    fn late_joining_curve(
        &self,
        script: &VoiceScript,
        scene: &VoiceScene<'_>,
        framed: &FramedGesture,
        frame: u64,
    ) -> Option<JoiningCurve> {
        let FramedSegment::Path { path, .. } = framed.segments.first()? else {
            return None;
        };
        let knot_now = self.key_knot(script, scene, framed.gesture.manner.touch, frame);
        // If one gesture ends as the next begins, off the grid of frames, the key has not quite reached the point that
        // they share.
        let previous_gesture = self
            .begun_count
            .checked_sub(2)
            .map(|earlier_index| &scene.gestures[script.gesture_indices[earlier_index]]);
        let shares_point = previous_gesture.is_some_and(|earlier_gesture| {
            frame.abs_diff(earlier_gesture.last_frame()) < framed.frames_per_score_frame()
                && (earlier_gesture.gesture.last_position - framed.gesture.entry_knot.x).abs() <= JOINING_DISTANCE_MIN
        });
        let is_on_path = shares_point
            || [path.evaluate(knot_now.t).0, framed.gesture.entry_knot.x]
                .iter()
                .any(|x| (knot_now.x - x).abs() <= JOINING_DISTANCE_MIN);
        if is_on_path || framed.gesture.manner.join_seconds == 0.0 {
            return None;
        }
        let last_time = framed.last_frame() as f64 / scene.scheme.rate;
        let t = (knot_now.t + framed.gesture.manner.join_seconds)
            .min(path.end_time())
            .min(last_time);
        let (x, v, a) = path.evaluate(t);
        (t > knot_now.t).then(|| JoiningCurve::new(knot_now, Knot { t, x, v, a }))
    }
}
