//! What all outputs have in common: they are opened, started with a ring reader, and stopped; and the thread that some
//! of them run.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;

use super::AudioError;
use super::ring::RingReader;

/// Priority of a thread that passes frames to a server: that of JACK's own clients, below the physics thread.
pub(super) const SINK_THREAD_PRIORITY: i32 = 65;

/// An output that is opened but does not play yet.
pub(super) struct OpenedOutput {
    pub(super) backend: &'static str,
    pub(super) device: String,
    /// Its own rate [Hz].
    pub(super) rate: u32,
    pub(super) block: u32,
    /// Whether a clock takes the frames.
    pub(super) is_paced: bool,
    /// Remarks for the user, as sentences.
    pub(super) remarks: Vec<String>,
    pub(super) start: StartOutput,
}

pub(super) type StartOutput = Box<dyn FnOnce(RingReader) -> Result<Box<dyn Sink>, OutputFailure> + Send>;

/// The error of an output that did not start, with the ring reader if it comes back.
pub(super) type OutputFailure = (Option<Box<RingReader>>, AudioError);

/// An output that plays.
pub(super) trait Sink: Send {
    /// Whether it still takes frames; also updates its timing. Called a few times a second.
    fn is_alive(&mut self) -> bool;

    /// Stop and give the ring reader back; the sentence says what went wrong, if anything.
    fn stop(self: Box<Self>) -> (Option<RingReader>, Option<String>);
}

/// A thread that works on one end of a ring: a ring reader or a ring writer.
pub(super) struct RingThread<R> {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<(R, Option<String>)>,
}

impl<R: Send + 'static> RingThread<R> {
    /// Run `body` until it returns or `stop` is set.
    pub(super) fn start(
        name: &str,
        ring_end: R,
        body: impl FnOnce(&mut R, &AtomicBool) -> Result<(), String> + Send + 'static,
    ) -> Result<Self, (Option<Box<R>>, AudioError)> {
        let stop = Arc::new(AtomicBool::new(false));
        let (ring_sender, ring_receiver) = mpsc::sync_channel::<R>(1);
        let stop_flag = stop.clone();
        let thread_main = move || {
            // The sender is dropped only after it has sent the ring; if the spawn fails, this closure does not run.
            let mut ring_end = ring_receiver.recv().expect("the end of the ring was sent");
            let failure = body(&mut ring_end, &stop_flag).err();
            (ring_end, failure)
        };
        match std::thread::Builder::new().name(name.to_owned()).spawn(thread_main) {
            Ok(thread) => {
                let _ = ring_sender.send(ring_end);
                Ok(Self { stop, thread })
            }
            Err(error) => Err((Some(Box::new(ring_end)), AudioError::Thread(error))),
        }
    }

    /// Whether the body has not returned.
    pub(super) fn is_running(&self) -> bool {
        !self.thread.is_finished()
    }

    /// Stop and give the ring back; the sentence says what went wrong, if anything.
    pub(super) fn stop(self) -> (Option<R>, Option<String>) {
        self.stop.store(true, Ordering::Release);
        match self.thread.join() {
            Ok((ring_end, failure)) => (Some(ring_end), failure),
            Err(_) => (None, Some("the thread that passes the sound on panicked".into())),
        }
    }
}

impl Sink for RingThread<RingReader> {
    fn is_alive(&mut self) -> bool {
        self.is_running()
    }

    fn stop(self: Box<Self>) -> (Option<RingReader>, Option<String>) {
        RingThread::stop(*self)
    }
}
