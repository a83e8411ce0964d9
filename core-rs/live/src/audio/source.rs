//! What all inputs have in common: they are opened, started with a ring writer, and stopped.

use super::AudioError;
use super::ring::RingWriter;

/// An input that is opened but does not record yet.
pub(super) struct OpenedInput {
    pub(super) backend: &'static str,
    pub(super) device: String,
    /// Its own rate [Hz].
    pub(super) rate: u32,
    pub(super) block: u32,
    pub(super) start: StartInput,
}

pub(super) type StartInput = Box<dyn FnOnce(RingWriter) -> Result<Box<dyn Source>, InputFailure> + Send>;

/// The error of an input that did not start, with the ring writer if it comes back.
pub(super) type InputFailure = (Option<Box<RingWriter>>, AudioError);

/// A running input.
pub(super) trait Source: Send {
    /// Whether frames still come. Called a few times a second.
    fn is_alive(&mut self) -> bool;

    /// Frames from the microphone to the ring, as far as the server reports them.
    fn latency(&self) -> u32;

    /// Stop, and give the ring writer back.
    fn stop(self: Box<Self>) -> Option<RingWriter>;
}
