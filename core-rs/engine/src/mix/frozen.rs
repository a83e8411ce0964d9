//! Outputs that were computed earlier, to be added to those that a simulation computes.

use std::sync::Arc;

use super::glide::GainGlide;

/// Samples of outputs that were computed earlier, from their first frame on.
#[derive(Debug)]
pub struct FrozenOutputs {
    /// (n_frames · n_out), frame by frame
    samples: Vec<f64>,
    n_out: usize,
}

impl FrozenOutputs {
    /// The samples of `n_out` outputs, frame by frame; samples that are missing in the last frame count as 0.
    #[must_use]
    pub fn new(samples: Vec<f64>, n_out: usize) -> Self {
        Self { samples, n_out }
    }

    /// Number of outputs.
    #[must_use]
    pub fn n_out(&self) -> usize {
        self.n_out
    }

    /// The sample of a column in a frame; 0 before the first frame and after the last one.
    fn sample(&self, frame: i64, column: usize) -> f64 {
        usize::try_from(frame)
            .ok()
            .and_then(|frame| frame.checked_mul(self.n_out))
            .and_then(|first| self.samples.get(first + column))
            .map_or(0.0, |&x| x)
    }
}

/// One frozen output in a mixer.
#[derive(Clone, Debug)]
pub(super) struct PlacedOutput {
    source: Arc<FrozenOutputs>,
    column: usize,
    /// The output of the mixer to which it is added.
    pub(super) mixer_output: usize,
    /// The frame of the mixer at which its first frame is heard.
    start_frame: i64,
    pub(super) fade: GainGlide,
}

impl PlacedOutput {
    pub(super) fn new(
        source: Arc<FrozenOutputs>,
        column: usize,
        mixer_output: usize,
        start_frame: i64,
        rate: f64,
    ) -> Self {
        Self {
            source,
            column,
            mixer_output,
            start_frame,
            fade: GainGlide::new(rate, 1.0),
        }
    }

    /// Whether it is the same frozen output, at the same place, as one of an old mixer whose output is now `out`.
    pub(super) fn is_continuation_of(&self, old_output: &Self, out: usize) -> bool {
        Arc::ptr_eq(&self.source, &old_output.source)
            && (self.column, self.start_frame, self.mixer_output) == (old_output.column, old_output.start_frame, out)
    }

    /// A copy for another mixer, at its output `mixer_output`, with another fade.
    pub(super) fn with_fade(&self, mixer_output: usize, fade: GainGlide) -> Self {
        Self {
            mixer_output,
            fade,
            ..self.clone()
        }
    }

    /// Its faded sample at a frame of the mixer.
    pub(super) fn faded_sample(&self, n: u64) -> f64 {
        let signed_frame = i64::try_from(n).unwrap_or(i64::MAX);
        self.source
            .sample(signed_frame.saturating_sub(self.start_frame), self.column)
            * self.fade.gain_at(n)
    }
}
