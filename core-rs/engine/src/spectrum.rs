//! Eigenvalues and eigenvectors: the ends of the spectrum of a symmetric operator that is given only as a function of a
//! vector; the eigenvalues of a sparse symmetric matrix near a number; the whole spectrum of a dense symmetric matrix;
//! and that of a dense matrix that is not symmetric.
//!
//! Deterministic to the bit: start vectors are fixed, sums are taken in a fixed order.

mod all;
mod general;
mod jacobi;
mod lanczos;
mod lowest;
mod ordering;
mod shift_invert;
pub(crate) mod sparse;
pub(crate) mod springs;
#[cfg(test)]
mod tests;
pub(crate) mod vector;

pub(crate) use all::all_eigenvalues;
pub(crate) use general::{Eigensystem, general_eigensystem, inverse};
#[cfg(test)]
pub(crate) use lanczos::LargestRitz;
pub(crate) use lanczos::{largest_eigenvalue, largest_eigenvalue_up_to};
pub(crate) use lowest::lowest_mode;
#[cfg(test)]
pub(crate) use shift_invert::are_distinct_modes;
pub(crate) use shift_invert::{CertifiedModes, lowest_modes, modes_around, n_below};

/// `apply(x, y)` sets y = A x, both (n,); the old values of y are to be overwritten.
pub(crate) type Apply<'a> = &'a mut dyn FnMut(&[f64], &mut [f64]);

/// An eigenvalue and its eigenvector.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Mode {
    /// The eigenvalue.
    pub lambda: f64,
    /// The eigenvector (n,), of length 1.
    pub vector: Vec<f64>,
}
