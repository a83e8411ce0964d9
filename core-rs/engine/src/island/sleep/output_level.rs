//! How strongly an output moves, as it is heard: by its range, its speed or its acceleration.

use crate::archive::state;

/// The level of one output since the last check, and the largest so far.
#[derive(Clone, Debug)]
pub(super) struct OutputLevel {
    /// How often the output is differentiated by time: 0, 1 or 2.
    derivative_order: u8,
    /// The last value [m], and the last difference from frame to frame [m].
    last_value: f64,
    last_step: f64,
    /// Lowest and highest value since the last check [m].
    lowest_value: f64,
    highest_value: f64,
    /// Largest difference from frame to frame since the last check [m].
    largest_step: f64,
    /// The largest range, difference, or difference of differences so far, as `derivative_order` says [m].
    largest_level: f64,
}

state!(OutputLevel {
    last_value,
    last_step,
    lowest_value,
    highest_value,
    largest_step,
    largest_level
});

impl OutputLevel {
    pub(super) fn new(derivative_order: u8) -> Self {
        Self {
            derivative_order,
            last_value: f64::NAN,
            last_step: f64::NAN,
            lowest_value: f64::INFINITY,
            highest_value: f64::NEG_INFINITY,
            largest_step: 0.0,
            largest_level: 0.0,
        }
    }

    /// The last value [m].
    pub(super) fn last_value(&self) -> f64 {
        self.last_value
    }

    /// Records the next value [m]. Differences from before the first one are NaN, which `max` passes over.
    #[inline]
    pub(super) fn record(&mut self, value: f64) {
        let value_step = value - self.last_value;
        let level = match self.derivative_order {
            0 => 0.0,
            1 => value_step.abs(),
            _ => (value_step - self.last_step).abs(),
        };
        self.largest_level = self.largest_level.max(level);
        self.largest_step = self.largest_step.max(value_step.abs());
        (self.lowest_value, self.highest_value) = (self.lowest_value.min(value), self.highest_value.max(value));
        (self.last_value, self.last_step) = (value, value_step);
    }

    /// Whether stopping it here and now would be quieter than the part `share` of the loudest so far; begins to record
    /// again. An output that is heard as an acceleration makes a click as strong as its step if it is stopped.
    pub(super) fn is_quiet(&mut self, share: f64) -> bool {
        let level_now = match self.derivative_order {
            0 => (self.highest_value - self.lowest_value).max(0.0),
            _ => self.largest_step,
        };
        if self.derivative_order == 0 {
            self.largest_level = self.largest_level.max(level_now);
        }
        (self.lowest_value, self.highest_value) = (f64::INFINITY, f64::NEG_INFINITY);
        self.largest_step = 0.0;
        level_now <= share * self.largest_level
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::sin;

    /// Whether a sine of 0.01 radians a frame is quiet after it was as loud as 1.
    fn is_quiet(order: u8, amplitude: f64) -> bool {
        let (mut output_level, mut frames_played) = (OutputLevel::new(order), 0.0);
        let mut play_fade = |from: f64, to: f64| {
            for part in 1..=1_000 {
                let ramp_share = f64::from(part) / 1_000.0;
                let amplitude = from + (to - from) * ramp_share * ramp_share * (3.0 - 2.0 * ramp_share);
                output_level.record(amplitude * sin(0.01 * frames_played));
                frames_played += 1.0;
            }
            output_level.is_quiet(1e-3)
        };
        assert!(!play_fade(1.0, 1.0));
        assert!(!play_fade(1.0, amplitude));
        play_fade(amplitude, amplitude)
    }

    #[test]
    fn is_quiet_by_order() {
        assert!(is_quiet(0, 0.9e-3) && !is_quiet(0, 1.1e-3));
        assert!(is_quiet(1, 0.9e-3) && !is_quiet(1, 1.1e-3));
        assert!(is_quiet(2, 0.9e-5) && !is_quiet(2, 1.1e-5));
    }

    #[test]
    fn is_quiet_of_rest() {
        let mut output_level = OutputLevel::new(2);
        (0..100).for_each(|_| output_level.record(0.25));
        assert!(output_level.is_quiet(1e-3));
        assert_eq!(output_level.last_value(), 0.25);
    }
}
