//! Laws that depend on distances in space.

use std::sync::Arc;

use super::scene::options;
use super::space::{RATE, momenta, norm, point, start};
use ergon_engine::law::{Law, LawText};
use ergon_engine::maths::sin;
use ergon_engine::network::{Network, SpacePoint};
use ergon_engine::simulation::{OnFault, Simulation};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

/// A law that is infinite at d = 0, and one that dissipates.
#[test]
fn space_laws_conserve_momenta_and_close_the_ledger() {
    let law = |law: &str, damping: Option<&str>| {
        let text = LawText {
            law: Some(law),
            damping,
            ..LawText::default()
        };
        Arc::new(Law::new(&text).unwrap())
    };
    let bond = law("0.04*((0.03/d)**2 - (0.03/d)**3)", None);
    let hard = law("20*d + 1e4*d**3", Some("0.01*v"));
    let mut network = Network::new();
    network.part("free", None);
    let masses = [0.01, 0.004, 0.02, 0.007];
    let points: Vec<SpacePoint> = (0..4)
        .map(|i| {
            let position = |axis: usize| 0.03 * sin((3 * i + axis * 7 + 1) as f64);
            let x0 = std::array::from_fn(position);
            let v0 = std::array::from_fn(|axis| 10.0 * position(axis + 2));
            point(&mut network, &format!("m{i}"), masses[i], x0, v0)
        })
        .collect();
    for i in 1..4 {
        let ends = (points[0], points[i]);
        let name = format!("bond{i}");
        network.space_lnl(&name, ends, 3, bond.clone(), 0.0).unwrap();
        let ends = (points[i], points[i % 3 + 1]);
        let rest = network.distance(ends, 3);
        let name = format!("hard{i}");
        network.space_lnl(&name, ends, 3, hard.clone(), rest).unwrap();
    }
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let mut simulation = start(network, &timeline);
    let before = momenta(&simulation, &masses);
    simulation.skip(40_000).unwrap();
    let after = momenta(&simulation, &masses);
    for (before, after) in before.iter().zip(&after) {
        let apart: Vec<f64> = before.iter().zip(after).map(|(a, b)| a - b).collect();
        assert!(norm(&apart) < 1e-11 * norm(before), "{apart:?}");
    }
    let energy = simulation.energy().unwrap();
    assert!(energy.lost > 1e-5, "{energy:?}");
    assert!(energy.residual.abs() < 1e-11 * energy.flow, "{energy:?}");
    assert!(energy.produced.abs() < 0.01 * energy.flow, "{energy:?}");
}

/// At its initial length a law is as stiff as its slope along its line, and as f/ℓ across it.
#[test]
fn space_law_too_stiff_initially_is_refused() {
    let scene = |expression: &str| {
        let text = LawText {
            law: Some(expression),
            ..LawText::default()
        };
        let law = Arc::new(Law::new(&text).unwrap());
        let mut network = Network::new();
        network.part("two", None);
        let a = point(&mut network, "a", 1e-3, [0.0; 3], [0.0; 3]);
        let b = point(&mut network, "b", 1e-3, [0.01, 0.0, 0.0], [0.0; 3]);
        network.space_lnl("s", (a, b), 3, law, 0.0).unwrap();
        let timeline = Timeline::new(Rate::new(RATE).unwrap());
        Simulation::new(Arc::new(network), &timeline, options(OnFault::Stop)).is_ok()
    };
    // The limit for both ends, 4M/T² over 2, is 3.9 MN/m.
    let (near, beyond) = (1e-3 * RATE * RATE * 1.9, 1e-3 * RATE * RATE * 2.1);
    for is_across in [false, true] {
        let law = |k: f64| match is_across {
            true => format!("{k} * 0.01"),
            false => format!("{k} * (d - 0.01)"),
        };
        assert!(scene(&law(near)), "{is_across}");
        assert!(!scene(&law(beyond)), "{is_across}");
    }
}
