//! Outputs without sound: they take frames by the clock, as a card would, or as fast as they come.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::ring::RingReader;
use super::sink::{OpenedOutput, RingThread, SINK_THREAD_PRIORITY, Sink};
use crate::realtime;

pub(super) const BLOCK_FRAMES: u32 = 256;
/// If the clock is later than this, it is reset: after a suspend the machine must not catch up by playing faster.
const LATENESS_MAX: Duration = Duration::from_millis(200);
const POLL_INTERVAL: Duration = Duration::from_micros(200);

/// A clock that takes frames at `rate`.
pub(super) fn open_paced(rate: u32, block: Option<u32>) -> OpenedOutput {
    let block = block.unwrap_or(BLOCK_FRAMES);
    OpenedOutput {
        backend: "null",
        device: "no sound, in real time".into(),
        rate,
        block,
        is_paced: true,
        remarks: Vec::new(),
        start: Box::new(move |ring_reader| {
            ring_reader.stream_state().set_timing(block, 0);
            let ring_thread = RingThread::start("ergon null", ring_reader, move |ring_reader, stop| {
                ring_reader
                    .stream_state()
                    .set_priority(realtime::set_priority(SINK_THREAD_PRIORITY));
                pace_by_clock(ring_reader, stop, rate, block, |_| Ok(()))
            })?;
            Ok(Box::new(ring_thread) as Box<dyn Sink>)
        }),
    }
}

/// An output that takes frames at once.
pub(super) fn open_unpaced(rate: u32, block: Option<u32>) -> OpenedOutput {
    let block = block.unwrap_or(BLOCK_FRAMES);
    OpenedOutput {
        backend: "null",
        device: "no sound, as fast as it is computed".into(),
        rate,
        block,
        is_paced: false,
        remarks: Vec::new(),
        start: Box::new(move |ring_reader| {
            ring_reader.stream_state().set_timing(block, 0);
            let ring_thread = RingThread::start("ergon null", ring_reader, move |ring_reader, stop| {
                let mut block_samples = vec![0.0; block as usize * ring_reader.channels()];
                while !stop.load(Ordering::Acquire) {
                    if ring_reader.take_waiting(&mut block_samples) == 0 {
                        std::thread::sleep(POLL_INTERVAL);
                    }
                }
                Ok(())
            })?;
            Ok(Box::new(ring_thread) as Box<dyn Sink>)
        }),
    }
}

/// Take frames by the clock, as a card would, and call `on_block` for each block.
pub(super) fn pace_by_clock<E>(
    ring_reader: &mut RingReader,
    stop: &AtomicBool,
    rate: u32,
    block: u32,
    mut on_block: impl FnMut(&[f32]) -> Result<(), E>,
) -> Result<(), E> {
    let mut block_samples = vec![0.0; block as usize * ring_reader.channels()];
    let mut start_instant = Instant::now();
    let mut frames_due = 0;
    while !stop.load(Ordering::Acquire) {
        frames_due += u64::from(block);
        let lateness = realtime::sleep_until(start_instant + frames_duration(frames_due, rate));
        if lateness > LATENESS_MAX {
            ring_reader.stream_state().add_xruns(1);
            (start_instant, frames_due) = (Instant::now(), 0);
        }
        ring_reader.fill(&mut block_samples);
        on_block(&block_samples)?;
    }
    Ok(())
}

/// Duration of `frames` at `rate` [Hz].
fn frames_duration(frames: u64, rate: u32) -> Duration {
    let (frames, rate) = (u128::from(frames), u128::from(rate.max(1)));
    Duration::from_nanos(u64::try_from(frames * 1_000_000_000 / rate).unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lasting_of_hours_of_blocks_without_drift() {
        // 256 frames at 44.1 kHz are not a whole number of nanoseconds.
        assert_eq!(frames_duration(44_100 * 3600 * 10, 44_100), Duration::from_secs(36_000));
        assert_eq!(frames_duration(147, 44_100), Duration::from_nanos(3_333_333));
    }
}
