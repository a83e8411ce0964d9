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
    let mut stroke = 0.0;
    (0..n)
        .map(|tick| {
            if tick % 150 == 0 {
                stroke = chance.uniform(-0.3, 0.3);
            }
            stroke
                + if chance.uniform(0.0, 1.0) < 0.5 {
                    1.0
                } else {
                    -1.0
                }
        })
        .collect()
}

fn path(row: &[f64], forces: &[f64], steps: usize) -> Vec<f64> {
    let key = KeyModel::from_row(row).unwrap();
    key.path(forces, RATE, Some(steps)).unwrap()
}

fn rms(x: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0);
    for x in x {
        (sum, n) = (sum + x * x, n + 1);
    }
    sqrt(sum / f64::from(n))
}

fn differs(a: &[f64], b: &[f64]) -> f64 {
    rms(a.iter().zip(b).map(|(a, b)| a - b))
}

/// Largest relative difference of a column from central differences.
fn tangent_error(row: &[f64], forces: &[f64]) -> f64 {
    let columns: Vec<usize> = (0..row.len()).filter(|&i| row[i] != 0.0).collect();
    let key = KeyModel::from_row(row).unwrap();
    let (_, jacobian) = key
        .path_and_jacobian(forces, RATE, Some(44), &columns)
        .unwrap();
    let error = |column: usize, index: usize, by: f64| {
        let moved = |by: f64| {
            let mut row = row.to_vec();
            row[index] += by;
            path(&row, forces, 44)
        };
        let (over, under) = (moved(by), moved(-by));
        let differences = over.iter().zip(&under).map(|(a, b)| (a - b) / (2.0 * by));
        let differences: Vec<f64> = differences.collect();
        let single: Vec<f64> = jacobian[column..]
            .iter()
            .step_by(columns.len())
            .copied()
            .collect();
        differs(&single, &differences) / rms(differences.into_iter())
    };
    // Wide differences include turns that appear or vanish, narrow ones suffer from rounding; one of the three is
    // accurate.
    let worst = columns.iter().enumerate().map(|(column, &index)| {
        let errors = [1e-5, 1e-6, 1e-7].map(|by| error(column, index, by * row[index].abs()));
        errors.into_iter().fold(f64::INFINITY, f64::min)
    });
    worst.fold(0.0, f64::max)
}

#[test]
fn jacobian_of_key_path_equals_differences() {
    let forces = forces(3000, 1);
    let sliding = ROW;
    let (mut static_too, mut giving_way, mut both) = (ROW, ROW, ROW);
    static_too[8..10].copy_from_slice(&[0.08, 4e-3]);
    giving_way[7] = 5000.0;
    both[7..10].copy_from_slice(&[5000.0, 0.08, 4e-3]);
    for row in [sliding, static_too, giving_way, both] {
        let error = tangent_error(&row, &forces);
        assert!(error < 1e-5, "{row:?}: {error:e}");
    }
}

#[test]
fn path_and_jacobian_returns_the_same_path() {
    let forces = forces(2000, 2);
    let key = KeyModel::from_row(&ROW).unwrap();
    let alone = key.path(&forces, RATE, None).unwrap();
    for columns in [vec![], vec![4], (0..13).collect()] {
        let (path, jacobian) = key
            .path_and_jacobian(&forces, RATE, None, &columns)
            .unwrap();
        assert_eq!(path, alone);
        assert_eq!(jacobian.len(), forces.len() * columns.len());
    }
}

/// A key that slides with 50 mN of dry friction turns where its velocity is zero, and its path consists of parabolas.
#[test]
fn friction_turns_at_zero_velocity() {
    let (mass, dry) = (0.4, 0.05);
    // With this delay, forces change between two velocities, so that friction changes with them.
    let delay = |steps: usize| 0.5 / (RATE * steps as f64);
    let row = |steps| [mass, 0.0, 0.0, 0.0, dry, 0.0, delay(steps), 0.0, 0.0, 0.0];
    // 0.4 N for 50 ticks, then -0.3 N: the key goes on, stops and turns.
    let forces: Vec<f64> = (0..200).map(|n| if n < 50 { 0.4 } else { -0.3 }).collect();
    let (up, down, back) = ((0.4 - dry) / mass, (0.3 + dry) / mass, (0.3 - dry) / mass);
    let first = 50.0 / RATE;
    let turn = first + up * first / down;
    let top = 0.5 * up * first * first + 0.5 * down * (turn - first) * (turn - first);
    let exact = |n: usize, delay: f64| {
        let t = (n as f64 / RATE - delay).max(0.0);
        if t < first {
            0.5 * up * t * t
        } else if t < turn {
            top - 0.5 * down * (turn - t) * (turn - t)
        } else {
            top - 0.5 * back * (t - turn) * (t - turn)
        }
    };
    let error = |steps: usize| {
        let path = path(&row(steps), &forces, steps);
        let errors = path.iter().enumerate();
        let errors = errors.map(|(n, x)| x - exact(n, delay(steps)));
        errors.fold(0.0, |worst: f64, error| worst.max(error.abs()))
    };
    // Second order: sixteen times the steps leave a 256th of the error, wherever in its step the turn lies.
    let (coarse, fine) = (error(7), error(112));
    assert!(
        coarse < 2e-8 && fine < coarse / 150.0,
        "{coarse:e} {fine:e}"
    );
}

#[test]
fn key_path_is_of_second_order() {
    let forces = forces(1500, 4);
    let row = &[0.38, 60.0, 1.2, 0.15, 0.0, -2.5e-3, 1.1e-3, 0.0, 0.0, 0.0];
    let fine = path(row, &forces, 1760);
    let [a, b] = [22, 88].map(|steps| differs(&path(row, &forces, steps), &fine));
    assert!(b < a / 14.0, "{a:e} {b:e}");
    // With modes and friction, the first-order error is small compared with a sensor's step of some micrometres.
    let fine = path(&ROW, &forces, 1760);
    let [a, b] = [22, 88].map(|steps| differs(&path(&ROW, &forces, steps), &fine));
    assert!(a < 1e-7 && b < a / 2.0, "{a:e} {b:e}");
}

#[test]
fn resting_key_stays_within_friction() {
    let row = [0.4, 60.0, 1.2, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0];
    let held = path(&row, &[0.049; 500], 44);
    assert!(held.iter().all(|&x| x == 0.0));
    assert!(path(&row, &[0.051; 500], 44)[499] > 0.0);
    // A contact that gives way moves by -F/σ ln(1 - f/F) under a force f that rises slowly.
    let mut giving = row;
    giving[7] = 5000.0;
    let rising: Vec<f64> = (0..4000).map(|n| 0.02 * f64::from(n) / 4000.0).collect();
    let there = path(&giving, &rising, 44)[3999];
    assert!(
        (there / (-1e-5 * crate::maths::log(0.6)) - 1.0).abs() < 0.03,
        "{there:e}"
    );
}

#[test]
fn delay_shifts_the_key_path() {
    let forces = forces(500, 3);
    let (mut now, mut later) = (ROW, ROW);
    (now[6], later[6]) = (0.0, 3.0 / RATE);
    (now[5], later[5]) = (-2.5e-3, -2.5e-3);
    let (now, later) = (path(&now, &forces, 44), path(&later, &forces, 44));
    assert!(differs(&now[..497], &later[3..]) < 1e-12);
    assert_ne!(now, later);
}

#[test]
fn key_models_with_wrong_rows_are_refused() {
    let with = |index: usize, value: f64| {
        let mut row = ROW;
        row[index] = value;
        KeyModel::from_row(&row)
    };
    assert_eq!(KeyModel::from_row(&ROW[..9]), Err(KeyError::Count));
    assert_eq!(KeyModel::from_row(&ROW[..11]), Err(KeyError::Count));
    assert_eq!(with(0, 0.0), Err(KeyError::Mass));
    assert_eq!(with(11, 0.0), Err(KeyError::Mass));
    assert_eq!(with(1, f64::NAN), Err(KeyError::NotFinite));
    assert_eq!(with(4, -1e-9), Err(KeyError::Negative));
    assert_eq!(with(6, 2.0), Err(KeyError::Delay));
    let key = with(11, 9000.0).unwrap();
    assert_eq!(key.path(&[], RATE, Some(44)), Err(KeyError::Fast));
    assert_eq!(key.path(&[], f64::NAN, None), Err(KeyError::Rate));
    assert_eq!(key.path(&[], RATE, Some(0)), Err(KeyError::Steps));
    let none = key.path_and_jacobian(&[], RATE, Some(400), &[13]);
    assert_eq!(none, Err(KeyError::Count));
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
    let key = KeyModel::from_row(&[
        0.38, 60.0, 1.2, 0.15, 0.05, -2.5e-3, 1.3e-3, 0.0, 0.0, 0.0, 0.02, 180.0, 0.02,
    ])
    .unwrap();
    let force: Vec<f64> = (0..3000)
        .map(|n| if (n / 170) % 2 == 0 { 0.5 } else { -0.7 } + 0.2 * f64::from(n % 3))
        .collect();
    let ticks: Vec<usize> = (0..20).map(|i| 40 + 97 * i).collect();
    let result = key.force_derivatives(&force, 1000.0, None, &ticks).unwrap();
    let by = 1e-6;
    for (column, &tick) in ticks.iter().enumerate() {
        let path = |by: f64| {
            let mut force = force.clone();
            force[tick] += by;
            key.path(&force, 1000.0, None).unwrap()
        };
        let (more, less) = (path(by), path(-by));
        let (mut error, mut size) = (0.0, 0.0);
        for n in 0..force.len() {
            let wide = (more[n] - less[n]) / (2.0 * by);
            let single = result[n * ticks.len() + column];
            error += (wide - single) * (wide - single);
            size += wide * wide;
        }
        assert!(error < 1e-8 * size, "{tick}: {error} {size}");
    }
    assert!(
        key.force_derivatives(&force, 1000.0, None, &[3000])
            .is_err()
    );
}
