//! Starting a voice at a later frame, and continuing one from the state of another version.

use std::collections::HashMap;

use super::{RunningGesture, Voice, VoiceScript};
use crate::island::written_hand::framed::FramedGesture;

/// What one voice passes on to another.
#[derive(Clone, Debug)]
pub(crate) struct VoiceTakeover {
    /// Index of the voice in the old island, and in this one.
    pub(crate) old_voice: usize,
    pub(crate) new_voice: usize,
    /// Pairs of MATs of the free keys, new and old; `None`: the two keys are equal.
    pub(crate) new_and_old_mats: Option<Vec<(usize, usize)>>,
    /// Pairs of equal gestures, old and new; rising.
    pub(crate) gesture_pairs: Vec<(usize, usize)>,
}

impl VoiceTakeover {
    /// Index in the new island of a gesture of the old one.
    fn new_gesture(&self, old_gesture: usize) -> Option<usize> {
        let pair_index = self.gesture_pairs.binary_search_by_key(&old_gesture, |pair| pair.0);
        pair_index.ok().map(|pair_index| self.gesture_pairs[pair_index].1)
    }
}

/// Pairs of equal gestures of two voices: old and new, rising.
pub(crate) fn equal_gestures(
    (script, gestures): (&VoiceScript, &[FramedGesture]),
    (other_script, other_gestures): (&VoiceScript, &[FramedGesture]),
) -> Vec<(usize, usize)> {
    let mut indices_by_start: HashMap<u64, Vec<usize>> = HashMap::new();
    for &gesture_index in &script.gesture_indices {
        let start_bits = gestures[gesture_index].gesture.start.to_bits();
        indices_by_start.entry(start_bits).or_default().push(gesture_index);
    }
    let mut gesture_pairs = Vec::new();
    for &other_index in &other_script.gesture_indices {
        let Some(candidates) = indices_by_start.get_mut(&other_gestures[other_index].gesture.start.to_bits()) else {
            continue;
        };
        if let Some(match_index) = candidates.iter().position(|&gesture_index| {
            gestures[gesture_index]
                .gesture
                .is_same(&other_gestures[other_index].gesture)
        }) {
            gesture_pairs.push((other_index, candidates.remove(match_index)));
        }
    }
    gesture_pairs.sort_unstable();
    gesture_pairs
}

impl Voice {
    /// Begin at frame `frame`: gestures that began before it are skipped.
    pub(crate) fn seek(&mut self, script: &VoiceScript, gestures: &[FramedGesture], frame: u64) {
        let is_past = |&gesture_index: &usize| gestures[gesture_index].first_frame < frame;
        self.begun_count = script.gesture_indices.partition_point(is_past);
        self.free_motion.seek(frame);
    }

    /// Take over the state of `old`, with the gesture that it plays if this voice has it too. If not, the key moves
    /// freely, and the next gesture joins it there.
    pub(crate) fn continue_from(
        &mut self,
        script: &VoiceScript,
        old: &mut Self,
        old_script: &VoiceScript,
        takeover: &VoiceTakeover,
    ) {
        match &takeover.new_and_old_mats {
            None => std::mem::swap(&mut self.free_motion, &mut old.free_motion),
            Some(pairs) => {
                let (modules, old_modules) = (&mut self.free_motion.modules, &old.free_motion.modules);
                for &(new_mat, old_mat) in pairs {
                    (modules.x[new_mat], modules.d[new_mat]) = (old_modules.x[old_mat], old_modules.d[old_mat]);
                }
                self.free_motion.set_slow_bodies();
            }
        }
        let latest_gesture_index = |voice: &Self, script: &VoiceScript| {
            let running_index = voice
                .running_gesture
                .as_ref()
                .map(|running_gesture| running_gesture.gesture_index);
            running_index.or_else(|| {
                voice
                    .begun_count
                    .checked_sub(1)
                    .map(|last| script.gesture_indices[last])
            })
        };
        let previous_gesture_index =
            latest_gesture_index(old, old_script).map(|old_gesture| takeover.new_gesture(old_gesture));
        self.particles = std::mem::take(&mut old.particles);
        self.is_led = old.is_led;
        self.running_gesture = old.running_gesture.take().and_then(|running_gesture| {
            let gesture_index = takeover.new_gesture(running_gesture.gesture_index)?;
            Some(RunningGesture {
                gesture_index,
                ..running_gesture
            })
        });
        // The position requested for this frame is kept only if the comparison goes into the report of the same
        // gesture.
        let is_same_gesture = previous_gesture_index == Some(latest_gesture_index(self, script));
        self.requested_position = if is_same_gesture {
            old.requested_position
        } else {
            f64::NAN
        };
    }
}
