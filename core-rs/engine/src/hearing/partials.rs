//! Pitch and decay of the strongest partials in two runs, by demodulation: both are shifted by −f and smoothed. The
//! slopes of the argument of their ratio and of their log levels, weighted by power, give the differences of frequency
//! and decay.

use std::f64::consts::{PI, TAU};

use crate::hearing::constants::{
    DECAY_FIT_MAX, PARTIALS_HOP, PARTIALS_MAX, QUIET_POWER_RATIO, SHORTEST_SECONDS, WINDOWS_MIN,
};
use crate::hearing::third_octaves::{length, powers};
use crate::maths::{atan2, log, log2, sincos};

/// Largest error of a pitch [cents], and of a T60 relative to itself, among partials up to `upto` [Hz]; `b` is the
/// reference.
pub(super) fn pitch_errors(a: &[f64], b: &[f64], rate: f64, upto: f64) -> (f64, f64) {
    let partials = strongest(b, rate, upto).into_iter();
    partials.fold((0.0, 0.0), |(cents, t60), f| {
        let (partial_cents, partial_t60) = compare(a, b, f, rate).unwrap_or((0.0, 0.0));
        (f64::max(cents, partial_cents), f64::max(t60, partial_t60))
    })
}

/// Frequencies of the strongest partials [Hz], each a maximum within the resolution of the window.
fn strongest(x: &[f64], rate: f64, upto: f64) -> Vec<f64> {
    let window = window_from_beginning(x.len(), (0.5 * SHORTEST_SECONDS * rate) as usize);
    let powers = powers(x.iter().zip(window).map(|(x, w)| x * w).collect());
    let bin_width = rate / length(x.len()) as f64;
    let peak_reach = ((2.0 / SHORTEST_SECONDS / bin_width) as usize).max(2);
    let last_bin = ((upto / bin_width) as usize).min(powers.len().saturating_sub(1));
    let is_peak_bin = |index: &usize| {
        let neighbours = &powers[index - peak_reach.min(*index)..(index + peak_reach + 1).min(powers.len())];
        powers[*index] > 0.0 && neighbours.iter().all(|power| *power <= powers[*index])
    };
    let mut peak_bins: Vec<usize> = (peak_reach..last_bin).filter(is_peak_bin).collect();
    peak_bins.sort_by(|a, b| powers[*b].total_cmp(&powers[*a]));
    peak_bins.truncate(PARTIALS_MAX);
    let loudest = peak_bins.first().map_or(0.0, |peak_bin| powers[*peak_bin]);
    peak_bins.retain(|peak_bin| powers[*peak_bin] >= QUIET_POWER_RATIO * loudest);
    peak_bins
        .into_iter()
        .map(|peak_bin| peak_bin as f64 * bin_width)
        .collect()
}

/// Error of the pitch [cents] and of the T60, relative to itself, of the partial near `f` [Hz]; `None` if the sound is
/// too short.
fn compare(a: &[f64], b: &[f64], f: f64, rate: f64) -> Option<(f64, f64)> {
    let (sound_band, reference_band) = (baseband(a, f, rate), baseband(b, f, rate));
    if reference_band.len() < WINDOWS_MIN {
        return None;
    }
    let weights: Vec<f64> = reference_band.iter().map(|[re, im]| re * re + im * im).collect();
    // ours/theirs: its argument turns little from one window to the next.
    let phase_ratios = sound_band.iter().zip(&reference_band);
    let phase_ratios: Vec<[f64; 2]> = phase_ratios.map(|(a, b)| times(*a, [b[0], -b[1]])).collect();
    let frequency_offset = slope(&unwrapped(&phase_ratios), &weights).0 / (TAU * PARTIALS_HOP);
    let log_level = |[re, im]: &[f64; 2]| 0.5 * log((re * re + im * im).max(f64::MIN_POSITIVE));
    let log_levels = |baseband_samples: &[[f64; 2]]| -> Vec<f64> { baseband_samples.iter().map(log_level).collect() };
    let (level_slope, slope_residual) = slope(&log_levels(&reference_band), &weights);
    let (sound_slope, _) = slope(&log_levels(&sound_band), &weights);
    let pitch_error = 1200.0 * log2((1.0 + frequency_offset / f).max(f64::MIN_POSITIVE)).abs();
    let is_decay = slope_residual < DECAY_FIT_MAX && -level_slope * reference_band.len() as f64 > DECAY_FIT_MAX;
    // The ratio of the T60s, less 1.
    let decay_error = if is_decay && sound_slope < 0.0 {
        (level_slope / sound_slope - 1.0).abs()
    } else {
        0.0
    };
    Some((pitch_error, decay_error))
}

/// A sound shifted by −f and smoothed, once every `PARTIALS_HOP`.
fn baseband(x: &[f64], f: f64, rate: f64) -> Vec<[f64; 2]> {
    let window_size = ((SHORTEST_SECONDS * rate) as usize).max(4);
    let hop_frames = ((PARTIALS_HOP * rate) as usize).max(1);
    let shifted: Vec<[f64; 2]> = x
        .iter()
        .enumerate()
        .map(|(n, x)| {
            let (sin, cos) = sincos(-TAU * f * n as f64 / rate);
            [x * cos, x * sin]
        })
        .collect();
    let hann_window = hann(window_size);
    let smoothed_at = |index: usize| {
        let products = shifted[index..index + window_size].iter().zip(&hann_window);
        products.fold([0.0; 2], |sum, (x, w)| [sum[0] + w * x[0], sum[1] + w * x[1]])
    };
    let last_start = x.len().checked_sub(window_size);
    last_start.map_or_else(Vec::new, |last_start| {
        (0..=last_start).step_by(hop_frames).map(smoothed_at).collect()
    })
}

/// A window of `size` that rises within `rise` and then falls to the end: partials that fade fast are strong only at
/// the beginning, where a symmetric window hardly weights them.
fn window_from_beginning(size: usize, rise: usize) -> Vec<f64> {
    let rise = rise.min(size / 2);
    let [rising_half, falling] = [rise, size - rise].map(|half| hann(2 * half));
    [&rising_half[..rise], &falling[size - rise..]].concat()
}

fn hann(size: usize) -> Vec<f64> {
    let window_weight = |n: usize| {
        let half_sine = sincos(PI * (n as f64 + 0.5) / size as f64).0;
        half_sine * half_sine
    };
    (0..size).map(window_weight).collect()
}

fn times(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

/// The arguments, unwrapped.
fn unwrapped(phasors: &[[f64; 2]]) -> Vec<f64> {
    let mut last_phasor = [1.0, 0.0];
    let mut angle_sum = 0.0;
    let unwrap_next = |phasor: &[f64; 2]| {
        let turn_ratio = times(*phasor, [last_phasor[0], -last_phasor[1]]);
        angle_sum += if turn_ratio == [0.0; 2] {
            0.0
        } else {
            atan2(turn_ratio[1], turn_ratio[0])
        };
        last_phasor = *phasor;
        angle_sum
    };
    phasors.iter().map(unwrap_next).collect()
}

/// The straight line that fits best by weighted least squares: its slope from one value to the next, and its residual
/// (rms).
fn slope(values: &[f64], weights: &[f64]) -> (f64, f64) {
    let weight_sum: f64 = weights.iter().sum();
    if weight_sum <= 0.0 {
        return (0.0, 0.0);
    }
    let weighted_mean = |value_of: &dyn Fn(usize) -> f64| -> f64 {
        let indexed_weights = weights.iter().enumerate();
        indexed_weights.map(|(i, weight)| weight * value_of(i)).sum::<f64>() / weight_sum
    };
    let (index_mean, value_mean) = (weighted_mean(&|i| i as f64), weighted_mean(&|i| values[i]));
    let index_variance = weighted_mean(&|i| (i as f64 - index_mean) * (i as f64 - index_mean));
    if index_variance <= 0.0 {
        return (0.0, 0.0);
    }
    let line_slope = weighted_mean(&|i| (i as f64 - index_mean) * (values[i] - value_mean)) / index_variance;
    let mean_square = weighted_mean(&|i| {
        let residual = values[i] - value_mean - line_slope * (i as f64 - index_mean);
        residual * residual
    });
    (line_slope, mean_square.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::exp;

    const RATE: f64 = 44_100.0;

    /// Two partials, each with its frequency [Hz] and decay [1/s].
    fn sound(low: (f64, f64), high: (f64, f64)) -> Vec<f64> {
        let partial = |t: f64, (f, decay): (f64, f64)| exp(-decay * t) * sincos(TAU * f * t).0;
        (0..13_230)
            .map(|n| n as f64 / RATE)
            .map(|t| partial(t, low) + 0.1 * partial(t, high))
            .collect()
    }

    #[test]
    fn pitch_errors_of_weaker_partials() {
        let reference = sound((220.0, 8.0), (1_310.0, 20.0));
        let (pitch_error, decay_error) = pitch_errors(&reference, &reference, RATE, 5_000.0);
        assert_eq!((pitch_error, decay_error), (0.0, 0.0));
        // 5 cents, and a T60 that is a tenth longer.
        let detuned = sound((220.0, 8.0), (1_310.0 * 1.002_892, 20.0 / 1.1));
        let (pitch_error, decay_error) = pitch_errors(&detuned, &reference, RATE, 5_000.0);
        assert!((pitch_error - 5.0).abs() < 0.2, "{pitch_error}");
        assert!((decay_error - 0.1).abs() < 0.01, "{decay_error}");
        // Partials above `upto` are not compared.
        assert!(pitch_errors(&detuned, &reference, RATE, 1_000.0).0 < 0.3);
    }

    #[test]
    fn pitch_errors_of_a_fast_fading_partial() {
        // 20 dB below the other at the beginning, and 60 dB lower after 115 ms of 300.
        let reference = sound((110.0, 20.0), (450.0, 60.0));
        let detuned = sound((110.0, 20.0), (450.0 * 1.002_892, 60.0));
        let (pitch_error, _) = pitch_errors(&detuned, &reference, RATE, 5_000.0);
        assert!((pitch_error - 5.0).abs() < 0.2, "{pitch_error}");
    }

    #[test]
    fn pitch_errors_of_short_and_silent_sounds_are_zero() {
        assert_eq!(pitch_errors(&[], &[], RATE, 5_000.0), (0.0, 0.0));
        assert_eq!(pitch_errors(&[0.0; 500], &[0.0; 500], RATE, 5_000.0), (0.0, 0.0));
        let reference = sound((220.0, 8.0), (1_310.0, 20.0));
        let silence = vec![0.0; reference.len()];
        let (pitch_error, decay_error) = pitch_errors(&silence, &reference, RATE, 5_000.0);
        assert!(pitch_error.is_finite() && decay_error.is_finite());
    }
}
