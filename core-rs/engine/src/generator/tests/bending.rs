use super::*;

// Every partial that the masses hold, against dense eigenvalues of the links that were made.
#[test]
fn stiff_string_partials_are_in_tune() {
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
fn stiff_string_with_impossible_values_is_refused() {
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

/// Bending is not stretching, so it does not harden.
#[test]
fn stiff_string_hardens_between_neighbours_only() {
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
fn bending_plates_have_ratios_of_thin_plates() {
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
fn supported_rectangle_matches_closed_form() {
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
fn rectangle_with_equal_sides_is_the_square_plate() {
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
fn bending_plates_with_impossible_values_are_refused() {
    let refused = |shape, radius, poisson| {
        let error = bent_plate(shape, radius, Rim::Free, poisson).expect_err("refused");
        error.to_string()
    };
    assert!(refused(Shape::Disc, 2, 0.3).contains("`radius`"));
    assert!(refused(Shape::Hex, 61, 0.3).contains("`radius`"));
    assert!(refused(Shape::Disc, 5, 0.6).contains("`poisson`"));
    assert!(refused(Shape::Rectangle { across: 9, up: 2 }, 0, 0.3).contains("`sides`"));
    let flat = plate(Shape::Disc, 5, Rim::Free).expect_err("refused");
    assert!(flat.to_string().contains("rings"));
}

#[test]
fn round_membrane_modes_match_bessel_zeros() {
    let disc = round_membrane(12, Rim::Fixed).expect("membrane");
    assert_eq!((disc.n_mat, disc.n_fixed), (397, 72));
    assert!(disc.runs.iter().all(|run| run.factor > 0.0));
    // In coordinates √M·x.
    let mut matrix = dense(&disc);
    for (i, j) in (0..397).flat_map(|i| (0..397).map(move |j| (i, j))) {
        matrix[(i, j)] /= (disc.share(i) * disc.share(j)).sqrt();
    }
    let mut values: Vec<f64> = matrix.symmetric_eigenvalues().iter().copied().collect();
    values.sort_by(f64::total_cmp);
    let zeros = [
        2.404_826, 3.831_706, 3.831_706, 5.135_622, 5.135_622, 5.520_078,
    ];
    for (value, zero) in values.iter().zip(zeros) {
        assert!(
            close((value / values[0]).sqrt(), zero / zeros[0], 0.01),
            "{value} {zero}"
        );
    }
    assert!(close(disc.lowest().expect("mode"), values[0], 1e-10));
    assert!(round_membrane(1, Rim::Free).is_err());
}
