//! A plan gives the motion of the scene as written.

use std::sync::Arc;

use ergon_engine::network::{But, Contact, Network, Side, Term, Tie};
use ergon_engine::plan::{Budget, Computation, Method, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

use super::scene::{Scene, options};

fn render(mut simulation: Simulation, n_frames: usize) -> Vec<f64> {
    let mut out = vec![0.0; n_frames * simulation.n_out()];
    simulation.process(&mut out).unwrap();
    out
}

/// Within an island every sum of forces is the same sum, so the bits are the same, except for outputs that add up
/// several islands.
#[test]
fn islands_equal_the_unsplit_network() {
    for seed in 0..60 {
        let scene = Scene::random(seed);
        let network = Arc::new(scene.network.clone());
        let plan = Plan::new(network, &scene.timeline, &Budget::Method(Method::Ca), None).unwrap();
        let options = SimulationOptions {
            keeps_ledger: false,
            ..options(OnFault::Stop)
        };
        let complete = render(scene.simulation(options), scene.n_frames());
        let planned = Simulation::from_plan(Arc::new(plan), options).unwrap();
        let planned = render(planned, scene.n_frames());
        let peak = complete.iter().fold(0.0_f64, |peak, x| peak.max(x.abs()));
        for (a, b) in complete.iter().zip(&planned) {
            assert!((a - b).abs() <= 1e-15 * peak, "{seed}: {a} {b}");
        }
    }
}

fn peak(sound: &[f64]) -> f64 {
    sound.iter().fold(0.0, |peak, x| peak.max(x.abs()))
}

/// Twelve tied masses in a row, defined at 44.1 kHz, deflected and struck; heard at two points and all together.
fn discrete() -> (Network, Timeline) {
    let rate = Rate::new(44_100.0).unwrap();
    let mut network = Network::new();
    network.part("body", Some(rate));
    for i in 0..12 {
        let (k, z) = (0.01, 2e-5 + 1e-3 * 0.01);
        let tie = Tie::Physical { k, z };
        let v0 = if i == 2 { 0.3 } else { 0.0 };
        network.cel("m", 1.0, tie, 0.0, 1e-4 * f64::from(i), v0).unwrap();
    }
    for i in 0..11 {
        network.spring("l", i, i + 1, 0.4, 1e-3 * 0.4, 0.0).unwrap();
    }
    let point = |first, len, weight| Term::Position { first, len, weight };
    network.listen("left", vec![point(3, 1, 1.0)]).unwrap();
    network.listen("right", vec![point(7, 2, -0.5)]).unwrap();
    network.listen("all", vec![point(0, 12, 0.1)]).unwrap();
    let mut timeline = Timeline::new(rate);
    for (mat, instant, impulse) in [(1, 0.0, 1e-6), (5, 0.01, -2e-6), (1, 0.0100001, 3e-6)] {
        timeline.strike(&network, mat, instant, impulse, Some(0.0), 0).unwrap();
    }
    (network, timeline)
}

/// A discrete network is exact by definition, and its modes equal it: up to rounding, for seconds.
#[test]
fn modal_discrete_body_equals_its_network() {
    let (network, timeline) = discrete();
    let network = Arc::new(network);
    let options = SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    };
    let complete = Simulation::new(network.clone(), &timeline, options).unwrap();
    let plan = Plan::new(network, &timeline, &Budget::Method(Method::Modal), None).unwrap();
    let Computation::Modes {
        n_modes: source,
        n_computed: saved,
        ..
    } = plan.rows()[0].computation
    else {
        panic!("{:?}", plan.rows());
    };
    assert_eq!((source, saved), (12, 12));
    let planned = Simulation::from_plan(Arc::new(plan), options).unwrap();
    let (complete, planned) = (render(complete, 88_200), render(planned, 88_200));
    let limit = complete
        .iter()
        .zip(&planned)
        .fold(0.0_f64, |limit, (a, b)| limit.max((a - b).abs()));
    assert!(limit <= 1e-10 * peak(&complete), "{limit} of {}", peak(&complete));
}

/// The same body with hands, contacts and couplings: modes that are pushed at their ports still equal the discrete
/// network, even if contacts open and close and strikes fall in between.
#[test]
fn modal_discrete_body_equals_its_network_in_contact() {
    for contact in [Contact::Plain, Contact::Exact] {
        let (mut network, mut timeline) = discrete();
        let rate = Rate::new(44_100.0).unwrap();
        network.part("hammer", Some(rate));
        let hammer = network.mas("m", 2.0, -2e-3, 0.8).unwrap();
        let nail = network.sol("n", 0.01).unwrap();
        let but = |k: f64, side| But {
            side,
            contact,
            ..But::plain(k, 1e-3, 5e-4)
        };
        network.but("b", hammer, 4, but(0.3, Side::Below)).unwrap();
        network.but("back", hammer, 9, but(0.2, Side::Above)).unwrap();
        network.spring("hold", hammer, nail, 1e-5, 0.0, 0.0).unwrap();
        network
            .listen(
                "h",
                vec![Term::Position {
                    first: hammer,
                    len: 1,
                    weight: 1.0,
                }],
            )
            .unwrap();
        network
            .listen(
                "f",
                vec![Term::Force {
                    first: 11,
                    len: 2,
                    weight: 1.0,
                }],
            )
            .unwrap();
        timeline.strike(&network, 4, 0.015, 2e-6, Some(0.0), 0).unwrap();
        let network = Arc::new(network);
        let options = SimulationOptions {
            keeps_ledger: false,
            ..options(OnFault::Stop)
        };
        let n_frames = 30_000;
        let complete = render(Simulation::new(network.clone(), &timeline, options).unwrap(), n_frames);
        let plan = Arc::new(Plan::new(network, &timeline, &Budget::Method(Method::Modal), None).unwrap());
        assert!(
            matches!(plan.rows()[1].computation, Computation::Modes { n_modes: 12, .. }),
            "{:?}",
            plan.rows()
        );
        let mut simulation = Simulation::from_plan(plan, options).unwrap();
        let mut planned = vec![0.0; complete.len()];
        let n_out = simulation.n_out();
        // In blocks of any size, and again from a snapshot.
        let mut position = 0;
        for block in [1, 63, 64, 65, 997, 12_345] {
            let end = position + block * n_out;
            simulation.process(&mut planned[position..end]).unwrap();
            position = end;
        }
        let moment = simulation.snapshot();
        simulation.process(&mut planned[position..]).unwrap();
        let first = planned[position..].to_vec();
        simulation.restore(&moment);
        simulation.process(&mut planned[position..]).unwrap();
        assert_eq!(first, planned[position..]);
        for output in 0..n_out {
            let source = |sound: &[f64]| -> Vec<f64> { sound.iter().skip(output).step_by(n_out).copied().collect() };
            let (complete, planned) = (source(&complete), source(&planned));
            // Later, the smallest difference has grown: a ball between two walls amplifies it.
            let (complete, planned) = (&complete[..1_000], &planned[..1_000]);
            let limit = complete
                .iter()
                .zip(planned)
                .fold(0.0_f64, |limit, (a, b)| limit.max((a - b).abs()));
            assert!(
                peak(complete) > 0.0 && limit <= 1e-8 * peak(complete),
                "{contact:?} {output}: {limit} of {}",
                peak(complete)
            );
        }
    }
}
