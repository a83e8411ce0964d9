//! How fit this machine and a device are: when a thread like the physics thread wakes, and how long replies take.
//!
//! What is measured is kept as it came; `live/fitness.py` says what it means, and what to do about it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::device::{Device, Gone, Sample};
use crate::realtime::{self, Granted, sleep_until};
use crate::safety::Guarded;

/// A reply that takes longer is lost.
const PATIENCE: Duration = Duration::from_millis(20);

/// What was measured, in nanoseconds.
#[derive(Clone, Debug)]
pub struct Checkup {
    /// What the system granted the thread.
    pub granted: Granted,
    /// How long after it was due each tick began. None are counted for a device that is in lockstep.
    pub lateness: Vec<u32>,
    /// From each force (of zero) sent to its reply.
    pub round_trips: Vec<u32>,
    /// Forces that had no reply within 20 ms.
    pub unanswered: u64,
    /// How long all of it took [s].
    pub seconds: f64,
}

impl Checkup {
    fn new(ticks: usize) -> Self {
        Self {
            granted: realtime::ask(realtime::PHYSICS),
            lateness: Vec::with_capacity(ticks),
            round_trips: Vec::with_capacity(ticks),
            unanswered: 0,
            seconds: 0.0,
        }
    }
}

/// Wake `ticks` times, a `period` [s] apart, as the physics thread does; with a device, send zero forces and wait for
/// the reply. Ends early when `stop` is set. Gives this thread the physics thread's priority, so call it in one of its
/// own.
///
/// # Errors
/// [`Gone`] when the device goes away.
pub fn checkup<D: Device>(
    mut device: Option<&mut Guarded<D>>,
    period: f64,
    ticks: usize,
    stop: &AtomicBool,
) -> Result<Checkup, Gone> {
    let mut found = Checkup::new(ticks);
    let period = Duration::from_secs_f64(period);
    let mut sample = Sample::default();
    if let Some(device) = &mut device {
        // Where it is by itself comes first, and answers no force.
        device.receive(&mut sample, Instant::now())?;
    }
    let lockstep = device.as_ref().is_some_and(|device| device.in_lockstep());
    let start = Instant::now();
    let mut due = start;
    for _ in 0..ticks {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        if !lockstep {
            due += period;
            // A reply that took longer than a tick is no lateness of the clock.
            due = due.max(Instant::now());
            found.lateness.push(nanoseconds(sleep_until(due)));
        }
        let Some(device) = &mut device else {
            continue;
        };
        // A reply that came too late must not count as the next one's.
        device.receive(&mut sample, Instant::now())?;
        let sent = Instant::now();
        device.send(&[])?;
        if device.receive(&mut sample, sent + PATIENCE)? {
            found.round_trips.push(nanoseconds(sent.elapsed()));
        } else {
            found.unanswered += 1;
        }
    }
    found.seconds = start.elapsed().as_secs_f64();
    Ok(found)
}

fn nanoseconds(time: Duration) -> u32 {
    u32::try_from(time.as_nanos()).unwrap_or(u32::MAX)
}
