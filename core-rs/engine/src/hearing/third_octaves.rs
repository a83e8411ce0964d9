//! Levels of third octaves: what can still be compared of two sounds whose waveforms have parted.

use std::f64::consts::TAU;
use std::ops::Range;

use crate::hearing::constants::{
    BAND_VALUES_MIN_PARTED, COMPARED_POWER_MIN, HIGHEST_AUDIBLE, HIGHEST_BAND_RATE_SHARE, LOWEST_THIRD_OCTAVE,
    MISSING_POWER_RATIO,
};
use crate::maths::{log10, pow, sincos};

/// Reference frequency of the third-octave grid [Hz].
const CENTRE_HERTZ: f64 = 1_000.0;

/// Mean difference of the levels of two sounds [dB], (n_frames · n_out) each, `reference` the reference: over the third
/// octaves within 60 dB of its strongest, summed over outputs that are normalised to equal power.
pub(crate) fn level_difference(sound: &[f64], reference: &[f64], n_out: usize, rate: f64) -> f64 {
    let n_frames = reference.len() / n_out.max(1);
    let bands = bands(n_frames, rate, BAND_VALUES_MIN_PARTED);
    let (mut sound_powers, mut reference_powers) = (vec![0.0; bands.len()], vec![0.0; bands.len()]);
    for output in 0..n_out {
        let output_sound = |x: &[f64]| -> Vec<f64> { x.iter().skip(output).step_by(n_out).copied().collect() };
        let (sound, reference) = (remove_mean(output_sound(sound)), remove_mean(output_sound(reference)));
        let reference_energy: f64 = reference.iter().map(|x| x * x).sum();
        if reference_energy <= 0.0 {
            continue;
        }
        for (sound, band_powers) in [(sound, &mut sound_powers), (reference, &mut reference_powers)] {
            let power_spectrum = power_spectrum(sound);
            for (band_power, band) in band_powers.iter_mut().zip(&bands) {
                *band_power += power_spectrum[band.bins.clone()].iter().sum::<f64>() / reference_energy;
            }
        }
    }
    let greatest_power = reference_powers
        .iter()
        .fold(0.0_f64, |strongest_yet, band_power| strongest_yet.max(*band_power));
    let power_pairs = sound_powers.iter().zip(&reference_powers);
    let compared_pairs =
        power_pairs.filter(|(_, reference_powers)| **reference_powers > COMPARED_POWER_MIN * greatest_power);
    let (level_sum, band_count) =
        compared_pairs.fold((0.0, 0), |(level_sum, band_count), (sound_powers, reference_powers)| {
            let level_gap = 10.0 * log10((sound_powers / reference_powers).max(MISSING_POWER_RATIO));
            (level_sum + level_gap.abs(), band_count + 1)
        });
    level_sum / f64::from(band_count.max(1))
}

/// Removes the mean, which is not audible.
fn remove_mean(mut sound: Vec<f64>) -> Vec<f64> {
    let sound_mean = sound.iter().sum::<f64>() / sound.len().max(1) as f64;
    sound.iter_mut().for_each(|x| *x -= sound_mean);
    sound
}

/// A third octave: its centre [Hz], and the bins of a transform in it.
pub(super) struct Band {
    pub(super) centre: f64,
    pub(super) bins: Range<usize>,
}

/// The bands whose width times duration is at least `band_values_min`, from 25 Hz up to 20 kHz, or up to
/// `HIGHEST_BAND_RATE_SHARE` of the rate if that is lower.
pub(super) fn bands(n_frames: usize, rate: f64, band_values_min: f64) -> Vec<Band> {
    let seconds = n_frames as f64 / rate;
    let bin_width = rate / fft_length(n_frames) as f64;
    let bin_above = |frequency: f64| (frequency / bin_width).ceil() as usize;
    let centres = (LOWEST_THIRD_OCTAVE..).map(|i| CENTRE_HERTZ * pow(2.0, f64::from(i) / 3.0));
    let (lower_ratio, upper_ratio) = (pow(2.0, -1.0 / 6.0), pow(2.0, 1.0 / 6.0));
    centres
        .take_while(|centre| *centre <= HIGHEST_AUDIBLE.min(HIGHEST_BAND_RATE_SHARE * rate))
        .filter(|centre| centre * (upper_ratio - lower_ratio) * seconds >= band_values_min)
        .map(|centre| Band {
            centre,
            bins: bin_above(centre * lower_ratio)..bin_above(centre * upper_ratio),
        })
        .collect()
}

/// Length of the transform: sounds are zero-padded to a power of two.
pub(super) fn fft_length(n_frames: usize) -> usize {
    n_frames.max(2).next_power_of_two()
}

/// |X|² of a sound, from 0 to half its rate.
pub(super) fn power_spectrum(mut re: Vec<f64>) -> Vec<f64> {
    let fft_size = fft_length(re.len());
    re.resize(fft_size, 0.0);
    let mut im = vec![0.0; fft_size];
    fourier_transform(&mut re, &mut im);
    let half_spectrum = re.iter().zip(&im).take(fft_size / 2 + 1);
    half_spectrum.map(|(re, im)| re * re + im * im).collect()
}

/// In-place Fourier transform of 2^k numbers (Cooley and Tukey). It uses the engine's own sines, so that a plan is the
/// same on every machine.
fn fourier_transform(re: &mut [f64], im: &mut [f64]) {
    let fft_size = re.len();
    let unused_bits = usize::BITS - fft_size.ilog2();
    for i in 0..fft_size {
        let reversed_index = i.reverse_bits().checked_shr(unused_bits).unwrap_or(0);
        if i < reversed_index {
            re.swap(i, reversed_index);
            im.swap(i, reversed_index);
        }
    }
    let twiddles: Vec<(f64, f64)> = (0..fft_size / 2)
        .map(|i| sincos(-TAU * i as f64 / fft_size as f64))
        .collect();
    let mut half_size = 1;
    while half_size < fft_size {
        let stride = fft_size / (2 * half_size);
        for first in (0..fft_size).step_by(2 * half_size) {
            for k in 0..half_size {
                let (sin, cos) = twiddles[k * stride];
                let (low_index, high_index) = (first + k, first + k + half_size);
                let (x, y) = (re[high_index], im[high_index]);
                let (x, y) = (x * cos - y * sin, x * sin + y * cos);
                (re[high_index], im[high_index]) = (re[low_index] - x, im[low_index] - y);
                re[low_index] += x;
                im[low_index] += y;
            }
        }
        half_size *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Partials at multiples of 60 Hz up to 20 kHz, 0.4 s, two outputs; `amplitude` gives a partial's amplitude,
    /// `phase` its phase.
    fn sound(amplitude: impl Fn(f64) -> f64, phase: f64) -> Vec<f64> {
        let sound_sample = |n: usize| {
            let partials = (1..=333).map(|k| {
                let (partial_hertz, k) = (60.0 * f64::from(k), f64::from(k));
                amplitude(partial_hertz) / k * sincos(TAU * partial_hertz * n as f64 / 44_100.0 + phase * k * k).0
            });
            partials.sum::<f64>()
        };
        let mono_sound = (0..17_640).map(sound_sample);
        mono_sound.flat_map(|x| [x, 3.0 + 1e-3 * x]).collect()
    }

    #[test]
    fn powers_equal_the_defining_sum() {
        let x: Vec<f64> = (0..16).map(|i| f64::from((7 * i * i + 3 * i) % 13)).collect();
        let power_spectrum = power_spectrum(x.clone());
        for (bin, power) in power_spectrum.iter().enumerate() {
            let phasor_at = |i: usize| sincos(TAU * (bin * i) as f64 / 16.0);
            let indexed_samples = x.iter().enumerate();
            let (re, im) = indexed_samples.fold((0.0, 0.0), |(re, im), (i, x)| {
                (re + x * phasor_at(i).1, im + x * phasor_at(i).0)
            });
            assert!((power - (re * re + im * im)).abs() < 1e-9, "{bin}");
        }
        assert_eq!(power_spectrum.len(), 9);
    }

    #[test]
    fn level_difference_ignores_phases() {
        let levels_apart = |a: &[f64], reference: &[f64]| level_difference(a, reference, 2, 44_100.0);
        let reference = sound(|_| 1.0, 1.0);
        let phase_change = levels_apart(&sound(|_| 1.0, 2.0), &reference);
        assert!((0.001..1.0).contains(&phase_change), "{phase_change}");
        let louder_sound: Vec<f64> = reference.iter().map(|x| 2.0 * x).collect();
        assert!((levels_apart(&louder_sound, &reference) - 6.02).abs() < 0.01);
        // 6 dB less in the upper half: ten of the 20 bands that are wide enough and not empty.
        let darker_change = levels_apart(&sound(|hertz| if hertz > 890.0 { 0.5 } else { 1.0 }, 1.0), &reference);
        assert!((2.5..3.6).contains(&darker_change), "{darker_change}");
    }

    #[test]
    fn level_difference_of_silence_is_finite() {
        let reference = sound(|_| 1.0, 1.0);
        let silence = vec![0.0; reference.len()];
        assert_eq!(level_difference(&reference, &reference, 2, 44_100.0), 0.0);
        assert_eq!(level_difference(&reference, &silence, 2, 44_100.0), 0.0);
        assert!((level_difference(&silence, &reference, 2, 44_100.0) - 100.0).abs() < 1e-9);
        assert_eq!(level_difference(&[], &[], 0, 44_100.0), 0.0);
    }
}
