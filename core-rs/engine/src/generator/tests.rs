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
    let run_links = |link_run: &TopologyRun| {
        let link_run = *link_run;
        (0..link_run.len).map(move |i| {
            (
                (link_run.a + i).min(link_run.b + i),
                (link_run.a + i).max(link_run.b + i),
            )
        })
    };
    let mut sorted_links: Vec<_> = topology.runs.iter().flat_map(run_links).collect();
    sorted_links.sort_unstable();
    sorted_links
}

fn distance(topology: &Topology, (a, b): (usize, usize)) -> f64 {
    let ([ax, ay], [bx, by]) = (topology.positions[a], topology.positions[b]);
    ((ax - bx) * (ax - bx) + (ay - by) * (ay - by)).sqrt()
}

/// Every pair of points, not both SOLs, whose distance on the picture is the length of a link.
fn neighbours(topology: &Topology, length: f64) -> Vec<(usize, usize)> {
    let n_points = topology.n_mat + topology.n_fixed;
    let point_pairs = (0..topology.n_mat).flat_map(|a| (a + 1..n_points).map(move |b| (a, b)));
    point_pairs
        .filter(|pair| (distance(topology, *pair) / length - 1.0).abs() < 1e-9)
        .collect()
}

fn dense(topology: &Topology) -> nalgebra::DMatrix<f64> {
    let n_masses = topology.n_mat;
    let mut stiffness_matrix = nalgebra::DMatrix::zeros(n_masses, n_masses);
    for run in &topology.runs {
        for i in 0..run.len {
            let (end_a, end_b) = (run.a + i, run.b + i);
            for (p, q) in [(end_a, end_b), (end_b, end_a)] {
                if p < n_masses {
                    stiffness_matrix[(p, p)] += run.factor;
                }
                if p < n_masses && q < n_masses {
                    stiffness_matrix[(p, q)] -= run.factor;
                }
            }
        }
    }
    stiffness_matrix
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
        let outer_ring = radius + usize::from(rim == Rim::Fixed);
        assert_eq!(
            links(&plate),
            neighbours(&plate, 0.5 / outer_ring as f64),
            "{shape:?} {rim:?}"
        );
        assert_eq!(plate.positions.len(), plate.n_mat + plate.n_fixed);
        assert_eq!(plate.positions[plate.centre], [0.0, 0.0]);
        let rim_points = match shape {
            Shape::Hex => 6 * outer_ring,
            _ => 4 * (2 * radius + 1),
        };
        assert_eq!(plate.n_fixed, if rim == Rim::Fixed { rim_points } else { 0 });
    }
    let large_gong = plate(Shape::Hex, 58, Rim::Free).expect("gong");
    assert_eq!((large_gong.n_mat, links(&large_gong).len()), (10_267, 30_450));
    assert!(large_gong.runs.len() <= 3 * 117 - 2, "one run a row and direction");
    let square_plate = plate(Shape::Square, 20, Rim::Free).expect("square");
    assert_eq!(square_plate.runs.len(), 41 + 1);
}

#[test]
fn string_springs_by_ends() {
    for (ends, springs, fixed) in [(Ends::Fixed, 8, 2), (Ends::Left, 7, 1), (Ends::Free, 6, 0)] {
        let plain_string = string(7, ends, 0.0).expect("string");
        assert_eq!(
            (links(&plain_string).len(), plain_string.n_fixed, plain_string.centre),
            (springs, fixed, 3)
        );
        let link_length = distance(&plain_string, (0, 1));
        assert_eq!(links(&plain_string), neighbours(&plain_string, link_length));
        let stiff_row = string(7, ends, 0.02).expect("string");
        // Neighbours but one; a fixed end may be one of them.
        assert_eq!(links(&stiff_row).len(), springs + 5 + fixed);
        let extra_links: usize = stiff_row
            .runs
            .iter()
            .filter(|run| run.factor == 0.02)
            .map(|run| run.len)
            .sum();
        assert_eq!(extra_links, 5 + fixed);
        assert!(stiff_row.lowest_lambda().expect("mode") > plain_string.lowest_lambda().expect("mode"));
    }
    assert!(string(2, Ends::Free, 0.5).is_ok_and(|s| links(&s).len() == 1));
}

// Formulas and iteration against dense matrices of another library.
#[test]
fn lowest_modes_match_dense_eigenvalues() {
    let test_bodies = [
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
    for tested_body in test_bodies {
        let tested_body = tested_body.expect("body");
        let mut eigenvalues: Vec<f64> = dense(&tested_body).symmetric_eigenvalues().iter().copied().collect();
        eigenvalues.sort_by(f64::total_cmp);
        let dense_lambda = eigenvalues[usize::from(tested_body.is_rigid())];
        let lowest_lambda = tested_body.lowest_lambda().expect("mode");
        assert!(
            (lowest_lambda - dense_lambda).abs() <= 1e-12 * dense_lambda + 1e-14 * eigenvalues[eigenvalues.len() - 1]
        );
    }
}

// The gong of ten thousand masses, against ARPACK (shift-invert; λ₁ as the sum over links of its vector).
#[test]
fn large_gong_modes_match_arpack() {
    let large_gong = plate(Shape::Hex, 58, Rim::Free).expect("gong");
    let lowest_lambda = large_gong.lowest_lambda().expect("mode");
    assert!(
        close(lowest_lambda, 0.001_767_593_317_852_036_4, 1e-13),
        "{lowest_lambda}"
    );
    let mut apply_gong = |x: &[f64], y: &mut [f64]| large_gong.apply(x, y);
    let crate::spectrum::LargestRitz {
        theta,
        residual,
        upper_bound,
        ..
    } = crate::spectrum::largest_eigenvalue(large_gong.n_mat, &mut apply_gong);
    let exact_lambda = 8.998_423_184_734_357;
    assert!(
        theta <= exact_lambda && theta + residual >= exact_lambda && upper_bound >= exact_lambda,
        "{theta} {residual}"
    );
    let spring_links = large_gong
        .runs
        .iter()
        .flat_map(|run| (0..run.len).map(|i| ((run.a + i, 1.0), Some((run.b + i, 1.0)), run.factor)));
    let springs = crate::spectrum::springs::Springs::new(large_gong.n_mat, spring_links.collect());
    let mode_search = crate::spectrum::lowest_modes(&springs, 7);
    assert!(mode_search.is_certified && mode_search.modes[0].lambda.abs() < 1e-13);
    let moving_modes = &mode_search.modes[1..];
    let expected = [
        0.001_767_593_317_852,
        0.001_767_593_317_852,
        0.004_741_437_800_798,
        0.004_741_437_800_798,
        0.007_630_716_347_664,
        0.007_685_707_940_994,
    ];
    for (mode, expected) in moving_modes.iter().zip(expected) {
        assert!(close(mode.lambda, expected, 1e-12), "{} {expected}", mode.lambda);
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
    for lonely_body in [string(1, Ends::Free, 0.0), plate(Shape::Hex, 0, Rim::Free)] {
        let lonely_body = lonely_body.expect("made");
        assert_eq!(tune(&lonely_body, 1.0, 440.0, None, None), Err(GeneratorError::NoMode));
    }
    let string = string(9, Ends::Fixed, 0.0).expect("string");
    for (mass, f, t60) in [(0.0, 1.0, 1.0), (1.0, f64::NAN, 1.0), (1.0, 1.0, 0.0)] {
        assert!(tune(&string, mass, f, Some(t60), None).is_err());
    }
    let test_rate = Rate::new(1_000.0).ok();
    assert!(matches!(
        tune(&string, 1.0, 500.0, None, test_rate),
        Err(GeneratorError::Pitch { .. })
    ));
}

/// σ and damped frequency of the lowest mode of m ẍ + z L ẋ + k L x = 0, from the dense matrix.
#[test]
fn continuous_tuning_of_pitch_and_decay() {
    let plate = plate(Shape::Hex, 4, Rim::Free).expect("plate");
    let (mass, f, t60) = (0.005, 65.4, 3.0);
    let TunedLinks { k, z } = tune(&plate, mass, f, Some(t60), None).expect("tuned");
    let mut eigenvalues: Vec<f64> = dense(&plate).symmetric_eigenvalues().iter().copied().collect();
    eigenvalues.sort_by(f64::total_cmp);
    let (squared, sigma) = (k * eigenvalues[1] / mass, 0.5 * z * eigenvalues[1] / mass);
    assert!(close((squared - sigma * sigma).sqrt(), TAU * f, 1e-12));
    assert!(close(3.0 * LN_10 / sigma, t60, 1e-12));
    let lossless = tune(&plate, mass, f, None, None).expect("tuned");
    assert_eq!(lossless.z, 0.0);
    assert!(close((lossless.k * eigenvalues[1] / mass).sqrt(), TAU * f, 1e-12));
}

// The discrete network is run: its lowest mode is excited alone, and its pole read from three samples.
#[test]
fn discrete_tuning_of_pole() {
    let (sample_rate, f, t60) = (Rate::new(44_100.0).expect("rate"), 880.0, 0.4);
    let string = string(12, Ends::Fixed, 0.1).expect("string");
    let mass = 3.0;
    let TunedLinks { k, z } = tune(&string, mass, f, Some(t60), Some(sample_rate)).expect("tuned");
    let mut apply_string = |x: &[f64], y: &mut [f64]| string.apply(x, y);
    let mode_shape = crate::spectrum::lowest_mode(12, &mut apply_string, &[])
        .expect("mode")
        .vector;
    let (mut x, mut last_positions) = (mode_shape.clone(), mode_shape);
    let (mut elastic, mut viscous) = (vec![0.0; 12], vec![0.0; 12]);
    let mut listened = Vec::new();
    for _ in 0..4 {
        listened.push(x[5]);
        let position_change: Vec<f64> = x
            .iter()
            .zip(&last_positions)
            .map(|(x, last_positions)| x - last_positions)
            .collect();
        string.apply(&x, &mut elastic);
        string.apply(&position_change, &mut viscous);
        last_positions.clone_from(&x);
        for i in 0..12 {
            x[i] += position_change[i] - (k * elastic[i] + z * viscous[i]) / mass;
        }
    }
    // x[n+1] = (2-κ-ζ) x[n] - (1-ζ) x[n-1], solved for κ and ζ from four samples.
    let (a, b, c, d) = (listened[0], listened[1], listened[2], listened[3]);
    let (p, q) = ((b * c - a * d) / (b * b - a * c), (c * c - b * d) / (b * b - a * c));
    let zeta = 1.0 - q;
    let pole_ratios = cell::CellRatios {
        kappa: 2.0 - p - zeta,
        zeta,
    };
    let (f_heard, t60_heard) = pole_ratios.pitch(sample_rate).expect("oscillates");
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
