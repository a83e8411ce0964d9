//! All eigenvalues and eigenvectors of a dense matrix that need not be symmetric: Householder's reduction to Hessenberg
//! form, Francis' double-shift QR to real Schur form, back-substitution (Golub & Van Loan 7.4-7.6; Peters & Wilkinson
//! 1970). Uses only sums, products, quotients and square roots, in a fixed order.

mod hessenberg;
mod inverse;
mod schur;
#[cfg(test)]
mod tests;
mod triangular;

pub(crate) use inverse::inverse;

/// Eigenvalues and eigenvectors of a real matrix.
#[derive(Clone, Debug)]
pub(crate) struct Eigensystem {
    /// Eigenvalues: real and imaginary part; the two of a conjugate pair are adjacent, positive imaginary part first
    /// (n)
    pub values: Vec<(f64, f64)>,
    /// One eigenvector a row; a conjugate pair has two rows, the real and the imaginary part   (n, n)
    pub vectors: Vec<f64>,
}

/// The eigenvalues and eigenvectors of `matrix` (n, n), row after row.
///
/// `None` if a number is not finite or QR does not converge.
pub(crate) fn general_eigensystem(mut matrix: Vec<f64>) -> Option<Eigensystem> {
    let dimension = matrix.len().isqrt();
    if !matrix.iter().all(|x| x.is_finite()) {
        return None;
    }
    // Row j of `rotated` is column j of the product of all reflections.
    let mut rotated = hessenberg::reduce(&mut matrix, dimension);
    let values = schur::iterate(&mut matrix, dimension, &mut rotated)?;
    let vectors = triangular::vectors(&matrix, dimension, &values, &rotated);
    let is_finite = vectors.iter().all(|x| x.is_finite());
    is_finite.then_some(Eigensystem { values, vectors })
}
