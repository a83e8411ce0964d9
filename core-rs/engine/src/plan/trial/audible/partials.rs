//! Pitch and decay of the strongest partials in two runs, by demodulation: both are shifted by −f and smoothed. The
//! slopes of the argument of their ratio and of their log levels, weighted by power, give the differences of frequency
//! and decay.

use std::f64::consts::{PI, TAU};

use crate::maths::{atan2, log, log2, sincos};
use crate::plan::constants::{PARTIALS_HOP, PARTIALS_MAX, QUIET, SHORTEST, STRAIGHT, WINDOWS_MIN};
use crate::plan::trial::third_octaves::{length, powers};

/// Largest error of a pitch [cents], and of a T60 relative to itself, among partials up to `upto` [Hz]; `b` is the
/// reference.
pub(super) fn pitch_errors(a: &[f64], b: &[f64], rate: f64, upto: f64) -> (f64, f64) {
    let partials = strongest(b, rate, upto).into_iter();
    partials.fold((0.0, 0.0), |(cents, t60), f| {
        let (cents_here, t60_here) = compare(a, b, f, rate).unwrap_or((0.0, 0.0));
        (f64::max(cents, cents_here), f64::max(t60, t60_here))
    })
}

/// Frequencies of the strongest partials [Hz], each a maximum within the resolution of the window.
fn strongest(x: &[f64], rate: f64, upto: f64) -> Vec<f64> {
    let window = window_from_beginning(x.len(), (0.5 * SHORTEST * rate) as usize);
    let powers = powers(x.iter().zip(window).map(|(x, w)| x * w).collect());
    let bin = rate / length(x.len()) as f64;
    let reach = ((2.0 / SHORTEST / bin) as usize).max(2);
    let last = ((upto / bin) as usize).min(powers.len().saturating_sub(1));
    let is_top = |index: &usize| {
        let around = &powers[index - reach.min(*index)..(index + reach + 1).min(powers.len())];
        powers[*index] > 0.0 && around.iter().all(|power| *power <= powers[*index])
    };
    let mut tops: Vec<usize> = (reach..last).filter(is_top).collect();
    tops.sort_by(|a, b| powers[*b].total_cmp(&powers[*a]));
    tops.truncate(PARTIALS_MAX);
    let loudest = tops.first().map_or(0.0, |top| powers[*top]);
    tops.retain(|top| powers[*top] >= QUIET * loudest);
    tops.into_iter().map(|top| top as f64 * bin).collect()
}

/// Error of the pitch [cents] and of the T60, relative to itself, of the partial near `f` [Hz]; `None` if the sound is
/// too short.
fn compare(a: &[f64], b: &[f64], f: f64, rate: f64) -> Option<(f64, f64)> {
    let (ours, theirs) = (baseband(a, f, rate), baseband(b, f, rate));
    if theirs.len() < WINDOWS_MIN {
        return None;
    }
    let weights: Vec<f64> = theirs.iter().map(|[re, im]| re * re + im * im).collect();
    // ours/theirs: its argument turns little from one window to the next.
    let ratios = ours.iter().zip(&theirs);
    let ratios: Vec<[f64; 2]> = ratios.map(|(a, b)| times(*a, [b[0], -b[1]])).collect();
    let drift = slope(&unwrapped(&ratios), &weights).0 / (TAU * PARTIALS_HOP);
    let level = |[re, im]: &[f64; 2]| 0.5 * log((re * re + im * im).max(f64::MIN_POSITIVE));
    let levels = |of: &[[f64; 2]]| -> Vec<f64> { of.iter().map(level).collect() };
    let (falls, rest) = slope(&levels(&theirs), &weights);
    let (ours, _) = slope(&levels(&ours), &weights);
    let cents = 1200.0 * log2((1.0 + drift / f).max(f64::MIN_POSITIVE)).abs();
    let is_decay = rest < STRAIGHT && -falls * theirs.len() as f64 > STRAIGHT;
    // The ratio of the T60s, less 1.
    let t60 = if is_decay && ours < 0.0 {
        (falls / ours - 1.0).abs()
    } else {
        0.0
    };
    Some((cents, t60))
}

/// A sound shifted by −f and smoothed, once every `PARTIALS_HOP`.
fn baseband(x: &[f64], f: f64, rate: f64) -> Vec<[f64; 2]> {
    let size = ((SHORTEST * rate) as usize).max(4);
    let hop = ((PARTIALS_HOP * rate) as usize).max(1);
    let shifted: Vec<[f64; 2]> = x
        .iter()
        .enumerate()
        .map(|(n, x)| {
            let (sin, cos) = sincos(-TAU * f * n as f64 / rate);
            [x * cos, x * sin]
        })
        .collect();
    let window = hann(size);
    let smooth = |index: usize| {
        let products = shifted[index..index + size].iter().zip(&window);
        products.fold([0.0; 2], |sum, (x, w)| {
            [sum[0] + w * x[0], sum[1] + w * x[1]]
        })
    };
    let last = x.len().checked_sub(size);
    last.map_or_else(Vec::new, |last| {
        (0..=last).step_by(hop).map(smooth).collect()
    })
}

/// A window of `size` that rises within `rise` and then falls to the end: partials that fade fast are strong only at
/// the beginning, where a symmetric window hardly weights them.
fn window_from_beginning(size: usize, rise: usize) -> Vec<f64> {
    let rise = rise.min(size / 2);
    let [rising, falling] = [rise, size - rise].map(|half| hann(2 * half));
    [&rising[..rise], &falling[size - rise..]].concat()
}

fn hann(size: usize) -> Vec<f64> {
    let weight = |n: usize| {
        let s = sincos(PI * (n as f64 + 0.5) / size as f64).0;
        s * s
    };
    (0..size).map(weight).collect()
}

fn times(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

/// The arguments, unwrapped.
fn unwrapped(values: &[[f64; 2]]) -> Vec<f64> {
    let mut last = [1.0, 0.0];
    let mut sum = 0.0;
    let turn = |turned: &[f64; 2]| {
        let by = times(*turned, [last[0], -last[1]]);
        sum += if by == [0.0; 2] {
            0.0
        } else {
            atan2(by[1], by[0])
        };
        last = *turned;
        sum
    };
    values.iter().map(turn).collect()
}

/// The straight line that fits best by weighted least squares: its slope from one value to the next, and its residual
/// (rms).
fn slope(values: &[f64], weights: &[f64]) -> (f64, f64) {
    let total: f64 = weights.iter().sum();
    if total <= 0.0 {
        return (0.0, 0.0);
    }
    let mean = |value_of: &dyn Fn(usize) -> f64| -> f64 {
        let each = weights.iter().enumerate();
        each.map(|(i, weight)| weight * value_of(i)).sum::<f64>() / total
    };
    let (t, y) = (mean(&|i| i as f64), mean(&|i| values[i]));
    let spread = mean(&|i| (i as f64 - t) * (i as f64 - t));
    if spread <= 0.0 {
        return (0.0, 0.0);
    }
    let by = mean(&|i| (i as f64 - t) * (values[i] - y)) / spread;
    let rest = mean(&|i| {
        let off = values[i] - y - by * (i as f64 - t);
        off * off
    });
    (by, rest.sqrt())
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
        let b = sound((220.0, 8.0), (1_310.0, 20.0));
        let (cents, t60) = pitch_errors(&b, &b, RATE, 5_000.0);
        assert_eq!((cents, t60), (0.0, 0.0));
        // 5 cents, and a T60 that is a tenth longer.
        let a = sound((220.0, 8.0), (1_310.0 * 1.002_892, 20.0 / 1.1));
        let (cents, t60) = pitch_errors(&a, &b, RATE, 5_000.0);
        assert!((cents - 5.0).abs() < 0.2, "{cents}");
        assert!((t60 - 0.1).abs() < 0.01, "{t60}");
        // Partials above `upto` are not compared.
        assert!(pitch_errors(&a, &b, RATE, 1_000.0).0 < 0.3);
    }

    #[test]
    fn pitch_errors_of_a_fast_fading_partial() {
        // 20 dB below the other at the beginning, and 60 dB lower after 115 ms of 300.
        let b = sound((110.0, 20.0), (450.0, 60.0));
        let a = sound((110.0, 20.0), (450.0 * 1.002_892, 60.0));
        let (cents, _) = pitch_errors(&a, &b, RATE, 5_000.0);
        assert!((cents - 5.0).abs() < 0.2, "{cents}");
    }

    #[test]
    fn pitch_errors_of_short_and_silent_sounds_are_zero() {
        assert_eq!(pitch_errors(&[], &[], RATE, 5_000.0), (0.0, 0.0));
        assert_eq!(
            pitch_errors(&[0.0; 500], &[0.0; 500], RATE, 5_000.0),
            (0.0, 0.0)
        );
        let b = sound((220.0, 8.0), (1_310.0, 20.0));
        let silence = vec![0.0; b.len()];
        let (cents, t60) = pitch_errors(&silence, &b, RATE, 5_000.0);
        assert!(cents.is_finite() && t60.is_finite());
    }
}
