//! A gain that changes smoothly while it sounds.

use crate::timeline::GRID_FRAMES;

/// Duration of a glide from one gain to another [s], rounded up to the grid, as for couplings.
const GLIDE_SECONDS: f64 = 0.02;

/// A gain that glides. Every glide is set at a multiple of [`GRID_FRAMES`], whatever the size of blocks, and begins
/// there or some frames later.
///
/// ```
/// use ergon_engine::mix::glide::GainGlide;
///
/// let mut glide = GainGlide::new(48_000.0, 1.0);
/// glide.set(0.5);
/// let mut frames = vec![1.0; 2000];
/// glide.apply(0, &mut frames, 1);
/// assert_eq!((frames[0], frames[1999]), (1.0, 0.5));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct GainGlide {
    start_gain: f64,
    end_gain: f64,
    start_frame: u64,
    glide_frames: u64,
    /// The gain that was requested: the glide to it is set at the next multiple of the grid, and starts `start_delay`
    /// frames later.
    requested_gain: Option<f64>,
    start_delay: u64,
}

impl GainGlide {
    /// A constant gain, for frames at `rate` [Hz].
    #[must_use]
    pub fn new(rate: f64, gain: f64) -> Self {
        let glide_frames = ((GLIDE_SECONDS * rate) as u64).div_ceil(GRID_FRAMES).max(1) * GRID_FRAMES;
        Self {
            start_gain: gain,
            end_gain: gain,
            start_frame: 0,
            glide_frames,
            requested_gain: None,
            start_delay: 0,
        }
    }

    /// A glide from one gain to another, from the next multiple of the grid on.
    #[must_use]
    pub(super) fn between(rate: f64, start_value: f64, target_value: f64) -> Self {
        let mut glide = Self::new(rate, start_value);
        glide.set(target_value);
        glide
    }

    /// Glide to `gain` from the next multiple of the grid on; a gain that is not finite is ignored.
    pub fn set(&mut self, gain: f64) {
        self.set_after(gain, 0);
    }

    /// [`GainGlide::set`], but the glide begins `start_delay` frames later.
    pub fn set_after(&mut self, gain: f64, start_delay: u64) {
        if gain.is_finite() {
            (self.requested_gain, self.start_delay) = (Some(gain), start_delay);
        }
    }

    /// The gain at frame `n`.
    #[must_use]
    pub fn gain_at(&self, n: u64) -> f64 {
        let frames_since_start = n.saturating_sub(self.start_frame);
        if frames_since_start >= self.glide_frames {
            return self.end_gain;
        }
        let u = frames_since_start as f64 / self.glide_frames as f64;
        self.start_gain + (self.end_gain - self.start_gain) * u * u * (3.0 - 2.0 * u)
    }

    /// The gain, if it is constant from frame `n` on.
    #[must_use]
    pub fn constant_gain(&self, n: u64) -> Option<f64> {
        let is_resting = self.requested_gain.is_none() && n.saturating_sub(self.start_frame) >= self.glide_frames;
        (is_resting || self.requested_gain.is_none() && self.start_gain == self.end_gain).then_some(self.end_gain)
    }

    /// At frame `n`: begin the glide that was requested, if `n` is a multiple of the grid.
    pub fn begin_requested(&mut self, n: u64) {
        if n.is_multiple_of(GRID_FRAMES)
            && let Some(requested_gain) = self.requested_gain.take()
        {
            (self.start_gain, self.end_gain, self.start_frame) =
                (self.gain_at(n), requested_gain, n + self.start_delay);
        }
    }

    /// Multiply frames (n_frames, n_channels), the first of which is frame `n`.
    pub fn apply(&mut self, n: u64, frames: &mut [f64], n_channels: usize) {
        let mut n = n;
        let mut samples_left = frames;
        while !samples_left.is_empty() {
            self.begin_requested(n);
            let frame_count = frames_to_next_grid_frame(n, self.constant_gain(n).is_some());
            let sample_count = samples_left.len();
            let span_length = frame_count.saturating_mul(n_channels as u64).min(sample_count as u64) as usize;
            let (span_samples, samples_after) = samples_left.split_at_mut(span_length);
            match self.constant_gain(n) {
                Some(gain) => span_samples.iter_mut().for_each(|x| *x *= gain),
                None => span_samples
                    .chunks_mut(n_channels.max(1))
                    .zip(n..)
                    .for_each(|(frame, n)| frame.iter_mut().for_each(|x| *x *= self.gain_at(n))),
            }
            (n, samples_left) = (n.saturating_add(frame_count), samples_after);
        }
    }
}

/// Begin or end the glide of a fading gain at frame `n`; returns whether any of it remains.
pub(super) fn update_fading_gain(fading_gain: &mut Option<GainGlide>, n: u64) -> bool {
    let Some(glide) = fading_gain else { return false };
    glide.begin_requested(n);
    if glide.constant_gain(n).is_some() {
        *fading_gain = None;
    }
    fading_gain.is_some()
}

/// A gain that glides to 0; `None` if it is 0 already.
pub(super) fn glide_to_zero(rate: f64, start_value: f64) -> Option<GainGlide> {
    (start_value != 0.0).then(|| GainGlide::between(rate, start_value, 0.0))
}

/// Number of frames from `n` on in which no glide is set: unlimited if `is_steady`, otherwise up to the next multiple
/// of the grid.
pub(super) fn frames_to_next_grid_frame(n: u64, is_steady: bool) -> u64 {
    if is_steady {
        u64::MAX
    } else {
        GRID_FRAMES - n % GRID_FRAMES
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The gain at each of `n` frames, computed in blocks; set to 0.25 at frame 100 and to 2 at frame 400.
    fn gains(n: usize, block: usize) -> Vec<f64> {
        let mut glide = GainGlide::new(44_100.0, 1.0);
        let mut frames = vec![1.0; n];
        let mut frame_index = 0;
        while frame_index < n {
            if frame_index == 100 {
                glide.set(0.25);
            } else if frame_index == 400 {
                glide.set(2.0);
            }
            let next_change = [100, 400, n].into_iter().find(|&block_end| frame_index < block_end);
            let block_end = (frame_index + block).min(next_change.unwrap_or(n));
            glide.apply(frame_index as u64, &mut frames[frame_index..block_end], 1);
            frame_index = block_end;
        }
        frames
    }

    #[test]
    fn glide_begins_on_the_grid_without_a_jump() {
        let gains = gains(3000, 64);
        assert!(gains[..=128].iter().all(|&x| x == 1.0) && gains[129] < 1.0);
        // The second glide begins at frame 448, where the first one has covered 5/14 of its duration from 1 to 1/4.
        let u = 320.0 / 896.0_f64;
        let expected_gain = 1.0 - 0.75 * (3.0 * u * u - 2.0 * u * u * u);
        assert!((gains[448] - expected_gain).abs() < 1e-12, "{}", gains[448]);
        assert!(gains[448 + 896..].iter().all(|&x| x == 2.0));
        // The steepest step of a glide is 1.5/896 of its range a frame.
        let gain_steps = gains.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(gain_steps.fold(0.0, f64::max) < 1.5 * 1.75 / 896.0);
    }

    #[test]
    fn glide_in_blocks_of_any_size() {
        let in_one_block = gains(2000, 4096);
        for block in [1, 7, 44, 64, 333] {
            assert_eq!(gains(2000, block), in_one_block);
        }
    }

    #[test]
    fn resting_glide_multiplies_by_its_gain() {
        let mut frames = [0.1, -0.3, 0.7, 1e-9];
        GainGlide::new(48_000.0, 0.5).apply(17, &mut frames, 2);
        assert_eq!(frames, [0.05, -0.15, 0.35, 5e-10]);
        let mut glide = GainGlide::new(48_000.0, 0.5);
        glide.set(f64::NAN);
        assert_eq!(glide.constant_gain(0), Some(0.5));
    }
}
