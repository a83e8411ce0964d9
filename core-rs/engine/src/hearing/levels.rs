//! Levels of third octaves that are heard in the presence of the others.
//!
//! A band is heard if it is above what the others mask. Maskers spread over the basilar membrane by 15.81 + 7.5·(Δ +
//! 0.474) − 17.5·√(1 + (Δ + 0.474)²) dB at a distance of Δ Bark (Schroeder, Atal & Hall, J. Acoust. Soc. Am. 66, 1979),
//! and mask what lies 14.5 + z dB below, z the Bark of the band: the offset of tones, which mask least (Johnston, IEEE
//! J. Sel. Areas Commun. 6, 1988). z = 26.81·f/(1960 + f) − 0.53 (Traunmüller, J. Acoust. Soc. Am. 88, 1990).

use std::f64::consts::PI;

use crate::hearing::constants::{BAND_VALUES_MIN, COMPARED_POWER_MIN, FADE_OUT_PARTS, MISSING_POWER_RATIO};
use crate::hearing::third_octaves::{Band, bands, power_spectrum};
use crate::maths::{log10, pow, sincos, sqrt};

/// The largest level difference among the third octaves that are heard in `reference` [dB].
pub(super) fn level_error(sound: &[f64], reference: &[f64], rate: f64) -> f64 {
    let bands = bands(reference.len(), rate, BAND_VALUES_MIN);
    let spectrum = |x: &[f64]| -> Vec<f64> {
        let powers = power_spectrum(with_faded_end(x));
        let band_power = |band: &Band| powers[band.bins.clone()].iter().sum();
        bands.iter().map(band_power).collect()
    };
    let (sound_powers, reference_powers) = (spectrum(sound), spectrum(reference));
    let centres: Vec<f64> = bands.iter().map(|band| band.centre).collect();
    let is_unmasked = unmasked_bands(&centres, &reference_powers);
    let band_pairs = sound_powers.iter().zip(&reference_powers).zip(is_unmasked);
    let unmasked_pairs = band_pairs.filter(|(_, is_heard)| *is_heard);
    unmasked_pairs.fold(0.0, |worst, ((sound_power, reference_power), _)| {
        worst.max(10.0 * log10((sound_power / reference_power).max(MISSING_POWER_RATIO)).abs())
    })
}

/// The sound with its end faded out: an abrupt end would be heard in every band.
fn with_faded_end(sound: &[f64]) -> Vec<f64> {
    let fade_length = sound.len() / FADE_OUT_PARTS;
    let fade_start = sound.len() - fade_length;
    let mut faded_sound = sound.to_vec();
    for (index, sample) in faded_sound[fade_start..].iter_mut().enumerate() {
        let fade_cosine = sincos(0.5 * PI * (index as f64 + 0.5) / fade_length as f64).1;
        *sample *= fade_cosine * fade_cosine;
    }
    faded_sound
}

/// Which bands are not masked, given their centres [Hz] and powers.
fn unmasked_bands(centres: &[f64], powers: &[f64]) -> Vec<bool> {
    let greatest_power = powers
        .iter()
        .fold(0.0_f64, |greatest_so_far, power| greatest_so_far.max(*power));
    let band_barks: Vec<f64> = centres.iter().map(|f| bark(*f)).collect();
    let masking_power = |band: usize| -> f64 {
        let other_powers = powers.iter().zip(&band_barks).enumerate();
        let other_powers = other_powers.filter(|(other, _)| *other != band);
        let spread_powers =
            other_powers.map(|(_, (power, bark))| power * power_ratio(spreading(band_barks[band] - bark)));
        spread_powers.sum::<f64>() * power_ratio(-14.5 - band_barks[band])
    };
    let indexed_powers = powers.iter().enumerate();
    indexed_powers
        .map(|(band, power)| *power > (COMPARED_POWER_MIN * greatest_power).max(masking_power(band)))
        .collect()
}

fn bark(f: f64) -> f64 {
    26.81 * f / (1960.0 + f) - 0.53
}

/// Level of a masker at a distance of `bark_distance` above it, relative to its own [dB].
fn spreading(bark_distance: f64) -> f64 {
    let bark_offset = bark_distance + 0.474;
    15.81 + 7.5 * bark_offset - 17.5 * sqrt(1.0 + bark_offset * bark_offset)
}

/// The ratio of powers for a level [dB].
fn power_ratio(db: f64) -> f64 {
    pow(10.0, 0.1 * db)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::maths::sincos;

    const RATE: f64 = 44_100.0;

    /// Sines, each of a frequency [Hz] and an amplitude, 0.3 s that fade in: an abrupt beginning would be heard in
    /// every band.
    fn tones(partials: &[(f64, f64)]) -> Vec<f64> {
        let tone_sample = |n: usize| {
            let fade_in = sincos(0.5 * PI * (n as f64 / 3_300.0).min(1.0)).0;
            let partial_sum: f64 = partials
                .iter()
                .map(|(f, amplitude)| amplitude * sincos(TAU * f * n as f64 / RATE).0)
                .sum();
            fade_in * fade_in * partial_sum
        };
        (0..13_230).map(tone_sample).collect()
    }

    #[test]
    fn spreading_reaches_further_up_than_down() {
        assert!(spreading(0.0).abs() < 0.01);
        assert!((spreading(3.0) + 21.4).abs() < 0.1, "{}", spreading(3.0));
        assert!((spreading(-3.0) + 50.7).abs() < 0.1, "{}", spreading(-3.0));
    }

    #[test]
    fn level_error_ignores_masked_tones() {
        // 50 dB below a strong tone: masked if next to it, heard two octaves above.
        let (near_partial, far_partial) = ((1_260.0, 3e-3), (4_000.0, 3e-3));
        let loud_partial = (1_000.0, 1.0);
        let reference = tones(&[loud_partial, near_partial, far_partial]);
        let level_without = |faint_partial: (f64, f64)| {
            let weakened = [loud_partial, near_partial, far_partial].map(|partial| {
                if partial == faint_partial {
                    (partial.0, 0.3 * partial.1)
                } else {
                    partial
                }
            });
            level_error(&tones(&weakened), &reference, RATE)
        };
        assert!(level_without(near_partial) < 1e-6, "{}", level_without(near_partial));
        let level_change = -20.0 * log10(0.3);
        assert!(
            (level_without(far_partial) - level_change).abs() < 0.5,
            "{}",
            level_without(far_partial)
        );
    }

    #[test]
    fn level_error_of_silence_is_finite() {
        let tone_sound = tones(&[(500.0, 1.0)]);
        let silence = vec![0.0; tone_sound.len()];
        assert_eq!(level_error(&tone_sound, &tone_sound, RATE), 0.0);
        assert_eq!(level_error(&tone_sound, &silence, RATE), 0.0);
        assert!((level_error(&silence, &tone_sound, RATE) - 100.0).abs() < 1e-9);
        assert_eq!(level_error(&[], &[], RATE), 0.0);
    }
}
