//! End of a performance, for a device that waits for a reply.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time between two checks for the end during a long wait.
const CHECK_INTERVAL: Duration = Duration::from_millis(20);

/// Ends the waits of a device for replies: in lockstep a wait may last for minutes, and so may the wait for the first
/// reply.
#[derive(Clone, Debug, Default)]
pub struct WaitCanceller(Arc<AtomicBool>);

impl WaitCanceller {
    /// End all waits for replies.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// Whether waits for replies were ended.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    /// Whether a wait for a reply until `deadline` goes on.
    pub(super) fn may_wait(&self, deadline: Instant) -> bool {
        !self.is_cancelled() && Instant::now() < deadline
    }
}

/// Time until which a read may block, in a wait until `deadline`.
pub(super) fn next_check(deadline: Instant) -> Instant {
    deadline.min(Instant::now() + CHECK_INTERVAL)
}
