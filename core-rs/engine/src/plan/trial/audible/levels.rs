//! Levels of third octaves that are heard in the presence of the others.
//!
//! A band is heard if it is above what the others mask. Maskers spread over the basilar membrane by 15.81 + 7.5·(Δ +
//! 0.474) − 17.5·√(1 + (Δ + 0.474)²) dB at a distance of Δ Bark (Schroeder, Atal & Hall, J. Acoust. Soc. Am. 66, 1979),
//! and mask what lies 14.5 + z dB below, z the Bark of the band: the offset of tones, which mask least (Johnston, IEEE
//! J. Sel. Areas Commun. 6, 1988). z = 26.81·f/(1960 + f) − 0.53 (Traunmüller, J. Acoust. Soc. Am. 88, 1990).

use std::f64::consts::PI;

use crate::maths::{log10, pow, sincos, sqrt};
use crate::plan::constants::{BAND_VALUES, COMPARED_POWER_MIN, FADED, MISSING};
use crate::plan::trial::third_octaves::{Band, bands, powers};

/// The largest level difference among the third octaves that are heard in `b` [dB].
pub(super) fn level_error(a: &[f64], b: &[f64], rate: f64) -> f64 {
    let bands = bands(b.len(), rate, BAND_VALUES);
    let spectrum = |x: &[f64]| -> Vec<f64> {
        let powers = powers(faded(x));
        let sum = |band: &Band| powers[band.bins.clone()].iter().sum();
        bands.iter().map(sum).collect()
    };
    let (ours, theirs) = (spectrum(a), spectrum(b));
    let centres: Vec<f64> = bands.iter().map(|band| band.centre).collect();
    let audible = unmasked_bands(&centres, &theirs);
    let each = ours.iter().zip(&theirs).zip(audible);
    let audible = each.filter(|(_, is_heard)| *is_heard);
    audible.fold(0.0, |worst, ((ours, theirs), _)| {
        worst.max(10.0 * log10((ours / theirs).max(MISSING)).abs())
    })
}

/// The sound with its end faded out: an abrupt end would be heard in every band.
fn faded(x: &[f64]) -> Vec<f64> {
    let n = x.len() / FADED;
    let from = x.len() - n;
    let mut x = x.to_vec();
    for (index, x) in x[from..].iter_mut().enumerate() {
        let s = sincos(0.5 * PI * (index as f64 + 0.5) / n as f64).1;
        *x *= s * s;
    }
    x
}

/// Which bands are not masked, given their centres [Hz] and powers.
fn unmasked_bands(centres: &[f64], powers: &[f64]) -> Vec<bool> {
    let strongest = powers.iter().fold(0.0_f64, |most, power| most.max(*power));
    let barks: Vec<f64> = centres.iter().map(|f| bark(*f)).collect();
    let masked = |masked_power: usize| -> f64 {
        let others = powers.iter().zip(&barks).enumerate();
        let others = others.filter(|(other, _)| *other != masked_power);
        let spread = others
            .map(|(_, (power, bark))| power * decibels(spreading(barks[masked_power] - bark)));
        spread.sum::<f64>() * decibels(-14.5 - barks[masked_power])
    };
    let indexed = powers.iter().enumerate();
    indexed
        .map(|(masked_power, power)| {
            *power > (COMPARED_POWER_MIN * strongest).max(masked(masked_power))
        })
        .collect()
}

fn bark(f: f64) -> f64 {
    26.81 * f / (1960.0 + f) - 0.53
}

/// Level of a masker at a distance of `bark` above it, relative to its own [dB].
fn spreading(bark: f64) -> f64 {
    let d = bark + 0.474;
    15.81 + 7.5 * d - 17.5 * sqrt(1.0 + d * d)
}

/// The ratio of powers for a level [dB].
fn decibels(db: f64) -> f64 {
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
        let sample = |n: usize| {
            let rise = sincos(0.5 * PI * (n as f64 / 3_300.0).min(1.0)).0;
            let each = partials.iter();
            let sum: f64 = each
                .map(|(f, size)| size * sincos(TAU * f * n as f64 / RATE).0)
                .sum();
            rise * rise * sum
        };
        (0..13_230).map(sample).collect()
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
        let (near, far) = ((1_260.0, 3e-3), (4_000.0, 3e-3));
        let loud = (1_000.0, 1.0);
        let b = tones(&[loud, near, far]);
        let without = |gone: (f64, f64)| {
            let rest = [loud, near, far].map(|partial| {
                if partial == gone {
                    (partial.0, 0.3 * partial.1)
                } else {
                    partial
                }
            });
            level_error(&tones(&rest), &b, RATE)
        };
        assert!(without(near) < 1e-6, "{}", without(near));
        let change = -20.0 * log10(0.3);
        assert!((without(far) - change).abs() < 0.5, "{}", without(far));
    }

    #[test]
    fn level_error_of_silence_is_finite() {
        let b = tones(&[(500.0, 1.0)]);
        let silence = vec![0.0; b.len()];
        assert_eq!(level_error(&b, &b, RATE), 0.0);
        assert_eq!(level_error(&b, &silence, RATE), 0.0);
        assert!((level_error(&silence, &b, RATE) - 100.0).abs() < 1e-9);
        assert_eq!(level_error(&[], &[], RATE), 0.0);
    }
}
