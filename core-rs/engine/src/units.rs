//! Units in the engine's interface, where one plain number could be mistaken for another.

/// ln(1000), a decay of 60 dB in nepers: T60 = ln(1000)/σ.
pub(crate) const LN_1000: f64 = 6.907_755_278_982_137;

/// Samples per second; the inverse is the step T.
///
/// ```
/// use ergon_engine::Rate;
///
/// let rate = Rate::new(48_000.0)?;
/// assert_eq!(rate.step(), 1.0 / 48_000.0);
/// assert!(Rate::new(-1.0).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Rate(f64);

/// The error for a number that is not a valid rate.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("A rate is a positive number of samples a second, not {0}.")]
pub struct RateError(f64);

impl Rate {
    /// A rate in Hz.
    ///
    /// # Errors
    /// [`RateError`] unless the rate is positive and finite, and its inverse a normal number.
    pub fn new(hertz: f64) -> Result<Self, RateError> {
        let is_usable = hertz > 0.0 && hertz.is_finite() && (1.0 / hertz).is_normal();
        if is_usable {
            Ok(Self(hertz))
        } else {
            Err(RateError(hertz))
        }
    }

    /// Samples per second [Hz].
    pub fn hertz(self) -> f64 {
        self.0
    }

    /// The step T [s].
    pub fn step(self) -> f64 {
        1.0 / self.0
    }
}

/// The largest frame number: up to here an f64 represents every integer (6,000 years at 48 kHz).
const FRAME_MAX: f64 = 9_007_199_254_740_992.0;

/// The frame on which an instant t [s] falls at a rate [Hz]: floor(t·rate + ½).
pub(crate) fn frame(t: f64, rate: f64) -> u64 {
    floor_frame(t * rate + 0.5)
}

/// The frame of an instant t [s] at `rate` [Hz], which has `oversampling` frames per frame of the score. An event acts
/// at the same instant for every `oversampling`.
pub(crate) fn score_frame(t: f64, rate: f64, oversampling: u32) -> u64 {
    let frame_factor = u64::from(oversampling);
    (frame(t, rate / f64::from(oversampling)) * frame_factor).min(FRAME_MAX as u64)
}

/// The nearest frame at a rate that has one frame for `every` frames of this one.
pub(crate) fn nearest_frame(frame: u64, every: u64) -> u64 {
    frame.saturating_add(every / 2) / every
}

/// The last frame at or before a number of frames, clamped to 0 … `FRAME_MAX`.
pub(crate) fn floor_frame(frames: f64) -> u64 {
    frames.clamp(0.0, FRAME_MAX) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_from_positive_numbers_only() {
        assert_eq!(Rate::new(44_100.0).map(Rate::hertz), Ok(44_100.0));
        assert_eq!(Rate::new(4.0).map(Rate::step), Ok(0.25));
        for invalid_rate in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-310] {
            assert!(Rate::new(invalid_rate).is_err(), "{invalid_rate}");
        }
    }
}
