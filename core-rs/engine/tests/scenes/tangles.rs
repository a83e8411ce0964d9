//! Points tied to each other, to a bell and to the ground: results that must not depend on blocks, plans or the
//! reference frame.

use std::sync::Arc;

use super::blocks::play;
use super::scene::options;
use super::space::{RATE, cross, hear, link, momenta, norm, point, start};
use ergon_engine::chance::Chance;
use ergon_engine::maths::{cos, sin};
use ergon_engine::network::{Network, SpaceLaw, SpacePoint, Tie};
use ergon_engine::plan::{Budget, Plan};
use ergon_engine::simulation::{Energy, OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;
use proptest::prelude::*;

/// Points tied to each other by springs and contacts, to a bell by a spring along one axis, and to the ground.
fn tangle(seed: u64) -> (Network, Timeline, Vec<f64>) {
    let mut chance = Chance::new(i128::from(seed), "space", "tangle", 0, 0);
    let mut draw = |low: f64, high: f64| chance.uniform(low, high);
    let mut network = Network::new();
    network.part("tangle", None);
    let n = 5;
    let masses: Vec<f64> = (0..n).map(|_| draw(2e-3, 2e-2)).collect();
    let points: Vec<SpacePoint> = (0..n)
        .map(|i| {
            let x0 = std::array::from_fn(|_| draw(-0.05, 0.05));
            let v0 = std::array::from_fn(|_| draw(-0.5, 0.5));
            point(&mut network, &format!("m{i}"), masses[i], x0, v0)
        })
        .collect();
    let length = |network: &Network, a: SpacePoint, b: SpacePoint| {
        let x0 = &network.mats().x0;
        let apart: Vec<f64> = (0..3).map(|axis| x0[a.first + axis] - x0[b.first + axis]).collect();
        norm(&apart)
    };
    for i in 0..n {
        for j in 0..i {
            let ends = (points[j], points[i]);
            let rest = length(&network, ends.0, ends.1) * draw(0.7, 1.3);
            match (i + j) % 3 {
                0 => {
                    let numbers = [draw(50.0, 500.0), draw(0.0, 0.05), rest];
                    link(&mut network, ends, SpaceLaw::Spring, numbers)
                }
                1 => {
                    let (exponent, is_clamped) = (1.0 + 0.5 * f64::from(u8::from(i % 2 == 0)), true);
                    let law = SpaceLaw::Contact { exponent, is_clamped };
                    link(&mut network, ends, law, [2e3, 0.02, 0.6 * rest])
                }
                _ => {
                    let core = draw(0.01, 0.05);
                    let numbers = [draw(20.0, 200.0), 0.0, 0.0];
                    link(&mut network, ends, SpaceLaw::Attraction { core }, numbers)
                }
            };
        }
    }
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    let tie = Tie::Tuned {
        f: 210.0,
        t60: Some(0.3),
    };
    network.part("bell", None);
    let bell = network.cel("m", 0.01, tie, 0.0, 0.0, 0.0).unwrap();
    network
        .spring("thread", bell, points[0].first + 1, 300.0, 0.01, 0.0)
        .unwrap();
    hear(&mut network, "bell", bell);
    hear(&mut network, "z", points[n - 1].first + 2);
    let weighed = points[0].first..points[n - 1].first + 3;
    for at in weighed.skip(2).step_by(3) {
        network.set_gravity(at..at + 1, -9.81).unwrap();
    }
    timeline
        .strike(&network, points[2].first, 0.01, 2e-3, Some(0.0), 0)
        .unwrap();
    timeline.strike(&network, bell, 0.02, 1e-3, Some(0.0), 0).unwrap();
    (network, timeline, masses)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn energy_ledger_of_tangles_closes(seed in any::<u64>()) {
        let (network, timeline, _) = tangle(seed);
        let mut simulation = start(network, &timeline);
        simulation.skip(8_000).unwrap();
        let energy: Energy = simulation.energy().unwrap();
        prop_assert!(energy.flow > 1e-4);
        prop_assert!(energy.residual.abs() <= 1e-11 * energy.flow, "{energy:?}");
    }

    #[test]
    fn tangles_in_blocks_plans_and_snapshots_bitwise(seed in any::<u64>()) {
        let (network, timeline, _) = tangle(seed);
        let n = 4_000;
        let mut whole = start(network.clone(), &timeline);
        let sound = play(&mut whole, n, &[n]);
        let mut split = start(network.clone(), &timeline);
        prop_assert!(sound == play(&mut split, n, &[17, 400, 1]));
        let network = Arc::new(network);
        let plan = Plan::new(network, &timeline, &Budget::Error(-20.0), None).unwrap();
        let plan = Arc::new(plan);
        let by = |threads| SimulationOptions { threads, keeps_ledger: false, ..options(OnFault::Stop) };
        let mut one = Simulation::from_plan(plan.clone(), by(1)).unwrap();
        let mut three = Simulation::from_plan(plan, by(3)).unwrap();
        play(&mut one, n / 2, &[64]);
        let snapshot = one.snapshot();
        let rest = play(&mut one, n / 2, &[64]);
        play(&mut three, n / 2, &[33]);
        prop_assert!(rest == play(&mut three, n / 2, &[33]));
        one.restore(&snapshot);
        prop_assert!(rest == play(&mut one, n / 2, &[9]));
    }
}

/// Four points tied only to each other, in another reference frame: rotated, and drifting [m/s].
fn free(turned: impl Fn([f64; 3]) -> [f64; 3], drift: [f64; 3]) -> (Network, [f64; 4]) {
    let mut network = Network::new();
    network.part("free", None);
    let masses = [0.01, 0.004, 0.02, 0.007];
    let points: Vec<SpacePoint> = (0..4)
        .map(|i| {
            let position = |axis: usize| 0.03 * sin((3 * i + axis * 7 + 1) as f64);
            let x0 = turned(std::array::from_fn(position));
            let v0 = turned(std::array::from_fn(|axis| 20.0 * position(axis + 2)));
            let v0 = std::array::from_fn(|axis| v0[axis] + drift[axis]);
            point(&mut network, &format!("m{i}"), masses[i], x0, v0)
        })
        .collect();
    for i in 0..4 {
        for j in 0..i {
            let (law, numbers) = if j == 0 {
                (SpaceLaw::Attraction { core: 0.02 }, [800.0, 0.0, 0.0])
            } else {
                (SpaceLaw::Spring, [800.0, 0.03, 0.04])
            };
            link(&mut network, (points[i], points[j]), law, numbers);
        }
    }
    let bounce = SpaceLaw::Contact {
        exponent: 1.5,
        is_clamped: true,
    };
    let ends = (points[0], points[3]);
    link(&mut network, ends, bounce, [2e3, 0.05, 0.03]);
    (network, masses)
}

/// Without links to anything else, momentum and angular momentum are conserved.
#[test]
fn free_tangle_conserves_its_momenta() {
    let (network, masses) = free(|x| x, [0.0; 3]);
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let mut simulation = start(network, &timeline);
    let before = momenta(&simulation, &masses);
    simulation.skip(40_000).unwrap();
    let after = momenta(&simulation, &masses);
    for (before, after) in before.iter().zip(&after) {
        let apart: Vec<f64> = before.iter().zip(after).map(|(a, b)| a - b).collect();
        assert!(norm(&apart) < 1e-12 * norm(before), "{before:?} became {after:?}");
    }
}

/// In a rotated or moving reference frame the motion is the same, up to rounding.
#[test]
fn free_tangle_in_rotated_and_moving_frames() {
    // Rotation about (1, 2, 2)/3 by 1 rad (Rodrigues).
    let (c, s, k) = (cos(1.0), sin(1.0), [1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0]);
    let turned = |x: [f64; 3]| -> [f64; 3] {
        let (across, along) = (cross(k, x), k[0] * x[0] + k[1] * x[1] + k[2] * x[2]);
        std::array::from_fn(|i| c * x[i] + s * across[i] + (1.0 - c) * along * k[i])
    };
    let n_frames = 4_000;
    let motion = |network: Network| -> Vec<f64> {
        let timeline = Timeline::new(Rate::new(RATE).unwrap());
        let mut simulation = start(network, &timeline);
        simulation.skip(n_frames).unwrap();
        simulation.positions().to_vec()
    };
    let plain = motion(free(|x| x, [0.0; 3]).0);
    let (drift, t) = ([0.7, -2.0, 1.3], n_frames as f64 / RATE);
    let aslant = motion(free(turned, [0.0; 3]).0);
    let riding = motion(free(|x| x, drift).0);
    let started = free(|x| x, [0.0; 3]).0.mats().x0.clone();
    for i in 0..4 {
        let single = |all: &[f64]| -> [f64; 3] { std::array::from_fn(|axis| all[3 * i + axis]) };
        let from_there = turned(single(&plain));
        for axis in 0..3 {
            assert!((single(&aslant)[axis] - from_there[axis]).abs() < 1e-12);
            let along = single(&riding)[axis] - t * drift[axis];
            assert!((along - single(&plain)[axis]).abs() < 1e-12);
        }
        let moved: Vec<f64> = (0..3)
            .map(|axis| single(&plain)[axis] - single(&started)[axis])
            .collect();
        assert!(norm(&moved) > 1e-3, "{moved:?}");
    }
}
