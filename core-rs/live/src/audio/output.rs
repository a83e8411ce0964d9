//! A playing output: its properties, and the supervisor that reconnects to a server that died.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::ring::{CHANNELS_MAX, RingReader};
use super::sink::{OpenedOutput, OutputFailure, Sink};
use super::spec::{AudioSpec, Backend};
use super::stream_state::StreamState;
use super::{AudioError, connect, null, rate};

/// Time between two checks by the supervisor.
const CHECK_INTERVAL: Duration = Duration::from_millis(50);
/// Waits before the first attempt to find a server that died, and longest wait between two attempts.
const RETRY_INTERVALS: (Duration, Duration) = (Duration::from_millis(500), Duration::from_secs(2));

/// Properties of an output.
#[derive(Clone, Debug)]
pub struct OutputInfo {
    /// `jack`, `pulse`, `system`, `file` or `null`.
    pub backend: String,
    /// The device that it plays on.
    pub device: String,
    /// Rate of the card [Hz].
    pub rate: u32,
    /// Rate of the score [Hz]; if it differs from the card's, the sound is converted.
    pub score_rate: u32,
    /// Channels of a frame.
    pub channels: usize,
    /// Frames that the card asks for per block.
    pub block: u32,
    /// Latency from the ring to the ear, as far as the server reports it [s].
    pub latency_s: f64,
    /// Whether a clock takes the frames. If not, they can be fed as fast as they are computed.
    pub is_paced: bool,
    /// SCHED_FIFO priority of the card's thread; `None`: scheduled like any other.
    pub priority: Option<i32>,
    /// All of the above in words.
    pub description: String,
}

/// Timing of the frames that go to the card.
#[derive(Clone, Copy, Debug)]
pub struct PlaybackTiming {
    /// How long ago frame 0 went to the card [s], calculated from the last block.
    pub first_frame_age: f64,
    /// From the card to the ear [s].
    pub latency: f64,
    /// Number of underruns.
    pub underruns: u64,
    /// Whether a card takes the frames.
    pub is_alive: bool,
}

/// Reports the timing of the sound to any thread.
pub struct SoundClock(Arc<OutputState>);

impl SoundClock {
    /// Timing of the frames; `None` before the first block, and for outputs without a clock.
    #[must_use]
    pub fn playback_timing(&self) -> Option<PlaybackTiming> {
        let (card_rate, is_paced) = {
            let info = &self.0.report().info;
            (info.rate, info.is_paced)
        };
        let stream_state = &self.0.stream_state;
        let (_, latency) = stream_state.timing();
        let first_frame_age = stream_state.first_frame_age().filter(|_| is_paced)?;
        Some(PlaybackTiming {
            first_frame_age: first_frame_age.as_secs_f64(),
            latency: f64::from(latency) / f64::from(card_rate.max(1)),
            underruns: stream_state.underruns(),
            is_alive: stream_state.is_alive(),
        })
    }
}

/// An event of the sound output or input.
#[derive(Clone, Debug)]
pub struct AudioEvent {
    /// Time since the output or input was opened [s].
    pub time: f64,
    /// Frames that had been played by then.
    pub frame: u64,
    /// What happened.
    pub sentence: String,
}

/// An open output that plays what is fed, until it is closed or dropped.
pub struct Output {
    state: Arc<OutputState>,
    supervisor: Option<JoinHandle<Option<String>>>,
}

struct OutputState {
    spec: AudioSpec,
    score_rate: u32,
    channels: usize,
    stream_state: Arc<StreamState>,
    opened_at: Instant,
    stop: AtomicBool,
    report: Mutex<OutputReport>,
}

struct OutputReport {
    info: OutputInfo,
    remarks: Vec<String>,
    events: Vec<AudioEvent>,
}

/// Open the output `spec` for the frames that come through `ring_reader`: `channels` at `rate` [Hz].
///
/// # Errors
///
/// A sentence on why the output cannot be opened; nothing was started then.
pub fn open(spec: &AudioSpec, rate: u32, channels: usize, ring_reader: RingReader) -> Result<Output, AudioError> {
    if !(1..=CHANNELS_MAX).contains(&channels) || channels != ring_reader.channels() {
        return Err(AudioError::Channels {
            channels,
            reason: format!("an output has 1 to {CHANNELS_MAX}, as many as the ring"),
        });
    }
    let stream_state = ring_reader.stream_state().clone();
    let (opened_output, connected_spec) = connect::connect(spec, rate, channels, &stream_state)?;
    let state = OutputState {
        // If the server dies, the supervisor looks for the backend that `auto` found, not for any other.
        spec: connected_spec,
        score_rate: rate,
        channels,
        stream_state,
        opened_at: Instant::now(),
        stop: AtomicBool::new(false),
        report: Mutex::new(OutputReport {
            info: OutputInfo::new(&opened_output, rate, channels),
            remarks: opened_output.remarks.clone(),
            events: Vec::new(),
        }),
    };
    let playback = Playback::start(opened_output, rate, ring_reader).map_err(|(_, error)| error)?;
    state.report_start(&playback);
    let state = Arc::new(state);
    let thread_state = state.clone();
    let supervisor = std::thread::Builder::new()
        .name("ergon supervisor".into())
        .spawn(move || thread_state.supervise(playback))
        .map_err(AudioError::Thread)?;
    Ok(Output {
        state,
        supervisor: Some(supervisor),
    })
}

impl Output {
    /// Properties of the output now.
    #[must_use]
    pub fn info(&self) -> OutputInfo {
        let report = self.state.report();
        let mut info = report.info.clone();
        info.priority = self.state.stream_state.priority();
        info.description = description_text(&info, &report.remarks);
        info
    }

    /// A handle that reports the timing of the sound to another thread.
    #[must_use]
    pub fn sound_clock(&self) -> SoundClock {
        SoundClock(self.state.clone())
    }

    /// Events since the output was opened.
    #[must_use]
    pub fn events(&self) -> Vec<AudioEvent> {
        self.state.report().events.clone()
    }

    /// Counts, and the panic switch.
    #[must_use]
    pub fn stream_state(&self) -> &Arc<StreamState> {
        &self.state.stream_state
    }

    /// Wait until the ring writer is closed and all of it was heard; false if `limit` passes first.
    #[must_use]
    pub fn wait(&self, limit: Duration) -> bool {
        let deadline = Instant::now() + limit;
        while !self.state.stream_state.has_finished() {
            if Instant::now() >= deadline {
                return false;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let output_info = self.info();
        if output_info.is_paced {
            // Frames that left the ring are still on their way through the card.
            let block_time = f64::from(output_info.block) / f64::from(output_info.rate);
            std::thread::sleep(Duration::from_secs_f64(output_info.latency_s + block_time));
        }
        true
    }

    /// Stop; a file is finished and gets its final name.
    ///
    /// # Errors
    ///
    /// An error during playback or writing, e.g. a file that could not be written.
    pub fn close(&mut self) -> Result<(), AudioError> {
        let Some(supervisor) = self.supervisor.take() else {
            return Ok(());
        };
        self.state.stop.store(true, Ordering::Release);
        supervisor.thread().unpark();
        match supervisor.join() {
            Ok(None) => Ok(()),
            Ok(Some(sentence)) => Err(AudioError::Broken(sentence)),
            Err(_) => Err(AudioError::Broken(
                "the thread that supervises the sound panicked".into(),
            )),
        }
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        // Errors are dropped here; call `close` to get them.
        let _ = self.close();
    }
}

impl OutputInfo {
    fn new(opened_output: &OpenedOutput, score_rate: u32, channels: usize) -> Self {
        Self {
            backend: opened_output.backend.into(),
            device: opened_output.device.clone(),
            rate: opened_output.rate,
            score_rate,
            channels,
            block: opened_output.block,
            latency_s: 0.0,
            is_paced: opened_output.is_paced,
            priority: None,
            description: String::new(),
        }
    }
}

fn description_text(info: &OutputInfo, remarks: &[String]) -> String {
    let channels = match info.channels {
        1 => "1 channel".into(),
        n => format!("{n} channels"),
    };
    let mut description = format!(
        "{} ({}): {channels} at {} Hz, {} frames at a time",
        info.backend, info.device, info.rate, info.block
    );
    if info.latency_s > 0.0 {
        description += &format!(", {:.1} ms to the card", 1000.0 * info.latency_s);
    }
    if info.rate != info.score_rate {
        description += &format!("; converted from {} Hz", info.score_rate);
    }
    for remark in remarks {
        description += "; ";
        description += remark;
    }
    description
}

impl OutputState {
    fn report(&self) -> MutexGuard<'_, OutputReport> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add_event(&self, sentence: String) {
        let event = AudioEvent {
            time: self.opened_at.elapsed().as_secs_f64(),
            frame: self.stream_state.played_frames(),
            sentence,
        };
        self.report().events.push(event);
    }

    fn report_start(&self, playback: &Playback) {
        self.stream_state.set_alive(true);
        self.update_latency(playback);
    }

    fn update_latency(&self, playback: &Playback) {
        let (block_frames, latency) = self.stream_state.timing();
        let mut report = self.report();
        let latency = f64::from(latency) + playback.converter_latency() as f64;
        report.info.latency_s = latency / f64::from(report.info.rate.max(1));
        report.info.block = block_frames;
    }

    /// Keep the output playing until it is stopped; returns the last error, if any.
    fn supervise(&self, mut playback: Playback) -> Option<String> {
        while !self.stop.load(Ordering::Acquire) {
            std::thread::park_timeout(CHECK_INTERVAL);
            if playback.is_alive() {
                self.update_latency(&playback);
                continue;
            }
            self.stream_state.set_alive(false);
            self.stream_state.set_freewheel(false);
            let (ring_reader, failure) = playback.stop();
            let can_reconnect = matches!(self.spec.backend, Backend::Jack | Backend::Pulse | Backend::System);
            let loss_reason = failure.clone().unwrap_or_else(|| "the device disappeared".into());
            self.add_event(if can_reconnect {
                format!(
                    "{} is lost ({loss_reason}); the piece plays on in silence until the output is found again",
                    self.spec
                )
            } else {
                format!("{} is lost ({loss_reason}); the piece plays on in silence", self.spec)
            });
            let Some(new_playback) = self.play_silence_until_found(ring_reader?, can_reconnect) else {
                return failure.filter(|_| !can_reconnect);
            };
            playback = new_playback;
            self.report_start(&playback);
            self.add_event(format!("{} is back", self.spec));
        }
        self.stream_state.set_alive(false);
        playback.stop().1
    }

    /// Take the frames by the silent clock until the server is back; `None` if the output was stopped first.
    fn play_silence_until_found(&self, ring_reader: RingReader, can_reconnect: bool) -> Option<Playback> {
        let mut playback =
            Playback::start(null::open_paced(self.score_rate, None), self.score_rate, ring_reader).ok()?;
        let mut retry_wait = RETRY_INTERVALS.0;
        let mut next_retry = Instant::now() + retry_wait;
        while !self.stop.load(Ordering::Acquire) {
            std::thread::park_timeout(CHECK_INTERVAL);
            if !can_reconnect || Instant::now() < next_retry {
                continue;
            }
            retry_wait = (retry_wait * 3 / 2).min(RETRY_INTERVALS.1);
            next_retry = Instant::now() + retry_wait;
            let (score_rate, channels) = (self.score_rate, self.channels);
            let Ok((opened_output, _)) = connect::connect(&self.spec, score_rate, channels, &self.stream_state) else {
                continue;
            };
            let (new_info, remarks) = (
                OutputInfo::new(&opened_output, self.score_rate, self.channels),
                opened_output.remarks.clone(),
            );
            let mut ring_reader = playback.stop().0?;
            ring_reader.restart_after_card_change();
            match Playback::start(opened_output, self.score_rate, ring_reader) {
                Ok(new_playback) => {
                    let mut report = self.report();
                    (report.info, report.remarks) = (new_info, remarks);
                    return Some(new_playback);
                }
                Err((ring_reader, _)) => {
                    let silence = null::open_paced(self.score_rate, None);
                    playback = Playback::start(silence, self.score_rate, *ring_reader?).ok()?;
                }
            }
        }
        playback.stop();
        None
    }
}

/// The path from the ring to the card.
struct Playback {
    sink: Box<dyn Sink>,
    converter: Option<rate::Converter>,
}

impl Playback {
    fn start(opened_output: OpenedOutput, score_rate: u32, mut ring_reader: RingReader) -> Result<Self, OutputFailure> {
        ring_reader.set_rate(score_rate);
        if opened_output.rate == score_rate {
            let sink = (opened_output.start)(ring_reader)?;
            return Ok(Self { sink, converter: None });
        }
        let (converter, converted_reader) =
            rate::convert_rate(ring_reader, score_rate, opened_output.rate, opened_output.block)?;
        match (opened_output.start)(converted_reader) {
            Ok(sink) => Ok(Self {
                sink,
                converter: Some(converter),
            }),
            Err((_, error)) => Err((converter.stop().map(Box::new), error)),
        }
    }

    fn is_alive(&mut self) -> bool {
        let is_converter_alive = self.converter.as_mut().is_none_or(rate::Converter::is_alive);
        self.sink.is_alive() && is_converter_alive
    }

    fn converter_latency(&self) -> usize {
        self.converter.as_ref().map_or(0, |converter| converter.latency)
    }

    fn stop(self) -> (Option<RingReader>, Option<String>) {
        let (ring_reader, failure) = self.sink.stop();
        match self.converter {
            Some(converter) => (converter.stop(), failure),
            None => (ring_reader, failure),
        }
    }
}
