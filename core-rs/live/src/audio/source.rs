//! What all inputs have in common: opened, started with a feed, stopped.

use super::AudioError;
use super::ring::Feed;

/// An input that is there, before anything is heard.
pub(super) struct OpenedInput {
    pub(super) backend: &'static str,
    pub(super) device: String,
    /// Its own rate [Hz].
    pub(super) rate: u32,
    pub(super) block: u32,
    pub(super) start: Start,
}

pub(super) type Start = Box<dyn FnOnce(Feed) -> Result<Box<dyn Source>, InputFailure> + Send>;

/// What did not start, and the feed back.
pub(super) type InputFailure = (Option<Box<Feed>>, AudioError);

/// An input that is heard.
pub(super) trait Source: Send {
    /// Whether frames still come. Called a few times a second.
    fn alive(&mut self) -> bool;

    /// Frames from the microphone to the ring, as far as the server tells.
    fn latency(&self) -> u32;

    /// Stop, and give the feed back.
    fn stop(self: Box<Self>) -> Option<Feed>;
}
