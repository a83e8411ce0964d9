//! Inner loops against their formulas, and solvers against known solutions.

use std::hint::black_box;

use super::super::conjugate::Conjugate;
use super::super::passes;
use crate::chance::Chance;
use crate::kernel::springs;
use crate::scheme::{Pull, Spring};

/// Numbers between -1 and 1.
fn numbers(n: usize, seed: u64) -> Vec<f64> {
    let mut chance = Chance::new(1, "loops", "", seed, 0);
    (0..n).map(|_| chance.uniform(-1.0, 1.0)).collect()
}

/// Runs whose two ends overlap, runs whose ends do not, and runs that go backwards.
fn runs() -> Vec<Spring> {
    let spring = |a, b, len, q| Spring {
        a,
        b,
        len,
        k: 3e4 / (1.0 + a as f64),
        q,
        z: if a % 2 == 0 { 0.7 } else { 0.0 },
        rest: 1e-3 * b as f64,
        pull: Pull::Both(a, b),
    };
    vec![
        spring(0, 1, 69, 0.0),
        spring(0, 35, 35, 1e5),
        spring(40, 3, 30, 1e5),
        spring(9, 2, 50, 0.0),
        spring(69, 0, 1, 1e5),
    ]
}

/// Forces of all links one after the other, with nothing fused or reordered.
fn plainly(f: impl Fn(&Spring, usize, usize) -> f64) -> Vec<f64> {
    let mut force = vec![0.0; 70];
    for run in runs() {
        let all: Vec<f64> = (0..run.len)
            .map(|i| f(&run, run.a + i, run.b + i))
            .collect();
        for (i, f) in all.iter().enumerate() {
            force[run.a + i] = black_box(force[run.a + i] + f);
        }
        for (i, f) in all.iter().enumerate() {
            force[run.b + i] = black_box(force[run.b + i] - f);
        }
    }
    force
}

#[test]
fn passes_have_the_bits_of_their_formulas() {
    let (x, v, mut scratch) = (numbers(70, 0), numbers(70, 1), vec![0.0; 70]);
    let spring = |run: &Spring, a: usize, b: usize| {
        let e = black_box(x[b] - x[a]) - run.rest;
        let linear = black_box(run.k * e);
        let cube = black_box(black_box(e * e) * e);
        if run.q == 0.0 {
            linear
        } else {
            linear + black_box(run.q * cube)
        }
    };
    let damper = |run: &Spring, a: usize, b: usize| black_box(run.z * black_box(v[b] - v[a]));
    let mut result = vec![0.0; 70];
    passes::elastic(&runs(), &x, &mut scratch, &mut result);
    assert_eq!(result, plainly(spring));
    result.fill(0.0);
    passes::viscous(&runs(), &v, &mut scratch, &mut result);
    assert_eq!(result, plainly(damper));
    result.fill(0.0);
    springs::total(&runs(), &x, &v, &mut scratch, &mut result);
    assert_eq!(
        result,
        plainly(|run, a, b| black_box(spring(run, a, b)) + damper(run, a, b))
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
        let matrix = columns.clone();
        let mut apply = |x: &[f64], y: &mut [f64]| {
            y.fill(0.0);
            for j in 0..n {
                for i in j..n.min(j + band + 1) {
                    let entry = matrix[j * (band + 1) + i - j];
                    y[i] += entry * x[j];
                    if i != j {
                        y[j] += entry * x[i];
                    }
                }
            }
        };
        let (x, mut y) = (numbers(n, 5), vec![0.0; n]);
        apply(&x, &mut y);
        let off = |result: &[f64]| {
            let off = result.iter().zip(&x).map(|(result, x)| (result - x).abs());
            off.fold(0.0, f64::max)
        };
        let inverse: Vec<f64> = (0..n).map(|j| 1.0 / columns[j * (band + 1)]).collect();
        let mut result = numbers(n, 6);
        Conjugate::new(n).solve(&mut apply, &inverse, &y, &mut result);
        assert!(off(&result) < 1e-14);
    }
}
