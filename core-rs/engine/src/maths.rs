//! Transcendentals that give the same bytes on every machine (`libm`, compiled with the engine).

pub(crate) mod lanes;

pub use libm::{
    asin, atan2, cos, exp, expm1, floor, fma, log, log1p, log2, log10, pow, sin, sincos, sqrt, tanh,
};

/// Ratio of amplitudes for a level in decibels.
pub fn decibels(level: f64) -> f64 {
    pow(10.0, level / 20.0)
}

/// The size of one number with the sign of another.
pub fn copysign(size: f64, sign: f64) -> f64 {
    size.copysign(sign)
}
