//! What is heard of the difference of two runs: pitch and decay of the strongest partials, and levels of third octaves.

mod levels;
mod partials;

use crate::plan::budget::{Budget, LEAST_HEARD};
use crate::plan::trial::pilot_run::PilotRun;
use crate::plan::trial::waveform_error::Spans;

/// The audible error of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Audible {
    /// Largest error of a pitch among the strongest partials [cents].
    pub cents: f64,
    /// Largest error of a T60 among them, relative to the T60.
    pub t60: f64,
    /// Largest error of the level of a third octave that the others do not mask [dB].
    pub level: f64,
}

/// What differs from the mean by less than this share of the largest position is rounding, and no sound.
const ROUNDING: f64 = 1e-14;

impl Audible {
    /// The error of a run against one at half its step, from the first event on, with partials up to `upto` [Hz].
    pub(in crate::plan) fn of(run: &[f64], finer: &[f64], spans: &Spans, upto: f64) -> Self {
        let n_out = spans.n_out.max(1);
        let from = spans.event() * n_out;
        let one = |x: &[f64], output: usize| -> Vec<f64> {
            let own: Vec<f64> = x[from..]
                .iter()
                .skip(output)
                .step_by(n_out)
                .copied()
                .collect();
            let mean = own.iter().sum::<f64>() / own.len().max(1) as f64;
            let largest = own.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            let sounds = |x: f64| if x.abs() > ROUNDING * largest { x } else { 0.0 };
            own.iter().map(|x| sounds(x - mean)).collect()
        };
        (0..n_out).fold(Self::default(), |worst, output| {
            let (ours, theirs) = (one(run, output), one(finer, output));
            let (cents, t60) = partials::pitch_errors(&ours, &theirs, spans.rate, upto);
            worst.with(Self {
                cents,
                t60,
                level: levels::level_error(&ours, &theirs, spans.rate),
            })
        })
    }

    /// The same if the budget is one of pitch and the run is not lost; else `None`.
    pub(in crate::plan) fn of_budget(
        budget: &Budget,
        (run, finer): (&PilotRun, &[f64]),
        spans: &Spans,
    ) -> Option<Self> {
        match *budget {
            Budget::Cents { upto, .. } if !run.is_lost => {
                Some(Self::of(&run.sound, finer, spans, upto))
            }
            _ => None,
        }
    }

    /// The larger error of each.
    pub(in crate::plan) fn with(self, other: Self) -> Self {
        Self {
            cents: self.cents.max(other.cents),
            t60: self.t60.max(other.t60),
            level: self.level.max(other.level),
        }
    }

    /// All three errors, multiplied by `by`.
    pub(in crate::plan) fn times(self, by: f64) -> Self {
        Self {
            cents: by * self.cents,
            t60: by * self.t60,
            level: by * self.level,
        }
    }

    /// The largest of the three, as a multiple of what a budget of pitch allows; 0 for any other budget.
    pub(in crate::plan) fn excess(&self, budget: &Budget) -> f64 {
        match *budget {
            Budget::Cents { cents, .. } => {
                let own = [self.cents, self.t60, self.level].into_iter();
                let all = own.zip(LEAST_HEARD).map(|(own, least)| own / least);
                all.fold(0.0, f64::max) * LEAST_HEARD[0] / cents
            }
            Budget::Error(_) | Budget::Method(_) => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_of_a_place_at_rest_is_not_heard() {
        let spans = Spans {
            n_out: 1,
            rate: 32_000.0,
            frames: [3_200, 6_400, 9_600],
        };
        let rests = |ulp: f64| -> Vec<f64> {
            let of = |i: u32| -9.8e-5 + ulp * f64::from(i.count_ones() % 2);
            (0..9_600).map(of).collect()
        };
        let heard = |ulp: f64| Audible::of(&rests(ulp), &rests(2.0 * ulp), &spans, 5_000.0);
        assert_eq!(heard(1e-20), Audible::default());
        assert!(heard(1e-9).level > 5.0);
    }
}
