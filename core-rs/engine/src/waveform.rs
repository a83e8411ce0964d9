//! How far one sound is from another: the error of a waveform that charts and maps name.

use crate::maths::{log10, sqrt};

/// A difference this much smaller than an output itself is rounding [power].
const ROUNDING: f64 = 1e-26;

/// What is known of one output from the first frame on.
#[derive(Clone, Copy)]
struct Sums {
    /// First frames of the sound and of the reference.
    first: [f64; 2],
    /// Neither has changed so far.
    are_still: bool,
    /// The squared difference, and the squared reference.
    difference: f64,
    square: f64,
    /// The reference and its square, both relative to its first frame: where a thing stands is no sound.
    sum: f64,
    centred: f64,
}

impl Sums {
    fn new(first: [f64; 2]) -> Self {
        Self {
            first,
            are_still: true,
            difference: 0.0,
            square: 0.0,
            sum: 0.0,
            centred: 0.0,
        }
    }

    fn add(&mut self, sound: f64, reference: f64) {
        let x = reference - self.first[1];
        self.are_still &= [sound, reference] == self.first;
        self.difference += (sound - reference) * (sound - reference);
        self.square += reference * reference;
        self.sum += x;
        self.centred += x * x;
    }

    /// ‖sound − reference‖² / ‖reference − mean‖² over the first `n` frames.
    fn ratio(&self, n: f64) -> f64 {
        if self.difference.is_nan() {
            return f64::INFINITY;
        }
        // Two places that are the same but for rounding are no sounds.
        if self.are_still || self.difference <= ROUNDING * self.square {
            return 0.0;
        }
        self.difference / (self.centred - self.sum * self.sum / n).max(0.0)
    }
}

/// ‖sound − reference‖ / ‖reference − mean‖ [dB] of the worst output, from the first frame to each of `ends`.
///
/// Both are (n_frames · n_out); `ends` are frames and do not fall. Ends beyond the shorter of the two count as its end.
/// −∞ where both are equal within rounding, ∞ where only the reference is silent or a difference is not finite.
///
/// ```
/// use ergon_engine::waveform::errors_until;
///
/// let reference = [0.0, 1.0, 0.0, -1.0];
/// let sound = reference.map(|x| 1.1 * x);
/// let found = errors_until(&sound, &reference, 1, &[4]);
/// assert!((found[0] + 20.0).abs() < 1e-9);
/// ```
pub fn errors_until(sound: &[f64], reference: &[f64], n_out: usize, ends: &[usize]) -> Vec<f64> {
    let n_out = n_out.max(1);
    let mut frames = sound.chunks_exact(n_out).zip(reference.chunks_exact(n_out));
    let mut sums: Vec<Sums> = sound
        .iter()
        .zip(reference)
        .take(n_out)
        .map(|(sound, reference)| Sums::new([*sound, *reference]))
        .collect();
    let mut n_frames = 0_usize;
    let error = |end: &usize| {
        let more = end.saturating_sub(n_frames);
        for (sound, reference) in frames.by_ref().take(more) {
            n_frames += 1;
            for ((sums, sound), reference) in sums.iter_mut().zip(sound).zip(reference) {
                sums.add(*sound, *reference);
            }
        }
        let ratios = sums.iter().map(|sums| sums.ratio(n_frames as f64));
        20.0 * log10(sqrt(ratios.fold(0.0, f64::max)))
    };
    ends.iter().map(error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tone(n: usize) -> Vec<f64> {
        (0..n).map(|n| crate::maths::sin(0.1 * n as f64)).collect()
    }

    #[test]
    fn errors_to_each_end_are_those_of_the_sounds_cut_there() {
        let reference = tone(300);
        let sound: Vec<f64> = (0..300)
            .map(|n| reference[n] + if n < 100 { 1e-3 } else { 1e-1 })
            .collect();
        let ends = [50, 100, 200, 300];
        let found = errors_until(&sound, &reference, 1, &ends);
        for (error, end) in found.iter().zip(ends) {
            let reference = &reference[..end];
            let mean = reference.iter().sum::<f64>() / end as f64;
            let square = |x: f64| x * x;
            let difference: f64 = (0..end).map(|n| square(sound[n] - reference[n])).sum();
            let whole: f64 = reference.iter().map(|x| square(x - mean)).sum();
            assert!(
                (error - 10.0 * log10(difference / whole)).abs() < 1e-9,
                "{end}"
            );
        }
    }

    #[test]
    fn the_worst_output_counts_and_where_it_stands_does_not() {
        let loud = tone(200);
        let both = |soft: f64, place: f64| -> Vec<f64> {
            let each = loud.iter().map(|x| [x + place, soft * x - place]);
            each.flatten().collect()
        };
        let mean = loud.iter().sum::<f64>() / 200.0;
        let [square, centred] =
            [0.0, mean].map(|mean| -> f64 { loud.iter().map(|x| (x - mean) * (x - mean)).sum() });
        let expected = 10.0 * log10(1e-2 * square / centred);
        for place in [0.0, 5.0] {
            let errors = errors_until(&both(1.1e-3, place), &both(1e-3, place), 2, &[200]);
            assert!((errors[0] - expected).abs() < 1e-6, "{}", errors[0]);
        }
    }

    #[test]
    fn silence_and_equal_sounds() {
        let reference = tone(100);
        let until = |sound: &[f64], other: &[f64]| errors_until(sound, other, 1, &[100])[0];
        assert_eq!(until(&reference, &reference), f64::NEG_INFINITY);
        assert_eq!(until(&[2.0; 100], &[2.5; 100]), f64::NEG_INFINITY);
        assert_eq!(until(&reference, &[0.0; 100]), f64::INFINITY);
        assert_eq!(until(&[f64::NAN; 100], &reference), f64::INFINITY);
        assert_eq!(errors_until(&[], &[], 1, &[0, 10]), [f64::NEG_INFINITY; 2]);
    }
}
