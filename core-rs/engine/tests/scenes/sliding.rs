//! Dry friction across a contact, against the formulas of a block on a slope; attraction between all pairs.

use std::sync::Arc;

use super::blocks::play;
use super::pairwise::{GAP, HERTZ, LINEAR, RATE, alone, crowd, points, rub, start};
use super::scene::options;
use ergon_engine::maths::{cos, sin};
use ergon_engine::network::{Measure, Network, PairLaw, PointGroup, SpaceLaw, Term};
use ergon_engine::plan::{Budget, Method, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

const G: f64 = 9.81;
const M: f64 = 5e-3;
const K: f64 = 2e4;
const STILL: [f64; 3] = [0.0; 3];

/// A block with the speed `v0` on a slope that rises along the first axis, at the depth at which the contact carries
/// it.
fn block(angle: f64, friction: f64, v0: [f64; 3]) -> Simulation {
    let normal = [-sin(angle), 0.0, cos(angle)];
    let mut network = Network::new();
    network.part("slope", None);
    let slope = points(&mut network, "slope", 3, &[0.0], [&STILL, &STILL]);
    let above = GAP - M * G * cos(angle) / K;
    let block = points(&mut network, "block", 3, &[M], [&normal.map(|part| above * part), &v0]);
    let single = PairLaw {
        friction,
        ..PairLaw::smooth(Measure::Plane(normal), LINEAR)
    };
    // Critical damping of a spring of K with M.
    let z = 2.0 * (K * M).sqrt();
    network
        .pairwise("lies", [slope, block], 3, single, [K, z, GAP])
        .unwrap();
    let last = block.first.first + 2;
    network.set_gravity(last..last + 1, -G).unwrap();
    start(network)
}

/// Position of the block uphill [m] and sideways [m], and its speed uphill [m/s].
fn uphill(simulation: &Simulation, angle: f64) -> [f64; 3] {
    let (x, d) = (simulation.positions(), simulation.steps());
    let along = |x: &[f64]| x[3] * cos(angle) + x[5] * sin(angle);
    [along(&x), x[4], along(&d) * RATE]
}

#[test]
fn block_on_a_slope_rests_with_enough_friction() {
    for angle in [0.1, 0.4, 0.7] {
        // Enough friction to hold against the damper too, which pushes while the spring gets longer.
        let friction = 1.3 * sin(angle) / cos(angle);
        let mut simulation = block(angle, friction, STILL);
        simulation.skip(44_100).unwrap();
        let [position, beside, speed] = uphill(&simulation, angle);
        let held = -M * G * sin(angle) / K;
        assert!((position - held).abs() < 1e-6 * held.abs(), "{position} is not {held}");
        assert_eq!(beside, 0.0);
        assert!(speed.abs() < 1e-12);
        simulation.skip(441_000).unwrap();
        let creep = uphill(&simulation, angle)[0] - position;
        assert!(creep.abs() < 1e-12, "it crept by {creep}");
    }
}

#[test]
fn block_on_a_slope_slides_by_coulomb_friction() {
    for (angle, friction) in [(0.3, 0.0), (0.4, 0.1), (0.7, 0.6)] {
        let mut simulation = block(angle, friction, STILL);
        let n = 22_050;
        simulation.skip(n).unwrap();
        let seconds = n as f64 / RATE;
        let slope = sin(angle) - friction * cos(angle);
        let [position, _, speed] = uphill(&simulation, angle);
        let expected = -0.5 * G * slope * seconds * seconds;
        // Friction reaches its full level once its spring is stretched, after a micrometre.
        assert!((position / expected - 1.0).abs() < 2e-3, "{position} is not {expected}");
        assert!((speed / (-G * slope * seconds) - 1.0).abs() < 2e-3);
    }
}

#[test]
fn thrown_block_slides_straight_and_stops_by_friction() {
    let (friction, v) = (0.3, [0.6, 0.8, 0.0]);
    let mut simulation = block(0.0, friction, v);
    let seconds = 1.0 / (friction * G);
    let n = (0.9 * seconds * RATE) as u64;
    simulation.skip(n).unwrap();
    let [along, beside, speed] = uphill(&simulation, 0.0);
    assert!((beside / along - 0.8 / 0.6).abs() < 1e-9);
    let left = 1.0 - n as f64 / RATE / seconds;
    assert!((speed / 0.6 / left - 1.0).abs() < 1e-2, "{speed}");
    simulation.skip(20_000).unwrap();
    let [along, beside, speed] = uphill(&simulation, 0.0);
    let far = (along * along + beside * beside).sqrt();
    let expected = 0.5 / (friction * G);
    assert!((far / expected - 1.0).abs() < 2e-3, "{far} is not {expected}");
    assert!(speed.abs() < 1e-9);
    let energy = simulation.energy().unwrap();
    let kinetic = 0.5 * M;
    assert!((energy.lost / kinetic - 1.0).abs() < 1e-2, "{energy:?}");
    assert!(energy.residual.abs() < 1e-12 * energy.flow);
}

/// Another version takes over while the block sticks: contacts keep their memory.
#[test]
fn take_over_of_sticking_contacts_without_slip() {
    let scene = |has_bell: bool| {
        let mut network = Network::new();
        network.part("sand", None);
        let single = crowd(&mut network, "m", 3, 30, 23);
        rub(&mut network, [single, single], 3, (HERTZ, 0.6), [400.0, 0.02, GAP]);
        for first in single.first.first..single.first.first + 3 * single.n {
            let (len, weight) = (1, 1.0);
            let term = Term::Position { first, len, weight };
            network.listen(&format!("x{first}"), vec![term]).unwrap();
        }
        if has_bell {
            network.part("bell", None);
            let hit = points(&mut network, "b", 3, &[1e-3], [&[1.0; 3], &STILL]);
            rub(&mut network, [hit, single], 3, (HERTZ, 0.0), [400.0, 0.02, GAP]);
        }
        let timeline = Timeline::new(Rate::new(RATE).unwrap());
        let budget = Budget::Method(Method::Ca);
        Arc::new(Plan::new(Arc::new(network), &timeline, &budget, None).unwrap())
    };
    let options = SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    };
    let n = 900;
    let [mut old, mut alone] = [(); 2].map(|()| Simulation::from_plan(scene(false), options).unwrap());
    let mut new = Simulation::from_plan_at_frame(scene(true), options, n as u64).unwrap();
    play(&mut old, n, &[64]);
    play(&mut alone, n, &[64]);
    let mut takeover = Takeover::new(&old, &new);
    assert!(new.take_over(&mut old, &mut takeover));
    let [after, unchanged] = [&mut new, &mut alone].map(|single| play(single, 40, &[40]));
    assert!(after == unchanged);
}

/// One group with neighbour search, against one link for each pair.
#[test]
fn pairwise_friction_equals_single_links() {
    let motion = |is_listed: bool, n_axes: usize| {
        let mut network = Network::new();
        network.part("sand", None);
        let single = crowd(&mut network, "m", n_axes, 14, 11);
        let law = (HERTZ, 0.7);
        let numbers = [400.0, 0.02, GAP];
        if is_listed {
            let first = |i| PointGroup {
                first: alone(single, i),
                n: 1,
            };
            for i in 0..single.n {
                for j in i + 1..single.n {
                    rub(&mut network, [first(i), first(j)], n_axes, law.clone(), numbers);
                }
            }
        } else {
            rub(&mut network, [single, single], n_axes, law, numbers);
        }
        let mut simulation = start(network);
        simulation.skip(1_500).unwrap();
        let energy = simulation.energy().unwrap();
        (simulation.positions(), energy)
    };
    for n_axes in [2, 3] {
        let [(single, energy), (listed, other)] = [false, true].map(|is| motion(is, n_axes));
        for (single, listed) in single.iter().zip(&listed) {
            assert!((single - listed).abs() < 1e-10, "{single} is not {listed}");
        }
        assert!((energy.lost - other.lost).abs() < 1e-8 * energy.lost);
        assert!(energy.lost > 0.0);
    }
}

#[test]
fn pairwise_attraction_equals_single_links() {
    let motion = |is_listed: bool| {
        let mut network = Network::new();
        network.part("sky", None);
        let single = crowd(&mut network, "m", 3, 9, 4);
        let sun = points(&mut network, "s", 3, &[0.0], [&STILL, &STILL]);
        let law = SpaceLaw::Attraction { core: 4e-3 };
        let numbers = [20.0, 0.0, 0.0];
        if is_listed {
            let ends = (0..single.n).flat_map(|i| (i + 1..single.n).map(move |j| (i, j)));
            let mut link = |ends| {
                let name = format!("l{}", network.n_lia());
                network.space_links(&name, ends, 1, 3, law.clone(), numbers).unwrap();
            };
            ends.for_each(|(i, j)| link((alone(single, i), alone(single, j))));
            (0..single.n).for_each(|i| link((sun.first, alone(single, i))));
        } else {
            rub(&mut network, [single, single], 3, (law.clone(), 0.0), numbers);
            rub(&mut network, [sun, single], 3, (law, 0.0), numbers);
        }
        let mut simulation = start(network);
        simulation.skip(4_000).unwrap();
        let energy = simulation.energy().unwrap();
        (simulation.positions(), energy)
    };
    let [(single, energy), (listed, other)] = [false, true].map(motion);
    for (single, listed) in single.iter().zip(&listed) {
        assert!((single - listed).abs() < 1e-8, "{single} is not {listed}");
    }
    assert!(energy.residual.abs() < 1e-11 * energy.flow, "{energy:?}");
    assert!((energy.stored / other.stored - 1.0).abs() < 1e-6);
}
