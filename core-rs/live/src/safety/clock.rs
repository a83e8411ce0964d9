//! The clock by which the stages judge ages.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// A device in lockstep waits for its host: its time is counted in ticks, and every run is repeatable. Any other device
/// keeps running while the host is stopped: its time is read from a clock.
#[derive(Debug)]
pub(super) enum SafetyClock {
    /// Number of periods for which forces were sent.
    Ticks { period: Duration, ticks: u32 },
    /// The wall clock.
    Wall,
    /// A clock that is set from outside [ns]: virtual time.
    External(Arc<AtomicU64>),
}

impl SafetyClock {
    pub(super) fn new(in_lockstep: bool, period: f64) -> Self {
        if in_lockstep {
            Self::Ticks {
                period: Duration::from_secs_f64(period),
                ticks: 0,
            }
        } else {
            Self::Wall
        }
    }

    /// Count a tick, when a force is about to be sent.
    pub(super) fn tick(&mut self) {
        if let Self::Ticks { ticks, .. } = self {
            *ticks = ticks.saturating_add(1);
        }
    }

    /// Time since some fixed moment.
    pub(super) fn now(&self) -> Duration {
        match self {
            Self::Ticks { period, ticks } => period.saturating_mul(*ticks),
            Self::Wall => wall(),
            Self::External(ns) => Duration::from_nanos(ns.load(Ordering::Relaxed)),
        }
    }
}

/// Time since boot, including the time for which the machine was suspended: std's `Instant` leaves that out on Linux
/// and macOS.
#[cfg(unix)]
pub(super) fn wall() -> Duration {
    #[cfg(any(target_os = "linux", target_os = "android"))]
    const CLOCK: libc::clockid_t = libc::CLOCK_BOOTTIME;
    #[cfg(not(any(target_os = "linux", target_os = "android")))]
    const CLOCK: libc::clockid_t = libc::CLOCK_MONOTONIC;
    let mut clock_time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the call writes into a local. Both clocks exist since Linux 2.6.39 and macOS 10.12, so it cannot fail.
    unsafe { libc::clock_gettime(CLOCK, &raw mut clock_time) };
    Duration::new(clock_time.tv_sec.unsigned_abs(), clock_time.tv_nsec as u32)
}

/// Time since the first call.
#[cfg(not(unix))]
pub(super) fn wall() -> Duration {
    use std::sync::OnceLock;
    use std::time::Instant;
    static FIRST: OnceLock<Instant> = OnceLock::new();
    FIRST.get_or_init(Instant::now).elapsed()
}
