//! Transcendental functions that give the same bits on every machine (`libm`, compiled with the engine).

pub(crate) mod lanes;
mod mixing;
pub(crate) mod wide;

pub(crate) use mixing::Mixing;

pub use libm::{
    asin, atan2, cos, exp, expm1, floor, fma, log, log1p, log2, log10, pow, sin, sincos, sqrt, tanh,
};

/// Ratio of amplitudes for a level [dB].
pub fn decibels(level: f64) -> f64 {
    pow(10.0, level / 20.0)
}

/// The magnitude of the first number with the sign of the second.
pub fn copysign(size: f64, sign: f64) -> f64 {
    size.copysign(sign)
}

/// p^α for p >= 0; without a call of `pow` if α = 1.
pub(crate) fn power_law(p: f64, exponent: f64) -> f64 {
    if exponent == 1.0 { p } else { pow(p, exponent) }
}
