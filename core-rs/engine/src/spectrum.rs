//! Ends of the spectrum of a symmetric operator that is only known by what it does to a vector.
//!
//! Deterministic to the bit: start vectors are fixed, sums are taken in a fixed order.

mod filter;
mod jacobi;
mod lanczos;
mod lowest;
#[cfg(test)]
mod tests;
mod vector;
mod whole;

pub(crate) use filter::lowest_modes;
#[cfg(test)]
pub(crate) use lanczos::Largest;
pub(crate) use lanczos::largest;
pub(crate) use lowest::lowest;
pub(crate) use whole::whole;

/// `apply(x, y)`: y = A x, both (n,); y comes with old values.
pub(crate) type Apply<'a> = &'a mut dyn FnMut(&[f64], &mut [f64]);

/// An eigenvalue and its vector of length 1.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Mode {
    /// The eigenvalue.
    pub lambda: f64,
    /// The vector (n,).
    pub vector: Vec<f64>,
}
