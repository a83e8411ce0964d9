//! A sound input: from a card to the physics through the same ring as for outputs, in the other direction.
//!
//! The card's callback pushes and the physics takes; neither waits. Missing frames are replaced by silence and counted.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::output::AudioEvent;
use super::ring::{CHANNELS_MAX, RingReader, RingWriter};
use super::source::{OpenedInput, Source};
use super::spec::{AudioSpec, Backend};
use super::stream_state::StreamState;
use super::{AudioError, jack, pulse, rate, ring};

/// Time between two checks by the supervisor.
const CHECK_INTERVAL: Duration = Duration::from_millis(50);
/// Time between two attempts to find a server that died.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);
/// If more than this many times the wanted frames wait in the ring, the excess is thrown away: otherwise the input
/// would be heard later and later.
const RING_EXCESS_FACTOR: usize = 4;

/// Properties of an input.
#[derive(Clone, Debug)]
pub struct InputInfo {
    /// `jack` or `pulse`.
    pub backend: String,
    /// The source.
    pub device: String,
    /// Rate of the card [Hz].
    pub rate: u32,
    /// Channels of a frame.
    pub channels: usize,
    /// Frames that the card gives per block.
    pub block: u32,
    /// Latency from the microphone to the physics [s]: that of the server, the frames that wait in the ring, and the
    /// conversion.
    pub latency_s: f64,
    /// All of the above in words.
    pub description: String,
}

/// An open input, until it is dropped.
pub struct Input {
    state: Arc<InputState>,
    supervisor: Option<JoinHandle<()>>,
}

struct InputState {
    spec: AudioSpec,
    channels: usize,
    stream_state: Arc<StreamState>,
    opened_at: Instant,
    stop: AtomicBool,
    report: Mutex<(InputInfo, Vec<AudioEvent>)>,
}

/// The end of an input on the physics thread; it neither allocates nor waits.
pub struct InputReader {
    ring_reader: RingReader,
    /// Frames that wait in the ring before sound begins, and begins again after an underrun.
    target_frames: usize,
    /// Whether `read` was called. Frames that came before are old: they are dropped and not counted.
    has_been_read: bool,
}

impl InputReader {
    /// The end of a ring that holds `target` frames before sound begins, at `rate` [Hz].
    #[must_use]
    pub fn new(mut ring_reader: RingReader, target: usize, rate: u32) -> Self {
        ring_reader.set_rate(rate);
        ring_reader.set_feeds_device(false);
        let target_frames = target.max(1);
        Self {
            ring_reader,
            target_frames,
            has_been_read: false,
        }
    }

    /// Fill interleaved frames. Missing frames become silence, with ramps of 2 ms before and after it, and are counted.
    pub fn read(&mut self, out: &mut [f32]) {
        if !std::mem::replace(&mut self.has_been_read, true) {
            self.ring_reader.discard_excess(0);
            self.ring_reader.set_feeds_device(true);
        }
        let frames = out.len() / self.ring_reader.channels();
        let wanted_frames = self.target_frames + frames;
        if self.ring_reader.waiting_frames() > RING_EXCESS_FACTOR * wanted_frames {
            self.ring_reader.discard_excess(wanted_frames);
        }
        self.ring_reader.fill(out);
    }

    /// Channels of a frame.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.ring_reader.channels()
    }
}

/// Open `channels` of the input that `spec` names, at `rate` [Hz], for a physics that takes `frames_at_once` frames at
/// once.
///
/// # Errors
/// A sentence on why the input cannot be opened; nothing was started then.
pub fn open_input(
    spec: &AudioSpec,
    rate: u32,
    channels: usize,
    frames_at_once: usize,
) -> Result<(Input, InputReader), AudioError> {
    if !(1..=CHANNELS_MAX).contains(&channels) {
        let reason = format!("an input has 1 to {CHANNELS_MAX}");
        return Err(AudioError::Channels { channels, reason });
    }
    let stream_state = Arc::new(StreamState::default());
    let opened_input = connect(spec, channels, &stream_state)?;
    let block_frames = opened_input.block as usize;
    let mut target_frames = block_frames + frames_at_once;
    let capacity = (2 * RING_EXCESS_FACTOR * (target_frames + block_frames)).max(opened_input.rate as usize / 4);
    let (ring_writer, device_reader) = ring::ring_with_state(channels, capacity, stream_state.clone());
    ring_writer.set_prefill(target_frames);
    let mut info = InputInfo {
        backend: opened_input.backend.into(),
        device: opened_input.device.clone(),
        rate: opened_input.rate,
        channels,
        block: opened_input.block,
        latency_s: 0.0,
        description: String::new(),
    };
    let (converter, ring_reader) = if opened_input.rate == rate {
        (None, device_reader)
    } else {
        let conversion = rate::convert_rate(
            device_reader,
            opened_input.rate,
            rate,
            opened_input.block.max(frames_at_once as u32),
        );
        let (converter, converted_reader) = conversion.map_err(|(_, error)| error)?;
        target_frames = converter.latency;
        (Some(converter), converted_reader)
    };
    info.latency_s = target_frames as f64 / f64::from(rate);
    let input_source = (opened_input.start)(ring_writer).map_err(|(_, error)| error)?;
    info.latency_s += f64::from(input_source.latency()) / f64::from(info.rate);
    info.description = description_text(&info, rate);
    let state = Arc::new(InputState {
        spec: spec.clone(),
        channels,
        stream_state,
        opened_at: Instant::now(),
        stop: AtomicBool::new(false),
        report: Mutex::new((info, Vec::new())),
    });
    state.stream_state.set_alive(true);
    let thread_state = state.clone();
    let supervisor = std::thread::Builder::new()
        .name("ergon input".into())
        .spawn(move || thread_state.supervise(input_source, converter))
        .map_err(AudioError::Thread)?;
    let input = Input {
        state,
        supervisor: Some(supervisor),
    };
    Ok((input, InputReader::new(ring_reader, target_frames, rate)))
}

fn connect(spec: &AudioSpec, channels: usize, stream_state: &Arc<StreamState>) -> Result<OpenedInput, AudioError> {
    match &spec.backend {
        Backend::Jack => jack::open_input(spec, channels, stream_state),
        Backend::Pulse => pulse::open_input(spec, channels),
        _ => Err(AudioError::Unavailable {
            backend: "input",
            reason: format!("{spec} has no inputs; use jack or pulse"),
        }),
    }
}

fn description_text(info: &InputInfo, rate: u32) -> String {
    let channels = match info.channels {
        1 => "1 channel".into(),
        n => format!("{n} channels"),
    };
    let mut description = format!(
        "{} ({}): {channels} in at {} Hz, {} frames at a time, {:.1} ms to the instrument",
        info.backend,
        info.device,
        info.rate,
        info.block,
        1000.0 * info.latency_s
    );
    if info.rate != rate {
        description += &format!("; converted to {rate} Hz");
    }
    description
}

impl Input {
    /// Properties of the input.
    #[must_use]
    pub fn info(&self) -> InputInfo {
        self.state.report().0.clone()
    }

    /// Events since the input was opened.
    #[must_use]
    pub fn events(&self) -> Vec<AudioEvent> {
        self.state.report().1.clone()
    }

    /// Counts: `underruns` and `missing` for silence put in, `discarded` for frames in excess.
    #[must_use]
    pub fn stream_state(&self) -> &Arc<StreamState> {
        &self.state.stream_state
    }
}

impl Drop for Input {
    fn drop(&mut self) {
        self.state.stop.store(true, Ordering::Release);
        if let Some(supervisor) = self.supervisor.take() {
            supervisor.thread().unpark();
            let _ = supervisor.join();
        }
    }
}

impl InputState {
    fn report(&self) -> MutexGuard<'_, (InputInfo, Vec<AudioEvent>)> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add_event(&self, sentence: String) {
        let event = AudioEvent {
            time: self.opened_at.elapsed().as_secs_f64(),
            frame: self.stream_state.played_frames(),
            sentence,
        };
        self.report().1.push(event);
    }

    /// Keep the input open until it is stopped.
    fn supervise(&self, source: Box<dyn Source>, converter: Option<rate::Converter>) {
        let mut source = Some(source);
        let mut idle_writer = None;
        let mut next_retry = Instant::now();
        while !self.stop.load(Ordering::Acquire) {
            std::thread::park_timeout(CHECK_INTERVAL);
            match &mut source {
                Some(ring_writer) => {
                    if ring_writer.is_alive() {
                        continue;
                    }
                    self.stream_state.set_alive(false);
                    self.add_event(format!(
                        "the input {} is lost; it is silent until it is found again",
                        self.spec
                    ));
                    idle_writer = source.take().and_then(Source::stop);
                    next_retry = Instant::now() + RETRY_INTERVAL;
                }
                None if Instant::now() < next_retry => {}
                None => {
                    next_retry = Instant::now() + RETRY_INTERVAL;
                    let Some(ring_stream) = idle_writer.take() else {
                        break;
                    };
                    match self.reopen(ring_stream) {
                        Ok(new_source) => {
                            source = Some(new_source);
                            self.stream_state.set_alive(true);
                            self.add_event(format!("the input {} is back", self.spec));
                        }
                        Err(stream) => idle_writer = stream.map(|ring_writer| *ring_writer),
                    }
                }
            }
        }
        drop(source.map(Source::stop));
        drop(converter.map(rate::Converter::stop));
    }

    /// Open the input again, at the rate that it had; otherwise return the ring writer.
    fn reopen(&self, ring_writer: RingWriter) -> Result<Box<dyn Source>, Option<Box<RingWriter>>> {
        let source_rate = self.report().0.rate;
        match connect(&self.spec, self.channels, &self.stream_state) {
            Ok(opened_input) if opened_input.rate == source_rate => {
                (opened_input.start)(ring_writer).map_err(|(ring_writer, _)| ring_writer)
            }
            _ => Err(Some(Box::new(ring_writer))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_frames(reader: &mut InputReader, frames: usize) -> Vec<f32> {
        let mut samples = vec![f32::NAN; frames * reader.channels()];
        reader.read(&mut samples);
        samples
    }

    #[test]
    fn input_reader_returns_frames_in_time() {
        let (mut ring_writer, ring_reader) = ring::ring(1, 4096);
        ring_writer.set_prefill(300);
        let mut reader = InputReader::new(ring_reader, 300, 48_000);
        assert_eq!(read_frames(&mut reader, 64), [0.0; 64], "silence before the first");
        let pushed_sound: Vec<f32> = (0..2560).map(|n| n as f32).collect();
        let mut read_sound = Vec::new();
        for block in pushed_sound.chunks(256) {
            assert_eq!(ring_writer.push(block), 256);
            (0..4).for_each(|_| read_sound.extend(read_frames(&mut reader, 64)));
        }
        let sound_start = read_sound.iter().position(|&x| x != 0.0).expect("sound") - 1;
        // It rises within 2 ms, then every sample is as it came.
        assert_eq!(
            read_sound[sound_start + 96..],
            pushed_sound[96..read_sound.len() - sound_start]
        );
        assert_eq!(ring_writer.stream_state().underruns(), 0);
    }

    #[test]
    fn input_reader_counts_missing_frames_as_silence() {
        let (mut ring_writer, ring_reader) = ring::ring(2, 4096);
        ring_writer.set_prefill(1);
        let mut reader = InputReader::new(ring_reader, 1, 48_000);
        read_frames(&mut reader, 1);
        ring_writer.push(&[1.0; 400]);
        read_frames(&mut reader, 100);
        assert_eq!(read_frames(&mut reader, 100), [1.0; 200]);
        let faded_frames = read_frames(&mut reader, 200);
        assert!(
            faded_frames
                .windows(4)
                .all(|w| (w[0] - w[2]).abs() <= 1.0 / 96.0 + 1e-6)
        );
        assert_eq!(faded_frames[398..], [0.0, 0.0]);
        assert_eq!(ring_writer.stream_state().underruns(), 1);
        assert_eq!(ring_writer.stream_state().missing_frames(), 200);
    }

    #[test]
    fn input_reader_discards_excess_frames() {
        let (mut ring_writer, ring_reader) = ring::ring(1, 4096);
        ring_writer.set_prefill(100);
        let mut reader = InputReader::new(ring_reader, 100, 48_000);
        let pushed_sound: Vec<f32> = (0..2000).map(|n| n as f32).collect();
        ring_writer.push(&pushed_sound);
        assert_eq!(read_frames(&mut reader, 50), [0.0; 50]);
        assert_eq!(ring_writer.filled_frames(), 0, "what came before it begins is old");
        assert_eq!(ring_writer.stream_state().discarded_frames(), 0);
        ring_writer.push(&pushed_sound);
        read_frames(&mut reader, 50);
        assert_eq!(ring_writer.stream_state().discarded_frames(), 2000 - 150);
        assert_eq!(ring_writer.filled_frames(), 100);
        assert_eq!(read_frames(&mut reader, 100)[99], 1999.0);
    }
}
