//! Transcendental functions over several lanes at once; each lane has the bits of the scalar function.
//!
//! The operations and the constants are those of `libm` (FreeBSD msun, e_exp.c); where `libm` branches, a lane computes
//! both sides and selects one.

use super::exp as exp_scalar;

const LN2_HI: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
const LN2_LO: f64 = f64::from_bits(0x3dea_39ef_3579_3c76);
const INV_LN2: f64 = f64::from_bits(0x3ff7_1547_652b_82fe);
/// Adding this number leaves a small integer in the lowest bits of the sum.
const ROUND_TO_LOW_BITS: f64 = 6_755_399_441_055_744.0; // 1.5·2⁵²
const BIAS: u64 = 0x3ff;

/// Largest |x| for which no lane overflows or underflows.
const ARGUMENT_MAX: f64 = 708.0;

/// Set `out` to `exp` of each entry of `inputs`, (n) each.
#[inline(always)]
pub(crate) fn exp(inputs: &[f64], out: &mut [f64]) {
    if are_in_range(inputs) {
        for (out, x) in out.iter_mut().zip(inputs) {
            *out = exp_in_range(*x);
        }
    } else {
        for (out, x) in out.iter_mut().zip(inputs) {
            *out = exp_scalar(*x);
        }
    }
}

/// `exp` of each of a few numbers that stay in one vector.
#[inline(always)]
pub(crate) fn exp_lanes<const N: usize>(a: [f64; N]) -> [f64; N] {
    #[cold]
    #[inline(never)]
    fn exp_each<const N: usize>(a: [f64; N]) -> [f64; N] {
        a.map(exp_scalar)
    }
    if are_in_range(&a) {
        a.map(exp_in_range)
    } else {
        exp_each(a)
    }
}

#[inline(always)]
fn are_in_range(a: &[f64]) -> bool {
    // Not `all`, which decides lane by lane.
    a.iter()
        .fold(1, |in_range, a| in_range & u64::from(a.abs() < ARGUMENT_MAX))
        == 1
}

/// `exp` for |x| < 708. The limits compare the upper halves of numbers, as in libm.
#[inline(always)]
fn exp_in_range(x: f64) -> f64 {
    const TINY: f64 = f64::from_bits(0x3e30_0001_0000_0000);
    const HALF_LN2: f64 = f64::from_bits(0x3fd6_2e43_0000_0000);
    const THREE_HALVES_LN2: f64 = f64::from_bits(0x3ff0_a2b2_0000_0000);
    const P: [f64; 5] = [
        f64::from_bits(0x3fc5_5555_5555_553e),
        f64::from_bits(0xbf66_c16c_16be_bd93),
        f64::from_bits(0x3f11_566a_af25_de2c),
        f64::from_bits(0xbebb_bd41_c5d2_6bf1),
        f64::from_bits(0x3e66_3769_72be_a4d0),
    ];
    let magnitude = x.abs();
    let sign = 1f64.copysign(x);
    // SAFETY: |x| < 708, so that the product fits an i32.
    let rounded_multiple: i32 = unsafe { (INV_LN2 * x + 0.5 * sign).to_int_unchecked() };
    let unit_multiple = if magnitude >= HALF_LN2 { sign } else { 0.0 };
    let k = if magnitude >= THREE_HALVES_LN2 {
        f64::from(rounded_multiple)
    } else {
        unit_multiple
    };
    let (hi, lo) = (x - k * LN2_HI, k * LN2_LO);
    let r = hi - lo;
    let rr = r * r;
    let c = r - rr * (P[0] + rr * (P[1] + rr * (P[2] + rr * (P[3] + rr * P[4]))));
    let y = 1.0 + (r * c / (2.0 - c) - lo + hi);
    let y = y * f64::from_bits((k + ROUND_TO_LOW_BITS).to_bits().wrapping_add(BIAS) << 52);
    if magnitude < TINY { 1.0 + x } else { y }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(numbers: &[f64]) {
        let mut result = vec![0.0; numbers.len()];
        exp(numbers, &mut result);
        for (x, y) in numbers.iter().zip(result) {
            let expected = exp_scalar(*x);
            assert!(
                expected.to_bits() == y.to_bits() || (expected.is_nan() && y.is_nan()),
                "{x:e}: {y} {expected}"
            );
        }
    }

    #[test]
    fn lanes_at_borders_equal_single_values() {
        let borders = [0.0, 3.73e-9, 0.346_573_590_279_972_64, 1.039_720_770_839_917_9, 708.0];
        for border in borders.map(f64::to_bits) {
            // libm compares only the upper half of a number; the steps are a hundredth of that half's last bit.
            let near_border: Vec<f64> = (-4000i64..4000)
                .map(|i| f64::from_bits(border.saturating_add_signed(i * 42_949_673)))
                .flat_map(|x| [x, -x])
                .collect();
            near_border.chunks(16).for_each(check);
        }
        check(&[
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NAN,
            709.0,
            710.0,
            -720.0,
            -746.0,
            0.0,
        ]);
    }

    proptest! {
        #[test]
        fn lanes_equal_single_values_bitwise(
            tame in prop::collection::vec(-708.0f64..708.0, 1..80),
            small in prop::collection::vec(-2.0f64..2.0, 1..80),
            any in prop::collection::vec(any::<f64>(), 1..20),
        ) {
            check(&tame);
            check(&small);
            check(&any);
        }
    }
}
