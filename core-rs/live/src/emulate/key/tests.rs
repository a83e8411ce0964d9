use std::sync::Arc;

use ergon_engine::maths;
use ergon_engine::network::{Network, Tie};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::Timeline;

use super::*;

fn keys(key: KeyConstants, rate: f64, hands: Vec<EmulatedHand>) -> EmulatedKeys {
    EmulatedKeys::new(1, key, rate, hands).unwrap()
}

fn push(force: f64) -> [f64; MAX_AXES] {
    let mut forces = [0.0; MAX_AXES];
    forces[0] = force;
    forces
}

/// Compares a CEL that a spring pulls, in one network with a mass, with the same CEL as a key that gets the spring's
/// force.
#[test]
fn emulated_key_equals_a_cel_bitwise() {
    let key_rate = 44_100.0 / 44.0;
    let key = KeyConstants {
        mass: 0.08,
        stiffness: 200.0,
        damping: 0.9,
        range: [-1.0, 1.0],
    };
    let cel_tie = Tie::Physical {
        k: key.stiffness,
        z: key.damping,
    };
    let mut network = Network::new();
    let cel_mat = network.cel("key", key.mass, cel_tie, 0.0, 0.0, 0.0).unwrap();
    let other_mat = network.mas("other", 0.05, 0.0, 1.5).unwrap();
    let link_stiffness = 120.0;
    network
        .spring("tie", cel_mat, other_mat, link_stiffness, 0.0, 0.0)
        .unwrap();
    let options = SimulationOptions {
        keeps_ledger: false,
        records_ergons: false,
        on_fault: OnFault::Stop,
        threads: 1,
        is_unchecked: false,
    };
    let timeline = Timeline::new(Rate::new(key_rate).unwrap());
    let mut complete = Simulation::new(Arc::new(network), &timeline, options).unwrap();
    let mut key = keys(key, key_rate, vec![]);
    let mut greatest_move: f64 = 0.0;
    for frame in 0..4000 {
        let mat_positions = complete.positions();
        assert_eq!(
            mat_positions[cel_mat].to_bits(),
            key.positions()[0].to_bits(),
            "{frame}"
        );
        greatest_move = greatest_move.max(mat_positions[cel_mat].abs());
        key.step(&push(
            link_stiffness * (mat_positions[other_mat] - mat_positions[cel_mat]),
        ));
        complete.skip(1).unwrap();
    }
    assert!(greatest_move > 1e-3, "{greatest_move}");
}

/// A hand is a spring and a damper to a moving point; for a point that stands still, the motion is compared with the
/// closed solution.
#[test]
fn hand_on_path_pulls_as_a_damped_spring() {
    let key_rate = 10_000.0;
    let (mass, stiffness, damping, hand_target) = (0.05, 300.0, 2.0, 0.01);
    let path_hand = EmulatedHand::OnPath {
        path: vec![hand_target; 2_000],
        stiffness,
        damping,
    };
    let key = KeyConstants {
        mass,
        stiffness: 0.0,
        damping: 0.0,
        range: [-1.0, 1.0],
    };
    let mut key = keys(key, key_rate, vec![path_hand]);
    let (sigma, squared) = (0.5 * damping / mass, stiffness / mass);
    let omega = maths::sqrt(squared - sigma * sigma);
    for n in 1..=2000 {
        key.step(&push(0.0));
        let t = f64::from(n) / key_rate;
        let (sin, cos) = maths::sincos(omega * t);
        let exact_position = hand_target * (1.0 - maths::exp(-sigma * t) * (cos + sigma / omega * sin));
        // A damper by backward differences is half a period late, and so is the first step.
        assert!(
            (key.positions()[0] - exact_position).abs() < 0.02 * hand_target,
            "{n}: {} {exact_position}",
            key.positions()[0]
        );
    }
    assert!(!key.is_touched(0), "it has let go");
}

#[test]
fn touched_of_free_and_resting_hands() {
    for (hand, touched) in [(EmulatedHand::Free, false), (EmulatedHand::Resting, true)] {
        let mut single_key = keys(KeyConstants::default(), 1000.0, vec![hand]);
        assert_eq!(single_key.is_touched(0), touched);
        single_key.step(&push(0.0));
        assert_eq!(single_key.positions()[0], 0.0);
    }
}

#[test]
fn key_stops_at_its_travel() {
    let mut single_key = keys(KeyConstants::default(), 1000.0, vec![]);
    for _ in 0..500 {
        single_key.step(&push(5.0));
    }
    assert_eq!(single_key.positions()[0], 0.05);
    single_key.step(&push(-5.0));
    assert!(single_key.positions()[0] < 0.05);
}

#[test]
fn key_with_a_model_follows_the_model() {
    let model_row = [
        0.38, 60.0, 1.2, 0.15, 0.05, -2.5e-3, 1e-3, 0.0, 0.0, 0.0, 0.02, 180.0, 0.02,
    ];
    let model = KeyModel::from_row(&model_row).unwrap();
    let push_forces: Vec<f64> = (0..500u32).map(|n| f64::from(n % 37) * 0.02).collect();
    let model_path = model.path(&push_forces, 1000.0, None).unwrap();
    let mut single_key = keys(KeyConstants::default(), 1000.0, vec![])
        .with_model(&model)
        .unwrap();
    for (force, x) in push_forces.iter().zip(model_path) {
        assert_eq!(single_key.positions()[0], x);
        single_key.step(&push(*force));
    }
    // A key that moves by a model also stops at its end.
    (0..2000).for_each(|_| single_key.step(&push(20.0)));
    assert_eq!(single_key.positions()[0], 0.05);
}

#[test]
fn hash_differs_with_the_path() {
    let hash_after = |force: f64| {
        let mut single_key = keys(KeyConstants::default(), 1000.0, vec![]);
        for _ in 0..100 {
            single_key.step(&push(force));
        }
        single_key.hash()
    };
    assert_eq!(hash_after(0.1), hash_after(0.1));
    assert_ne!(hash_after(0.1), hash_after(0.1 + 1e-12));
}

#[test]
fn wrong_key_models_are_refused() {
    let refused = |key, rate| EmulatedKeys::new(1, key, rate, vec![]).is_err();
    let default_key = KeyConstants::default();
    assert!(refused(
        KeyConstants {
            mass: 0.0,
            ..default_key
        },
        1000.0
    ));
    assert!(refused(
        KeyConstants {
            damping: f64::NAN,
            ..default_key
        },
        1000.0
    ));
    assert!(refused(default_key, 0.0));
    let fast_key = KeyConstants {
        stiffness: 1e9,
        ..default_key
    };
    assert!(refused(fast_key, 1000.0));
    assert!(EmulatedKeys::new(17, default_key, 1000.0, vec![]).is_err());
}
