use super::*;
use proptest::prelude::*;

fn rate(hertz: f64) -> Rate {
    Rate::new(hertz).expect("rate")
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * b.abs()
}

type Matrix = [[f64; 2]; 2];

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
}

/// e^{At} by scaling and squaring a Taylor series, without any use of poles.
fn expm(a: &Matrix, t: f64) -> Matrix {
    let largest_entry = a.iter().flatten().map(|x| (x * t).abs()).fold(0.0, f64::max);
    let mut halvings = 0;
    let mut scaled_time = t;
    while largest_entry * (scaled_time / t) > 1e-2 {
        halvings += 1;
        scaled_time *= 0.5;
    }
    let scaled_matrix: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] * scaled_time));
    let mut exponential = [[1.0, 0.0], [0.0, 1.0]];
    let mut taylor_term = exponential;
    for n in 1..=12 {
        taylor_term = product(&taylor_term, &scaled_matrix);
        for row in &mut taylor_term {
            row.iter_mut().for_each(|x| *x /= f64::from(n));
        }
        for i in 0..2 {
            for j in 0..2 {
                exponential[i][j] += taylor_term[i][j];
            }
        }
    }
    (0..halvings).fold(exponential, |root, _| product(&root, &root))
}

/// Position and velocity after `t` of m ẍ + z ẋ + k x = 0.
fn flow(m: f64, k: f64, z: f64, t: f64, x: f64, v: f64) -> (f64, f64) {
    // Time is in units of |t|, so that one scale of the Taylor series serves all entries.
    let time_unit = t.abs();
    let exponential = expm(
        &[[0.0, 1.0], [-k / m * time_unit * time_unit, -z / m * time_unit]],
        t / time_unit,
    );
    (
        exponential[0][0] * x + exponential[0][1] * v * time_unit,
        exponential[1][0] * x / time_unit + exponential[1][1] * v,
    )
}

#[test]
fn released_cell_matches_matrix_exponential() {
    // Without loss, below, at and above critical damping, and without a spring.
    for (k, z) in [
        (4e6, 0.0),
        (4e6, 300.0),
        (1e6, 2e3),
        (1e6, 9e3),
        (0.0, 50.0),
        (0.0, 0.0),
    ] {
        let released_cell = Cell::new(2.0, 2.0 * k, 2.0 * z);
        for t in [0.0, 1e-5, 3e-4, 2e-3] {
            let exact_position = if t == 0.0 { 1.0 } else { flow(1.0, k, z, t, 1.0, 0.0).0 };
            let cell_position = released_cell.released(t);
            assert!(
                (cell_position - exact_position).abs() < 1e-12,
                "{k} {z} {t}: {cell_position} {exact_position}"
            );
        }
    }
}

// Reference values, computed by another program with more digits.
#[test]
fn ratios_match_reference_values() {
    let vectors = [
        (
            440.0,
            1.0,
            44_100.0,
            0.003_928_080_335_657_302,
            0.000_313_227_817_321_603_7,
        ),
        (
            440.0,
            1.0,
            4_410.0,
            0.379_699_981_290_506_4,
            0.003_127_866_834_002_217_7,
        ),
        (
            8.0,
            0.6,
            4_410.0,
            0.000_136_373_522_263_312_26,
            0.005_207_674_192_967_996,
        ),
        (
            5_000.0,
            0.3,
            44_100.0,
            0.486_128_721_658_317_94,
            0.001_043_711_232_153_786_8,
        ),
    ];
    for (f, t60, hertz, kappa, zeta) in vectors {
        let tuned_ratios = tune(f, Some(t60), rate(hertz));
        assert!(close(tuned_ratios.kappa, kappa, 1e-15), "{f}: {tuned_ratios:?}");
        assert!(close(tuned_ratios.zeta, zeta, 1e-15), "{f}: {tuned_ratios:?}");
    }
}

#[test]
fn split_matches_reference_values() {
    let [force_now, force_next] = Cell::tuned(1.0, 440.0, Some(1.0)).split(1.0, 0.3, rate(44_100.0));
    assert!(close(force_now, 30_856.709_804_9, 1e-12), "{force_now}");
    assert!(close(force_next, 13_225.697_835_1, 1e-12), "{force_next}");
}

#[test]
fn ratios_of_free_and_slowing_cells() {
    let rate = rate(1_000.0);
    let free_ratios = Cell::new(2.0, 0.0, 0.0).ratios(rate);
    assert_eq!(free_ratios, CellRatios { kappa: 0.0, zeta: 0.0 });
    let slowing = Cell::new(2.0, 0.0, 30.0).ratios(rate);
    assert_eq!(slowing.kappa, 0.0);
    assert!(close(slowing.zeta, -expm1(-0.015), 1e-15));
    assert_eq!(Cell::new(2.0, 8e5, 0.0).ratios(rate).zeta, 0.0);
    assert_eq!(
        CellRatios { kappa: 0.1, zeta: 0.0 }.pitch(rate).map(|p| p.1),
        Some(f64::INFINITY)
    );
    // No oscillation: critical damping, damping above it, or a K too large for the scheme.
    for (kappa, zeta) in [(0.0, 0.1), (0.001, 0.1), (4.5, 0.0)] {
        assert_eq!(CellRatios { kappa, zeta }.pitch(rate), None);
    }
    // A cell that loses all velocity in one step still starts from finite numbers.
    assert_eq!(Cell::new(1e-6, 1.0, 1e4).last_step(1.0, 2.0, 0.0, rate), 0.002);
    let tuned_cell = Cell::tuned(2.0, 3.0, Some(4.0));
    let rebuilt_cell = Cell::new(2.0, tuned_cell.stiffness(), tuned_cell.viscosity());
    assert!(close(
        rebuilt_cell.ratios(rate).kappa,
        tuned_cell.ratios(rate).kappa,
        1e-14
    ));
}

/// Mass, stiffness and viscosity of cells with any damping at 1 kHz, from ω₀T and the damping ratio.
fn cells() -> impl Strategy<Value = (f64, f64, f64)> {
    let damping_ratio = prop_oneof![Just(0.0), Just(1.0), 0.0..0.99f64, 0.99..1.01f64, 1.0..20.0f64];
    (0.01..10.0f64, prop_oneof![Just(0.0), 1e-3..0.5f64], damping_ratio).prop_map(|(m, angle, damping_ratio)| {
        let undamped_omega = angle * 1_000.0;
        (
            m,
            m * undamped_omega * undamped_omega,
            2.0 * m * damping_ratio * undamped_omega.max(1.0),
        )
    })
}

proptest! {
    // 20 Hz to 20 kHz: 1e-10 cents and 2e-16 in T60 were measured elsewhere.
    #[test]
    fn pitch_inverts_tune(f in 20.0..20_000.0f64, t60 in 0.01..10.0f64) {
        let rate = rate(44_100.0);
        let (f_again, t60_again) = tune(f, Some(t60), rate).pitch(rate).expect("complex poles");
        prop_assert!(close(f_again, f, 1e-12));
        prop_assert!(close(t60_again, t60, 1e-11));
    }

    // Started from its own backward step, the scheme runs through the continuous motion.
    #[test]
    fn scheme_follows_continuous_motion(
        (m, k, z) in cells(), x0 in -1.0..1.0f64, v0 in -300.0..300.0f64, rest in -1.0..1.0f64,
    ) {
        let rate = rate(1_000.0);
        let cell = Cell::new(m, k, z);
        let CellRatios { kappa, zeta } = cell.ratios(rate);
        let last = cell.last_step(x0, v0, rest, rate);
        let (before, _) = flow(m, k, z, -rate.step(), x0 - rest, v0);
        // What decays within one step is larger by the same factor one step before.
        let size = exp(z / m * rate.step()) * (1.0 + (x0 - rest).abs() + v0.abs() * rate.step());
        prop_assert!((x0 - last - rest - before).abs() <= 4e-12 * size, "{last} {before}");
        let (mut x, mut delta) = (x0 - rest, last);
        for n in 1..=20 {
            delta = delta - kappa * x - zeta * delta;
            x += delta;
            let (exact, _) = flow(m, k, z, f64::from(n) * rate.step(), x0 - rest, v0);
            prop_assert!((x - exact).abs() <= 4e-12 * size, "{n}: {x} {exact}");
        }
    }

    // An impulse between two samples, split over both, leaves no error afterwards.
    #[test]
    fn split_follows_continuous_impulse((m, k, z) in cells(), alpha in 0.0..1.0f64) {
        let rate = rate(1_000.0);
        let cell = Cell::new(m, k, z);
        let CellRatios { kappa, zeta } = cell.ratios(rate);
        let mass = m / rate.step() / rate.step();
        let forces = cell.split(0.7, alpha, rate);
        let (mut x, mut delta) = (0.0, 0.0);
        for n in 0..20 {
            delta = delta - kappa * x - zeta * delta + forces.get(n).unwrap_or(&0.0) / mass;
            x += delta;
            let t = (n as f64 + 1.0 - alpha) * rate.step();
            let (exact, _) = flow(m, k, z, t, 0.0, 0.7 / m);
            prop_assert!((x - exact).abs() <= 4e-12 * 0.7 / m * rate.step() * 20.0, "{n}: {x} {exact}");
        }
    }

    // Factors of the response, and weights of a step, are those of the functions that they replace.
    #[test]
    fn answer_factors_and_weights_of_a_step(
        (m, k, z) in cells(), from in 0.0..1.0f64, to in 0.0..1.0f64,
    ) {
        let rate = rate(1_000.0);
        let (cell, step) = (Cell::new(m, k, z), rate.step());
        let within = cell.within_step(from, rate, cell.response(step));
        prop_assert_eq!(within, (cell.interpolation(from, rate), cell.split(1.0, from, rate)));
        if cell.has_impulse_response_factors(step) {
            let [from, to] = [from, to].map(|instant| (instant - 0.5) * step);
            let ([_, earlier], [later, _]) = (cell.impulse_response_factors(from), cell.impulse_response_factors(to));
            let answer = later[0] * earlier[0] + later[1] * earlier[1];
            let size = cell.impulse_response_around(-step).abs().max(cell.impulse_response_around(step));
            prop_assert!((answer - cell.impulse_response_around(to - from)).abs() <= 1e-11 * size);
        }
    }
}

#[test]
fn resolvable_cells_at_multiples_of_half_the_rate() {
    let rate = rate(8_000.0);
    for (f, is_moved) in [(4_000.0, true), (12_000.0, true), (3_999.9, false), (1e-4, false)] {
        let cell = Cell::tuned(1.0, f, Some(0.1));
        let moved_cell = cell.resolvable_at(rate);
        assert_eq!(moved_cell != cell, is_moved, "{f} Hz");
        assert!((moved_cell.frequency() - f).abs() <= 2e-7 * rate.hertz());
        // From two samples of its free motion after an impulse: what it does in the middle between them.
        let (now, next) = (moved_cell.response(rate.step()), moved_cell.response(2.0 * rate.step()));
        let (by_now, by_next) = moved_cell.interpolation(0.5, rate);
        let exact = moved_cell.response(1.5 * rate.step());
        assert!(
            (by_now * now + by_next * next - exact).abs() <= 1e-8 * exact.abs(),
            "{f} Hz"
        );
    }
}
