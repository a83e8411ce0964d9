use super::*;
use crate::maths::{self, sin};
use proptest::prelude::*;
use std::f64::consts::PI;

/// The sparse matrix of springs between masses of 1.
fn matrix(n: usize, springs: &Springs) -> springs::Springs {
    let unit_springs = springs.iter();
    let unit_springs = unit_springs.map(|&(a, b, k)| ((a, 1.0), b.map(|b| (b, 1.0)), k));
    springs::Springs::new(n, unit_springs.collect())
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
            let spring_force = k * (x[*a] - b.map_or(0.0, |b| x[b]));
            y[*a] += spring_force;
            if let Some(b) = b {
                y[*b] -= spring_force;
            }
        }
    }
}

fn dense(n: usize, springs: &Springs) -> Vec<f64> {
    let mut apply_springs = operator(springs);
    let mut matrix = nalgebra::DMatrix::zeros(n, n);
    for i in 0..n {
        let mut unit_vector = vec![0.0; n];
        unit_vector[i] = 1.0;
        let mut matrix_column = vec![0.0; n];
        apply_springs(&unit_vector, &mut matrix_column);
        matrix.set_column(i, &nalgebra::DVector::from_vec(matrix_column));
    }
    let mut eigenvalues: Vec<f64> = matrix.symmetric_eigenvalues().iter().copied().collect();
    eigenvalues.sort_by(f64::total_cmp);
    eigenvalues
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
    vector::add_scaled(-mode.lambda, &mode.vector, &mut image);
    vector::norm(&image)
}

#[test]
fn lowest_mode_of_strings_matches_closed_form() {
    for n in [1, 2, 3, 7, 60, 1_000, 5_000] {
        let double_span = 2.0 * (n as f64 + 1.0);
        let fixed_string = string(n, true);
        let mode = lowest_mode(n, &mut operator(&fixed_string), &[]).expect("fixed");
        let closed_form = from_sine(PI / double_span);
        assert!(
            close(mode.lambda, closed_form, 1e-13),
            "{n}: {} {closed_form}",
            mode.lambda
        );
        let free_string = string(n, false);
        let mode = lowest_mode(n, &mut operator(&free_string), &[vec![1.0; n]]);
        assert_eq!(mode.is_none(), n == 1);
        if let Some(mode) = mode {
            let closed_form = from_sine(PI / (2.0 * n as f64));
            assert!(
                close(mode.lambda, closed_form, 1e-13),
                "{n}: {} {closed_form}",
                mode.lambda
            );
            assert!(residual(&free_string, &mode) <= 1e-7 * closed_form);
        }
        if n > 1 {
            let LargestRitz {
                theta,
                residual,
                upper_bound,
                ..
            } = largest_eigenvalue(n, &mut operator(&fixed_string));
            let closed_form = from_sine(PI / 2.0 * n as f64 / (n as f64 + 1.0));
            assert!(
                theta <= closed_form * (1.0 + 1e-14) && upper_bound >= closed_form * (1.0 - 1e-14),
                "{n}"
            );
            assert!(
                (closed_form - theta) <= f64::max(residual, 1e-13),
                "{n}: {theta} {residual}"
            );
        }
    }
}

#[test]
fn modes_of_a_string_and_of_a_membrane() {
    let mass_count = 300;
    let fixed_string = string(mass_count, true);
    let modes = certified(mass_count, &fixed_string, 50);
    assert_eq!(modes.len(), 50);
    for (i, mode) in modes.iter().enumerate() {
        let closed_form = from_sine((i + 1) as f64 * PI / (2.0 * (mass_count as f64 + 1.0)));
        assert!(
            close(mode.lambda, closed_form, 1e-12),
            "{i}: {} {closed_form}",
            mode.lambda
        );
    }
    // The modes of a square membrane come in pairs of one frequency: λ is the sum of those of two strings.
    let side_count = 21;
    let mut springs: Springs = Vec::new();
    for i in 0..side_count * side_count {
        if i % side_count > 0 {
            springs.push((i - 1, Some(i), 1.0));
        }
        if i >= side_count {
            springs.push((i - side_count, Some(i), 1.0));
        }
    }
    let string_lambda = |i: usize| from_sine(i as f64 * PI / (2.0 * side_count as f64));
    let mut closed_form: Vec<f64> = (0..side_count * side_count)
        .map(|i| string_lambda(i / side_count) + string_lambda(i % side_count))
        .collect();
    closed_form.sort_by(f64::total_cmp);
    let null_vectors = [vec![1.0; side_count * side_count]];
    let modes = certified(side_count * side_count, &springs, 31);
    assert!(modes[0].lambda.abs() < 1e-12);
    for (mode, closed_form) in modes.iter().zip(&closed_form).skip(1) {
        assert!(close(mode.lambda, *closed_form, 1e-12), "{} {closed_form}", mode.lambda);
        assert!(residual(&springs, mode) < 1e-7 * closed_form);
    }
    let lowest_mode = lowest_mode(side_count * side_count, &mut operator(&springs), &null_vectors).expect("mode");
    assert!(close(lowest_mode.lambda, closed_form[1], 1e-13));
}

// Two bodies nearly in tune: their lowest modes differ by a ten-thousandth.
#[test]
fn modes_of_nearly_tuned_bodies_are_separated() {
    let mass_count = 50;
    let mut springs = string(mass_count, true);
    let second_string: Springs = string(mass_count, true);
    let shifted = |(a, b, k): &(usize, Option<usize>, f64)| (a + mass_count, b.map(|b| b + mass_count), k * 1.0001);
    springs.extend(second_string.iter().map(shifted));
    let mode = lowest_mode(2 * mass_count, &mut operator(&springs), &[]).expect("mode");
    let closed_form = from_sine(PI / (2.0 * (mass_count as f64 + 1.0)));
    assert!(close(mode.lambda, closed_form, 1e-13), "{} {closed_form}", mode.lambda);
    assert!(vector::norm(&mode.vector[mass_count..]) < 1e-3);
    let lowest_two = certified(2 * mass_count, &springs, 2);
    assert!(
        close(lowest_two[0].lambda, closed_form, 1e-12) && close(lowest_two[1].lambda, closed_form * 1.0001, 1e-12)
    );
}

#[test]
fn modes_without_links_have_zero_frequency() {
    let mut nothing = |_: &[f64], y: &mut [f64]| y.fill(0.0);
    assert_eq!(largest_eigenvalue(5, &mut nothing).theta, 0.0);
    assert_eq!(lowest_mode(5, &mut nothing, &[]).expect("mode").lambda, 0.0);
    let zero_modes = certified(5, &Vec::new(), 3);
    assert!(zero_modes.len() == 3 && zero_modes.iter().all(|mode| mode.lambda == 0.0));
}

/// Connected graphs: a chain with springs across it, and perhaps some to the ground.
fn graphs() -> impl Strategy<Value = (usize, Springs, bool)> {
    (2..40usize, any::<bool>()).prop_flat_map(|(n, grounded)| {
        let chain_springs = prop::collection::vec(0.1..10.0f64, n - 1);
        let cross_springs = prop::collection::vec((0..n, 0..n, 0.1..10.0f64), 0..60);
        let ground_springs = prop::collection::vec((0..n, 0.1..5.0f64), usize::from(grounded) * 3);
        (chain_springs, cross_springs, ground_springs).prop_map(
            move |(chain_springs, cross_springs, ground_springs)| {
                let mut springs: Springs = chain_springs
                    .into_iter()
                    .enumerate()
                    .map(|(i, k)| (i, Some(i + 1), k))
                    .collect();
                springs.extend(
                    cross_springs
                        .into_iter()
                        .filter(|(a, b, _)| a != b)
                        .map(|(a, b, k)| (a, Some(b), k)),
                );
                springs.extend(ground_springs.into_iter().map(|(a, k)| (a, None, k)));
                (n, springs, grounded)
            },
        )
    })
}

proptest! {
    #[test]
    fn random_networks_match_dense_eigenvalues((n, springs, grounded) in graphs()) {
        let values = dense(n, &springs);
        let rigid = usize::from(!grounded);
        let null = if grounded { Vec::new() } else { vec![vec![1.0; n]] };
        let top = values[n - 1];
        let LargestRitz { theta, residual, upper_bound, .. } = largest_eigenvalue(n, &mut operator(&springs));
        prop_assert!(close(theta, top, 1e-9) && residual <= 1e-9 * top, "{theta} {top}");
        prop_assert!(upper_bound >= top * (1.0 - 1e-12));
        // The error of the dense values is some units of rounding of the largest value.
        let rounding = 1e-13 * top;
        let low = lowest_mode(n, &mut operator(&springs), &null).expect("mode").lambda;
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
    let mass_count = 2_000;
    let mut apply_string = |v: &[f64], y: &mut [f64]| {
        for i in 0..mass_count {
            let left_neighbour = if i == 0 { 0.0 } else { v[i - 1] };
            let right_neighbour = if i + 1 == mass_count { 0.0 } else { v[i + 1] };
            y[i] = 2.0 * v[i] - left_neighbour - right_neighbour;
        }
    };
    let complete = largest_eigenvalue(mass_count, &mut apply_string);
    let bounded = largest_eigenvalue_up_to(mass_count, &mut apply_string, 3.0);
    assert!(bounded.theta >= 3.0 && bounded.theta <= complete.theta);
    assert!(
        bounded.steps <= 5 && complete.steps > 50,
        "{} of {}",
        bounded.steps,
        complete.steps
    );
    // If the bound is not reached, the eigenvalue is found as exactly as without it.
    assert_eq!(largest_eigenvalue_up_to(mass_count, &mut apply_string, 4.0), complete);
}

/// Eigenvalues, and squares of coordinates, against nalgebra's; one matrix has equal eigenvalues.
#[test]
fn eigenvalues_of_full_matrices_equal_nalgebra() {
    for n in [1usize, 2, 3, 10, 33, 120] {
        let matrix_entry = |i: usize, j: usize| {
            let (lower_index, upper_index) = (i.min(j) as f64, i.max(j) as f64);
            maths::sin(lower_index * 1.7 + upper_index * upper_index) + if i == j { 5.0 } else { 0.0 }
        };
        let full_matrix: Vec<f64> = (0..n * n).map(|at| matrix_entry(at / n, at % n)).collect();
        let reference = nalgebra::DMatrix::from_row_slice(n, n, &full_matrix).symmetric_eigen();
        let probe_vector: Vec<f64> = (0..n).map(|i| maths::cos(i as f64)).collect();
        let (eigenvalues, coordinates) = all_eigenvalues(full_matrix, std::slice::from_ref(&probe_vector)).unwrap();
        let mut expected: Vec<(f64, f64)> = (0..n)
            .map(|i| {
                let eigenvector = reference.eigenvectors.column(i);
                let coordinate: f64 = eigenvector.iter().zip(&probe_vector).map(|(a, b)| a * b).sum();
                (reference.eigenvalues[i], coordinate * coordinate)
            })
            .collect();
        expected.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (i, (value, square)) in expected.into_iter().enumerate() {
            assert!((eigenvalues[i] - value).abs() < 1e-12 * (1.0 + value.abs()), "{n}");
            assert!((coordinates[0][i] * coordinates[0][i] - square).abs() < 1e-9, "{n} {i}");
        }
    }
}

/// The eigenvalues of a string are 2 − 2 cos(πi/(n + 1)), its vectors √(2/(n + 1))·sin.
#[test]
fn eigenvalues_of_a_string_match_closed_form() {
    let mass_count = 400;
    let mut full_matrix = vec![0.0; mass_count * mass_count];
    for i in 0..mass_count {
        full_matrix[i * mass_count + i] = 2.0;
        if i > 0 {
            full_matrix[i * mass_count + i - 1] = -1.0;
            full_matrix[(i - 1) * mass_count + i] = -1.0;
        }
    }
    let mut end_vector = vec![0.0; mass_count];
    end_vector[0] = 1.0;
    let (eigenvalues, coordinates) = all_eigenvalues(full_matrix, &[end_vector]).unwrap();
    for i in 0..mass_count {
        let mode_angle = std::f64::consts::PI * (i + 1) as f64 / (mass_count + 1) as f64;
        assert!((eigenvalues[i] - (2.0 - 2.0 * maths::cos(mode_angle))).abs() < 1e-13);
        let end_amplitude = maths::sqrt(2.0 / (mass_count + 1) as f64) * maths::sin(mode_angle);
        assert!((coordinates[0][i].abs() - end_amplitude).abs() < 1e-11, "{i}");
    }
}

/// Isolated oscillators, whose eigenvalues are known; several runs are needed, each orthogonal to the modes found
/// before.
#[test]
fn close_modes_are_certified_once_each() {
    let mode_count = 400;
    for step in [2.3e-5, 1e-8] {
        let lambdas: Vec<f64> = (0..mode_count).map(|i| 1e6 * (1.0 + step * i as f64)).collect();
        let lone_springs: Springs = lambdas.iter().enumerate().map(|(i, &k)| (i, None, k)).collect();
        for (mode, lambda) in certified(mode_count, &lone_springs, mode_count).iter().zip(&lambdas) {
            assert!((mode.lambda / lambda - 1.0).abs() < 1e-13, "{lambda}");
        }
    }
}

/// Counting eigenvalues cannot tell whether a mode was found twice, or a vector is not a mode.
#[test]
fn are_modes_rejects_repeated_and_false_modes() {
    let lone_springs: Springs = (0..5).map(|i| (i, None, 1.0 + i as f64)).collect();
    let springs = matrix(5, &lone_springs);
    let true_modes = lowest_modes(&springs, 4).modes;
    assert!(are_distinct_modes(&springs, &true_modes));
    let mut repeated_modes = true_modes.clone();
    repeated_modes[2] = repeated_modes[1].clone();
    assert!(!are_distinct_modes(&springs, &repeated_modes));
    let mut false_modes = true_modes;
    false_modes[2].vector = false_modes[3].vector.clone();
    assert!(!are_distinct_modes(&springs, &false_modes));
}
