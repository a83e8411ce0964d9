//! Many frames of a linear key at once: one frame is an affine map, and its powers are computed by squaring.

use super::{FreeKey, FreeMotion};
use crate::kernel::KernelScratch;
use crate::state::ImposedTarget;
use crate::timeline::DriveSource;

/// Least number of frames for which powers are used; fewer are computed one by one.
pub(super) const FRAMES_MIN: u64 = 1 << 18;
/// A key of more MATs than this is computed frame by frame.
const MATS_MAX: usize = 8;

/// The map of some frames minus the identity, on (x, d, 1) of all MATs. A slow key changes by far less than 1 in one
/// frame, and the digits of that change would be lost beside the identity.
#[derive(Clone, Debug)]
pub(crate) struct FramePowers {
    n_mat: usize,
    /// (size, size), row by row; the last row is 0
    frame_change: Vec<f64>,
    squared_change: Vec<f64>,
    /// (size,) each
    state: Vec<f64>,
    state_change: Vec<f64>,
}

impl FramePowers {
    /// Buffers for the powers of a key's frame; `None` if a frame is not a constant affine map, or the key has more
    /// MATs than [`MATS_MAX`].
    pub(crate) fn new(free_key: &FreeKey) -> Option<Self> {
        let scheme = &*free_key.scheme;
        let n_mat = scheme.n_mat();
        let has_constant_drives = free_key
            .drives
            .iter()
            .all(|drive| matches!(drive.source, DriveSource::Constant(_)));
        let is_affine = scheme.is_linear && scheme.exact_runs.is_empty() && free_key.slow_bodies.is_empty();
        let state_size = 2 * n_mat + 1;
        (is_affine && has_constant_drives && n_mat <= MATS_MAX).then(|| Self {
            n_mat,
            frame_change: vec![0.0; state_size * state_size],
            squared_change: vec![0.0; state_size * state_size],
            state: vec![0.0; state_size],
            state_change: vec![0.0; state_size],
        })
    }

    fn size(&self) -> usize {
        2 * self.n_mat + 1
    }

    /// Advance a key by `frames` frames without strikes.
    pub(super) fn advance(
        &mut self,
        free_key: &FreeKey,
        motion: &mut FreeMotion,
        mut frames: u64,
        scratch: &mut KernelScratch,
        targets: &mut Vec<ImposedTarget>,
    ) {
        let (mat_count, last_index) = (self.n_mat, self.size() - 1);
        self.state[..mat_count].copy_from_slice(&motion.modules.x);
        self.state[mat_count..last_index].copy_from_slice(&motion.modules.d);
        self.state[last_index] = 1.0;
        self.set_one_frame_map(free_key, motion, scratch, targets);
        while frames > 0 {
            if frames % 2 == 1 {
                self.apply_map();
            }
            frames /= 2;
            if frames > 0 {
                self.square_map();
            }
        }
        motion.modules.x.copy_from_slice(&self.state[..mat_count]);
        motion.modules.d.copy_from_slice(&self.state[mat_count..last_index]);
    }

    /// Set `frame_change` to the change by one frame, column by column: the effect of 1 in one state variable alone,
    /// less that of the zero state.
    fn set_one_frame_map(
        &mut self,
        free_key: &FreeKey,
        motion: &mut FreeMotion,
        scratch: &mut KernelScratch,
        targets: &mut Vec<ImposedTarget>,
    ) {
        let (mat_count, state_size) = (self.n_mat, self.size());
        self.frame_change.fill(0.0);
        for column in (0..state_size).rev() {
            motion.modules.x.fill(0.0);
            motion.modules.d.fill(0.0);
            if column < mat_count {
                motion.modules.x[column] = 1.0;
            } else if column < 2 * mat_count {
                motion.modules.d[column - mat_count] = 1.0;
            }
            free_key.sum_forces(motion, 0, scratch, targets);
            free_key.strike_and_move(motion, 0, 0.0, targets);
            for (mat, &step) in motion.modules.d.iter().enumerate() {
                let step_before = f64::from(u8::from(column == mat_count + mat));
                // The change of a position is exactly its last step.
                for (row, change) in [(mat, step), (mat_count + mat, step - step_before)] {
                    let constant = self.frame_change[row * state_size + state_size - 1];
                    self.frame_change[row * state_size + column] =
                        change - if column < 2 * mat_count { constant } else { 0.0 };
                }
            }
        }
    }

    /// Apply the map to the state.
    fn apply_map(&mut self) {
        let state_size = self.size();
        for (change_entry, row) in self
            .state_change
            .iter_mut()
            .zip(self.frame_change.chunks_exact(state_size))
        {
            *change_entry = row.iter().zip(&self.state).map(|(a, b)| a * b).sum();
        }
        for (state, change) in self.state.iter_mut().zip(&self.state_change) {
            *state += change;
        }
    }

    /// The map of twice as many frames: (1 + B)² = 1 + 2B + B².
    fn square_map(&mut self) {
        let state_size = self.size();
        for (row, out) in self.squared_change.chunks_exact_mut(state_size).enumerate() {
            out.fill(0.0);
            let factors = &self.frame_change[row * state_size..(row + 1) * state_size];
            for (&factor, other_row) in factors.iter().zip(self.frame_change.chunks_exact(state_size)) {
                for (out, other_entry) in out.iter_mut().zip(other_row) {
                    *out += factor * other_entry;
                }
            }
        }
        for (change, square) in self.frame_change.iter_mut().zip(&self.squared_change) {
            *change = 2.0 * *change + square;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::island::written_hand::free::VoiceBuffers;
    use crate::network::{Network, Tie};
    use crate::scheme::Scheme;
    use crate::state::ModuleState;
    use crate::timeline::{Drive, DriveKind};
    use crate::units::Rate;

    /// A mass on a spring that a second one and a weight pull.
    fn key() -> FreeKey {
        let mut network = Network::default();
        let ground_tie = |k, z| Tie::Physical { k, z };
        let first_mat = network.cel("a", 0.4, ground_tie(60.0, 1e-5), 1e-3, 0.0, 0.0);
        let second_mat = network.cel("b", 0.1, ground_tie(2.0, 0.0), 0.0, 0.0, 0.0);
        let (first_mat, second_mat) = (first_mat.unwrap(), second_mat.unwrap());
        network.spring("r", first_mat, second_mat, 30.0, 0.0, 0.0).unwrap();
        let scheme = Scheme::new(&network, Rate::new(44_100.0).unwrap()).unwrap();
        FreeKey {
            scheme: Arc::new(scheme),
            struck_mat: first_mat,
            scene_mats: vec![first_mat, second_mat],
            drives: vec![Drive {
                mat: second_mat,
                kind: DriveKind::Force,
                source: DriveSource::Constant(-0.02),
                acts_on_free_key: true,
            }],
            slow_bodies: Vec::new(),
        }
    }

    fn buffers(free: &FreeKey) -> VoiceBuffers {
        VoiceBuffers {
            has_only_flow: false,
            trial_motion: free.motion_at_rest(),
            scratch: KernelScratch::new(&free.scheme),
            targets: Vec::new(),
            frame_powers: FramePowers::new(free),
        }
    }

    fn moving_key(free: &FreeKey) -> FreeMotion {
        free.start_motion(ModuleState::new(&free.scheme, vec![2e-3, -1e-3], vec![1e-6, 3e-7]))
    }

    #[test]
    fn frame_powers_advance_equals_frames_in_sequence() {
        let free_key = key();
        let mut buffers = buffers(&free_key);
        let mut frame_powers = buffers.frame_powers.take().unwrap();
        for frames in [0, 1, 2, 77, 12_345, 300_001] {
            let mut stepped = moving_key(&free_key);
            for n in 0..frames {
                free_key.sum_forces(&mut stepped, n, &mut buffers.scratch, &mut buffers.targets);
                free_key.strike_and_move(&mut stepped, n, 0.0, &mut buffers.targets);
            }
            let mut advanced = moving_key(&free_key);
            let VoiceBuffers { scratch, targets, .. } = &mut buffers;
            frame_powers.advance(&free_key, &mut advanced, frames, scratch, targets);
            for (stepped, advanced, error_max) in [
                (&stepped.modules.x, &advanced.modules.x, 1e-11),
                (&stepped.modules.d, &advanced.modules.d, 1e-14),
            ] {
                for (a, b) in stepped.iter().zip(advanced) {
                    assert!((a - b).abs() <= error_max, "{a} and {b} after {frames}");
                }
            }
        }
    }

    /// Frame by frame this would take minutes.
    #[test]
    fn aim_of_a_throw_lasting_a_day() {
        let free_key = key();
        let mut buffers = buffers(&free_key);
        let (start_frame, arrival_frame, target_position) = (1_000, 86_399 * 44_100, 0.5e-3);
        let force = free_key.force_to_arrive(
            &moving_key(&free_key),
            start_frame,
            arrival_frame,
            target_position,
            &mut buffers,
        );
        let mut key_motion = moving_key(&free_key);
        let VoiceBuffers {
            scratch,
            targets,
            frame_powers,
            ..
        } = &mut buffers;
        free_key.sum_forces(&mut key_motion, start_frame, scratch, targets);
        free_key.strike_and_move(&mut key_motion, start_frame, force, targets);
        let frame_powers = frame_powers.as_mut().unwrap();
        frame_powers.advance(
            &free_key,
            &mut key_motion,
            arrival_frame - start_frame - 1,
            scratch,
            targets,
        );
        let end_position = key_motion.modules.x[free_key.struck_mat];
        assert!(
            (end_position - target_position).abs() < 1e-9,
            "{end_position} m, by {force} N"
        );
    }

    #[test]
    fn frame_powers_with_laws_are_absent() {
        let mut free_key = key();
        assert!(FramePowers::new(&free_key).is_some());
        Arc::make_mut(&mut free_key.scheme).is_linear = false;
        assert!(FramePowers::new(&free_key).is_none());
    }
}
