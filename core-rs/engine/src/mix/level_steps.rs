//! Levels of a sound, step by step.

use super::meter::{Meter, MeterError};
use super::true_peak::magnitude_max;
use crate::archive::{Archive, Damaged, State, state};

/// Peaks in a step.
pub const PEAKS_PER_STEP: usize = 10;

/// Measures a sound in steps of a tenth of a second: the loudness of the last 400 ms, and ten peaks.
///
/// ```
/// use ergon_engine::mix::level_steps::{LevelSteps, PEAKS_PER_STEP};
///
/// let mut levels = LevelSteps::new(48_000.0, 1)?;
/// levels.process(&[0.5; 4_801]);
/// let measured = levels.levels();
/// assert_eq!(measured.len(), 1 + PEAKS_PER_STEP);
/// assert_eq!(measured[1..], [0.5; PEAKS_PER_STEP]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct LevelSteps {
    meter: Meter,
    /// Frames of the current step that have come.
    frames_in_step: usize,
    peaks: [f64; PEAKS_PER_STEP],
    /// Loudness [LUFS] and peaks of each step   (n_steps · (1 + PEAKS_PER_STEP))
    levels: Vec<f64>,
}

state!(LevelSteps {
    meter,
    frames_in_step,
    peaks
});

impl LevelSteps {
    /// Levels of `n_channels` at `rate` [Hz].
    ///
    /// # Errors
    /// [`MeterError`] if loudness is not defined for the rate or the number of channels.
    pub fn new(rate: f64, n_channels: usize) -> Result<Self, MeterError> {
        Ok(Self {
            meter: Meter::new(rate, n_channels)?,
            frames_in_step: 0,
            peaks: [0.0; PEAKS_PER_STEP],
            levels: Vec::new(),
        })
    }

    /// Number of channels.
    pub fn n_channels(&self) -> usize {
        self.meter.n_channels()
    }

    /// Measure (n_frames, n_channels); what is not finite counts as in [`Meter::process`].
    pub fn process(&mut self, frames: &[f64]) {
        let (n_channels, step) = (self.n_channels(), self.meter.tenth_frames());
        let mut frames_left = frames;
        while frames_left.len() >= n_channels {
            // Peak p is that of the frames from p · step / PEAKS on.
            let peak_index = (1..PEAKS_PER_STEP)
                .take_while(|p| p * step / PEAKS_PER_STEP <= self.frames_in_step)
                .count();
            let stop = (peak_index + 1) * step / PEAKS_PER_STEP;
            let n_frames = (stop - self.frames_in_step).min(frames_left.len() / n_channels);
            let span;
            (span, frames_left) = frames_left.split_at(n_frames * n_channels);
            self.meter.process(span);
            self.peaks[peak_index] = self.peaks[peak_index].max(magnitude_max(span));
            self.frames_in_step += n_frames;
            if self.frames_in_step == step {
                self.levels.push(self.meter.momentary_loudness());
                self.levels.extend(std::mem::take(&mut self.peaks));
                self.frames_in_step = 0;
            }
        }
    }

    /// The loudness [LUFS] and the peaks of each complete step   (n_steps · (1 + PEAKS_PER_STEP))
    pub fn levels(&self) -> &[f64] {
        &self.levels
    }

    /// What the levels of later frames depend on, besides the sound.
    pub fn write_state(&mut self) -> Vec<u8> {
        let mut state_bytes = Vec::new();
        // Writing cannot fail.
        let _ = self.archive(&mut Archive::Write(&mut state_bytes));
        state_bytes
    }

    /// Continue after frames whose levels are `measured_levels`; `state` is the state after them.
    ///
    /// # Errors
    /// [`Damaged`] if these are not the state and the levels of such steps; all is then as it was.
    pub fn read_state(&mut self, state: &[u8], measured_levels: &[f64]) -> Result<(), Damaged> {
        let mut restored = self.clone();
        let mut archive = Archive::Read(state);
        restored.archive(&mut archive)?;
        let step = self.meter.tenth_frames();
        let is_valid = archive.is_empty() && restored.frames_in_step < step && restored.meter.is_within_tenth();
        if !is_valid || !measured_levels.len().is_multiple_of(1 + PEAKS_PER_STEP) {
            return Err(Damaged);
        }
        restored.levels = measured_levels.to_vec();
        *self = restored;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths;

    #[test]
    fn levels_after_a_restored_state_equal_those_without() {
        for n_channels in [1, 3, 8] {
            let samples = (0..30_000 * n_channels).map(|i| maths::sin((i * i % 10_007) as f64));
            let frames: Vec<f64> = samples.collect();
            let mut levels = LevelSteps::new(44_100.0, n_channels).unwrap();
            frames.chunks(77 * n_channels).for_each(|block| levels.process(block));
            let (early, late) = frames.split_at(13_000 * n_channels);
            let mut first = LevelSteps::new(44_100.0, n_channels).unwrap();
            first.process(early);
            let (state, measured_levels) = (first.write_state(), first.levels().to_vec());
            let mut second = LevelSteps::new(44_100.0, n_channels).unwrap();
            second.read_state(&state, &measured_levels).unwrap();
            second.process(late);
            assert_eq!(second.levels(), levels.levels());
            assert_eq!(levels.levels().len(), 6 * (1 + PEAKS_PER_STEP));
            let peak = |samples: &[f64]| samples.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
            for p in 0..PEAKS_PER_STEP {
                let cell =
                    &frames[p * 4_410 / PEAKS_PER_STEP * n_channels..(p + 1) * 4_410 / PEAKS_PER_STEP * n_channels];
                assert_eq!(levels.levels()[1 + p], peak(cell));
            }
        }
    }

    #[test]
    fn damaged_states_are_refused() {
        let mut levels = LevelSteps::new(44_100.0, 2).unwrap();
        let state = levels.write_state();
        assert!(levels.read_state(&state[1..], &[]).is_err());
        assert!(levels.read_state(&state, &[0.0]).is_err());
        let mut other = LevelSteps::new(44_100.0, 9).unwrap();
        assert!(other.read_state(&state, &[]).is_err());
        assert!(levels.read_state(&state, &[]).is_ok());
    }
}
