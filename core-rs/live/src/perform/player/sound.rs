//! The frames of a tick: computed, mixed, limited, and pushed into the ring.

use std::sync::atomic::Ordering;
use std::time::Instant;

use super::{Player, RING_TIMEOUT};
use crate::perform::Stage;
use crate::perform::frozen::Frozen;

/// Time constant of the decay of peaks [s].
const PEAK_DECAY: f64 = 0.3;

impl Player {
    /// Compute the frames of the tick, mixed and limited.
    pub(super) fn step(&mut self, frame_count: usize) {
        let stage = &mut self.stage;
        let channels = stage.mixer.n_channels();
        let n_outputs = stage.simulation.n_out();
        if frame_count > 0 {
            let outputs = &mut self.outputs[..frame_count * n_outputs];
            let mixed_sound = &mut self.mixed[..frame_count * channels];
            if let Some(sound_input) = &mut self.connections.sound_input {
                let is_playing = self.connections.shared.played() > 0;
                sound_input.tick(&mut stage.simulation, self.frame, frame_count, is_playing);
            }
            // A part that diverges is muted by itself: the result is not needed.
            let _ = if n_outputs == 0 {
                stage.simulation.skip(frame_count as u64)
            } else {
                stage.simulation.process(outputs)
            };
            if let Some(frozen_stems) = &mut self.connections.frozen {
                // If no clock sets the pace, wait for the disk.
                let wait_start = Instant::now();
                let is_there = |frozen_stems: &Frozen| frozen_stems.is_ready(self.frame, frame_count);
                let stop_requested = || self.connections.flags.stop.load(Ordering::Acquire);
                while !self.has_pace
                    && !is_there(frozen_stems)
                    && wait_start.elapsed() < RING_TIMEOUT
                    && !stop_requested()
                {
                    self.clock.wait_while_full();
                }
                self.status.missed += frozen_stems.join(outputs, n_outputs, self.frame);
            }
            stage.mixer.process(outputs, mixed_sound);
            if let Some(fades) = &mut stage.fades
                && fades.process(mixed_sound).is_some()
            {
                stage.n_frames = Some(self.frame + frame_count as u64);
                stage.fades = None;
            }
            self.gain.apply(self.frame, mixed_sound, channels);
            if let Some(window) = &mut self.window {
                window.add_levels(mixed_sound, !self.panicked);
            }
            limit(stage, mixed_sound, &mut self.folded);
        } else {
            let frame_count = stage.tick_frames.min(self.tail_frames);
            let mixed_sound = &mut self.mixed[..frame_count * channels];
            mixed_sound.fill(0.0);
            limit(stage, mixed_sound, &mut self.folded);
        }
        for (hand, hand_input) in stage.hands.iter().enumerate() {
            self.piece_forces[hand] = stage.simulation.hand_force(hand) * hand_input.travel_ratio;
        }
        self.tick += 1;
        self.frame += frame_count as u64;
    }

    /// Send frames to the card, without those of the limiter's initial delay.
    pub(super) fn feed(&mut self, n: usize, is_tail: bool) {
        let channels = self.stage.n_heard();
        let folded = match self.stage.fold {
            Some(_) => &self.folded,
            None => &self.mixed,
        };
        let skipped_frames = self.frames_to_skip.min(n);
        let delay_frames = (self.stage.limiter.latency() - self.frames_to_skip) as u64;
        self.frames_to_skip -= skipped_frames;
        if is_tail {
            self.tail_frames -= n;
        }
        for (single, x) in self.output_f32.iter_mut().zip(&folded[..n * channels]) {
            *single = *x as f32;
        }
        let peak_decay = (1.0 - self.clock.period() / PEAK_DECAY).max(0.0) as f32;
        self.status.peaks.iter_mut().for_each(|peak| *peak *= peak_decay);
        if self.panicked {
            // After a panic nothing is heard.
            self.status.peaks.fill(0.0);
        }
        let folded = if self.panicked { 0 } else { n };
        for frame in self.output_f32[..folded * channels].chunks_exact(channels) {
            for (peak, x) in self.status.peaks.iter_mut().zip(frame) {
                *peak = peak.max(x.abs());
            }
        }
        let mut samples_left = &self.output_f32[skipped_frames * channels..n * channels];
        if let Some(sound_tap) = &mut self.tap {
            let tap_frame = self.frame.saturating_sub(n as u64 + delay_frames);
            sound_tap.push(tap_frame, samples_left, self.panicked);
        }
        let wait_start = Instant::now();
        loop {
            let taken_frames = self.connections.feed.push(samples_left);
            samples_left = &samples_left[taken_frames * channels..];
            let stop_requested = self.connections.flags.stop.load(Ordering::Acquire);
            if samples_left.is_empty() || stop_requested {
                break;
            }
            // Keys are not kept waiting by a card: the frames are dropped.
            if self.clock.is_paced_by_keys() || wait_start.elapsed() > RING_TIMEOUT {
                self.status.dropped += (samples_left.len() / channels) as u64;
                break;
            }
            self.clock.wait_while_full();
        }
    }
}

/// Fold the mixed channels into `folded` if there is a fold, and limit those that are heard.
fn limit(stage: &mut Stage, mixed: &mut [f64], folded: &mut [f64]) {
    let Some(channel_fold) = &mut stage.fold else {
        stage.limiter.process(mixed);
        return;
    };
    let folded = &mut folded[..mixed.len() / channel_fold.n_in() * channel_fold.n_out()];
    channel_fold.process(mixed, folded);
    stage.limiter.process(folded);
}
