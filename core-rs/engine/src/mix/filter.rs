//! Filters of second order on a route.

use crate::archive::state;
use crate::maths::{pow, sqrt};
use crate::section::{BUTTERWORTH_2, FilterSection};

/// What a filter does. `f` is its cutoff or corner [Hz], above 0 and below half of the rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FilterKind {
    /// A Butterworth high-pass of order 2.
    Highpass {
        /// Cutoff [Hz], where the gain is -3 dB.
        f: f64,
    },
    /// A Butterworth low-pass of order 2.
    Lowpass {
        /// Cutoff [Hz], where the gain is -3 dB.
        f: f64,
    },
    /// A gain below a corner.
    Lowshelf {
        /// Corner [Hz], where the gain is half of `level` in decibels.
        f: f64,
        /// Gain far below [dB].
        level: f64,
    },
    /// A gain above a corner.
    Highshelf {
        /// Corner [Hz], where the gain is half of `level` in decibels.
        f: f64,
        /// Gain far above [dB].
        level: f64,
    },
}

impl FilterKind {
    /// Its cutoff or corner [Hz].
    #[must_use]
    pub fn frequency(&self) -> f64 {
        match *self {
            Self::Highpass { f } | Self::Lowpass { f } => f,
            Self::Lowshelf { f, .. } | Self::Highshelf { f, .. } => f,
        }
    }

    /// The name of the filter in a score.
    #[must_use]
    pub fn score_word(&self) -> &'static str {
        match self {
            Self::Highpass { .. } => "highpass",
            Self::Lowpass { .. } => "lowpass",
            Self::Lowshelf { .. } => "lowshelf",
            Self::Highshelf { .. } => "highshelf",
        }
    }
}

/// How a filter combines the outputs of its section.
#[derive(Clone, Copy, Debug)]
enum SectionWeights {
    High,
    Low,
    /// Of input, band-pass and low-pass.
    Shelf([f64; 3]),
}

/// A filter that runs.
///
/// Transfer functions are those of Bristow-Johnson's *Audio EQ Cookbook* (W3C Note, 2021): LPF and HPF with Q = 1/√2,
/// lowShelf and highShelf with a slope of 1. They are computed by a trapezoidal state-variable section, mixed as by
/// Simper (*Solving the continuous SVF equations using trapezoidal integration and equivalent currents*, 2013).
#[derive(Clone, Debug)]
pub(super) struct Filter {
    kind: FilterKind,
    section: FilterSection,
    weights: SectionWeights,
}

state!(Filter { section });

impl Filter {
    /// A filter at rest, at `rate` [Hz].
    pub(super) fn new(kind: FilterKind, rate: f64) -> Self {
        let section = |scale| FilterSection::scaled(kind.frequency(), rate, BUTTERWORTH_2, scale);
        let (section, weights) = match kind {
            FilterKind::Highpass { .. } => (section(1.0), SectionWeights::High),
            FilterKind::Lowpass { .. } => (section(1.0), SectionWeights::Low),
            FilterKind::Lowshelf { level, .. } => {
                let root_gain = pow(10.0, level / 40.0);
                let band_weight = BUTTERWORTH_2 * (root_gain - 1.0);
                let weights = SectionWeights::Shelf([1.0, band_weight, root_gain * root_gain - 1.0]);
                (section(1.0 / sqrt(root_gain)), weights)
            }
            FilterKind::Highshelf { level, .. } => {
                let root_gain = pow(10.0, level / 40.0);
                let band_weight = BUTTERWORTH_2 * (1.0 - root_gain) * root_gain;
                let weights = SectionWeights::Shelf([root_gain * root_gain, band_weight, 1.0 - root_gain * root_gain]);
                (section(sqrt(root_gain)), weights)
            }
        };
        Self { kind, section, weights }
    }

    /// Whether both have the same kind and values, so that changing from one to the other makes no step in the sound.
    pub(super) fn is_equal(&self, other: &Self) -> bool {
        self.kind == other.kind
    }

    /// Whether both have the same kind; their values may differ.
    pub(super) fn is_same_kind(&self, other: &Self) -> bool {
        self.kind.score_word() == other.kind.score_word()
    }

    /// Copy the state of another filter.
    pub(super) fn take_over(&mut self, other: &Self) {
        self.section.take_over(&other.section);
    }

    /// Whether both have bitwise equal states.
    pub(super) fn has_same_state(&self, other: &Self) -> bool {
        self.section.is_in_state_of(&other.section)
    }

    /// The section of a high-pass.
    pub(super) fn highpass_section(&mut self) -> Option<&mut FilterSection> {
        matches!(self.weights, SectionWeights::High).then_some(&mut self.section)
    }

    /// Filter samples in place.
    pub(super) fn process(&mut self, signal: &mut [f64]) {
        let mut section = self.section.clone(); // in registers
        match self.weights {
            SectionWeights::High => signal.iter_mut().for_each(|x| *x = section.next(*x).high),
            SectionWeights::Low => signal.iter_mut().for_each(|x| *x = section.next(*x).low),
            SectionWeights::Shelf([input, band, low]) => signal.iter_mut().for_each(|x| {
                let split_bands = section.next(*x);
                *x = input * *x + band * split_bands.band + low * split_bands.low;
            }),
        }
        self.section = section;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::{log10, sincos};
    use std::f64::consts::TAU;

    const RATE: f64 = 48_000.0;

    fn next(filter: &mut Filter, x: f64) -> f64 {
        let mut signal = [x];
        filter.process(&mut signal);
        signal[0]
    }

    /// Level of a filter at a frequency [dB], by a Fourier sum of its impulse response.
    fn level(tone: FilterKind, f: f64) -> f64 {
        let mut filter = Filter::new(tone, RATE);
        let (mut real_sum, mut imaginary_sum) = (0.0, 0.0);
        for i in 0..40_000 {
            let response = next(&mut filter, if i == 0 { 1.0 } else { 0.0 });
            let (sin, cos) = sincos(TAU * f * f64::from(i) / RATE);
            real_sum += response * cos;
            imaginary_sum += response * sin;
        }
        10.0 * log10(real_sum * real_sum + imaginary_sum * imaginary_sum)
    }

    #[test]
    fn filters_have_half_power_at_their_cutoff() {
        for f in [50.0, 1000.0, 15_000.0] {
            let half_power = 10.0 * log10(0.5);
            assert!((level(FilterKind::Lowpass { f }, f) - half_power).abs() < 1e-6);
            assert!((level(FilterKind::Highpass { f }, f) - half_power).abs() < 1e-6);
        }
    }

    #[test]
    fn shelves_at_corner_and_ends() {
        for (f, db) in [(200.0, 6.0), (3000.0, -12.0)] {
            let (low_shelf, high_shelf) = (
                FilterKind::Lowshelf { f, level: db },
                FilterKind::Highshelf { f, level: db },
            );
            assert!((level(low_shelf, 0.5) - db).abs() < 1e-3);
            assert!((level(low_shelf, f) - db / 2.0).abs() < 1e-6);
            assert!(level(low_shelf, 0.5 * RATE).abs() < 1e-6);
            assert!(level(high_shelf, 0.5).abs() < 1e-3);
            assert!((level(high_shelf, f) - db / 2.0).abs() < 1e-6);
            assert!((level(high_shelf, 0.5 * RATE) - db).abs() < 1e-6);
        }
    }

    #[test]
    fn shelf_of_zero_decibels() {
        let mut filter = Filter::new(FilterKind::Highshelf { f: 900.0, level: 0.0 }, RATE);
        for x in [0.3, -1.0, 0.25, 1e-12] {
            assert_eq!(next(&mut filter, x), x);
        }
    }
}
