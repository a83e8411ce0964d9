//! Outputs: weighted sums of positions (SOX), of their first and second derivatives (SOV, SOA), of forces of links
//! (SOF), and distances of two points in space.

/// One term of an output: a weight on a range of like modules.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Term {
    /// Positions of MATs [m] (SOX).
    Position {
        /// First MAT.
        first: usize,
        /// How many.
        len: usize,
        /// Factor of their sum.
        weight: f64,
    },
    /// Forces that LIAs put on their second points [N] (SOF).
    Force {
        /// First LIA.
        first: usize,
        /// How many.
        len: usize,
        /// Factor of their sum.
        weight: f64,
    },
    /// Lengths that LIAs in space measure [m] (SOX of a distance).
    Length {
        /// First LIA.
        first: usize,
        /// How many.
        len: usize,
        /// Factor of their sum.
        weight: f64,
    },
    /// Forces that CELs put on the ground, K·(x − rest) [N] (SOF of a bank).
    Ground {
        /// First CEL.
        first: usize,
        /// How many.
        len: usize,
        /// Factor of their sum.
        weight: f64,
    },
}

impl Term {
    /// The term over another range.
    pub(crate) fn over(&self, first: usize, len: usize) -> Self {
        match *self {
            Self::Position { weight, .. } => Self::Position { first, len, weight },
            Self::Force { weight, .. } => Self::Force { first, len, weight },
            Self::Length { weight, .. } => Self::Length { first, len, weight },
            Self::Ground { weight, .. } => Self::Ground { first, len, weight },
        }
    }
}

/// A named output: the sum of its terms.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// Its name in the score, e.g. `bell` or `string.left`.
    pub name: String,
    /// The terms of the sum.
    pub terms: Vec<Term>,
    /// How often the sum is differentiated by time: 0, 1 (SOV) or 2 (SOA).
    pub order: u8,
}
