//! How far apart two runs of one beginning are, and what errors that tells.

use crate::maths::{log10, pow, sqrt};
use crate::plan::IslandPlan;
use crate::plan::trial::pilot_run::AFTER;

/// Errors fall with the square of the step at best, with its first power at least.
pub(in crate::plan) const ORDERS: (f64, f64) = (1.0, 2.0);
/// By so much an error of order 1 falls with a doubling [dB].
pub(in crate::plan) const DOUBLING: f64 = 6.02;

/// Errors of S and of 2S [dB] by what they differ by, and S/2 and S before them: a change that falls faster than
/// by the order `most` is luck, for it matters where between two instants a contact closes.
pub(in crate::plan) fn errors(change: f64, last: Option<f64>, most: f64) -> (f64, f64) {
    let least = ORDERS.0;
    let believed = last.map_or(change, |last| change.max(last - most * DOUBLING));
    let order = last.map_or(least, |last| {
        ((last - believed) / DOUBLING).clamp(least, most)
    });
    let falls = pow(2.0, order);
    (
        believed + 20.0 * log10(falls / (falls - 1.0)),
        believed - 20.0 * log10(falls - 1.0),
    )
}

/// What is stated of an error where a law has kinks or friction lets go, by the error `before` of twice the step: where
/// such an instant lies within a step is luck, so what it leaves falls with the first power of the step at most.
pub(in crate::plan) fn with_kinks(error: f64, before: Option<f64>) -> f64 {
    before.map_or(error, |before| error.max(before - DOUBLING))
}

/// Two errors that have nothing to do with each other, together [dB].
pub(in crate::plan) fn beside(one: f64, other: f64) -> f64 {
    let power = |db: f64| pow(10.0, db / 10.0);
    10.0 * log10(power(one) + power(other))
}

/// Where sounds are compared: from the start to a third of the time after the first event, to two thirds, to all.
pub(in crate::plan) struct Spans {
    pub(in crate::plan) n_out: usize,
    /// Frames a second [Hz].
    pub(in crate::plan) rate: f64,
    frames: [usize; 3],
}

impl Spans {
    pub(in crate::plan) fn of(island_plan: &IslandPlan, n_frames: usize) -> Self {
        let rate = island_plan.timeline.rate.hertz() / f64::from(island_plan.oversampling);
        let third = (AFTER / 3.0 * rate) as usize;
        Self {
            n_out: island_plan.network.outputs().len(),
            frames: [2, 1, 0].map(|thirds| n_frames.saturating_sub(thirds * third)),
            rate,
        }
    }

    /// The first event [frames].
    pub(in crate::plan) fn event(&self) -> usize {
        let [first, second, all] = self.frames;
        first.saturating_sub(all - second)
    }

    /// Only so many frames.
    pub(in crate::plan) fn within(&self, n_frames: usize) -> Self {
        Self {
            frames: self.frames.map(|n| n.min(n_frames)),
            ..*self
        }
    }
}

/// ‖a − b‖ / ‖b‖ [dB] of the output and over the span where it is worst; that something stands aside is no sound.
pub(in crate::plan) fn difference(a: &[f64], b: &[f64], spans: &Spans) -> f64 {
    let of = |output: usize, n_frames: usize| {
        let own = |x: &[f64]| -> Vec<f64> {
            let own = x.iter().skip(output).step_by(spans.n_out);
            own.take(n_frames).copied().collect()
        };
        let (a, b) = (own(a), own(b));
        let mean = b.iter().sum::<f64>() / b.len().max(1) as f64;
        let apart: f64 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
        let whole: f64 = b.iter().map(|b| (b - mean) * (b - mean)).sum();
        if apart > 0.0 { apart / whole } else { 0.0 }
    };
    let all = (0..spans.n_out).flat_map(|output| spans.frames.map(|n| of(output, n)));
    20.0 * log10(sqrt(all.fold(0.0, f64::max)).max(1e-15))
}
