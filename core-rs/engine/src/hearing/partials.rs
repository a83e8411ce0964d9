//! Pitch and decay of the strongest partials in two runs, by demodulation: both are shifted by −f and smoothed. How
//! fast the argument of their ratio turns, and the slopes of their log levels, weighted by power, give the differences
//! of frequency and decay.

use std::f64::consts::{PI, TAU};

use crate::hearing::Scatter;
use crate::hearing::constants::{
    COMMON_ANGLE_SHARE, DECAY_FALL_MIN, DECAY_FIT_MAX, PARTIALS_HOP, PARTIALS_MAX, QUIET_POWER_RATIO, RAYLEIGH_MIN,
    SHORTEST_SECONDS, WINDOWS_APART, WINDOWS_MIN,
};
use crate::hearing::third_octaves::{fft_length, power_spectrum};
use crate::maths::{atan2, log, log2, sincos};

/// Largest error of a pitch [cents], and of a T60 relative to itself, among partials up to `frequency_max` [Hz]; by
/// comparison with `reference`. `scatter` says whether what chance may explain is deducted.
pub(super) fn pitch_errors(
    sound: &[f64],
    reference: &[f64],
    rate: f64,
    frequency_max: f64,
    scatter: Scatter,
) -> (f64, f64) {
    let partials = strongest_partials(reference, rate, frequency_max).into_iter();
    partials.fold((0.0, 0.0), |(cents, t60), f| {
        let (partial_cents, partial_t60) = partial_errors(sound, reference, f, rate, scatter).unwrap_or((0.0, 0.0));
        (f64::max(cents, partial_cents), f64::max(t60, partial_t60))
    })
}

/// Frequencies of the strongest partials [Hz], each a maximum within the resolution of the window.
fn strongest_partials(samples: &[f64], rate: f64, frequency_max: f64) -> Vec<f64> {
    let window = window_from_beginning(samples.len(), (0.5 * SHORTEST_SECONDS * rate) as usize);
    let powers = power_spectrum(
        samples
            .iter()
            .zip(window)
            .map(|(sample, weight)| sample * weight)
            .collect(),
    );
    let bin_width = rate / fft_length(samples.len()) as f64;
    let peak_reach = ((2.0 / SHORTEST_SECONDS / bin_width) as usize).max(2);
    let last_bin = ((frequency_max / bin_width) as usize).min(powers.len().saturating_sub(1));
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
fn partial_errors(sound: &[f64], reference: &[f64], f: f64, rate: f64, scatter: Scatter) -> Option<(f64, f64)> {
    let (sound_band, reference_band) = (baseband(sound, f, rate), baseband(reference, f, rate));
    if reference_band.len() < WINDOWS_MIN {
        return None;
    }
    let weights: Vec<f64> = reference_band.iter().map(|[re, im]| re * re + im * im).collect();
    let frequency_offset = significant_drift(&sound_band, &reference_band, scatter) / (TAU * PARTIALS_HOP);
    let log_level = |[re, im]: &[f64; 2]| 0.5 * log((re * re + im * im).max(f64::MIN_POSITIVE));
    let log_levels = |baseband_samples: &[[f64; 2]]| -> Vec<f64> { baseband_samples.iter().map(log_level).collect() };
    let (reference_levels, sound_levels) = (log_levels(&reference_band), log_levels(&sound_band));
    let reference_line = Line::fitted(&reference_levels, &weights);
    let level_ratios: Vec<f64> = sound_levels
        .iter()
        .zip(&reference_levels)
        .map(|(level, reference_level)| level - reference_level)
        .collect();
    let sound_slope = reference_line.slope + Line::fitted(&level_ratios, &weights).significant_slope(scatter);
    let pitch_error = 1200.0 * log2((1.0 + frequency_offset / f).max(f64::MIN_POSITIVE)).abs();
    let level_fall = -reference_line.slope * reference_band.len() as f64;
    let is_decay = reference_line.residual < DECAY_FIT_MAX && level_fall > DECAY_FALL_MIN;
    // The ratio of the T60s, less 1.
    let decay_error = if is_decay && sound_slope < 0.0 {
        (reference_line.slope / sound_slope - 1.0).abs()
    } else {
        0.0
    };
    Some((pitch_error, decay_error))
}

/// A sound shifted by −f and smoothed, once every `PARTIALS_HOP`.
fn baseband(x: &[f64], f: f64, rate: f64) -> Vec<[f64; 2]> {
    let window_size = ((SHORTEST_SECONDS * rate) as usize).max(4);
    let hop_frames = ((PARTIALS_HOP * rate) as usize).max(1);
    let shifted_samples: Vec<[f64; 2]> = x
        .iter()
        .enumerate()
        .map(|(n, x)| {
            let (sin, cos) = sincos(-TAU * f * n as f64 / rate);
            [x * cos, x * sin]
        })
        .collect();
    let hann_window = hann_values(window_size);
    let smoothed_at = |index: usize| {
        let products = shifted_samples[index..index + window_size].iter().zip(&hann_window);
        products.fold([0.0; 2], |sum, (x, w)| [sum[0] + w * x[0], sum[1] + w * x[1]])
    };
    let last_start = x.len().checked_sub(window_size);
    last_start.map_or_else(Vec::new, |last_start| {
        (0..=last_start).step_by(hop_frames).map(smoothed_at).collect()
    })
}

/// A window of `size` that rises within `rise_length` and then falls to the end: partials that fade fast are strong
/// only at the beginning, where a symmetric window hardly weights them.
fn window_from_beginning(size: usize, rise_length: usize) -> Vec<f64> {
    let rise_length = rise_length.min(size / 2);
    let [rising_half, falling_half] = [rise_length, size - rise_length].map(|half| hann_values(2 * half));
    [&rising_half[..rise_length], &falling_half[size - rise_length..]].concat()
}

fn hann_values(size: usize) -> Vec<f64> {
    let window_weight = |n: usize| {
        let half_sine = sincos(PI * (n as f64 + 0.5) / size as f64).0;
        half_sine * half_sine
    };
    (0..size).map(window_weight).collect()
}

fn complex_product(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

/// How fast the phase of `sound` leaves that of `reference` [rad from one window to the next], as far as it is
/// significant: the angle of the mean turn of their ratio, first from window to window, then over half a window, which
/// scatters less. Where a partial passes through zero its phase is chance and may slip by a cycle; its turn hardly
/// counts there.
///
/// The pulse-pair estimate and its deviation: Miller & Rochwarger, IEEE Trans. Inf. Theory 18 (1972); Zrnić, IEEE
/// Trans. Aerosp. Electron. Syst. 13 (1977). The turns of noise have no common angle, by Rayleigh's test (Mardia &
/// Jupp, Directional Statistics, 2000, 6.3.1), and no drift is significant.
fn significant_drift(sound: &[[f64; 2]], reference: &[[f64; 2]], scatter: Scatter) -> f64 {
    let ratio = |(a, b): (&[f64; 2], &[f64; 2])| -> [f64; 2] {
        let [re, im] = phase_step(*b, *a);
        match modulus(*a) {
            0.0 => [0.0; 2],
            size => [re / size, im / size],
        }
    };
    let ratios: Vec<[f64; 2]> = sound.iter().zip(reference).map(ratio).collect();
    let phase_steps = |lag: usize| -> Vec<[f64; 2]> {
        let pairs = ratios.iter().zip(ratios.iter().skip(lag));
        pairs.map(|(before, after)| phase_step(*before, *after)).collect()
    };
    let sum = |phase_steps: &[[f64; 2]]| {
        phase_steps.iter().fold([0.0; 2], |sum, phase_step| {
            [sum[0] + phase_step[0], sum[1] + phase_step[1]]
        })
    };
    let coarse_drift = angle(sum(&phase_steps(1)));
    let lag = WINDOWS_APART;
    let (sin, cos) = sincos(-coarse_drift * lag as f64);
    let lag_steps = phase_steps(lag);
    let drift = coarse_drift + angle(complex_product(sum(&lag_steps), [cos, sin])) / lag as f64;
    let moduli: Vec<f64> = lag_steps.iter().map(|phase_step| modulus(*phase_step)).collect();
    // Not a number where one of the two is silent.
    let coherence = modulus(sum(&lag_steps)) / moduli.iter().sum::<f64>();
    let (independent_count, squared_coherence) = (effective_count(&moduli), coherence * coherence);
    let deviation =
        ((1.0 - squared_coherence).max(0.0) / (2.0 * squared_coherence * independent_count)).sqrt() / lag as f64;
    match squared_coherence > (RAYLEIGH_MIN / independent_count).min(COMMON_ANGLE_SHARE) {
        true => significant_part(drift, scatter.deviations() * deviation),
        false => 0.0,
    }
}

/// The product whose angle is that from one phasor to another.
fn phase_step(first_phasor: [f64; 2], second_phasor: [f64; 2]) -> [f64; 2] {
    complex_product(second_phasor, [first_phasor[0], -first_phasor[1]])
}

fn angle([re, im]: [f64; 2]) -> f64 {
    if (re, im) == (0.0, 0.0) { 0.0 } else { atan2(im, re) }
}

fn modulus([re, im]: [f64; 2]) -> f64 {
    (re * re + im * im).sqrt()
}

/// The straight line that fits best by weighted least squares.
struct Line {
    /// From one value to the next.
    slope: f64,
    /// What is left (rms).
    residual: f64,
    /// The standard deviation of the slope.
    deviation: f64,
}

impl Line {
    fn fitted(values: &[f64], weights: &[f64]) -> Self {
        let weight_sum: f64 = weights.iter().sum();
        let weighted_mean = |value_of: &dyn Fn(usize) -> f64| -> f64 {
            let indexed_weights = weights.iter().enumerate();
            indexed_weights.map(|(i, weight)| weight * value_of(i)).sum::<f64>() / weight_sum
        };
        let (index_mean, value_mean) = (weighted_mean(&|i| i as f64), weighted_mean(&|i| values[i]));
        let index_variance = weighted_mean(&|i| (i as f64 - index_mean) * (i as f64 - index_mean));
        if !(weight_sum > 0.0 && index_variance > 0.0) {
            return Self {
                slope: 0.0,
                residual: 0.0,
                deviation: 0.0,
            };
        }
        let line_slope = weighted_mean(&|i| (i as f64 - index_mean) * (values[i] - value_mean)) / index_variance;
        let mean_square = weighted_mean(&|i| {
            let residual = values[i] - value_mean - line_slope * (i as f64 - index_mean);
            residual * residual
        });
        Self {
            slope: line_slope,
            residual: mean_square.sqrt(),
            deviation: (mean_square / (index_variance * effective_count(weights))).sqrt(),
        }
    }

    /// The slope as far as it is more than chance.
    fn significant_slope(&self, scatter: Scatter) -> f64 {
        significant_part(self.slope, scatter.deviations() * self.deviation)
    }
}

/// The effective number of independent windows of these weights.
fn effective_count(weights: &[f64]) -> f64 {
    let (sum, square_sum) = weights.iter().fold((0.0, 0.0), |(sum, square_sum), weight| {
        (sum + weight, square_sum + weight * weight)
    });
    (sum * sum / square_sum / WINDOWS_APART as f64).max(1.0)
}

/// A value less `chance`, what chance may make of it; 0 if either is not a number.
fn significant_part(value: f64, chance: f64) -> f64 {
    let excess = value.abs() - chance;
    if excess > 0.0 { excess.copysign(value) } else { 0.0 }
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
        let (pitch_error, decay_error) = pitch_errors(&reference, &reference, RATE, 5_000.0, Scatter::Deducted);
        assert_eq!((pitch_error, decay_error), (0.0, 0.0));
        // 5 cents, and a T60 that is a tenth longer.
        let detuned = sound((220.0, 8.0), (1_310.0 * 1.002_892, 20.0 / 1.1));
        let (pitch_error, decay_error) = pitch_errors(&detuned, &reference, RATE, 5_000.0, Scatter::Deducted);
        assert!((pitch_error - 5.0).abs() < 0.2, "{pitch_error}");
        assert!((decay_error - 0.1).abs() < 0.01, "{decay_error}");
        // Partials above `frequency_max` are not compared.
        assert!(pitch_errors(&detuned, &reference, RATE, 1_000.0, Scatter::Deducted).0 < 0.3);
    }

    #[test]
    fn pitch_errors_of_a_fast_fading_partial() {
        // 20 dB below the other at the beginning, and 60 dB lower after 115 ms of 300.
        let reference = sound((110.0, 20.0), (450.0, 60.0));
        let detuned = sound((110.0, 20.0), (450.0 * 1.002_892, 60.0));
        let (pitch_error, _) = pitch_errors(&detuned, &reference, RATE, 5_000.0, Scatter::Deducted);
        assert!((pitch_error - 5.0).abs() < 0.2, "{pitch_error}");
    }

    #[test]
    fn pitch_errors_of_a_beating_partial() {
        // Two partials 10 Hz apart are one band, whose level passes through zero every 0.1 s. In the second sound the
        // weaker one is 1 dB stronger and then the stronger: the phase slips by a cycle at each zero, and the pitch of
        // neither has changed.
        let beat = |second: f64| -> Vec<f64> {
            let instants = (0..13_230).map(|n| f64::from(n) / RATE);
            instants
                .map(|t| exp(-5.0 * t) * (sincos(TAU * 235.0 * t).0 + second * sincos(TAU * 245.0 * t).0))
                .collect()
        };
        let (pitch_error, _) = pitch_errors(&beat(1.02), &beat(0.98), RATE, 5_000.0, Scatter::Deducted);
        assert!(pitch_error < 3.0, "{pitch_error}");
    }

    #[test]
    fn pitch_errors_of_noise() {
        // The strongest peaks of two noises are no partials, and their pitches cannot differ.
        let noise = |seed: u32| -> Vec<f64> {
            let mut chance = crate::chance::Chance::new(seed.into(), "noise", "", 0, 0);
            (0..13_230).map(|_| chance.uniform(-1.0, 1.0)).collect()
        };
        let pitch_error =
            |seed: u32| pitch_errors(&noise(seed), &noise(100 + seed), RATE, 5_000.0, Scatter::Deducted).0;
        let n_significant = (0..20).filter(|&seed| pitch_error(seed) > 3.0).count();
        assert!(n_significant <= 2, "{n_significant} of 20");
    }

    #[test]
    fn pitch_errors_of_short_and_silent_sounds_are_zero() {
        assert_eq!(pitch_errors(&[], &[], RATE, 5_000.0, Scatter::Deducted), (0.0, 0.0));
        assert_eq!(
            pitch_errors(&[0.0; 500], &[0.0; 500], RATE, 5_000.0, Scatter::Deducted),
            (0.0, 0.0)
        );
        let reference = sound((220.0, 8.0), (1_310.0, 20.0));
        let silence = vec![0.0; reference.len()];
        let (pitch_error, decay_error) = pitch_errors(&silence, &reference, RATE, 5_000.0, Scatter::Deducted);
        assert!(pitch_error.is_finite() && decay_error.is_finite());
    }
}
