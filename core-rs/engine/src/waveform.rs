//! How far one sound is from another: the error of a waveform that plans, charts and maps name.

use crate::maths::{log10, sqrt};

/// ‖sound − reference‖² / ‖reference − mean‖² of the worst output, over the first `n_frames`: where a thing stands is
/// no sound.
///
/// Both are (n_frames · n_out). 0 where neither changes, ∞ where only the reference is silent or a difference is not a
/// number.
pub(crate) fn worst_ratio(sound: &[f64], reference: &[f64], n_out: usize, n_frames: usize) -> f64 {
    let output_ratio = |output: usize| {
        let output_column = |x: &[f64]| -> Vec<f64> {
            let output_column = x.iter().skip(output).step_by(n_out);
            output_column.take(n_frames).copied().collect()
        };
        let (sound, reference) = (output_column(sound), output_column(reference));
        if is_still(&reference, 1) && is_still(&sound, 1) {
            return 0.0; // at a place that is the same but for rounding, which is no sound
        }
        let reference_mean = reference.iter().sum::<f64>() / reference.len().max(1) as f64;
        let sample_pairs = sound.iter().zip(&reference);
        let difference: f64 = sample_pairs.map(|(a, b)| (a - b) * (a - b)).sum();
        let reference_power: f64 = reference
            .iter()
            .map(|b| (b - reference_mean) * (b - reference_mean))
            .sum();
        if difference.is_nan() {
            return f64::INFINITY;
        }
        if difference > 0.0 {
            difference / reference_power
        } else {
            0.0
        }
    };
    (0..n_out).map(output_ratio).fold(0.0, f64::max)
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
    let frame_count = sound.len().min(reference.len()) / n_out.max(1);
    let error_level = |end: &usize| {
        let error_ratio = worst_ratio(sound, reference, n_out, (*end).min(frame_count));
        20.0 * log10(sqrt(error_ratio))
    };
    ends.iter().map(error_level).collect()
}

/// Whether nothing changes in a sound, (n_frames · n_out).
pub(crate) fn is_still(sound: &[f64], n_out: usize) -> bool {
    let mut sound_frames = sound.chunks_exact(n_out.max(1));
    let first_frame = sound_frames.next();
    sound_frames.all(|frame| Some(frame) == first_frame)
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
        let faulty_sound: Vec<f64> = (0..300)
            .map(|n| reference[n] + if n < 100 { 1e-3 } else { 1e-1 })
            .collect();
        let end_frames = [50, 100, 200, 300];
        let error_levels = errors_until(&faulty_sound, &reference, 1, &end_frames);
        for (error, end) in error_levels.iter().zip(end_frames) {
            let reference = &reference[..end];
            let reference_mean = reference.iter().sum::<f64>() / end as f64;
            let square = |x: f64| x * x;
            let difference: f64 = (0..end).map(|n| square(faulty_sound[n] - reference[n])).sum();
            let reference_power: f64 = reference.iter().map(|x| square(x - reference_mean)).sum();
            assert!(
                (error - 10.0 * log10(difference / reference_power)).abs() < 1e-9,
                "{end}"
            );
        }
    }

    #[test]
    fn errors_of_the_worst_output_at_any_place() {
        let loud_output = tone(200);
        let two_outputs = |soft_level: f64, place: f64| -> Vec<f64> {
            let frame_pairs = loud_output.iter().map(|x| [x + place, soft_level * x - place]);
            frame_pairs.flatten().collect()
        };
        let mean = loud_output.iter().sum::<f64>() / 200.0;
        let [square, centred] =
            [0.0, mean].map(|mean| -> f64 { loud_output.iter().map(|x| (x - mean) * (x - mean)).sum() });
        let expected = 10.0 * log10(1e-2 * square / centred);
        for place in [0.0, 5.0] {
            let error_levels = errors_until(&two_outputs(1.1e-3, place), &two_outputs(1e-3, place), 2, &[200]);
            assert!((error_levels[0] - expected).abs() < 1e-6, "{}", error_levels[0]);
        }
    }

    #[test]
    fn errors_of_silence_and_of_equal_sounds() {
        let reference = tone(100);
        let error_level = |sound: &[f64], other: &[f64]| errors_until(sound, other, 1, &[100])[0];
        assert_eq!(error_level(&reference, &reference), f64::NEG_INFINITY);
        assert_eq!(error_level(&[2.0; 100], &[2.5; 100]), f64::NEG_INFINITY);
        assert_eq!(error_level(&reference, &[0.0; 100]), f64::INFINITY);
        assert_eq!(error_level(&[f64::NAN; 100], &reference), f64::INFINITY);
        assert_eq!(errors_until(&[], &[], 1, &[0, 10]), [f64::NEG_INFINITY; 2]);
    }
}
