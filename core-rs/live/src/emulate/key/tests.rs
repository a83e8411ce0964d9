use std::sync::Arc;

use ergon_engine::maths;
use ergon_engine::network::{Network, Tie};
use ergon_engine::simulation::{OnFault, Options, Simulation};
use ergon_engine::timeline::Timeline;

use super::*;

fn keys(key: Key, rate: f64, hands: Vec<Hand>) -> Keys {
    Keys::new(1, key, rate, hands).unwrap()
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
    let rate = 44_100.0 / 44.0;
    let key = Key {
        mass: 0.08,
        stiffness: 200.0,
        damping: 0.9,
        range: [-1.0, 1.0],
    };
    let tie = Tie::Physical {
        k: key.stiffness,
        z: key.damping,
    };
    let mut network = Network::new();
    let cel = network.cel("key", key.mass, tie, 0.0, 0.0, 0.0).unwrap();
    let other = network.mas("other", 0.05, 0.0, 1.5).unwrap();
    let k = 120.0;
    network.spring("tie", cel, other, k, 0.0, 0.0).unwrap();
    let options = Options {
        ledger: false,
        record: false,
        on_fault: OnFault::Stop,
        threads: 1,
        unchecked: false,
    };
    let timeline = Timeline::new(Rate::new(rate).unwrap());
    let mut complete = Simulation::new(Arc::new(network), &timeline, options).unwrap();
    let mut key = keys(key, rate, vec![]);
    let mut moved: f64 = 0.0;
    for frame in 0..4000 {
        let x = complete.positions();
        assert_eq!(x[cel].to_bits(), key.positions()[0].to_bits(), "{frame}");
        moved = moved.max(x[cel].abs());
        key.step(&push(k * (x[other] - x[cel])));
        complete.skip(1).unwrap();
    }
    assert!(moved > 1e-3, "{moved}");
}

/// A hand is a spring and a damper to a moving point; for a point that stands still, the motion is compared with the
/// closed solution.
#[test]
fn hand_on_path_pulls_as_a_damped_spring() {
    let rate = 10_000.0;
    let (mass, stiffness, damping, to) = (0.05, 300.0, 2.0, 0.01);
    let hand = Hand::OnPath {
        path: vec![to; 2_000],
        stiffness,
        damping,
    };
    let key = Key {
        mass,
        stiffness: 0.0,
        damping: 0.0,
        range: [-1.0, 1.0],
    };
    let mut key = keys(key, rate, vec![hand]);
    let (sigma, squared) = (0.5 * damping / mass, stiffness / mass);
    let omega = maths::sqrt(squared - sigma * sigma);
    for n in 1..=2000 {
        key.step(&push(0.0));
        let t = f64::from(n) / rate;
        let (sin, cos) = maths::sincos(omega * t);
        let x = to * (1.0 - maths::exp(-sigma * t) * (cos + sigma / omega * sin));
        // A damper by backward differences is half a period late, and so is the first step.
        assert!(
            (key.positions()[0] - x).abs() < 0.02 * to,
            "{n}: {} {x}",
            key.positions()[0]
        );
    }
    assert!(!key.touched(0), "it has let go");
}

#[test]
fn touched_of_free_and_resting_hands() {
    for (hand, touched) in [(Hand::Free, false), (Hand::Resting, true)] {
        let mut key = keys(Key::default(), 1000.0, vec![hand]);
        assert_eq!(key.touched(0), touched);
        key.step(&push(0.0));
        assert_eq!(key.positions()[0], 0.0);
    }
}

#[test]
fn key_stops_at_its_travel() {
    let mut key = keys(Key::default(), 1000.0, vec![]);
    for _ in 0..500 {
        key.step(&push(5.0));
    }
    assert_eq!(key.positions()[0], 0.05);
    key.step(&push(-5.0));
    assert!(key.positions()[0] < 0.05);
}

#[test]
fn key_with_a_model_follows_the_model() {
    let row = [
        0.38, 60.0, 1.2, 0.15, 0.05, -2.5e-3, 1e-3, 0.0, 0.0, 0.0, 0.02, 180.0, 0.02,
    ];
    let model = KeyModel::from_row(&row).unwrap();
    let forces: Vec<f64> = (0..500u32).map(|n| f64::from(n % 37) * 0.02).collect();
    let path = model.path(&forces, 1000.0, None).unwrap();
    let mut key = keys(Key::default(), 1000.0, vec![])
        .with_model(&model)
        .unwrap();
    for (force, x) in forces.iter().zip(path) {
        assert_eq!(key.positions()[0], x);
        key.step(&push(*force));
    }
    // A key that moves by a model also stops at its end.
    (0..2000).for_each(|_| key.step(&push(20.0)));
    assert_eq!(key.positions()[0], 0.05);
}

#[test]
fn hash_differs_with_the_path() {
    let path = |force: f64| {
        let mut key = keys(Key::default(), 1000.0, vec![]);
        for _ in 0..100 {
            key.step(&push(force));
        }
        key.hash()
    };
    assert_eq!(path(0.1), path(0.1));
    assert_ne!(path(0.1), path(0.1 + 1e-12));
}

#[test]
fn wrong_key_models_are_refused() {
    let refused = |key, rate| Keys::new(1, key, rate, vec![]).is_err();
    let usual = Key::default();
    assert!(refused(Key { mass: 0.0, ..usual }, 1000.0));
    assert!(refused(
        Key {
            damping: f64::NAN,
            ..usual
        },
        1000.0
    ));
    assert!(refused(usual, 0.0));
    let fast = Key {
        stiffness: 1e9,
        ..usual
    };
    assert!(refused(fast, 1000.0));
    assert!(Keys::new(17, usual, 1000.0, vec![]).is_err());
}
