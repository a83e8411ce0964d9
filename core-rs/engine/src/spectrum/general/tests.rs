use super::{Eigensystem, general_eigensystem, inverse};
use crate::chance::Chance;

/// Largest element of A·v − λ·v over all eigenpairs, relative to ‖v‖·‖A‖.
fn residual(matrix: &[f64], result: &Eigensystem) -> f64 {
    let dimension = result.values.len();
    let apply_matrix = |x: &[f64]| -> Vec<f64> {
        let matrix_rows = matrix.chunks_exact(dimension);
        matrix_rows
            .map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum())
            .collect()
    };
    let matrix_norm = matrix.iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut worst_residual = 0.0_f64;
    let mut eigen_index = 0;
    while eigen_index < dimension {
        let (re, im) = result.values[eigen_index];
        let vector_rows = if im == 0.0 { 1 } else { 2 };
        let x = &result.vectors[eigen_index * dimension..(eigen_index + 1) * dimension];
        let zero_vector = vec![0.0; dimension];
        let y = if vector_rows == 2 {
            assert_eq!(result.values[eigen_index + 1], (re, -im));
            &result.vectors[(eigen_index + 1) * dimension..(eigen_index + 2) * dimension]
        } else {
            &zero_vector
        };
        let vector_norm = x.iter().chain(y).map(|x| x * x).sum::<f64>().sqrt();
        let (ax, ay) = (apply_matrix(x), apply_matrix(y));
        for i in 0..dimension {
            let entry_residual = (ax[i] - re * x[i] + im * y[i]).abs() + (ay[i] - im * x[i] - re * y[i]).abs();
            worst_residual = worst_residual.max(entry_residual / (vector_norm * matrix_norm));
        }
        eigen_index += vector_rows;
    }
    worst_residual
}

fn drawn(n: usize, seed: u64) -> Vec<f64> {
    let mut chance = Chance::new(i128::from(seed), "matrix", "", 0, 0);
    (0..n * n).map(|_| chance.uniform(-1.0, 1.0)).collect()
}

#[test]
fn general_eigenvectors_of_random_matrices() {
    for n in 1..40 {
        for seed in 0..8 {
            let matrix = drawn(n, seed * 100 + n as u64);
            let eigensystem = general_eigensystem(matrix.clone()).unwrap();
            assert!(residual(&matrix, &eigensystem) < 1e-13 * n as f64, "{n} {seed}");
            let eigenvalue_sum: f64 = eigensystem.values.iter().map(|value| value.0).sum();
            let trace: f64 = (0..n).map(|i| matrix[i * n + i]).sum();
            assert!((eigenvalue_sum - trace).abs() < 1e-12 * n as f64, "{n} {seed}");
        }
    }
}

#[test]
fn general_eigenvalues_of_a_companion_matrix() {
    // The companion matrix of (x − 1)(x − 2)(x + 3)(x² + 2x + 5).
    let mut companion = vec![0.0; 25];
    for i in 0..4 {
        companion[(i + 1) * 5 + i] = 1.0;
    }
    let polynomial = [-1.0, -2.0, 3.0].iter().fold(vec![5.0, 2.0, 1.0], |low, by| {
        let mut product = vec![0.0; low.len() + 1];
        for (i, c) in low.iter().enumerate() {
            product[i + 1] += c;
            product[i] += c * by;
        }
        product
    });
    for (i, c) in polynomial[..5].iter().enumerate() {
        companion[i * 5 + 4] = -c;
    }
    let mut eigenvalues = general_eigensystem(companion).unwrap().values;
    eigenvalues.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let expected = [(-3.0, 0.0), (-1.0, -2.0), (-1.0, 2.0), (1.0, 0.0), (2.0, 0.0)];
    for (item, expected) in eigenvalues.iter().zip(expected) {
        assert!(
            (item.0 - expected.0).abs() + (item.1 - expected.1).abs() < 1e-12,
            "{eigenvalues:?}"
        );
    }
}

#[test]
fn general_eigenvectors_of_equal_eigenvalues() {
    // The same rotation twice, in two planes that are not coupled.
    let mut double_rotation = vec![0.0; 16];
    for (i, j, x) in [(0, 2, 3.0), (2, 0, -3.0), (1, 3, 3.0), (3, 1, -3.0)] {
        double_rotation[i * 4 + j] = x;
    }
    let eigensystem = general_eigensystem(double_rotation.clone()).unwrap();
    assert!(residual(&double_rotation, &eigensystem) < 1e-14);
    assert!(inverse(eigensystem.vectors.clone()).is_some());
}

#[test]
fn inverse_times_matrix_is_identity() {
    for n in [1, 2, 7, 30] {
        let matrix = drawn(n, n as u64);
        let inverse_matrix = inverse(matrix.clone()).unwrap();
        for i in 0..n {
            for j in 0..n {
                let product_entry: f64 = (0..n).map(|k| matrix[i * n + k] * inverse_matrix[k * n + j]).sum();
                assert!((product_entry - f64::from(u8::from(i == j))).abs() < 1e-10, "{n}");
            }
        }
    }
    assert_eq!(inverse(vec![1.0, 2.0, 2.0, 4.0]), None);
}

#[test]
fn general_spectrum_of_a_non_finite_matrix() {
    assert!(general_eigensystem(vec![1.0, f64::NAN, 0.0, 1.0]).is_none());
    assert!(general_eigensystem(Vec::new()).is_some());
}
