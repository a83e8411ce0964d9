use super::*;
use crate::maths;

/// A tenth of a second of a 9 Hz hand with a 90 Hz tremor, 24 samples.
fn hand() -> (Vec<f64>, Vec<f64>) {
    let t: Vec<f64> = (0..24).map(|i| f64::from(i) / 240.0).collect();
    let x = t
        .iter()
        .map(|t| maths::sin(56.0 * t) + 0.1 * maths::cos(560.0 * t))
        .collect();
    (t, x)
}

fn plain(t: &[f64], x: &[f64]) -> Take {
    Take::new(t, x, Preparation::default()).unwrap()
}

#[test]
fn trim_of_take_cuts_the_path_between_samples() {
    let (t, x) = hand();
    let complete = plain(&t, &x);
    let trim = Some((0.0101, 0.0777));
    let trimmed_part = Take::new(
        &t,
        &x,
        Preparation {
            trim,
            ..Preparation::default()
        },
    )
    .unwrap();
    assert!((trimmed_part.duration() - 0.0676).abs() < 1e-16);
    for i in 0..=50 {
        let t = 0.0676 * f64::from(i) / 50.0;
        let (trimmed_part, complete) = (
            trimmed_part.profile().evaluate(t),
            complete.profile().evaluate(t + 0.0101),
        );
        assert!(
            (trimmed_part.0 - complete.0).abs() < 1e-12,
            "{t}: {trimmed_part:?} {complete:?}"
        );
        assert!((trimmed_part.1 - complete.1).abs() < 1e-9 && (trimmed_part.2 - complete.2).abs() < 1e-5);
    }
}

#[test]
fn placed_take_starts_with_its_first_instant() {
    let (t, x) = hand();
    let late_instants: Vec<f64> = t.iter().map(|t| t + 40.0).collect();
    let placed_take = plain(&late_instants, &x).placed(3.0, 2.0, 0.5, false).unwrap();
    assert!((placed_take.start_time() - 3.0).abs() < 1e-12);
    assert!((placed_take.end_time() - 3.0 - 0.5 * t[23]).abs() < 1e-12);
    for (t, x) in t.iter().zip(&x) {
        assert!((placed_take.evaluate(3.0 + 0.5 * t).0 - 2.0 * x).abs() < 1e-10);
    }
    assert!(plain(&t, &x).placed(3.0, 2.0, 0.0, false).is_err());
}

/// sos = scipy.signal.butter(4, 30, fs=240, output="sos"); scipy.signal.sosfiltfilt(sos, x)[[0, 7, 23]]
#[test]
fn smooth_take_equals_scipy() {
    let (t, x) = hand();
    let smooth_take = Take::new(
        &t,
        &x,
        Preparation {
            smooth: Some(30.0),
            ..Preparation::default()
        },
    )
    .unwrap();
    for (i, wanted) in [(0, SCIPY[0]), (7, SCIPY[1]), (23, SCIPY[2])] {
        let smoothed_position = smooth_take.profile().knot(i).x;
        assert!(
            (smoothed_position - wanted).abs() < 1e-13,
            "{i}: {smoothed_position} {wanted}"
        );
    }
}

const SCIPY: [f64; 3] = [0.09902771411784429, 1.0009927583782594, -0.8936866604984115];

/// The filter needs a constant step; the spline through the jittered instants gives the movement between them.
#[test]
fn smooth_take_with_uneven_samples() {
    let sample_rate = 500.0;
    let movement = |t: f64| maths::sin(12.0 * t);
    let even_instants: Vec<f64> = (0..1000).map(|i| f64::from(i) / sample_rate).collect();
    let jittered: Vec<f64> = (0..1000)
        .map(|i| f64::from(i) / sample_rate + 4e-4 * maths::sin(f64::from(i * i)))
        .collect();
    let smooth_take = |t: &[f64]| {
        let x: Vec<f64> = t.iter().map(|&t| movement(t)).collect();
        Take::new(
            t,
            &x,
            Preparation {
                smooth: Some(20.0),
                ..Preparation::default()
            },
        )
        .unwrap()
    };
    let (even_take, jittered_take) = (smooth_take(&even_instants), smooth_take(&jittered));
    for i in 100..900 {
        let t = f64::from(i) / sample_rate;
        assert!((even_take.profile().evaluate(t).0 - jittered_take.profile().evaluate(t).0).abs() < 1e-6);
    }
}

/// The ends of a movement that stops away from 0 do not sag towards 0.
#[test]
fn smooth_take_has_straight_ends() {
    let t: Vec<f64> = (0..200).map(|i| f64::from(i) / 200.0).collect();
    let ramp_positions: Vec<f64> = t.iter().map(|t| 3.0 + 0.5 * t).collect();
    let smooth_take = Take::new(
        &t,
        &ramp_positions,
        Preparation {
            smooth: Some(25.0),
            ..Preparation::default()
        },
    )
    .unwrap();
    for (i, x) in ramp_positions.iter().enumerate() {
        assert!((smooth_take.profile().knot(i).x - x).abs() < 2e-3, "{i}");
    }
    let still_positions = vec![0.25; 200];
    let smooth_take = Take::new(
        &t,
        &still_positions,
        Preparation {
            smooth: Some(1.0),
            ..Preparation::default()
        },
    )
    .unwrap();
    assert!((0..200).all(|i| (smooth_take.profile().knot(i).x - 0.25).abs() < 1e-14));
}

#[test]
fn take_error_names_the_sample() {
    let refused = |t: &[f64], x: &[f64], preparation| Take::new(t, x, preparation).unwrap_err();
    let unprepared = Preparation::default();
    assert_eq!(refused(&[0.0], &[0.0], unprepared), TakeError::TooFew(1));
    assert_eq!(
        refused(&[0.0, 1.0], &[0.0], unprepared),
        TakeError::Lengths { n_t: 2, n_x: 1 }
    );
    let order_error = refused(&[0.0, 1.0, 1.0], &[0.0; 3], unprepared);
    assert_eq!(
        order_error,
        TakeError::NotRising {
            index: 2,
            t: 1.0,
            previous_t: 1.0
        }
    );
    assert!(matches!(
        refused(&[0.0, 1.0], &[0.0, f64::NAN], unprepared),
        TakeError::NotFinite { index: 1, .. }
    ));
    for trim in [(-0.1, 0.5), (0.5, 0.5), (0.2, 1.1), (f64::NAN, 1.0)] {
        let preparation = Preparation {
            trim: Some(trim),
            ..unprepared
        };
        assert!(matches!(
            refused(&[0.0, 1.0], &[0.0; 2], preparation),
            TakeError::Trim { .. }
        ));
    }
    let cutoff_error = refused(
        &[0.0, 0.01],
        &[0.0; 2],
        Preparation {
            smooth: Some(50.0),
            ..unprepared
        },
    );
    assert_eq!(
        cutoff_error.to_string(),
        "smooth 50 Hz must lie above 0 and below half of the 100 samples a second of this take"
    );
}
