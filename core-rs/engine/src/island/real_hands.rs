//! Real hands in an island: positions in, mean forces out, once a tick.

use crate::state::ModuleState;
use crate::timeline::{Drive, Hand, HandInterpolation};

/// A hand, and the MAT that it moves.
#[derive(Clone, Debug)]
pub(crate) struct HandBinding {
    mat: usize,
    hand: Hand,
}

/// State of a hand.
#[derive(Clone, Debug, Default)]
pub(super) struct HandState {
    /// Position that a device has sent for the next tick, and its last step if the device knows it [m].
    sent_motion: Option<(f64, Option<f64>)>,
    /// Positions at the last tick and at the end of this one [m].
    start_position: f64,
    end_position: f64,
    /// Sum of the forces in this tick [N].
    force_sum: f64,
    /// Mean force over the last complete tick [N].
    mean_force: f64,
}

crate::archive::option!((f64, Option<f64>), optional);

crate::archive::state!(HandState {
    sent_motion,
    start_position,
    end_position,
    force_sum,
    mean_force
});

impl HandBinding {
    /// The MAT that it moves.
    pub(crate) fn mat(&self) -> usize {
        self.mat
    }
}

/// Set the hands to the timeline's positions in the frame before `frame`.
pub(super) fn seek_hands(hand_bindings: &[HandBinding], hand_states: &mut [HandState], frame: u64) {
    for (binding, state) in hand_bindings.iter().zip(hand_states) {
        state.end_position = binding.hand.position(frame.saturating_sub(1));
    }
}

/// The hands among drives.
pub(super) fn hand_bindings(drives: &[Drive]) -> Vec<HandBinding> {
    let binding = |drive: &Drive| {
        Some(HandBinding {
            mat: drive.mat,
            hand: drive.hand()?.clone(),
        })
    };
    drives.iter().filter_map(binding).collect()
}

/// Set positions and last steps of the hands' MATs at a frame.
pub(super) fn move_hands(
    hand_bindings: &[HandBinding],
    hand_states: &mut [HandState],
    frame: u64,
    modules: &mut ModuleState,
) {
    for (binding, state) in hand_bindings.iter().zip(hand_states) {
        let (mat_position, mat_last_step) = (&mut modules.x[binding.mat], &mut modules.d[binding.mat]);
        let tick_frames = u64::from(binding.hand.tick_frames);
        let frame_in_tick = frame % tick_frames;
        if frame_in_tick == 0 {
            let (end_position, sent_last_step) = state
                .sent_motion
                .unwrap_or_else(|| (binding.hand.position(frame), None));
            let start_position = if frame == 0 { end_position } else { state.end_position };
            (state.start_position, state.end_position) = (start_position, end_position);
            if tick_frames == 1 || binding.hand.interpolation == HandInterpolation::Hold {
                *mat_last_step = sent_last_step.unwrap_or(end_position - start_position);
                *mat_position = end_position;
                continue;
            }
        }
        if binding.hand.interpolation == HandInterpolation::Line {
            let displacement = state.end_position - state.start_position;
            *mat_last_step = displacement / tick_frames as f64;
            *mat_position = state.start_position + displacement * ((frame_in_tick + 1) as f64 / tick_frames as f64);
        }
    }
}

/// Add the summed forces of a frame to the mean of the tick.
pub(super) fn add_hand_forces(
    hand_bindings: &[HandBinding],
    hand_states: &mut [HandState],
    frame: u64,
    modules: &ModuleState,
) {
    for (binding, state) in hand_bindings.iter().zip(hand_states) {
        state.force_sum += modules.force[binding.mat];
        let tick_frames = u64::from(binding.hand.tick_frames);
        if (frame + 1).is_multiple_of(tick_frames) {
            state.mean_force = state.force_sum / tick_frames as f64;
            state.force_sum = 0.0;
        }
    }
}

impl super::Island {
    /// Set the position of a hand of the scene from the next tick on, and its last step [m].
    pub(crate) fn set_hand_position(&mut self, hand: usize, x: f64, last_step: Option<f64>) {
        for (binding, state) in self
            .script
            .hand_bindings
            .iter()
            .zip(&mut self.state.sources.hand_states)
        {
            if binding.hand.index == hand {
                state.sent_motion = Some((x, last_step));
            }
        }
    }

    /// Mean force on a hand of the scene over the last complete tick [N].
    pub(crate) fn hand_force(&self, hand: usize) -> f64 {
        let bindings_and_states = self.script.hand_bindings.iter().zip(&self.state.sources.hand_states);
        let hand_states = bindings_and_states.filter(|(binding, _)| binding.hand.index == hand);
        hand_states.map(|(_, state)| state.mean_force).sum()
    }
}
