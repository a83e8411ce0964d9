//! Inputs that move or push MATs, from a sound card or as values that are set while it plays: how their samples are
//! conditioned, and the values from a file that replace them.

use std::fmt;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::{DriveKind, DriveSource, StrikeError, Timeline};
use crate::section::{BUTTERWORTH_2, FilterSection};

/// Largest number of inputs of a piece.
const INPUTS_MAX: usize = 64;
/// Longest glide from one set value to the next [s].
const GLIDE_SECONDS_MAX: f64 = 60.0;

/// Where the samples of an input come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InputSource {
    /// A channel of the sound card, from 0.
    Channel(usize),
    /// Values of [`Simulation::set_input`](crate::simulation::Simulation::set_input): each is reached after `glide`
    /// [s], and held.
    Value {
        /// The number by which the input is set.
        number: u64,
        /// Time from one value to the next [s].
        glide: f64,
    },
}

/// How the samples of an input are conditioned before they act.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoundInSettings {
    /// Where the samples come from.
    pub source: InputSource,
    /// Value of full scale (1.0) [m or N].
    pub gain: f64,
    /// Cutoff of a Butterworth high-pass of order 2 [Hz]; `None`: no high-pass.
    pub highpass: Option<f64>,
    /// Largest magnitude that acts [m or N].
    pub clamp: f64,
}

impl SoundInSettings {
    /// The value after gain and clamp [m or N] of an input value at full scale 1.
    pub(crate) fn gained_and_clamped(&self, value: f64) -> f64 {
        (value * self.gain).clamp(-self.clamp, self.clamp)
    }

    /// The input value at which the clamp begins to act, full scale 1.
    pub(crate) fn clamp_start(&self) -> f64 {
        (self.clamp / self.gain).abs()
    }
}

/// The stages that every sample of an input passes: high-pass, gain, clamp.
#[derive(Clone, Debug)]
pub struct Conditioner {
    settings: SoundInSettings,
    section: Option<FilterSection>,
    /// The last output value [m or N].
    last_value: f64,
}

impl Conditioner {
    /// Stages at rest, at `rate` [Hz]; the cutoff must be below half of this rate.
    pub fn new(settings: SoundInSettings, rate: f64) -> Self {
        let section = |cutoff| FilterSection::new(cutoff, rate, BUTTERWORTH_2);
        Self {
            section: settings.highpass.map(section),
            settings,
            last_value: 0.0,
        }
    }

    /// The value of the next sample [m or N]; a sample that is not finite counts as silence.
    pub fn condition_next(&mut self, sample: f64) -> f64 {
        let finite_sample = if sample.is_finite() { sample } else { 0.0 };
        let filtered_sample = match &mut self.section {
            Some(section) => section.next(finite_sample).high,
            None => finite_sample,
        };
        self.last_value = self.settings.gained_and_clamped(filtered_sample);
        self.last_value
    }

    /// The channel of the sound card that it reads; `None` if its values are set.
    pub(crate) fn channel(&self) -> Option<usize> {
        match self.settings.source {
            InputSource::Channel(channel) => Some(channel),
            InputSource::Value { .. } => None,
        }
    }

    /// The last output value [m or N].
    pub(crate) fn last_value(&self) -> f64 {
        self.last_value
    }

    /// Continue from the state of another conditioner, if it has the same source.
    pub(crate) fn take_over(&mut self, other: &Self) {
        if self.settings.source != other.settings.source {
            return;
        }
        if let (Some(section), Some(other)) = (&mut self.section, &other.section) {
            section.take_over(other);
        }
        self.last_value = other.last_value;
    }
}

/// An input, and its values without live input.
#[derive(Clone)]
pub struct SoundIn {
    /// Index among the inputs of the timeline.
    pub(crate) index: usize,
    pub(crate) settings: SoundInSettings,
    /// Frames from one set value to the next.
    pub(crate) glide_frames: u64,
    /// Values at the frames of the score from frame 0 on [m or N], (n_frames,); 0 after them.
    values: Arc<[f64]>,
    /// SHA-256 of the values.
    digest: [u8; 32],
}

impl SoundIn {
    /// The value from the file at a frame of the score [m or N].
    pub(crate) fn value(&self, frame: u64) -> f64 {
        let frame_index = usize::try_from(frame).unwrap_or(usize::MAX);
        self.values.get(frame_index).copied().unwrap_or(0.0)
    }
}

impl fmt::Debug for SoundIn {
    /// Shows the digest instead of the values, because timelines are hashed by their debug output.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("SoundIn")
            .field("index", &self.index)
            .field("settings", &self.settings)
            .field("digest", &self.digest)
            .finish()
    }
}

impl Timeline {
    /// Declare an input; returns its index.
    ///
    /// `samples` are the values from frame 0 on that are used without live input, at the rate of the timeline,
    /// full scale 1, (n_frames,). They pass the same stages as live samples.
    ///
    /// # Errors
    /// [`StrikeError`] if a setting is not finite or out of range, or there are more than 64 inputs.
    pub fn add_sound_input(&mut self, settings: SoundInSettings, samples: &[f64]) -> Result<usize, StrikeError> {
        let frame_rate = self.rate.hertz();
        let index = self.sounds_in.len();
        let refusal = |quantity, requirement, value| Err(StrikeError::Value(quantity, requirement, value));
        if index == INPUTS_MAX {
            return refusal("the number of inputs", " of 64 at most", index as f64 + 1.0);
        }
        if !settings.gain.is_finite() {
            return refusal("the gain of an input", "", settings.gain);
        }
        if !(settings.clamp > 0.0 && settings.clamp.is_finite()) {
            return refusal("the clamp of an input", " above 0", settings.clamp);
        }
        let mut glide_frames = 1;
        if let InputSource::Value { glide, .. } = settings.source {
            if !(0.0..=GLIDE_SECONDS_MAX).contains(&glide) {
                return refusal("the glide of an input", " of seconds from 0 to 60", glide);
            }
            if !settings.clamp_start().is_finite() {
                return refusal("the gain of an input", " that is not 0", settings.gain);
            }
            glide_frames = ((glide * frame_rate + 0.5) as u64).max(1);
        }
        if let Some(cutoff) = settings.highpass
            && !(cutoff > 0.0 && cutoff < 0.5 * frame_rate)
        {
            let requirement = " of hertz between 0 and half the rate";
            return refusal("the high-pass of an input", requirement, cutoff);
        }
        let mut conditioner = Conditioner::new(settings, frame_rate);
        let values: Arc<[f64]> = samples.iter().map(|&x| conditioner.condition_next(x)).collect();
        let mut sound_hash = Sha256::new();
        for value in &*values {
            sound_hash.update(value.to_le_bytes());
        }
        self.sounds_in.push(SoundIn {
            index,
            settings,
            glide_frames,
            values,
            digest: sound_hash.finalize().into(),
        });
        Ok(index)
    }

    /// Let an input push a MAT, or impose its position, by its values times `scale`.
    ///
    /// Frame n is computed with value n: a force acts in it, a position is reached at its end.
    ///
    /// # Errors
    /// [`StrikeError`] if there is no such input, or the position of the MAT is imposed already.
    pub fn drive_by_sound(&mut self, mat: usize, kind: DriveKind, index: usize, scale: f64) -> Result<(), StrikeError> {
        let Some(sound) = self.sounds_in.get(index).cloned() else {
            return Err(StrikeError::NoInput(index, self.sounds_in.len()));
        };
        let sound_source = DriveSource::SoundIn {
            sound,
            scale: super::check_finite("scale", scale).map(|()| scale)?,
            steps: 1,
        };
        // The drive does not belong to the MAT's own part, because written gestures cannot depend on live input.
        self.drive(mat, kind, sound_source, false)
    }

    /// How the samples of each input are conditioned, in order of declaration.
    pub(crate) fn sound_settings(&self) -> impl Iterator<Item = SoundInSettings> {
        self.sounds_in.iter().map(|sound| sound.settings)
    }
}
