//! A random function of one number that is the same everywhere: what is rough, along the way on which one passes it.

use crate::maths;

/// √(60/11): heights from -1 to 1 have the variance 1/3, and the curve through them 11/20 of it.
const RMS_NORMALISATION: f64 = 2.335_496_832_484_569_3;

/// A smooth curve over `x` with the mean 0 and the root mean square 1, never beyond ±2.34.
///
/// At each whole number stands an independent random height from -1 to 1; the quadratic B-spline of these heights has
/// no corner. At a speed of r numbers a second its power falls as sinc⁶(f/r): by 3 dB at 0.25·r, by 23.5 dB at r/2.
/// The heights beside 0 are 1, so that its greatest value is that at 0. The stability certificate samples a law only
/// at range ends; this makes it see the maximum.
pub(super) fn noise(x: f64) -> f64 {
    let nearest = maths::floor(x + 0.5);
    let offset = x - nearest; // NaN if x is infinite
    let index = nearest as i64;
    let left_term = 0.5 * (0.5 - offset) * (0.5 - offset) * height(index.wrapping_sub(1));
    let right_term = 0.5 * (0.5 + offset) * (0.5 + offset) * height(index.wrapping_add(1));
    RMS_NORMALISATION * (left_term + (0.75 - offset * offset) * height(index) + right_term)
}

/// A random height from -1 to 1: SplitMix64 (Steele, Lea and Flood, 2014) of a whole number.
fn height(index: i64) -> f64 {
    const STEP: f64 = 1.0 / (1_u64 << 52) as f64;
    if index.unsigned_abs() <= 1 {
        return 1.0;
    }
    let mut mixed = (index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    mixed ^= mixed >> 31;
    (mixed >> 11) as f64 * STEP - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean, variance and correlation over a stretch beside those of the spline in closed form: heights are
    /// independent, so the correlation at the distance 1 is 26/66 of the variance, and 0 from 3 on.
    #[test]
    fn noise_moments_equal_those_of_spline() {
        const N: u32 = 400_000;
        const SAMPLES_PER_STEP: u32 = 4; // places for each whole number
        let values: Vec<f64> = (0..N)
            .map(|i| noise(100.0 + f64::from(i) / f64::from(SAMPLES_PER_STEP)))
            .collect();
        let product_mean = |lag: u32| {
            let pairs = values.iter().zip(&values[(lag * SAMPLES_PER_STEP) as usize..]);
            pairs.map(|(a, b)| a * b).sum::<f64>() / f64::from(N - lag * SAMPLES_PER_STEP)
        };
        assert!((values.iter().sum::<f64>() / f64::from(N)).abs() < 0.02);
        for (lag, correlation) in [(0, 1.0), (1, 26.0 / 66.0), (2, 1.0 / 66.0), (3, 0.0), (7, 0.0)] {
            let measured = product_mean(lag);
            assert!((measured - correlation).abs() < 0.015, "{lag}: {measured}");
        }
    }

    #[test]
    fn noise_is_greatest_at_zero_and_smooth() {
        let places = || (-40_000..40_000).map(|i| f64::from(i) / 16.0);
        assert!((noise(0.0) - RMS_NORMALISATION).abs() < 1e-15);
        assert!(places().all(|x| noise(x).abs() <= RMS_NORMALISATION + 1e-12));
        assert!(places().all(|x| (noise(x + 1e-7) - noise(x)).abs() < 5e-7));
        assert!(noise(f64::INFINITY).is_nan() && noise(f64::NAN).is_nan() && noise(-1e300).is_finite());
    }
}
