//! The thread that carries pictures from a performance to its pages.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use ergon_view::payload::{ByteWriter, kind, write_chunk};
use ergon_view::serve::{Retention, Server};

use super::{PlaybackTimes, WindowReader};
use crate::safety;

/// Time between two checks for a picture, a quarter of a video frame. The thread polls, because waking it would cost
/// the physics thread a system call.
const POLL_INTERVAL: Duration = Duration::from_millis(4);

/// Shows performances to pages, one version after the other, until it is dropped.
pub struct WindowServer {
    reader_sender: Mutex<Sender<(WindowReader, PlaybackTimes)>>,
    n_skipped: Arc<AtomicU64>,
    is_stopping: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl WindowServer {
    /// Start the thread.
    ///
    /// # Errors
    /// The system could not start a thread.
    pub fn start(server: Arc<Server>) -> io::Result<Self> {
        let (reader_sender, new_readers) = channel();
        let mut relay = WindowRelay::new(server, new_readers);
        let is_stopping = Arc::new(AtomicBool::new(false));
        let (n_skipped, is_thread_stopping) = (relay.n_skipped.clone(), is_stopping.clone());
        let relay_thread = thread::Builder::new().name("ergon window".into()).spawn(move || {
            safety::block_signals();
            while !is_thread_stopping.load(Ordering::Acquire) {
                relay.poll();
                thread::sleep(POLL_INTERVAL);
            }
        })?;
        Ok(Self {
            reader_sender: Mutex::new(reader_sender),
            n_skipped,
            is_stopping,
            thread: Some(relay_thread),
        })
    }

    /// Show a version from its first picture on; until then the previous version is shown.
    pub fn show(&self, reader: WindowReader, playback_times: PlaybackTimes) {
        let sender = self.reader_sender.lock().unwrap_or_else(PoisonError::into_inner);
        // If the thread has ended, there is nobody to show it to.
        let _ = sender.send((reader, playback_times));
    }

    /// Number of pictures that were skipped because the one before had not been fetched.
    pub fn skipped_count(&self) -> u64 {
        self.n_skipped.load(Ordering::Relaxed)
    }
}

impl Drop for WindowServer {
    fn drop(&mut self) {
        self.is_stopping.store(true, Ordering::Release);
        if let Some(relay_thread) = self.thread.take() {
            let _ = relay_thread.join();
        }
    }
}

/// The work of the thread.
pub(in super::super) struct WindowRelay {
    server: Arc<Server>,
    new_readers: Receiver<(WindowReader, PlaybackTimes)>,
    /// The reader that is shown, then those that wait for their first picture.
    shown_and_waiting: Vec<(WindowReader, PlaybackTimes)>,
    has_sent_greeting: bool,
    n_skipped: Arc<AtomicU64>,
    /// Skipped pictures of readers that were dropped.
    n_skipped_before: u64,
}

impl WindowRelay {
    pub(in super::super) fn new(server: Arc<Server>, new_readers: Receiver<(WindowReader, PlaybackTimes)>) -> Self {
        Self {
            server,
            new_readers,
            shown_and_waiting: Vec::new(),
            has_sent_greeting: false,
            n_skipped: Arc::default(),
            n_skipped_before: 0,
        }
    }

    /// Send new pictures.
    pub(in super::super) fn poll(&mut self) {
        self.shown_and_waiting.extend(self.new_readers.try_iter());
        let has_picture =
            |reader_and_times: &(WindowReader, PlaybackTimes)| reader_and_times.0.display_frames.updated();
        if let Some(index) = self.shown_and_waiting.iter().rposition(has_picture) {
            self.has_sent_greeting &= index == 0;
            self.n_skipped_before += (self.shown_and_waiting.drain(..index))
                .map(|(reader, _)| reader.skipped_count())
                .sum::<u64>();
            self.send_first_frame();
        }
        // The reader that is shown stays, because its count is still needed; others that are over were never played.
        let mut index = 0;
        self.shown_and_waiting.retain(|(reader, _)| {
            index += 1;
            index == 1 || !reader.is_over()
        });
        let skipped_now = self
            .shown_and_waiting
            .first()
            .map_or(0, |(reader, _)| reader.skipped_count());
        (self.n_skipped).store(self.n_skipped_before + skipped_now, Ordering::Relaxed);
    }

    #[cfg(test)]
    pub(in super::super) fn skipped_count(&self) -> u64 {
        self.n_skipped.load(Ordering::Relaxed)
    }

    /// Send the newest picture of the reader that is shown.
    fn send_first_frame(&mut self) {
        let (reader, playback_times) = &mut self.shown_and_waiting[0];
        let (recorder, hub) = (&mut reader.recorder, self.server.hub());
        let display_frame = reader.display_frames.read();
        let seconds = recorder.seconds(display_frame.snapshot.frame);
        let playback_time = playback_times.playback_time(
            display_frame.snapshot.frame,
            display_frame.dropped_frames,
            self.server.now(),
        );
        recorder.add_squared_levels(&display_frame.square_sums, display_frame.n_level_frames);
        for strike in &display_frame.strikes[..display_frame.n_strikes] {
            let strike_seconds = recorder.seconds(strike.frame);
            recorder.add_strike(strike_seconds, strike.point, strike.impulse);
        }
        recorder.record(&display_frame.snapshot);
        if !self.has_sent_greeting {
            hub.set_greeting(&recorder.take_bytes());
            self.has_sent_greeting = true;
        }
        let mut live_chunks = recorder.take_live();
        if let Some(instant) = playback_time {
            let mut clock_bytes = ByteWriter::default();
            clock_bytes.f64(instant);
            clock_bytes.f64(1.0);
            write_chunk(&mut live_chunks.latest, kind::CLOCK, seconds, &clock_bytes.0);
        }
        if !live_chunks.events.is_empty() {
            let retention = if live_chunks.has_key_state {
                Retention::KeyState
            } else {
                Retention::All
            };
            hub.publish(&live_chunks.events, retention);
        }
        hub.publish(&live_chunks.latest, Retention::Latest);
    }
}
