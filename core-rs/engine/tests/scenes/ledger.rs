//! The ledger closes to rounding for every kind of link, open and gated, on free and imposed points.

use super::scene::{LENGTH, LINKS, Scene, options};
use ergon_engine::simulation::{Energy, OnFault};
use proptest::prelude::*;

fn ledger(scene: &Scene) -> Energy {
    let mut simulation = scene.simulation(options(OnFault::Stop));
    simulation.skip((LENGTH * simulation.rate()) as u64).unwrap();
    simulation.energy().unwrap()
}

#[test]
fn energy_ledger_closes_for_all_kinds_of_link() {
    for kind in 0..LINKS {
        for gated in [false, true] {
            for imposed in [false, true] {
                let mut scene = Scene::new(44_100.0, kind as u64);
                let (a, b) = (scene.bell(0), scene.bell(1));
                let link = scene.link(kind, a, b);
                if imposed {
                    scene.moved_point(a);
                }
                let (network, timeline) = (&scene.network, &mut scene.timeline);
                if gated {
                    timeline.couple(network, link, 0.05, Some(0.12)).unwrap();
                }
                for (instant, impulse) in [(0.01, 3e-3), (0.06, -4e-3), (0.11, 4e-3)] {
                    timeline.strike(network, b, instant, impulse, Some(0.0), 0).unwrap();
                }
                let energy = ledger(&scene);
                assert!(energy.flow > 1e-5, "{energy:?}");
                assert!(
                    energy.residual.abs() <= 1e-12 * energy.flow,
                    "kind {kind}, gated {gated}, imposed {imposed}: {energy:?}"
                );
                // Without a gate, an exact contact creates no energy.
                if [4, 6].contains(&kind) && !gated {
                    assert!(energy.produced.abs() <= 1e-9 * energy.flow, "{energy:?}");
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn energy_ledger_closes_for_random_scenes(seed in any::<u64>()) {
        let energy = ledger(&Scene::random(seed));
        prop_assert!(energy.residual.abs() <= 1e-11 * energy.flow, "{energy:?}");
    }
}
