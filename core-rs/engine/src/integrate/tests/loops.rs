//! Inner loops against their formulas, and solvers against known solutions.

use std::hint::black_box;

use super::super::conjugate::ConjugateGradients;
use super::super::passes;
use crate::chance::Chance;
use crate::kernel::springs::{ForcePart, SpringPass};
use crate::scheme::{ForceEnds, FusedSprings, Spring};

/// Numbers between -1 and 1.
fn numbers(n: usize, seed: u64) -> Vec<f64> {
    let mut number_source = Chance::new(1, "loops", "", seed, 0);
    (0..n).map(|_| number_source.uniform(-1.0, 1.0)).collect()
}

/// Runs whose two ends overlap, runs whose ends do not, and runs that go backwards.
fn runs() -> Vec<Spring> {
    let spring_run = |a, b, len, q| Spring {
        a,
        b,
        len,
        k: 3e4 / (1.0 + a as f64),
        q,
        z: if a % 2 == 0 { 0.7 } else { 0.0 },
        rest: 1e-3 * b as f64,
        force_ends: ForceEnds::Both(a, b),
    };
    vec![
        spring_run(0, 1, 69, 0.0),
        spring_run(0, 35, 35, 1e5),
        spring_run(40, 3, 30, 1e5),
        spring_run(9, 2, 50, 0.0),
        spring_run(69, 0, 1, 1e5),
    ]
}

/// Forces of all links one after the other, with nothing fused or reordered.
fn plainly(f: impl Fn(&Spring, usize, usize) -> f64) -> Vec<f64> {
    let mut mat_force = vec![0.0; 70];
    for run in runs() {
        let link_forces: Vec<f64> = (0..run.len).map(|i| f(&run, run.a + i, run.b + i)).collect();
        for (i, f) in link_forces.iter().enumerate() {
            mat_force[run.a + i] = black_box(mat_force[run.a + i] + f);
        }
        for (i, f) in link_forces.iter().enumerate() {
            mat_force[run.b + i] = black_box(mat_force[run.b + i] - f);
        }
    }
    mat_force
}

#[test]
fn passes_have_the_bits_of_their_formulas() {
    let (x, v) = (numbers(70, 0), numbers(70, 1));
    let spring_force = |run: &Spring, a: usize, b: usize| {
        let elongation = black_box(x[b] - x[a]) - run.rest;
        let linear_force = black_box(run.k * elongation);
        let cubed_length = black_box(black_box(elongation * elongation) * elongation);
        if run.q == 0.0 {
            linear_force
        } else {
            linear_force + black_box(run.q * cubed_length)
        }
    };
    let damper_force = |run: &Spring, a: usize, b: usize| black_box(run.z * black_box(v[b] - v[a]));
    let pass_forces = |part: ForcePart| {
        let mut mat_force = vec![f64::NAN; 70];
        SpringPass::new(&runs(), 70).compute_forces(part, &FusedSprings::new(runs()), [&x, &v], &mut mat_force);
        mat_force
    };
    assert_eq!(pass_forces(ForcePart::Elastic), plainly(spring_force));
    assert_eq!(pass_forces(ForcePart::Viscous), plainly(damper_force));
    assert_eq!(
        pass_forces(ForcePart::Total),
        plainly(|run, a, b| black_box(spring_force(run, a, b)) + damper_force(run, a, b))
    );
}

#[test]
fn are_in_range_of_bad_positions() {
    for bad in [f64::NAN, f64::INFINITY, -2e4] {
        let mut x = numbers(70, 2);
        assert!(passes::are_in_range(&x));
        x[68] = bad;
        assert!(!passes::are_in_range(&x));
    }
}

#[test]
fn conjugate_gradients_solve_banded_systems() {
    for (n, band) in [(1, 0), (5, 4), (60, 9)] {
        let mut columns = numbers(n * (band + 1), 4);
        for j in 0..n {
            columns[j * (band + 1)] += 2.0 * (band + 1) as f64;
            columns[j * (band + 1)..][n.min(j + band + 1) - j..band + 1].fill(0.0);
        }
        let band_columns = columns.clone();
        let mut apply_matrix = |x: &[f64], y: &mut [f64]| {
            y.fill(0.0);
            for j in 0..n {
                for i in j..n.min(j + band + 1) {
                    let matrix_entry = band_columns[j * (band + 1) + i - j];
                    y[i] += matrix_entry * x[j];
                    if i != j {
                        y[j] += matrix_entry * x[i];
                    }
                }
            }
        };
        let (x, mut y) = (numbers(n, 5), vec![0.0; n]);
        apply_matrix(&x, &mut y);
        let largest_error = |solution: &[f64]| {
            let largest_error = solution.iter().zip(&x).map(|(solution, x)| (solution - x).abs());
            largest_error.fold(0.0, f64::max)
        };
        let inverse: Vec<f64> = (0..n).map(|j| 1.0 / columns[j * (band + 1)]).collect();
        let mut solution = numbers(n, 6);
        ConjugateGradients::new(n).solve(&mut apply_matrix, &inverse, &y, &mut solution);
        assert!(largest_error(&solution) < 1e-14);
    }
}
