//! Starting a voice at a later frame, and continuing one from the state of another version.

use std::collections::HashMap;

use super::{RunningGesture, Voice, VoiceScript};
use crate::island::written_hand::framed::FramedGesture;

/// What one voice passes on to another.
#[derive(Clone, Debug)]
pub(crate) struct VoiceTakeover {
    /// Index of the voice in the old island, and in this one.
    pub(crate) from: usize,
    pub(crate) to: usize,
    /// Pairs of MATs of the free keys, here and there; `None`: the two keys are alike.
    pub(crate) mats: Option<Vec<(usize, usize)>>,
    /// Pairs of equal gestures, there and here; rising.
    pub(crate) gestures: Vec<(usize, usize)>,
}

impl VoiceTakeover {
    /// Index here of a gesture there.
    fn gesture(&self, old_gesture: usize) -> Option<usize> {
        let pair_index = self.gestures.binary_search_by_key(&old_gesture, |pair| pair.0);
        pair_index.ok().map(|pair_index| self.gestures[pair_index].1)
    }
}

/// Pairs of equal gestures of two voices: there and here, rising.
pub(crate) fn shared(
    (script, gestures): (&VoiceScript, &[FramedGesture]),
    (other_script, others): (&VoiceScript, &[FramedGesture]),
) -> Vec<(usize, usize)> {
    let mut by_start: HashMap<u64, Vec<usize>> = HashMap::new();
    for &gesture_index in &script.gestures {
        let start_bits = gestures[gesture_index].gesture.start.to_bits();
        by_start.entry(start_bits).or_default().push(gesture_index);
    }
    let mut gesture_pairs = Vec::new();
    for &other in &other_script.gestures {
        let Some(same_start) = by_start.get_mut(&others[other].gesture.start.to_bits()) else {
            continue;
        };
        if let Some(match_index) = same_start
            .iter()
            .position(|&gesture_index| gestures[gesture_index].gesture.is_same(&others[other].gesture))
        {
            gesture_pairs.push((other, same_start.remove(match_index)));
        }
    }
    gesture_pairs.sort_unstable();
    gesture_pairs
}

impl Voice {
    /// Begin at frame `n`: gestures that began before it are skipped.
    pub(crate) fn seek(&mut self, script: &VoiceScript, gestures: &[FramedGesture], n: u64) {
        let is_past = |&gesture_index: &usize| gestures[gesture_index].first < n;
        self.begun = script.gestures.partition_point(is_past);
        self.free.seek(n);
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
        match &takeover.mats {
            None => std::mem::swap(&mut self.free, &mut old.free),
            Some(pairs) => {
                let (body, their_body) = (&mut self.free.body, &old.free.body);
                for &(new_mat, old_mat) in pairs {
                    (body.x[new_mat], body.d[new_mat]) = (their_body.x[old_mat], their_body.d[old_mat]);
                }
                self.free.settle();
            }
        }
        let latest_gesture = |voice: &Self, script: &VoiceScript| {
            let playing = voice.running.as_ref().map(|running| running.gesture);
            playing.or_else(|| voice.begun.checked_sub(1).map(|last| script.gestures[last]))
        };
        let gesture_before = latest_gesture(old, old_script).map(|old_gesture| takeover.gesture(old_gesture));
        self.flight = std::mem::take(&mut old.flight);
        self.is_led = old.is_led;
        self.running = old.running.take().and_then(|running| {
            let gesture = takeover.gesture(running.gesture)?;
            Some(RunningGesture { gesture, ..running })
        });
        // The position asked for at this very frame is kept only if the comparison goes into the report of the same
        // gesture.
        let is_same_gesture = gesture_before == Some(latest_gesture(self, script));
        self.asked = if is_same_gesture { old.asked } else { f64::NAN };
    }
}
