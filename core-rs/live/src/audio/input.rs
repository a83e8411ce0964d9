//! A sound input: from a card to the physics through the same ring as for outputs, in the other direction.
//!
//! The card's callback pushes and the physics takes; neither waits. Missing frames are replaced by silence and counted.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::output::Event;
use super::ring::{CHANNELS_MAX, Drain, Feed};
use super::shared::Shared;
use super::source::{OpenedInput, Source};
use super::spec::{Backend, Spec};
use super::{AudioError, jack, pulse, rate, ring};

/// Time between two checks by the supervisor.
const CHECK_INTERVAL: Duration = Duration::from_millis(50);
/// Time between two attempts to find a server that died.
const RETRY: Duration = Duration::from_secs(1);
/// If more than this many times the wanted frames wait in the ring, the excess is thrown away: otherwise the input
/// would be heard later and later.
const EXCESS_FACTOR: usize = 4;

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
    pub sentence: String,
}

/// An open input, until it is dropped.
pub struct Input {
    state: Arc<InputState>,
    supervisor: Option<JoinHandle<()>>,
}

struct InputState {
    spec: Spec,
    channels: usize,
    shared: Arc<Shared>,
    began: Instant,
    stop: AtomicBool,
    report: Mutex<(InputInfo, Vec<Event>)>,
}

/// The end of an input on the physics thread; it neither allocates nor waits.
pub struct InputReader {
    drain: Drain,
    /// Frames that wait in the ring before sound begins, and begins again after an underrun.
    target: usize,
    /// Whether `read` was called. Frames that came before are old: they are dropped and not counted.
    has_begun: bool,
}

impl InputReader {
    /// The end of a ring that holds `target` frames before sound begins, at `rate` [Hz].
    #[must_use]
    pub fn new(mut drain: Drain, target: usize, rate: u32) -> Self {
        drain.set_rate(rate);
        drain.set_outermost(false);
        let target = target.max(1);
        Self {
            drain,
            target,
            has_begun: false,
        }
    }

    /// Fill interleaved frames. Missing frames become silence, with ramps of 2 ms before and after it, and are counted.
    pub fn read(&mut self, out: &mut [f32]) {
        if !std::mem::replace(&mut self.has_begun, true) {
            self.drain.catch_up(0);
            self.drain.set_outermost(true);
        }
        let frames = out.len() / self.drain.channels();
        let wanted_frames = self.target + frames;
        if self.drain.waiting() > EXCESS_FACTOR * wanted_frames {
            self.drain.catch_up(wanted_frames);
        }
        self.drain.fill(out);
    }

    /// Channels of a frame.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.drain.channels()
    }
}

/// Open `channels` of the input that `spec` names, at `rate` [Hz], for a physics that takes `frames_at_once` frames at
/// once.
///
/// # Errors
/// A sentence on why the input cannot be opened; nothing was started then.
pub fn open_input(
    spec: &Spec,
    rate: u32,
    channels: usize,
    frames_at_once: usize,
) -> Result<(Input, InputReader), AudioError> {
    if !(1..=CHANNELS_MAX).contains(&channels) {
        let why = format!("an input has 1 to {CHANNELS_MAX}");
        return Err(AudioError::Channels { channels, why });
    }
    let shared = Arc::new(Shared::default());
    let opened = connect(spec, channels, &shared)?;
    let block_frames = opened.block as usize;
    let mut target_frames = block_frames + frames_at_once;
    let capacity = (2 * EXCESS_FACTOR * (target_frames + block_frames)).max(opened.rate as usize / 4);
    let (feed, inner_drain) = ring::joined(channels, capacity, shared.clone());
    feed.set_prefill(target_frames);
    let mut info = InputInfo {
        backend: opened.backend.into(),
        device: opened.device.clone(),
        rate: opened.rate,
        channels,
        block: opened.block,
        latency_s: 0.0,
        sentence: String::new(),
    };
    let (converter, drain) = if opened.rate == rate {
        (None, inner_drain)
    } else {
        let conversion = rate::convert_rate(inner_drain, opened.rate, rate, opened.block.max(frames_at_once as u32));
        let (converter, outer_drain) = conversion.map_err(|(_, error)| error)?;
        target_frames = converter.latency;
        (Some(converter), outer_drain)
    };
    info.latency_s = target_frames as f64 / f64::from(rate);
    let input_source = (opened.start)(feed).map_err(|(_, error)| error)?;
    info.latency_s += f64::from(input_source.latency()) / f64::from(info.rate);
    info.sentence = sentence(&info, rate);
    let state = Arc::new(InputState {
        spec: spec.clone(),
        channels,
        shared,
        began: Instant::now(),
        stop: AtomicBool::new(false),
        report: Mutex::new((info, Vec::new())),
    });
    state.shared.set_alive(true);
    let thread_state = state.clone();
    let supervisor = std::thread::Builder::new()
        .name("ergon input".into())
        .spawn(move || thread_state.supervise(input_source, converter))
        .map_err(AudioError::Thread)?;
    let input = Input {
        state,
        supervisor: Some(supervisor),
    };
    Ok((input, InputReader::new(drain, target_frames, rate)))
}

fn connect(spec: &Spec, channels: usize, shared: &Arc<Shared>) -> Result<OpenedInput, AudioError> {
    match &spec.backend {
        Backend::Jack => jack::open_input(spec, channels, shared),
        Backend::Pulse => pulse::open_input(spec, channels),
        _ => Err(AudioError::Unavailable {
            backend: "input",
            why: format!("{spec} has no inputs; use jack or pulse"),
        }),
    }
}

fn sentence(info: &InputInfo, rate: u32) -> String {
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
    pub fn events(&self) -> Vec<Event> {
        self.state.report().1.clone()
    }

    /// Counts: `underruns` and `missing` for silence put in, `discarded` for frames in excess.
    #[must_use]
    pub fn shared(&self) -> &Arc<Shared> {
        &self.state.shared
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
    fn report(&self) -> MutexGuard<'_, (InputInfo, Vec<Event>)> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add_event(&self, sentence: String) {
        let event = Event {
            time: self.began.elapsed().as_secs_f64(),
            frame: self.shared.played(),
            sentence,
        };
        self.report().1.push(event);
    }

    /// Keep the input open until it is stopped.
    fn supervise(&self, source: Box<dyn Source>, converter: Option<rate::Converter>) {
        let mut source = Some(source);
        let mut idle_feed = None;
        let mut next_retry = Instant::now();
        while !self.stop.load(Ordering::Acquire) {
            std::thread::park_timeout(CHECK_INTERVAL);
            match &mut source {
                Some(stream) => {
                    if stream.is_alive() {
                        continue;
                    }
                    self.shared.set_alive(false);
                    self.add_event(format!(
                        "the input {} is lost; it is silent until it is found again",
                        self.spec
                    ));
                    idle_feed = source.take().and_then(Source::stop);
                    next_retry = Instant::now() + RETRY;
                }
                None if Instant::now() < next_retry => {}
                None => {
                    next_retry = Instant::now() + RETRY;
                    let Some(stream) = idle_feed.take() else {
                        break;
                    };
                    match self.reopen(stream) {
                        Ok(back) => {
                            source = Some(back);
                            self.shared.set_alive(true);
                            self.add_event(format!("the input {} is back", self.spec));
                        }
                        Err(stream) => idle_feed = stream.map(|stream| *stream),
                    }
                }
            }
        }
        drop(source.map(Source::stop));
        drop(converter.map(rate::Converter::stop));
    }

    /// Open the input again, at the rate that it had; otherwise return the feed.
    fn reopen(&self, feed: Feed) -> Result<Box<dyn Source>, Option<Box<Feed>>> {
        let source_rate = self.report().0.rate;
        match connect(&self.spec, self.channels, &self.shared) {
            Ok(opened) if opened.rate == source_rate => (opened.start)(feed).map_err(|(feed, _)| feed),
            _ => Err(Some(Box::new(feed))),
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
        let (mut feed, drain) = ring::ring(1, 4096);
        feed.set_prefill(300);
        let mut reader = InputReader::new(drain, 300, 48_000);
        assert_eq!(read_frames(&mut reader, 64), [0.0; 64], "silence before the first");
        let pushed_sound: Vec<f32> = (0..2560).map(|n| n as f32).collect();
        let mut read_sound = Vec::new();
        for block in pushed_sound.chunks(256) {
            assert_eq!(feed.push(block), 256);
            (0..4).for_each(|_| read_sound.extend(read_frames(&mut reader, 64)));
        }
        let sound_start = read_sound.iter().position(|&x| x != 0.0).expect("sound") - 1;
        // It rises within 2 ms, then every sample is as it came.
        assert_eq!(
            read_sound[sound_start + 96..],
            pushed_sound[96..read_sound.len() - sound_start]
        );
        assert_eq!(feed.shared().underruns(), 0);
    }

    #[test]
    fn input_reader_counts_missing_frames_as_silence() {
        let (mut feed, drain) = ring::ring(2, 4096);
        feed.set_prefill(1);
        let mut reader = InputReader::new(drain, 1, 48_000);
        read_frames(&mut reader, 1);
        feed.push(&[1.0; 400]);
        read_frames(&mut reader, 100);
        assert_eq!(read_frames(&mut reader, 100), [1.0; 200]);
        let faded_frames = read_frames(&mut reader, 200);
        assert!(
            faded_frames
                .windows(4)
                .all(|w| (w[0] - w[2]).abs() <= 1.0 / 96.0 + 1e-6)
        );
        assert_eq!(faded_frames[398..], [0.0, 0.0]);
        assert_eq!(feed.shared().underruns(), 1);
        assert_eq!(feed.shared().missing(), 200);
    }

    #[test]
    fn input_reader_discards_excess_frames() {
        let (mut feed, drain) = ring::ring(1, 4096);
        feed.set_prefill(100);
        let mut reader = InputReader::new(drain, 100, 48_000);
        let pushed_sound: Vec<f32> = (0..2000).map(|n| n as f32).collect();
        feed.push(&pushed_sound);
        assert_eq!(read_frames(&mut reader, 50), [0.0; 50]);
        assert_eq!(feed.filled(), 0, "what came before it begins is old");
        assert_eq!(feed.shared().discarded(), 0);
        feed.push(&pushed_sound);
        read_frames(&mut reader, 50);
        assert_eq!(feed.shared().discarded(), 2000 - 150);
        assert_eq!(feed.filled(), 100);
        assert_eq!(read_frames(&mut reader, 100)[99], 1999.0);
    }
}
