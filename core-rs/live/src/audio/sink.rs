//! What all outputs have in common: they are opened, started with a drain, and stopped; and the thread that some of
//! them run.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;

use super::AudioError;
use super::ring::Drain;

/// Priority of a thread that passes frames to a server: that of JACK's own clients, below the physics thread.
pub(super) const PRIORITY: i32 = 65;

/// An output that is opened but does not play yet.
pub(super) struct Opened {
    pub(super) backend: &'static str,
    pub(super) device: String,
    /// Its own rate [Hz].
    pub(super) rate: u32,
    pub(super) block: u32,
    /// Whether a clock takes the frames.
    pub(super) paced: bool,
    /// Remarks for the user, as sentences.
    pub(super) remarks: Vec<String>,
    pub(super) start: Start,
}

pub(super) type Start = Box<dyn FnOnce(Drain) -> Result<Box<dyn Sink>, StartFailure> + Send>;

/// The error of an output that did not start, with the drain if it comes back.
pub(super) type StartFailure = (Option<Box<Drain>>, AudioError);

/// An output that plays.
pub(super) trait Sink: Send {
    /// Whether it still takes frames; also updates its timing. Called a few times a second.
    fn alive(&mut self) -> bool;

    /// Stop and give the drain back; the sentence says what went wrong, if anything.
    fn stop(self: Box<Self>) -> (Option<Drain>, Option<String>);
}

/// A sink that is a thread.
pub(super) struct ThreadSink {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<(Drain, Option<String>)>,
}

impl ThreadSink {
    /// Run `body` until it returns or `stop` is set.
    pub(super) fn start(
        name: &str,
        drain: Drain,
        body: impl FnOnce(&mut Drain, &AtomicBool) -> Result<(), String> + Send + 'static,
    ) -> Result<Self, StartFailure> {
        let stop = Arc::new(AtomicBool::new(false));
        let (to, from) = mpsc::sync_channel::<Drain>(1);
        let stopping = stop.clone();
        let main = move || {
            // The sender is dropped only after it has sent the drain; if the spawn fails, this closure does not run.
            let mut drain = from.recv().expect("the drain was sent");
            let trouble = body(&mut drain, &stopping).err();
            (drain, trouble)
        };
        match std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(main)
        {
            Ok(thread) => {
                let _ = to.send(drain);
                Ok(Self { stop, thread })
            }
            Err(error) => Err((Some(Box::new(drain)), AudioError::Thread(error))),
        }
    }
}

impl Sink for ThreadSink {
    fn alive(&mut self) -> bool {
        !self.thread.is_finished()
    }

    fn stop(self: Box<Self>) -> (Option<Drain>, Option<String>) {
        self.stop.store(true, Ordering::Release);
        match self.thread.join() {
            Ok((drain, trouble)) => (Some(drain), trouble),
            Err(_) => (
                None,
                Some("the thread that writes the sound panicked".into()),
            ),
        }
    }
}
