//! Inputs in an island: samples of a sound card tick by tick, or single values to which an input glides. Before any
//! arrive, an input plays its file.

use crate::state::{ImposedTarget, ModuleState};
use crate::timeline::{Drive, DriveKind, DriveSource, InputSource, SoundIn};

/// Most frames that are handed over at once.
pub(crate) const INPUT_FRAMES_MAX: usize = 4_096;

/// A MAT that an input moves or pushes.
#[derive(Clone, Debug)]
pub(super) struct SoundDrive {
    pub(super) mat: usize,
    kind: DriveKind,
    input: SoundIn,
    scale: f64,
    /// Steps in a frame of the score.
    steps_per_frame: u64,
}

/// What an input received.
#[derive(Clone, Debug)]
pub(super) enum InputSignal {
    /// Samples of a sound card.
    Samples(Samples),
    /// The ramp to the last value that was set; `None`: none was.
    Ramp(Option<Ramp>),
}

impl InputSignal {
    /// The value at a frame of the score [m or N].
    fn value(&self, frame: u64, sound: &SoundIn) -> f64 {
        match self {
            Self::Samples(samples) => samples.value(frame, sound),
            Self::Ramp(Some(ramp)) if frame + 1 >= ramp.start_frame => {
                sound.settings.gained_and_clamped(ramp.value(frame))
            }
            Self::Ramp(_) => sound.value(frame),
        }
    }
}

/// A linear ramp of an input to a value, full scale 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ramp {
    start_value: f64,
    stop_value: f64,
    /// First frame of the ramp, and its number of frames.
    start_frame: u64,
    length_frames: u64,
}

impl Ramp {
    /// The value at a frame, which is at the earliest the one before `start_frame`.
    fn value(&self, frame: u64) -> f64 {
        let frames_done = frame + 1 - self.start_frame;
        if frames_done >= self.length_frames {
            return self.stop_value;
        }
        self.start_value + (self.stop_value - self.start_value) * (frames_done as f64 / self.length_frames as f64)
    }
}

/// Samples of a sound card.
#[derive(Clone, Debug)]
pub(super) struct Samples {
    /// Frame of the score of the first sample; `None`: no samples have arrived.
    first_frame: Option<u64>,
    /// The value in the frame before `first_frame`.
    value_before: f64,
    sample_count: usize,
    /// (INPUT_FRAMES_MAX), of which the first `sample_count` are valid.
    values: Box<[f64]>,
}

impl Samples {
    fn value(&self, frame: u64, sound: &SoundIn) -> f64 {
        match self.first_frame {
            Some(first_frame) if frame >= first_frame => {
                let sample_index = usize::try_from(frame - first_frame).unwrap_or(usize::MAX);
                self.values[..self.sample_count]
                    .get(sample_index)
                    .copied()
                    .unwrap_or(0.0)
            }
            Some(first_frame) if frame + 1 == first_frame => self.value_before,
            _ => sound.value(frame),
        }
    }
}

/// The MATs that inputs drive, each with an input that has received nothing.
pub(super) fn sound_drives(drives: &[Drive]) -> (Vec<SoundDrive>, Vec<InputSignal>) {
    let sound_drive = |drive: &Drive| match &drive.source {
        DriveSource::SoundIn { sound, scale, steps } => Some(SoundDrive {
            mat: drive.mat,
            kind: drive.kind,
            input: sound.clone(),
            scale: *scale,
            steps_per_frame: u64::from(*steps),
        }),
        _ => None,
    };
    let input_drives: Vec<SoundDrive> = drives.iter().filter_map(sound_drive).collect();
    let new_signal = |drive: &SoundDrive| match drive.input.settings.source {
        InputSource::Channel(_) => InputSignal::Samples(Samples {
            first_frame: None,
            value_before: 0.0,
            sample_count: 0,
            values: vec![0.0; INPUT_FRAMES_MAX].into(),
        }),
        InputSource::Value { .. } => InputSignal::Ramp(None),
    };
    let input_signals = input_drives.iter().map(new_signal).collect();
    (input_drives, input_signals)
}

/// Add the forces of step `n`, and impose the positions at its end.
///
/// Between frames of the score a force is held, and a position moves linearly.
pub(super) fn apply_inputs(
    drives: &[SoundDrive],
    input_signals: &[InputSignal],
    n: u64,
    modules: &mut ModuleState,
    targets: &mut Vec<ImposedTarget>,
) {
    for (drive, input_signal) in drives.iter().zip(input_signals) {
        let score_frame = n / drive.steps_per_frame;
        let value_now = input_signal.value(score_frame, &drive.input);
        if drive.kind == DriveKind::Force {
            modules.push(drive.mat, drive.scale * value_now);
            continue;
        }
        let steps_done = n % drive.steps_per_frame + 1;
        let ramped_value = if steps_done == drive.steps_per_frame {
            value_now
        } else {
            let value_before = score_frame
                .checked_sub(1)
                .map_or(0.0, |score_frame| input_signal.value(score_frame, &drive.input));
            value_before + (value_now - value_before) * (steps_done as f64 / drive.steps_per_frame as f64)
        };
        targets.push(ImposedTarget {
            mat: drive.mat,
            x: drive.scale * ramped_value,
            previous: 0.0,
        });
    }
}

impl super::Island {
    /// Take the values of an input for the frames of the score from `first_frame` on [m or N]; `value_before` is the
    /// value in the frame before.
    pub(crate) fn receive_samples(&mut self, index: usize, first_frame: u64, value_before: f64, values: &[f64]) {
        let input_pairs = self
            .script
            .sound_drives
            .iter()
            .zip(&mut self.state.sources.input_signals);
        for (_, input_signal) in input_pairs.filter(|(drive, _)| drive.input.index == index) {
            let InputSignal::Samples(samples) = input_signal else {
                continue;
            };
            let sample_count = values.len().min(INPUT_FRAMES_MAX);
            samples.values[..sample_count].copy_from_slice(&values[..sample_count]);
            (samples.first_frame, samples.value_before, samples.sample_count) =
                (Some(first_frame), value_before, sample_count);
        }
    }

    /// Let the input `number` ramp to `value` (full scale 1) from frame `start_frame` of the score on; false if it is
    /// not in this island.
    pub(crate) fn set_input(&mut self, number: u64, start_frame: u64, value: f64) -> bool {
        let mut has_input = false;
        for (sound, ramp) in self.value_inputs(number) {
            let clamp_limit = sound.settings.clamp_start();
            let value_before = |frame| match ramp {
                Some(ramp) => ramp.value(frame),
                None => sound.value(frame) / sound.settings.gain,
            };
            *ramp = Some(Ramp {
                start_value: start_frame.checked_sub(1).map_or(0.0, value_before),
                stop_value: value.clamp(-clamp_limit, clamp_limit),
                start_frame,
                length_frames: sound.glide_frames,
            });
            has_input = true;
        }
        has_input
    }

    /// The inputs with this number, and their ramps.
    fn value_inputs(&mut self, number: u64) -> impl Iterator<Item = (&SoundIn, &mut Option<Ramp>)> {
        let input_pairs = self
            .script
            .sound_drives
            .iter()
            .zip(&mut self.state.sources.input_signals);
        input_pairs.filter_map(
            move |(drive, input_signal)| match (drive.input.settings.source, input_signal) {
                (
                    InputSource::Value {
                        number: input_number, ..
                    },
                    InputSignal::Ramp(ramp),
                ) if input_number == number => Some((&drive.input, ramp)),
                _ => None,
            },
        )
    }

    /// The ramps of inputs whose value was set, with their numbers.
    pub(crate) fn input_ramps(&self) -> impl Iterator<Item = (u64, Ramp)> {
        let input_pairs = self.script.sound_drives.iter().zip(&self.state.sources.input_signals);
        input_pairs.filter_map(
            |(drive, input_signal)| match (drive.input.settings.source, input_signal) {
                (InputSource::Value { number, .. }, InputSignal::Ramp(Some(ramp))) => Some((number, *ramp)),
                _ => None,
            },
        )
    }

    /// Let the input `number` continue a ramp that it had in another island.
    pub(crate) fn continue_ramp(&mut self, number: u64, ramp: Ramp) {
        self.value_inputs(number)
            .for_each(|(_, value_ramp)| *value_ramp = Some(ramp));
    }
}
