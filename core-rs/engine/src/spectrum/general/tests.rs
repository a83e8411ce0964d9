use super::{General, general, inverse};
use crate::chance::Chance;

/// Largest element of A·v − λ·v over all eigenpairs, relative to ‖v‖·‖A‖.
fn residual(matrix: &[f64], result: &General) -> f64 {
    let n = result.values.len();
    let apply = |x: &[f64]| -> Vec<f64> {
        let rows = matrix.chunks_exact(n);
        rows.map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum())
            .collect()
    };
    let size = matrix.iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut worst = 0.0_f64;
    let mut k = 0;
    while k < n {
        let (re, im) = result.values[k];
        let width = if im == 0.0 { 1 } else { 2 };
        let x = &result.vectors[k * n..(k + 1) * n];
        let zero = vec![0.0; n];
        let y = if width == 2 {
            assert_eq!(result.values[k + 1], (re, -im));
            &result.vectors[(k + 1) * n..(k + 2) * n]
        } else {
            &zero
        };
        let length = x.iter().chain(y).map(|x| x * x).sum::<f64>().sqrt();
        let (ax, ay) = (apply(x), apply(y));
        for i in 0..n {
            let off = (ax[i] - re * x[i] + im * y[i]).abs() + (ay[i] - im * x[i] - re * y[i]).abs();
            worst = worst.max(off / (length * size));
        }
        k += width;
    }
    worst
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
            let result = general(matrix.clone()).unwrap();
            assert!(residual(&matrix, &result) < 1e-13 * n as f64, "{n} {seed}");
            let sum: f64 = result.values.iter().map(|value| value.0).sum();
            let trace: f64 = (0..n).map(|i| matrix[i * n + i]).sum();
            assert!((sum - trace).abs() < 1e-12 * n as f64, "{n} {seed}");
        }
    }
}

#[test]
fn general_eigenvalues_of_a_companion_matrix() {
    // The companion matrix of (x − 1)(x − 2)(x + 3)(x² + 2x + 5).
    let mut matrix = vec![0.0; 25];
    for i in 0..4 {
        matrix[(i + 1) * 5 + i] = 1.0;
    }
    let polynomial = [-1.0, -2.0, 3.0]
        .iter()
        .fold(vec![5.0, 2.0, 1.0], |low, by| {
            let mut more = vec![0.0; low.len() + 1];
            for (i, c) in low.iter().enumerate() {
                more[i + 1] += c;
                more[i] += c * by;
            }
            more
        });
    for (i, c) in polynomial[..5].iter().enumerate() {
        matrix[i * 5 + 4] = -c;
    }
    let mut result = general(matrix).unwrap().values;
    result.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let wanted = [
        (-3.0, 0.0),
        (-1.0, -2.0),
        (-1.0, 2.0),
        (1.0, 0.0),
        (2.0, 0.0),
    ];
    for (item, wanted) in result.iter().zip(wanted) {
        assert!(
            (item.0 - wanted.0).abs() + (item.1 - wanted.1).abs() < 1e-12,
            "{result:?}"
        );
    }
}

#[test]
fn general_eigenvectors_of_equal_eigenvalues() {
    // The same rotation twice, in two planes that are not coupled.
    let mut matrix = vec![0.0; 16];
    for (i, j, x) in [(0, 2, 3.0), (2, 0, -3.0), (1, 3, 3.0), (3, 1, -3.0)] {
        matrix[i * 4 + j] = x;
    }
    let result = general(matrix.clone()).unwrap();
    assert!(residual(&matrix, &result) < 1e-14);
    assert!(inverse(result.vectors.clone()).is_some());
}

#[test]
fn inverse_times_matrix_is_identity() {
    for n in [1, 2, 7, 30] {
        let matrix = drawn(n, n as u64);
        let result = inverse(matrix.clone()).unwrap();
        for i in 0..n {
            for j in 0..n {
                let sum: f64 = (0..n).map(|k| matrix[i * n + k] * result[k * n + j]).sum();
                assert!((sum - f64::from(u8::from(i == j))).abs() < 1e-10, "{n}");
            }
        }
    }
    assert_eq!(inverse(vec![1.0, 2.0, 2.0, 4.0]), None);
}

#[test]
fn general_spectrum_of_a_non_finite_matrix() {
    assert!(general(vec![1.0, f64::NAN, 0.0, 1.0]).is_none());
    assert!(general(Vec::new()).is_some());
}
