//! The limiter, the last stage before the loudspeakers.

use std::collections::VecDeque;

use thiserror::Error;

use crate::maths;

/// Look-ahead of the limiter [s], which is its attack time: shorter than the 10 ms of backward masking in hearing, and
/// long enough for a fade without a click.
const LOOK_AHEAD_SECONDS: f64 = 5e-3;
/// Time constant of the release [s].
const RELEASE_SECONDS: f64 = 50e-3;
/// A gain of 1 in fixed point, in steps of −241 dB: a running sum of integers does not drift, so the gain returns to
/// exactly 1.
const FIXED_ONE: f64 = (1u64 << 40) as f64;
/// Largest look-ahead [frames]: the sum of that many values up to [`FIXED_ONE`] is at most 2⁵³, so doubles hold it
/// exactly.
const LOOK_AHEAD_FRAMES_MAX: f64 = 8191.0;

/// Largest number of channels; the largest loudspeaker rooms have some hundreds.
pub const MAX_CHANNELS: usize = 1024;

/// Why a limiter cannot be built.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum LimiterError {
    /// A rate at which 5 ms of look-ahead are less than one frame, or too many frames.
    #[error("a limiter's rate lies above 0 and up to 1.6 MHz; here {0} Hz")]
    Rate(f64),
    /// More than [`MAX_CHANNELS`].
    #[error("a limiter has at most {MAX_CHANNELS} channels; here {0}")]
    Channels(usize),
    /// A ceiling that is not a finite number above 0.
    #[error("a limiter's ceiling is a number above zero; here {0}")]
    Ceiling(f64),
}

/// Look-ahead limiter of sample peaks, one gain for all channels: 5 ms look-ahead, 50 ms release.
///
/// No output exceeds the ceiling. Samples that need no reduction are unchanged to the bit, [`Limiter::latency`] frames
/// late.
///
/// The reduction that each frame needs, 1 - gain, passes a sliding maximum over the look-ahead, an exponential release
/// and a mean over the look-ahead; so the gain reaches its target in time for each peak, on a straight line.
///
/// ```
/// use ergon_engine::mix::limiter::Limiter;
///
/// let mut limiter = Limiter::new(44_100.0, 1, 0.9)?;
/// let mut frames = vec![0.0; 2000];
/// frames[500] = 3.0;
/// limiter.process(&mut frames);
/// assert!(frames.iter().all(|x| x.abs() <= 0.9));
/// assert!((frames[500 + limiter.latency()] - 0.9).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Limiter {
    n_channels: usize,
    ceiling: f64,
    latency_frames: usize,
    /// Factor by which the reduction falls in one frame.
    release_factor: f64,
    /// The last `latency_frames` frames, oldest at `write_index`.
    delayed_samples: Vec<f64>,
    /// Reductions of the last `latency_frames` + 1 frames in fixed point, before the mean; the next one is written at
    /// `next_reduction_index`.
    fixed_reductions: Vec<u64>,
    fixed_reduction_sum: u64,
    write_index: usize,
    next_reduction_index: usize,
    /// Candidates for the maximum of the window, in falling order: frame and reduction.
    candidates: VecDeque<(u64, f64)>,
    frame: u64,
    reduction: f64,
}

impl Limiter {
    /// A limiter of `n_channels` at `rate` [Hz] whose output stays within ±`ceiling`.
    ///
    /// # Errors
    /// If the rate is too low or too high for the look-ahead, the ceiling is not a finite number above 0, or there are
    /// too many channels.
    pub fn new(rate: f64, n_channels: usize, ceiling: f64) -> Result<Self, LimiterError> {
        let latency = (LOOK_AHEAD_SECONDS * rate).ceil();
        if !(latency > 0.0 && latency <= LOOK_AHEAD_FRAMES_MAX) {
            return Err(LimiterError::Rate(rate));
        }
        if !(ceiling > 0.0 && ceiling.is_finite()) {
            return Err(LimiterError::Ceiling(ceiling));
        }
        if n_channels > MAX_CHANNELS {
            return Err(LimiterError::Channels(n_channels));
        }
        let latency_frames = latency as usize;
        Ok(Self {
            n_channels,
            ceiling,
            latency_frames,
            release_factor: maths::exp(-1.0 / (RELEASE_SECONDS * rate)),
            delayed_samples: vec![0.0; latency_frames * n_channels],
            fixed_reductions: vec![0; latency_frames + 1],
            fixed_reduction_sum: 0,
            write_index: 0,
            next_reduction_index: 0,
            // Allocated here, because `process` must not allocate.
            candidates: VecDeque::with_capacity(latency_frames + 2),
            frame: 0,
            reduction: 0.0,
        })
    }

    /// Delay of the output in frames.
    pub fn latency(&self) -> usize {
        self.latency_frames
    }

    /// Number of channels.
    pub fn n_channels(&self) -> usize {
        self.n_channels
    }

    /// Limit (n_frames, n_channels) in place. NaN counts as silence, infinity as the largest finite number.
    ///
    /// # Panics
    /// If the last frame is not complete.
    pub fn process(&mut self, frames: &mut [f64]) {
        if self.n_channels == 0 {
            return;
        }
        assert_eq!(frames.len() % self.n_channels, 0);
        for frame in frames.chunks_exact_mut(self.n_channels) {
            let mut frame_peak = 0.0f64;
            for x in &mut *frame {
                *x = if x.is_nan() { 0.0 } else { x.clamp(-f64::MAX, f64::MAX) };
                frame_peak = frame_peak.max(x.abs());
            }
            let frame_gain = self.gain_after(frame_peak);
            let delayed = &mut self.delayed_samples[self.write_index * self.n_channels..][..self.n_channels];
            for (x, delayed) in frame.iter_mut().zip(delayed) {
                // The rounding of the gain may leave a sample above the ceiling by the last bit.
                let limited = (*delayed * frame_gain).clamp(-self.ceiling, self.ceiling);
                *delayed = std::mem::replace(x, limited);
            }
            self.write_index = (self.write_index + 1) % self.latency_frames;
        }
    }

    /// The gain of the frame that leaves while a frame with this `peak` enters.
    fn gain_after(&mut self, peak: f64) -> f64 {
        let wanted_reduction = if peak > self.ceiling {
            1.0 - self.ceiling / peak
        } else {
            0.0
        };
        let window_reduction = self.largest_in_window(wanted_reduction);
        let released_reduction = self.reduction * self.release_factor;
        // Below one step of the fixed point, the release ends.
        self.reduction = if released_reduction * FIXED_ONE < 1.0 {
            window_reduction
        } else {
            window_reduction.max(released_reduction)
        };
        let newest_reduction = (self.reduction * FIXED_ONE).ceil() as u64;
        self.fixed_reduction_sum = self.fixed_reduction_sum + newest_reduction
            - std::mem::replace(&mut self.fixed_reductions[self.next_reduction_index], newest_reduction);
        self.next_reduction_index = (self.next_reduction_index + 1) % self.fixed_reductions.len();
        1.0 - self.fixed_reduction_sum as f64 / (self.fixed_reductions.len() as f64 * FIXED_ONE)
    }

    /// The largest reduction among this frame and the `latency_frames` frames before it.
    fn largest_in_window(&mut self, new_reduction: f64) -> f64 {
        while self
            .candidates
            .back()
            .is_some_and(|&(_, smaller)| smaller <= new_reduction)
        {
            self.candidates.pop_back();
        }
        self.candidates.push_back((self.frame, new_reduction));
        if self.candidates[0].0 + (self.latency_frames as u64) < self.frame {
            self.candidates.pop_front();
        }
        self.frame += 1;
        self.candidates[0].1
    }
}

#[cfg(test)]
mod tests;
