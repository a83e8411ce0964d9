use super::*;
use crate::cell;
use crate::maths::{exp, log};
use crate::units::Rate;
use proptest::prelude::*;
use std::f64::consts::{LN_10, TAU};

mod banks;
mod bending;
mod decays;

/// Links one by one, each from its lower point.
fn links(topology: &Topology) -> Vec<(usize, usize)> {
    let each = |run: &LinkRun| {
        let run = *run;
        (0..run.len).map(move |i| ((run.a + i).min(run.b + i), (run.a + i).max(run.b + i)))
    };
    let mut links: Vec<_> = topology.runs.iter().flat_map(each).collect();
    links.sort_unstable();
    links
}

fn distance(topology: &Topology, (a, b): (usize, usize)) -> f64 {
    let ([ax, ay], [bx, by]) = (topology.positions[a], topology.positions[b]);
    ((ax - bx) * (ax - bx) + (ay - by) * (ay - by)).sqrt()
}

/// Every pair of points, not both SOLs, whose distance on the bench is the length of a link.
fn neighbours(topology: &Topology, length: f64) -> Vec<(usize, usize)> {
    let n = topology.n_mat + topology.n_fixed;
    let pairs = (0..topology.n_mat).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
    pairs
        .filter(|pair| (distance(topology, *pair) / length - 1.0).abs() < 1e-9)
        .collect()
}

fn dense(topology: &Topology) -> nalgebra::DMatrix<f64> {
    let n = topology.n_mat;
    let mut matrix = nalgebra::DMatrix::zeros(n, n);
    for run in &topology.runs {
        for i in 0..run.len {
            let (a, b) = (run.a + i, run.b + i);
            for (p, q) in [(a, b), (b, a)] {
                if p < n {
                    matrix[(p, p)] += run.factor;
                }
                if p < n && q < n {
                    matrix[(p, q)] -= run.factor;
                }
            }
        }
    }
    matrix
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * b.abs()
}

#[test]
fn plate_links_all_neighbours_once() {
    for (shape, rim, radius) in [
        (Shape::Hex, Rim::Free, 4),
        (Shape::Hex, Rim::Fixed, 3),
        (Shape::Hex, Rim::Fixed, 0),
        (Shape::Square, Rim::Free, 3),
        (Shape::Square, Rim::Fixed, 3),
        (Shape::Square, Rim::Fixed, 0),
    ] {
        let plate = plate(shape, radius, rim).expect("plate");
        let outer = radius + usize::from(rim == Rim::Fixed);
        assert_eq!(
            links(&plate),
            neighbours(&plate, 0.5 / outer as f64),
            "{shape:?} {rim:?}"
        );
        assert_eq!(plate.positions.len(), plate.n_mat + plate.n_fixed);
        assert_eq!(plate.positions[plate.centre], [0.0, 0.0]);
        let ring = match shape {
            Shape::Hex => 6 * outer,
            _ => 4 * (2 * radius + 1),
        };
        assert_eq!(plate.n_fixed, if rim == Rim::Fixed { ring } else { 0 });
    }
    let gong = plate(Shape::Hex, 58, Rim::Free).expect("gong");
    assert_eq!((gong.n_mat, links(&gong).len()), (10_267, 30_450));
    assert!(
        gong.runs.len() <= 3 * 117 - 2,
        "one run a row and direction"
    );
    let square = plate(Shape::Square, 20, Rim::Free).expect("square");
    assert_eq!(square.runs.len(), 41 + 1);
}

#[test]
fn string_springs_by_ends() {
    for (ends, springs, fixed) in [(Ends::Fixed, 8, 2), (Ends::Left, 7, 1), (Ends::Free, 6, 0)] {
        let plain = string(7, ends, 0.0).expect("string");
        assert_eq!(
            (links(&plain).len(), plain.n_fixed, plain.centre),
            (springs, fixed, 3)
        );
        let gap = distance(&plain, (0, 1));
        assert_eq!(links(&plain), neighbours(&plain, gap));
        let stiff = string(7, ends, 0.02).expect("string");
        // Neighbours but one; a fixed end may be one of them.
        assert_eq!(links(&stiff).len(), springs + 5 + fixed);
        let extra: usize = stiff
            .runs
            .iter()
            .filter(|run| run.factor == 0.02)
            .map(|run| run.len)
            .sum();
        assert_eq!(extra, 5 + fixed);
        assert!(stiff.lowest().expect("mode") > plain.lowest().expect("mode"));
    }
    assert!(string(2, Ends::Free, 0.5).is_ok_and(|s| links(&s).len() == 1));
}

// Formulas and iteration against dense matrices of another library.
#[test]
fn lowest_modes_match_dense_eigenvalues() {
    let bodies = [
        string(40, Ends::Fixed, 0.0),
        string(40, Ends::Free, 0.0),
        string(40, Ends::Left, 0.0),
        string(40, Ends::Fixed, 0.3),
        string(41, Ends::Free, 0.3),
        string(1, Ends::Left, 0.0),
        plate(Shape::Square, 4, Rim::Free),
        plate(Shape::Square, 4, Rim::Fixed),
        plate(Shape::Square, 0, Rim::Fixed),
        plate(Shape::Hex, 5, Rim::Free),
        plate(Shape::Hex, 5, Rim::Fixed),
        plate(Shape::Hex, 0, Rim::Fixed),
    ];
    for body in bodies {
        let body = body.expect("body");
        let mut values: Vec<f64> = dense(&body)
            .symmetric_eigenvalues()
            .iter()
            .copied()
            .collect();
        values.sort_by(f64::total_cmp);
        let value = values[usize::from(body.is_rigid())];
        let lambda = body.lowest().expect("mode");
        assert!((lambda - value).abs() <= 1e-12 * value + 1e-14 * values[values.len() - 1]);
    }
}

// The gong of ten thousand masses, against ARPACK (shift-invert; λ₁ as the sum over links of its vector).
#[test]
fn large_gong_modes_match_arpack() {
    let gong = plate(Shape::Hex, 58, Rim::Free).expect("gong");
    let lambda = gong.lowest().expect("mode");
    assert!(
        close(lambda, 0.001_767_593_317_852_036_4, 1e-13),
        "{lambda}"
    );
    let mut apply = |x: &[f64], y: &mut [f64]| gong.apply(x, y);
    let crate::spectrum::Largest {
        theta,
        residual,
        safe,
        ..
    } = crate::spectrum::largest(gong.n_mat, &mut apply);
    let exact = 8.998_423_184_734_357;
    assert!(
        theta <= exact && theta + residual >= exact && safe >= exact,
        "{theta} {residual}"
    );
    let links = gong.runs.iter().flat_map(|run| {
        (0..run.len).map(|i| ((run.a + i, 1.0), Some((run.b + i, 1.0)), run.factor))
    });
    let springs = crate::spectrum::springs::Springs::new(gong.n_mat, links.collect());
    let result = crate::spectrum::lowest_modes(&springs, 7);
    assert!(result.is_certified && result.modes[0].lambda.abs() < 1e-13);
    let modes = &result.modes[1..];
    let expected = [
        0.001_767_593_317_852,
        0.001_767_593_317_852,
        0.004_741_437_800_798,
        0.004_741_437_800_798,
        0.007_630_716_347_664,
        0.007_685_707_940_994,
    ];
    for (mode, expected) in modes.iter().zip(expected) {
        assert!(
            close(mode.lambda, expected, 1e-12),
            "{} {expected}",
            mode.lambda
        );
    }
}

#[test]
fn strings_and_plates_of_impossible_sizes_are_refused() {
    let sentence = |error: GeneratorError| error.to_string();
    assert_eq!(
        string(0, Ends::Fixed, 0.0).map_err(sentence),
        Err("`masses` must be from 1 to 2000000; here it is 0.".into())
    );
    assert!(string(2_000_001, Ends::Fixed, 0.0).is_err());
    assert!(string(20_001, Ends::Fixed, 0.1).is_err());
    assert!(string(9, Ends::Fixed, -0.1).is_err());
    assert!(string(9, Ends::Fixed, f64::NAN).is_err());
    assert!(plate(Shape::Hex, 817, Rim::Free).is_err());
    assert!(plate(Shape::Square, usize::MAX / 8, Rim::Free).is_err());
    for lonely in [string(1, Ends::Free, 0.0), plate(Shape::Hex, 0, Rim::Free)] {
        let lonely = lonely.expect("made");
        assert_eq!(
            tune(&lonely, 1.0, 440.0, None, None),
            Err(GeneratorError::NoMode)
        );
    }
    let string = string(9, Ends::Fixed, 0.0).expect("string");
    for (mass, f, t60) in [(0.0, 1.0, 1.0), (1.0, f64::NAN, 1.0), (1.0, 1.0, 0.0)] {
        assert!(tune(&string, mass, f, Some(t60), None).is_err());
    }
    let rate = Rate::new(1_000.0).ok();
    assert!(matches!(
        tune(&string, 1.0, 500.0, None, rate),
        Err(GeneratorError::Pitch { .. })
    ));
}

/// σ and damped frequency of the lowest mode of m ẍ + z L ẋ + k L x = 0, from the dense matrix.
#[test]
fn continuous_tuning_of_pitch_and_decay() {
    let plate = plate(Shape::Hex, 4, Rim::Free).expect("plate");
    let (mass, f, t60) = (0.005, 65.4, 3.0);
    let Tuned { k, z } = tune(&plate, mass, f, Some(t60), None).expect("tuned");
    let mut values: Vec<f64> = dense(&plate)
        .symmetric_eigenvalues()
        .iter()
        .copied()
        .collect();
    values.sort_by(f64::total_cmp);
    let (squared, sigma) = (k * values[1] / mass, 0.5 * z * values[1] / mass);
    assert!(close((squared - sigma * sigma).sqrt(), TAU * f, 1e-12));
    assert!(close(3.0 * LN_10 / sigma, t60, 1e-12));
    let lossless = tune(&plate, mass, f, None, None).expect("tuned");
    assert_eq!(lossless.z, 0.0);
    assert!(close(
        (lossless.k * values[1] / mass).sqrt(),
        TAU * f,
        1e-12
    ));
}

// The discrete network is run: its lowest mode is excited alone, and its pole read from three samples.
#[test]
fn discrete_tuning_of_pole() {
    let (rate, f, t60) = (Rate::new(44_100.0).expect("rate"), 880.0, 0.4);
    let string = string(12, Ends::Fixed, 0.1).expect("string");
    let mass = 3.0;
    let Tuned { k, z } = tune(&string, mass, f, Some(t60), Some(rate)).expect("tuned");
    let mut apply = |x: &[f64], y: &mut [f64]| string.apply(x, y);
    let shape = crate::spectrum::lowest(12, &mut apply, &[])
        .expect("mode")
        .vector;
    let (mut x, mut last) = (shape.clone(), shape);
    let (mut elastic, mut viscous) = (vec![0.0; 12], vec![0.0; 12]);
    let mut listened = Vec::new();
    for _ in 0..4 {
        listened.push(x[5]);
        let delta: Vec<f64> = x.iter().zip(&last).map(|(x, last)| x - last).collect();
        string.apply(&x, &mut elastic);
        string.apply(&delta, &mut viscous);
        last.clone_from(&x);
        for i in 0..12 {
            x[i] += delta[i] - (k * elastic[i] + z * viscous[i]) / mass;
        }
    }
    // x[n+1] = (2-κ-ζ) x[n] - (1-ζ) x[n-1], solved for κ and ζ from four samples.
    let (a, b, c, d) = (listened[0], listened[1], listened[2], listened[3]);
    let (p, q) = (
        (b * c - a * d) / (b * b - a * c),
        (c * c - b * d) / (b * b - a * c),
    );
    let zeta = 1.0 - q;
    let ratios = cell::Ratios {
        kappa: 2.0 - p - zeta,
        zeta,
    };
    let (f_heard, t60_heard) = ratios.pitch(rate).expect("oscillates");
    assert!(
        close(f_heard, f, 1e-8) && close(t60_heard, t60, 1e-6),
        "{f_heard} {t60_heard}"
    );
}

proptest! {
    // Runs, and slices of them, act as their links do one by one.
    #[test]
    fn apply_equals_dense_matrix(seed in 0..1_000u32, fixed in any::<bool>()) {
        let rim = if fixed { Rim::Fixed } else { Rim::Free };
        let plate = plate(Shape::Hex, 3, rim).expect("plate");
        let x: Vec<f64> = (0..plate.n_mat as u32)
            .map(|i| f64::from((i * 7_919 + seed) * 729 % 1_009) / 500.0 - 1.0)
            .collect();
        let mut y = vec![9.0; plate.n_mat];
        plate.apply(&x, &mut y);
        let exact = dense(&plate) * nalgebra::DVector::from_vec(x);
        for (y, exact) in y.iter().zip(exact.iter()) {
            prop_assert!((y - exact).abs() < 1e-13);
        }
    }
}
