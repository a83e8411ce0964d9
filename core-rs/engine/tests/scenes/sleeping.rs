//! By ear, an island that has become quiet is stopped until its next event: what changes is not heard, what grows by
//! itself is not stopped, and every run of a score gives the same bits.

use std::sync::Arc;

use ergon_engine::generator::{Rim, Shape, plate};
use ergon_engine::law::{Law, LawText};
use ergon_engine::network::{But, Network, Term, Tie};
use ergon_engine::plan::{Budget, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

use super::blocks::play;
use super::scene::options;

const RATE: f64 = 44_100.0;
/// Length of the scenes: 3 s.
const N: usize = 132_300;
/// -90 dB.
const QUIET: f64 = 3.2e-5;
/// Number of the point that is struck live.
const SKIN: u32 = 1;

fn term(first: usize) -> Vec<Term> {
    let (len, weight) = (1, 1.0);
    vec![Term::Position { first, len, weight }]
}

/// A hammer that strikes a skin, both damped; `q` [N/m³] hardens the skin, which is then no body of modes.
fn drum(q: f64) -> (Arc<Network>, usize) {
    drum_at(90.0, q)
}

/// The same, with a skin whose lowest mode is at `f` [Hz].
fn drum_at(f: f64, q: f64) -> (Arc<Network>, usize) {
    let mut network = Network::new();
    network.part("drum", None);
    let topology = plate(Shape::Square, 5, Rim::Fixed).unwrap();
    let skin = network.mesh("skin", &topology, 0.1, f, Some(0.25), q).unwrap();
    network.listen("skin", term(skin + 12)).unwrap();
    let tie = Tie::Tuned { f: 1.0, t60: Some(0.3) };
    let hammer = network.cel("hammer", 0.02, tie, 0.0, 0.0, 0.0).unwrap();
    let but = But::plain(2e4, 0.2, 1e-4);
    network.but("to", hammer, skin + 24, but).unwrap();
    (Arc::new(network), hammer)
}

fn simulation(network: &Arc<Network>, timeline: &Timeline) -> Simulation {
    simulation_from(network, timeline, 0)
}

fn simulation_from(network: &Arc<Network>, timeline: &Timeline, from: usize) -> Simulation {
    let plan = Plan::new(network.clone(), timeline, &Budget::default(), None).unwrap();
    let options = SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    };
    Simulation::from_plan_at_frame(Arc::new(plan), options, from as u64).unwrap()
}

/// Continue and keep every island awake, by a damping that comes and goes: T60 30 years.
fn awake(simulation: &mut Simulation, n_frames: usize) -> Vec<f64> {
    let before = simulation.steps_at_rest();
    let mut sound = Vec::new();
    for from in (0..n_frames).step_by(64) {
        simulation.damp(Some(1e9).filter(|_| from % 128 == 0));
        sound.extend(numbers(&play(simulation, 64.min(n_frames - from), &[64])));
    }
    assert_eq!(simulation.steps_at_rest(), before);
    sound
}

fn numbers(bits: &[u64]) -> Vec<f64> {
    bits.iter().map(|bits| f64::from_bits(*bits)).collect()
}

fn peak(sound: &[f64]) -> f64 {
    sound.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()))
}

/// Strikes at 0.05 s and 2.2 s.
fn strikes(network: &Network, hammer: usize) -> Timeline {
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    for (index, instant) in [(0, 0.05), (1, 2.2)] {
        timeline
            .strike(network, hammer, instant, 0.01, Some(0.0), index)
            .unwrap();
    }
    timeline
}

#[test]
fn sleep_between_strikes_is_inaudible() {
    for q in [0.0, 1e9] {
        let (network, hammer) = drum(q);
        let mut asleep = simulation(&network, &strikes(&network, hammer));
        let mut reference = asleep.fork();
        let sound = numbers(&play(&mut asleep, N, &[512]));
        let expected = awake(&mut reference, N);
        let passed = asleep.steps_at_rest() as f64 / RATE;
        assert!(passed > 0.5, "{q}: {passed}");
        let apart: Vec<f64> = sound.iter().zip(&expected).map(|(x, y)| x - y).collect();
        let second = (2.2 * RATE) as usize;
        let [before, after] = [&apart[..second], &apart[second..]].map(peak);
        let loudest = peak(&expected);
        assert!(before < QUIET * loudest, "{q}: {before} of {loudest}");
        // The second strike meets a hammer that is elsewhere by so little.
        assert!(after < 10.0 * QUIET * loudest, "{q}: {after} of {loudest}");
        assert!(peak(&sound[second..]) > 0.5 * loudest);
    }
}

/// An event that falls between two frames of an island that takes several steps a frame.
#[test]
fn sleep_ends_with_a_strike_between_frames() {
    let (network, hammer) = drum_at(2_400.0, 1e9);
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    for (index, frame) in [(0, 2_000.0), (1, 80_000.5)] {
        let position = frame / RATE;
        timeline
            .strike(&network, hammer, position, 0.01, Some(0.0), index)
            .unwrap();
    }
    let plan = Plan::new(network.clone(), &timeline, &Budget::default(), None).unwrap();
    assert!(plan.rows()[0].oversampling > 1);
    let mut asleep = simulation(&network, &timeline);
    let mut reference = asleep.fork();
    let sound = numbers(&play(&mut asleep, 82_000, &[512]));
    assert!(asleep.steps_at_rest() > 20_000);
    let expected = awake(&mut reference, 82_000);
    assert!(peak(&sound[80_000..]) > 0.5 * peak(&expected));
    let apart: Vec<f64> = sound.iter().zip(&expected).map(|(x, y)| x - y).collect();
    assert!(peak(&apart) < 10.0 * QUIET * peak(&expected));
}

#[test]
fn sleep_in_blocks_of_any_size_and_from_stored_states() {
    let (network, hammer) = drum(1e9);
    let timeline = strikes(&network, hammer);
    let mut unsplit = simulation(&network, &timeline);
    let expected = play(&mut unsplit, N, &[N]);
    assert!(play(&mut simulation(&network, &timeline), N, &[1, 700, 44, 256, 3]) == expected);
    // While it moves, while it sleeps, and after the second strike.
    for position in [20_000, 80_000, 100_000] {
        let mut first = simulation(&network, &timeline);
        play(&mut first, position, &[512]);
        let mut second = simulation_from(&network, &timeline, position);
        for island in first.storable() {
            let (_, state) = first.take_recording(&island);
            assert!(second.set_state(&island, &state).is_ok());
        }
        assert!(
            play(&mut second, N - position, &[512]) == expected[position..],
            "{position}"
        );
    }
}

#[test]
fn sleep_ends_with_a_live_strike() {
    let (network, hammer) = drum(1e9);
    let mut open = Timeline::new(Rate::new(RATE).unwrap());
    open.open();
    open.add_strike_point(&network, hammer, SKIN, Some(0.0)).unwrap();
    let mut asleep = simulation(&network, &open);
    assert!(asleep.strike(SKIN, 0.01));
    play(&mut asleep, N, &[128]);
    let passed = asleep.steps_at_rest();
    assert!(passed > N as u64 / 2, "{passed}");
    assert!(asleep.strike(SKIN, 0.01));
    let sound = numbers(&play(&mut asleep, 2_048, &[128]));
    assert_eq!(asleep.steps_at_rest(), passed);
    assert!(peak(&sound) > 1e-6, "{}", peak(&sound));
}

/// A mass that drives itself, from a millionth of a millionth of a millimetre up, beside one that was struck and has
/// long decayed when it is heard.
#[test]
fn sleep_excludes_growing_oscillations() {
    let mut network = Network::new();
    network.part("pair", None);
    let tie = |f, t60| Tie::Tuned { f, t60 };
    let struck = network
        .cel("struck", 0.01, tie(200.0, Some(0.1)), 0.0, 0.0, 0.0)
        .unwrap();
    let grown = network.cel("grown", 0.01, tie(150.0, None), 1e-15, 0.0, 0.0).unwrap();
    let ground = network.sol("ground", 0.0).unwrap();
    let drive = LawText {
        law: Some("0*d"),
        damping: Some("-0.2*v + 20*v**3"),
        ..LawText::default()
    };
    let drive = Arc::new(Law::new(&drive).unwrap());
    network.lnl("drive", ground, grown, drive, 0.0).unwrap();
    network.spring("between", struck, grown, 1e-9, 0.0, 0.0).unwrap();
    network.listen("pair", term(grown)).unwrap();
    let network = Arc::new(network);
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.strike(&network, struck, 0.0, 1e-3, Some(0.0), 0).unwrap();
    let mut simulation = simulation(&network, &timeline);
    let sound = numbers(&play(&mut simulation, 2 * N, &[512]));
    assert!(peak(&sound[N..]) > 1e-5, "{}", peak(&sound[N..]));
}
