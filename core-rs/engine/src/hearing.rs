//! What is heard of the difference of two sounds: pitch and decay of the strongest partials, levels of third octaves,
//! and when strokes begin and how strong they are.

mod constants;
mod levels;
mod partials;
mod strokes;
pub(crate) mod third_octaves;

pub use constants::JUST_NOTICEABLE;
pub(crate) use constants::{HIGHEST_AUDIBLE, QUIET_POWER_RATIO, SHORTEST_SECONDS};
use constants::{MEAN_ROUNDING_SHARE, MOTION_START_SHARE, SIGNIFICANT_DEVIATIONS};

/// What becomes of differences of pitch and decay that chance may explain: a partial that contacts disturb wavers, and a
/// line through its level or phase has another slope after the smallest change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scatter {
    Counted,
    Deducted,
}

impl Scatter {
    /// Differences count as far as they exceed so many of their standard deviations.
    const fn deviations(self) -> f64 {
        match self {
            Self::Counted => 0.0,
            Self::Deducted => SIGNIFICANT_DEVIATIONS,
        }
    }
}

/// The audible error of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Audible {
    /// Largest error of a pitch among the strongest partials [cents].
    pub cents: f64,
    /// Largest error of a T60 among them, relative to the T60.
    pub t60: f64,
    /// Largest error of the level of a third octave that the others do not mask [dB].
    pub level: f64,
    /// How early or late the first stroke begins [s].
    pub first_stroke: f64,
    /// How early or late a later stroke begins [s].
    pub later_stroke: f64,
    /// Largest error of the level of a stroke [dB].
    pub stroke_level: f64,
}

impl Audible {
    /// The error of a run against a finer one of the same length (n_frames · n_out), at `rate` [Hz], with partials up
    /// to `frequency_max` [Hz]. Both are compared from where the finer one begins to sound.
    pub(crate) fn new(
        (run, finer): (&[f64], &[f64]),
        n_out: usize,
        rate: f64,
        frequency_max: f64,
        scatter: Scatter,
    ) -> Self {
        let n_outputs = n_out.max(1);
        (0..n_outputs).fold(Self::default(), |worst, output| {
            let [run_sound, finer_sound] = [run, finer]
                .map(|sound| -> Vec<f64> { sound.iter().skip(output).step_by(n_outputs).copied().collect() });
            let sound_begin = begin_of_sound(&finer_sound);
            let [run_sound, finer_sound] = [run_sound, finer_sound].map(|sound| without_mean(&sound[sound_begin..]));
            let (cents, t60) = partials::pitch_errors(&run_sound, &finer_sound, rate, frequency_max, scatter);
            let strokes = strokes::stroke_errors(&run_sound, &finer_sound, rate);
            worst.with(Self {
                cents,
                t60,
                level: levels::level_error(&run_sound, &finer_sound, rate),
                first_stroke: strokes.first,
                later_stroke: strokes.later,
                stroke_level: strokes.level,
            })
        })
    }

    /// The larger of two errors, measure by measure.
    pub(crate) fn with(self, other: Self) -> Self {
        let [first_errors, other_errors] = [self, other].map(|error| error.values());
        Self::from(std::array::from_fn(|i| first_errors[i].max(other_errors[i])))
    }

    /// Both errors in the worst case: the sum of each.
    pub(crate) fn plus(self, other: Self) -> Self {
        let [first_errors, other_errors] = [self, other].map(|error| error.values());
        Self::from(std::array::from_fn(|i| first_errors[i] + other_errors[i]))
    }

    /// All errors, in the order of `JUST_NOTICEABLE`.
    pub fn values(&self) -> [f64; JUST_NOTICEABLE.len()] {
        [
            self.cents,
            self.t60,
            self.level,
            self.first_stroke,
            self.later_stroke,
            self.stroke_level,
        ]
    }

    /// The largest of them, as a multiple of what is just noticeable.
    pub(crate) fn worst_excess(&self) -> f64 {
        let error_limits = self.values().into_iter().zip(JUST_NOTICEABLE);
        error_limits
            .map(|(error, threshold)| error / threshold)
            .fold(0.0, f64::max)
    }
}

impl From<[f64; JUST_NOTICEABLE.len()]> for Audible {
    fn from(values: [f64; JUST_NOTICEABLE.len()]) -> Self {
        let [cents, t60, level, first_stroke, later_stroke, stroke_level] = values;
        Self {
            cents,
            t60,
            level,
            first_stroke,
            later_stroke,
            stroke_level,
        }
    }
}

/// The frame before the first in which a sound has moved.
fn begin_of_sound(sound: &[f64]) -> usize {
    let first_sample = sound.first().copied().unwrap_or(0.0);
    let motion = |x: &f64| (x - first_sample).abs();
    let largest = sound.iter().map(motion).fold(0.0, f64::max);
    let is_moving = |x: &f64| motion(x) > MOTION_START_SHARE * largest;
    sound.iter().position(is_moving).unwrap_or(0).saturating_sub(1)
}

/// The sound without its mean, which is not audible, nor what is rounding.
fn without_mean(sound: &[f64]) -> Vec<f64> {
    let mean = sound.iter().sum::<f64>() / sound.len().max(1) as f64;
    let largest = sound.iter().fold(0.0_f64, |max, x| max.max(x.abs()));
    let cut_rounding = |x: f64| {
        if x.abs() > MEAN_ROUNDING_SHARE * largest {
            x
        } else {
            0.0
        }
    };
    sound.iter().map(|x| cut_rounding(x - mean)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn begin_of_sound_after_rest() {
        let begin_of = |x: &[f64]| begin_of_sound(x);
        assert_eq!(begin_of(&[3.0, 3.0, 3.0, 4.0, 3.0]), 2);
        assert_eq!(begin_of(&[3.0, 4.0, 3.0]), 0);
        assert_eq!((begin_of(&[1.0; 4]), begin_of(&[])), (0, 0));
    }

    #[test]
    fn audible_ignores_rounding_at_rest() {
        let resting_sound = |ulp: f64| -> Vec<f64> {
            let noise_sample = |i: u32| -9.8e-5 + ulp * f64::from(i.count_ones() % 2);
            (0..9_600).map(noise_sample).collect()
        };
        let audible = |ulp: f64| {
            let (run, finer) = (resting_sound(ulp), resting_sound(2.0 * ulp));
            Audible::new((&run, &finer), 1, 32_000.0, 5_000.0, Scatter::Counted)
        };
        assert_eq!(audible(1e-20), Audible::default());
        assert!(audible(1e-9).level > 5.0);
    }
}
