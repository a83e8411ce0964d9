use super::*;

use Curve::{Hold, Line, Smooth};

fn points(written: &[(f64, f64, Curve)]) -> Vec<Point> {
    written.iter().map(|&(t, x, curve)| Point { t, x, curve }).collect()
}

fn mixed() -> Profile {
    Profile::through_points(&points(&[
        (1.0, 0.0, Line),
        (2.0, 6.0, Smooth),
        (2.5, -1.0, Smooth),
        (3.0, 2.0, Smooth),
        (4.0, 4.0, Line),
        (5.0, 4.0, Hold),
        (6.0, 0.0, Smooth),
    ]))
    .unwrap()
}

#[test]
fn profile_meets_points_and_rests_at_run_ends() {
    let mixed_path = mixed();
    for (t, x) in [
        (1.0, 0.0),
        (2.0, 6.0),
        (2.5, -1.0),
        (3.0, 2.0),
        (4.0, 4.0),
        (5.0, 4.0),
        (6.0, 0.0),
    ] {
        assert!((mixed_path.evaluate(t).0 - x).abs() < 1e-14, "at {t}");
    }
    for t in [1.0, 5.0, 6.0] {
        let (_, v, a) = mixed_path.evaluate(t);
        assert!(v.abs() < 1e-12 && a.abs() < 1e-11, "at {t}: {v} {a}");
    }
    // One run: its inner points are passed in motion.
    assert!(mixed_path.evaluate(2.0).1 < -1.0);
    // Straight lines keep their speed up to the corner; in the corner the later line counts.
    assert_eq!(mixed_path.evaluate(3.0).1, 2.0);
    assert!((mixed_path.evaluate(3.5).0 - 3.0).abs() < 1e-15 && (mixed_path.evaluate(3.9).1 - 2.0).abs() < 1e-14);
    assert_eq!(mixed_path.evaluate(4.5), (4.0, 0.0, 0.0));
    assert_eq!(mixed_path.evaluate(0.0), (0.0, 0.0, 0.0));
    assert_eq!(mixed_path.evaluate(7.0), (0.0, 0.0, 0.0));
}

#[test]
fn profile_of_a_single_point_is_constant() {
    let constant_path = Profile::through_points(&points(&[(1.0, 5.0, Smooth)])).unwrap();
    for t in [0.0, 1.0, 2.0] {
        assert_eq!(constant_path.evaluate(t), (5.0, 0.0, 0.0));
    }
    assert_eq!(constant_path.range(0.0, 9.0), (5.0, 5.0));
}

#[test]
fn evaluate_from_a_cursor_equals_evaluate() {
    let mixed_path = mixed();
    let mut path_cursor = 0;
    let walk_instants = (0..=800).map(|i| 0.5 + f64::from(i) / 100.0);
    for t in walk_instants
        .clone()
        .chain(walk_instants.rev())
        .chain([1.1, 5.9, 0.2, 3.0, 9.0, 4.0])
    {
        assert_eq!(
            mixed_path.evaluate_from(&mut path_cursor, t),
            mixed_path.evaluate(t),
            "at {t}"
        );
    }
}

#[test]
fn range_of_profile_is_its_true_excursion() {
    let mixed_path = mixed();
    for (from, to) in [
        (0.0, 9.0),
        (1.3, 1.9),
        (1.5, 2.4),
        (2.6, 3.4),
        (3.2, 3.3),
        (4.2, 4.8),
        (2.0, 2.0),
    ] {
        let (range_low, range_high) = mixed_path.range(from, to);
        let sampled_path: Vec<f64> = (0..=20_000)
            .map(|i| mixed_path.evaluate(from + (to - from) * f64::from(i) / 20_000.0).0)
            .collect();
        let (sampled_low, sampled_high) = extremes(&sampled_path);
        assert!(
            range_low <= sampled_low + 1e-14 && sampled_low - range_low < 1e-5,
            "{from}..{to}: {range_low} {sampled_low}"
        );
        assert!(
            range_high >= sampled_high - 1e-14 && range_high - sampled_high < 1e-5,
            "{from}..{to}: {range_high} {sampled_high}"
        );
    }
    // Between its points the run overshoots all of them.
    let (range_low, range_high) = mixed_path.range(1.0, 3.0);
    assert!(range_low < -1.001 && range_high > 7.2, "{range_low} {range_high}");
}

#[test]
fn trimmed_profile_follows_the_same_path() {
    let mixed_path = mixed();
    let trimmed_path = mixed_path.trimmed(1.25, 4.5).shifted_earlier(1.25);
    assert_eq!((trimmed_path.start_time(), trimmed_path.end_time()), (0.0, 3.25));
    for i in 0..=100 {
        let t = 3.25 * f64::from(i) / 100.0;
        let ((x, v, a), (x0, v0, a0)) = (trimmed_path.evaluate(t), mixed_path.evaluate(t + 1.25));
        assert!(
            (x - x0).abs() < 1e-13 && (v - v0).abs() < 1e-11 && (a - a0).abs() < 1e-9,
            "{t}"
        );
    }
}

#[test]
fn profile_error_names_the_point() {
    assert_eq!(Profile::through_points(&[]), Err(PathError::Empty));
    let late_error = Profile::through_points(&points(&[(1.0, 0.0, Line), (1.0, 1.0, Line)]));
    assert_eq!(
        late_error,
        Err(PathError::NotRising {
            index: 1,
            t: 1.0,
            previous_t: 1.0
        })
    );
    let hold_error = Profile::through_points(&points(&[(1.0, 0.0, Line), (2.0, 1.0, Hold)]));
    assert_eq!(
        hold_error,
        Err(PathError::HoldMoves {
            index: 1,
            x: 1.0,
            previous_x: 0.0
        })
    );
    let nan_error = Profile::through_points(&points(&[(1.0, 0.0, Line), (2.0, f64::NAN, Line)]));
    assert!(nan_error.unwrap_err().to_string().contains("point 1"));
}
