//! The ring between the physics and the sound card: `Feed` stays with the physics, `Drain` goes to the card.
//!
//! Neither allocates, locks or panics while it plays. Outside gaps and panics, samples pass unchanged.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rtrb::{Consumer, Producer, RingBuffer};

use super::output_fades::OutputFades;
use super::shared::Shared;

/// Most channels of a frame.
pub const CHANNELS_MAX: usize = 64;
const POLL: Duration = Duration::from_micros(100);

/// The physics' side: it takes whole interleaved frames.
pub struct Feed {
    samples: Producer<f32>,
    channels: usize,
    capacity: usize,
    gate: Arc<Gate>,
    shared: Arc<Shared>,
}

/// The card's side.
pub struct Drain {
    samples: Consumer<f32>,
    channels: usize,
    gate: Arc<Gate>,
    shared: Arc<Shared>,
    phase: Phase,
    fades: OutputFades,
    /// The edge that begins the silence of a panic was reported, and the edge that ends it was not yet.
    silence_reported: bool,
    /// Frames that waited when a panic ended: they are dropped.
    outdated_frames: usize,
    /// Whether this drain feeds the loudspeakers; the inner drain of a rate converter reports nothing.
    outermost: bool,
    written: FrameCounts,
    /// Rate of the frames that are handed out [Hz].
    rate: u32,
}

/// State shared by both ends of one ring.
struct Gate {
    closed: AtomicBool,
    prefill: AtomicUsize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// No frame came yet, or all were dropped: silence that does not count as missing.
    Waiting,
    Playing,
    /// The ring went empty while it played: silent until it holds the prefill again.
    Starved,
}

/// Frames that were given to the card, and the rates to count them in frames of the score.
#[derive(Clone, Copy)]
struct FrameCounts {
    before: u64,
    frames: u64,
    score_rate: u64,
    card_rate: u64,
}

/// A ring of `capacity` frames of `channels`. The card begins, and begins again after an underrun, once the ring is
/// half full (or as full as `Feed::set_prefill` says), or closed.
///
/// # Panics
///
/// Unless `channels` is 1 to 64.
#[must_use]
pub fn ring(channels: usize, capacity: usize) -> (Feed, Drain) {
    joined(channels, capacity, Arc::new(Shared::default()))
}

/// A ring that reports to `shared`.
pub(super) fn joined(channels: usize, capacity: usize, shared: Arc<Shared>) -> (Feed, Drain) {
    assert!((1..=CHANNELS_MAX).contains(&channels), "1 to {CHANNELS_MAX} channels");
    let capacity = capacity.max(1);
    let (producer, consumer) = RingBuffer::new(capacity * channels);
    let gate = Arc::new(Gate {
        closed: AtomicBool::new(false),
        prefill: AtomicUsize::new(capacity / 2),
    });
    let feed = Feed {
        samples: producer,
        channels,
        capacity,
        gate: gate.clone(),
        shared: shared.clone(),
    };
    let drain = Drain {
        samples: consumer,
        channels,
        gate,
        shared,
        phase: Phase::Waiting,
        silence_reported: false,
        outdated_frames: 0,
        fades: OutputFades::new(channels, 48_000),
        outermost: true,
        written: FrameCounts {
            before: 0,
            frames: 0,
            score_rate: 1,
            card_rate: 1,
        },
        rate: 48_000,
    };
    (feed, drain)
}

impl FrameCounts {
    /// Total number in frames of the score.
    fn score(self) -> u64 {
        self.before + self.frames * self.score_rate / self.card_rate
    }
}

impl Feed {
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
    pub fn room(&self) -> usize {
        self.samples.slots() / self.channels
    }

    /// Frames that wait for the card.
    #[must_use]
    pub fn filled(&self) -> usize {
        self.capacity - self.room()
    }

    /// Push interleaved frames; returns how many were taken, whole frames only.
    pub fn push(&mut self, frames: &[f32]) -> usize {
        let frames_taken = self.room().min(frames.len() / self.channels);
        let samples = frames.get(..frames_taken * self.channels).unwrap_or(&[]);
        self.samples.push_entire_slice(samples).map_or(0, |()| frames_taken)
    }

    /// Push frames; those without room are dropped, and counted if any frame was played before.
    pub(super) fn offer(&mut self, frames: &[f32]) {
        let frames_lost = frames.len() / self.channels - self.push(frames);
        if self.shared.played() > 0 {
            self.shared.add_discarded(frames_lost as u64);
        }
    }

    /// Number of frames that must wait before the card begins, and begins again after an underrun.
    pub fn set_prefill(&self, frames: usize) {
        let frames = frames.min(self.capacity);
        self.gate.prefill.store(frames, Ordering::Relaxed);
    }

    /// Mark the end: the card plays what is in the ring, then stops. Dropping does the same.
    pub fn close(&self) {
        self.gate.closed.store(true, Ordering::Release);
    }

    /// The state that both sides share.
    #[must_use]
    pub fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.close();
    }
}

impl Drain {
    /// Channels of a frame.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The state that both sides share.
    #[must_use]
    pub fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }

    /// Set the rate of the frames that are handed out [Hz]; it gives the ramps their duration.
    pub(super) fn set_rate(&mut self, rate: u32) {
        self.fades.set_rate(rate);
        self.rate = rate.max(1);
    }

    /// Say whether this drain feeds the loudspeakers; if not, it stands before another ring and reports nothing.
    pub(super) fn set_outermost(&mut self, outermost: bool) {
        self.outermost = outermost;
        self.count_from(self.shared.played(), 1, 1);
    }

    /// Count frames from now on as `card_rate`, of a score at `score_rate` of which `before` frames were played.
    pub(super) fn count_from(&mut self, before: u64, score_rate: u32, card_rate: u32) {
        self.written = FrameCounts {
            before,
            frames: 0,
            score_rate: score_rate.into(),
            card_rate: card_rate.max(1).into(),
        };
    }

    /// The card behind this drain changed: the next frames rise from silence, if anything was heard before.
    pub(super) fn changed_card(&mut self) {
        if self.phase != Phase::Waiting {
            self.phase = Phase::Starved;
            self.fades.restart();
        }
    }

    /// Frames that wait.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.samples.slots() / self.channels
    }

    /// Whether the feed was closed and all frames were handed out.
    #[must_use]
    pub fn ended(&self) -> bool {
        // `closed` is read first, so that everything pushed before closing is counted.
        self.gate.closed.load(Ordering::Acquire) && self.waiting() == 0
    }

    /// Fill interleaved frames, for the card's callback. Silence before the first frames and after the end; at an
    /// underrun the sound falls to silence within 2 ms, and the underrun is counted.
    pub fn fill(&mut self, out: &mut [f32]) {
        let n_complete = out.len() - out.len() % self.channels;
        let (out, partial_frame) = out.split_at_mut(n_complete);
        partial_frame.fill(0.0);
        let is_silenced = self.update_panic();
        if is_silenced && self.fades.request_hush() {
            // Frames are dropped at the pace at which they would be heard, so that the sound before and after keeps its
            // time.
            self.discard(out.len() / self.channels);
            out.fill(0.0);
            return;
        }
        let outdated = self.drop_outdated(out.len() / self.channels);
        let (unheard, out) = out.split_at_mut(outdated * self.channels);
        unheard.fill(0.0);
        if out.is_empty() {
            return;
        }
        let is_closed = self.gate.closed.load(Ordering::Acquire);
        let waiting = self.waiting();
        if self.phase != Phase::Playing
            && (waiting >= self.gate.prefill.load(Ordering::Relaxed).max(1) || is_closed && waiting > 0)
        {
            self.phase = Phase::Playing;
        }
        let sound_frames = match self.phase {
            Phase::Playing => waiting.min(out.len() / self.channels),
            _ => 0,
        };
        let (sounding, silent_samples) = out.split_at_mut(sound_frames * self.channels);
        if self.samples.pop_entire_slice(sounding).is_err() {
            sounding.fill(0.0);
        }
        self.fades.shape_sound(sounding);
        self.count_played(sound_frames, is_closed && sound_frames == waiting);
        if !silent_samples.is_empty() {
            self.fill_gap(silent_samples, is_closed && sound_frames == waiting, is_silenced);
        }
        self.fades.apply_hush(out);
    }

    /// Drop what waits except for the last `keep` frames; the next frames rise from silence.
    pub(super) fn catch_up(&mut self, keep: usize) {
        let waiting = self.waiting();
        self.discard(waiting.saturating_sub(keep));
        self.fades.restart();
    }

    /// Hand out the frames that wait, at most `out`, to a reader without a clock; returns their number.
    pub fn take(&mut self, out: &mut [f32]) -> usize {
        if self.update_panic() && self.fades.request_hush() {
            let frames_dropped = self.discard(out.len() / self.channels);
            out[..frames_dropped * self.channels].fill(0.0);
            return frames_dropped;
        }
        let has_ended = self.ended();
        let frames_taken = self.waiting().min(out.len() / self.channels);
        if frames_taken == 0 {
            self.count_played(0, has_ended);
            return 0;
        }
        self.phase = Phase::Playing;
        self.fill(&mut out[..frames_taken * self.channels]);
        frames_taken
    }

    /// Wait until `frames` wait or no more can come. Only for a callback of a freewheeling server.
    pub(super) fn wait_for(&self, frames: usize, limit: Duration) {
        let deadline = Instant::now() + limit;
        let frames = frames.min(self.samples.buffer().capacity() / self.channels);
        while self.phase == Phase::Playing
            && self.waiting() < frames
            && !self.gate.closed.load(Ordering::Acquire)
            && !self.shared.panicked()
            && Instant::now() < deadline
        {
            std::thread::sleep(POLL);
        }
    }

    /// Whether silence is requested, or a fall to silence is not finished.
    fn update_panic(&mut self) -> bool {
        if self.shared.panicked() || self.fades.is_falling_silent() {
            if std::mem::take(&mut self.outdated_frames) > 0 {
                self.fades.hush_now();
            }
            if !std::mem::replace(&mut self.silence_reported, true) {
                self.report_edge(true);
            }
            return true;
        }
        if self.fades.end_hush() {
            // Frames that were computed during the panic are out of date.
            self.outdated_frames = self.waiting();
            self.fades.restart();
        }
        self.end_silence();
        false
    }

    /// Drop at most `limit` of the frames that a panic left out of date; returns how many.
    fn drop_outdated(&mut self, limit: usize) -> usize {
        if self.outdated_frames == 0 {
            return 0;
        }
        let frames_dropped = self.discard(limit.min(self.outdated_frames));
        self.outdated_frames -= frames_dropped;
        self.end_silence();
        frames_dropped
    }

    fn end_silence(&mut self) {
        if self.outdated_frames == 0 && std::mem::take(&mut self.silence_reported) {
            self.report_edge(false);
            if self.waiting() == 0 {
                self.phase = Phase::Waiting;
            }
        }
    }

    fn report_edge(&self, silent: bool) {
        if self.outermost {
            let edge_frame = self.written.score() + self.shared.skipped();
            self.shared.add_edge(edge_frame, silent);
        }
    }

    fn fill_gap(&mut self, silent: &mut [f32], ended: bool, is_silenced: bool) {
        if self.phase == Phase::Playing && !ended {
            self.phase = Phase::Starved;
            self.fades.begin_gap();
            if self.outermost && !is_silenced {
                self.shared.add_underruns(1);
            }
        }
        self.fades.fill_gap(silent);
        if self.phase == Phase::Starved && !ended && !is_silenced && self.outermost {
            let missing_frames = silent.len() / self.channels;
            self.shared.add_missing(missing_frames as u64);
        }
    }

    fn count_played(&mut self, frames: usize, ended: bool) {
        if !self.outermost {
            return;
        }
        let frame_counts = &mut self.written;
        if frames > 0 {
            let played_rate = f64::from(self.rate) * frame_counts.score_rate as f64 / frame_counts.card_rate as f64;
            self.shared.set_block_start(frame_counts.score(), played_rate);
        }
        frame_counts.frames += frames as u64;
        self.shared.set_played(frame_counts.score());
        if ended {
            self.shared.set_finished();
        }
    }

    /// Drop at most `limit` frames, or all if the ring is closed; returns how many, at most `limit`.
    fn discard(&mut self, limit: usize) -> usize {
        let is_closed = self.gate.closed.load(Ordering::Acquire);
        let waiting = self.waiting();
        let frames_dropped = if is_closed { waiting } else { waiting.min(limit) };
        if let Ok(ring_chunk) = self.samples.read_chunk(frames_dropped * self.channels) {
            ring_chunk.commit_all();
        }
        let frame_counts = self.written;
        let skipped = frames_dropped as u64 * frame_counts.score_rate / frame_counts.card_rate;
        self.shared.add_skipped(skipped);
        if self.outermost {
            self.shared.add_discarded(frames_dropped as u64);
            if is_closed && frames_dropped == waiting {
                self.shared.set_finished();
            }
        }
        frames_dropped.min(limit)
    }
}
