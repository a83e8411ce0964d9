//! A part that diverges is named and stops the run, or is muted while all others play.

use std::sync::Arc;

use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{Gesture, Manner, Touch};
use ergon_engine::gesture::written::{Approach, WrittenPoints};
use ergon_engine::law::{Law, LawText};
use ergon_engine::network::{Network, Term, Tie};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::{DriveKind, DriveSource, Timeline};
use ergon_engine::units::Rate;

use super::scene::hand;

const HERTZ: f64 = 44_100.0;
const OPTIONS: SimulationOptions = SimulationOptions {
    keeps_ledger: true,
    records_ergons: true,
    on_fault: OnFault::Mute,
    threads: 1,
    is_unchecked: false,
};

/// A healthy bell, and a part `sick` whose mass `m` passes 10 km at 0.1 s.
fn scene() -> (Network, Timeline, usize) {
    let mut network = Network::new();
    network.part("bell", None);
    let tie = Tie::Tuned {
        f: 440.0,
        t60: Some(1.0),
    };
    let bell = network.cel("m", 1e-2, tie, 0.0, 1e-3, 0.0).unwrap();
    network.part("sick", None);
    let mass = network.mas("m", 1.0, 0.0, 1e5).unwrap();
    for (name, first) in [("bell", bell), ("sick", mass)] {
        let (len, weight) = (1, 1.0);
        network
            .listen(name, vec![Term::Position { first, len, weight }])
            .unwrap();
    }
    let timeline = Timeline::new(Rate::new(HERTZ).unwrap());
    (network, timeline, mass)
}

fn play(simulation: &mut Simulation, n_frames: usize) -> Vec<[f64; 2]> {
    let mut out = vec![0.0; 2 * n_frames];
    simulation.process(&mut out).unwrap();
    out.chunks(2).map(|frame| [frame[0], frame[1]]).collect()
}

fn gesture(touch: Touch, t: [f64; 2]) -> Gesture {
    let written = WrittenPoints {
        t: &t,
        x: &[0.0, 1e-3],
        approaches: &[Approach::Path(Curve::Smooth); 2],
        sources: &[],
    };
    let manner = Manner {
        touch,
        force_max: Some(1e3),
        ..Manner::OPEN
    };
    Gesture::from_points(0, &written, manner).unwrap()
}

#[test]
fn fault_of_a_stopped_run_names_its_place() {
    let (network, timeline, _) = scene();
    let options = SimulationOptions {
        on_fault: OnFault::Stop,
        ..OPTIONS
    };
    let mut simulation = Simulation::new(Arc::new(network), &timeline, options).unwrap();
    let mut out = vec![0.0; 20_000];
    let fault = simulation.process(&mut out).unwrap_err();
    assert_eq!((fault.module.as_str(), fault.part.as_str()), ("sick.m", "sick"));
    // The first frame past 10 km.
    assert!((4410..=4411).contains(&fault.frame), "{}", fault.frame);
    assert_eq!(simulation.frame(), fault.frame);
    assert!(fault.to_string().contains("0.100 s"));
}

#[test]
fn fault_without_parts_names_the_module() {
    let mut network = Network::new();
    network.mas("m", 1.0, 0.0, 1e9).unwrap();
    let timeline = Timeline::new(Rate::new(HERTZ).unwrap());
    let options = SimulationOptions {
        on_fault: OnFault::Stop,
        ..OPTIONS
    };
    let mut simulation = Simulation::new(Arc::new(network), &timeline, options).unwrap();
    assert_eq!(simulation.skip(10).unwrap_err().module, "m");
}

/// The gestures of a muted key are dropped: while one plays, before it begins, after it has ended.
#[test]
fn mute_of_a_key_drops_its_gestures() {
    for touch in [Touch::Open, Touch::Tracked] {
        for t in [[0.05, 0.2], [0.15, 0.2], [0.02, 0.05]] {
            let (mut network, mut timeline, _) = scene();
            network.part("sick", None);
            let tie = Tie::Tuned { f: 8.0, t60: Some(0.6) };
            let struck = network.cel("key", 0.08, tie, 0.0, 0.0, 0.0).unwrap();
            timeline.add_key("key", struck);
            timeline.add_gesture(gesture(touch, t)).unwrap();
            let mut simulation = Simulation::new(Arc::new(network), &timeline, OPTIONS).unwrap();
            play(&mut simulation, 22_050);
            assert_eq!(simulation.muted_parts().len(), 1);
            assert!(simulation.gesture_positions()[0].is_nan());
            let report = simulation.reports()[0];
            assert_eq!(report.n_missed_steps, 0);
            assert!(t[0] < 0.1 || report.n_ergons == 0, "{t:?}: {report:?}");
        }
    }
}

/// Strikes and drives of a muted part continue in the timeline, but have no effect.
#[test]
fn mute_of_a_part_ignores_strikes_and_drives() {
    let (mut network, mut timeline, mass) = scene();
    network.part("sick", None);
    let point = network.sol("point", 0.0).unwrap();
    network.set_imposed(point);
    let path = hand().placed(0.09, 1.0, 3.0, false).unwrap();
    timeline
        .drive(point, DriveKind::Position, DriveSource::Take(path), true)
        .unwrap();
    timeline
        .drive(mass, DriveKind::Force, DriveSource::Constant(1.0), true)
        .unwrap();
    for position in [0.05, 0.15, 0.25] {
        timeline.strike(&network, mass, position, 1.0, Some(0.0), 0).unwrap();
        timeline.add_ergon(&network, mass, position, 1e-3, 1e3, 0).unwrap();
    }
    let mut simulation = Simulation::new(Arc::new(network), &timeline, OPTIONS).unwrap();
    play(&mut simulation, 6_000);
    let (muted, still) = (simulation.muted_parts(), simulation.positions()[1..].to_vec());
    play(&mut simulation, 10_000);
    assert_eq!(simulation.muted_parts(), muted, "it goes off once");
    assert_eq!(simulation.positions()[1..], still);
    let ergons = simulation.take_ergons();
    assert_eq!(ergons.len(), 2, "those of 0.05 s");
    assert!(ergons.iter().all(|it| it.impulse.is_finite() && it.speed.is_finite()));
    assert!(simulation.energy().unwrap().injected.is_finite());
}

/// A force may be non-finite one frame before the position that it moves.
#[test]
fn mute_keeps_outputs_finite() {
    let (mut network, timeline, mass) = scene();
    network.part("sick", None);
    let law = LawText {
        law: Some("where(d < -100, 1e308*1e308, 0)"),
        ..LawText::default()
    };
    let fixed = network.sol("s", 0.0).unwrap();
    let law = Arc::new(Law::new(&law).unwrap());
    let first = network.lnl("l", mass, fixed, law, 0.0).unwrap();
    let (len, weight) = (1, 1.0);
    network.listen("f", vec![Term::Force { first, len, weight }]).unwrap();
    let mut simulation = Simulation::new(Arc::new(network), &timeline, OPTIONS).unwrap();
    let mut out = vec![0.0; 3 * 4_000];
    simulation.process(&mut out).unwrap();
    assert_eq!(simulation.muted_parts().len(), 1);
    assert!(out.iter().all(|sample| sample.is_finite()));
    assert!(
        out.chunks(3)
            .skip(1_000)
            .all(|frame| frame[1] == 0.0 && frame[2] == 0.0)
    );
}

#[test]
fn mute_is_undone_by_an_earlier_snapshot() {
    let (network, timeline, _) = scene();
    let mut simulation = Simulation::new(Arc::new(network), &timeline, OPTIONS).unwrap();
    play(&mut simulation, 4_000);
    let snapshot = simulation.snapshot();
    let first = play(&mut simulation, 2_000);
    assert_eq!(simulation.muted_parts(), [("sick".to_owned(), 4_410)]);
    simulation.restore(&snapshot);
    assert!(simulation.muted_parts().is_empty());
    assert_eq!(play(&mut simulation, 2_000), first);
}

/// Its ground lies beyond all bounds: muting the part must terminate all the same.
#[test]
fn mute_of_a_part_with_distant_ground() {
    let mut network = Network::new();
    network.part("far", None);
    let tie = Tie::Physical { k: 1.0, z: 0.0 };
    let mass = network.cel("m", 1.0, tie, 2e4, 9.9e3, 1e5).unwrap();
    network.sol("s", -3e4).unwrap();
    let (len, weight, first) = (1, 1.0, mass);
    network
        .listen("o", vec![Term::Position { first, len, weight }])
        .unwrap();
    let timeline = Timeline::new(Rate::new(HERTZ).unwrap());
    let mut simulation = Simulation::new(Arc::new(network), &timeline, OPTIONS).unwrap();
    simulation.skip(1_000).unwrap();
    assert_eq!(simulation.muted_parts(), [("far".to_owned(), 1)]);
}

/// Only the imposed point that leaves the bounds is muted: the mass tied to it has not moved yet.
#[test]
fn mute_by_an_absurd_drive_spares_its_neighbours() {
    let (mut network, mut timeline, _) = scene();
    network.part("rail", None);
    let point = network.sol("point", 0.0).unwrap();
    network.set_imposed(point);
    network.spring("l", 0, point, 1.0, 0.0, 0.0).unwrap();
    let path = hand().placed(0.0, 1e7, 1.0, false).unwrap();
    timeline
        .drive(point, DriveKind::Position, DriveSource::Take(path), true)
        .unwrap();
    let mut simulation = Simulation::new(Arc::new(network), &timeline, OPTIONS).unwrap();
    play(&mut simulation, 4_000);
    let names: Vec<String> = simulation.muted_parts().into_iter().map(|it| it.0).collect();
    assert_eq!(names, ["rail"]);
}

#[test]
fn unchecked_simulation_runs_until_it_diverges() {
    let mut network = Network::new();
    network.part("p", Rate::new(HERTZ).ok());
    let tie = Tie::Physical { k: 4.2, z: 0.0 };
    network.cel("m", 1.0, tie, 0.0, 1e-3, 0.0).unwrap();
    let timeline = Timeline::new(Rate::new(HERTZ).unwrap());
    let network = Arc::new(network);
    let stop = SimulationOptions {
        on_fault: OnFault::Stop,
        ..OPTIONS
    };
    assert!(Simulation::new(network.clone(), &timeline, stop).is_err());
    let unchecked = SimulationOptions {
        is_unchecked: true,
        ..stop
    };
    let mut simulation = Simulation::new(network, &timeline, unchecked).unwrap();
    assert_eq!(simulation.skip(1000).unwrap_err().module, "p.m");
}
