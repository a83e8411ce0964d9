use proptest::prelude::*;

use super::*;
use crate::chance::Chance;
use crate::maths::sqrt;

const RATE: f64 = 44_100.0 / 44.0;
/// A sliding key of 380 g, with a mode of 20 g at 180 Hz.
const ROW: [f64; 13] = [
    0.38, 60.0, 1.2, 0.15, 0.05, -2.5e-3, 1.1e-3, 0.0, 0.0, 0.0, 0.02, 180.0, 0.02,
];

/// Strokes and random single ticks, as strong as a fader's motor.
fn forces(n: usize, seed: i128) -> Vec<f64> {
    let mut chance = Chance::new(seed, "test", "forces", 0, 0);
    let mut stroke_force = 0.0;
    (0..n)
        .map(|tick| {
            if tick % 150 == 0 {
                stroke_force = chance.uniform(-0.3, 0.3);
            }
            stroke_force + if chance.uniform(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 }
        })
        .collect()
}

fn path(row: &[f64], forces: &[f64], steps: usize) -> Vec<f64> {
    let key_model = KeyModel::from_row(row).unwrap();
    key_model.path(forces, RATE, Some(steps)).unwrap()
}

fn rms(x: impl Iterator<Item = f64>) -> f64 {
    let (mut square_sum, mut term_count) = (0.0, 0);
    for x in x {
        (square_sum, term_count) = (square_sum + x * x, term_count + 1);
    }
    sqrt(square_sum / f64::from(term_count))
}

fn differs(a: &[f64], b: &[f64]) -> f64 {
    rms(a.iter().zip(b).map(|(a, b)| a - b))
}

/// Largest relative difference of a column from central differences.
fn tangent_error(row: &[f64], forces: &[f64]) -> f64 {
    let columns: Vec<usize> = (0..row.len()).filter(|&i| row[i] != 0.0).collect();
    let key_model = KeyModel::from_row(row).unwrap();
    let (_, jacobian) = key_model.path_and_jacobian(forces, RATE, Some(44), &columns).unwrap();
    let relative_error = |column: usize, index: usize, by: f64| {
        let moved_path = |by: f64| {
            let mut row = row.to_vec();
            row[index] += by;
            path(&row, forces, 44)
        };
        let (path_above, path_below) = (moved_path(by), moved_path(-by));
        let differences = path_above.iter().zip(&path_below).map(|(a, b)| (a - b) / (2.0 * by));
        let differences: Vec<f64> = differences.collect();
        let jacobian_column: Vec<f64> = jacobian[column..].iter().step_by(columns.len()).copied().collect();
        differs(&jacobian_column, &differences) / rms(differences.into_iter())
    };
    // Wide differences include turns that appear or vanish, narrow ones suffer from rounding; one of the three is
    // accurate.
    let column_errors = columns.iter().enumerate().map(|(column, &index)| {
        let trial_errors = [1e-5, 1e-6, 1e-7].map(|by| relative_error(column, index, by * row[index].abs()));
        trial_errors.into_iter().fold(f64::INFINITY, f64::min)
    });
    column_errors.fold(0.0, f64::max)
}

#[test]
fn jacobian_of_key_path_equals_differences() {
    let forces = forces(3000, 1);
    let sliding = ROW;
    let (mut static_too, mut giving_way, mut both_frictions) = (ROW, ROW, ROW);
    static_too[8..10].copy_from_slice(&[0.08, 4e-3]);
    giving_way[7] = 5000.0;
    both_frictions[7..10].copy_from_slice(&[5000.0, 0.08, 4e-3]);
    for row in [sliding, static_too, giving_way, both_frictions] {
        let worst_error = tangent_error(&row, &forces);
        assert!(worst_error < 1e-5, "{row:?}: {worst_error:e}");
    }
}

#[test]
fn path_and_jacobian_returns_the_same_path() {
    let forces = forces(2000, 2);
    let key_model = KeyModel::from_row(&ROW).unwrap();
    let path_alone = key_model.path(&forces, RATE, None).unwrap();
    for columns in [vec![], vec![4], (0..13).collect()] {
        let (path, jacobian) = key_model.path_and_jacobian(&forces, RATE, None, &columns).unwrap();
        assert_eq!(path, path_alone);
        assert_eq!(jacobian.len(), forces.len() * columns.len());
    }
}

/// A key that slides with 50 mN of dry friction turns where its velocity is zero, and its path consists of parabolas.
#[test]
fn friction_turns_at_zero_velocity() {
    let (mass, dry) = (0.4, 0.05);
    // With this delay, forces change between two velocities, so that friction changes with them.
    let delay = |steps: usize| 0.5 / (RATE * steps as f64);
    let key_row = |steps| [mass, 0.0, 0.0, 0.0, dry, 0.0, delay(steps), 0.0, 0.0, 0.0];
    // 0.4 N for 50 ticks, then -0.3 N: the key goes on, stops and turns.
    let forces: Vec<f64> = (0..200).map(|n| if n < 50 { 0.4 } else { -0.3 }).collect();
    let (speeding_up, slowing_down, moving_back) = ((0.4 - dry) / mass, (0.3 + dry) / mass, (0.3 - dry) / mass);
    let push_duration = 50.0 / RATE;
    let turn_time = push_duration + speeding_up * push_duration / slowing_down;
    let top_position = 0.5 * speeding_up * push_duration * push_duration
        + 0.5 * slowing_down * (turn_time - push_duration) * (turn_time - push_duration);
    let exact_position = |n: usize, delay: f64| {
        let t = (n as f64 / RATE - delay).max(0.0);
        if t < push_duration {
            0.5 * speeding_up * t * t
        } else if t < turn_time {
            top_position - 0.5 * slowing_down * (turn_time - t) * (turn_time - t)
        } else {
            top_position - 0.5 * moving_back * (t - turn_time) * (t - turn_time)
        }
    };
    let path_error = |steps: usize| {
        let path = path(&key_row(steps), &forces, steps);
        let point_errors = path.iter().enumerate();
        let point_errors = point_errors.map(|(n, x)| x - exact_position(n, delay(steps)));
        point_errors.fold(0.0, |worst: f64, path_error| worst.max(path_error.abs()))
    };
    // Second order: sixteen times the steps leave a 256th of the error, wherever in its step the turn lies.
    let (coarse_error, fine_error) = (path_error(7), path_error(112));
    assert!(
        coarse_error < 2e-8 && fine_error < coarse_error / 150.0,
        "{coarse_error:e} {fine_error:e}"
    );
}

#[test]
fn key_path_is_of_second_order() {
    let forces = forces(1500, 4);
    let key_row = &[0.38, 60.0, 1.2, 0.15, 0.0, -2.5e-3, 1.1e-3, 0.0, 0.0, 0.0];
    let fine_path = path(key_row, &forces, 1760);
    let [coarse_error, finer_error] = [22, 88].map(|steps| differs(&path(key_row, &forces, steps), &fine_path));
    assert!(finer_error < coarse_error / 14.0, "{coarse_error:e} {finer_error:e}");
    // With modes and friction, the first-order error is small compared with a sensor's step of some micrometres.
    let fine_path = path(&ROW, &forces, 1760);
    let [coarse_error, finer_error] = [22, 88].map(|steps| differs(&path(&ROW, &forces, steps), &fine_path));
    assert!(
        coarse_error < 1e-7 && finer_error < coarse_error / 2.0,
        "{coarse_error:e} {finer_error:e}"
    );
}

#[test]
fn resting_key_stays_within_friction() {
    let key_row = [0.4, 60.0, 1.2, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0];
    let resting_path = path(&key_row, &[0.049; 500], 44);
    assert!(resting_path.iter().all(|&x| x == 0.0));
    assert!(path(&key_row, &[0.051; 500], 44)[499] > 0.0);
    // A contact that gives way moves by -F/σ ln(1 - f/F) under a force f that rises slowly.
    let mut yielding_row = key_row;
    yielding_row[7] = 5000.0;
    let rising_force: Vec<f64> = (0..4000).map(|n| 0.02 * f64::from(n) / 4000.0).collect();
    let end_position = path(&yielding_row, &rising_force, 44)[3999];
    assert!(
        (end_position / (-1e-5 * crate::maths::log(0.6)) - 1.0).abs() < 0.03,
        "{end_position:e}"
    );
}

#[test]
fn delay_shifts_the_key_path() {
    let forces = forces(500, 3);
    let (mut undelayed, mut delayed) = (ROW, ROW);
    (undelayed[6], delayed[6]) = (0.0, 3.0 / RATE);
    (undelayed[5], delayed[5]) = (-2.5e-3, -2.5e-3);
    let (undelayed, delayed) = (path(&undelayed, &forces, 44), path(&delayed, &forces, 44));
    assert!(differs(&undelayed[..497], &delayed[3..]) < 1e-12);
    assert_ne!(undelayed, delayed);
}

#[test]
fn key_models_with_wrong_rows_are_refused() {
    let model_with = |index: usize, value: f64| {
        let mut changed_row = ROW;
        changed_row[index] = value;
        KeyModel::from_row(&changed_row)
    };
    assert_eq!(KeyModel::from_row(&ROW[..9]), Err(KeyError::Count));
    assert_eq!(KeyModel::from_row(&ROW[..11]), Err(KeyError::Count));
    assert_eq!(model_with(0, 0.0), Err(KeyError::Mass));
    assert_eq!(model_with(11, 0.0), Err(KeyError::Mass));
    assert_eq!(model_with(1, f64::NAN), Err(KeyError::NotFinite));
    assert_eq!(model_with(4, -1e-9), Err(KeyError::Negative));
    assert_eq!(model_with(6, 2.0), Err(KeyError::Delay));
    let fast_key = model_with(11, 9000.0).unwrap();
    assert_eq!(fast_key.path(&[], RATE, Some(44)), Err(KeyError::Fast));
    assert_eq!(fast_key.path(&[], f64::NAN, None), Err(KeyError::Rate));
    assert_eq!(fast_key.path(&[], RATE, Some(0)), Err(KeyError::Steps));
    let wrong_column = fast_key.path_and_jacobian(&[], RATE, Some(400), &[13]);
    assert_eq!(wrong_column, Err(KeyError::Count));
}

proptest! {
    /// For any key and any forces, the path is finite, and no energy exceeds what the forces put in.
    #[test]
    fn key_path_of_random_keys_stays_finite(
        mass in 0.02..2.0f64, stiffness in 0.0..400.0f64, damping in 0.0..5.0f64, dry in 0.0..0.5f64,
        presliding in prop_oneof![Just(0.0), 100.0..5000.0f64], frequency in 20.0..400.0f64, seed in 0..1000i128,
    ) {
        let row = [mass, stiffness, damping, 0.1, dry, 0.0, 5e-4, presliding, 2.0 * dry, 3e-3, 0.1 * mass, frequency, 0.01];
        let path = path(&row, &forces(500, seed), 44);
        prop_assert!(path.iter().all(|x| x.abs() < 50.0));
    }
}

#[test]
fn force_derivatives_equal_differences() {
    let key_model = KeyModel::from_row(&[
        0.38, 60.0, 1.2, 0.15, 0.05, -2.5e-3, 1.3e-3, 0.0, 0.0, 0.0, 0.02, 180.0, 0.02,
    ])
    .unwrap();
    let tick_forces: Vec<f64> = (0..3000)
        .map(|n| if (n / 170) % 2 == 0 { 0.5 } else { -0.7 } + 0.2 * f64::from(n % 3))
        .collect();
    let pushed_ticks: Vec<usize> = (0..20).map(|i| 40 + 97 * i).collect();
    let derivatives = key_model
        .force_derivatives(&tick_forces, 1000.0, None, &pushed_ticks)
        .unwrap();
    let force_change = 1e-6;
    for (column, &tick) in pushed_ticks.iter().enumerate() {
        let path = |force_change: f64| {
            let mut tick_forces = tick_forces.clone();
            tick_forces[tick] += force_change;
            key_model.path(&tick_forces, 1000.0, None).unwrap()
        };
        let (path_above, path_below) = (path(force_change), path(-force_change));
        let (mut error_square, mut square_sum) = (0.0, 0.0);
        for n in 0..tick_forces.len() {
            let central_slope = (path_above[n] - path_below[n]) / (2.0 * force_change);
            let derivative = derivatives[n * pushed_ticks.len() + column];
            error_square += (central_slope - derivative) * (central_slope - derivative);
            square_sum += central_slope * central_slope;
        }
        assert!(error_square < 1e-8 * square_sum, "{tick}: {error_square} {square_sum}");
    }
    assert!(
        key_model
            .force_derivatives(&tick_forces, 1000.0, None, &[3000])
            .is_err()
    );
}
