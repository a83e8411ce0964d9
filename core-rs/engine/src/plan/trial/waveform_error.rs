//! How far apart two runs of the same beginning are, and which errors follow from that.

use crate::assembly::budget::Budget;
use crate::assembly::unit::IslandPlan;
use crate::hearing::{Audible, Scatter};
use crate::maths::{amplitude_ratio, log10, pow, sqrt};
use crate::plan::constants::{EARLY_MARGIN_DB, EARLY_SPAN_DIVISOR, PILOT_SECONDS, PILOT_SPANS};
use crate::plan::trial::pilot_run::frames_per_second;
use crate::waveform::worst_ratio;

/// A factor of 2 [dB]: what an error of order 1 falls by when the step is halved.
pub(in crate::plan) const FACTOR_TWO_DB: f64 = 6.02;

/// The sum of two independent errors, by power [dB].
pub(in crate::plan) fn power_sum_db(error: f64, other: f64) -> f64 {
    let power_ratio = |db: f64| pow(10.0, db / 10.0);
    10.0 * log10(power_ratio(error) + power_ratio(other))
}

/// The sum of several errors in the worst case, by amplitude [dB].
pub(in crate::plan) fn amplitude_sum_db(errors: impl IntoIterator<Item = f64>) -> f64 {
    20.0 * log10(errors.into_iter().map(amplitude_ratio).sum::<f64>().max(1e-15))
}

/// The difference of two errors by amplitude [dB]: what is left of a budget, or of a measured difference, after an
/// error; practically nothing if the second is larger.
pub(in crate::plan) fn amplitude_difference_db(total_error: f64, known_error: f64) -> f64 {
    20.0 * log10((amplitude_ratio(total_error) - amplitude_ratio(known_error)).max(1e-15))
}

/// The spans over which sounds are compared: from the start to one third of the time after the first event, to two
/// thirds, and to the end.
pub(in crate::plan) struct ComparedSpans {
    pub(in crate::plan) n_out: usize,
    /// Frames a second [Hz].
    pub(in crate::plan) rate: f64,
    pub(in crate::plan) span_ends: [usize; 3],
}

impl ComparedSpans {
    pub(in crate::plan) fn new(island_plan: &IslandPlan, n_frames: usize) -> Self {
        let rate = frames_per_second(island_plan);
        // Rounded up: the frame of the event belongs to the spans.
        let third_frames = (PILOT_SECONDS / 3.0 * rate).ceil() as usize;
        Self {
            n_out: island_plan.network.outputs().len(),
            span_ends: [2, 1, 0].map(|thirds| n_frames.saturating_sub(thirds * third_frames)),
            rate,
        }
    }

    /// The audible error of a run against a finer one of the same length; `None` unless the budget is one of pitch.
    pub(in crate::plan) fn audible_error(
        &self,
        budget: &Budget,
        sound_pair: (&[f64], &[f64]),
        scatter: Scatter,
    ) -> Option<Audible> {
        match *budget {
            Budget::Cents {
                frequency_hz_max: frequency_max,
                ..
            } => Some(Audible::new(sound_pair, self.n_out, self.rate, frequency_max, scatter)),
            Budget::Error(_) | Budget::Method(_) => None,
        }
    }

    /// The first event [frames].
    pub(in crate::plan) fn event_frame(&self) -> usize {
        let [first_end, second_end, last_end] = self.span_ends;
        first_end.saturating_sub(last_end - second_end)
    }

    /// The same spans over a shorter time after the first event: `parts` of `PILOT_SPANS`, at least one.
    pub(in crate::plan) fn shortened(&self, parts: usize) -> Self {
        let event_frame = self.event_frame();
        let third_frames = (self.end() - event_frame) * parts.clamp(1, PILOT_SPANS) / PILOT_SPANS / 3;
        let end_frame = event_frame + 3 * third_frames;
        Self {
            span_ends: [2, 1, 0].map(|thirds| end_frame - thirds * third_frames),
            ..*self
        }
    }

    /// Where the last span ends [frames].
    pub(in crate::plan) fn end(&self) -> usize {
        self.span_ends[2]
    }

    /// Frames after which an unfinished run is compared, so that it may be stopped early: one in the first span, and
    /// the ends of all spans but the last.
    pub(in crate::plan) fn checkpoints(&self) -> [usize; 3] {
        let [first_end, second_end, _] = self.span_ends;
        [
            first_end - (first_end - self.event_frame()) * (EARLY_SPAN_DIVISOR - 1) / EARLY_SPAN_DIVISOR,
            first_end,
            second_end,
        ]
    }

    /// The same spans, cut off at `n_frames`.
    pub(in crate::plan) fn limited_to(&self, n_frames: usize) -> Self {
        Self {
            span_ends: self.span_ends.map(|n| n.min(n_frames)),
            ..*self
        }
    }
}

/// A run that is compared with another one while it is played.
pub(in crate::plan) struct EarlyComparison<'a> {
    reference_sound: &'a [f64],
    spans: &'a ComparedSpans,
    /// Checkpoints already passed.
    n_checked: usize,
    /// Lower bound of the difference over the whole run [dB].
    pub(in crate::plan) lower_bound_db: f64,
}

impl<'a> EarlyComparison<'a> {
    pub(in crate::plan) fn with_reference(reference: &'a [f64], spans: &'a ComparedSpans) -> Self {
        Self {
            reference_sound: reference,
            spans,
            n_checked: 0,
            lower_bound_db: f64::NEG_INFINITY,
        }
    }

    /// Returns the lower bound of the difference over the whole run [dB] if another checkpoint is passed after
    /// `n_frames` of its sound.
    pub(in crate::plan) fn update(&mut self, n_frames: usize, sound: &[f64]) -> Option<f64> {
        let checkpoints = self.spans.checkpoints();
        let checks_passed = checkpoints.iter().filter(|checkpoint| **checkpoint <= n_frames).count();
        if checks_passed <= self.n_checked {
            return None;
        }
        self.n_checked = checks_passed;
        let early_margin = if checks_passed == 1 { EARLY_MARGIN_DB } else { 0.0 };
        let early_spans = self.spans.limited_to(checkpoints[checks_passed - 1]);
        let bound_level = difference_db(sound, self.reference_sound, &early_spans) - early_margin;
        self.lower_bound_db = self.lower_bound_db.max(bound_level);
        Some(self.lower_bound_db)
    }
}

/// ‖a − b‖ / ‖b‖ [dB], the worst over outputs and spans; the mean of `b` does not count as sound.
pub(in crate::plan) fn difference_db(a: &[f64], b: &[f64], spans: &ComparedSpans) -> f64 {
    let span_ratios = spans.span_ends.map(|n| worst_ratio(a, b, spans.n_out, n));
    20.0 * log10(sqrt(span_ratios.into_iter().fold(0.0, f64::max)).max(1e-15))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One output at 1 kHz: an event after 60 ms, then 0.3 s.
    fn spans() -> ComparedSpans {
        ComparedSpans {
            n_out: 1,
            rate: 1_000.0,
            span_ends: [160, 260, 360],
        }
    }

    #[test]
    fn amplitude_difference_inverts_amplitude_sum() {
        for (one, other) in [(-40.0, -46.0), (-80.0, -40.0), (-3.0, -3.0)] {
            assert!((amplitude_difference_db(amplitude_sum_db([one, other]), other) - one).abs() < 1e-9);
        }
        assert!((amplitude_sum_db([-40.0, -40.0]) + 40.0 - FACTOR_TWO_DB).abs() < 0.01);
        assert!(amplitude_difference_db(-60.0, -40.0) <= -300.0);
    }

    #[test]
    fn shortened_spans_keep_the_event() {
        let full_spans = spans();
        assert_eq!((full_spans.event_frame(), full_spans.end()), (60, 360));
        for (parts, end) in [(0, 108), (1, 108), (3, 210), (4, 258), (6, 360), (99, 360)] {
            let short_spans = full_spans.shortened(parts);
            assert_eq!((short_spans.event_frame(), short_spans.end()), (60, end));
        }
    }

    /// Two notes that begin at the event, of which the first also has the error `error_at`.
    fn notes(error_at: impl Fn(usize) -> f64) -> (Vec<f64>, Vec<f64>) {
        let note_sample = |n: usize| crate::maths::sin(0.7 * n.saturating_sub(60) as f64);
        let all_frames = 0..360_usize;
        (
            all_frames.clone().map(|n| note_sample(n) + error_at(n)).collect(),
            all_frames.map(note_sample).collect(),
        )
    }

    #[test]
    fn early_comparison_never_exceeds_the_full_difference() {
        let spans = spans();
        let growing_error = |n: usize| 1e-6 * (n as f64 - 60.0).max(0.0);
        let early_error = |n: usize| if (60..85).contains(&n) { 1e-3 } else { 1e-9 };
        for (a, b) in [notes(growing_error), notes(early_error)] {
            let mut comparison = EarlyComparison::with_reference(&b, &spans);
            let full_difference = difference_db(&a, &b, &spans);
            let mut bound_count = 0;
            for end in (0..=360).step_by(24) {
                if let Some(error_bound) = comparison.update(end, &a[..end]) {
                    bound_count += 1;
                    assert!(
                        error_bound <= full_difference + 1e-9,
                        "{error_bound} of {full_difference} after {end}"
                    );
                }
            }
            assert_eq!(bound_count, 3);
            assert!(comparison.lower_bound_db > full_difference - EARLY_MARGIN_DB);
        }
    }
}
