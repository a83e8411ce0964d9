//! Broken links are reported when they break, and again with each key state.

use std::collections::HashMap;
use std::sync::Arc;

use ergon_engine::maths::asin;
use ergon_engine::network::{Network, SpaceLaw, SpacePoint, SpacePoints, Term};
use ergon_engine::plan::{Budget, Plan};
use ergon_engine::simulation::{MotionLook, OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;
use ergon_view::payload::{ByteReader, kind};
use ergon_view::read::MotionFile;
use ergon_view::record::{Recorder, RecordingSetup, point_runs};

const RATE: f64 = 44_100.0;
const FPS: f64 = 1_000.0;
const K: f64 = 1_000.0;
/// A negligible stiffness [N/m].
const LOOSE: f64 = 1e-6;
const LENGTH: f64 = 0.1;

fn point(network: &mut Network, name: &str, m: f64, x0: [f64; 2], v0: f64) -> SpacePoint {
    let points = SpacePoints {
        n_axes: 2,
        masses: &[m],
        x0: &x0,
        v0: &[v0, 0.0],
        z: 0.0,
    };
    let first = network.points(name, false, points).unwrap();
    SpacePoint::strided(first, 1)
}

fn thread(network: &mut Network, ends: (SpacePoint, SpacePoint), k: f64, breaks: f64) {
    let law = SpaceLaw::Yielding {
        yield_force: f64::INFINITY,
        break_elongation: breaks,
    };
    network.space_links("t", ends, 1, 2, law, [k, 0.0, LENGTH]).unwrap();
}

/// The instant at which a ball of 1 kg that leaves a spring at rest with `v` [m/s] has moved by `x` [m].
fn instant(v: f64, x: f64) -> f64 {
    let omega = K.sqrt();
    asin(x * omega / v) / omega
}

/// Three balls on threads: two tear off, one of them from two threads side by side, and one holds. The order of the
/// threads is not that of the islands.
fn torn() -> (Network, Vec<Option<f64>>) {
    let mut network = Network::new();
    network.part("w", None);
    let nails = [0.0, 1.0, 2.0].map(|y| point(&mut network, "n", 0.0, [0.0, y], 0.0));
    let ends: Vec<(SpacePoint, SpacePoint)> = (nails.into_iter().zip([0.4, 0.8, 0.1]))
        .zip([0.0, 1.0, 2.0])
        .map(|((nail, v), y)| (nail, point(&mut network, "b", 1.0, [LENGTH, y], v)))
        .collect();
    thread(&mut network, ends[0], LOOSE, 12e-3);
    thread(&mut network, ends[1], K, 8e-3);
    thread(&mut network, ends[2], K, 8e-3);
    thread(&mut network, ends[0], K, 8e-3);
    let first = instant(0.4, 8e-3);
    let speed = (0.4_f64 * 0.4 - K * 8e-3 * 8e-3).sqrt();
    for (ball, name) in ends.iter().zip(["a", "b", "c"]) {
        let (first, len, weight) = (ball.1.first, 1, 1.0);
        let term = Term::Position { first, len, weight };
        network.listen(name, vec![term]).unwrap();
    }
    let when = [Some(first + 4e-3 / speed), Some(instant(0.8, 8e-3)), None, Some(first)];
    (network, when.to_vec())
}

fn recorded(mut simulation: Simulation, seconds: f64) -> (MotionLook, MotionFile) {
    let look = simulation.make_look();
    let parts: Vec<String> = point_runs(&look)
        .iter()
        .map(|run| {
            let (first, count, kind) = (run.points.start, run.points.len(), run.kind);
            format!(r#"{{"first": {first}, "count": {count}, "kind": "{kind}"}}"#)
        })
        .collect();
    let (n, parts) = (look.points.len(), parts.join(", "));
    let setup = RecordingSetup {
        manifest: format!(r#"{{"points": {n}, "modes": 0, "parts": [{parts}]}}"#),
        point_positions: vec![[0.0; 3]; n],
        ergons: Vec::new(),
        strike_points: HashMap::new(),
        key_mats: Vec::new(),
        n_speakers: 0,
        looks_per_second: FPS,
    };
    let mut recorder = Recorder::new(&simulation, look.clone(), setup).unwrap();
    while recorder.next_frame() <= (seconds * RATE) as u64 {
        simulation.skip(recorder.next_frame() - simulation.frame()).unwrap();
        recorder.record_look(&mut simulation);
    }
    (look, MotionFile::new(recorder.finish()).unwrap())
}

/// The ends of each link in the table, as MATs.
fn links(look: &MotionLook, file: &MotionFile) -> Vec<(usize, usize)> {
    let table = file.chunks().iter().find(|place| place.kind == kind::LINKS);
    let mut from = ByteReader(file.payload(table.unwrap()));
    let n = from.u32().unwrap();
    let mut mat = || look.points[from.u32().unwrap() as usize].mat;
    (0..n).map(|_| (mat(), mat())).collect()
}

fn check(simulation: Simulation, network: &Network, when: &[Option<f64>]) {
    let (look, file) = recorded(simulation, 2.5);
    let table = links(&look, &file);
    let mut output = vec![Vec::new(); when.len()];
    for place in file.chunks().iter().filter(|place| place.kind == kind::BROKEN) {
        let mut from = ByteReader(file.payload(place));
        while !from.0.is_empty() {
            let instant = place.seconds + from.f32().unwrap();
            let number = from.u32().unwrap() as usize;
            // Each link has two pairs, one for each of its two axes.
            assert_eq!(number % 2, 0);
            let link = number / 2;
            let run = network.run_of(link).unwrap();
            assert_eq!(table[number], run.pair(link - run.first, 0));
            output[link].push((place.seconds, instant));
        }
    }
    for (output, when) in output.iter().zip(when) {
        let Some(when) = when else {
            assert_eq!(output, &[]);
            continue;
        };
        // Reported at the first look after the break, and at the beginning of each second.
        let seconds: Vec<f64> = output.iter().map(|(seconds, _)| *seconds).collect();
        let late = seconds[0] - when;
        assert!((-1e-4..1.0 / FPS + 1e-4).contains(&late), "{late} s late");
        assert_eq!(seconds.len(), 3);
        assert!((seconds[1] - 1.0).abs() < 1e-4 && (seconds[2] - 2.0).abs() < 1e-4);
        for (_, instant) in output {
            assert!((instant - seconds[0]).abs() < 1e-6);
        }
    }
}

#[test]
fn broken_links_arrive_at_once_and_in_states() {
    let (network, when) = torn();
    let network = Arc::new(network);
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let options = SimulationOptions {
        keeps_ledger: false,
        records_ergons: false,
        on_fault: OnFault::Stop,
        threads: 1,
        is_unchecked: false,
    };
    let complete = Simulation::new(network.clone(), &timeline, options).unwrap();
    check(complete, &network, &when);
    let plan = Plan::new(network.clone(), &timeline, &Budget::Error(-20.0), None).unwrap();
    let planned = Simulation::from_plan(Arc::new(plan), options).unwrap();
    check(planned, &network, &when);
}
