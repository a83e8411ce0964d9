//! The stop of the whole process: one word that any thread and any signal handler may set.
//!
//! Every force and every block of a sound card is checked against it, so a stop needs no lock, no queue and no running
//! thread. A stop stays set until it is taken back.

use std::sync::atomic::{AtomicU8, Ordering};

const FORCES_STOPPED: u8 = 1;
const ALL_STOPPED: u8 = 2;

static STOP_BITS: AtomicU8 = AtomicU8::new(0);

/// What a signal stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum StopScope {
    /// Nothing.
    Nothing = 0,
    /// Every force, until [`release`].
    Forces = FORCES_STOPPED,
    /// Every force and every sound, because the program ends.
    All = ALL_STOPPED,
}

impl StopScope {
    pub(crate) fn from_bits(bits: u8) -> Self {
        match bits {
            ALL_STOPPED => Self::All,
            FORCES_STOPPED => Self::Forces,
            _ => Self::Nothing,
        }
    }
}

/// Stop `scope`; earlier stops stay.
pub fn stop(scope: StopScope) {
    STOP_BITS.fetch_or(scope as u8, Ordering::SeqCst);
}

/// Let forces return, as at the start, unless the program ends.
pub fn release() {
    STOP_BITS.fetch_and(!FORCES_STOPPED, Ordering::SeqCst);
}

/// Take every stop back: for a process that survives a signal.
pub fn reset() {
    STOP_BITS.store(0, Ordering::SeqCst);
}

/// Whether only zero forces may be sent to a hand.
#[must_use]
pub fn are_forces_stopped() -> bool {
    STOP_BITS.load(Ordering::SeqCst) != 0
}

/// Whether nothing may sound, because the program ends.
#[must_use]
pub fn is_silenced() -> bool {
    STOP_BITS.load(Ordering::SeqCst) & ALL_STOPPED != 0
}
