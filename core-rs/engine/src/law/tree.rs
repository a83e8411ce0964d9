//! An expression as a tree, and its operations on single values.

use super::noise::noise;
use crate::maths;

/// Operations on one value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unary {
    Negate,
    Abs,
    Sqrt,
    Sign,
    Exp,
    Tanh,
    Noise,
}

/// Operations on two values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Min,
    Max,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    Equal,
    NotEqual,
}

impl Unary {
    #[inline(always)]
    pub(super) fn apply(self, a: f64) -> f64 {
        match self {
            Self::Negate => -a,
            Self::Abs => a.abs(),
            Self::Sqrt => a.sqrt(),
            Self::Sign => {
                if a > 0.0 {
                    1.0
                } else if a < 0.0 {
                    -1.0
                } else {
                    a // 0 or NaN
                }
            }
            Self::Exp => maths::exp(a),
            Self::Tanh => maths::tanh(a),
            Self::Noise => noise(a),
        }
    }
}

impl Binary {
    #[inline(always)]
    pub(super) fn apply(self, a: f64, b: f64) -> f64 {
        let as_number = |condition: bool| if condition { 1.0 } else { 0.0 };
        match self {
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            Self::Power => power(a, b),
            // std's min and max do not define which zero they return.
            Self::Min => {
                if b < a {
                    b
                } else {
                    a
                }
            }
            Self::Max => {
                if b > a {
                    b
                } else {
                    a
                }
            }
            Self::Less => as_number(a < b),
            Self::LessEqual => as_number(a <= b),
            Self::Greater => as_number(a > b),
            Self::GreaterEqual => as_number(a >= b),
            Self::Equal => as_number(a == b),
            Self::NotEqual => as_number(a != b),
        }
    }
}

/// `where(c, a, b)`.
#[inline(always)]
pub(super) fn choose(c: f64, a: f64, b: f64) -> f64 {
    if c != 0.0 { a } else { b }
}

/// Largest whole exponent that is computed by multiplication; above it, rounding errors add up to more than those of
/// `pow`.
const INTEGER_EXPONENT_MAX: f64 = 64.0;

/// The exponent as a whole number, if the power is computed by multiplication.
pub(super) fn integer_exponent(exponent: f64) -> Option<i32> {
    (exponent.abs() <= INTEGER_EXPONENT_MAX && exponent == maths::floor(exponent)).then_some(exponent as i32)
}

/// `a ** b`; whole exponents up to 64 by multiplication, which is exact if the products are.
pub(super) fn power(a: f64, b: f64) -> f64 {
    match integer_exponent(b) {
        Some(n) => integer_power(a, n),
        None => maths::pow(a, b),
    }
}

/// Repeated squaring from the highest bit of the exponent down, with a multiplication by `a` at each set bit: a fixed
/// order.
pub(super) fn integer_power(a: f64, n: i32) -> f64 {
    let magnitude = n.unsigned_abs();
    if magnitude == 0 {
        return 1.0;
    }
    let mut product = a;
    for bit in (0..magnitude.ilog2()).rev() {
        product *= product;
        if magnitude >> bit & 1 == 1 {
            product *= a;
        }
    }
    if n < 0 { 1.0 / product } else { product }
}

/// A node; its arguments come before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Node {
    Number(f64),
    /// A constant that may change: its number among the open constants, and its value.
    Adjustable(usize, f64),
    Elongation,
    Velocity,
    Unary(Unary, usize),
    Binary(Binary, usize, usize),
    Where(usize, usize, usize),
}

/// An expression: nodes in the order in which they were made, the root last.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    pub(super) root: usize,
}
