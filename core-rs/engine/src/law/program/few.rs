//! A compiled expression at a few places: values are passed whole, so that they stay in one wide vector.

use super::super::tree::{Binary, Unary, choose, integer_power};
use super::lanes::for_each_of;
use super::{FIRST_STEP_REGISTER, SHORT_LANES, ShortVector, Step};
use crate::maths::lanes;
use crate::maths::wide::half_wide;

type Values = [f64; SHORT_LANES];

half_wide! {
    /// Run every step; d and v are loaded into registers 0 and 1.
    pub(super) fn run(steps: &[Step], registers: &mut [ShortVector]) {
        for (i, step) in steps.iter().enumerate() {
            let combine = |register: usize| registers[register].0;
            registers[FIRST_STEP_REGISTER + i].0 = match *step {
                Step::Constant(_) => continue, // is in place
                Step::Adjustable(_, value) => [value; SHORT_LANES],
                Step::Unary(operation, a) => unary(operation, combine(a)),
                Step::WholePower(exponent, a) => integer_powers(exponent, combine(a)),
                Step::Binary(operation, a, b) => binary(operation, combine(a), combine(b)),
                Step::Where(c, a, b) => select(combine(c), combine(a), combine(b)),
            };
        }
    }
}

#[inline(always)]
fn unary(operation: Unary, a: Values) -> Values {
    match operation {
        Unary::Exp => lanes::exp_lanes(a),
        Unary::Tanh | Unary::Noise => by_lane(a, a, |a, _| operation.apply(a)),
        _ => {
            for_each_of!(
                Unary: Negate Abs Sqrt Sign Exp Tanh Noise;
                operation, |OPERATION| a.map(|a| OPERATION.apply(a))
            )
        }
    }
}

#[inline(always)]
fn integer_powers(exponent: i32, a: Values) -> Values {
    match exponent {
        2 => a.map(|a| integer_power(a, 2)),
        3 => a.map(|a| integer_power(a, 3)),
        _ => by_lane(a, a, |a, _| integer_power(a, exponent)),
    }
}

#[inline(always)]
fn binary(operation: Binary, a: Values, b: Values) -> Values {
    match operation {
        Binary::Power => by_lane(a, b, |a, b| Binary::Power.apply(a, b)),
        _ => for_each_of!(
            Binary: Add Subtract Multiply Divide Power Min Max
                Less LessEqual Greater GreaterEqual Equal NotEqual;
            operation, |OPERATION| std::array::from_fn(|lane| OPERATION.apply(a[lane], b[lane]))
        ),
    }
}

#[inline(always)]
fn select(c: Values, a: Values, b: Values) -> Values {
    std::array::from_fn(|lane| choose(c[lane], a[lane], b[lane]))
}

/// Not inlined: its loop over lanes would keep the values of all operations in memory.
#[inline(never)]
fn by_lane(a: Values, b: Values, combine: impl Fn(f64, f64) -> f64) -> Values {
    std::array::from_fn(|lane| combine(a[lane], b[lane]))
}
