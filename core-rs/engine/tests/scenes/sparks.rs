//! Sparks of written gestures, compared with the ergons that struck; watching changes no sample.

use std::collections::HashMap;
use std::sync::Arc;

use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{ErgonKind, Gesture, Manner, Touch};
use ergon_engine::gesture::written::{Approach, WrittenPoints};
use ergon_engine::network::{Network, Term, Tie};
use ergon_engine::plan::{Budget, Plan};
use ergon_engine::simulation::{ErgonRecord, MotionLook, MotionSnapshot, OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

use super::scene::Scene;

const RATE: f64 = 44_100.0;
/// Mass of the key [kg].
const KEY: f64 = 0.08;
/// Number of frames between two looks.
const LOOK: usize = 735;
/// Ergons of a stream that are at most this far apart are seen as one [s].
const TOGETHER: f64 = 1e-3;

const RECORDED: SimulationOptions = SimulationOptions {
    keeps_ledger: false,
    records_ergons: true,
    on_fault: OnFault::Stop,
    threads: 1,
    is_unchecked: false,
};

/// A key that is heard, and one gesture on it: up 4 mm and back.
fn played(method: Approach, manner: Manner) -> Simulation {
    let mut network = Network::new();
    network.part("bell", None);
    let tie = |k, z| Tie::Physical { k, z };
    network.cel("b", 2e-3, tie(4e3, 0.01), 0.0, 0.0, 0.0).unwrap();
    network.part("key", None);
    let struck = network.cel("m", KEY, tie(20.0, 0.4), 0.0, 0.0, 0.0).unwrap();
    network.spring("s", struck, 0, 5.0, 0.0, 0.0).unwrap();
    let term = Term::Position {
        first: 0,
        len: 2,
        weight: 1.0,
    };
    network.listen("both", vec![term]).unwrap();
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    let key = timeline.add_key("key", struck);
    let written = WrittenPoints {
        t: &[0.01, 0.05, 0.13],
        x: &[0.0, 4e-3, 0.0],
        approaches: &[method; 3],
        sources: &[3, 4, 5],
    };
    let gesture = Gesture::from_points(key, &written, manner).unwrap();
    timeline.add_gesture(gesture).unwrap();
    simulation(network, &timeline)
}

fn simulation(network: Network, timeline: &Timeline) -> Simulation {
    let plan = Plan::new(Arc::new(network), timeline, &Budget::default(), None).unwrap();
    Simulation::from_plan(Arc::new(plan), RECORDED).unwrap()
}

/// For each look: the ergons that struck, and the sparks that are seen.
fn looks(simulation: &mut Simulation, n: usize, frames: usize) -> Vec<(Vec<ErgonRecord>, Vec<ErgonRecord>)> {
    let look = simulation.make_look();
    simulation.start_watching();
    let mut snapshot = MotionSnapshot::new(simulation, &look);
    let mut first = |simulation: &mut Simulation, look: &MotionLook| {
        simulation.skip(frames as u64).unwrap();
        simulation.fill_snapshot(look, &mut snapshot);
        (simulation.take_ergons(), snapshot.sparks().to_vec())
    };
    (0..n).map(|_| first(simulation, &look)).collect()
}

/// Expected sparks of a stream: for each run of ergons of one sign without a gap, the impulse and the mean instant and
/// speed. A particle that is 1e-4 times as heavy as the key gives the impulse p to a key at rest if its speed is p (1 +
/// 1e-4)/(2e-4 M).
fn gathered(struck: &[ErgonRecord]) -> Vec<[f64; 3]> {
    let mut all = Vec::new();
    for sign in [1.0, -1.0] {
        let same: Vec<&ErgonRecord> = (struck.iter()).filter(|ergon| ergon.impulse * sign > 0.0).collect();
        for run in same.chunk_by(|a, b| b.time - a.time <= TOGETHER) {
            let impulse: f64 = run.iter().map(|ergon| ergon.impulse).sum();
            let mean = |source: fn(&ErgonRecord) -> f64| {
                let all = run.iter().map(|ergon| ergon.impulse / impulse * source(ergon));
                all.sum::<f64>()
            };
            let speed = |ergon: &ErgonRecord| ergon.impulse * 1.0001 / (2e-4 * KEY);
            all.push([impulse, mean(|ergon| ergon.time), mean(speed)]);
        }
    }
    all.sort_by(|a, b| a[1].total_cmp(&b[1]));
    all
}

fn near(a: f64, b: f64, by: f64) {
    assert!((a - b).abs() <= by, "{a} is not {b}");
}

#[test]
fn sparks_of_smooth_paths_are_gathered_by_sign() {
    let smooth = Approach::Path(Curve::Smooth);
    for touch in [Touch::Open, Touch::Tracked] {
        let manner = Manner { touch, ..Manner::OPEN };
        let mut simulation = played(smooth, manner);
        let mut n = 0;
        for (struck, mut seen) in looks(&mut simulation, 12, LOOK) {
            seen.sort_by(|a, b| a.time.total_cmp(&b.time));
            let expected = gathered(&struck);
            assert_eq!(seen.len(), expected.len());
            assert!(seen.len() <= 4, "{seen:?}");
            for (seen, [impulse, time, speed]) in seen.iter().zip(&expected) {
                near(seen.impulse, *impulse, 1e-12 * impulse.abs());
                near(seen.time, *time, 1e-12);
                near(seen.speed, *speed, 1e-9 * speed.abs());
                assert_eq!(seen.mat, 1);
                assert!([3, 4, 5].contains(&seen.source));
            }
            n += seen.len();
        }
        // The hand pushes up, down, and up again; the downward part is twice as long.
        assert!((8..20).contains(&n), "{n}");
    }
}

#[test]
fn sparks_of_particles_have_their_speed() {
    let manner = Manner {
        ergon_kind: ErgonKind::Particle,
        ..Manner::OPEN
    };
    let mut simulation = played(Approach::Path(Curve::Smooth), manner);
    let all: Vec<_> = looks(&mut simulation, 12, LOOK);
    assert!(all.iter().any(|(_, seen)| seen.len() > 1));
    for (struck, seen) in all {
        assert_eq!(seen.len(), gathered(&struck).len());
        for spark in &seen {
            near(spark.speed, 1_000.0 * spark.impulse.signum(), 1e-6);
        }
    }
}

#[test]
fn sparks_of_throws_and_grains_are_single() {
    let grains = Manner {
        grain: Some(3e-3),
        ..Manner::OPEN
    };
    let smooth = Approach::Path(Curve::Smooth);
    for (method, manner) in [(Approach::Throw, Manner::OPEN), (smooth, grains)] {
        let mut n = 0;
        for (struck, seen) in looks(&mut played(method, manner), 12, LOOK) {
            let output = |all: &[ErgonRecord]| -> Vec<(u64, u64)> {
                let each = all.iter();
                each.map(|ergon| (ergon.time.to_bits(), ergon.impulse.to_bits()))
                    .collect()
            };
            assert_eq!(output(&seen), output(&struck));
            n += seen.len();
        }
        if method == Approach::Throw {
            assert_eq!(n, 2);
        } else {
            assert!((35..45).contains(&n), "{n}");
        }
    }
}

#[test]
fn sparks_beyond_the_limit_are_gathered_by_sign() {
    let manner = Manner {
        grain: Some(1e-4),
        ..Manner::OPEN
    };
    let mut simulation = played(Approach::Path(Curve::Smooth), manner);
    let (struck, seen) = looks(&mut simulation, 1, 8_000).remove(0);
    assert!(struck.len() > 500);
    assert_eq!(seen.len(), 16);
    for (seen, struck) in seen.iter().zip(&struck).take(14) {
        assert_eq!((seen.time, seen.impulse), (struck.time, struck.impulse));
    }
    for up in [true, false] {
        let sum = |all: &[ErgonRecord]| -> f64 {
            let single = all.iter().filter(|ergon| (ergon.impulse > 0.0) == up);
            single.map(|ergon| ergon.impulse).sum()
        };
        near(sum(&seen), sum(&struck), 1e-12 * sum(&struck).abs());
    }
    assert!(seen.iter().all(|ergon| (0.01..0.13).contains(&ergon.time)));
}

/// Sum of the impulses for each MAT and sign.
fn impulses<'a>(all: impl Iterator<Item = &'a ErgonRecord>) -> HashMap<(u32, bool), f64> {
    let mut sums = HashMap::new();
    for ergon in all.filter(|ergon| ergon.impulse != 0.0) {
        *sums.entry((ergon.mat, ergon.impulse > 0.0)).or_default() += ergon.impulse;
    }
    sums
}

#[test]
fn sparks_sum_to_the_impulses_of_gestures() {
    let mut n = 0;
    for seed in 0..24 {
        let scene = Scene::random(seed);
        let frames = scene.n_frames();
        let mut single = scene.simulation(RECORDED);
        let written: Vec<u32> = {
            let written = single.written_ergons(&scene.timeline);
            written.iter().map(|ergon| ergon.mat).collect()
        };
        let all = looks(&mut single, 7, frames / 7);
        // MATs that strikes or ergons of the score hit are not keys here.
        let gestures = all.iter().flat_map(|look| &look.0);
        let struck = impulses(gestures.filter(|ergon| !written.contains(&ergon.mat)));
        let seen = impulses(all.iter().flat_map(|look| &look.1));
        assert_eq!(seen.len(), struck.len(), "{seed}");
        for (at, impulse) in struck {
            near(seen[&at], impulse, 1e-9 * impulse.abs());
        }
        n += all.iter().map(|look| look.1.len()).sum::<usize>();
        let (sparks, ergons) = all.iter().fold((0, 0), |(sparks, ergons), look| {
            (sparks + look.1.len(), ergons + look.0.len())
        });
        assert!(sparks <= ergons, "{seed}");
    }
    assert!(n > 100, "{n}");
}

#[test]
fn watch_changes_no_sample() {
    for seed in 0..12 {
        let scene = Scene::random(seed);
        let sound = |is_watched: bool| -> Vec<u64> {
            let mut single = scene.simulation(RECORDED);
            let look = single.make_look();
            let mut snapshot = MotionSnapshot::new(&single, &look);
            if is_watched {
                single.start_watching();
            }
            let mut out = vec![0.0; scene.n_frames() * single.n_out()];
            for block in out.chunks_mut(500 * single.n_out()) {
                single.process(block).unwrap();
                if is_watched {
                    single.fill_snapshot(&look, &mut snapshot);
                }
            }
            out.iter().map(|x| x.to_bits()).collect()
        };
        assert!(sound(true) == sound(false), "{seed}");
    }
}
