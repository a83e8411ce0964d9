//! A compiled expression over a run of links: one plain loop for each step, which becomes SIMD code.

use super::super::tree::{Binary, Unary, choose, integer_power};
use super::{FIRST_STEP_REGISTER, Register, Step};
use crate::maths::lanes;

/// Lanes in the widest vector: a loop over whole vectors has no remainder.
const VECTOR_LANES: usize = 8;

/// Run every step for the first `n` lanes; `registers` are those of this program, with d and v loaded into 0 and 1.
///
/// It must be inlined where the loops are compiled for wide vectors.
#[inline(always)]
pub(super) fn run(steps: &[Step], registers: &mut [Register], n: usize) {
    // Lanes beyond `n` hold old numbers, and their results are never read.
    let n_rounded = n.next_multiple_of(VECTOR_LANES);
    for (i, step) in steps.iter().enumerate() {
        let (registers_before, registers_after) = registers.split_at_mut(FIRST_STEP_REGISTER + i);
        let n_lanes = if is_slow(step) { n } else { n_rounded };
        compute(step, &mut registers_after[0][..n_lanes], |register| {
            &registers_before[register][..n_lanes]
        });
    }
}

/// Compute one step for all lanes of `out`, from registers of as many lanes. Constants are in place.
#[inline(always)]
fn compute<'r>(step: &Step, out: &mut [f64], value_of: impl Fn(usize) -> &'r [f64]) {
    match *step {
        Step::Constant(_) | Step::Adjustable(..) => {}
        Step::Unary(operation, a) => apply_unary(operation, out, value_of(a)),
        Step::WholePower(exponent, a) => apply_power(exponent, out, value_of(a)),
        Step::Binary(operation, a, b) => apply_binary(operation, out, value_of(a), value_of(b)),
        Step::Where(c, a, b) => {
            for (out, ((c, a), b)) in out.iter_mut().zip(value_of(c).iter().zip(value_of(a)).zip(value_of(b))) {
                *out = choose(*c, *a, *b);
            }
        }
    }
}

/// Whether the step is computed link by link, so that every lane costs time.
#[inline(always)]
fn is_slow(step: &Step) -> bool {
    let power_operation = Binary::Power;
    matches!(step, Step::Unary(Unary::Tanh | Unary::Noise, _))
        || matches!(step, Step::Binary(operation, ..) if *operation == power_operation)
}

/// One loop for each operation, so that no loop contains a decision.
macro_rules! for_each_of {
    ($kind:ident: $($name:ident)+; $operation:expr, |$fixed:ident| $body:expr) => {
        match $operation {
            $($kind::$name => { const $fixed: $kind = $kind::$name; $body })+
        }
    };
}
pub(super) use for_each_of;

#[inline(always)]
fn apply_unary(operation: Unary, out: &mut [f64], a: &[f64]) {
    match operation {
        Unary::Exp => lanes::exp(a, out),
        _ => for_each_of!(Unary: Negate Abs Sqrt Sign Exp Tanh Noise; operation, |OPERATION| {
            for (out, a) in out.iter_mut().zip(a) {
                *out = OPERATION.apply(*a);
            }
        }),
    }
}

#[inline(always)]
fn apply_binary(operation: Binary, out: &mut [f64], a: &[f64], b: &[f64]) {
    for_each_of!(
        Binary: Add Subtract Multiply Divide Power Min Max
            Less LessEqual Greater GreaterEqual Equal NotEqual;
        operation, |OPERATION| {
            for (out, (a, b)) in out.iter_mut().zip(a.iter().zip(b)) {
                *out = OPERATION.apply(*a, *b);
            }
        }
    );
}

/// [`integer_power`]: squares and cubes in one pass, others one multiplication after another.
#[inline(always)]
fn apply_power(exponent: i32, out: &mut [f64], a: &[f64]) {
    macro_rules! in_one_pass {
        ($exponent:literal) => {
            for (out, a) in out.iter_mut().zip(a) {
                *out = integer_power(*a, $exponent);
            }
        };
    }
    match exponent {
        2 => in_one_pass!(2),
        3 => in_one_pass!(3),
        _ => {
            let magnitude = exponent.unsigned_abs();
            if magnitude == 0 {
                return out.fill(1.0);
            }
            out.copy_from_slice(a);
            for bit in (0..magnitude.ilog2()).rev() {
                out.iter_mut().for_each(|out| *out *= *out);
                if magnitude >> bit & 1 == 1 {
                    out.iter_mut().zip(a).for_each(|(out, a)| *out *= a);
                }
            }
            if exponent < 0 {
                out.iter_mut().for_each(|out| *out = 1.0 / *out);
            }
        }
    }
}
