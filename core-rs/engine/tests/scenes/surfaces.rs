//! Points inside a surface of triangles: the ledger closes, momentum is conserved, and no point gets out.

use std::sync::Arc;

use super::pairwise::{GAP, HERTZ, LINEAR, points, rub, start};
use ergon_engine::chance::Chance;
use ergon_engine::network::{Facets, Measure, Network, PairLaw, PointGroup, SpaceLaw};
use proptest::prelude::*;

/// A cube around 0 with sides of 2·`half`: twelve triangles.
fn cube(half: f64, reach: f64) -> Facets {
    let corner = |i: usize, axis: usize| if i >> axis & 1 == 1 { half } else { -half };
    let corners: Vec<[f64; 3]> = (0..8).map(|i| std::array::from_fn(|axis| corner(i, axis))).collect();
    let sides = [
        [0, 1, 3, 2],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 3, 7, 5],
    ];
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    let triangles: Vec<[u32; 3]> = sides.into_iter().flat_map(halves).collect();
    Facets::new(&corners, &triangles, reach).unwrap()
}

const HALF: f64 = 0.03;

/// Points inside a box; `shell`: mass of the box [kg], 0 if it is fixed.
fn shaken(seed: u64, shell: f64, law: SpaceLaw, friction: f64) -> (Network, Vec<f64>) {
    let mut network = Network::new();
    network.part("box", None);
    let mut chance = Chance::new(i128::from(seed), "surface", "crowd", 0, 0);
    let n = 24;
    let masses: Vec<f64> = (0..n).map(|_| chance.uniform(1e-3, 4e-3)).collect();
    let x0: Vec<f64> = (0..3 * n).map(|_| chance.uniform(-0.02, 0.02)).collect();
    let v0: Vec<f64> = (0..3 * n).map(|_| chance.uniform(-0.4, 0.4)).collect();
    let wall = points(&mut network, "wall", 3, &[shell], [&[0.0; 3], &[0.0; 3]]);
    let single: PointGroup = points(&mut network, "m", 3, &masses, [&x0, &v0]);
    rub(
        &mut network,
        [single, single],
        3,
        (LINEAR, friction),
        [500.0, 0.03, GAP],
    );
    let reach = 0.5 * GAP;
    // Points that overlap at the start become fast: K is large enough to hold back 0.1 J.
    let stiff = if law == HERTZ { 2e5 } else { 8_000.0 };
    let what = PairLaw {
        friction,
        ..PairLaw::smooth(Measure::Surface(Arc::new(cube(HALF, reach))), law)
    };
    network
        .pairwise("walls", [wall, single], 3, what, [stiff, 0.03, reach])
        .unwrap();
    let all: Vec<f64> = std::iter::once(shell).chain(masses).collect();
    (network, all)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn surface_contacts_close_the_ledger_and_confine_points(
        seed in any::<u64>(),
        is_hertz in any::<bool>(),
        friction in prop_oneof![Just(0.0), 0.1..0.9_f64],
    ) {
        let law = if is_hertz { HERTZ } else { LINEAR };
        let (network, masses) = shaken(seed, 0.0, law, friction);
        let n = masses.len() - 1;
        let mut simulation = start(network);
        simulation.skip(6_000).unwrap();
        let energy = simulation.energy().unwrap();
        prop_assert!(energy.lost > 1e-6, "{energy:?}");
        prop_assert!(energy.residual.abs() <= 1e-11 * energy.flow, "{energy:?}");
        let x = simulation.positions();
        prop_assert!(x[3..3 + 3 * n].iter().all(|x| x.abs() < HALF));
    }

    /// A free box takes up the momentum of the points.
    #[test]
    fn surface_contacts_conserve_momentum(seed in any::<u64>(), friction in prop_oneof![Just(0.0), 0.1..0.9_f64]) {
        let (network, masses) = shaken(seed, 0.05, LINEAR, friction);
        let n = masses.len() - 1;
        let mut simulation = start(network);
        let sum = |steps: &[f64]| -> [f64; 3] {
            std::array::from_fn(|axis| {
                let own = (0..n).map(|i| masses[1 + i] * steps[3 + axis * n + i]);
                masses[0] * steps[axis] + own.sum::<f64>()
            })
        };
        let before = sum(&simulation.steps());
        simulation.skip(6_000).unwrap();
        let after = sum(&simulation.steps());
        prop_assert!(simulation.steps()[..3].iter().any(|step| *step != 0.0));
        for (before, after) in before.into_iter().zip(after) {
            prop_assert!((before - after).abs() < 1e-18, "{before} became {after}");
        }
    }
}
