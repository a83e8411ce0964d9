//! Threads share a gong that is large enough, beside smaller parts that are distributed among them: whatever happens,
//! the number of threads changes no byte.

use std::sync::Arc;

use super::blocks::play;
use super::scene::options;
use ergon_engine::generator::{Rim, Shape, plate};
use ergon_engine::network::{Network, Term};
use ergon_engine::plan::{Budget, Method, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

const N: usize = 150;

/// A version of the piece, with the pitch of each gong.
fn piece(f: [f64; 2], method: Method) -> Arc<Plan> {
    struck(f, method, 0.02)
}

/// The same with strikes of another impulse [N·s].
fn struck([gong, bell]: [f64; 2], method: Method, impulse: f64) -> Arc<Plan> {
    let mut network = Network::new();
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    timeline.open();
    for (radius, f, part) in [(32, gong, "gong"), (3, bell, "bell"), (2, 65.4, "other")] {
        network.part(part, None);
        let topology = plate(Shape::Hex, radius, Rim::Fixed).unwrap();
        let first = network.n_mat();
        network.mesh("p", &topology, 0.3, f, Some(4.0), 4e8).unwrap();
        listen(&mut network, part, first + 9);
        timeline
            .strike(&network, first + 5, 1e-3, impulse, Some(0.0), 0)
            .unwrap();
    }
    Arc::new(Plan::new(Arc::new(network), &timeline, &Budget::Method(method), None).unwrap())
}

fn listen(network: &mut Network, name: &str, first: usize) {
    let (len, weight) = (1, 1.0);
    let term = Term::Position { first, len, weight };
    network.listen(name, vec![term]).unwrap();
}

fn by(threads: usize) -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        threads,
        ..options(OnFault::Mute)
    }
}

/// The sound is the same for 1, 2 and 3 threads, and is not silence.
fn same_for_all(sound: impl Fn(usize, &[usize]) -> Vec<u64>) {
    let alone = sound(1, &[2 * N]);
    assert!(alone.iter().rev().take(N).any(|bits| *bits != 0));
    assert!(alone == sound(2, &[2 * N]));
    assert!(alone == sound(3, &[7, 2 * N]));
}

#[test]
fn threads_agree_bitwise_after_restore_and_fork() {
    for method in [Method::Ca, Method::Ca2p] {
        let plan = piece([65.4, 65.4], method);
        same_for_all(|threads, blocks| {
            let mut simulation = Simulation::from_plan(plan.clone(), by(threads)).unwrap();
            let mut all = play(&mut simulation, N, blocks);
            // The fork has threads of its own.
            let (snapshot, mut fork) = (simulation.snapshot(), simulation.fork());
            let end = play(&mut simulation, N, &[N]);
            assert!(play(&mut fork, N, blocks) == end);
            simulation.restore(&snapshot);
            assert!(play(&mut simulation, N, blocks) == end);
            all.extend(end);
            all
        });
    }
}

/// The first takeover keeps the gong, the second replaces it.
#[test]
fn threads_agree_bitwise_after_take_over() {
    for method in [Method::Ca, Method::Ca2p] {
        let versions = [[65.4, 65.4], [65.4, 80.0], [70.0, 80.0]].map(|f| piece(f, method));
        same_for_all(|threads, blocks| {
            let mut playing = Simulation::from_plan(versions[0].clone(), by(threads)).unwrap();
            let mut all = play(&mut playing, N, blocks);
            for plan in &versions[1..] {
                let (plan, position) = (plan.clone(), playing.frame());
                let mut new = Simulation::from_plan_at_frame(plan, by(threads), position).unwrap();
                let mut takeover = Takeover::new(&playing, &new);
                assert!(new.take_over(&mut playing, &mut takeover));
                playing = new;
                playing.damp(Some(0.1));
                all.extend(play(&mut playing, N, blocks));
            }
            all
        });
    }
}

/// Strikes so hard that frames are computed in finer steps.
#[test]
fn threads_agree_bitwise_with_finer_frames() {
    for method in [Method::Ca, Method::Ca2p] {
        let plan = struck([65.4, 65.4], method, 0.5);
        same_for_all(|threads, blocks| {
            let mut simulation = Simulation::from_plan(plan.clone(), by(threads)).unwrap();
            let sound = play(&mut simulation, 2 * N, blocks);
            let finer = simulation.finer_parts();
            assert!(
                finer.iter().any(|(part, frames, _)| part == "gong" && *frames > 20),
                "{finer:?}"
            );
            sound
        });
    }
}

/// A part that is muted takes its links out of the mesh that threads share.
#[test]
fn threads_agree_bitwise_after_mute() {
    let mut network = Network::new();
    network.part("gong", None);
    let topology = plate(Shape::Hex, 32, Rim::Fixed).unwrap();
    network.mesh("p", &topology, 0.3, 65.4, Some(4.0), 4e8).unwrap();
    listen(&mut network, "gong", 9);
    network.part("sick", None);
    // Passes 10 km after 44 frames.
    let mass = network.mas("m", 1.0, 0.0, 1e7).unwrap();
    network.spring("r", 11, mass, 1e-3, 0.0, 0.0).unwrap();
    let network = Arc::new(network);
    let timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    same_for_all(|threads, blocks| {
        let mut simulation = Simulation::new(network.clone(), &timeline, by(threads)).unwrap();
        let sound = play(&mut simulation, 2 * N, blocks);
        assert_eq!(simulation.muted_parts().len(), 1);
        sound
    });
}
