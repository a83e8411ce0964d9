//! The end of a performance, as a device sees it that waits for a reply.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How often a wait that may last looks whether it is over.
const LOOK: Duration = Duration::from_millis(20);

/// Ends the waits of a device for replies: in lockstep one may last for minutes, and so may the first reply.
#[derive(Clone, Debug, Default)]
pub struct Ending(Arc<AtomicBool>);

impl Ending {
    /// No reply is waited for any more.
    pub fn end(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// Whether no reply is waited for any more.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    /// Whether a reply is waited for until this instant, and no longer.
    pub(super) fn still_waits(&self, until: Instant) -> bool {
        !self.is_over() && Instant::now() < until
    }
}

/// Until when a read may block in a wait until this instant.
pub(super) fn next_look(until: Instant) -> Instant {
    until.min(Instant::now() + LOOK)
}
