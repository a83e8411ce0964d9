//! Springs in space that yield and break.

use std::sync::Arc;

use super::blocks::play;
use super::scene::options;
use super::space::{RATE, link, point, start};
use ergon_engine::maths::sin;
use ergon_engine::network::{Network, SpaceLaw, SpacePoint, SpacePoints, Term};
use ergon_engine::plan::{Budget, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

/// A point moves away from a fixed one at a constant speed; returns the force of the link, frame by frame.
fn pulled(law: SpaceLaw, far: f64) -> (Simulation, Vec<f64>) {
    let (k, rest) = (1_000.0, 0.1);
    let mut network = Network::new();
    network.part("wire", None);
    let held = point(&mut network, "a", 0.0, [0.0; 3], [0.0; 3]);
    // Heavy enough that the link hardly slows it.
    let ball = point(&mut network, "b", 1e6, [rest, 0.0, 0.0], [far, 0.0, 0.0]);
    let wire = link(&mut network, (held, ball), law, [k, 0.0, rest]);
    let (len, weight) = (1, -1.0);
    let term = Term::Force {
        first: wire,
        len,
        weight,
    };
    network.listen("force", vec![term]).unwrap();
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let mut simulation = start(network, &timeline);
    let mut force = vec![0.0; 44_100];
    simulation.process(&mut force).unwrap();
    (simulation, force)
}

#[test]
fn yielding_link_yields_and_breaks() {
    let endless = f64::INFINITY;
    // The link grows by 20 mm in a second: at 1 N/mm the final force is 20 N, if nothing yields.
    let (_, force) = pulled(SpaceLaw::Spring, 0.02);
    assert!((force[44_099] - 20.0).abs() < 1e-2);
    let (yields, breaks) = (5.0, endless);
    let (simulation, force) = pulled(
        SpaceLaw::Yielding {
            yield_force: yields,
            break_elongation: breaks,
        },
        0.02,
    );
    let limit = force.iter().copied().fold(0.0, f64::max);
    assert!((limit - 5.0).abs() < 1e-9 && (force[44_099] - 5.0).abs() < 1e-9);
    let energy = simulation.energy().unwrap();
    // 5 N along 15 mm.
    assert!((energy.lost - 0.075).abs() < 1e-4, "{energy:?}");
    assert!(energy.residual.abs() < 1e-11 * energy.flow, "{energy:?}");
    let (yields, breaks) = (endless, 8e-3);
    let (simulation, force) = pulled(
        SpaceLaw::Yielding {
            yield_force: yields,
            break_elongation: breaks,
        },
        0.02,
    );
    let broken = 1 + force.iter().rposition(|&force| force != 0.0).unwrap();
    assert!((broken as f64 / RATE - 0.4).abs() < 1e-3, "{broken}");
    assert!((force[broken - 1] - 8.0).abs() < 1e-3);
    let energy = simulation.energy().unwrap();
    // The energy of the broken link, ½·8 N·8 mm, is lost.
    assert!((energy.lost - 0.032).abs() < 1e-4, "{energy:?}");
    assert!(energy.residual.abs() < 1e-11 * energy.flow, "{energy:?}");
}

/// A row that is thrown apart, so that some of its links break; each mass is heard. `is_more`: a weight hangs on it.
fn torn_row(is_more: bool) -> Network {
    let law = SpaceLaw::Yielding {
        yield_force: 0.8,
        break_elongation: 4e-3,
    };
    let mut network = Network::new();
    network.part("net", None);
    let n = 8;
    let x0: Vec<f64> = (0..3 * n)
        .map(|position| {
            if position < n {
                0.02 * position as f64
            } else {
                1e-3 * sin(position as f64)
            }
        })
        .collect();
    let mut v0 = vec![0.0; 3 * n];
    (v0[0], v0[n - 1], v0[2 * n + 4]) = (-4.0, 5.0, 2.0);
    let masses = vec![2e-3; n];
    let points = SpacePoints {
        n_axes: 3,
        masses: &masses,
        x0: &x0,
        v0: &v0,
        z: 0.0,
    };
    let first = network.points("m", true, points).unwrap();
    let ends = [first, first + 1].map(|first| SpacePoint::strided(first, n));
    network
        .space_links("s", (ends[0], ends[1]), n - 1, 3, law, [400.0, 0.01, 0.02])
        .unwrap();
    for link in 0..n - 1 {
        let (len, weight) = (1, 1.0);
        let term = Term::Force {
            first: link,
            len,
            weight,
        };
        network.listen(&format!("f{link}"), vec![term]).unwrap();
    }
    if is_more {
        let weight = point(&mut network, "w", 1e-3, [0.0, 0.1, 0.0], [0.0; 3]);
        let end = SpacePoint::strided(first, n);
        link(&mut network, (end, weight), SpaceLaw::Spring, [20.0, 0.0, 0.1]);
    }
    network
}

/// A net that is stretched by its own motion until it tears: the ledger closes, and broken links stay broken and never
/// pull.
#[test]
fn tearing_row_closes_its_ledger() {
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let mut simulation = start(torn_row(false), &timeline);
    let n = 20_000;
    let sound = play(&mut simulation, n, &[64]);
    let energy = simulation.energy().unwrap();
    assert!(energy.lost > 1e-4, "{energy:?}");
    assert!(energy.residual.abs() < 1e-11 * energy.flow, "{energy:?}");
    let forces = |frame: usize| &sound[7 * frame..7 * (frame + 1)];
    let still = |frame: usize| forces(frame).iter().filter(|&&bits| bits << 1 == 0).count();
    assert!(still(n - 1) >= 1 && still(n - 1) < 7, "{}", still(n - 1));
    assert_eq!(still(n - 1), still(n - 5_000));
    // A snapshot contains which links are broken.
    let mut other = start(torn_row(false), &timeline);
    play(&mut other, n / 2, &[100]);
    let snapshot = other.snapshot();
    let rest = play(&mut other, n / 2, &[64]);
    assert!(rest == sound[7 * (n / 2)..]);
    simulation.restore(&snapshot);
    assert!(rest == play(&mut simulation, n / 2, &[9]));
}

/// Links that are torn stay torn when an edit changes the rest.
#[test]
fn take_over_keeps_broken_links_broken() {
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let version = |is_more| {
        let network = Arc::new(torn_row(is_more));
        Arc::new(Plan::new(network, &timeline, &Budget::Error(-20.0), None).unwrap())
    };
    let options = SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    };
    let n = 10_000;
    let mut old = Simulation::from_plan(version(false), options).unwrap();
    let before = play(&mut old, n, &[64]);
    let broken = |sound: &[u64], link: usize| {
        let end = &sound[sound.len() - 7 * 500..];
        end.iter().skip(link).step_by(7).all(|bits| bits << 1 == 0)
    };
    let torn: Vec<bool> = (0..7).map(|link| broken(&before, link)).collect();
    assert!(torn.contains(&true) && torn.contains(&false), "{torn:?}");
    let mut new = Simulation::from_plan_at_frame(version(true), options, n as u64).unwrap();
    let mut takeover = Takeover::new(&old, &new);
    assert!(new.take_over(&mut old, &mut takeover));
    let after = play(&mut new, 500, &[64]);
    for (link, torn) in torn.into_iter().enumerate() {
        assert_eq!(broken(&after, link), torn, "link {link}");
    }
}
