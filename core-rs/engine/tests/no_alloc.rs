//! A simulation does not allocate while it steps: for any scene, from its first frame on, with the ledger, and after it
//! was restored.

#[allow(dead_code)] // what the other tests ask of it
#[path = "scenes/scene.rs"]
mod scene;

use std::ops::Range;
use std::sync::Arc;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use ergon_engine::generator::{Rim, Shape, plate};
use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{Gesture, Manner};
use ergon_engine::gesture::written::{Approach, WrittenPoints};
use ergon_engine::network::{Measure, Network, PairLaw, PointGroup, SpaceLaw, SpacePoint, SpacePoints, Term, Tie};
use ergon_engine::plan::{Budget, Computation, Method, Plan};
use ergon_engine::simulation::{MotionSnapshot, OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;
use scene::{Scene, options};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

fn allocations(simulation: &mut Simulation, out: &mut [f64]) -> u32 {
    reset_violation_count();
    assert_no_alloc(|| simulation.process(out)).unwrap();
    violation_count()
}

#[test]
fn allocator_counts_violations() {
    reset_violation_count();
    drop(assert_no_alloc(|| Vec::<u8>::with_capacity(100)));
    assert!(violation_count() > 0);
}

#[test]
fn process_of_random_scenes_does_not_allocate() {
    for seed in 0..60 {
        let scene = Scene::random(seed);
        let mut simulation = scene.simulation(options(OnFault::Stop));
        let mut out = vec![0.0; scene.n_frames() * simulation.n_out()];
        let half = scene.n_frames() / 2 * simulation.n_out();
        assert_eq!(allocations(&mut simulation, &mut out[..half]), 0, "{seed}");
        let snapshot = simulation.snapshot();
        assert_eq!(allocations(&mut simulation, &mut out[half..]), 0, "{seed}");
        simulation.restore(&snapshot);
        assert_eq!(allocations(&mut simulation, &mut out[half..]), 0, "{seed} again");
    }
}

/// Looking only copies: masses, cells, modes, the strongest push of each contact, and the strikes of written hands.
#[test]
fn look_does_not_allocate() {
    look(0..4);
}

#[test]
#[ignore = "minutes: make test-long"]
fn look_at_many_scenes_does_not_allocate() {
    look(4..20);
}

fn look(seeds: Range<u64>) {
    let mut sparks = 0;
    for seed in seeds {
        let scene = Scene::random(seed);
        let network = Arc::new(scene.network.clone());
        let plan = Plan::new(network, &scene.timeline, &Budget::default(), None).unwrap();
        let options = SimulationOptions {
            keeps_ledger: false,
            ..options(OnFault::Stop)
        };
        let mut simulation = Simulation::from_plan(Arc::new(plan), options).unwrap();
        let look = simulation.make_look();
        simulation.start_watching();
        let mut snapshot = MotionSnapshot::new(&simulation, &look);
        let mut seen = false;
        let mut out = vec![0.0; scene.n_frames() * simulation.n_out()];
        for block in out.chunks_mut(100 * simulation.n_out()) {
            assert_eq!(allocations(&mut simulation, block), 0, "{seed}");
            reset_violation_count();
            assert_no_alloc(|| simulation.fill_snapshot(&look, &mut snapshot));
            assert_eq!(violation_count(), 0, "{seed}");
            assert_eq!(snapshot.frame, simulation.frame());
            seen |= snapshot.tracks.iter().any(|x| *x != 0.0);
            sparks += snapshot.sparks().len();
        }
        assert!(seen, "{seed}");
    }
    assert!(sparks > 10, "{sparks}");
}

/// A key of two masses that is computed once in ten frames, and a bell that it pulls: the key is led, thrown by grains
/// and struck.
#[test]
fn slow_key_does_not_allocate() {
    let mut network = Network::new();
    network.part("key", None);
    network.macrostep(10);
    let tie = |k, z| Tie::Physical { k, z };
    let struck = network.cel("m", 0.08, tie(200.0, 0.4), 0.0, 0.0, 0.0).unwrap();
    let inner = network.mas("n", 0.03, 0.0, 0.0).unwrap();
    network.spring("r", struck, inner, 150.0, 0.2, 0.0).unwrap();
    network.part("bell", None);
    let bell = network.cel("b", 2e-3, tie(4e3, 0.01), 0.0, 0.0, 0.0).unwrap();
    network.spring("c", struck, bell, 300.0, 0.0, 0.0).unwrap();
    let term = Term::Position {
        first: inner,
        len: 2,
        weight: 1.0,
    };
    network.listen("both", vec![term]).unwrap();
    let rate = Rate::new(44_100.0).unwrap();
    let mut timeline = Timeline::new(rate);
    let key = timeline.add_key("key", struck);
    for (start, grain) in [(0.01, None), (0.12, Some(5e-3))] {
        let t = [start, start + 0.04, start + 0.1];
        let method = [Approach::Path(Curve::Smooth); 3];
        let written = WrittenPoints {
            t: &t,
            x: &[0.0, 3e-3, 1e-3],
            approaches: &method,
            sources: &[],
        };
        let manner = Manner { grain, ..Manner::OPEN };
        let gesture = Gesture::from_points(key, &written, manner).unwrap();
        timeline.add_gesture(gesture).unwrap();
    }
    timeline.strike(&network, struck, 0.23, 0.01, Some(0.0), 0).unwrap();
    let plan = Plan::new(Arc::new(network), &timeline, &Budget::default(), None).unwrap();
    assert!(plan.rows().iter().any(|row| row.computation
        == Computation::Slow {
            macrostep: 10,
            is_exact: true
        }));
    let options = SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    };
    let mut simulation = Simulation::from_plan(Arc::new(plan), options).unwrap();
    let mut out = vec![0.0; 6_000 * simulation.n_out()];
    assert_eq!(allocations(&mut simulation, &mut out), 0);
    let snapshot = simulation.snapshot();
    assert_eq!(allocations(&mut simulation, &mut out), 0);
    simulation.restore(&snapshot);
    let then = out.clone();
    assert_eq!(allocations(&mut simulation, &mut out), 0, "again");
    assert_eq!(out, then);
}

/// One simulation takes over from another while both play any scene.
#[test]
fn take_over_does_not_allocate() {
    take_over(0..4);
}

#[test]
#[ignore = "minutes: make test-long"]
fn take_over_of_many_scenes_does_not_allocate() {
    take_over(4..100);
}

fn take_over(seeds: Range<u64>) {
    for seed in seeds {
        let scene = Scene::random(seed);
        let network = Arc::new(scene.network.clone());
        let options = SimulationOptions {
            keeps_ledger: false,
            ..options(OnFault::Stop)
        };
        let plan = Plan::new(network, &scene.timeline, &Budget::default(), None).unwrap();
        let plan = Arc::new(plan);
        let mut old = Simulation::from_plan(plan.clone(), options).unwrap();
        let position = scene.n_frames() / 3;
        let mut out = vec![0.0; position * old.n_out()];
        assert_eq!(allocations(&mut old, &mut out), 0, "{seed}");
        let mut new = Simulation::from_plan_at_frame(plan, options, position as u64).unwrap();
        let mut takeover = Takeover::new(&old, &new);
        reset_violation_count();
        assert!(assert_no_alloc(|| new.take_over(&mut old, &mut takeover)));
        assert_eq!(violation_count(), 0, "{seed}");
        assert_eq!(allocations(&mut new, &mut out), 0, "{seed}");
    }
}

/// A gong and a key at rest are tested for rest, skipped, forked, struck live, and tested again.
#[test]
fn rest_and_wake_do_not_allocate() {
    let mut network = Network::new();
    network.part("gong", None);
    let topology = plate(Shape::Hex, 6, Rim::Fixed).unwrap();
    let gong = network.mesh("p", &topology, 0.3, 120.0, Some(1.0), 1e11).unwrap();
    network.part("key", None);
    let tie = Tie::Physical { k: 60.0, z: 1.2 };
    let key = network.cel("m", 0.4, tie, 0.0, 0.0, 0.0).unwrap();
    let but = ergon_engine::network::But::plain(4e3, 0.1, 1e-3);
    network.but("b", key, gong + 40, but).unwrap();
    let (first, len, weight) = (gong + 3, 1, 1.0);
    let term = Term::Position { first, len, weight };
    network.listen("gong", vec![term]).unwrap();
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    timeline.open();
    timeline.add_key("key", key);
    timeline.add_strike_point(&network, gong + 30, 7, None).unwrap();
    let network = Arc::new(network);
    for budget in [Budget::default(), Budget::Method(Method::Ca)] {
        let plan = Plan::new(network.clone(), &timeline, &budget, None).unwrap();
        let options = SimulationOptions {
            keeps_ledger: false,
            ..options(OnFault::Stop)
        };
        let mut simulation = Simulation::from_plan(Arc::new(plan), options).unwrap();
        let mut out = vec![0.0; 10_000];
        assert_eq!(allocations(&mut simulation, &mut out), 0);
        let passed = simulation.steps_at_rest();
        assert!(passed > 0, "it rests");
        for mut going in [simulation.fork(), simulation] {
            assert_eq!(allocations(&mut going, &mut out), 0);
            assert!(going.steps_at_rest() > passed, "it goes on resting");
            reset_violation_count();
            assert_no_alloc(|| going.strike(7, 1e-3));
            assert_eq!(violation_count(), 0);
            let passed = going.steps_at_rest();
            let mut out = vec![0.0; 50_000];
            assert_eq!(allocations(&mut going, &mut out), 0);
            assert_eq!(going.steps_at_rest(), passed, "it is awake");
            assert!(out.iter().any(|x| *x != 0.0));
            // It decays by 60 dB in a second.
            let mut out = vec![0.0; 100_000];
            assert_eq!(allocations(&mut going, &mut out), 0);
            if let Budget::Cents { .. } = budget {
                assert!(going.steps_at_rest() > passed, "it sleeps");
            }
        }
    }
}

/// A gong is struck so hard that frames are computed in finer steps: for many frames, in a fork, and across a takeover.
#[test]
fn finer_frames_do_not_allocate() {
    let mut network = Network::new();
    network.part("gong", None);
    let topology = plate(Shape::Hex, 6, Rim::Fixed).unwrap();
    network.mesh("p", &topology, 0.3, 120.0, Some(1.0), 1e11).unwrap();
    let (first, len, weight) = (3, 1, 1.0);
    let term = Term::Position { first, len, weight };
    network.listen("gong", vec![term]).unwrap();
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    timeline.open();
    timeline.strike(&network, 5, 0.0, 1.0, Some(0.0), 0).unwrap();
    let network = Arc::new(network);
    for method in [Method::Ca, Method::Ca2p] {
        let budget = Budget::Method(method);
        let plan = Plan::new(network.clone(), &timeline, &budget, None).unwrap();
        let plan = Arc::new(plan);
        let options = SimulationOptions {
            keeps_ledger: false,
            ..options(OnFault::Stop)
        };
        let mut old = Simulation::from_plan(plan.clone(), options).unwrap();
        let mut out = vec![0.0; 100];
        assert_eq!(allocations(&mut old, &mut out), 0);
        let mut fork = old.fork();
        let mut new = Simulation::from_plan_at_frame(plan, options, 100).unwrap();
        let mut takeover = Takeover::new(&old, &new);
        reset_violation_count();
        assert!(assert_no_alloc(|| new.take_over(&mut old, &mut takeover)));
        assert_eq!(violation_count(), 0);
        for mut going in [new, fork.fork()] {
            assert_eq!(allocations(&mut going, &mut out), 0);
            reset_violation_count();
            assert_eq!(assert_no_alloc(|| going.n_finer()), 1);
            assert_eq!(violation_count(), 0);
            assert!(going.finer_parts()[0].1 > 100);
        }
        assert_eq!(allocations(&mut fork, &mut out), 0);
    }
}

/// The same when the method of a body changes at a takeover: modes to other modes, modes to masses, and back.
#[test]
fn take_over_with_another_method_does_not_allocate() {
    let string = |k: f64| {
        let mut network = Network::new();
        network.part("string", None);
        for i in 0..24 {
            let k = if i % 23 == 0 { 2e4 * k } else { 0.0 };
            let tie = Tie::Physical { k, z: 2e-7 * k };
            let name = format!("s{i}");
            network.cel(&name, 2e-3, tie, 0.0, 1e-4, 0.0).unwrap();
        }
        for i in 1..24 {
            let name = format!("l{i}");
            let k = 2e4 * k;
            network.spring(&name, i - 1, i, k, 2e-7 * k, 0.0).unwrap();
        }
        let (first, len, weight) = (7, 3, 1.0);
        let term = Term::Position { first, len, weight };
        network.listen("s", vec![term]).unwrap();
        Arc::new(network)
    };
    let options = SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    };
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    timeline.open();
    let budgets = [
        Budget::default(),
        Budget::Method(Method::Ca),
        Budget::Method(Method::Ca2p),
        Budget::Method(Method::Ieq),
        Budget::Method(Method::Bm4),
    ];
    let plan = |k: f64, budget: &Budget| Plan::new(string(k), &timeline, budget, None).unwrap();
    for before in &budgets {
        for after in &budgets {
            let mut old = Simulation::from_plan(Arc::new(plan(1.0, before)), options).unwrap();
            old.skip(1_000).unwrap();
            let new = Arc::new(plan(1.1, after));
            let mut new = Simulation::from_plan_at_frame(new, options, 1_000).unwrap();
            let mut takeover = Takeover::new(&old, &new);
            reset_violation_count();
            assert!(assert_no_alloc(|| new.take_over(&mut old, &mut takeover)));
            assert_eq!(violation_count(), 0, "{before:?} {after:?}");
            let mut out = [0.0; 500];
            assert_eq!(allocations(&mut new, &mut out), 0, "{before:?} {after:?}");
            assert!(out.iter().any(|x| *x != 0.0));
        }
    }
}

/// Points with contacts and sliding history between all pairs: from the first frame on, and once they lie in a heap.
#[test]
fn friction_between_all_pairs_does_not_allocate() {
    let (side, gap, n) = (5, 8e-3, 125);
    let mut network = Network::new();
    network.part("sand", None);
    let place = |i: usize| {
        let row = [i % side, i / side % side, i / side / side];
        row.map(|i| 0.9 * gap * i as f64 - 2.0 * gap)
    };
    let axis = |axis: usize| (0..n).map(move |i| place(i)[axis]);
    let x0: Vec<f64> = (0..3).flat_map(axis).collect();
    let mut points = |name: &str, masses: &[f64], x0: &[f64]| {
        let v0 = &vec![0.0; x0.len()][..];
        let (n_axes, z) = (3, 0.0);
        let points = SpacePoints {
            n_axes,
            masses,
            x0,
            v0,
            z,
        };
        let first = network.points(name, true, points).unwrap();
        PointGroup {
            first: SpacePoint::strided(first, masses.len()),
            n: masses.len(),
        }
    };
    let bowl = points("bowl", &[0.0], &[0.0; 3]);
    let sand = points("sand", &vec![1e-3; n], &x0);
    let last = sand.first.first + 2 * n;
    network.set_gravity(last..last + n, -9.81).unwrap();
    let law = SpaceLaw::Contact {
        exponent: 1.0,
        is_clamped: true,
    };
    for (name, groups, measure, gap) in [
        ("rub", [sand, sand], Measure::Distance, gap),
        ("wall", [bowl, sand], Measure::Within, 0.03),
    ] {
        let single = PairLaw {
            measure,
            law: law.clone(),
            friction: 0.4,
        };
        let numbers = [500.0, 0.05, gap];
        network.pairwise(name, groups, 3, single, numbers).unwrap();
    }
    let term = Term::Force {
        first: 0,
        len: n,
        weight: 1.0,
    };
    network.listen("rub", vec![term]).unwrap();
    let timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    let options = SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    };
    let mut simulation = Simulation::new(Arc::new(network), &timeline, options).unwrap();
    let mut out = vec![0.0; 8_000];
    for block in 0..4 {
        assert_eq!(allocations(&mut simulation, &mut out), 0, "{block}");
        assert!(out.iter().any(|&force| force != 0.0));
    }
}
