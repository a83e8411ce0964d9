use super::*;

// Every partial that the masses hold, against dense eigenvalues of the links that were made.
#[test]
fn stiff_string_partials_are_in_tune() {
    for ends in [Ends::Fixed, Ends::Free, Ends::Left] {
        for masses in [30, 60, 101] {
            for b in [0.0, 1e-4, 3e-4, 1e-3] {
                let bent_string = stiff_string(masses, ends, b).expect("string");
                let mut eigenvalues: Vec<f64> = dense(&bent_string).symmetric_eigenvalues().iter().copied().collect();
                eigenvalues.sort_by(f64::total_cmp);
                eigenvalues.drain(..usize::from(bent_string.is_rigid()));
                assert!(close(bent_string.lowest_lambda().expect("mode"), eigenvalues[0], 1e-9));
                for (i, value) in eigenvalues.iter().enumerate().take(20) {
                    let partial_number = (i + 1 + i * usize::from(ends == Ends::Left)) as f64;
                    let exact_ratio = partial_number * ((1.0 + b * partial_number * partial_number) / (1.0 + b)).sqrt();
                    let tuning_ratio = (value / eigenvalues[0]).sqrt() / exact_ratio;
                    let cents_off = 1200.0 * log(tuning_ratio) / std::f64::consts::LN_2;
                    assert!(
                        cents_off.abs() < 1.0,
                        "{masses} {ends:?} {b}: partial {partial_number}, {cents_off}"
                    );
                }
            }
        }
    }
}

#[test]
fn stiff_string_with_impossible_values_is_refused() {
    let sentence = |masses, b| {
        let refusal = stiff_string(masses, Ends::Fixed, b).expect_err("refused");
        refusal.to_string()
    };
    assert!(sentence(0, 1e-4).contains("`masses`"));
    assert!(sentence(60, -1e-4).contains("`inharmonicity`"));
    assert!(sentence(60, f64::NAN).contains("`inharmonicity`"));
    assert!(sentence(5_001, 1e-4).contains("5000"));
    let coarse_message = sentence(20, 1e-3);
    let enough_masses: usize = coarse_message
        .split_whitespace()
        .filter_map(|word| word.parse().ok())
        .next_back()
        .expect("a number");
    assert!(
        stiff_string(enough_masses, Ends::Fixed, 1e-3).is_ok(),
        "{coarse_message}"
    );
}

/// Bending is not stretching, so it does not harden.
#[test]
fn stiff_string_hardens_between_neighbours_only() {
    let bent_string = stiff_string(40, Ends::Fixed, 5e-4).expect("string");
    let hard_links: usize = bent_string
        .runs
        .iter()
        .filter(|run| run.hardens)
        .map(|run| run.len)
        .sum();
    assert_eq!(hard_links, 41);
    assert!(bent_string.runs.iter().any(|run| run.factor < 0.0));
}

/// Eigenvalues of a body's M⁻¹K, rising.
fn spectrum_of(body: &Topology) -> Vec<f64> {
    let mut scaled_matrix = dense(body);
    for ((i, j), value) in (0..body.n_mat)
        .flat_map(|j| (0..body.n_mat).map(move |i| (i, j)))
        .zip(scaled_matrix.iter_mut())
    {
        *value /= (body.mass_share(i) * body.mass_share(j)).sqrt();
    }
    let mut eigenvalues: Vec<f64> = scaled_matrix.symmetric_eigenvalues().iter().copied().collect();
    eigenvalues.sort_by(f64::total_cmp);
    eigenvalues
}

// Leissa, Vibration of Plates (NASA SP-160, 1969): λ² of free and of simply supported plates.
#[test]
fn bending_plates_have_ratios_of_thin_plates() {
    let rectangle = Shape::Rectangle { across: 17, up: 17 };
    let plate_cases = [
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
    for (shape, radius, rim, poisson, wanted, within) in plate_cases {
        let tested_plate = bent_plate(shape, radius, rim, poisson).expect("plate");
        let eigenvalues = spectrum_of(&tested_plate);
        let rigid_modes = if rim == Rim::Free { 3 } else { 0 };
        for value in &eigenvalues[..rigid_modes] {
            assert!(value.abs() < 1e-9 * eigenvalues[eigenvalues.len() - 1], "{value}");
        }
        let lowest_lambda = tested_plate.lowest_lambda().expect("mode");
        assert!(
            close(lowest_lambda, eigenvalues[rigid_modes], 1e-6),
            "{lowest_lambda} {}",
            eigenvalues[rigid_modes]
        );
        for (value, wanted_one) in eigenvalues[rigid_modes..].iter().zip(&wanted) {
            let relative_ratio = (value / eigenvalues[rigid_modes]).sqrt() / (wanted_one / wanted[0]);
            assert!(
                (relative_ratio - 1.0).abs() < within,
                "{shape:?} {rim:?}: {wanted_one} {relative_ratio}"
            );
        }
    }
}

/// ω of a simply supported rectangle is proportional to (m/a)² + (n/b)².
#[test]
fn supported_rectangle_matches_closed_form() {
    let (across, up) = (39, 24);
    let tested_plate = bent_plate(Shape::Rectangle { across, up }, 0, Rim::Fixed, 0.3).expect("plate");
    let eigenvalues = spectrum_of(&tested_plate);
    let side_term = |m: usize, masses: usize| {
        let side_fraction = m as f64 / (masses + 1) as f64;
        side_fraction * side_fraction
    };
    let mut closed_form: Vec<f64> = (1..9)
        .flat_map(|m| (1..9).map(move |n| side_term(m, across) + side_term(n, up)))
        .collect();
    closed_form.sort_by(f64::total_cmp);
    assert!(close(tested_plate.lowest_lambda().expect("mode"), eigenvalues[0], 1e-9));
    for (value, wanted_one) in eigenvalues.iter().zip(&closed_form).take(10) {
        let relative_ratio = (value / eigenvalues[0]).sqrt() / (wanted_one / closed_form[0]);
        assert!((relative_ratio - 1.0).abs() < 0.02, "{relative_ratio}");
    }
}

#[test]
fn rectangle_with_equal_sides_is_the_square_plate() {
    for rim in [Rim::Free, Rim::Fixed] {
        let square_plate = plate(Shape::Square, 4, rim).expect("square");
        let equal_rectangle = plate(Shape::Rectangle { across: 9, up: 9 }, 0, rim).expect("rectangle");
        assert_eq!(square_plate.lowest_lambda(), equal_rectangle.lowest_lambda());
        for (one, two) in spectrum_of(&square_plate).iter().zip(spectrum_of(&equal_rectangle)) {
            assert!((one - two).abs() < 1e-12, "{one} {two}");
        }
        assert_eq!(
            links(&equal_rectangle),
            neighbours(&equal_rectangle, distance(&equal_rectangle, (0, 1)))
        );
        assert_eq!(equal_rectangle.positions[equal_rectangle.centre], [0.0, 0.0]);
    }
}

#[test]
fn bending_plates_with_impossible_values_are_refused() {
    let refused = |shape, radius, poisson| {
        let refusal = bent_plate(shape, radius, Rim::Free, poisson).expect_err("refused");
        refusal.to_string()
    };
    assert!(refused(Shape::Disc, 2, 0.3).contains("`radius`"));
    assert!(refused(Shape::Hex, 61, 0.3).contains("`radius`"));
    assert!(refused(Shape::Disc, 5, 0.6).contains("`poisson`"));
    assert!(refused(Shape::Rectangle { across: 9, up: 2 }, 0, 0.3).contains("`sides`"));
    let ring_refusal = plate(Shape::Disc, 5, Rim::Free).expect_err("refused");
    assert!(ring_refusal.to_string().contains("rings"));
}

#[test]
fn round_membrane_modes_match_bessel_zeros() {
    let membrane = round_membrane(12, Rim::Fixed).expect("membrane");
    assert_eq!((membrane.n_mat, membrane.n_fixed), (397, 72));
    assert!(membrane.runs.iter().all(|run| run.factor > 0.0));
    // In coordinates √M·x.
    let mut scaled_matrix = dense(&membrane);
    for (i, j) in (0..397).flat_map(|i| (0..397).map(move |j| (i, j))) {
        scaled_matrix[(i, j)] /= (membrane.mass_share(i) * membrane.mass_share(j)).sqrt();
    }
    let mut eigenvalues: Vec<f64> = scaled_matrix.symmetric_eigenvalues().iter().copied().collect();
    eigenvalues.sort_by(f64::total_cmp);
    let bessel_zeros = [2.404_826, 3.831_706, 3.831_706, 5.135_622, 5.135_622, 5.520_078];
    for (value, zero) in eigenvalues.iter().zip(bessel_zeros) {
        assert!(
            close((value / eigenvalues[0]).sqrt(), zero / bessel_zeros[0], 0.01),
            "{value} {zero}"
        );
    }
    assert!(close(membrane.lowest_lambda().expect("mode"), eigenvalues[0], 1e-10));
    assert!(round_membrane(1, Rim::Free).is_err());
}
