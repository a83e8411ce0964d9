//! Real hands: positions in, forces out, by ticks.

use std::sync::Arc;

use ergon_engine::cell::Cell;
use ergon_engine::network::{But, Network, Side, Term, Tie};
use ergon_engine::plan::{Budget, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::{DriveKind, DriveSource, HandInterpolation, Timeline};
use ergon_engine::units::Rate;

use super::scene::options;

const RATE: f64 = 44_100.0;
const KEY: usize = 0;

/// A key that strikes a chain of twelve masses, which is heard at its far end.
fn scene(side: Side) -> Network {
    let mut network = Network::new();
    network.part("key", None);
    let tie = Tie::Physical { k: 60.0, z: 1.2 };
    network.cel("m", 0.4, tie, 0.0, 0.0, 0.0).unwrap();
    network.part("string", None);
    for i in 0..12 {
        let (k, z) = if i == 0 || i == 11 { (4e3, 2e-3) } else { (0.0, 0.0) };
        let tie = Tie::Physical { k, z };
        network.cel(&format!("s{i}"), 2e-3, tie, 0.0, 0.0, 0.0).unwrap();
    }
    for i in 1..12 {
        network.spring("l", i, i + 1, 2e4, 5e-3, 0.0).unwrap();
    }
    let but = But {
        side,
        ..But::plain(4e3, 0.1, 1e-3)
    };
    network.but("b", KEY, 4, but).unwrap();
    let point = |first, len, weight| Term::Position { first, len, weight };
    network.listen("out", vec![point(9, 1, 1.0)]).unwrap();
    network
}

fn plain() -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    }
}

fn rate() -> Rate {
    Rate::new(RATE).unwrap()
}

/// Up and down five times in a second, 3 mm either way.
fn wave(n: usize, per_second: f64) -> Vec<f64> {
    (0..n)
        .map(|k| 2e-3 + 3e-3 * ergon_engine::maths::sin(2.0 * std::f64::consts::PI * 5.0 * k as f64 / per_second))
        .collect()
}

fn planned(network: &Arc<Network>, timeline: &Timeline, budget: &Budget) -> Simulation {
    let plan = Plan::new(network.clone(), timeline, budget, None).unwrap();
    Simulation::from_plan(Arc::new(plan), plain()).unwrap()
}

/// A performance tick by tick, as from a device, and a render of its recording give the same samples and forces, for
/// every block size and plan.
#[test]
fn recording_renders_to_the_played_samples() {
    let network = Arc::new(scene(Side::Below));
    let every = 44;
    let ticks = wave(500, RATE / f64::from(every));
    for budget in [
        Budget::default(),
        Budget::Error(-80.0),
        Budget::Method(ergon_engine::plan::Method::Ca),
    ] {
        let mut open = Timeline::new(rate());
        open.add_hand(&network, KEY, every, HandInterpolation::Line, &[])
            .unwrap();
        let mut live = planned(&network, &open, &budget);
        let (mut played, mut forces) = (Vec::new(), Vec::new());
        for &x in &ticks {
            live.set_hand_position(0, x, None);
            let mut out = vec![0.0; every as usize];
            live.process(&mut out).unwrap();
            played.extend(out);
            forces.push(live.hand_force(0));
        }
        assert!(forces.iter().any(|f| *f < -0.1), "the hand feels the string");
        assert!(played.iter().any(|x| x.abs() > 1e-5), "the string is heard");
        let mut known = Timeline::new(rate());
        known
            .add_hand(&network, KEY, every, HandInterpolation::Line, &ticks)
            .unwrap();
        for block in [1, 44, 997] {
            let mut again = planned(&network, &known, &budget);
            let mut out = vec![0.0; played.len()];
            out.chunks_mut(block).for_each(|out| again.process(out).unwrap());
            assert!(out == played, "{budget:?}, blocks of {block}");
            assert_eq!(again.hand_force(0).to_bits(), forces[forces.len() - 1].to_bits());
        }
    }
}

/// A key in one process and a scene in another, with ticks of one frame, give the bits of the key in the scene.
#[test]
fn key_in_another_simulation_equals_key_in_scene() {
    let network = Arc::new(scene(Side::Below));
    let push = 2.0;
    // The whole network; a constant force pushes the key until it strikes.
    let n_frames = 4_000;
    let mut first = Timeline::new(rate());
    first
        .drive(KEY, DriveKind::Force, DriveSource::Constant(push), true)
        .unwrap();
    let mut complete = Simulation::new(network.clone(), &first, plain()).unwrap();
    // The scene without the key, and the key alone.
    let mut open = Timeline::new(rate());
    open.add_hand(&network, KEY, 1, HandInterpolation::Line, &[]).unwrap();
    let mut apart = Simulation::new(network.clone(), &open, plain()).unwrap();
    let ratios = Cell::new(0.4, 60.0, 1.2).ratios(rate());
    let w = rate().step() * rate().step() / 0.4;
    let (mut x, mut d) = (
        0.0_f64,
        Cell::new(0.4, 60.0, 1.2).last_step(0.0, 0.0, 0.0, rate()) - 0.5 * w * push,
    );
    let mut touched = false;
    for n in 0..n_frames {
        apart.set_hand_position(0, x, Some(d));
        let (mut a, mut b) = ([0.0], [0.0]);
        complete.process(&mut a).unwrap();
        apart.process(&mut b).unwrap();
        let forces = apart.hand_force(0);
        touched |= forces != 0.0;
        d += (push + forces) * w - ratios.kappa * x - ratios.zeta * d;
        x += d;
        assert_eq!(a[0].to_bits(), b[0].to_bits(), "sound at {n}");
        assert_eq!(complete.positions()[KEY].to_bits(), x.to_bits(), "key at {n}");
    }
    assert!(touched);
}

/// A force at frame n moves the key at n + 1, its reaction acts at n + 1, and the struck mass moves at n + 2.
#[test]
fn structural_latency_is_one_sample() {
    let network = Arc::new(scene(Side::Below));
    let mut open = Timeline::new(rate());
    open.add_hand(&network, KEY, 1, HandInterpolation::Line, &[]).unwrap();
    let mut scene = Simulation::new(network, &open, plain()).unwrap();
    let mut x = vec![0.0; 1];
    scene.process(&mut x).unwrap();
    assert_eq!(scene.hand_force(0), 0.0);
    // Frame 1: the hand is at 2 mm, a millimetre into the contact.
    scene.set_hand_position(0, 2e-3, None);
    scene.process(&mut x).unwrap();
    assert!(scene.hand_force(0) < 0.0, "felt in the same frame");
    assert!(scene.positions()[4] > 0.0, "frame 2: the struck mass has moved");
}

/// Two hands joined by a spring that no output hears: each feels the other.
#[test]
fn hands_feel_each_other_through_a_spring() {
    let mut network = Network::new();
    network.part("keys", None);
    let tie = Tie::Physical { k: 60.0, z: 1.2 };
    network.cel("a", 0.4, tie, 0.0, 0.0, 0.0).unwrap();
    network.cel("b", 0.4, tie, 0.0, 0.0, 0.0).unwrap();
    network.spring("r", 0, 1, 120.0, 0.0, 0.0).unwrap();
    let network = Arc::new(network);
    let mut timeline = Timeline::new(rate());
    for mat in [0, 1] {
        timeline
            .add_hand(&network, mat, 44, HandInterpolation::Hold, &[])
            .unwrap();
    }
    let mut duet = planned(&network, &timeline, &Budget::default());
    duet.set_hand_position(0, 10e-3, None);
    duet.skip(44).unwrap();
    assert!((duet.hand_force(1) - 1.2).abs() < 1e-12, "{}", duet.hand_force(1));
    assert!((duet.hand_force(0) + 1.2).abs() < 1e-12);
}
