//! The ring between the physics and the sound card: `RingWriter` stays with the physics, `RingReader` goes to the card.
//!
//! Neither allocates, locks or panics while it plays. Outside gaps and panics, samples pass unchanged.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rtrb::{Consumer, Producer, RingBuffer};

use super::output_fades::OutputFades;
use super::stream_state::StreamState;

/// Most channels of a frame.
pub const CHANNELS_MAX: usize = 64;
const POLL_INTERVAL: Duration = Duration::from_micros(100);

/// The physics' side: it takes whole interleaved frames.
pub struct RingWriter {
    samples: Producer<f32>,
    channels: usize,
    capacity: usize,
    control: Arc<RingControl>,
    stream_state: Arc<StreamState>,
}

/// The card's side.
pub struct RingReader {
    samples: Consumer<f32>,
    channels: usize,
    control: Arc<RingControl>,
    stream_state: Arc<StreamState>,
    phase: PlaybackPhase,
    fades: OutputFades,
    /// The edge that begins the silence of a panic was reported, and the edge that ends it was not yet.
    is_silence_reported: bool,
    /// Frames that waited when a panic ended: they are dropped.
    outdated_frames: usize,
    /// Whether this reader feeds the loudspeakers; the inner ring reader of a rate converter reports nothing.
    feeds_device: bool,
    frame_counts: FrameCounts,
    /// Rate of the frames that are handed out [Hz].
    rate: u32,
}

/// State shared by both ends of one ring.
struct RingControl {
    is_closed: AtomicBool,
    prefill: AtomicUsize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum PlaybackPhase {
    /// No frame came yet, or all were dropped: silence that does not count as missing.
    Waiting,
    Playing,
    /// The ring went empty while it played: silent until it holds the prefill again.
    Underrun,
}

/// Frames that were given to the card, and the rates to count them in frames of the score.
#[derive(Clone, Copy)]
struct FrameCounts {
    frames_before: u64,
    frames: u64,
    score_rate: u64,
    card_rate: u64,
}

/// A ring of `capacity` frames of `channels`. The card begins, and begins again after an underrun, once the ring is
/// half full (or as full as `RingWriter::set_prefill` says), or closed.
///
/// # Panics
///
/// Unless `channels` is 1 to 64.
#[must_use]
pub fn ring(channels: usize, capacity: usize) -> (RingWriter, RingReader) {
    ring_with_state(channels, capacity, Arc::new(StreamState::default()))
}

/// A ring that reports to `stream_state`.
pub(super) fn ring_with_state(
    channels: usize,
    capacity: usize,
    stream_state: Arc<StreamState>,
) -> (RingWriter, RingReader) {
    assert!((1..=CHANNELS_MAX).contains(&channels), "1 to {CHANNELS_MAX} channels");
    let capacity = capacity.max(1);
    let (producer, consumer) = RingBuffer::new(capacity * channels);
    let control = Arc::new(RingControl {
        is_closed: AtomicBool::new(false),
        prefill: AtomicUsize::new(capacity / 2),
    });
    let ring_writer = RingWriter {
        samples: producer,
        channels,
        capacity,
        control: control.clone(),
        stream_state: stream_state.clone(),
    };
    let ring_reader = RingReader {
        samples: consumer,
        channels,
        control,
        stream_state,
        phase: PlaybackPhase::Waiting,
        is_silence_reported: false,
        outdated_frames: 0,
        fades: OutputFades::new(channels, 48_000),
        feeds_device: true,
        frame_counts: FrameCounts {
            frames_before: 0,
            frames: 0,
            score_rate: 1,
            card_rate: 1,
        },
        rate: 48_000,
    };
    (ring_writer, ring_reader)
}

impl FrameCounts {
    /// Total number in frames of the score.
    fn score_frames(self) -> u64 {
        self.frames_before + self.frames * self.score_rate / self.card_rate
    }
}

impl RingWriter {
    /// Channels of a frame.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Frames that the ring holds at most.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Frames that may be pushed now.
    #[must_use]
    pub fn free_frames(&self) -> usize {
        self.samples.slots() / self.channels
    }

    /// Frames that wait for the card.
    #[must_use]
    pub fn filled_frames(&self) -> usize {
        self.capacity - self.free_frames()
    }

    /// Push interleaved frames; returns how many were taken, whole frames only.
    pub fn push(&mut self, frames: &[f32]) -> usize {
        let frames_taken = self.free_frames().min(frames.len() / self.channels);
        let samples = frames.get(..frames_taken * self.channels).unwrap_or(&[]);
        self.samples.push_entire_slice(samples).map_or(0, |()| frames_taken)
    }

    /// Push frames; those without room are dropped, and counted if any frame was played before.
    pub(super) fn push_or_discard(&mut self, frames: &[f32]) {
        let frames_lost = frames.len() / self.channels - self.push(frames);
        if self.stream_state.played_frames() > 0 {
            self.stream_state.add_discarded(frames_lost as u64);
        }
    }

    /// Number of frames that must wait before the card begins, and begins again after an underrun.
    pub fn set_prefill(&self, frames: usize) {
        let frames = frames.min(self.capacity);
        self.control.prefill.store(frames, Ordering::Relaxed);
    }

    /// Mark the end: the card plays what is in the ring, then stops. Dropping does the same.
    pub fn close(&self) {
        self.control.is_closed.store(true, Ordering::Release);
    }

    /// The state that both sides share.
    #[must_use]
    pub fn stream_state(&self) -> &Arc<StreamState> {
        &self.stream_state
    }
}

impl Drop for RingWriter {
    fn drop(&mut self) {
        self.close();
    }
}

impl RingReader {
    /// Channels of a frame.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The state that both sides share.
    #[must_use]
    pub fn stream_state(&self) -> &Arc<StreamState> {
        &self.stream_state
    }

    /// Set the rate of the frames that are handed out [Hz]; it gives the ramps their duration.
    pub(super) fn set_rate(&mut self, rate: u32) {
        self.fades.set_rate(rate);
        self.rate = rate.max(1);
    }

    /// Say whether this reader feeds the loudspeakers; if not, it stands before another ring and reports nothing.
    pub(super) fn set_feeds_device(&mut self, feeds_device: bool) {
        self.feeds_device = feeds_device;
        self.start_counting(self.stream_state.played_frames(), 1, 1);
    }

    /// Count frames from now on as `card_rate`, of a score at `score_rate` of which `frames_before` frames were played.
    pub(super) fn start_counting(&mut self, frames_before: u64, score_rate: u32, card_rate: u32) {
        self.frame_counts = FrameCounts {
            frames_before,
            frames: 0,
            score_rate: score_rate.into(),
            card_rate: card_rate.max(1).into(),
        };
    }

    /// The card behind this ring reader changed: the next frames rise from silence, if anything was heard before.
    pub(super) fn restart_after_card_change(&mut self) {
        if self.phase != PlaybackPhase::Waiting {
            self.phase = PlaybackPhase::Underrun;
            self.fades.restart();
        }
    }

    /// Frames that wait.
    #[must_use]
    pub fn waiting_frames(&self) -> usize {
        self.samples.slots() / self.channels
    }

    /// Whether the ring writer was closed and all frames were handed out.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        // `is_closed` is read first, so that everything pushed before closing is counted.
        self.control.is_closed.load(Ordering::Acquire) && self.waiting_frames() == 0
    }

    /// Fill interleaved frames, for the card's callback. Silence before the first frames and after the end; at an
    /// underrun the sound falls to silence within 2 ms, and the underrun is counted.
    pub fn fill(&mut self, out: &mut [f32]) {
        let n_complete = out.len() - out.len() % self.channels;
        let (out, partial_frame) = out.split_at_mut(n_complete);
        partial_frame.fill(0.0);
        let is_silenced = self.update_panic();
        if is_silenced && self.fades.request_mute() {
            // Frames are dropped at the pace at which they would be heard, so that the sound before and after keeps its
            // time.
            self.discard(out.len() / self.channels);
            out.fill(0.0);
            return;
        }
        let outdated_count = self.discard_outdated(out.len() / self.channels);
        let (outdated_samples, out) = out.split_at_mut(outdated_count * self.channels);
        outdated_samples.fill(0.0);
        if out.is_empty() {
            return;
        }
        let is_closed = self.control.is_closed.load(Ordering::Acquire);
        let waiting_frames = self.waiting_frames();
        if self.phase != PlaybackPhase::Playing
            && (waiting_frames >= self.control.prefill.load(Ordering::Relaxed).max(1)
                || is_closed && waiting_frames > 0)
        {
            self.phase = PlaybackPhase::Playing;
        }
        let sound_frames = match self.phase {
            PlaybackPhase::Playing => waiting_frames.min(out.len() / self.channels),
            _ => 0,
        };
        let (playing_samples, silent_samples) = out.split_at_mut(sound_frames * self.channels);
        if self.samples.pop_entire_slice(playing_samples).is_err() {
            playing_samples.fill(0.0);
        }
        self.fades.shape_sound(playing_samples);
        self.count_played(sound_frames, is_closed && sound_frames == waiting_frames);
        if !silent_samples.is_empty() {
            self.fill_gap(silent_samples, is_closed && sound_frames == waiting_frames, is_silenced);
        }
        self.fades.apply_mute(out);
    }

    /// Drop what waits except for the last `frames_to_keep` frames; the next frames rise from silence.
    pub(super) fn discard_excess(&mut self, frames_to_keep: usize) {
        let waiting_frames = self.waiting_frames();
        self.discard(waiting_frames.saturating_sub(frames_to_keep));
        self.fades.restart();
    }

    /// Hand out the frames that wait, at most `out`, to a reader without a clock; returns their number.
    pub fn take_waiting(&mut self, out: &mut [f32]) -> usize {
        if self.update_panic() && self.fades.request_mute() {
            let frames_dropped = self.discard(out.len() / self.channels);
            out[..frames_dropped * self.channels].fill(0.0);
            return frames_dropped;
        }
        let has_ended = self.has_ended();
        let frames_taken = self.waiting_frames().min(out.len() / self.channels);
        if frames_taken == 0 {
            self.count_played(0, has_ended);
            return 0;
        }
        self.phase = PlaybackPhase::Playing;
        self.fill(&mut out[..frames_taken * self.channels]);
        frames_taken
    }

    /// Wait until `frames` wait or no more can come. Only for a callback of a freewheeling server.
    pub(super) fn wait_for(&self, frames: usize, limit: Duration) {
        let deadline = Instant::now() + limit;
        let frames = frames.min(self.samples.buffer().capacity() / self.channels);
        while self.phase == PlaybackPhase::Playing
            && self.waiting_frames() < frames
            && !self.control.is_closed.load(Ordering::Acquire)
            && !self.stream_state.is_panicking()
            && Instant::now() < deadline
        {
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    /// Whether silence is requested, or a fall to silence is not finished.
    fn update_panic(&mut self) -> bool {
        if self.stream_state.is_panicking() || self.fades.is_falling_silent() {
            if std::mem::take(&mut self.outdated_frames) > 0 {
                self.fades.mute_now();
            }
            if !std::mem::replace(&mut self.is_silence_reported, true) {
                self.report_edge(true);
            }
            return true;
        }
        if self.fades.end_mute() {
            // Frames that were computed during the panic are out of date.
            self.outdated_frames = self.waiting_frames();
            self.fades.restart();
        }
        self.end_silence();
        false
    }

    /// Drop at most `limit` of the frames that a panic left out of date; returns how many.
    fn discard_outdated(&mut self, limit: usize) -> usize {
        if self.outdated_frames == 0 {
            return 0;
        }
        let frames_dropped = self.discard(limit.min(self.outdated_frames));
        self.outdated_frames -= frames_dropped;
        self.end_silence();
        frames_dropped
    }

    fn end_silence(&mut self) {
        if self.outdated_frames == 0 && std::mem::take(&mut self.is_silence_reported) {
            self.report_edge(false);
            if self.waiting_frames() == 0 {
                self.phase = PlaybackPhase::Waiting;
            }
        }
    }

    fn report_edge(&self, is_silence_start: bool) {
        if self.feeds_device {
            let edge_frame = self.frame_counts.score_frames() + self.stream_state.skipped_frames();
            self.stream_state.add_edge(edge_frame, is_silence_start);
        }
    }

    fn fill_gap(&mut self, silent_samples: &mut [f32], has_ended: bool, is_silenced: bool) {
        if self.phase == PlaybackPhase::Playing && !has_ended {
            self.phase = PlaybackPhase::Underrun;
            self.fades.begin_gap();
            if self.feeds_device && !is_silenced {
                self.stream_state.add_underruns(1);
            }
        }
        self.fades.fill_gap(silent_samples);
        if self.phase == PlaybackPhase::Underrun && !has_ended && !is_silenced && self.feeds_device {
            let missing_frames = silent_samples.len() / self.channels;
            self.stream_state.add_missing(missing_frames as u64);
        }
    }

    fn count_played(&mut self, frames: usize, has_ended: bool) {
        if !self.feeds_device {
            return;
        }
        let frame_counts = &mut self.frame_counts;
        if frames > 0 {
            let played_rate = f64::from(self.rate) * frame_counts.score_rate as f64 / frame_counts.card_rate as f64;
            self.stream_state
                .set_block_start(frame_counts.score_frames(), played_rate);
        }
        frame_counts.frames += frames as u64;
        self.stream_state.set_played(frame_counts.score_frames());
        if has_ended {
            self.stream_state.set_finished();
        }
    }

    /// Drop at most `limit` frames, or all if the ring is closed; returns how many, at most `limit`.
    fn discard(&mut self, limit: usize) -> usize {
        let is_closed = self.control.is_closed.load(Ordering::Acquire);
        let waiting_frames = self.waiting_frames();
        let frames_dropped = if is_closed {
            waiting_frames
        } else {
            waiting_frames.min(limit)
        };
        if let Ok(ring_chunk) = self.samples.read_chunk(frames_dropped * self.channels) {
            ring_chunk.commit_all();
        }
        let frame_counts = self.frame_counts;
        let skipped_frames = frames_dropped as u64 * frame_counts.score_rate / frame_counts.card_rate;
        self.stream_state.add_skipped(skipped_frames);
        if self.feeds_device {
            self.stream_state.add_discarded(frames_dropped as u64);
            if is_closed && frames_dropped == waiting_frames {
                self.stream_state.set_finished();
            }
        }
        frames_dropped.min(limit)
    }
}
