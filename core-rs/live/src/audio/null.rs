//! Outputs without sound: they take frames by the clock, as a card would, or as fast as they come.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::ring::Drain;
use super::sink::{Opened, PRIORITY, RingThread, Sink};
use crate::realtime;

pub(super) const BLOCK: u32 = 256;
/// If the clock is later than this, it is reset: after a suspend the machine must not catch up by playing faster.
const RESET_AFTER: Duration = Duration::from_millis(200);
const POLL: Duration = Duration::from_micros(200);

/// A clock that takes frames at `rate`.
pub(super) fn open(rate: u32, block: Option<u32>) -> Opened {
    let block = block.unwrap_or(BLOCK);
    Opened {
        backend: "null",
        device: "no sound, in real time".into(),
        rate,
        block,
        paced: true,
        remarks: Vec::new(),
        start: Box::new(move |drain| {
            drain.shared().set_timing(block, 0);
            let pump = RingThread::start("ergon null", drain, move |drain, stop| {
                drain.shared().set_priority(realtime::set_priority(PRIORITY));
                by_the_clock(drain, stop, rate, block, |_| Ok(()))
            })?;
            Ok(Box::new(pump) as Box<dyn Sink>)
        }),
    }
}

/// An output that takes frames at once.
pub(super) fn fast(rate: u32, block: Option<u32>) -> Opened {
    let block = block.unwrap_or(BLOCK);
    Opened {
        backend: "null",
        device: "no sound, as fast as it is computed".into(),
        rate,
        block,
        paced: false,
        remarks: Vec::new(),
        start: Box::new(move |drain| {
            drain.shared().set_timing(block, 0);
            let pump = RingThread::start("ergon null", drain, move |drain, stop| {
                let mut block_samples = vec![0.0; block as usize * drain.channels()];
                while !stop.load(Ordering::Acquire) {
                    if drain.take(&mut block_samples) == 0 {
                        std::thread::sleep(POLL);
                    }
                }
                Ok(())
            })?;
            Ok(Box::new(pump) as Box<dyn Sink>)
        }),
    }
}

/// Take frames by the clock, as a card would, and call `with` for each block.
pub(super) fn by_the_clock<E>(
    drain: &mut Drain,
    stop: &AtomicBool,
    rate: u32,
    block: u32,
    mut with: impl FnMut(&[f32]) -> Result<(), E>,
) -> Result<(), E> {
    let mut block_samples = vec![0.0; block as usize * drain.channels()];
    let mut start_instant = Instant::now();
    let mut frames_due = 0;
    while !stop.load(Ordering::Acquire) {
        frames_due += u64::from(block);
        let lateness = realtime::sleep_until(start_instant + lasting(frames_due, rate));
        if lateness > RESET_AFTER {
            drain.shared().add_xruns(1);
            (start_instant, frames_due) = (Instant::now(), 0);
        }
        drain.fill(&mut block_samples);
        with(&block_samples)?;
    }
    Ok(())
}

/// Duration of `frames` at `rate` [Hz].
fn lasting(frames: u64, rate: u32) -> Duration {
    let (frames, rate) = (u128::from(frames), u128::from(rate.max(1)));
    Duration::from_nanos(u64::try_from(frames * 1_000_000_000 / rate).unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lasting_of_hours_of_blocks_without_drift() {
        // 256 frames at 44.1 kHz are not a whole number of nanoseconds.
        assert_eq!(lasting(44_100 * 3600 * 10, 44_100), Duration::from_secs(36_000));
        assert_eq!(lasting(147, 44_100), Duration::from_nanos(3_333_333));
    }
}
