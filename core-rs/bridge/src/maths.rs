//! The engine's own elementary functions: values that a score computes must not depend on the machine's libc.

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

/// Sine of an angle [rad].
#[pyfunction]
pub(crate) fn sin(x: f64) -> f64 {
    maths::sin(x)
}

/// Cosine of an angle [rad].
#[pyfunction]
pub(crate) fn cos(x: f64) -> f64 {
    maths::cos(x)
}

/// Angle of the point (x, y) [rad].
#[pyfunction]
pub(crate) fn atan2(y: f64, x: f64) -> f64 {
    maths::atan2(y, x)
}

/// `x` to the power `y`.
#[pyfunction]
pub(crate) fn pow(x: f64, y: f64) -> f64 {
    maths::pow(x, y)
}

/// Ratio of amplitudes for a level in dB.
#[pyfunction]
pub(crate) fn decibels(level: f64) -> f64 {
    maths::amplitude_ratio(level)
}
