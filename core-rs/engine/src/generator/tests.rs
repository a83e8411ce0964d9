use super::*;
use crate::cell;
use crate::maths::{exp, log};
use crate::units::Rate;
use proptest::prelude::*;
use std::f64::consts::{LN_10, TAU};

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

/// Every pair of points, not both SOLs, whose distance on the bench is one link's.
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
fn plates_link_all_neighbours_and_nothing_else() {
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
fn strings_have_their_springs() {
    for (ends, springs, fixed) in [(Ends::Fixed, 8, 2), (Ends::Left, 7, 1), (Ends::Free, 6, 0)] {
        let plain = string(7, ends, 0.0).expect("string");
        assert_eq!(
            (links(&plain).len(), plain.n_fixed, plain.centre),
            (springs, fixed, 3)
        );
        let gap = distance(&plain, (0, 1));
        assert_eq!(links(&plain), neighbours(&plain, gap));
        let stiff = string(7, ends, 0.02).expect("string");
        // Neighbours but one, of which a fixed end may be one.
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
fn a_large_gong_matches_arpack() {
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
    let null = [vec![1.0; gong.n_mat]];
    let modes = crate::spectrum::lowest_modes(gong.n_mat, &mut apply, &null, 6);
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
fn what_cannot_be_made_is_refused_with_a_sentence() {
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
fn continuous_tuning_gives_pitch_and_decay() {
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
fn discrete_tuning_gives_the_pole() {
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
    let mut heard = Vec::new();
    for _ in 0..4 {
        heard.push(x[5]);
        let delta: Vec<f64> = x.iter().zip(&last).map(|(x, last)| x - last).collect();
        string.apply(&x, &mut elastic);
        string.apply(&delta, &mut viscous);
        last.clone_from(&x);
        for i in 0..12 {
            x[i] += delta[i] - (k * elastic[i] + z * viscous[i]) / mass;
        }
    }
    // x[n+1] = (2-κ-ζ) x[n] - (1-ζ) x[n-1], solved for κ and ζ from four samples.
    let (a, b, c, d) = (heard[0], heard[1], heard[2], heard[3]);
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

fn form(count: usize, spread: Spread, place: Place) -> BankForm {
    BankForm {
        count,
        f: (20.0, 10_000.0),
        t60: (0.5, 8.0),
        spread,
        place,
    }
}

#[test]
fn an_even_bank_runs_from_low_and_long_to_high_and_short() {
    let never = |_| unreachable!("nothing is drawn");
    let bank = bank(&form(3, Spread::Even, Place::Line), never).expect("bank");
    let of = |member: &BankCell| (member.f, member.t60);
    assert_eq!((of(&bank[0]), of(&bank[2])), ((20.0, 8.0), (10_000.0, 0.5)));
    assert!(close(bank[1].f, (20.0f64 * 10_000.0).sqrt(), 1e-14) && close(bank[1].t60, 2.0, 1e-14));
    assert_eq!(bank[1].position, [0.0, 0.0]);
}

#[test]
fn a_spiral_fills_the_disc_evenly() {
    let bank = bank(&form(1_000, Spread::Random, Place::Spiral), |i| {
        (0.5, i as f64 / 1e3)
    })
    .expect("bank");
    let radius = |cell: &BankCell| {
        let [x, y] = cell.position;
        (x * x + y * y).sqrt()
    };
    assert!(bank.iter().all(|cell| radius(cell) < 0.5));
    let inner = bank.iter().filter(|cell| radius(cell) < 0.25).count();
    assert_eq!(inner, 250, "a quarter of the area");
    let upper = bank.iter().filter(|cell| cell.position[1] > 0.0).count();
    assert!((490..=510).contains(&upper), "{upper}");
}

#[test]
fn bad_banks_are_refused() {
    let refused = |form: BankForm| bank(&form, |_| (0.5, 0.5)).is_err();
    let good = form(5, Spread::Even, Place::Line);
    assert!(!refused(good));
    assert!(refused(BankForm { count: 0, ..good }));
    assert!(refused(BankForm {
        count: 2_000_001,
        ..good
    }));
    assert!(refused(BankForm {
        f: (30.0, 20.0),
        ..good
    }));
    assert!(refused(BankForm {
        t60: (0.0, 20.0),
        ..good
    }));
    assert!(refused(BankForm {
        f: (20.0, f64::INFINITY),
        ..good
    }));
}

proptest! {
    #[test]
    fn drawn_members_lie_within(u in 0.0..1.0f64, w in 0.0..1.0f64) {
        let bank = bank(&form(2, Spread::Random, Place::Line), |_| (u, w)).expect("bank");
        for member in bank {
            prop_assert!((20.0..=10_000.0).contains(&member.f));
            prop_assert!((0.5..=8.0).contains(&member.t60));
            prop_assert!(close(crate::maths::log(member.f / 20.0), u * crate::maths::log(500.0), 1e-9));
        }
    }

    // Runs and their slices do what the links one by one do.
    #[test]
    fn apply_is_the_dense_matrix(seed in 0..1_000u32, fixed in any::<bool>()) {
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

// Every partial that the masses hold, against dense eigenvalues of the links that were made.
#[test]
fn partials_of_a_stiff_string_are_in_tune() {
    for ends in [Ends::Fixed, Ends::Free, Ends::Left] {
        for masses in [30, 60, 101] {
            for b in [0.0, 1e-4, 3e-4, 1e-3] {
                let string = stiff_string(masses, ends, b).expect("string");
                let mut values: Vec<f64> = dense(&string)
                    .symmetric_eigenvalues()
                    .iter()
                    .copied()
                    .collect();
                values.sort_by(f64::total_cmp);
                values.drain(..usize::from(string.is_rigid()));
                assert!(close(string.lowest().expect("mode"), values[0], 1e-9));
                for (i, value) in values.iter().enumerate().take(20) {
                    let n = (i + 1 + i * usize::from(ends == Ends::Left)) as f64;
                    let wanted = n * ((1.0 + b * n * n) / (1.0 + b)).sqrt();
                    let ratio = (value / values[0]).sqrt() / wanted;
                    let cents = 1200.0 * log(ratio) / std::f64::consts::LN_2;
                    assert!(
                        cents.abs() < 1.0,
                        "{masses} {ends:?} {b}: partial {n}, {cents}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_stiff_string_that_cannot_be_is_refused() {
    let sentence = |masses, b| {
        let error = stiff_string(masses, Ends::Fixed, b).expect_err("refused");
        error.to_string()
    };
    assert!(sentence(0, 1e-4).contains("`masses`"));
    assert!(sentence(60, -1e-4).contains("`inharmonicity`"));
    assert!(sentence(60, f64::NAN).contains("`inharmonicity`"));
    assert!(sentence(5_001, 1e-4).contains("5000"));
    let coarse = sentence(20, 1e-3);
    let enough: usize = coarse
        .split_whitespace()
        .filter_map(|word| word.parse().ok())
        .next_back()
        .expect("a number");
    assert!(stiff_string(enough, Ends::Fixed, 1e-3).is_ok(), "{coarse}");
}

/// Bending is no stretching: it does not harden.
#[test]
fn only_links_between_neighbours_harden() {
    let string = stiff_string(40, Ends::Fixed, 5e-4).expect("string");
    let hard: usize = string
        .runs
        .iter()
        .filter(|run| run.hardens)
        .map(|run| run.len)
        .sum();
    assert_eq!(hard, 41);
    assert!(string.runs.iter().any(|run| run.factor < 0.0));
}

/// Eigenvalues of a body's M⁻¹K, rising.
fn spectrum_of(body: &Topology) -> Vec<f64> {
    let mut matrix = dense(body);
    for ((i, j), value) in (0..body.n_mat)
        .flat_map(|j| (0..body.n_mat).map(move |i| (i, j)))
        .zip(matrix.iter_mut())
    {
        *value /= (body.share(i) * body.share(j)).sqrt();
    }
    let mut values: Vec<f64> = matrix.symmetric_eigenvalues().iter().copied().collect();
    values.sort_by(f64::total_cmp);
    values
}

// Leissa, Vibration of Plates (NASA SP-160, 1969): λ² of free and of simply supported plates.
#[test]
fn plates_that_bend_have_the_ratios_of_thin_plates() {
    let rectangle = Shape::Rectangle { across: 17, up: 17 };
    let cases = [
        // A free disc, ν = 0.33: (2, 0) twice, (0, 1), (3, 0) twice.
        (
            Shape::Disc,
            12,
            Rim::Free,
            0.33,
            vec![5.253, 5.253, 9.084, 12.23, 12.23],
            0.02,
        ),
        // A disc held at its rim, ν = 0.3.
        (
            Shape::Disc,
            12,
            Rim::Fixed,
            0.3,
            vec![4.977, 13.94, 13.94, 25.65, 25.65, 29.76],
            0.02,
        ),
        // A free square, ν = 0.3.
        (
            rectangle,
            0,
            Rim::Free,
            0.3,
            vec![13.489, 19.789, 24.432, 35.024, 35.024],
            0.03,
        ),
    ];
    for (shape, radius, rim, poisson, wanted, within) in cases {
        let plate = bent_plate(shape, radius, rim, poisson).expect("plate");
        let values = spectrum_of(&plate);
        let rigid = if rim == Rim::Free { 3 } else { 0 };
        for value in &values[..rigid] {
            assert!(value.abs() < 1e-9 * values[values.len() - 1], "{value}");
        }
        let lowest = plate.lowest().expect("mode");
        assert!(
            close(lowest, values[rigid], 1e-6),
            "{lowest} {}",
            values[rigid]
        );
        for (value, wanted_one) in values[rigid..].iter().zip(&wanted) {
            let ratio = (value / values[rigid]).sqrt() / (wanted_one / wanted[0]);
            assert!(
                (ratio - 1.0).abs() < within,
                "{shape:?} {rim:?}: {wanted_one} {ratio}"
            );
        }
    }
}

/// ω of a simply supported rectangle is proportional to (m/a)² + (n/b)².
#[test]
fn a_held_rectangle_has_the_closed_form() {
    let (across, up) = (39, 24);
    let plate = bent_plate(Shape::Rectangle { across, up }, 0, Rim::Fixed, 0.3).expect("plate");
    let values = spectrum_of(&plate);
    let side = |m: usize, masses: usize| {
        let part = m as f64 / (masses + 1) as f64;
        part * part
    };
    let mut wanted: Vec<f64> = (1..9)
        .flat_map(|m| (1..9).map(move |n| side(m, across) + side(n, up)))
        .collect();
    wanted.sort_by(f64::total_cmp);
    assert!(close(plate.lowest().expect("mode"), values[0], 1e-9));
    for (value, wanted_one) in values.iter().zip(&wanted).take(10) {
        let ratio = (value / values[0]).sqrt() / (wanted_one / wanted[0]);
        assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
    }
}

#[test]
fn a_rectangle_of_a_squares_sides_is_the_square() {
    for rim in [Rim::Free, Rim::Fixed] {
        let square = plate(Shape::Square, 4, rim).expect("square");
        let same = plate(Shape::Rectangle { across: 9, up: 9 }, 0, rim).expect("rectangle");
        assert_eq!(square.lowest(), same.lowest());
        for (one, two) in spectrum_of(&square).iter().zip(spectrum_of(&same)) {
            assert!((one - two).abs() < 1e-12, "{one} {two}");
        }
        assert_eq!(links(&same), neighbours(&same, distance(&same, (0, 1))));
        assert_eq!(same.positions[same.centre], [0.0, 0.0]);
    }
}

#[test]
fn plates_that_cannot_bend_are_refused() {
    let refused = |shape, radius, poisson| {
        let error = bent_plate(shape, radius, Rim::Free, poisson).expect_err("refused");
        error.to_string()
    };
    assert!(refused(Shape::Disc, 2, 0.3).contains("`radius`"));
    assert!(refused(Shape::Hex, 61, 0.3).contains("`radius`"));
    assert!(refused(Shape::Disc, 5, 0.6).contains("`poisson`"));
    assert!(refused(Shape::Rectangle { across: 9, up: 2 }, 0, 0.3).contains("`sides`"));
    let flat = plate(Shape::Disc, 5, Rim::Free).expect_err("refused");
    assert!(flat.to_string().contains("bending"));
}

/// The decay of every mode of a body, by its own matrices: (f [Hz], t60 [s]).
fn decays(body: &Topology, losses: &Losses, mass: f64) -> Vec<(f64, f64)> {
    let n = body.n_mat;
    let root = |i: usize| (mass * body.share(i)).sqrt();
    let scaled = |matrix: nalgebra::DMatrix<f64>| {
        nalgebra::DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] / (root(i) * root(j)))
    };
    let dampers = Topology {
        runs: losses.dampers.clone(),
        ..body.clone()
    };
    let mut viscous = dense(body) * losses.tuned.z + dense(&dampers);
    for i in 0..n {
        viscous[(i, i)] += losses.ground * body.share(i);
    }
    let (stiff, viscous) = (scaled(dense(body) * losses.tuned.k), scaled(viscous));
    let apart = &stiff * &viscous - &viscous * &stiff;
    assert!(
        apart.norm() <= 1e-10 * stiff.norm() * viscous.norm(),
        "modes are shared"
    );
    let eigen = stiff.symmetric_eigen();
    let mut found: Vec<(f64, f64)> = (0..n)
        .map(|mode| {
            let shape = eigen.eigenvectors.column(mode);
            let sigma = 0.5 * shape.dot(&(&viscous * shape));
            let whole = eigen.eigenvalues[mode];
            // A mode that creeps keeps its place.
            let squared = if whole > sigma * sigma {
                whole - sigma * sigma
            } else {
                whole
            };
            (squared.max(0.0).sqrt() / TAU, 3.0 * LN_10 / sigma)
        })
        .collect();
    found.sort_by(|one, two| one.0.total_cmp(&two.0));
    found
}

/// Of a mode there, or between the two modes around it, straight in logarithms.
fn decay_at(modes: &[(f64, f64)], f: f64) -> f64 {
    if let Some(own) = modes.iter().find(|mode| (mode.0 / f - 1.0).abs() < 1e-6) {
        return own.1;
    }
    let above = modes
        .partition_point(|mode| mode.0 < f)
        .clamp(1, modes.len() - 1);
    let ((f1, t1), (f2, t2)) = (modes[above - 1], modes[above]);
    let part = log(f / f1) / log(f2 / f1);
    t1 * exp(part * log(t2 / t1))
}

#[test]
fn decays_at_named_pitches() {
    let two = [(100.0, 8.0), (4_000.0, 1.0)];
    // As air and a soundboard take from a string: less than the square of the pitch.
    let four = [(110.0, 12.0), (500.0, 8.0), (1_500.0, 4.0), (4_000.0, 1.0)];
    let steep = [(110.0, 8.0), (440.0, 0.2)];
    let bodies = [
        string(60, Ends::Fixed, 0.0),
        stiff_string(60, Ends::Fixed, 3e-4),
        string(60, Ends::Free, 0.0),
        stiff_string(60, Ends::Left, 1e-4),
    ];
    for body in bodies {
        let body = body.expect("body");
        for points in [two.as_slice(), &four, &steep] {
            let losses = tune_points(&body, 1e-4, 110.0, points, None).expect("losses");
            let modes = decays(&body, &losses, 1e-4);
            let lowest = modes[usize::from(body.is_rigid())];
            assert!(close(lowest.0, 110.0, 1e-6), "{lowest:?}");
            for &(f, t60) in points {
                let own = decay_at(&modes, f);
                // Where no mode lies, the chord between two of them leaves the curve.
                let is_mode = modes.iter().any(|mode| (mode.0 / f - 1.0).abs() < 1e-3);
                let within = if is_mode { 0.01 } else { 0.03 };
                assert!((own / t60 - 1.0).abs() < within, "{points:?}: {own} at {f}");
            }
            assert!(modes.iter().all(|mode| mode.1 > 0.0));
        }
    }
    for body in [
        plate(Shape::Hex, 5, Rim::Free),
        bent_plate(Shape::Disc, 6, Rim::Free, 0.3),
    ] {
        let body = body.expect("body");
        for points in [
            vec![(100.0, 8.0), (400.0, 1.0)],
            vec![(100.0, 8.0), (250.0, 5.0), (400.0, 3.0)],
        ] {
            let losses = tune_points(&body, 1e-3, 100.0, &points, None).expect("losses");
            let modes = decays(&body, &losses, 1e-3);
            for &(f, t60) in &points {
                let own = decay_at(&modes, f);
                assert!((own / t60 - 1.0).abs() < 0.03, "{points:?}: {own} at {f}");
            }
        }
    }
}

#[test]
fn decays_that_no_damper_gives_are_refused() {
    let string = string(20, Ends::Fixed, 0.0).expect("string");
    let sentence = |points: &[(f64, f64)]| {
        let error = tune_points(&string, 1e-4, 110.0, points, None).expect_err("refused");
        error.to_string()
    };
    assert!(sentence(&[(110.0, 1.0)]).contains("2"));
    assert!(sentence(&[(110.0, 1.0), (110.0, 2.0)]).contains("above the one before"));
    assert!(sentence(&[(110.0, 1.0), (220.0, -2.0)]).contains("t60"));
    let comb: Vec<(f64, f64)> = (1..12)
        .map(|i| (110.0 * f64::from(i), if i % 2 == 0 { 9.0 } else { 0.1 }))
        .collect();
    assert!(sentence(&comb).contains("nearest"), "{}", sentence(&comb));
}
