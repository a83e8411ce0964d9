//! Conversion between the rates of the score and the card, in a thread between two rings: a card's callback never
//! resamples.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rubato::audioadapter_buffers::direct::InterleavedSlice;
use rubato::{Fft, FixedSync, Indexing, Resampler as _};

use super::AudioError;
use super::ring::{self, RingReader, RingWriter};
use super::sink::{OutputFailure, RingThread, SINK_THREAD_PRIORITY, Sink};
use crate::realtime;

/// Frames that are converted at once. More frames: the filter's cutoff is nearer to half the rate, and the latency is
/// longer.
const CHUNK_FRAMES: usize = 512;
const POLL_INTERVAL: Duration = Duration::from_micros(200);

/// The converter's thread, and its latency [frames at the output rate].
pub(super) struct Converter {
    ring_thread: RingThread<RingReader>,
    pub(super) latency: usize,
}

/// Put a converter from rate `input_rate` to rate `output_rate` behind the ring `inner_reader`, for a reader that takes
/// `block_frames` at a time; returns the ring reader for that reader.
pub(super) fn convert_rate(
    mut inner_reader: RingReader,
    input_rate: u32,
    output_rate: u32,
    block_frames: u32,
) -> Result<(Converter, RingReader), OutputFailure> {
    let channels = inner_reader.channels();
    let resampler = match Resampler::new(input_rate, output_rate, channels) {
        Ok(resampler) => resampler,
        Err(error) => return Err((Some(Box::new(inner_reader)), error)),
    };
    let stream_state = inner_reader.stream_state().clone();
    let frames_ahead = 2 * block_frames as usize + resampler.output.len() / channels;
    let (ring_writer, mut converted_reader) = ring::ring_with_state(channels, 2 * frames_ahead, stream_state.clone());
    ring_writer.set_prefill(frames_ahead);
    converted_reader.set_rate(output_rate);
    converted_reader.start_counting(stream_state.played_frames(), input_rate, output_rate);
    inner_reader.set_feeds_device(false);
    let latency = frames_ahead + resampler.delay;
    let ring_thread = RingThread::start("ergon rate", inner_reader, move |inner_reader, stop| {
        realtime::set_priority(SINK_THREAD_PRIORITY);
        resampler.run(inner_reader, ring_writer, stop)
    })?;
    Ok((Converter { ring_thread, latency }, converted_reader))
}

impl Converter {
    pub(super) fn is_alive(&mut self) -> bool {
        self.ring_thread.is_alive()
    }

    /// Stop, and return the inner ring reader.
    pub(super) fn stop(self) -> Option<RingReader> {
        let (mut ring_reader, _) = Box::new(self.ring_thread).stop();
        if let Some(ring_reader) = &mut ring_reader {
            ring_reader.set_feeds_device(true);
        }
        ring_reader
    }
}

struct Resampler {
    fft: Fft<f32>,
    channels: usize,
    input_rate: u64,
    output_rate: u64,
    delay: usize,
    input: Vec<f32>,
    output: Vec<f32>,
}

impl Resampler {
    fn new(input_rate: u32, output_rate: u32, channels: usize) -> Result<Self, AudioError> {
        let fft = Fft::new_custom(
            input_rate as usize,
            output_rate as usize,
            CHUNK_FRAMES,
            1,
            channels,
            rubato::WindowFunction::BlackmanHarris2,
            FixedSync::Input,
        )
        .map_err(|error| AudioError::Rate {
            from: input_rate,
            to: output_rate,
            reason: error.to_string(),
        })?;
        Ok(Self {
            channels,
            input_rate: input_rate.into(),
            output_rate: output_rate.into(),
            delay: fft.output_delay(),
            input: vec![0.0; fft.input_frames_max() * channels],
            output: vec![0.0; fft.output_frames_max() * channels],
            fft,
        })
    }

    fn run(
        mut self,
        inner_reader: &mut RingReader,
        mut ring_writer: RingWriter,
        stop: &AtomicBool,
    ) -> Result<(), String> {
        let channels = self.channels;
        let (mut frames_in, mut frames_out) = (0_u64, 0_u64);
        let mut frames_skipped = 0; // frames of the filter's own delay, which come before the first frame of the input
        let mut frames_held = 0;
        while !stop.load(Ordering::Acquire) {
            let frames_wanted = self.fft.input_frames_next();
            let frames_taken =
                inner_reader.take_waiting(&mut self.input[frames_held * channels..frames_wanted * channels]);
            (frames_held, frames_in) = (frames_held + frames_taken, frames_in + frames_taken as u64);
            let has_ended = frames_taken == 0 && inner_reader.has_ended();
            if frames_held < frames_wanted && !has_ended {
                std::thread::sleep(POLL_INTERVAL);
                continue;
            }
            let frames_due = (frames_in * self.output_rate).div_ceil(self.input_rate);
            if has_ended && frames_out >= frames_due {
                ring_writer.close();
                std::thread::sleep(POLL_INTERVAL);
                continue;
            }
            let mut n_frames = self.convert(frames_held)?;
            frames_held = 0;
            let skip_count = n_frames.min(self.delay - frames_skipped);
            frames_skipped += skip_count;
            n_frames -= skip_count;
            if has_ended {
                n_frames = n_frames.min(usize::try_from(frames_due - frames_out).unwrap_or(usize::MAX));
            }
            let mut samples_left = &self.output[skip_count * channels..(skip_count + n_frames) * channels];
            while !samples_left.is_empty() && !stop.load(Ordering::Acquire) {
                match ring_writer.push(samples_left) {
                    0 => std::thread::sleep(POLL_INTERVAL),
                    frames => samples_left = &samples_left[frames * channels..],
                }
            }
            frames_out += n_frames as u64;
        }
        Ok(())
    }

    /// Convert the first `frames_held` frames of the input; the rest of the input counts as silence.
    fn convert(&mut self, frames_held: usize) -> Result<usize, String> {
        let channels = self.channels;
        let input_slice = InterleavedSlice::new(&self.input, channels, self.input.len() / channels);
        let frame_capacity = self.output.len() / channels;
        let output_slice = InterleavedSlice::new_mut(&mut self.output, channels, frame_capacity);
        let (Ok(input_slice), Ok(mut output_slice)) = (input_slice, output_slice) else {
            return Err("the rate converter's buffers have no whole frames".into());
        };
        let indexing = Indexing::new().partial_len(frames_held);
        self.fft
            .process_into_buffer(&input_slice, &mut output_slice, Some(&indexing))
            .map(|(_, frames_written)| frames_written)
            .map_err(|error| format!("the rate converter failed: {error}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ergon_engine::maths::sin;
    use std::f64::consts::TAU;

    /// One second of a sine at `input_rate` [Hz], converted to `output_rate` [Hz], two channels.
    fn convert_sine(from: u32, to: u32, pitch: f64) -> Vec<f32> {
        let (mut ring_writer, ring_reader) = ring::ring(2, 4096);
        let (converter, mut converted_reader) = convert_rate(ring_reader, from, to, 256)
            .map_err(|(_, error)| error)
            .expect("the rates can be converted");
        let source_sound: Vec<f32> = (0..from)
            .flat_map(|n| {
                let sine_sample = sin(TAU * pitch * f64::from(n) / f64::from(from)) as f32;
                [sine_sample, -sine_sample]
            })
            .collect();
        let mut sound_left = &source_sound[..];
        let (mut all_samples, mut block_samples) = (Vec::new(), [0.0; 512]);
        while !converted_reader.has_ended() {
            let frames_taken = ring_writer.push(sound_left);
            sound_left = &sound_left[2 * frames_taken..];
            if sound_left.is_empty() {
                ring_writer.close();
            }
            match converted_reader.take_waiting(&mut block_samples) {
                0 => std::thread::sleep(POLL_INTERVAL),
                frames => all_samples.extend_from_slice(&block_samples[..2 * frames]),
            }
        }
        let source_reader = converter.stop().expect("the drain comes back");
        assert!(source_reader.has_ended());
        assert_eq!(source_reader.stream_state().played_frames(), u64::from(from));
        all_samples
    }

    #[test]
    fn converted_sine_keeps_duration_and_pitch() {
        for (from, to) in [(44_100, 48_000), (48_000, 44_100), (96_000, 48_000)] {
            for pitch in [440.0, 10_000.0] {
                let output_sound = convert_sine(from, to, pitch);
                assert_eq!(output_sound.len(), 2 * to as usize, "{from} to {to}");
                // Near the beginning and the end, the filter also covers the silence outside.
                for n in 1000..to as usize - 1000 {
                    let sine_sample = sin(TAU * pitch * n as f64 / f64::from(to)) as f32;
                    let (left_sample, right_sample) = (output_sound[2 * n], output_sound[2 * n + 1]);
                    assert!(
                        (left_sample - sine_sample).abs() < 2e-4,
                        "{from} to {to}, {pitch} Hz, {n}"
                    );
                    assert_eq!(left_sample, -right_sample);
                }
            }
        }
    }
}
