//! Faults of a board: each is found within a time and a travel of the key.

use super::simulated_key::{Grip, PieceForce, PlayedKey, SimulatedKey, TEST_HAND};
use super::{AxisSpec, Plausibility, TripCause};

const FINE: f64 = 1e-5;

/// The effect of a fault.
#[derive(Debug)]
struct FaultOutcome {
    /// Time after the fault in which there was a force [ms].
    lasted: f64,
    /// How far the key moved beyond its positions without the fault and without any force [mm].
    travel: f64,
    why: Option<TripCause>,
}

/// The effect of a fault at an instant, by comparison with the same play without the fault, and without any force from
/// that instant on.
fn harm(fault: fn(&mut SimulatedKey), start: f64, grip: Option<Grip>, piece_force: PieceForce) -> FaultOutcome {
    let play = || {
        let mut play = PlayedKey::new(SimulatedKey::new(FINE, 20.0, Some(0.05)), piece_force);
        play.key().grip = grip;
        play.run_until(start);
        assert!(play.trips.is_empty(), "{:?}", play.trips);
        play
    };
    let (mut complete, mut free_play, mut faulty_play) = (play(), play(), play());
    fault(faulty_play.key());
    free_play.key().motor_sign = 0.0;
    let (mut force_time, mut extra_travel) = (0.0, 0.0_f64);
    while faulty_play.time() < start + 1.5 && (force_time == 0.0 || faulty_play.time() < start + force_time + 0.3) {
        for play in [&mut complete, &mut free_play, &mut faulty_play] {
            play.tick();
        }
        if faulty_play.sent_force != 0.0 {
            force_time = faulty_play.time() - start;
        }
        let (intact_position, free_position, faulty_position) =
            (complete.key().x, free_play.key().x, faulty_play.key().x);
        extra_travel = extra_travel
            .max(faulty_position - intact_position.max(free_position))
            .max(intact_position.min(free_position) - faulty_position);
    }
    let why = faulty_play.trips.first().map(|trip| trip.1);
    FaultOutcome {
        lasted: 1e3 * force_time,
        travel: 1e3 * extra_travel,
        why,
    }
}

const SINE: Grip = Grip {
    position: |t| 5e-3 * libm::sin(std::f64::consts::TAU * t),
    ..TEST_HAND
};

const REVERSED: fn(&mut SimulatedKey) = |key| key.motor_sign = -1.0;
const FROZEN: fn(&mut SimulatedKey) = |key| key.frozen = true;
const SPRINGS: [(&str, PieceForce); 5] = [
    ("200 N/m to 3 mm", |_, x, _| 200.0 * (3e-3 - x)),
    ("500 N/m to 3 mm", |_, x, _| 500.0 * (3e-3 - x)),
    ("800 N/m to 3 mm", |_, x, _| 800.0 * (3e-3 - x)),
    ("1500 N/m to 1 mm", |_, x, v| 1500.0 * (1e-3 - x) - v),
    ("200 N/m to a key that goes 8 mm", |t, x, _| {
        200.0 * (8e-3 * libm::sin(12.0 * t) - x)
    }),
];
const INSTANTS: [f64; 3] = [3.0, 3.1, 3.25];

/// The effect of a fault in every scene at every instant.
fn harms(fault: fn(&mut SimulatedKey), grip: Option<Grip>) -> Vec<(&'static str, f64, FaultOutcome)> {
    let fault_cases = SPRINGS.iter().flat_map(|of| INSTANTS.map(|at| (of, at)));
    fault_cases
        .map(|(&(name, piece_force), at)| (name, at, harm(fault, at, grip, piece_force)))
        .collect()
}

#[test]
fn reversed_motor_under_a_hand_trips_early() {
    for (name, position, harm) in harms(REVERSED, Some(TEST_HAND)) {
        assert_eq!(harm.why, Some(TripCause::WrongWay), "{name} {position} {harm:?}");
        assert!(harm.lasted < 450.0 && harm.travel < 8.0, "{name} {position} {harm:?}");
    }
}

#[test]
fn reversed_motor_trips_under_moving_and_absent_hands() {
    for (name, position, harm) in harms(REVERSED, Some(SINE)) {
        // A spring weaker than the hand cannot drive the hand away.
        if name.starts_with("200") {
            continue;
        }
        assert_eq!(harm.why, Some(TripCause::WrongWay), "{name} {position} {harm:?}");
        assert!(harm.lasted < 450.0, "{name} {position} {harm:?}");
        // In this case the motor is reversed while a probe is under way, which first gets a right response.
        assert!(
            harm.travel < 12.0 || (name.starts_with("1500") && position == 3.25),
            "{name} {position} {harm:?}"
        );
    }
    for (name, position, harm) in harms(REVERSED, None) {
        // If the scene is at rest there is no force that could have the wrong sign.
        let scene_moves = name.ends_with("8 mm");
        assert!(
            !scene_moves || harm.why == Some(TripCause::WrongWay),
            "{name} {position} {harm:?}"
        );
        assert!(harm.lasted < 300.0 && harm.travel < 13.0, "{name} {position} {harm:?}");
    }
}

#[test]
fn frozen_sensor_trips_or_moves_little() {
    for grip in [Some(TEST_HAND), Some(SINE)] {
        for (name, position, harm) in harms(FROZEN, grip) {
            if harm.why.is_none() {
                // The sensor froze when nothing could show it: with hardly any force, or just after a right response.
                assert!(harm.travel < 1.0, "{name} {position} {harm:?}");
                continue;
            }
            assert_eq!(harm.why, Some(TripCause::Frozen), "{name} {position} {harm:?}");
            assert!(harm.lasted < 400.0 && harm.travel < 7.0, "{name} {position} {harm:?}");
        }
    }
    for (name, position, harm) in harms(FROZEN, None) {
        assert!(harm.lasted < 400.0, "{name} {position} {harm:?}");
    }
}

#[test]
fn wrong_wiring_stops_at_first_movement() {
    for (grip, piece_force) in [
        (SINE, SPRINGS[0].1),
        (SINE, SPRINGS[2].1),
        (TEST_HAND, SPRINGS[1].1),
        (TEST_HAND, SPRINGS[4].1),
    ] {
        let mut play = PlayedKey::new(SimulatedKey::new(FINE, 20.0, Some(0.05)), piece_force);
        (play.key().grip, play.key().motor_sign) = (Some(grip), -1.0);
        play.run_until(4.0);
        let trip_kinds: Vec<_> = play.trips.iter().map(|trip| trip.1).collect();
        assert_eq!(trip_kinds, [TripCause::WrongWay], "{:?}", play.trips);
        assert_eq!(play.sent_force, 0.0, "it stays off");
        play.guarded_device.release();
        play.run_until(8.0);
        assert_eq!(play.trips.len(), 2, "and is found again: {:?}", play.trips);
    }
}

#[test]
fn key_pushed_into_its_stop_trips_and_recovers() {
    // For a while the scene pulls the key to a position beyond its range.
    let pulling_scene: PieceForce = |t, x, _| 100.0 * (if t < 4.0 { 0.09 } else { 0.0 } - x);
    let mut play = PlayedKey::new(SimulatedKey::new(FINE, 20.0, None), pulling_scene);
    play.key().grip = None;
    let mut arrived = f64::INFINITY;
    while play.trips.is_empty() && play.time() < 4.0 {
        play.tick();
        if play.key().x == 0.05 && play.sent_force > 2.0 {
            arrived = arrived.min(play.time());
        }
    }
    assert_eq!(play.trips[0].1, TripCause::AtStop);
    assert!(play.trips[0].0 - arrived < 0.3, "{arrived} {:?}", play.trips);
    play.run_until(6.9);
    assert_eq!(play.sent_force, 0.0);
    play.run_until(9.0);
    assert_eq!(play.trips.len(), 1);
    assert!(play.key().x.abs() < 1e-3, "the spring has it back: {}", play.key().x);
}

#[test]
fn third_trip_lasts_until_the_player_releases_it() {
    let mut play = PlayedKey::new(SimulatedKey::new(FINE, 20.0, None), |t, x, _| {
        if x > 0.049 && t % 8.0 < 4.0 { 5.0 } else { 0.0 }
    });
    play.key().grip = Some(Grip {
        k: 3e3,
        z: 30.0,
        position: |t| 0.055 * (t % 8.0 / 0.1).min((4.0 - t % 8.0) / 0.1).clamp(0.0, 1.0),
    });
    let stop_trips = |play: &PlayedKey| play.trips.iter().filter(|trip| trip.1 == TripCause::AtStop).count();
    play.run_until(47.9);
    assert_eq!(stop_trips(&play), 3, "{:?}", play.trips);
    play.guarded_device.release();
    play.run_until(55.0);
    assert_eq!(stop_trips(&play), 4, "{:?}", play.trips);
}

#[test]
#[ignore = "figures for docs/live.md: --ignored --nocapture"]
#[allow(clippy::print_stdout)] // prints a table on request
fn figures() {
    for (fault, name) in [(REVERSED, "reversed"), (FROZEN, "frozen")] {
        for (grip, hand) in [(Some(TEST_HAND), "still"), (Some(SINE), "goes"), (None, "nobody")] {
            for (piece_force, position, FaultOutcome { lasted, travel, why }) in harms(fault, grip) {
                println!("{name:9} {hand:7} {piece_force:33} {position}: {lasted:7.1} ms {travel:6.2} mm {why:?}");
            }
        }
    }
}

/// A key keeps its position until a pulse test is made; then the host is stopped. Afterwards the force equals the
/// scene's.
#[test]
fn restart_ends_tests_and_suspicions() {
    let axis_spec = AxisSpec {
        range: [-0.05, 0.05],
        resolution: 1e-5,
        inertia: Some(0.05),
        force_max: 20.0,
        delay_seconds: 0.0,
        energy_max: 1.0,
        power_max: 0.5,
    };
    let mut axis_checks = Plausibility::new(axis_spec, 1e-3);
    let asked_force = |x: f64| 500.0 * x;
    let (x, mut sent_force) = (2e-3, 0.0);
    let mut is_asked = false;
    for _ in 0..400 {
        sent_force = axis_checks.tick(asked_force(x), sent_force, Some(x));
        is_asked |= sent_force != asked_force(x);
        if is_asked {
            break;
        }
    }
    assert!(is_asked);
    axis_checks.restart();
    // After the stop the position is another, and the earlier force is gone.
    for i in 0..12 {
        let x = -2e-3 + 1e-6 * f64::from(i);
        assert_eq!(axis_checks.tick(asked_force(x), 0.0, Some(x)), asked_force(x));
    }
}
