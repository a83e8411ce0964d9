//! Loudness measurement. It only reports: it does not change samples.

use ebur128::{Channel, EbuR128, Mode};
use thiserror::Error;

/// A rate or a number of channels that BS.1770's filters do not cover.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("loudness can be measured of 1 to 64 channels at 16 Hz to 2.8 MHz; here {n_channels} at {rate} Hz")]
pub struct MeterError {
    /// Requested rate [Hz].
    pub rate: f64,
    /// Requested number of channels.
    pub n_channels: usize,
}

/// Sample peak and integrated loudness (ITU-R BS.1770-4) of a signal.
///
/// All channels have the same weight: a channel is a loudspeaker of any layout, and BS.1770 gives other weights only to
/// the surround channels of its own layouts. For mono and stereo this is the standard.
///
/// ```
/// use ergon_engine::mix::meter::Meter;
///
/// let mut meter = Meter::new(44_100.0, 1)?;
/// assert_eq!(meter.loudness(), f64::NEG_INFINITY); // nothing yet
/// meter.process(&[0.0, 0.5, -0.25]);
/// assert!((meter.peak() - 0.5).abs() < 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Meter {
    peak: f64,
    loudness: EbuR128,
    finite: Vec<f64>,
}

impl Meter {
    /// A meter of `n_channels` at `rate` [Hz].
    ///
    /// # Errors
    /// [`MeterError`] if EBU R 128 is not defined for the rate or the number of channels.
    pub fn new(rate: f64, n_channels: usize) -> Result<Self, MeterError> {
        let refused = MeterError { rate, n_channels };
        let channels = u32::try_from(n_channels).map_err(|_| refused)?;
        // `as` converts NaN and negative rates to 0, which is refused.
        let mut loudness = EbuR128::new(channels, rate.round() as u32, Mode::I).map_err(|_| refused)?;
        loudness
            .set_channel_map(&vec![Channel::Center; n_channels])
            .map_err(|_| refused)?;
        Ok(Self {
            peak: 0.0,
            loudness,
            finite: Vec::new(),
        })
    }

    /// Number of channels.
    pub fn n_channels(&self) -> usize {
        self.loudness.channels() as usize
    }

    /// Measure (n_frames, n_channels). For the loudness, a sample that is not finite counts as 0; NaN does not change
    /// the peak.
    pub fn process(&mut self, frames: &[f64]) {
        self.peak = frames.iter().fold(self.peak, |peak, x| peak.max(x.abs()));
        self.finite.clear();
        self.finite
            .extend(frames.iter().map(|&x| if x.is_finite() { x } else { 0.0 }));
        // An error is only possible for an incomplete frame, which is cut off here.
        let n_samples = self.finite.len() / self.n_channels() * self.n_channels();
        let _ = self.loudness.add_frames_f64(&self.finite[..n_samples]);
    }

    /// Largest absolute sample so far.
    pub fn peak(&self) -> f64 {
        self.peak
    }

    /// Loudness of the last 400 ms [LUFS], without gating; -inf for silence.
    pub fn momentary(&self) -> f64 {
        self.loudness.loudness_momentary().unwrap_or(f64::NEG_INFINITY)
    }

    /// Integrated loudness so far [LUFS]; -inf for silence and before the first 400 ms have passed.
    pub fn loudness(&self) -> f64 {
        self.loudness.loudness_global().unwrap_or(f64::NEG_INFINITY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths;

    fn tone(n_channels: usize, level: f64) -> Vec<f64> {
        let frame_rate = 48_000;
        let sine_sample = |i: i32| {
            let sine_phase = std::f64::consts::TAU * 997.0 * f64::from(i) / f64::from(frame_rate);
            maths::decibels(level) * maths::sin(sine_phase)
        };
        (0..5 * frame_rate)
            .flat_map(|i| vec![sine_sample(i); n_channels])
            .collect()
    }

    fn measured(frames: &[f64], n_channels: usize) -> Meter {
        let mut meter = Meter::new(48_000.0, n_channels).unwrap();
        frames.chunks(64 * n_channels).for_each(|block| meter.process(block));
        meter
    }

    /// BS.1770: a 997 Hz sine of 0 dBFS in one channel reads -3.01 LKFS; every doubling of
    /// channels adds 3.01.
    #[test]
    fn loudness_of_the_reference_tone() {
        for (n_channels, wanted) in [(1, -23.01), (2, -20.0), (24, -9.21)] {
            let meter = measured(&tone(n_channels, -20.0), n_channels);
            assert!((meter.loudness() - wanted).abs() < 0.02, "{}", meter.loudness());
            assert!((meter.peak() - 0.1).abs() < 1e-5);
        }
    }

    #[test]
    fn momentary_loudness_of_a_steady_tone() {
        let meter = measured(&tone(1, -40.0), 1);
        assert!((meter.momentary() + 43.01).abs() < 0.02);
        assert_eq!(measured(&[0.0; 96_000], 2).momentary(), f64::NEG_INFINITY);
    }

    #[test]
    fn loudness_of_silence() {
        let meter = measured(&[0.0; 96_000], 2);
        assert_eq!((meter.peak(), meter.loudness()), (0.0, f64::NEG_INFINITY));
        assert_eq!(Meter::new(48_000.0, 1).unwrap().loudness(), f64::NEG_INFINITY);
    }

    #[test]
    fn loudness_with_a_non_finite_sample() {
        let mut frames = tone(1, -20.0);
        frames[1000] = f64::NAN;
        let meter = measured(&frames, 1);
        assert!((meter.loudness() + 23.01).abs() < 0.02 && meter.peak() < 0.11);
        frames[1000] = f64::INFINITY;
        assert_eq!(measured(&frames, 1).peak(), f64::INFINITY);
    }

    #[test]
    fn meter_with_wrong_settings_is_refused() {
        for (rate, n_channels) in [(48_000.0, 0), (48_000.0, 65), (0.0, 1), (f64::NAN, 1), (1e9, 2)] {
            assert!(Meter::new(rate, n_channels).is_err());
        }
    }
}
