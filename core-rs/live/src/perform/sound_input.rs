//! Inputs of a sound card in a performance: opened beforehand, read tick by tick, and written to a file if one is asked
//! for.

use std::path::PathBuf;

use ergon_engine::simulation::Simulation;

use super::PlayError;
use crate::audio::{self, AudioError, AudioSpec, AudioTap, Backend, Input, InputReader, OutputInfo, TapHandle};

/// Where the inputs of a piece come from.
#[derive(Clone, Debug, Default)]
pub struct InputConfig {
    /// The source; `None`: each input plays what the piece itself has for it.
    pub source: Option<AudioSpec>,
    /// The path of a new WAVE file for the input.
    pub record_path: Option<PathBuf>,
}

/// The input of a performance, as other threads see it.
#[derive(Default)]
pub struct InputStatus {
    /// The input, if there is one.
    pub input: Option<Input>,
    /// A sentence about the input, or why there is none; empty if the piece has no inputs.
    pub description: String,
    /// The file that the input is written to.
    pub recording: Option<TapHandle>,
}

/// The input on the physics thread.
pub(super) struct SoundInput {
    reader: InputReader,
    /// The samples of a tick   (tick_frames, n_channels)
    samples: Vec<f32>,
    tap: Option<AudioTap>,
    /// Level of the ring [frames] at which ticks wait: a fuller ring would delay the input.
    fill_target: usize,
}

/// Open the input of a piece that has inputs, for an output whose ring holds `frames_ahead` frames.
///
/// With the backend `auto` a missing input is no error; with a named backend it is.
pub(super) fn open(
    config: &InputConfig,
    simulation: &Simulation,
    output: &OutputInfo,
    tick_frames: usize,
    frames_ahead: usize,
) -> Result<(Option<SoundInput>, InputStatus), PlayError> {
    let channels = simulation.n_channels_in();
    let mut input_status = InputStatus::default();
    if channels == 0 {
        return Ok((None, input_status));
    }
    let silence_sentence = "each input of the score plays its file, or silence where it has none";
    let Some(input_spec) = &config.source else {
        input_status.description = format!("no input: {silence_sentence}");
        return Ok((None, input_status));
    };
    let is_required = input_spec.backend != Backend::Auto;
    if is_required && !output.is_paced {
        let error_text = format!(
            "the input {input_spec} delivers sound in real time, and the output does not take it so ({}: {}); \
             use --audio jack, pulse, null or clock:PATH",
            output.backend, output.device
        );
        return Err(AudioError::Broken(error_text).into());
    }
    let sample_rate = simulation.rate() as u32;
    let block_frames = (output.block as usize).max(tick_frames);
    let input_spec = match (is_required, output.backend.as_str()) {
        (true, _) => Ok(input_spec.clone()),
        (false, "jack") => Ok(AudioSpec::without_options(Backend::Jack)),
        (false, "pulse") => Ok(AudioSpec::without_options(Backend::Pulse)),
        (false, other) => Err(format!("{other} has no inputs")),
    };
    let opened_input = input_spec.and_then(|input_spec| {
        audio::open_input(&input_spec, sample_rate, channels, block_frames).map_err(|error| error.to_string())
    });
    let (input, reader) = match opened_input {
        Ok(opened_input) => opened_input,
        Err(error_text) if is_required => return Err(AudioError::Broken(error_text).into()),
        Err(error_text) => {
            input_status.description = format!("no input ({error_text}): {silence_sentence}");
            return Ok((None, input_status));
        }
    };
    let input_info = input.info();
    let total_latency = input_info.latency_s + frames_ahead as f64 / simulation.rate() + output.latency_s;
    input_status.description = format!(
        "{}, {:.1} ms to the loudspeaker",
        input_info.description,
        1000.0 * total_latency
    );
    input_status.input = Some(input);
    let mut tap = None;
    if let Some(record_path) = &config.record_path {
        let (sound_tap, tap_handle) = audio::tap(record_path, sample_rate, channels)?;
        (tap, input_status.recording) = (Some(sound_tap), Some(tap_handle));
    }
    let samples = vec![0.0; tick_frames * channels];
    let sound_input = SoundInput {
        reader,
        samples,
        tap,
        fill_target: frames_ahead,
    };
    Ok((Some(sound_input), input_status))
}

impl SoundInput {
    /// Whether `ring_frames` frames in the ring are enough.
    pub(super) fn has_enough(&self, ring_frames: usize) -> bool {
        ring_frames >= self.fill_target
    }

    /// Pass the input of a tick, which begins at `frame`, to the simulation. Until the card `is_playing` the input is
    /// silence, because the frames before are computed without waiting.
    pub(super) fn tick(&mut self, simulation: &mut Simulation, frame: u64, n_frames: usize, is_playing: bool) {
        let channels = self.reader.channels();
        let samples = &mut self.samples[..n_frames * channels];
        if is_playing {
            self.reader.read(samples);
        } else {
            samples.fill(0.0);
        }
        simulation.feed_input_samples(samples, channels);
        if let Some(sound_tap) = &mut self.tap {
            sound_tap.push(frame, samples, false);
        }
    }

    /// An input that a test feeds.
    #[cfg(test)]
    pub(super) fn fed_by_test(reader: InputReader, tick_frames: usize, tap: AudioTap) -> Self {
        let samples = vec![0.0; tick_frames * reader.channels()];
        Self {
            reader,
            samples,
            tap: Some(tap),
            fill_target: usize::MAX,
        }
    }
}
