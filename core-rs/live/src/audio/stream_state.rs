//! State that the physics, the card and the player share during playback: atomics only.

use std::sync::atomic::{AtomicBool, AtomicI32, AtomicI64, AtomicU32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::stop;

/// No frame has gone to the card yet.
const NOT_STARTED: i64 = i64::MIN;
/// Number of edges of silence that are kept.
const EDGES_MAX: usize = 256;

/// An edge of a panic's silence: its beginning or its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SilenceEdge {
    /// Frame of the score at which the sound begins to fall, or to rise again.
    pub frame: u64,
    /// Whether silence begins there.
    pub is_start: bool,
}

/// State of the sound of one performance. Every method may be called from any thread, also from the callback.
pub struct StreamState {
    opened_at: Instant,
    /// When frame 0 went to the card, or would have gone, calculated from the last block [ns since `opened_at`].
    first_frame_nanos: AtomicI64,
    /// Frames of the score that were thrown away, before or behind a converter.
    skipped_frames: AtomicU64,
    panic: AtomicBool,
    alive: AtomicBool,
    freewheel: AtomicBool,
    is_finished: AtomicBool,
    underruns: AtomicU64,
    missing_frames: AtomicU64,
    played_frames: AtomicU64,
    discarded_frames: AtomicU64,
    xruns: AtomicU64,
    priority: AtomicI32,
    latency: AtomicU32,
    block: AtomicU32,
    /// The latest edges, each frame · 2 + silent, and how many there were.
    edges: [AtomicU64; EDGES_MAX],
    n_edges: AtomicU64,
}

impl Default for StreamState {
    fn default() -> Self {
        Self {
            opened_at: Instant::now(),
            first_frame_nanos: AtomicI64::new(NOT_STARTED),
            skipped_frames: AtomicU64::new(0),
            panic: AtomicBool::default(),
            alive: AtomicBool::default(),
            freewheel: AtomicBool::default(),
            is_finished: AtomicBool::default(),
            underruns: AtomicU64::default(),
            missing_frames: AtomicU64::default(),
            played_frames: AtomicU64::default(),
            discarded_frames: AtomicU64::default(),
            xruns: AtomicU64::default(),
            priority: AtomicI32::default(),
            latency: AtomicU32::default(),
            block: AtomicU32::default(),
            edges: [const { AtomicU64::new(0) }; EDGES_MAX],
            n_edges: AtomicU64::default(),
        }
    }
}

macro_rules! count {
    ($(#[$doc:meta])* $name:ident, $add:ident) => {
        $(#[$doc])*
        #[must_use]
        pub fn $name(&self) -> u64 {
            self.$name.load(Ordering::Relaxed)
        }

        pub(super) fn $add(&self, n: u64) {
            self.$name.fetch_add(n, Ordering::Relaxed);
        }
    };
}

impl StreamState {
    /// Silence within 5 ms, in the callback itself, and no sound until `release`; meanwhile frames are dropped from the
    /// ring as fast as they would be heard.
    pub fn panic(&self) {
        self.panic.store(true, Ordering::Release);
    }

    /// Sound again, faded in, from what is pushed from now on: the frames that wait in the ring are dropped.
    pub fn release(&self) {
        self.panic.store(false, Ordering::Release);
    }

    /// Whether silence is requested.
    #[must_use]
    pub fn is_panicking(&self) -> bool {
        self.panic.load(Ordering::Acquire) || stop::is_silenced()
    }

    /// Whether a card (or a file, or the silent clock that was asked for) takes the frames. False before `open`, after
    /// the end, and while the supervisor looks for a server that died.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.alive.load(Ordering::Acquire)
    }

    pub(super) fn set_alive(&self, is_alive: bool) {
        self.alive.store(is_alive, Ordering::Release);
    }

    /// Whether the server runs as fast as its clients (JACK's freewheel): then frames can be fed without a clock.
    #[must_use]
    pub fn is_freewheeling(&self) -> bool {
        self.freewheel.load(Ordering::Acquire)
    }

    pub(super) fn set_freewheel(&self, is_on: bool) {
        self.freewheel.store(is_on, Ordering::Release);
    }

    /// Whether the ring writer was closed and its last frame went to the card.
    #[must_use]
    pub fn has_finished(&self) -> bool {
        self.is_finished.load(Ordering::Acquire)
    }

    pub(super) fn set_finished(&self) {
        self.is_finished.store(true, Ordering::Release);
    }

    count! {
        /// Number of times that the ring went empty while it should have sounded.
        underruns, add_underruns
    }
    count! {
        /// Frames of silence that underruns put in (frames of the card).
        missing_frames, add_missing
    }
    count! {
        /// Frames thrown away: by a panic, and of an input those in excess.
        discarded_frames, add_discarded
    }
    count! {
        /// Late cycles that the server, the card or the silent clock reported. PipeWire's JACK reports none.
        xruns, add_xruns
    }

    /// Frames of the score that went to the card.
    #[must_use]
    pub fn played_frames(&self) -> u64 {
        self.played_frames.load(Ordering::Acquire)
    }

    pub(super) fn set_played(&self, frames: u64) {
        self.played_frames.store(frames, Ordering::Release);
    }

    /// How long ago frame 0 of the ring went to the card, calculated from the last block: frame n goes n frames later.
    /// Silence of an underrun shifts it. `None` before the first block.
    #[must_use]
    pub fn first_frame_age(&self) -> Option<Duration> {
        let zero_nanos = self.first_frame_nanos.load(Ordering::Acquire);
        let nanos_now = i64::try_from(self.opened_at.elapsed().as_nanos()).unwrap_or(i64::MAX);
        (zero_nanos != NOT_STARTED)
            .then(|| Duration::from_nanos(nanos_now.saturating_sub(zero_nanos).max(0).unsigned_abs()))
    }

    /// Report that a block that begins with frame `n`, at `rate` [Hz], goes to the card now.
    pub(super) fn set_block_start(&self, n: u64, rate: f64) {
        let n = n + self.skipped_frames.load(Ordering::Relaxed);
        let nanos_before = (n as f64 / rate * 1e9) as i64;
        let nanos_now = i64::try_from(self.opened_at.elapsed().as_nanos()).unwrap_or(i64::MAX);
        self.first_frame_nanos
            .store(nanos_now.saturating_sub(nanos_before), Ordering::Release);
    }

    pub(super) fn add_skipped(&self, frames: u64) {
        self.skipped_frames.fetch_add(frames, Ordering::Relaxed);
    }

    pub(super) fn skipped_frames(&self) -> u64 {
        self.skipped_frames.load(Ordering::Relaxed)
    }

    /// Edges of silence from number `first_number` on, at most the latest 256.
    #[must_use]
    pub fn edges(&self, first_number: u64) -> Vec<SilenceEdge> {
        let edge_count = self.n_edges.load(Ordering::Acquire);
        let decode_edge = |number: u64| {
            let packed_edge = self.edges[number as usize % EDGES_MAX].load(Ordering::Relaxed);
            SilenceEdge {
                frame: packed_edge >> 1,
                is_start: packed_edge & 1 == 1,
            }
        };
        (first_number.max(edge_count.saturating_sub(EDGES_MAX as u64))..edge_count)
            .map(decode_edge)
            .collect()
    }

    /// Add an edge. Only the ring reader that feeds the loudspeakers calls this, so there is one writer.
    pub(super) fn add_edge(&self, frame: u64, is_start: bool) {
        let edge_count = self.n_edges.load(Ordering::Relaxed);
        let packed_edge = frame << 1 | u64::from(is_start);
        self.edges[edge_count as usize % EDGES_MAX].store(packed_edge, Ordering::Relaxed);
        self.n_edges.store(edge_count + 1, Ordering::Release);
    }

    /// SCHED_FIFO priority that the card's thread actually has; `None`: no real-time priority.
    #[must_use]
    pub fn priority(&self) -> Option<i32> {
        Some(self.priority.load(Ordering::Relaxed)).filter(|priority| *priority > 0)
    }

    pub(super) fn set_priority(&self, priority: Option<i32>) {
        self.priority.store(priority.unwrap_or(0), Ordering::Relaxed);
    }

    /// (frames that the card asks for per block, frames from the ring to the ear as far as the server reports them), in
    /// frames of the card.
    #[must_use]
    pub fn timing(&self) -> (u32, u32) {
        let block_frames = self.block.load(Ordering::Relaxed);
        (block_frames, self.latency.load(Ordering::Relaxed))
    }

    pub(super) fn set_timing(&self, block: u32, latency: u32) {
        self.block.store(block, Ordering::Relaxed);
        self.latency.store(latency, Ordering::Relaxed);
    }
}
