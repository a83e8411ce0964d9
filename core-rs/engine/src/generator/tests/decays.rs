use super::*;

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
    let mut result: Vec<(f64, f64)> = (0..n)
        .map(|mode| {
            let shape = eigen.eigenvectors.column(mode);
            let sigma = 0.5 * shape.dot(&(&viscous * shape));
            let complete = eigen.eigenvalues[mode];
            // An overdamped mode is listed at its undamped frequency.
            let squared = if complete > sigma * sigma {
                complete - sigma * sigma
            } else {
                complete
            };
            (squared.max(0.0).sqrt() / TAU, 3.0 * LN_10 / sigma)
        })
        .collect();
    result.sort_by(|one, two| one.0.total_cmp(&two.0));
    result
}

/// The decay of a mode at `f`, or between the two modes around it, straight in logarithms.
fn decay_at(modes: &[(f64, f64)], f: f64) -> f64 {
    if let Some(single) = modes.iter().find(|mode| (mode.0 / f - 1.0).abs() < 1e-6) {
        return single.1;
    }
    let above = modes
        .partition_point(|mode| mode.0 < f)
        .clamp(1, modes.len() - 1);
    let ((f1, t1), (f2, t2)) = (modes[above - 1], modes[above]);
    let part = log(f / f1) / log(f2 / f1);
    t1 * exp(part * log(t2 / t1))
}

#[test]
fn tune_points_at_named_pitches() {
    let two = [(100.0, 8.0), (4_000.0, 1.0)];
    // As air and a soundboard damp a string: loss rises by less than the square of the pitch.
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
                let single = decay_at(&modes, f);
                // Where no mode lies, the chord between two modes deviates from the curve.
                let is_mode = modes.iter().any(|mode| (mode.0 / f - 1.0).abs() < 1e-3);
                let within = if is_mode { 0.01 } else { 0.03 };
                assert!(
                    (single / t60 - 1.0).abs() < within,
                    "{points:?}: {single} at {f}"
                );
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
                let single = decay_at(&modes, f);
                assert!(
                    (single / t60 - 1.0).abs() < 0.03,
                    "{points:?}: {single} at {f}"
                );
            }
        }
    }
}

#[test]
fn tune_points_of_impossible_decays_are_refused() {
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
