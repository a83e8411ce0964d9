//! Control of a performance from any thread, by flags that the physics thread reads in every tick.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crate::device::WaitCanceller;
use crate::realtime::GrantedScheduling;
use crate::{audio, stop};

/// Bits of what the system granted: the memory of the process is locked; the grant is known.
const MEMORY_LOCKED: u64 = 1;
const GRANT_KNOWN: u64 = 4;
/// The first bit of the priority in a grant.
const PRIORITY_SHIFT: u32 = 8;

/// Flags that the physics thread shares with others.
#[derive(Debug, Default)]
pub(super) struct SharedFlags {
    /// Whether the performance is to end.
    pub(super) stop: AtomicBool,
    /// Whether a panic is active: zero force, silent sound.
    pub(super) panic: AtomicBool,
    /// Request to let tripped axes push again; the physics thread clears it.
    pub(super) release: AtomicBool,
    /// Whether the last frame was computed.
    pub(super) is_done: AtomicBool,
    /// Ends the waits for each device.
    cancellers: Vec<WaitCanceller>,
    /// What the system granted the physics thread: [`MEMORY_LOCKED`], [`GRANT_KNOWN`], and from
    /// [`PRIORITY_SHIFT`] on priority + 1. 0: not known.
    granted_scheduling: AtomicU64,
}

impl SharedFlags {
    pub(super) fn new(cancellers: Vec<WaitCanceller>) -> Self {
        Self {
            cancellers,
            ..Self::default()
        }
    }

    pub(super) fn set_granted(&self, scheduling: GrantedScheduling) {
        let priority = scheduling.fifo_priority.map_or(0, |fifo| fifo as u64 + 1);
        let packed_grant =
            GRANT_KNOWN | priority << PRIORITY_SHIFT | if scheduling.is_memory_locked { MEMORY_LOCKED } else { 0 };
        self.granted_scheduling.store(packed_grant, Ordering::Release);
    }

    pub(super) fn granted_scheduling(&self) -> Option<GrantedScheduling> {
        let packed_grant = self.granted_scheduling.load(Ordering::Acquire);
        (packed_grant != 0).then(|| GrantedScheduling {
            fifo_priority: (packed_grant >> PRIORITY_SHIFT).checked_sub(1).map(|fifo| fifo as i32),
            is_memory_locked: packed_grant & MEMORY_LOCKED != 0,
        })
    }
}

/// Stops a performance from any thread; it takes no lock and never waits.
#[derive(Clone)]
pub struct Control {
    flags: Arc<SharedFlags>,
    sound: Arc<audio::StreamState>,
}

impl Control {
    pub(super) fn new(flags: Arc<SharedFlags>, sound: Arc<audio::StreamState>) -> Self {
        Self { flags, sound }
    }

    /// Silence within 5 ms and zero force at the next tick, until [`Control::release`].
    pub fn panic(&self) {
        self.flags.panic.store(true, Ordering::Release);
        self.sound.panic();
    }

    /// Let sound and force return after a panic, after [`stop::Stop::Forces`] and after a trip.
    pub fn release(&self) {
        stop::release();
        self.flags.panic.store(false, Ordering::Release);
        self.flags.release.store(true, Ordering::Release);
        self.sound.release();
    }

    /// End the performance: zero force at once, silence within 5 ms.
    pub fn stop(&self) {
        self.flags.stop.store(true, Ordering::Release);
        // Otherwise a lockstep device that does not answer would be waited for as long as its address allows.
        self.flags.cancellers.iter().for_each(WaitCanceller::cancel);
        self.sound.panic();
    }
}

/// Sets the flag `is_done` when it is dropped, also if the physics thread panics.
pub(super) struct DoneOnDrop(pub(super) Arc<SharedFlags>);

impl Drop for DoneOnDrop {
    fn drop(&mut self) {
        self.0.is_done.store(true, Ordering::Release);
    }
}
