//! How far one sound is from another: the error of a waveform that plans, charts and maps name.

use crate::maths::{log10, sqrt};

/// ‖sound − reference‖² / ‖reference − mean‖² of the worst output, over the first `n_frames`: where a thing stands is
/// no sound.
///
/// Both are (n_frames · n_out). 0 where neither changes, ∞ where only the reference is silent or a difference is not a
/// number.
pub(crate) fn worst_ratio(sound: &[f64], reference: &[f64], n_out: usize, n_frames: usize) -> f64 {
    let ratio = |output: usize| {
        let column = |x: &[f64]| -> Vec<f64> {
            let column = x.iter().skip(output).step_by(n_out);
            column.take(n_frames).copied().collect()
        };
        let (sound, reference) = (column(sound), column(reference));
        if is_still(&reference, 1) && is_still(&sound, 1) {
            return 0.0; // at a place that is the same but for rounding, which is no sound
        }
        let mean = reference.iter().sum::<f64>() / reference.len().max(1) as f64;
        let pairs = sound.iter().zip(&reference);
        let difference: f64 = pairs.map(|(a, b)| (a - b) * (a - b)).sum();
        let size: f64 = reference.iter().map(|b| (b - mean) * (b - mean)).sum();
        if difference.is_nan() {
            return f64::INFINITY;
        }
        if difference > 0.0 {
            difference / size
        } else {
            0.0
        }
    };
    (0..n_out).map(ratio).fold(0.0, f64::max)
}

/// ‖sound − reference‖ / ‖reference − mean‖ [dB] of the worst output, from the first frame to each of `ends`.
///
/// Both are (n_frames · n_out); `ends` are frames. Ends beyond the shorter of the two count as its end. −∞ where both
/// are equal, ∞ where only the reference is silent or a difference is not a number.
///
/// ```
/// use ergon_engine::waveform::errors_until;
///
/// let reference = [0.0, 1.0, 0.0, -1.0];
/// let sound = reference.map(|x| 1.1 * x);
/// let errors = errors_until(&sound, &reference, 1, &[4]);
/// assert!((errors[0] + 20.0).abs() < 1e-9);
/// ```
pub fn errors_until(sound: &[f64], reference: &[f64], n_out: usize, ends: &[usize]) -> Vec<f64> {
    let length = sound.len().min(reference.len()) / n_out.max(1);
    let error = |end: &usize| {
        let ratio = worst_ratio(sound, reference, n_out, (*end).min(length));
        20.0 * log10(sqrt(ratio))
    };
    ends.iter().map(error).collect()
}

/// Whether nothing changes in a sound, (n_frames · n_out).
pub(crate) fn is_still(sound: &[f64], n_out: usize) -> bool {
    let mut frames = sound.chunks_exact(n_out.max(1));
    let first = frames.next();
    frames.all(|frame| Some(frame) == first)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tone(n: usize) -> Vec<f64> {
        (0..n).map(|n| crate::maths::sin(0.1 * n as f64)).collect()
    }

    #[test]
    fn errors_until_each_end() {
        let reference = tone(300);
        let sound: Vec<f64> = (0..300)
            .map(|n| reference[n] + if n < 100 { 1e-3 } else { 1e-1 })
            .collect();
        let ends = [50, 100, 200, 300];
        let errors = errors_until(&sound, &reference, 1, &ends);
        for (error, end) in errors.iter().zip(ends) {
            let reference = &reference[..end];
            let mean = reference.iter().sum::<f64>() / end as f64;
            let square = |x: f64| x * x;
            let difference: f64 = (0..end).map(|n| square(sound[n] - reference[n])).sum();
            let size: f64 = reference.iter().map(|x| square(x - mean)).sum();
            assert!(
                (error - 10.0 * log10(difference / size)).abs() < 1e-9,
                "{end}"
            );
        }
    }

    #[test]
    fn errors_of_the_worst_output_at_any_place() {
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
    fn errors_of_silence_and_of_equal_sounds() {
        let reference = tone(100);
        let until = |sound: &[f64], other: &[f64]| errors_until(sound, other, 1, &[100])[0];
        assert_eq!(until(&reference, &reference), f64::NEG_INFINITY);
        assert_eq!(until(&[2.0; 100], &[2.5; 100]), f64::NEG_INFINITY);
        assert_eq!(until(&reference, &[0.0; 100]), f64::INFINITY);
        assert_eq!(until(&[f64::NAN; 100], &reference), f64::INFINITY);
        assert_eq!(errors_until(&[], &[], 1, &[0, 10]), [f64::NEG_INFINITY; 2]);
    }
}
