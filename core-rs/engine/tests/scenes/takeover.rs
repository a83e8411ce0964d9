//! One simulation takes over from another in the middle of a scene.

use std::ops::Range;
use std::sync::Arc;

use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{Gesture, Manner, Touch};
use ergon_engine::gesture::written::{Approach, WrittenPoints};
use ergon_engine::law::{Law, LawText};
use ergon_engine::network::{But, Network, Side, Term, Tie};
use ergon_engine::plan::{Budget, Method, Plan, PlanContext};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::{HandInterpolation, Timeline};
use ergon_engine::units::Rate;

use super::scene::{Scene, options};

const RATE: f64 = 44_100.0;
const TICK: u32 = 44;

fn plain() -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    }
}

const BUT: But = But {
    side: Side::Above,
    ..But::plain(4e3, 0.1, 1e-4)
};

/// Masses in a row, tied to the ground at both ends.
fn chain(network: &mut Network, name: &str, n: usize, law: Option<&Arc<Law>>) -> usize {
    network.part(name, None);
    let first = network.n_mat();
    for i in 0..n {
        let (k, z) = if i == 0 || i + 1 == n { (4e3, 2e-3) } else { (0.0, 0.0) };
        let tie = Tie::Physical { k, z };
        let name = format!("s{i}");
        network.cel(&name, 2e-3, tie, 0.0, 0.0, 0.0).unwrap();
    }
    for i in first..first + n - 1 {
        let name = format!("l{}", i - first);
        match law {
            Some(law) => network.lnl(&name, i, i + 1, law.clone(), 0.0),
            None => network.spring(&name, i, i + 1, 2e4, 1e-2, 0.0),
        }
        .unwrap();
    }
    first
}

/// The key of a real hand that strikes a string, to which a slow lever with gestures is coupled for a time; a separate
/// body, a bank of cells, and a net that hardens.
fn network() -> Network {
    network_with(false)
}

/// The same; `is_more`: with another instrument before it.
fn network_with(is_more: bool) -> Network {
    let mut network = Network::new();
    let tie = |k, z| Tie::Physical { k, z };
    if is_more {
        let other = chain(&mut network, "other", 8, None);
        network.but("b", other + 1, other + 6, BUT).unwrap();
        let (first, len, weight) = (other + 2, 1, 1.0);
        let term = Term::Position { first, len, weight };
        network.listen("other", vec![term]).unwrap();
    }
    network.part("key", None);
    let key = network.cel("m", 0.4, tie(60.0, 1.2), 0.0, 0.0, 0.0).unwrap();
    network.part("lever", None);
    network.macrostep(10);
    let lever = network.cel("m", 0.08, tie(200.0, 0.4), 0.0, 0.0, 0.0).unwrap();
    let inner = network.mas("n", 0.03, 0.0, 0.0).unwrap();
    network.spring("r", lever, inner, 150.0, 0.2, 0.0).unwrap();
    let string = chain(&mut network, "string", 16, None);
    network.part("joints", None);
    network.but("hammer", key, string + 4, BUT).unwrap();
    network.spring("couple", lever, string + 9, 300.0, 0.01, 0.0).unwrap();
    let gong = chain(&mut network, "gong", 12, None);
    network.part("sky", None);
    let sky = network.n_mat();
    for i in 0..40 {
        let f = 200.0 + 31.0 * f64::from(i);
        let tie = Tie::Tuned { f, t60: Some(2.0) };
        network.cel(&format!("c{i}"), 2e-3, tie, 0.0, 0.0, 0.0).unwrap();
    }
    let law = LawText {
        law: Some("2e4*d + 1e12*d**3"),
        ..LawText::default()
    };
    let law = Arc::new(Law::new(&law).unwrap());
    let net = chain(&mut network, "net", 10, Some(&law));
    let point = |first, len, weight| Term::Position { first, len, weight };
    for (name, terms) in [
        ("string", vec![point(string + 12, 1, 1.0)]),
        ("gong", vec![point(gong + 3, 1, 1.0)]),
        ("both", vec![point(gong + 7, 1, 0.5), point(sky, 20, 1.0)]),
        ("sky", vec![point(sky, 40, 1.0)]),
        ("net", vec![point(net + 2, 1, 1.0), point(lever, 2, 0.1)]),
    ] {
        network.listen(name, terms).unwrap();
    }
    network
}

fn mat(network: &Network, name: &str) -> usize {
    (0..network.n_mat()).find(|&mat| network.mat_name(mat) == name).unwrap()
}

fn link(network: &Network, name: &str) -> usize {
    (0..network.n_lia())
        .find(|&link| network.link_name(link) == name)
        .unwrap()
}

fn gesture_to(start: f64, x: f64, touch: Touch, layer: bool) -> Gesture {
    let written = WrittenPoints {
        t: &[start, start + 0.04, start + 0.05, start + 0.09],
        x: &[0.0, x, x, 0.2 * x],
        approaches: &[
            Approach::Path(Curve::Smooth),
            Approach::Path(Curve::Smooth),
            Approach::Throw,
            Approach::Path(Curve::Line),
        ],
        sources: &[],
    };
    let manner = Manner {
        touch,
        is_layer: layer,
        ..Manner::OPEN
    };
    Gesture::from_points(0, &written, manner).unwrap()
}

/// The events that all versions have.
fn begin(network: &Network) -> Timeline {
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.open();
    timeline.add_key("lever", mat(network, "lever.m"));
    timeline
        .add_hand(network, mat(network, "key.m"), TICK, HandInterpolation::Line, &[])
        .unwrap();
    timeline
}

/// All events; those after `until` [s] differ.
fn timeline(network: &Network, until: f64) -> Timeline {
    let mut timeline = begin(network);
    let other = |t: f64| if t < until { 1.0 } else { -0.7 };
    for t in [0.01, 0.11, 0.22, 0.31] {
        timeline
            .add_gesture(gesture_to(t, 3e-3 * other(t), Touch::Open, false))
            .unwrap();
    }
    for t in [0.05, 0.27] {
        timeline
            .add_gesture(gesture_to(t, 1e-3 * other(t), Touch::Open, true))
            .unwrap();
    }
    for (i, t) in [0.004, 0.0501, 0.1203, 0.19, 0.2507, 0.33].into_iter().enumerate() {
        for name in ["gong.s5", "string.s3", "net.s4", "sky.c7", "lever.m"] {
            let (mat, position) = (mat(network, name), t + 1e-4 * i as f64);
            let impulse = if name == "lever.m" { 2e-3 } else { 3e-5 };
            timeline
                .strike(network, mat, position, impulse * other(position), Some(0.0), 0)
                .unwrap();
        }
        let cell = mat(network, "sky.c11");
        timeline.add_ergon(network, cell, t, 1e-6, 30.0 * other(t), 0).unwrap();
    }
    let couple = link(network, "joints.couple");
    timeline.couple(network, couple, 0.06, Some(0.3)).unwrap();
    timeline
}

/// Position of the real hand at a tick [m].
fn hand(tick: u64) -> f64 {
    let t = tick as f64 * f64::from(TICK) / RATE;
    2e-3 * ergon_engine::maths::sin(60.0 * t)
}

/// Play up to a frame, in blocks, with the hand.
fn play(simulation: &mut Simulation, until: u64, block: usize, out: &mut Vec<u64>) {
    let n_out = simulation.n_out();
    while simulation.frame() < until {
        let frame = simulation.frame();
        let tick = u64::from(TICK);
        if frame.is_multiple_of(tick) {
            simulation.set_hand_position(0, hand(frame / tick), None);
        }
        let n = (until - frame).min(tick - frame % tick).min(block as u64) as usize;
        let mut sound = vec![f64::NAN; n * n_out];
        simulation.process(&mut sound).unwrap();
        out.extend(sound.iter().map(|x| x.to_bits()));
    }
}

/// Everything that can be read from a simulation, as bits.
fn seen(simulation: &Simulation) -> String {
    format!(
        "{:?} {:?} {:?} {:?} {:?} {:?}",
        simulation.positions(),
        simulation.steps(),
        simulation.energy(),
        simulation.reports(),
        simulation.gesture_positions(),
        simulation.hand_force(0),
    )
}

/// Plays versions one after the other, each from its frame on.
fn versions(plans: &[(Arc<Plan>, u64)], until: u64, options: SimulationOptions, block: usize) -> (Vec<u64>, String) {
    let mut sound = Vec::new();
    let mut now = Simulation::from_plan(plans[0].0.clone(), options).unwrap();
    for (plan, from) in &plans[1..] {
        play(&mut now, *from, block, &mut sound);
        let mut next = Simulation::from_plan_at_frame(plan.clone(), options, *from).unwrap();
        let mut takeover = Takeover::new(&now, &next);
        assert!(next.take_over(&mut now, &mut takeover));
        now = next;
    }
    play(&mut now, until, block, &mut sound);
    (sound, seen(&now))
}

const LENGTH: u64 = 17_600;

#[test]
fn take_over_by_an_equal_version_bitwise() {
    let network = Arc::new(network());
    let timeline = timeline(&network, f64::INFINITY);
    for budget in [
        Budget::default(),
        Budget::Method(Method::Ca2p),
        Budget::Method(Method::Ca),
    ] {
        let plan = Plan::new(network.clone(), &timeline, &budget, None).unwrap();
        let next = Arc::new(
            Plan::in_context(
                network.clone(),
                &timeline,
                &budget,
                None,
                PlanContext {
                    earlier_plan: Some(&plan),
                    ..PlanContext::default()
                },
            )
            .unwrap(),
        );
        let plan = Arc::new(plan);
        let complete = versions(&[(plan.clone(), 0)], LENGTH, plain(), 44);
        for (first, second) in [(44, 88), (440, 4_400), (1_540, 2_200), (3_300, 8_800), (10_164, 13_200)] {
            for shift in [0, 1, 7, 23] {
                let (first, second) = (first + shift, second + 3 * shift);
                let plans = [(plan.clone(), 0), (next.clone(), first), (plan.clone(), second)];
                let parts = versions(&plans, LENGTH, plain(), 64);
                let position = complete.0.iter().zip(&parts.0).position(|(a, b)| a != b);
                assert_eq!(
                    position.map(|position| position / 5),
                    None,
                    "{budget:?} {first} {second}"
                );
                assert_eq!(complete.1, parts.1, "{budget:?} {first} {second}");
            }
        }
    }
}

/// A version that differs only after `until`: no bit before that changes, and takeovers before it give the samples of
/// the new version played from the start.
#[test]
fn take_over_by_a_version_with_later_changes() {
    let network = Arc::new(network());
    let until = 0.205;
    let (old, new) = (timeline(&network, f64::INFINITY), timeline(&network, until));
    for budget in [Budget::default(), Budget::Method(Method::Ca2p)] {
        let plan = |timeline: &Timeline| Arc::new(Plan::new(network.clone(), timeline, &budget, None).unwrap());
        let (old, new) = (plan(&old), plan(&new));
        let unchanged = versions(&[(old.clone(), 0)], LENGTH, plain(), 44);
        let written = versions(&[(new.clone(), 0)], LENGTH, plain(), 44);
        let first = (until * RATE) as usize * 5;
        assert!(unchanged.0[..first] == written.0[..first]);
        assert!(unchanged.0[first..] != written.0[first..]);
        for from in [440, 2_200, 4_411, 8_800] {
            let joined = versions(&[(old.clone(), 0), (new.clone(), from)], LENGTH, plain(), 64);
            assert!(joined.0 == written.0, "{budget:?} {from}");
            assert_eq!(joined.1, written.1, "{budget:?} {from}");
        }
    }
}

/// The plan of a session does not depend on the events written, nor on the plan that it is made like.
#[test]
fn plan_of_a_session_ignores_written_events() {
    let network = Arc::new(network());
    let plan = |timeline: &Timeline, like: Option<&Plan>| {
        let budget = Budget::default();
        match like {
            Some(like) => {
                let known = PlanContext {
                    earlier_plan: Some(like),
                    ..PlanContext::default()
                };
                Plan::in_context(network.clone(), timeline, &budget, None, known)
            }
            None => Plan::new(network.clone(), timeline, &budget, None),
        }
        .unwrap()
    };
    let full = timeline(&network, 0.1);
    let mut empty = begin(&network);
    empty
        .couple(&network, link(&network, "joints.couple"), 5.0, None)
        .unwrap();
    let ergon = mat(&network, "sky.c11");
    empty.add_ergon(&network, ergon, 9.0, 1e-6, 1.0, 0).unwrap();
    let (first, other) = (plan(&full, None), plan(&empty, None));
    let again = plan(&full, Some(&other));
    for plan in [&other, &again] {
        assert_eq!(plan.choices(), first.choices());
        assert_eq!(plan.hash(), first.hash());
    }
    let (complete, like) = (Arc::new(first), Arc::new(again));
    let sound = |plan| versions(&[(plan, 0)], LENGTH, plain(), 440);
    let listened = sound(complete.clone());
    assert_eq!(sound(like), listened);
    // No event of the first version has begun yet: after the takeover, the samples are those of the other, to the last
    // bit, with threads too.
    let plans = [(Arc::new(other), 0), (complete, 150)];
    let options = SimulationOptions { threads: 3, ..plain() };
    assert_eq!(versions(&plans, LENGTH, options, 4_400), listened);
}

/// Another instrument is added and removed: everything that it does not touch keeps its bits, whatever its new indices
/// are.
#[test]
fn take_over_with_an_added_part_bitwise() {
    let (network, more) = (Arc::new(network()), Arc::new(network_with(true)));
    for budget in [Budget::default(), Budget::Method(Method::Ca2p)] {
        let plan = |network: &Arc<Network>| {
            let timeline = timeline(network, f64::INFINITY);
            Arc::new(Plan::new(network.clone(), &timeline, &budget, None).unwrap())
        };
        let (plan, with) = (plan(&network), plan(&more));
        let complete = versions(&[(plan.clone(), 0)], LENGTH, plain(), 44).0;
        let (come, gone) = (4_433, 8_811);
        let plans = [(plan.clone(), 0), (with, come), (plan, gone)];
        let joined = versions(&plans, LENGTH, plain(), 64).0;
        // While the instrument is there, its output is the first of six; otherwise there are five.
        let (before, rest) = joined.split_at(come as usize * 5);
        let (between, after) = rest.split_at((gone - come) as usize * 6);
        let between = between.chunks(6).flat_map(|frame| &frame[1..]);
        let joined: Vec<u64> = before.iter().chain(between).chain(after).copied().collect();
        for (index, (a, b)) in complete.iter().zip(&joined).enumerate() {
            // An output that sums several units adds them in the order of their costs, which may change.
            let is_sum = [2, 4].contains(&(index % 5));
            let apart = (f64::from_bits(*a) - f64::from_bits(*b)).abs();
            assert!(a == b || (is_sum && apart < 1e-15), "{budget:?} {index}: {apart}");
        }
        assert_eq!(complete.len(), joined.len());
    }
}

/// A running gesture that the new version does not have ends at once: the key moves freely, and the next gesture joins
/// it there.
#[test]
fn take_over_without_a_running_gesture_ends_it() {
    let mut network = Network::new();
    network.part("key", None);
    let tie = Tie::Tuned { f: 8.0, t60: Some(0.6) };
    network.cel("m", 0.08, tie, 0.0, 0.0, 0.0).unwrap();
    let term = Term::Position {
        first: 0,
        len: 1,
        weight: 1.0,
    };
    network.listen("m", vec![term]).unwrap();
    let network = Arc::new(network);
    let plan = |gestures: &[Gesture]| {
        let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
        timeline.open();
        timeline.add_key("key", 0);
        for gesture in gestures {
            timeline.add_gesture(gesture.clone()).unwrap();
        }
        Arc::new(Plan::new(network.clone(), &timeline, &Budget::default(), None).unwrap())
    };
    let from = 0.035;
    let gone = gesture_to(0.01, 4e-3, Touch::Open, false);
    let next = gesture_to(0.2, 2e-3, Touch::Open, false);
    let frame = (from * RATE) as u64;
    let versions = versions(
        &[(plan(&[gone]), 0), (plan(std::slice::from_ref(&next)), frame)],
        15_000,
        plain(),
        64,
    );
    let x: Vec<f64> = versions.0.iter().map(|x| f64::from_bits(*x)).collect();
    // Up to the throw, the acceleration is that of the gesture, 4 mm in 40 ms: nothing jumps.
    let curvature = |n: usize| (x[n + 1] - 2.0 * x[n] + x[n - 1]).abs() * RATE * RATE;
    let worst = (1..(0.239 * RATE) as usize).map(curvature).fold(0.0, f64::max);
    assert!(worst < 40.0, "{worst} m/s²");
    // The free key swings at its own frequency from its position at the takeover; a led key is where the gesture asks
    // for it.
    let position = |t: f64| x[(t * RATE).round() as usize];
    assert!(
        position(0.05) > position(from) && position(0.1) < -5e-4,
        "it swings back"
    );
    assert!((position(0.24) - 2e-3).abs() < 1e-6, "{}", position(0.24));
}

/// Another network: masses of the same name keep their motion, in a bank or stepped; new ones begin at their initial
/// state.
#[test]
fn take_over_keeps_masses_by_name() {
    let version = |k: f64, coupled: bool, more: bool| {
        let mut network = Network::new();
        network.part("bells", None);
        let tie = |k| Tie::Physical { k, z: 1e-3 };
        if more {
            network.cel("new", 1e-2, tie(2e3), 0.0, 1e-3, 0.0).unwrap();
        }
        let a = network.cel("a", 1e-2, tie(k), 0.0, 0.0, 0.0).unwrap();
        let b = network.cel("b", 2e-2, tie(3e3), 0.0, 0.0, 0.0).unwrap();
        if coupled {
            network.spring("l", a, b, 10.0, 0.0, 0.0).unwrap();
        }
        let term = Term::Position {
            first: 0,
            len: network.n_mat(),
            weight: 1.0,
        };
        network.listen("all", vec![term]).unwrap();
        let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
        timeline.open();
        timeline.strike(&network, a, 1e-3, 1e-3, Some(0.0), 0).unwrap();
        timeline.strike(&network, b, 2e-3, 1e-3, Some(0.0), 0).unwrap();
        Arc::new(Plan::new(Arc::new(network), &timeline, &Budget::default(), None).unwrap())
    };
    let position = 3_000;
    let all = [
        (2e3, false, false),
        (2e3, true, false),
        (2.2e3, false, true),
        (2e3, true, true),
    ];
    for (i, &before) in all.iter().enumerate() {
        for &after in &all[i + 1..] {
            let pair = [before, after].map(|(k, coupled, more)| version(k, coupled, more));
            let mut old = Simulation::from_plan(pair[0].clone(), plain()).unwrap();
            old.skip(position).unwrap();
            let (x, d) = (old.positions(), old.steps());
            let mut new = Simulation::from_plan_at_frame(pair[1].clone(), plain(), position).unwrap();
            let mut takeover = Takeover::new(&old, &new);
            assert!(new.take_over(&mut old, &mut takeover));
            let (now, steps) = (new.positions(), new.steps());
            let n = x.len().min(now.len());
            for i in 1..=2.min(n) {
                let (a, b) = (x.len() - i, now.len() - i);
                assert!((x[a] - now[b]).abs() <= 1e-18, "{before:?} {after:?}");
                assert!((d[a] - steps[b]).abs() <= 1e-18, "{before:?} {after:?}");
                assert!(x[a] != 0.0);
            }
            if after.2 && !before.2 {
                assert_eq!(now[0], 1e-3);
            }
        }
    }
}

#[test]
fn take_over_of_random_scenes() {
    go_on(0..4);
}

#[test]
#[ignore = "minutes: make test-long"]
fn take_over_of_many_random_scenes() {
    go_on(4..100);
}

/// Takeovers in random scenes, with and without the ledger.
fn go_on(seeds: Range<u64>) {
    for seed in seeds {
        let scene = Scene::random(seed);
        let network = Arc::new(scene.network.clone());
        let n = scene.n_frames() as u64;
        let plan = |budget: Option<Budget>| {
            Arc::new(match budget {
                Some(budget) => Plan::new(network.clone(), &scene.timeline, &budget, None).unwrap(),
                None => Plan::plain(network.clone(), &scene.timeline, false).unwrap(),
            })
        };
        let budgets = [None, Some(Budget::default()), Some(Budget::Method(Method::Ca))];
        for budget in budgets {
            let options = SimulationOptions {
                keeps_ledger: budget.is_none(),
                ..plain()
            };
            let plan = plan(budget);
            let complete = versions(&[(plan.clone(), 0)], n, options, 64);
            for position in [n / 31, n / 7, n / 3, n / 2 + 1] {
                let plans = [
                    (plan.clone(), 0),
                    (plan.clone(), position),
                    (plan.clone(), position + n / 4),
                ];
                let parts = versions(&plans, n, options, 64);
                assert!(complete.0 == parts.0, "{seed} {budget:?} {position}");
                assert_eq!(complete.1, parts.1, "{seed} {budget:?} {position}");
            }
        }
    }
}

/// A muted part stays muted in a version that does not change it, and all others play on.
#[test]
fn take_over_keeps_muted_parts_muted() {
    let version = |struck: &[f64]| {
        let mut network = Network::new();
        network.part("bell", None);
        let tie = Tie::Tuned {
            f: 440.0,
            t60: Some(1.0),
        };
        let bell = network.cel("m", 1e-2, tie, 0.0, 1e-3, 0.0).unwrap();
        network.part("sick", None);
        let mass = network.mas("m", 1.0, 0.0, 1e5).unwrap();
        // The mass that passes all bounds at 0.1 s hangs on the bell by a negligible spring.
        network.spring("l", bell, mass, 1e-9, 0.0, 0.0).unwrap();
        for (name, first) in [("bell", bell), ("sick", mass)] {
            let term = Term::Position {
                first,
                len: 1,
                weight: 1.0,
            };
            network.listen(name, vec![term]).unwrap();
        }
        let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
        timeline.open();
        for &instant in struck {
            timeline.strike(&network, bell, instant, 1e-4, Some(0.0), 0).unwrap();
        }
        let budget = Budget::Method(Method::Ca);
        Arc::new(Plan::new(Arc::new(network), &timeline, &budget, None).unwrap())
    };
    let mute = SimulationOptions {
        on_fault: OnFault::Mute,
        ..plain()
    };
    let mut old = Simulation::from_plan(version(&[]), mute).unwrap();
    let mut before = vec![0.0; 2 * 6_000];
    old.process(&mut before).unwrap();
    assert_eq!(old.n_muted(), 1);
    let mut alone = old.fork();
    let mut new = Simulation::from_plan_at_frame(version(&[0.2]), mute, 6_000).unwrap();
    let mut takeover = Takeover::new(&old, &new);
    assert!(new.take_over(&mut old, &mut takeover));
    let (mut after, mut unchanged) = (vec![0.0; 2 * 2_000], vec![0.0; 2 * 2_000]);
    new.process(&mut after).unwrap();
    alone.process(&mut unchanged).unwrap();
    assert_eq!(new.muted_parts(), [("sick".to_owned(), 6_000)]);
    let bell = |sound: &[f64]| sound.iter().step_by(2).copied().collect::<Vec<_>>();
    assert_eq!(bell(&after), bell(&unchanged), "up to the new strike");
    assert!(after.iter().skip(1).step_by(2).all(|x| *x == 0.0));
}
