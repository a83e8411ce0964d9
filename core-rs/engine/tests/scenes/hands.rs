//! Gestures in edge cases: at and before time 0, at one instant, against stops, near half a period of the key.

use std::sync::Arc;

use ergon_engine::gesture::error::GestureError;
use ergon_engine::gesture::profile::Curve::{Hold, Line, Smooth};
use ergon_engine::gesture::report::GestureReport;
use ergon_engine::gesture::script::{ErgonKind, Gesture, Manner, Touch};
use ergon_engine::gesture::written::{Approach, Approach::Path, WrittenPoints};
use ergon_engine::network::{But, Error, Network, Term, Tie};
use ergon_engine::simulation::{OnFault, Simulation};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

use super::scene::options;

fn tie() -> Tie {
    Tie::Tuned { f: 8.0, t60: Some(0.6) }
}

struct Keyboard {
    network: Network,
    timeline: Timeline,
}

type Points<'a> = &'a [(f64, f64, Approach)];

impl Keyboard {
    fn new(hertz: f64) -> Self {
        let mut network = Network::new();
        network.part("key", None);
        let first = network.cel("m", 0.08, tie(), 0.0, 0.0, 0.0).unwrap();
        let (len, weight) = (1, 1.0);
        network
            .listen("m", vec![Term::Position { first, len, weight }])
            .unwrap();
        let mut timeline = Timeline::new(Rate::new(hertz).unwrap());
        timeline.add_key("key", first);
        Self { network, timeline }
    }

    fn try_play(&mut self, points: Points<'_>, manner: Manner) -> Result<usize, GestureError> {
        let t: Vec<f64> = points.iter().map(|point| point.0).collect();
        let x: Vec<f64> = points.iter().map(|point| point.1).collect();
        let method: Vec<Approach> = points.iter().map(|point| point.2).collect();
        let written = WrittenPoints {
            t: &t,
            x: &x,
            approaches: &method,
            sources: &[],
        };
        let gesture = Gesture::from_points(0, &written, manner)?;
        self.timeline.add_gesture(gesture)
    }

    fn play(&mut self, points: Points<'_>, manner: Manner) {
        self.try_play(points, manner).unwrap();
    }

    fn try_hear(&self, seconds: f64) -> Result<(Vec<f64>, Vec<GestureReport>), Error> {
        let network = Arc::new(self.network.clone());
        let mut simulation = Simulation::new(network, &self.timeline, options(OnFault::Stop))?;
        let mut out = vec![0.0; (seconds * self.timeline.rate.hertz()) as usize];
        simulation.process(&mut out).unwrap();
        Ok((out, simulation.reports().to_vec()))
    }

    fn hear(&self, seconds: f64) -> (Vec<f64>, Vec<GestureReport>) {
        self.try_hear(seconds).unwrap()
    }
}

fn smooth(points: &[(f64, f64)]) -> Vec<(f64, f64, Approach)> {
    points.iter().map(|&(t, x)| (t, x, Path(Smooth))).collect()
}

/// At any rate, a written point that lies on a frame is met.
#[test]
fn gesture_meets_its_points_at_any_rate() {
    for hertz in [8_000.0, 44_100.0, 192_000.0] {
        for touch in [Touch::Open, Touch::Tracked] {
            let mut keys = Keyboard::new(hertz);
            keys.play(
                &smooth(&[(0.0, 0.0), (0.1, 5e-3), (0.2, 1e-3)]),
                Manner { touch, ..Manner::OPEN },
            );
            let (x, reports) = keys.hear(0.3);
            for (t, wanted) in [(0.1, 5e-3), (0.2, 1e-3)] {
                let n = (t * hertz + 0.5) as usize;
                assert!((x[n] - wanted).abs() < 1e-11, "{hertz} {t}: {}", x[n]);
            }
            assert!(reports[0].deviation_max < 1e-11 && !reports[0].is_first_point_missed);
        }
    }
}

/// A gesture that began before the piece is joined from rest; all later points are met.
#[test]
fn gesture_from_before_the_piece_is_joined() {
    let mut keys = Keyboard::new(44_100.0);
    keys.play(&smooth(&[(-0.05, 2e-3), (0.1, 5e-3)]), Manner::OPEN);
    let (x, reports) = keys.hear(0.15);
    assert_eq!(x[0], 0.0);
    assert!((x[4410] - 5e-3).abs() < 1e-12);
    assert!(reports[0].is_first_point_missed);
    // A gesture that ended before the piece is silent.
    let mut keys = Keyboard::new(44_100.0);
    keys.play(&smooth(&[(-0.2, 2e-3), (-0.1, 5e-3)]), Manner::OPEN);
    let (x, reports) = keys.hear(0.1);
    assert!(x.iter().all(|x| *x == 0.0));
    assert_eq!(reports[0].n_ergons, 0);
}

#[test]
fn gestures_at_the_same_instant_play_the_later() {
    let mut keys = Keyboard::new(44_100.0);
    keys.play(&smooth(&[(0.05, 0.0), (0.1, 5e-3)]), Manner::OPEN);
    keys.play(&smooth(&[(0.05, 0.0), (0.1, -3e-3)]), Manner::OPEN);
    let (x, reports) = keys.hear(0.15);
    assert!((x[4410] + 3e-3).abs() < 1e-12);
    assert_eq!(reports[0].n_ergons, 0);
}

/// A single point, a gesture longer than the piece, and no gesture.
#[test]
fn gestures_of_extreme_lengths_stay_finite() {
    let mut keys = Keyboard::new(44_100.0);
    keys.play(&smooth(&[(0.05, 2e-3)]), Manner::OPEN);
    keys.play(&smooth(&[(0.1, 0.0), (1e6, 5e-3)]), Manner::OPEN);
    keys.play(&smooth(&[(1e9, 0.0)]), Manner::OPEN);
    let (x, _) = keys.hear(0.2);
    assert!((x[2205] - 2e-3).abs() < 1e-12, "joined to its one point");
    assert!(keys.try_play(&[], Manner::OPEN).is_err());
}

/// If a hold ends between two frames, the throw still lands on its own frame.
#[test]
fn throw_right_after_a_hold_lands() {
    for start in [0.05, 0.05 + 0.3 / 44_100.0, 0.05 + 0.7 / 44_100.0] {
        let mut keys = Keyboard::new(44_100.0);
        let (thrown, back) = (start + 0.03, start + 0.05);
        keys.play(
            &[
                (start - 0.02, 0.0, Path(Line)),
                (start, 0.0, Path(Hold)),
                (thrown, 4e-3, Approach::Throw),
                (back, 1e-3, Approach::Throw),
                (back + 0.02, 1e-3, Path(Smooth)),
            ],
            Manner::OPEN,
        );
        let (x, reports) = keys.hear(0.15);
        for (t, wanted) in [(thrown, 4e-3), (back, 1e-3)] {
            let n = (t * 44_100.0 + 0.5) as usize;
            assert!((x[n] - wanted).abs() < 1e-12, "{start}: {}", x[n]);
        }
        assert!(reports[0].n_ergons > 2);
    }
}

/// After half its period a key is at the same place whatever the throw: no impulse makes it land elsewhere.
#[test]
fn throw_without_a_solution_is_skipped() {
    let mut keys = Keyboard::new(8_000.0);
    let undamped = Tie::Tuned { f: 8.0, t60: None };
    keys.network = Network::new();
    keys.network.part("key", None);
    keys.network.cel("m", 0.08, undamped, 0.0, 0.0, 0.0).unwrap();
    let (first, len, weight) = (0, 1, 1.0);
    keys.network
        .listen("m", vec![Term::Position { first, len, weight }])
        .unwrap();
    keys.play(
        &[(0.0, 0.0, Approach::Throw), (1.0 / 16.0, 5e-3, Approach::Throw)],
        Manner::OPEN,
    );
    let (x, reports) = keys.hear(0.2);
    assert!(x.iter().all(|x| *x == 0.0));
    assert_eq!(reports[0].n_ergons, 0);
}

#[test]
fn gesture_with_non_finite_points_is_refused() {
    let mut keys = Keyboard::new(44_100.0);
    for method in [Approach::Throw, Path(Smooth)] {
        for (t, x) in [(0.1, f64::NAN), (f64::NAN, 0.0), (f64::INFINITY, 0.0)] {
            assert!(
                keys.try_play(&[(0.0, 0.0, method), (t, x, method)], Manner::OPEN)
                    .is_err()
            );
        }
    }
    let short = keys.try_play(
        &[(0.1, 0.0, Approach::Throw), (0.100_001, 1e-3, Approach::Throw)],
        Manner::OPEN,
    );
    assert!(matches!(short, Err(GestureError::ThrowTooShort { index: 1, .. })));
    let points = smooth(&[(0.0, 0.0), (0.1, 1e-3)]);
    for bad in [
        Manner {
            grain: Some(0.0),
            ..Manner::OPEN
        },
        Manner {
            grain: Some(f64::INFINITY),
            ..Manner::OPEN
        },
        Manner {
            join_seconds: -1.0,
            ..Manner::OPEN
        },
        Manner {
            force_max: Some(0.0),
            ..Manner::OPEN
        },
        Manner {
            touch: Touch::Tracked,
            ergon_kind: ErgonKind::Particle,
            ..Manner::OPEN
        },
    ] {
        assert!(keys.try_play(&points, bad).is_err(), "{bad:?}");
    }
    let written = WrittenPoints {
        t: &[0.0],
        x: &[0.0],
        approaches: &[Approach::Throw],
        sources: &[],
    };
    let elsewhere = Gesture::from_points(1, &written, Manner::OPEN).unwrap();
    assert_eq!(keys.timeline.add_gesture(elsewhere), Err(GestureError::NoKey(1)));
}

/// The last grain is shortened to the time that is left; the end of the gesture is still met.
#[test]
fn grain_shortened_at_the_end_of_a_gesture() {
    for grain in [0.007, 0.03] {
        let mut keys = Keyboard::new(44_100.0);
        keys.play(
            &smooth(&[(0.0, 0.0), (0.05, 5e-3)]),
            Manner {
                grain: Some(grain),
                ..Manner::OPEN
            },
        );
        let (x, reports) = keys.hear(0.1);
        assert!((x[2205] - 5e-3).abs() < 1e-12, "{grain}");
        let n_grains = (0.05_f64 / grain).ceil() as u64;
        assert_eq!(reports[0].n_ergons, n_grains, "{grain}");
    }
}

/// A grain longer than a quarter period is allowed if the gesture ends sooner, because no flight is then that long.
#[test]
fn grain_longer_than_a_quarter_period() {
    let mut keys = Keyboard::new(44_100.0);
    let long = Manner {
        grain: Some(1e9),
        ..Manner::OPEN
    };
    keys.play(&smooth(&[(0.0, 0.0), (0.02, 5e-3)]), long);
    assert_eq!(keys.hear(0.1).1[0].n_ergons, 1);
    keys.play(&smooth(&[(0.2, 0.0), (0.4, 5e-3)]), long);
    assert!(keys.try_hear(0.1).is_err());
}

/// The free copy of the key has no gates: the inner link would hold the copy, but not the key.
#[test]
fn coupling_inside_a_key_is_refused() {
    let mut keys = Keyboard::new(44_100.0);
    let rail = keys.network.sol("rail", 0.0).unwrap();
    let inner = keys.network.spring("inner", 0, rail, 1e4, 0.0, 0.0).unwrap();
    keys.network.part("bell", None);
    let bell = keys.network.cel("m", 0.01, tie(), 0.0, 0.0, 0.0).unwrap();
    let outer = keys.network.spring("outer", 0, bell, 1e4, 0.0, 0.0).unwrap();
    keys.timeline.couple(&keys.network, outer, 5.0, None).unwrap();
    assert!(keys.try_hear(0.01).is_ok());
    keys.timeline.couple(&keys.network, inner, 5.0, None).unwrap();
    assert!(keys.try_hear(0.01).unwrap_err().to_string().contains("key.inner"));
}

/// A stop 10 mm away does not change the period of the key, nor a gesture laid over another.
#[test]
fn open_stop_leaves_gestures_unchanged() {
    let but = But::plain(1e5, 0.0, 0.01);
    let hear = |stop: bool| {
        let mut keys = Keyboard::new(44_100.0);
        if stop {
            let rail = keys.network.sol("rail", 0.0).unwrap();
            keys.network.but("stop", 0, rail, but).unwrap();
        }
        let grain = Manner {
            grain: Some(0.01),
            ..Manner::OPEN
        };
        keys.play(&smooth(&[(0.0, 0.0), (0.1, 5e-3)]), grain);
        let layer = Manner {
            is_layer: true,
            ..Manner::OPEN
        };
        keys.play(&smooth(&[(0.03, 0.0), (0.05, 1e-3), (0.07, 0.0)]), layer);
        keys.hear(0.1).0
    };
    let (with, without) = (hear(true), hear(false));
    let worst = with
        .iter()
        .zip(&without)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    assert!(worst < 1e-12, "{worst}");
}
