//! CA equals the scheme by which an island steps, to the last bit; a clone is a snapshot.

use super::*;
use crate::network::{But, Contact, Side, Tie};
use crate::simulation::{OnFault, Simulation, SimulationOptions};
use crate::timeline::Timeline;

/// A mesh with all kinds of links, and a contact of each kind.
fn everything() -> Network {
    let mut network = hex(2e12, Some(0.5));
    let tuned_tie = Tie::Tuned {
        f: 300.0,
        t60: Some(0.3),
    };
    let soft_contact = But {
        side: Side::Above,
        exponent: 1.5,
        is_clamped: true,
        ..But::plain(3e5, 0.3, 1e-4)
    };
    let hammer_mat = network.cel("hammer", 5e-3, tuned_tie, 0.0, 2e-4, -3.0).expect("a cell");
    network.but("felt", hammer_mat, 40, soft_contact).expect("a contact");
    let exact_contact = But {
        contact: Contact::Exact,
        side: Side::Below,
        exponent: 1.0,
        ..soft_contact
    };
    network.but("stop", hammer_mat, 200, exact_contact).expect("a contact");
    network.set_initial_motion(100, 1e-4, 0.7).expect("a start");
    network
}

#[test]
fn integrator_by_ca_equals_the_scheme_of_islands() {
    let network = Arc::new(everything());
    let strikes = [(0, 165, 0.02), (17, 3, -0.01), (18, 3, 0.004)];
    let mut timeline = Timeline::new(rate());
    for (frame, mat, impulse) in strikes {
        timeline
            .strike(&network, mat, frame as f64 / HERTZ, impulse, Some(0.0), 0)
            .expect("a strike");
    }
    let options = SimulationOptions {
        keeps_ledger: false,
        records_ergons: false,
        on_fault: OnFault::Stop,
        threads: 1,
        is_unchecked: false,
    };
    let mut simulation = Simulation::new(network.clone(), &timeline, options).expect("it plays");
    let mesh_path = play(by(&network, MeshMethod::Ca, 1), 600, &strikes);
    for (frame, x) in mesh_path.iter().enumerate() {
        simulation.skip(1).expect("it is stable");
        let island_state = simulation.positions();
        for (x, island_state) in x.iter().zip(island_state) {
            assert_eq!(x.to_bits(), island_state.to_bits(), "frame {frame}");
        }
    }
    assert_eq!(mesh_path.len(), 600);
}

#[test]
fn clone_of_integrator_continues_with_the_same_bits() {
    for method in MeshMethod::ALL {
        let network = hex(2e12, Some(0.5));
        let mut integrator = by(&network, method, 2);
        integrator.step(&[(165, 0.02)], &mut ThreadTeam::alone());
        for _ in 0..20 {
            integrator.step(&[], &mut ThreadTeam::alone());
        }
        let mut integrator_copy = integrator.clone();
        for _ in 0..20 {
            integrator.step(&[(3, 1e-3)], &mut ThreadTeam::alone());
            integrator_copy.step(&[(3, 1e-3)], &mut ThreadTeam::alone());
        }
        assert_eq!(integrator.positions(), integrator_copy.positions());
        assert!(integrator.is_bounded() && integrator.energy() > 0.0);
    }
}

/// A mesh partitioned for a thread team gives the same bits for any number of threads.
#[test]
fn thread_team_steps_the_same_bits() {
    // Enough masses for three ranges, and every kind of pass: with losses of links, with losses of ties, and without
    // losses.
    let hung_mesh = |t60: Option<f64>| {
        let mut network = hex_of(32, 60.0, 1e12, t60);
        let physical_tie = Tie::Physical { k: 1e3, z: 0.2 };
        network.cel("hung", 1e-3, physical_tie, 0.0, 1e-4, 0.0).expect("a cell");
        network
    };
    for (network, method) in [
        (hung_mesh(Some(0.5)), MeshMethod::Ca),
        (hung_mesh(Some(0.5)), MeshMethod::Ca2p),
        (hung_mesh(Some(0.5)), MeshMethod::Bm4),
        (hung_mesh(None), MeshMethod::Ca2p),
        (hung_mesh(None), MeshMethod::Bm4),
        (hex_of(32, 60.0, 1e12, None), MeshMethod::Bm4),
    ] {
        let last_state = |threads: usize| {
            let mut integrator = by(&network, method, 1);
            integrator.partition(threads);
            assert_eq!(integrator.can_share_work(), threads > 1);
            crate::kernel::thread_team::with_denormals_flushed(|| {
                ThreadTeam::with_threads(threads, |team| {
                    integrator.step(&[(700, 0.02), (1584, 0.03), (1585, -0.01)], team);
                    (0..15).for_each(|_| integrator.step(&[], team));
                });
            });
            let position_bits = integrator.positions().iter().map(|x| x.to_bits());
            (position_bits.collect::<Vec<_>>(), integrator.energy().to_bits())
        };
        let lone_state = last_state(1);
        assert_eq!(lone_state, last_state(2), "{method:?}");
        assert_eq!(lone_state, last_state(3), "{method:?}");
    }
}
