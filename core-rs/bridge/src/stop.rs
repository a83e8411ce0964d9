//! The stop of the whole process: what signals stop, and forces that are let go.

use ergon_live::safety;
use ergon_live::stop::{self, Stop};
use pyo3::prelude::*;

/// Have signals stop something at once, below Python, before their handlers run: where the program `ends` every
/// force and sound, else every force; None: nothing. Ask again whenever a handler was set.
#[pyfunction]
#[pyo3(signature = (signals, *, ends))]
pub(crate) fn stop_on_signals(signals: Vec<i32>, ends: Option<bool>) {
    let stops = match ends {
        Some(true) => Stop::All,
        Some(false) => Stop::Forces,
        None => Stop::Nothing,
    };
    for signal in signals {
        safety::watch(signal, stops);
    }
}

/// No force on any hand, until a performance is released.
#[pyfunction]
pub(crate) fn let_go() {
    stop::stop(Stop::Forces);
}

/// Whether every hand is let go.
#[pyfunction]
pub(crate) fn has_let_go() -> bool {
    stop::has_let_go()
}

/// Nothing is stopped: for a process that outlives what a signal ended.
#[pyfunction]
pub(crate) fn begin_again() {
    stop::begin_again();
}
