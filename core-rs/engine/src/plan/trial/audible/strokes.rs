//! Strokes in a sound: when each begins, and how strong it is.

use crate::maths::log10;
use crate::plan::constants::{BEGUN, MISSING, QUIET, REACH, RISE, SHORTEST, STROKES_HOP};

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
    let (ours, theirs) = (speeds(sound), speeds(reference));
    let frames = |seconds: f64| ((seconds * rate) as usize).max(1);
    let begins = beginnings(&theirs, frames(STROKES_HOP));
    let is_dense = begins.len() * frames(SHORTEST) > theirs.len();
    let compared = if is_dense { 1 } else { begins.len() };
    let mut worst = StrokeErrors::default();
    for (index, begin) in begins.into_iter().take(compared).enumerate() {
        let all = begin..(begin + frames(SHORTEST)).min(theirs.len());
        let ratio = energy(&ours[all.clone()]) / energy(&theirs[all]);
        let around = begin.saturating_sub(frames(REACH))..(begin + frames(REACH)).min(theirs.len());
        let enough = BEGUN * energy(&theirs[around.clone()]);
        let [here, there] = [(&ours, enough * ratio), (&theirs, enough)]
            .map(|(speeds, enough)| first_above(&speeds[around.clone()], enough));
        let late = (here as f64 - there as f64).abs() / rate;
        let time = if index == 0 {
            &mut worst.first
        } else {
            &mut worst.later
        };
        *time = time.max(late);
        if !is_dense {
            worst.level = worst.level.max(decibels(ratio));
        }
    }
    if is_dense {
        worst.level = level_of_dense(&ours, &theirs, frames(SHORTEST));
    }
    worst
}

/// Mean difference of the levels of successive spans that are not quiet [dB].
fn level_of_dense(ours: &[f64], theirs: &[f64], length: usize) -> f64 {
    let spans = |speeds: &[f64]| -> Vec<f64> { speeds.chunks_exact(length).map(energy).collect() };
    let (ours, theirs) = (spans(ours), spans(theirs));
    let loudest = theirs
        .iter()
        .fold(0.0_f64, |most, energy| most.max(*energy));
    let loud = ours
        .iter()
        .zip(&theirs)
        .filter(|(_, energy)| **energy > QUIET * loudest);
    let (sum, n_spans) = loud.fold((0.0, 0), |(sum, n_spans), (ours, theirs)| {
        (sum + decibels(ours / theirs), n_spans + 1)
    });
    sum / f64::from(n_spans.max(1))
}

/// The frames in which strokes begin, to within a hop.
fn beginnings(speeds: &[f64], hop: usize) -> Vec<usize> {
    let powers: Vec<f64> = speeds.chunks(hop).map(energy).collect();
    let loudest = powers.iter().fold(0.0_f64, |most, power| most.max(*power));
    let n_before = (SHORTEST / STROKES_HOP) as usize;
    let is_stroke = |index: &usize| {
        let before = powers[index.saturating_sub(n_before)..*index].iter();
        let before = before.fold(0.0_f64, |most, power| most.max(*power));
        powers[*index] > (QUIET * loudest).max(RISE * before)
    };
    let mut begins: Vec<usize> = Vec::new();
    for index in (0..powers.len()).filter(is_stroke) {
        // Power that still rises belongs to the stroke before.
        if begins.last().is_none_or(|last| index > last + n_before / 5) {
            begins.push(index);
        }
    }
    begins.into_iter().map(|index| index * hop).collect()
}

/// Differences from frame to frame, in which a stroke begins more suddenly than in positions.
fn speeds(sound: &[f64]) -> Vec<f64> {
    sound.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

fn energy(speeds: &[f64]) -> f64 {
    speeds.iter().map(|speed| speed * speed).sum()
}

/// The first frame at which the energy exceeds `enough`; the last if none does.
fn first_above(speeds: &[f64], enough: f64) -> usize {
    let mut sum = 0.0;
    let is_above = |speed: &f64| {
        sum += speed * speed;
        sum > enough
    };
    speeds.iter().position(is_above).unwrap_or(speeds.len())
}

/// The size of a level difference [dB].
fn decibels(ratio: f64) -> f64 {
    10.0 * log10(ratio.clamp(MISSING, 1.0 / MISSING)).abs()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::maths::{exp, sincos};

    const RATE: f64 = 44_100.0;

    /// Strokes on a partial of 300 Hz that decays in 20 ms, each with its time [s] and size; 0.4 s.
    fn strokes(each: &[(f64, f64)]) -> Vec<f64> {
        let sample = |n: usize| {
            let since = |time: f64| n as f64 / RATE - time;
            let begun = each.iter().filter(|(time, _)| since(*time) >= 0.0);
            begun
                .map(|(time, size)| {
                    let since = since(*time);
                    size * exp(-since / 0.02) * sincos(TAU * 300.0 * since).0
                })
                .sum()
        };
        (0..17_640).map(sample).collect()
    }

    #[test]
    fn stroke_errors_of_late_and_loud_strokes() {
        let reference = strokes(&[(0.05, 1.0), (0.2, 0.5)]);
        let errors = |each: &[(f64, f64)]| stroke_errors(&strokes(each), &reference, RATE);
        assert_eq!(errors(&[(0.05, 1.0), (0.2, 0.5)]), StrokeErrors::default());
        let late = errors(&[(0.051, 1.0), (0.197, 0.5)]);
        assert!((late.first - 1e-3).abs() < 2e-4, "{late:?}");
        assert!((late.later - 3e-3).abs() < 5e-4, "{late:?}");
        let loud = errors(&[(0.05, 1.0), (0.2, 0.6)]);
        assert!((loud.level - 1.58).abs() < 0.1, "{loud:?}");
        assert!(loud.later < 1e-4, "{loud:?}");
    }

    #[test]
    fn stroke_errors_of_a_missing_stroke() {
        let reference = strokes(&[(0.05, 1.0), (0.2, 0.5)]);
        let errors = stroke_errors(&strokes(&[(0.05, 1.0)]), &reference, RATE);
        assert!(errors.level > 20.0, "{errors:?}");
        let silence = vec![0.0; reference.len()];
        assert!(stroke_errors(&silence, &reference, RATE).level > 90.0);
        assert_eq!(
            stroke_errors(&reference, &silence, RATE),
            StrokeErrors::default()
        );
        assert_eq!(stroke_errors(&[], &[], RATE), StrokeErrors::default());
    }

    #[test]
    fn stroke_errors_of_a_roll_are_those_of_its_level() {
        let roll = |size: f64| -> Vec<f64> {
            let each: Vec<(f64, f64)> = (0..13).map(|n| (0.03 * f64::from(n), size)).collect();
            strokes(&each)
        };
        let errors = stroke_errors(&roll(1.1), &roll(1.0), RATE);
        assert!((errors.level - 0.83).abs() < 0.05, "{errors:?}");
    }
}
