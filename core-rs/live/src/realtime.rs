//! Real-time scheduling and locked memory for a thread that must not be late, and what the system really granted.

use std::fmt;
use std::time::{Duration, Instant};

/// Priority of the physics thread among real-time threads: above JACK's clients (65), below the watchdogs of JACK's
/// server and the kernel's threads.
pub const PHYSICS_PRIORITY: i32 = 78;
/// Size of the stack that is touched in advance [bytes], because a page fault while playing makes a tick late.
const PREFAULT_BYTES: usize = 256 * 1024;

/// What the system granted a thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GrantedScheduling {
    /// Priority under SCHED_FIFO; `None`: scheduled like any other program.
    pub fifo_priority: Option<i32>,
    /// Whether the process's memory stays in RAM.
    pub is_memory_locked: bool,
}

impl fmt::Display for GrantedScheduling {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.fifo_priority {
            Some(priority) => write!(formatter, "SCHED_FIFO {priority}")?,
            None => write!(formatter, "no real-time priority")?,
        }
        let memory_state = if self.is_memory_locked { "locked" } else { "not locked" };
        write!(formatter, ", memory {memory_state}")
    }
}

/// Ask for real-time scheduling of this thread and for locked memory; returns what was really granted. The policy is
/// read back from the kernel, because a successful request does not yet mean that it holds.
pub fn request(priority: i32) -> GrantedScheduling {
    let is_memory_locked = lock_memory();
    prefault();
    GrantedScheduling {
        fifo_priority: set_fifo_priority(priority),
        is_memory_locked,
    }
}

/// Ask for real-time scheduling of this thread only; returns the priority really granted.
pub fn set_priority(priority: i32) -> Option<i32> {
    set_fifo_priority(priority)
}

#[cfg(target_os = "linux")]
fn set_fifo_priority(priority: i32) -> Option<i32> {
    // SAFETY: zero is a valid sched_param; both calls write into locals that outlive them.
    unsafe {
        let mut schedule_param: libc::sched_param = std::mem::zeroed();
        schedule_param.sched_priority = priority;
        libc::pthread_setschedparam(libc::pthread_self(), libc::SCHED_FIFO, &raw const schedule_param);
    }
    self::priority()
}

/// The real-time priority of this thread; `None`: scheduled like any other.
#[cfg(target_os = "linux")]
pub fn priority() -> Option<i32> {
    // SAFETY: zero is a valid sched_param; the call writes into locals that outlive it.
    unsafe {
        let mut sched_param: libc::sched_param = std::mem::zeroed();
        let mut sched_policy = 0;
        libc::pthread_getschedparam(libc::pthread_self(), &raw mut sched_policy, &raw mut sched_param);
        (sched_policy == libc::SCHED_FIFO).then_some(sched_param.sched_priority)
    }
}

/// The real-time priority of this thread; `None`: scheduled like any other.
#[cfg(not(target_os = "linux"))]
pub fn priority() -> Option<i32> {
    None
}

#[cfg(not(target_os = "linux"))]
fn fifo(_: i32) -> Option<i32> {
    None
}

#[cfg(unix)]
fn lock_memory() -> bool {
    // SAFETY: no pointers are passed.
    unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) == 0 }
}

#[cfg(not(unix))]
fn lock_memory() -> bool {
    false
}

#[inline(never)]
fn prefault() {
    let stack_bytes = [0_u8; PREFAULT_BYTES];
    std::hint::black_box(&stack_bytes);
}

/// Sleep until an instant; returns how late the thread woke.
pub fn sleep_until(instant: Instant) -> Duration {
    if let Some(time_left) = instant.checked_duration_since(Instant::now()) {
        // Never spin: since Linux 6.12 a spinning real-time thread is stopped for 50 ms in every second.
        std::thread::sleep(time_left);
    }
    Instant::now().saturating_duration_since(instant)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn request_names_the_granted_rights() {
        let text = std::thread::spawn(|| request(PHYSICS_PRIORITY).to_string());
        let text = text.join().expect("the thread ends");
        assert!(text.contains("memory"), "{text}");
    }

    #[test]
    fn sleep_until_the_instant() {
        let instant = Instant::now() + Duration::from_millis(5);
        let wake_delay = sleep_until(instant);
        assert!(Instant::now() >= instant + wake_delay);
    }
}
