//! Takes: captured movements.

use std::sync::Arc;

use thiserror::Error;

use super::placed::PlacedPath;
use super::profile::{PathError, Profile};
use super::spline::Ends;
use crate::section::FilterSection;

/// Largest number of samples of a take: five and a half hours at 1 kHz, 1.3 GB while it is being read.
pub const MAX_SAMPLES: usize = 20_000_000;

/// A captured movement: the natural quintic spline through its samples.
///
/// ```
/// use ergon_engine::gesture::take::{Preparation, Take};
///
/// let t: Vec<f64> = (0..100).map(|i| f64::from(i) / 100.0).collect();
/// let x: Vec<f64> = t.iter().map(|t| 1e-3 * t).collect();
/// let preparation = Preparation { trim: Some((0.2, 0.7)), smooth: None };
/// assert!((Take::new(&t, &x, preparation)?.duration() - 0.5).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Take {
    profile: Arc<Profile>,
}

/// Why samples do not define a take.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TakeError {
    /// Different numbers of instants and positions.
    #[error("a take has one position for each instant; here are {n_t} instants and {n_x} positions")]
    Lengths {
        /// Instants given.
        n_t: usize,
        /// Positions given.
        n_x: usize,
    },
    /// Fewer than two samples.
    #[error("a take needs at least two samples; this one has {0}")]
    TooFew(usize),
    /// More than [`MAX_SAMPLES`].
    #[error(
        "a take has at most {MAX_SAMPLES} samples; this one has {0}: \
         split it, or capture at a lower rate"
    )]
    TooMany(usize),
    /// NaN or infinity.
    #[error("sample {index} of the take is not a finite number: x = {x} m at t = {t} s")]
    NotFinite {
        /// Which sample, from 0.
        index: usize,
        /// Its instant [s].
        t: f64,
        /// Its position [m].
        x: f64,
    },
    /// An instant is not later than the one before.
    #[error("time must rise along a take: sample {index} is at {t} s, the one before it at {previous_t} s")]
    NotRising {
        /// Which sample, from 0.
        index: usize,
        /// Its instant [s].
        t: f64,
        /// The instant before it [s].
        previous_t: f64,
    },
    /// `trim` reaches beyond the samples, or keeps nothing.
    #[error("trim {from} s to {to} s does not lie inside the take, which runs from {start} s to {stop} s")]
    Trim {
        /// Wanted start [s].
        from: f64,
        /// Wanted end [s].
        to: f64,
        /// First instant [s].
        start: f64,
        /// Last instant [s].
        stop: f64,
    },
    /// A part that reaches beyond the take, or holds nothing.
    #[error("{from} s to {to} s does not lie inside a take that lasts {stop} s")]
    Part {
        /// Wanted start [s].
        from: f64,
        /// Wanted end [s].
        to: f64,
        /// Duration of the take [s].
        stop: f64,
    },
    /// A cutoff of `smooth` that is too high for the samples, or not above 0.
    #[error(
        "smooth {cutoff} Hz must lie above 0 and below half of the {rate} samples a second \
         of this take"
    )]
    Smooth {
        /// Wanted cutoff [Hz].
        cutoff: f64,
        /// Mean rate of the samples [Hz].
        rate: f64,
    },
}

/// How the samples of a take are prepared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Preparation {
    /// First and last instant to keep [s], in the time of the samples; the first becomes 0.
    pub trim: Option<(f64, f64)>,
    /// Cutoff [Hz] of a low-pass, applied forward and backward.
    pub smooth: Option<f64>,
}

impl Take {
    /// The take of samples (`t` [s], `x` [m]), both (n,).
    ///
    /// `smooth` filters the complete take first. `trim` then cuts the path, so its ends lie exactly on the path of the
    /// complete take.
    ///
    /// # Errors
    /// If there are too few samples, or they are not finite or not in order, the cutoff is not below half their rate,
    /// or the trim lies outside the take.
    pub fn new(t: &[f64], x: &[f64], preparation: Preparation) -> Result<Self, TakeError> {
        check_samples(t, x)?;
        let natural_spline = |t: &[f64], x: &[f64]| Profile::spline(t.to_vec(), x.to_vec(), Ends::Natural);
        let profile = match preparation.smooth {
            None => natural_spline(t, x),
            Some(cutoff) => {
                let (t, mut x) = resample_evenly(t, x, natural_spline);
                low_pass(&mut x, cutoff, mean_rate(&t))?;
                natural_spline(&t, &x)
            }
        };
        let Some((from, to)) = preparation.trim else {
            return Ok(Self {
                profile: Arc::new(profile),
            });
        };
        let (start, stop) = (profile.start_time(), profile.end_time());
        if !(start <= from && from < to && to <= stop) {
            return Err(TakeError::Trim { from, to, start, stop });
        }
        Ok(Self {
            profile: Arc::new(profile.trimmed(from, to).shifted_earlier(from)),
        })
    }

    /// The part of the take between two instants [s], counted from its first sample; the path between them is
    /// unchanged.
    ///
    /// # Errors
    /// [`TakeError::Part`] unless 0 ≤ `part_start` < `part_end` ≤ [`Take::duration`].
    pub fn part(&self, part_start: f64, part_end: f64) -> Result<Self, TakeError> {
        let stop = self.duration();
        if !(0.0 <= part_start && part_start < part_end && part_end <= stop) {
            return Err(TakeError::Part {
                from: part_start,
                to: part_end,
                stop,
            });
        }
        let take_start = self.profile.start_time();
        let trimmed_path = self.profile.trimmed(take_start + part_start, take_start + part_end);
        Ok(Self {
            profile: Arc::new(trimmed_path.shifted_earlier(take_start + part_start)),
        })
    }

    /// The path, to be shared.
    pub fn profile(&self) -> &Arc<Profile> {
        &self.profile
    }

    /// The take with its first instant at `start` [s] of the piece, positions times `scale`, durations times `stretch`.
    ///
    /// # Errors
    /// [`PathError::Placement`] if a number is not finite or `stretch` is not above 0.
    pub fn placed(&self, start: f64, scale: f64, stretch: f64, is_reversed: bool) -> Result<PlacedPath, PathError> {
        // The clock of a capture may begin at any value, so its origin is not part of the movement.
        let clock_origin = start - self.profile.start_time() * stretch;
        PlacedPath::transformed(Arc::clone(&self.profile), clock_origin, scale, stretch, is_reversed)
    }

    /// Time from its first instant to its last [s].
    pub fn duration(&self) -> f64 {
        self.profile.end_time() - self.profile.start_time()
    }
}

fn check_samples(t: &[f64], x: &[f64]) -> Result<(), TakeError> {
    let n_samples = t.len();
    if n_samples != x.len() {
        return Err(TakeError::Lengths {
            n_t: n_samples,
            n_x: x.len(),
        });
    }
    match n_samples {
        0 | 1 => return Err(TakeError::TooFew(n_samples)),
        2..=MAX_SAMPLES => {}
        _ => return Err(TakeError::TooMany(n_samples)),
    }
    if let Some(index) =
        (0..n_samples).find(|&sample_index| !(t[sample_index].is_finite() && x[sample_index].is_finite()))
    {
        return Err(TakeError::NotFinite {
            index,
            t: t[index],
            x: x[index],
        });
    }
    if let Some(sample_index) = (1..n_samples).find(|&sample_index| t[sample_index] <= t[sample_index - 1]) {
        return Err(TakeError::NotRising {
            index: sample_index,
            t: t[sample_index],
            previous_t: t[sample_index - 1],
        });
    }
    Ok(())
}

/// Mean rate of the samples [Hz].
fn mean_rate(t: &[f64]) -> f64 {
    (t.len() - 1) as f64 / (t[t.len() - 1] - t[0])
}

/// The samples at even steps, as a digital filter needs them. If instants jitter (0.0333, 0.0667, 0.1), the spline is
/// sampled instead.
fn resample_evenly(t: &[f64], x: &[f64], natural: impl Fn(&[f64], &[f64]) -> Profile) -> (Vec<f64>, Vec<f64>) {
    let last_index = t.len() - 1;
    let (first_instant, last_instant) = (t[0], t[last_index]);
    let even_instants: Vec<f64> = (0..=last_index)
        .map(|i| first_instant + (last_instant - first_instant) * (i as f64 / last_index as f64))
        .collect();
    // 1e-9 of a step allows for the rounding of i·T, which is not jitter.
    let tolerance = 1e-9 * (last_instant - first_instant) / last_index as f64;
    if t.iter().zip(&even_instants).all(|(t, e)| (t - e).abs() <= tolerance) {
        return (even_instants, x.to_vec());
    }
    let natural_path = natural(t, x);
    let mut path_cursor = 0;
    let x = even_instants
        .iter()
        .map(|&t| natural_path.evaluate_from(&mut path_cursor, t).0)
        .collect();
    (even_instants, x)
}

/// 1/Q of the two sections of a Butterworth low-pass of order 4: 2·sin(π/8), 2·sin(3π/8).
const SECTION_DAMPINGS: [f64; 2] = [0.765_366_864_730_179_6, 1.847_759_065_022_573_5];

/// Number of samples added before and after by reflection through the end points: 3 × (order + 1), as in `filtfilt` of
/// MATLAB and scipy, so that either can check a take.
const PADDING_SAMPLES: usize = 15;

/// Butterworth low-pass of order 4, forward and backward: no delay, -6 dB at `cutoff` [Hz].
fn low_pass(x: &mut [f64], cutoff: f64, rate: f64) -> Result<(), TakeError> {
    if !(cutoff > 0.0 && cutoff < 0.5 * rate) {
        return Err(TakeError::Smooth { cutoff, rate });
    }
    let last_index = x.len() - 1;
    let padding = PADDING_SAMPLES.min(last_index);
    let padding_before = (1..=padding).rev().map(|i| 2.0 * x[0] - x[i]);
    let padding_after = (1..=padding).map(|i| 2.0 * x[last_index] - x[last_index - i]);
    let mut padded_samples: Vec<f64> = padding_before.chain(x.iter().copied()).chain(padding_after).collect();
    for _ in 0..2 {
        for damping in SECTION_DAMPINGS {
            let mut section = FilterSection::new(cutoff, rate, damping);
            section.settle(padded_samples[0]);
            padded_samples.iter_mut().for_each(|x| *x = section.next(*x).low);
        }
        padded_samples.reverse();
    }
    x.copy_from_slice(&padded_samples[padding..=padding + last_index]);
    Ok(())
}

#[cfg(test)]
mod tests;
