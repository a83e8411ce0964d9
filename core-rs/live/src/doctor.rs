//! A check of this machine and a device: when a thread like the physics thread wakes, and how long replies take.
//!
//! The measurements are raw; `ergon/live/fitness.py` interprets them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::device::{Device, DeviceLoss, DeviceSample};
use crate::realtime::{self, GrantedScheduling, sleep_until};
use crate::safety::GuardedDevice;

/// Time after which a reply counts as lost.
const REPLY_TIMEOUT: Duration = Duration::from_millis(20);

/// The measurements, in nanoseconds.
#[derive(Clone, Debug)]
pub struct TimingCheck {
    /// What the system granted the thread.
    pub granted: GrantedScheduling,
    /// Lateness of each tick; empty for a device in lockstep.
    pub lateness: Vec<u32>,
    /// Time from each (zero) force sent to its reply.
    pub round_trips: Vec<u32>,
    /// Forces that had no reply within 20 ms.
    pub n_unanswered: u64,
    /// Duration of the whole check [s].
    pub seconds: f64,
}

impl TimingCheck {
    fn new(ticks: usize) -> Self {
        Self {
            granted: realtime::request(realtime::PHYSICS_PRIORITY),
            lateness: Vec::with_capacity(ticks),
            round_trips: Vec::with_capacity(ticks),
            n_unanswered: 0,
            seconds: 0.0,
        }
    }
}

/// Wake `ticks` times, a `tick_period` [s] apart, as the physics thread does; with a device, send zero forces and wait
/// for each reply. Ends early when `stop` is set. This thread keeps the priority of the physics thread, so call it in a
/// thread of its own.
///
/// # Errors
/// [`DeviceLoss`] if the device goes away.
pub fn check_timing<D: Device>(
    mut device: Option<&mut GuardedDevice<D>>,
    tick_period: f64,
    ticks: usize,
    stop: &AtomicBool,
) -> Result<TimingCheck, DeviceLoss> {
    let mut timing_check = TimingCheck::new(ticks);
    let tick_period = Duration::from_secs_f64(tick_period);
    let mut sample = DeviceSample::default();
    if let Some(device) = &mut device {
        // The initial position comes first; it is not a reply to a force.
        device.receive(&mut sample, Instant::now())?;
    }
    let lockstep = device.as_ref().is_some_and(|device| device.in_lockstep());
    let start_instant = Instant::now();
    let mut next_wake = start_instant;
    for _ in 0..ticks {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        if !lockstep {
            next_wake += tick_period;
            // A reply that took longer than a tick is not lateness of the clock.
            next_wake = next_wake.max(Instant::now());
            timing_check.lateness.push(nanoseconds(sleep_until(next_wake)));
        }
        let Some(device) = &mut device else {
            continue;
        };
        // A late reply must not be taken for the next one.
        device.receive(&mut sample, Instant::now())?;
        let send_instant = Instant::now();
        device.send(&[])?;
        if device.receive(&mut sample, send_instant + REPLY_TIMEOUT)? {
            timing_check.round_trips.push(nanoseconds(send_instant.elapsed()));
        } else {
            timing_check.n_unanswered += 1;
        }
    }
    timing_check.seconds = start_instant.elapsed().as_secs_f64();
    Ok(timing_check)
}

fn nanoseconds(time: Duration) -> u32 {
    u32::try_from(time.as_nanos()).unwrap_or(u32::MAX)
}
