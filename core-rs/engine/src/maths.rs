//! Transcendental functions that give the same bits on every machine (`libm`, compiled with the engine).

pub(crate) mod lanes;
mod mixing;
pub(crate) mod wide;

pub(crate) use mixing::Mixing;

pub use libm::{asin, atan2, cos, exp, expm1, floor, fma, log, log1p, log2, log10, pow, sin, sincos, sqrt, tanh};

/// Ratio of amplitudes for a level [dB].
pub fn amplitude_ratio(level: f64) -> f64 {
    pow(10.0, level / 20.0)
}

/// The magnitude of the first number with the sign of the second.
pub fn copysign(size: f64, sign: f64) -> f64 {
    size.copysign(sign)
}

/// Exponents up to this that are multiples of 1/2 need no `pow`, which takes ten times as long as a square root.
const HALF_EXPONENT_MAX: f64 = 4.0;

/// p^α for p >= 0.
pub(crate) fn power_law(p: f64, exponent: f64) -> f64 {
    let half_count = 2.0 * exponent;
    if !(0.0..=2.0 * HALF_EXPONENT_MAX).contains(&half_count) || half_count != floor(half_count) {
        return pow(p, exponent);
    }
    let half_count = half_count as u32;
    let mut product = if half_count & 1 == 1 { sqrt(p) } else { 1.0 };
    for _ in 0..half_count / 2 {
        product *= p;
    }
    product
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_law_of_halves_and_other_exponents() {
        for halves in -3..=12 {
            for exponent in [0.5 * f64::from(halves), 0.5 * f64::from(halves) + 0.1] {
                for p in [1e-9, 0.37, 1.0, 12.5] {
                    let exact_power = pow(p, exponent);
                    let absolute_error = (power_law(p, exponent) - exact_power).abs();
                    assert!(absolute_error <= 1e-15 * exact_power, "{p}^{exponent}");
                }
            }
        }
        assert_eq!(power_law(0.0, 1.5), 0.0);
        assert_eq!(power_law(0.0, 0.0), 1.0);
    }
}
