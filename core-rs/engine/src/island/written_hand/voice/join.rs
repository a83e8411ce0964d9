//! How a gesture begins: directly, if the key is where it begins, or by a curve that leads onto its path.

use super::{RunningGesture, Scene, Voice, VoiceScript};
use crate::gesture::quintic::{Knot, Quintic};
use crate::island::written_hand::framed::{FramedGesture, Leg};

/// A key closer than this to the beginning of a gesture needs no joining curve [m].
const JOINING_DISTANCE_MIN: f64 = 1e-9;
/// A joining curve shorter than this is worse than a late one [s]: 3 mm in 5 ms are 3,600 m/s².
const JOINING_SECONDS_MIN: f64 = 5e-3;

/// A curve that leads onto a gesture's path, up to an instant [s].
#[derive(Clone, Debug, Default)]
pub(super) struct Joining {
    pub(super) curve: Quintic,
    pub(super) end: f64,
}

crate::archive::option!(Joining, optional);
crate::archive::state!(Joining { curve, end });

impl Joining {
    fn new(from: Knot, to: Knot) -> Self {
        Self {
            curve: Quintic::between_knots(from, to),
            end: to.t,
        }
    }
}

impl Voice {
    /// Begin the next gesture, or the curve that joins it, when its time has come.
    pub(super) fn begin(&mut self, script: &VoiceScript, scene: &mut Scene<'_>, n: u64) {
        let frame_rate = scene.scheme.rate;
        while let Some(&gesture_index) = script.gestures.get(self.begun) {
            let gesture = &scene.gestures[gesture_index];
            let time_now = n as f64 / frame_rate;
            let has_joined = self
                .running
                .as_ref()
                .is_some_and(|running| running.gesture == gesture_index);
            if n >= gesture.first {
                self.begun += 1;
                scene.reports[gesture_index].start = time_now;
                if has_joined {
                    continue;
                }
                let late_curve = self.late_joining(script, scene, gesture, n);
                scene.reports[gesture_index].is_first_point_missed = late_curve.is_some();
                self.running = Some(RunningGesture::new(gesture_index, late_curve));
                continue;
            }
            let time_left = gesture.gesture.start - time_now;
            let is_in_time =
                n >= gesture.join_from && time_left >= JOINING_SECONDS_MIN.min(gesture.gesture.manner.join_seconds);
            if self.running.is_none() && is_in_time {
                let knot_now = self.motion(script, scene, gesture.gesture.manner.touch, n);
                let is_at_entry = (knot_now.x - gesture.gesture.entry_knot.x).abs() <= JOINING_DISTANCE_MIN
                    && (knot_now.v / frame_rate).abs() <= JOINING_DISTANCE_MIN;
                if !is_at_entry && gesture.gesture.manner.join_seconds > 0.0 {
                    self.running = Some(RunningGesture::new(
                        gesture_index,
                        Some(Joining::new(knot_now, gesture.gesture.entry_knot)),
                    ));
                }
            }
            return;
        }
    }

    /// The curve by which a gesture joins its own path after its start, if the key is elsewhere.
    fn late_joining(
        &self,
        script: &VoiceScript,
        scene: &Scene<'_>,
        gesture: &FramedGesture,
        n: u64,
    ) -> Option<Joining> {
        let Leg::Path { path, .. } = gesture.legs.first()? else {
            return None;
        };
        let knot_now = self.motion(script, scene, gesture.gesture.manner.touch, n);
        // If one gesture ends as the next begins, off the grid of frames, the key has not quite reached the point that
        // they share.
        let gesture_before = self
            .begun
            .checked_sub(2)
            .map(|earlier_index| &scene.gestures[script.gestures[earlier_index]]);
        let shares_point = gesture_before.is_some_and(|earlier_gesture| {
            n.abs_diff(earlier_gesture.last()) < gesture.score_frame()
                && (earlier_gesture.gesture.last_position - gesture.gesture.entry_knot.x).abs() <= JOINING_DISTANCE_MIN
        });
        let agrees = shares_point
            || [path.evaluate(knot_now.t).0, gesture.gesture.entry_knot.x]
                .iter()
                .any(|x| (knot_now.x - x).abs() <= JOINING_DISTANCE_MIN);
        if agrees || gesture.gesture.manner.join_seconds == 0.0 {
            return None;
        }
        let last_time = gesture.last() as f64 / scene.scheme.rate;
        let t = (knot_now.t + gesture.gesture.manner.join_seconds)
            .min(path.stop())
            .min(last_time);
        let (x, v, a) = path.evaluate(t);
        (t > knot_now.t).then(|| Joining::new(knot_now, Knot { t, x, v, a }))
    }
}
