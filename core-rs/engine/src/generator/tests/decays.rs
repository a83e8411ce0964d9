use super::*;

/// The decay of every mode of a body, by its own matrices: (f [Hz], t60 [s]).
fn decays(body: &Topology, losses: &Losses, mass: f64) -> Vec<(f64, f64)> {
    let n_masses = body.n_mat;
    let mass_root = |i: usize| (mass * body.mass_share(i)).sqrt();
    let mass_scaled = |matrix: nalgebra::DMatrix<f64>| {
        nalgebra::DMatrix::from_fn(n_masses, n_masses, |i, j| {
            matrix[(i, j)] / (mass_root(i) * mass_root(j))
        })
    };
    let dampers = Topology {
        runs: losses.dampers.clone(),
        ..body.clone()
    };
    let mut viscous = dense(body) * losses.tuned.z + dense(&dampers);
    for i in 0..n_masses {
        viscous[(i, i)] += losses.ground * body.mass_share(i);
    }
    let (scaled_stiffness, viscous) = (mass_scaled(dense(body) * losses.tuned.k), mass_scaled(viscous));
    let commutator = &scaled_stiffness * &viscous - &viscous * &scaled_stiffness;
    assert!(
        commutator.norm() <= 1e-10 * scaled_stiffness.norm() * viscous.norm(),
        "modes are shared"
    );
    let eigen_system = scaled_stiffness.symmetric_eigen();
    let mut mode_decays: Vec<(f64, f64)> = (0..n_masses)
        .map(|mode| {
            let mode_shape = eigen_system.eigenvectors.column(mode);
            let sigma = 0.5 * mode_shape.dot(&(&viscous * mode_shape));
            let complete = eigen_system.eigenvalues[mode];
            // An overdamped mode is listed at its undamped frequency.
            let squared = if complete > sigma * sigma {
                complete - sigma * sigma
            } else {
                complete
            };
            (squared.max(0.0).sqrt() / TAU, 3.0 * LN_10 / sigma)
        })
        .collect();
    mode_decays.sort_by(|one, two| one.0.total_cmp(&two.0));
    mode_decays
}

/// The decay of a mode at `f`, or between the two modes around it, straight in logarithms.
fn decay_at(modes: &[(f64, f64)], f: f64) -> f64 {
    if let Some(exact_mode) = modes.iter().find(|mode| (mode.0 / f - 1.0).abs() < 1e-6) {
        return exact_mode.1;
    }
    let upper_index = modes.partition_point(|mode| mode.0 < f).clamp(1, modes.len() - 1);
    let ((f1, t1), (f2, t2)) = (modes[upper_index - 1], modes[upper_index]);
    let log_fraction = log(f / f1) / log(f2 / f1);
    t1 * exp(log_fraction * log(t2 / t1))
}

#[test]
fn tune_points_at_named_pitches() {
    let two_points = [(100.0, 8.0), (4_000.0, 1.0)];
    // As air and a soundboard damp a string: loss rises by less than the square of the pitch.
    let four_points = [(110.0, 12.0), (500.0, 8.0), (1_500.0, 4.0), (4_000.0, 1.0)];
    let steep_points = [(110.0, 8.0), (440.0, 0.2)];
    let test_bodies = [
        string(60, Ends::Fixed, 0.0),
        stiff_string(60, Ends::Fixed, 3e-4),
        string(60, Ends::Free, 0.0),
        stiff_string(60, Ends::Left, 1e-4),
    ];
    for tested_body in test_bodies {
        let tested_body = tested_body.expect("body");
        for points in [two_points.as_slice(), &four_points, &steep_points] {
            let tuned_losses = tune_points(&tested_body, 1e-4, 110.0, points, None).expect("losses");
            let body_modes = decays(&tested_body, &tuned_losses, 1e-4);
            let lowest_mode = body_modes[usize::from(tested_body.is_rigid())];
            assert!(close(lowest_mode.0, 110.0, 1e-6), "{lowest_mode:?}");
            for &(f, t60) in points {
                let mode_decay = decay_at(&body_modes, f);
                // Where no mode lies, the chord between two modes deviates from the curve.
                let has_mode = body_modes.iter().any(|mode| (mode.0 / f - 1.0).abs() < 1e-3);
                let tolerance = if has_mode { 0.01 } else { 0.03 };
                assert!(
                    (mode_decay / t60 - 1.0).abs() < tolerance,
                    "{points:?}: {mode_decay} at {f}"
                );
            }
            assert!(body_modes.iter().all(|mode| mode.1 > 0.0));
        }
    }
    for tested_body in [
        plate(Shape::Hex, 5, Rim::Free),
        bent_plate(Shape::Disc, 6, Rim::Free, 0.3),
    ] {
        let tested_body = tested_body.expect("body");
        for points in [
            vec![(100.0, 8.0), (400.0, 1.0)],
            vec![(100.0, 8.0), (250.0, 5.0), (400.0, 3.0)],
        ] {
            let tuned_losses = tune_points(&tested_body, 1e-3, 100.0, &points, None).expect("losses");
            let body_modes = decays(&tested_body, &tuned_losses, 1e-3);
            for &(f, t60) in &points {
                let mode_decay = decay_at(&body_modes, f);
                assert!((mode_decay / t60 - 1.0).abs() < 0.03, "{points:?}: {mode_decay} at {f}");
            }
        }
    }
}

#[test]
fn tune_points_of_impossible_decays_are_refused() {
    let string = string(20, Ends::Fixed, 0.0).expect("string");
    let sentence = |points: &[(f64, f64)]| {
        let refusal = tune_points(&string, 1e-4, 110.0, points, None).expect_err("refused");
        refusal.to_string()
    };
    assert!(sentence(&[(110.0, 1.0)]).contains("2"));
    assert!(sentence(&[(110.0, 1.0), (110.0, 2.0)]).contains("above the one before"));
    assert!(sentence(&[(110.0, 1.0), (220.0, -2.0)]).contains("t60"));
    let comb_points: Vec<(f64, f64)> = (1..12)
        .map(|i| (110.0 * f64::from(i), if i % 2 == 0 { 9.0 } else { 0.1 }))
        .collect();
    assert!(sentence(&comb_points).contains("nearest"), "{}", sentence(&comb_points));
}
