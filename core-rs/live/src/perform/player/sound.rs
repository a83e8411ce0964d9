//! The frames of a tick: computed, mixed, limited, and pushed into the ring.

use std::sync::atomic::Ordering;
use std::time::Instant;

use super::{Player, RING_TIMEOUT};
use crate::perform::PreparedPiece;
use crate::perform::frozen::FrozenOutputs;

/// Time constant of the decay of peaks [s].
const PEAK_DECAY_SECONDS: f64 = 0.3;

impl Player {
    /// Compute the frames of the tick, mixed and limited.
    pub(super) fn compute_sound(&mut self, frame_count: usize) {
        let piece = &mut self.piece;
        let channels = piece.mixer.n_channels();
        let n_outputs = piece.simulation.n_out();
        if frame_count > 0 {
            let outputs = &mut self.outputs[..frame_count * n_outputs];
            let mixed_sound = &mut self.mixed_frames[..frame_count * channels];
            if let Some(sound_input) = &mut self.connections.sound_input {
                let is_playing = self.connections.stream_state.played_frames() > 0;
                sound_input.tick(&mut piece.simulation, self.frame, frame_count, is_playing);
            }
            // A part that diverges is muted by itself: the result is not needed.
            let _ = if n_outputs == 0 {
                piece.simulation.skip(frame_count as u64)
            } else {
                piece.simulation.process(outputs)
            };
            if let Some(frozen_stems) = &mut self.connections.frozen {
                // If no clock sets the pace, wait for the disk.
                let wait_start = Instant::now();
                let has_frames = |frozen_stems: &FrozenOutputs| frozen_stems.is_ready(self.frame, frame_count);
                let is_stop_requested = || self.connections.flags.stop.load(Ordering::Acquire);
                while !self.is_paced
                    && !has_frames(frozen_stems)
                    && wait_start.elapsed() < RING_TIMEOUT
                    && !is_stop_requested()
                {
                    self.clock.wait_while_full();
                }
                self.status.missed_frozen_frames += frozen_stems.join(outputs, n_outputs, self.frame);
            }
            piece.mixer.process(outputs, mixed_sound);
            if let Some(fades) = &mut piece.silence_detector
                && fades.process(mixed_sound).is_some()
            {
                piece.n_frames = Some(self.frame + frame_count as u64);
                piece.silence_detector = None;
            }
            self.gain.apply(self.frame, mixed_sound, channels);
            if let Some(window) = &mut self.window {
                window.add_levels(mixed_sound, !self.is_panicking);
            }
            limit(piece, mixed_sound, &mut self.folded_frames);
        } else {
            let frame_count = piece.tick_frames.min(self.tail_frames);
            let mixed_sound = &mut self.mixed_frames[..frame_count * channels];
            mixed_sound.fill(0.0);
            limit(piece, mixed_sound, &mut self.folded_frames);
        }
        for (hand, hand_input) in piece.hands.iter().enumerate() {
            self.piece_forces[hand] = piece.simulation.hand_force(hand) * hand_input.travel_ratio;
        }
        self.tick += 1;
        self.frame += frame_count as u64;
    }

    /// Send frames to the card, without those of the limiter's initial delay.
    pub(super) fn push_output(&mut self, n_frames: usize, is_tail: bool) {
        let channels = self.piece.n_heard_channels();
        let output_sound = match self.piece.fold {
            Some(_) => &self.folded_frames,
            None => &self.mixed_frames,
        };
        let skipped_frames = self.frames_to_skip.min(n_frames);
        let delay_frames = (self.piece.limiter.latency() - self.frames_to_skip) as u64;
        self.frames_to_skip -= skipped_frames;
        if is_tail {
            self.tail_frames -= n_frames;
        }
        for (output_sample, x) in self.output_samples.iter_mut().zip(&output_sound[..n_frames * channels]) {
            *output_sample = *x as f32;
        }
        let peak_decay = (1.0 - self.clock.period() / PEAK_DECAY_SECONDS).max(0.0) as f32;
        self.status.peaks.iter_mut().for_each(|peak| *peak *= peak_decay);
        if self.is_panicking {
            // After a panic nothing is heard.
            self.status.peaks.fill(0.0);
        }
        let peak_frames = if self.is_panicking { 0 } else { n_frames };
        for frame in self.output_samples[..peak_frames * channels].chunks_exact(channels) {
            for (peak, x) in self.status.peaks.iter_mut().zip(frame) {
                *peak = peak.max(x.abs());
            }
        }
        let mut samples_left = &self.output_samples[skipped_frames * channels..n_frames * channels];
        if let Some(sound_tap) = &mut self.tap {
            let tap_frame = self.frame.saturating_sub(n_frames as u64 + delay_frames);
            sound_tap.push(tap_frame, samples_left, self.is_panicking);
        }
        let wait_start = Instant::now();
        loop {
            let pushed_frames = self.connections.ring_writer.push(samples_left);
            samples_left = &samples_left[pushed_frames * channels..];
            let is_stop_requested = self.connections.flags.stop.load(Ordering::Acquire);
            if samples_left.is_empty() || is_stop_requested {
                break;
            }
            // Keys are not kept waiting by a card: the frames are dropped.
            if self.clock.is_paced_by_keys() || wait_start.elapsed() > RING_TIMEOUT {
                self.status.dropped_frames += (samples_left.len() / channels) as u64;
                break;
            }
            self.clock.wait_while_full();
        }
    }
}

/// Fold the mixed channels into `folded_frames` if there is a fold, and limit those that are heard.
fn limit(piece: &mut PreparedPiece, mixed_frames: &mut [f64], folded_frames: &mut [f64]) {
    let Some(channel_fold) = &mut piece.fold else {
        piece.limiter.process(mixed_frames);
        return;
    };
    let folded_frames = &mut folded_frames[..mixed_frames.len() / channel_fold.n_in() * channel_fold.n_out()];
    channel_fold.process(mixed_frames, folded_frames);
    piece.limiter.process(folded_frames);
}
