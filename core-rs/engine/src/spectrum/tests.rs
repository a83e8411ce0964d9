use super::*;
use crate::maths::{self, sin};
use proptest::prelude::*;
use std::f64::consts::PI;

/// The sparse matrix of springs between masses of 1.
fn matrix(n: usize, springs: &Springs) -> springs::Springs {
    let each = springs.iter();
    let each = each.map(|&(a, b, k)| ((a, 1.0), b.map(|b| (b, 1.0)), k));
    springs::Springs::new(n, each.collect())
}

/// The lowest modes; the inertia of the matrix confirms that none is missing.
fn certified(n: usize, springs: &Springs, count: usize) -> Vec<Mode> {
    let result = lowest_modes(&matrix(n, springs), count);
    assert!(result.is_certified);
    result.modes
}

/// Springs (a, b, k); `None` for b is the ground.
type Springs = Vec<(usize, Option<usize>, f64)>;

fn operator(springs: &Springs) -> impl FnMut(&[f64], &mut [f64]) {
    move |x, y| {
        y.fill(0.0);
        for (a, b, k) in springs {
            let force = k * (x[*a] - b.map_or(0.0, |b| x[b]));
            y[*a] += force;
            if let Some(b) = b {
                y[*b] -= force;
            }
        }
    }
}

fn dense(n: usize, springs: &Springs) -> Vec<f64> {
    let mut apply = operator(springs);
    let mut matrix = nalgebra::DMatrix::zeros(n, n);
    for i in 0..n {
        let mut unit = vec![0.0; n];
        unit[i] = 1.0;
        let mut column = vec![0.0; n];
        apply(&unit, &mut column);
        matrix.set_column(i, &nalgebra::DVector::from_vec(column));
    }
    let mut values: Vec<f64> = matrix.symmetric_eigenvalues().iter().copied().collect();
    values.sort_by(f64::total_cmp);
    values
}

fn string(n: usize, fixed: bool) -> Springs {
    let mut springs: Springs = (1..n).map(|i| (i - 1, Some(i), 1.0)).collect();
    if fixed {
        springs.extend([(0, None, 1.0), (n - 1, None, 1.0)]);
    }
    springs
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * b.abs()
}

fn from_sine(angle: f64) -> f64 {
    4.0 * sin(angle) * sin(angle)
}

fn residual(springs: &Springs, mode: &Mode) -> f64 {
    let mut image = vec![0.0; mode.vector.len()];
    operator(springs)(&mode.vector, &mut image);
    vector::add(-mode.lambda, &mode.vector, &mut image);
    vector::norm(&image)
}

#[test]
fn lowest_mode_of_strings_matches_closed_form() {
    for n in [1, 2, 3, 7, 60, 1_000, 5_000] {
        let wide = 2.0 * (n as f64 + 1.0);
        let fixed = string(n, true);
        let mode = lowest(n, &mut operator(&fixed), &[]).expect("fixed");
        let closed = from_sine(PI / wide);
        assert!(
            close(mode.lambda, closed, 1e-13),
            "{n}: {} {closed}",
            mode.lambda
        );
        let free = string(n, false);
        let mode = lowest(n, &mut operator(&free), &[vec![1.0; n]]);
        assert_eq!(mode.is_none(), n == 1);
        if let Some(mode) = mode {
            let closed = from_sine(PI / (2.0 * n as f64));
            assert!(
                close(mode.lambda, closed, 1e-13),
                "{n}: {} {closed}",
                mode.lambda
            );
            assert!(residual(&free, &mode) <= 1e-7 * closed);
        }
        if n > 1 {
            let Largest {
                theta,
                residual,
                safe,
                ..
            } = largest(n, &mut operator(&fixed));
            let closed = from_sine(PI / 2.0 * n as f64 / (n as f64 + 1.0));
            assert!(
                theta <= closed * (1.0 + 1e-14) && safe >= closed * (1.0 - 1e-14),
                "{n}"
            );
            assert!(
                (closed - theta) <= f64::max(residual, 1e-13),
                "{n}: {theta} {residual}"
            );
        }
    }
}

#[test]
fn modes_of_a_string_and_of_a_membrane() {
    let n = 300;
    let fixed = string(n, true);
    let modes = certified(n, &fixed, 50);
    assert_eq!(modes.len(), 50);
    for (i, mode) in modes.iter().enumerate() {
        let closed = from_sine((i + 1) as f64 * PI / (2.0 * (n as f64 + 1.0)));
        assert!(
            close(mode.lambda, closed, 1e-12),
            "{i}: {} {closed}",
            mode.lambda
        );
    }
    // The modes of a square membrane come in pairs of one frequency: λ is the sum of those of two strings.
    let side = 21;
    let mut springs: Springs = Vec::new();
    for i in 0..side * side {
        if i % side > 0 {
            springs.push((i - 1, Some(i), 1.0));
        }
        if i >= side {
            springs.push((i - side, Some(i), 1.0));
        }
    }
    let single = |i: usize| from_sine(i as f64 * PI / (2.0 * side as f64));
    let mut closed: Vec<f64> = (0..side * side)
        .map(|i| single(i / side) + single(i % side))
        .collect();
    closed.sort_by(f64::total_cmp);
    let null = [vec![1.0; side * side]];
    let modes = certified(side * side, &springs, 31);
    assert!(modes[0].lambda.abs() < 1e-12);
    for (mode, closed) in modes.iter().zip(&closed).skip(1) {
        assert!(
            close(mode.lambda, *closed, 1e-12),
            "{} {closed}",
            mode.lambda
        );
        assert!(residual(&springs, mode) < 1e-7 * closed);
    }
    let first = lowest(side * side, &mut operator(&springs), &null).expect("mode");
    assert!(close(first.lambda, closed[1], 1e-13));
}

// Two bodies nearly in tune: their lowest modes differ by a ten-thousandth.
#[test]
fn modes_of_nearly_tuned_bodies_are_separated() {
    let n = 50;
    let mut springs = string(n, true);
    let second: Springs = string(n, true);
    let shifted = |(a, b, k): &(usize, Option<usize>, f64)| (a + n, b.map(|b| b + n), k * 1.0001);
    springs.extend(second.iter().map(shifted));
    let mode = lowest(2 * n, &mut operator(&springs), &[]).expect("mode");
    let closed = from_sine(PI / (2.0 * (n as f64 + 1.0)));
    assert!(
        close(mode.lambda, closed, 1e-13),
        "{} {closed}",
        mode.lambda
    );
    assert!(vector::norm(&mode.vector[n..]) < 1e-3);
    let modes = certified(2 * n, &springs, 2);
    assert!(
        close(modes[0].lambda, closed, 1e-12) && close(modes[1].lambda, closed * 1.0001, 1e-12)
    );
}

#[test]
fn modes_without_links_have_zero_frequency() {
    let mut nothing = |_: &[f64], y: &mut [f64]| y.fill(0.0);
    assert_eq!(largest(5, &mut nothing).theta, 0.0);
    assert_eq!(lowest(5, &mut nothing, &[]).expect("mode").lambda, 0.0);
    let modes = certified(5, &Vec::new(), 3);
    assert!(modes.len() == 3 && modes.iter().all(|mode| mode.lambda == 0.0));
}

/// Connected graphs: a chain with springs across it, and perhaps some to the ground.
fn graphs() -> impl Strategy<Value = (usize, Springs, bool)> {
    (2..40usize, any::<bool>()).prop_flat_map(|(n, grounded)| {
        let chain = prop::collection::vec(0.1..10.0f64, n - 1);
        let across = prop::collection::vec((0..n, 0..n, 0.1..10.0f64), 0..60);
        let ground = prop::collection::vec((0..n, 0.1..5.0f64), usize::from(grounded) * 3);
        (chain, across, ground).prop_map(move |(chain, across, ground)| {
            let mut springs: Springs = chain
                .into_iter()
                .enumerate()
                .map(|(i, k)| (i, Some(i + 1), k))
                .collect();
            springs.extend(
                across
                    .into_iter()
                    .filter(|(a, b, _)| a != b)
                    .map(|(a, b, k)| (a, Some(b), k)),
            );
            springs.extend(ground.into_iter().map(|(a, k)| (a, None, k)));
            (n, springs, grounded)
        })
    })
}

proptest! {
    #[test]
    fn random_networks_match_dense_eigenvalues((n, springs, grounded) in graphs()) {
        let values = dense(n, &springs);
        let rigid = usize::from(!grounded);
        let null = if grounded { Vec::new() } else { vec![vec![1.0; n]] };
        let top = values[n - 1];
        let Largest { theta, residual, safe, .. } = largest(n, &mut operator(&springs));
        prop_assert!(close(theta, top, 1e-9) && residual <= 1e-9 * top, "{theta} {top}");
        prop_assert!(safe >= top * (1.0 - 1e-12));
        // The error of the dense values is some units of rounding of the largest value.
        let rounding = 1e-13 * top;
        let low = lowest(n, &mut operator(&springs), &null).expect("mode").lambda;
        prop_assert!((low - values[rigid]).abs() <= 1e-12 * low + rounding, "{low} {values:?}");
        let sparse = matrix(n, &springs);
        let found = lowest_modes(&sparse, 6);
        prop_assert!(found.is_certified);
        prop_assert_eq!(found.modes.len(), 6.min(n));
        for (mode, value) in found.modes.iter().zip(&values) {
            prop_assert!((mode.lambda - value).abs() <= 1e-12 * value + rounding);
        }
        // Modes nearest to a number, and the number of modes below it.
        let centre = values[n / 2] * 1.01 + 0.01;
        prop_assert_eq!(n_below(&sparse, centre), values.iter().filter(|value| **value < centre).count());
        let mut nearest = values.clone();
        nearest.sort_by(|a, b| (a - centre).abs().total_cmp(&(b - centre).abs()));
        let around = modes_around(&sparse, centre, 4);
        prop_assert!(around.is_certified);
        prop_assert_eq!(around.modes.len(), 4.min(n));
        for mode in &around.modes {
            let known = nearest.iter().take(5).any(|value| (mode.lambda - value).abs() <= 1e-11 * value + rounding);
            prop_assert!(known, "{} {:?} {:?}", mode.lambda, nearest, centre);
        }
    }
}

#[test]
fn largest_up_to_a_bound_ends_early() {
    // Fixed ends and 2,000 masses: λmax is just below 4.
    let n = 2_000;
    let mut row = |v: &[f64], y: &mut [f64]| {
        for i in 0..n {
            let before = if i == 0 { 0.0 } else { v[i - 1] };
            let after = if i + 1 == n { 0.0 } else { v[i + 1] };
            y[i] = 2.0 * v[i] - before - after;
        }
    };
    let complete = largest(n, &mut row);
    let beyond = largest_up_to(n, &mut row, 3.0);
    assert!(beyond.theta >= 3.0 && beyond.theta <= complete.theta);
    assert!(
        beyond.steps <= 5 && complete.steps > 50,
        "{} of {}",
        beyond.steps,
        complete.steps
    );
    // If the bound is not reached, the eigenvalue is found as exactly as without it.
    assert_eq!(largest_up_to(n, &mut row, 4.0), complete);
}

/// Eigenvalues, and squares of coordinates, against nalgebra's; one matrix has equal eigenvalues.
#[test]
fn eigenvalues_of_full_matrices_equal_nalgebra() {
    for n in [1usize, 2, 3, 10, 33, 120] {
        let cell = |i: usize, j: usize| {
            let (low, high) = (i.min(j) as f64, i.max(j) as f64);
            maths::sin(low * 1.7 + high * high) + if i == j { 5.0 } else { 0.0 }
        };
        let full: Vec<f64> = (0..n * n).map(|at| cell(at / n, at % n)).collect();
        let same = nalgebra::DMatrix::from_row_slice(n, n, &full).symmetric_eigen();
        let probe: Vec<f64> = (0..n).map(|i| maths::cos(i as f64)).collect();
        let (values, seen) = all_eigenvalues(full, std::slice::from_ref(&probe)).unwrap();
        let mut expected: Vec<(f64, f64)> = (0..n)
            .map(|i| {
                let column = same.eigenvectors.column(i);
                let along: f64 = column.iter().zip(&probe).map(|(a, b)| a * b).sum();
                (same.eigenvalues[i], along * along)
            })
            .collect();
        expected.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (i, (value, square)) in expected.into_iter().enumerate() {
            assert!(
                (values[i] - value).abs() < 1e-12 * (1.0 + value.abs()),
                "{n}"
            );
            assert!((seen[0][i] * seen[0][i] - square).abs() < 1e-9, "{n} {i}");
        }
    }
}

/// The eigenvalues of a string are 2 − 2 cos(πi/(n + 1)), its vectors √(2/(n + 1))·sin.
#[test]
fn eigenvalues_of_a_string_match_closed_form() {
    let n = 400;
    let mut full = vec![0.0; n * n];
    for i in 0..n {
        full[i * n + i] = 2.0;
        if i > 0 {
            full[i * n + i - 1] = -1.0;
            full[(i - 1) * n + i] = -1.0;
        }
    }
    let mut end = vec![0.0; n];
    end[0] = 1.0;
    let (values, seen) = all_eigenvalues(full, &[end]).unwrap();
    for i in 0..n {
        let angle = std::f64::consts::PI * (i + 1) as f64 / (n + 1) as f64;
        assert!((values[i] - (2.0 - 2.0 * maths::cos(angle))).abs() < 1e-13);
        let vector = maths::sqrt(2.0 / (n + 1) as f64) * maths::sin(angle);
        assert!((seen[0][i].abs() - vector).abs() < 1e-11, "{i}");
    }
}

/// Isolated oscillators, whose eigenvalues are known; several runs are needed, each orthogonal to the modes found
/// before.
#[test]
fn close_modes_are_certified_once_each() {
    let n = 400;
    for step in [2.3e-5, 1e-8] {
        let lambdas: Vec<f64> = (0..n).map(|i| 1e6 * (1.0 + step * i as f64)).collect();
        let alone: Springs = lambdas
            .iter()
            .enumerate()
            .map(|(i, &k)| (i, None, k))
            .collect();
        for (mode, lambda) in certified(n, &alone, n).iter().zip(&lambdas) {
            assert!((mode.lambda / lambda - 1.0).abs() < 1e-13, "{lambda}");
        }
    }
}

/// Counting eigenvalues cannot tell whether a mode was found twice, or a vector is not a mode.
#[test]
fn are_modes_rejects_repeated_and_false_modes() {
    let alone: Springs = (0..5).map(|i| (i, None, 1.0 + i as f64)).collect();
    let springs = matrix(5, &alone);
    let result = lowest_modes(&springs, 4).modes;
    assert!(are_modes(&springs, &result));
    let mut twice = result.clone();
    twice[2] = twice[1].clone();
    assert!(!are_modes(&springs, &twice));
    let mut other = result;
    other[2].vector = other[3].vector.clone();
    assert!(!are_modes(&springs, &other));
}
