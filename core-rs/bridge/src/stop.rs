//! The stop of the whole process: by signals, or by letting go of every hand.

use ergon_live::safety;
use ergon_live::stop::{self, StopScope};
use pyo3::prelude::*;

/// Let signals act at once, before their Python handlers run.
///
/// `ends` True: they stop every force and sound; False: every force; None: nothing. Call it again after each
/// `signal.signal`, which replaces the core's handler.
#[pyfunction]
#[pyo3(signature = (signals, *, ends))]
pub(crate) fn stop_on_signals(signals: Vec<i32>, ends: Option<bool>) {
    let stop_scope = match ends {
        Some(true) => StopScope::All,
        Some(false) => StopScope::Forces,
        None => StopScope::Nothing,
    };
    for signal in signals {
        safety::watch(signal, stop_scope);
    }
}

/// Set every force of the process to zero, until `Performance.release`.
#[pyfunction]
pub(crate) fn let_go() {
    stop::stop(StopScope::Forces);
}

/// Whether every force is zero, by `let_go` or by a signal.
#[pyfunction]
pub(crate) fn has_let_go() -> bool {
    stop::are_forces_stopped()
}

/// Allow forces and sound again, in a process that continues after a signal.
#[pyfunction]
pub(crate) fn begin_again() {
    stop::reset();
}
