//! The engine's own transcendentals: what a score computes must not depend on the machine's libc.

use ergon_engine::maths;
use pyo3::prelude::*;

/// Natural logarithm.
#[pyfunction]
pub(crate) fn ln(x: f64) -> f64 {
    maths::log(x)
}

/// Exponential.
#[pyfunction]
pub(crate) fn exp(x: f64) -> f64 {
    maths::exp(x)
}

/// `x` to the power `y`.
#[pyfunction]
pub(crate) fn pow(x: f64, y: f64) -> f64 {
    maths::pow(x, y)
}

/// Ratio of amplitudes for a level in dB.
#[pyfunction]
pub(crate) fn decibels(level: f64) -> f64 {
    maths::decibels(level)
}
