//! Islands at rest are not computed, and no bit changes: of outputs, of everything that can be read at any frame, and
//! of stored states.
//!
//! By ear islands also sleep, see `sleeping`. The reference is the same simulation with [`Simulation::start_watching`]
//! called every few frames: that wakes every island.

use std::sync::Arc;

use ergon_engine::generator::{Rim, Shape, plate};
use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{Gesture, Manner};
use ergon_engine::gesture::written::{Approach, WrittenPoints};
use ergon_engine::network::{But, Dry, Network, Term, Tie};
use ergon_engine::plan::{Budget, Method, Plan};
use ergon_engine::simulation::{MotionSnapshot, OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::{DriveKind, DriveSource, Timeline};
use ergon_engine::units::Rate;

use super::blocks::play;
use super::scene::options;

const RATE: f64 = 44_100.0;
/// Length of the scenes [frames], and the frame of the first event.
const N: usize = 40_000;
const BEGINS: u64 = 88 * 256;
/// Number of the point that is struck live.
const GONG: u32 = 3;

fn seconds(frame: f64) -> f64 {
    frame / RATE
}

fn term(first: usize, len: usize) -> Vec<Term> {
    let weight = 1.0;
    vec![Term::Position { first, len, weight }]
}

/// A key that strikes a linear plate, a gong that stiffens, two chains that are coupled for a time, a lever that is
/// computed once in ten frames with a bell on it, a mass that rests away from 0, and a rail that always presses on a
/// stop.
fn network() -> Arc<Network> {
    let mut network = Network::new();
    let tie = |k, z| Tie::Physical { k, z };
    let but = But::plain(2e4, 0.2, 2e-3);
    let cel =
        |network: &mut Network, name: &str, m: f64, tie: Tie, at: f64| network.cel(name, m, tie, at, at, 0.0).unwrap();
    network.part("plate", None);
    let topology = plate(Shape::Square, 3, Rim::Fixed).unwrap();
    let skin = network.mesh("p", &topology, 0.1, 90.0, Some(0.3), 0.0).unwrap();
    network.listen("plate", term(skin + 16, 1)).unwrap();
    network.part("key", None);
    let single = Tie::Tuned { f: 2.0, t60: Some(0.6) };
    let key = cel(&mut network, "m", 0.3, single, 0.0);
    network.but("to", key, skin + 24, but).unwrap();
    network.part("gong", None);
    let gong = network.mesh("g", &topology, 0.3, 150.0, Some(1.0), 1e11).unwrap();
    network.listen("gong", term(gong + 14, 3)).unwrap();
    network.part("chains", None);
    let chain = network.n_mat();
    for i in 0..8 {
        cel(&mut network, &format!("c{i}"), 2e-3, tie(900.0, 3e-3), 0.0);
    }
    for i in (0..7).filter(|i| *i != 3) {
        let name = format!("l{i}");
        network.spring(&name, chain + i, chain + i + 1, 8e3, 4e-3, 0.0).unwrap();
    }
    network.spring("couple", chain + 3, chain + 4, 8e3, 4e-3, 0.0).unwrap();
    network.listen("chain", term(chain + 6, 2)).unwrap();
    network.part("lever", None);
    network.macrostep(10);
    let lever = cel(&mut network, "m", 0.08, tie(200.0, 0.4), 0.0);
    let inner = network.mas("n", 0.03, 0.0, 0.0).unwrap();
    network.spring("r", lever, inner, 150.0, 0.2, 0.0).unwrap();
    network.part("bell", None);
    let bell = cel(&mut network, "b", 2e-3, tie(4e3, 0.01), 0.0);
    network.spring("c", lever, bell, 300.0, 0.0, 0.0).unwrap();
    network.listen("lever", term(inner, 2)).unwrap();
    network.part("aside", None);
    let aside = cel(&mut network, "a", 0.01, tie(4e3, 0.05), 0.01);
    let other = cel(&mut network, "b", 0.02, tie(5e3, 0.9), 0.01);
    network.spring("s", aside, other, 3e3, 0.2, 0.0).unwrap();
    network.listen("aside", term(aside, 2)).unwrap();
    network.part("rail", None);
    let rail = network.mas("r", 1.0, 0.0, 0.0).unwrap();
    network.set_imposed(rail);
    let stop = network.sol("s", 0.0).unwrap();
    network.but("press", rail, stop, But { gap: 0.0, ..but }).unwrap();
    Arc::new(network)
}

/// The first MAT whose name begins with `name`.
fn mat(network: &Network, name: &str) -> usize {
    let mut mats = 0..network.n_mat();
    mats.find(|&mat| network.mat_name(mat).starts_with(name)).unwrap()
}

/// The events: at the border of a block, next to it, and between frames.
fn timeline(network: &Network) -> Timeline {
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    let position = |name: &str| mat(network, name);
    timeline.add_key("key", position("key.m"));
    let begins = BEGINS as f64;
    for (start, layer) in [(begins, false), (begins + 900.5, true)] {
        let start = seconds(start);
        let written = WrittenPoints {
            t: &[start, start + 0.06, start + 0.2],
            x: &[0.0, 4e-3, 0.0],
            approaches: &[Approach::Path(Curve::Smooth); 3],
            sources: &[],
        };
        let manner = Manner {
            is_layer: layer,
            ..Manner::OPEN
        };
        let gesture = Gesture::from_points(0, &written, manner).unwrap();
        timeline.add_gesture(gesture).unwrap();
    }
    let gong = mat(network, "gong.") + 12;
    for frame in [begins + 256.0, begins + 512.0 - 1.0, begins + 768.5] {
        timeline
            .strike(network, gong, seconds(frame), 3e-3, Some(0.0), 0)
            .unwrap();
    }
    let chain = position("chains.c1");
    timeline
        .strike(network, chain, seconds(begins + 0.5), 1e-4, Some(0.0), 0)
        .unwrap();
    timeline
        .add_ergon(network, chain, seconds(begins + 700.0), 1e-4, 1.0, 0)
        .unwrap();
    let lever = position("lever.m");
    timeline
        .strike(network, lever, seconds(begins + 3.0), 2e-3, Some(0.0), 0)
        .unwrap();
    let couple = (0..network.n_lia()).find(|&link| network.link_name(link) == "chains.couple");
    let (from, to) = (seconds(9_000.0), seconds(begins + 6_000.0));
    timeline.couple(network, couple.unwrap(), from, Some(to)).unwrap();
    let rail = position("rail.r");
    let press = DriveSource::Constant(1e-3);
    timeline.drive(rail, DriveKind::Position, press, true).unwrap();
    let aside = position("aside.a");
    timeline
        .glide_through(network, aside, &[(0.4, [4e3, 0.05, 0.01]), (0.6, [5e3, 0.05, 0.01])])
        .unwrap();
    timeline
}

fn plain() -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    }
}

/// Continue as [`play`] does, and keep every island awake.
fn awake(simulation: &mut Simulation, n_frames: usize) -> Vec<u64> {
    let before = simulation.steps_at_rest();
    let mut sound = Vec::new();
    for from in (0..n_frames).step_by(64) {
        simulation.start_watching();
        sound.extend(play(simulation, 64.min(n_frames - from), &[64]));
    }
    assert_eq!(simulation.steps_at_rest(), before);
    sound
}

/// Everything that can be read from a simulation, as bits.
fn seen(simulation: &Simulation) -> String {
    format!(
        "{:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?}",
        simulation.positions(),
        simulation.steps(),
        simulation.energy(),
        simulation.reports(),
        simulation.gesture_positions(),
        simulation.energy_gains(),
        simulation.finer_parts(),
        simulation.muted_parts(),
    )
}

/// The states that a render stores; islands continue from them.
fn stored(simulation: &mut Simulation) -> Vec<Vec<u8>> {
    let islands = simulation.storable();
    let states = islands.iter().map(|island| simulation.take_recording(island).1);
    states.collect()
}

fn simulations(network: &Arc<Network>, timeline: &Timeline) -> Vec<(String, Simulation)> {
    let saved = SimulationOptions {
        records_ergons: true,
        ..options(OnFault::Stop)
    };
    let mut all = Vec::new();
    for (name, options) in [("steps", plain()), ("ledger", saved)] {
        let simulation = Simulation::new(network.clone(), timeline, options).unwrap();
        all.push((name.to_owned(), simulation));
    }
    let methods = [Method::Ca, Method::Ca2p, Method::Bm4, Method::Ieq];
    let budgets = methods.map(Budget::Method).into_iter();
    for budget in budgets.chain([Budget::Error(-70.0)]) {
        let plan = Arc::new(Plan::new(network.clone(), timeline, &budget, None).unwrap());
        let simulation = Simulation::from_plan(plan.clone(), plain()).unwrap();
        all.push((format!("{budget:?}"), simulation));
        let options = SimulationOptions { threads: 4, ..plain() };
        let simulation = Simulation::from_plan(plan, options).unwrap();
        all.push((format!("{budget:?}, 4 threads"), simulation));
    }
    all
}

#[test]
fn rest_is_skipped_with_the_same_bits() {
    let network = network();
    let timeline = timeline(&network);
    // Frames at which both are compared, unrelated to any period: while everything is at rest, and later.
    let looks = [300, 1_111, 8_191, 15_003, BEGINS as usize - 1_100, 25_007, N];
    for (name, mut rested) in simulations(&network, &timeline) {
        let mut reference = rested.fork();
        let mut position = 0;
        for until in looks {
            let sound = play(&mut rested, until - position, &[1, 700, 44, 256, 3]);
            assert!(sound == awake(&mut reference, until - position), "{name} {until}");
            assert_eq!(seen(&rested), seen(&reference), "{name} {until}");
            assert!(stored(&mut rested) == stored(&mut reference), "{name} {until}");
            position = until;
        }
        assert_eq!(rested.take_ergons(), reference.take_ergons(), "{name}");
        let passed = rested.steps_at_rest();
        assert!(passed > BEGINS / 2, "{name}: {passed}");
    }
}

/// Strikes at the border of a block, next to it, and in the middle of one.
#[test]
fn live_strike_wakes_resting_parts_in_its_frame() {
    let network = network();
    let mut open = Timeline::new(Rate::new(RATE).unwrap());
    open.open();
    let gong = mat(&network, "gong.") + 12;
    open.add_strike_point(&network, gong, GONG, Some(0.0)).unwrap();
    for budget in [Budget::Error(-70.0), Budget::Method(Method::Ca)] {
        let plan = Arc::new(Plan::new(network.clone(), &open, &budget, None).unwrap());
        for frame in [4_096, 4_097, 5_000] {
            let mut rested = Simulation::from_plan(plan.clone(), plain()).unwrap();
            let mut reference = rested.fork();
            assert!(play(&mut rested, frame, &[128]) == awake(&mut reference, frame));
            let before = rested.steps_at_rest();
            let alone = {
                let mut other = rested.fork();
                play(&mut other, 3_000, &[128]);
                other.steps_at_rest() - before
            };
            for simulation in [&mut rested, &mut reference] {
                assert!(simulation.strike(GONG, 2e-3));
            }
            let sound = play(&mut rested, 3_000, &[128]);
            assert!(sound == awake(&mut reference, 3_000), "{budget:?} {frame}");
            assert_eq!(seen(&rested), seen(&reference));
            // It moves in the next frame, and nothing else wakes.
            let n_out = rested.n_out();
            let moved = sound.chunks(n_out).position(|row| row[1] != sound[1]);
            assert!(moved.is_some_and(|at| at < 40), "{moved:?}");
            let since = rested.steps_at_rest() - before;
            assert!(since > 0 && since + 3_000 == alone, "{since} {alone}");
        }
    }
}

/// A mass that friction has stopped rests where it stopped, until it is struck again.
#[test]
fn mass_stopped_by_friction_rests_again() {
    let mut network = Network::new();
    network.part("sled", None);
    let sled = network.mas("m", 0.02, 0.0, 0.0).unwrap();
    let ground = network.sol("g", 0.0).unwrap();
    let dry = Dry {
        level: 0.05,
        static_level: 0.08,
        speed: 4e-3,
    };
    network.dry("d", sled, ground, dry).unwrap();
    network.listen("sled", term(sled, 1)).unwrap();
    let network = Arc::new(network);
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    for instant in [0.1, 4.0] {
        timeline.strike(&network, sled, instant, 1e-2, Some(0.0), 0).unwrap();
    }
    let mut rested = Simulation::new(network, &timeline, options(OnFault::Stop)).unwrap();
    let mut reference = rested.fork();
    // It slides for 0.2 s; the next test for rest comes within as long again.
    let passed = [(1, 20_000, 30_000), (3, 120_000, 132_300), (2, 60_000, 80_000)];
    for (seconds, least, limit) in passed {
        let (n, before) = (seconds * 44_100, rested.steps_at_rest());
        assert!(play(&mut rested, n, &[256, 100]) == awake(&mut reference, n));
        assert_eq!(seen(&rested), seen(&reference));
        let passed = rested.steps_at_rest() - before;
        assert!((least..limit).contains(&passed), "{seconds} s: {passed}");
    }
}

/// If watching begins while the scene is at rest, pressing contacts are seen frame by frame.
#[test]
fn look_at_rest_sees_pressing_contacts() {
    let network = network();
    let timeline = timeline(&network);
    let mut rested = Simulation::new(network.clone(), &timeline, plain()).unwrap();
    let mut reference = rested.fork();
    let look = rested.make_look();
    let (mut single, mut other) = (MotionSnapshot::new(&rested, &look), MotionSnapshot::new(&rested, &look));
    assert!(play(&mut rested, 5_000, &[256]) == awake(&mut reference, 5_000));
    assert!(rested.steps_at_rest() > 0);
    rested.start_watching();
    reference.start_watching();
    for _ in 0..30 {
        play(&mut rested, 1_470, &[49]);
        play(&mut reference, 1_470, &[49]);
        rested.fill_snapshot(&look, &mut single);
        reference.fill_snapshot(&look, &mut other);
        assert_eq!(format!("{single:?}"), format!("{other:?}"));
        assert!(single.pushes.iter().any(|push| push.force != 0.0));
    }
}

/// One version takes over while everything is at rest, another one in the middle of what follows.
#[test]
fn take_over_from_a_resting_version() {
    let network = network();
    let version = |is_written: bool| {
        let mut single = Timeline::new(Rate::new(RATE).unwrap());
        if is_written {
            single = timeline(&network);
        } else {
            single.add_key("key", mat(&network, "key.m"));
            let press = DriveSource::Constant(1e-3);
            let rail = mat(&network, "rail.r");
            single.drive(rail, DriveKind::Position, press, true).unwrap();
        }
        single.open();
        Arc::new(Plan::new(network.clone(), &single, &Budget::Error(-70.0), None).unwrap())
    };
    let (still, written) = (version(false), version(true));
    for [first, second] in [[3_000, 9_001], [5_003, BEGINS as usize + 300]] {
        let played = |is_awake: bool| {
            let mut sound = Vec::new();
            let mut now = Simulation::from_plan(still.clone(), plain()).unwrap();
            let (mut position, mut passed) = (0, 0);
            for (from, plan) in [(first, &still), (second, &written), (N, &written)] {
                sound.extend(if is_awake {
                    awake(&mut now, from - position)
                } else {
                    play(&mut now, from - position, &[256, 44])
                });
                passed += now.steps_at_rest();
                position = from;
                let mut next = Simulation::from_plan_at_frame(plan.clone(), plain(), position as u64).unwrap();
                let mut takeover = Takeover::new(&now, &next);
                assert!(next.take_over(&mut now, &mut takeover));
                now = next;
            }
            (sound, seen(&now), passed)
        };
        let (rested, reference) = (played(false), played(true));
        assert!(rested.0 == reference.0 && rested.1 == reference.1);
        assert!(rested.2 > first as u64 && reference.2 == 0, "{}", rested.2);
    }
}
