//! Strokes in a sound: when each begins, and how strong it is.

use crate::hearing::constants::{
    MISSING_POWER_RATIO, ONSET_ENERGY_SHARE, ONSET_POWER_RATIO, ONSET_SEARCH_SECONDS, QUIET_POWER_RATIO,
    SHORTEST_SECONDS, STROKES_HOP,
};
use crate::maths::log10;

/// Errors of the strokes of a sound, each at its worst.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct StrokeErrors {
    /// How early or late the first begins [s].
    pub(super) first: f64,
    /// How early or late the others begin [s].
    pub(super) later: f64,
    /// Level [dB].
    pub(super) level: f64,
}

/// The errors of `sound` against `reference`, both without their means.
pub(super) fn stroke_errors(sound: &[f64], reference: &[f64], rate: f64) -> StrokeErrors {
    let (sound_speeds, reference_speeds) = (frame_differences(sound), frame_differences(reference));
    let frames_in = |seconds: f64| ((seconds * rate) as usize).max(1);
    let stroke_begins = stroke_beginnings(&reference_speeds, frames_in(STROKES_HOP));
    let is_dense = stroke_begins.len() * frames_in(SHORTEST_SECONDS) > reference_speeds.len();
    let stroke_count = if is_dense { 1 } else { stroke_begins.len() };
    let mut worst_errors = StrokeErrors::default();
    for (index, begin) in stroke_begins.into_iter().take(stroke_count).enumerate() {
        let stroke_span = begin..(begin + frames_in(SHORTEST_SECONDS)).min(reference_speeds.len());
        let energy_ratio = energy(&sound_speeds[stroke_span.clone()]) / energy(&reference_speeds[stroke_span]);
        let search_span = begin.saturating_sub(frames_in(ONSET_SEARCH_SECONDS))
            ..(begin + frames_in(ONSET_SEARCH_SECONDS)).min(reference_speeds.len());
        let begin_energy = ONSET_ENERGY_SHARE * energy(&reference_speeds[search_span.clone()]);
        let [sound_begin, reference_begin] = [
            (&sound_speeds, begin_energy * energy_ratio),
            (&reference_speeds, begin_energy),
        ]
        .map(|(frame_differences, begin_energy)| {
            first_frame_above(&frame_differences[search_span.clone()], begin_energy)
        });
        let stroke_delay = (sound_begin as f64 - reference_begin as f64).abs() / rate;
        let worst_delay = if index == 0 {
            &mut worst_errors.first
        } else {
            &mut worst_errors.later
        };
        *worst_delay = worst_delay.max(stroke_delay);
        if !is_dense {
            worst_errors.level = worst_errors.level.max(level_difference_db(energy_ratio));
        }
    }
    if is_dense {
        worst_errors.level = dense_level_error(&sound_speeds, &reference_speeds, frames_in(SHORTEST_SECONDS));
    }
    worst_errors
}

/// Mean difference of the levels of successive spans that are not quiet [dB].
fn dense_level_error(sound: &[f64], reference: &[f64], length: usize) -> f64 {
    let span_energies =
        |frame_differences: &[f64]| -> Vec<f64> { frame_differences.chunks_exact(length).map(energy).collect() };
    let (sound, reference) = (span_energies(sound), span_energies(reference));
    let loudest = reference
        .iter()
        .fold(0.0_f64, |loudest_yet, energy| loudest_yet.max(*energy));
    let loud_spans = sound
        .iter()
        .zip(&reference)
        .filter(|(_, energy)| **energy > QUIET_POWER_RATIO * loudest);
    let (level_sum, n_spans) = loud_spans.fold((0.0, 0), |(level_sum, n_spans), (sound, reference)| {
        (level_sum + level_difference_db(sound / reference), n_spans + 1)
    });
    level_sum / f64::from(n_spans.max(1))
}

/// The frames in which strokes begin, to within a hop.
fn stroke_beginnings(frame_differences: &[f64], hop: usize) -> Vec<usize> {
    let hop_powers: Vec<f64> = frame_differences.chunks(hop).map(energy).collect();
    let loudest = hop_powers
        .iter()
        .fold(0.0_f64, |greatest_so_far, power| greatest_so_far.max(*power));
    let hops_before = (SHORTEST_SECONDS / STROKES_HOP) as usize;
    let is_stroke = |index: &usize| {
        let power_before = hop_powers[index.saturating_sub(hops_before)..*index].iter();
        let power_before = power_before.fold(0.0_f64, |greatest_so_far, power| greatest_so_far.max(*power));
        hop_powers[*index] > (QUIET_POWER_RATIO * loudest).max(ONSET_POWER_RATIO * power_before)
    };
    let mut stroke_hops: Vec<usize> = Vec::new();
    for index in (0..hop_powers.len()).filter(is_stroke) {
        // Power that still rises belongs to the stroke before.
        if stroke_hops
            .last()
            .is_none_or(|last_hop| index > last_hop + hops_before / 5)
        {
            stroke_hops.push(index);
        }
    }
    stroke_hops.into_iter().map(|index| index * hop).collect()
}

/// Differences from frame to frame, in which a stroke begins more suddenly than in positions.
fn frame_differences(sound: &[f64]) -> Vec<f64> {
    sound.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

fn energy(frame_differences: &[f64]) -> f64 {
    frame_differences.iter().map(|speed| speed * speed).sum()
}

/// The first frame at which the energy exceeds `energy_limit`; the last if none does.
fn first_frame_above(frame_differences: &[f64], energy_limit: f64) -> usize {
    let mut energy_sum = 0.0;
    let is_above = |speed: &f64| {
        energy_sum += speed * speed;
        energy_sum > energy_limit
    };
    frame_differences
        .iter()
        .position(is_above)
        .unwrap_or(frame_differences.len())
}

/// The size of a level difference [dB], from a ratio of powers.
fn level_difference_db(power_ratio: f64) -> f64 {
    10.0 * log10(power_ratio.clamp(MISSING_POWER_RATIO, 1.0 / MISSING_POWER_RATIO)).abs()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::maths::{exp, sincos};

    const RATE: f64 = 44_100.0;

    /// Strokes on a partial of 300 Hz that decays in 20 ms, each with its time [s] and size; 0.4 s.
    fn strokes(stroke_pairs: &[(f64, f64)]) -> Vec<f64> {
        let stroke_sample = |n: usize| {
            let time_since = |time: f64| n as f64 / RATE - time;
            let begun_strokes = stroke_pairs.iter().filter(|(time, _)| time_since(*time) >= 0.0);
            begun_strokes
                .map(|(time, amplitude)| {
                    let time_since = time_since(*time);
                    amplitude * exp(-time_since / 0.02) * sincos(TAU * 300.0 * time_since).0
                })
                .sum()
        };
        (0..17_640).map(stroke_sample).collect()
    }

    #[test]
    fn stroke_errors_of_late_and_loud_strokes() {
        let reference = strokes(&[(0.05, 1.0), (0.2, 0.5)]);
        let errors_of = |stroke_list: &[(f64, f64)]| stroke_errors(&strokes(stroke_list), &reference, RATE);
        assert_eq!(errors_of(&[(0.05, 1.0), (0.2, 0.5)]), StrokeErrors::default());
        let late_errors = errors_of(&[(0.051, 1.0), (0.197, 0.5)]);
        assert!((late_errors.first - 1e-3).abs() < 2e-4, "{late_errors:?}");
        assert!((late_errors.later - 3e-3).abs() < 5e-4, "{late_errors:?}");
        let loud_errors = errors_of(&[(0.05, 1.0), (0.2, 0.6)]);
        assert!((loud_errors.level - 1.58).abs() < 0.1, "{loud_errors:?}");
        assert!(loud_errors.later < 1e-4, "{loud_errors:?}");
    }

    #[test]
    fn stroke_errors_of_a_missing_stroke() {
        let reference = strokes(&[(0.05, 1.0), (0.2, 0.5)]);
        let errors = stroke_errors(&strokes(&[(0.05, 1.0)]), &reference, RATE);
        assert!(errors.level > 20.0, "{errors:?}");
        let silence = vec![0.0; reference.len()];
        assert!(stroke_errors(&silence, &reference, RATE).level > 90.0);
        assert_eq!(stroke_errors(&reference, &silence, RATE), StrokeErrors::default());
        assert_eq!(stroke_errors(&[], &[], RATE), StrokeErrors::default());
    }

    #[test]
    fn stroke_errors_of_a_roll_are_those_of_its_level() {
        let roll_sound = |size: f64| -> Vec<f64> {
            let roll_strokes: Vec<(f64, f64)> = (0..13).map(|n| (0.03 * f64::from(n), size)).collect();
            strokes(&roll_strokes)
        };
        let errors = stroke_errors(&roll_sound(1.1), &roll_sound(1.0), RATE);
        assert!((errors.level - 0.83).abs() < 0.05, "{errors:?}");
    }
}
