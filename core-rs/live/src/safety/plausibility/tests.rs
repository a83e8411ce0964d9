//! Faults of a board, each within its time and its way; and hands that play, whom nothing may stop.

use super::Trip;
use super::played::{Grip, HAND, Key, Play, Scene};

const FINE: f64 = 1e-5;

/// What a fault did.
#[derive(Debug)]
struct Harm {
    /// How long there was a force after it [ms].
    lasted: f64,
    /// How far the key went beyond where the scene or the hand alone would have taken it [mm].
    travel: f64,
    why: Option<Trip>,
}

/// A fault at an instant of a play, beside the same without it, and without any force from then on.
fn harm(fault: fn(&mut Key), at: f64, grip: Option<Grip>, scene: Scene) -> Harm {
    let play = || {
        let mut play = Play::new(Key::new(FINE, 20.0, Some(0.05)), scene);
        play.key().grip = grip;
        play.until(at);
        assert!(play.trips.is_empty(), "{:?}", play.trips);
        play
    };
    let (mut whole, mut free, mut faulty) = (play(), play(), play());
    fault(faulty.key());
    free.key().motor = 0.0;
    let (mut lasted, mut travel) = (0.0, 0.0_f64);
    while faulty.time() < at + 1.5 && (lasted == 0.0 || faulty.time() < at + lasted + 0.3) {
        for play in [&mut whole, &mut free, &mut faulty] {
            play.tick();
        }
        if faulty.sent != 0.0 {
            lasted = faulty.time() - at;
        }
        let (a, b, x) = (whole.key().x, free.key().x, faulty.key().x);
        travel = travel.max(x - a.max(b)).max(a.min(b) - x);
    }
    let why = faulty.trips.first().map(|trip| trip.1);
    Harm {
        lasted: 1e3 * lasted,
        travel: 1e3 * travel,
        why,
    }
}

const SINE: Grip = Grip {
    at: |t| 5e-3 * libm::sin(6.283 * t),
    ..HAND
};

#[test]
fn table() {
    let reversed: fn(&mut Key) = |key| key.motor = -1.0;
    let frozen: fn(&mut Key) = |key| key.frozen = true;
    let springs: [(&str, Scene); 5] = [
        ("200 N/m to 3 mm", |_, x, _| 200.0 * (3e-3 - x)),
        ("500 N/m to 3 mm", |_, x, _| 500.0 * (3e-3 - x)),
        ("800 N/m to 3 mm", |_, x, _| 800.0 * (3e-3 - x)),
        ("1500 N/m to 1 mm", |_, x, v| 1500.0 * (1e-3 - x) - v),
        ("200 N/m to a key that goes 8 mm", |t, x, _| 200.0 * (8e-3 * libm::sin(12.0 * t) - x)),
    ];
    for (fault, name) in [(reversed, "reversed"), (frozen, "frozen")] {
        for (grip, hand) in [(Some(HAND), "still"), (Some(SINE), "sine"), (None, "nobody")] {
            for (scene, way) in springs.iter().map(|(a, b)| (b, a)) {
                for at in [3.0, 3.1, 3.25] {
                    let Harm { lasted, travel, why } = harm(fault, at, grip, *scene);
                    println!("{name:9} {hand:7} {way:33} {at}: {lasted:7.1} ms {travel:6.2} mm {why:?}");
                }
            }
        }
    }
}
