//! The frames of a tick: computed, mixed, limited, and pushed into the ring.

use std::sync::atomic::Ordering;
use std::time::Instant;

use super::{PATIENCE, Player};
use crate::perform::Stage;
use crate::perform::frozen::Frozen;

/// Time constant of the decay of peaks [s].
const PEAK_DECAY: f64 = 0.3;

impl Player {
    /// Compute the frames of the tick, mixed and limited.
    pub(super) fn step(&mut self, n: usize) {
        let stage = &mut self.stage;
        let channels = stage.mixer.n_channels();
        let n_out = stage.simulation.n_out();
        if n > 0 {
            let outputs = &mut self.outputs[..n * n_out];
            let mixed = &mut self.mixed[..n * channels];
            if let Some(sound_input) = &mut self.connections.sound_input {
                let is_playing = self.connections.shared.played() > 0;
                sound_input.tick(&mut stage.simulation, self.frame, n, is_playing);
            }
            // A part that diverges is muted by itself: the result is not needed.
            let _ = if n_out == 0 {
                stage.simulation.skip(n as u64)
            } else {
                stage.simulation.process(outputs)
            };
            if let Some(frozen) = &mut self.connections.frozen {
                // If no clock sets the pace, wait for the disk.
                let asked = Instant::now();
                let is_there = |frozen: &Frozen| frozen.is_ready(self.frame, n);
                let is_over = || self.connections.flags.stop.load(Ordering::Acquire);
                while !self.paced && !is_there(frozen) && asked.elapsed() < PATIENCE && !is_over() {
                    self.clock.nap();
                }
                self.status.missed += frozen.join(outputs, n_out, self.frame);
            }
            stage.mixer.process(outputs, mixed);
            if let Some(fades) = &mut stage.fades
                && fades.take(mixed).is_some()
            {
                stage.n_frames = Some(self.frame + n as u64);
                stage.fades = None;
            }
            self.gain.apply(self.frame, mixed, channels);
            if let Some(window) = &mut self.window {
                window.add_levels(mixed, !self.panicked);
            }
            limit(stage, mixed, &mut self.folded);
        } else {
            let n = stage.tick_frames.min(self.tail_frames);
            let mixed = &mut self.mixed[..n * channels];
            mixed.fill(0.0);
            limit(stage, mixed, &mut self.folded);
        }
        for (hand, own) in stage.hands.iter().enumerate() {
            self.piece_forces[hand] = stage.simulation.hand_force(hand) * own.reach;
        }
        self.tick += 1;
        self.frame += n as u64;
    }

    /// Send frames to the card, without those of the limiter's initial delay.
    pub(super) fn feed(&mut self, n: usize, is_tail: bool) {
        let channels = self.stage.n_heard();
        let folded = match self.stage.fold {
            Some(_) => &self.folded,
            None => &self.mixed,
        };
        let skip = self.to_skip.min(n);
        let behind = (self.stage.limiter.latency() - self.to_skip) as u64;
        self.to_skip -= skip;
        if is_tail {
            self.tail_frames -= n;
        }
        for (single, x) in self.single.iter_mut().zip(&folded[..n * channels]) {
            *single = *x as f32;
        }
        let falls = (1.0 - self.clock.period() / PEAK_DECAY).max(0.0) as f32;
        self.status.peaks.iter_mut().for_each(|peak| *peak *= falls);
        if self.panicked {
            // After a panic nothing is heard.
            self.status.peaks.fill(0.0);
        }
        let folded = if self.panicked { 0 } else { n };
        for frame in self.single[..folded * channels].chunks_exact(channels) {
            for (peak, x) in self.status.peaks.iter_mut().zip(frame) {
                *peak = peak.max(x.abs());
            }
        }
        let mut rest = &self.single[skip * channels..n * channels];
        if let Some(tap) = &mut self.tap {
            let tap_frame = self.frame.saturating_sub(n as u64 + behind);
            tap.push(tap_frame, rest, self.panicked);
        }
        let asked = Instant::now();
        loop {
            let taken = self.connections.feed.push(rest);
            rest = &rest[taken * channels..];
            let is_over = self.connections.flags.stop.load(Ordering::Acquire);
            if rest.is_empty() || is_over {
                break;
            }
            // Keys are not kept waiting by a card: the frames are dropped.
            if self.clock.is_by_keys() || asked.elapsed() > PATIENCE {
                self.status.dropped += (rest.len() / channels) as u64;
                break;
            }
            self.clock.nap();
        }
    }
}

/// Fold the mixed channels into `folded` if there is a fold, and limit those that are heard.
fn limit(stage: &mut Stage, mixed: &mut [f64], folded: &mut [f64]) {
    let Some(fold) = &mut stage.fold else {
        stage.limiter.process(mixed);
        return;
    };
    let folded = &mut folded[..mixed.len() / fold.n_in() * fold.n_out()];
    fold.process(mixed, folded);
    stage.limiter.process(folded);
}
