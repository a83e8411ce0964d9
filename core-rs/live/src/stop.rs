//! The stop of the whole process: one word that any thread and any signal handler may set.
//!
//! Every force and every block of a sound card is checked against it, so a stop needs no lock, no queue and no running
//! thread. A stop stays set until it is taken back.

use std::sync::atomic::{AtomicU8, Ordering};

const LET_GO: u8 = 1;
const OVER: u8 = 2;

static STOPPED: AtomicU8 = AtomicU8::new(0);

/// What a signal stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Stop {
    /// Nothing.
    Nothing = 0,
    /// Every force, until [`release`].
    Forces = LET_GO,
    /// Every force and every sound, because the program ends.
    All = OVER,
}

impl Stop {
    pub(crate) fn from_bits(bits: u8) -> Self {
        match bits {
            OVER => Self::All,
            LET_GO => Self::Forces,
            _ => Self::Nothing,
        }
    }
}

/// Stop `what`; earlier stops stay.
pub fn stop(what: Stop) {
    STOPPED.fetch_or(what as u8, Ordering::SeqCst);
}

/// Let forces return, as at the start, unless the program ends.
pub fn release() {
    STOPPED.fetch_and(!LET_GO, Ordering::SeqCst);
}

/// Take every stop back: for a process that survives a signal.
pub fn reset() {
    STOPPED.store(0, Ordering::SeqCst);
}

/// Whether only zero forces may be sent to a hand.
#[must_use]
pub fn has_let_go() -> bool {
    STOPPED.load(Ordering::SeqCst) != 0
}

/// Whether nothing may sound, because the program ends.
#[must_use]
pub fn is_over() -> bool {
    STOPPED.load(Ordering::SeqCst) & OVER != 0
}
