//! `ergon._core`: the only door between Python and the engine.
//!
//! A function here does three things: check shapes, let go of the GIL, call the engine. Anything
//! longer belongs in `ergon-engine`.

mod maths;

use pyo3::prelude::*;

/// The compiled core of ergon.
#[pymodule(gil_used = false)]
mod _core {
    #[pymodule_export]
    use super::maths::{decibels, exp, ln, pow};
    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
