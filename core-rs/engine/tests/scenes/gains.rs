//! Contacts and meshes that create energy are named, and stop the run or are muted.

use std::sync::Arc;

use ergon_engine::network::{But, Network, Term, Tie};
use ergon_engine::plan::{Budget, Method, Plan, PlanContext};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

const HERTZ: f64 = 44_100.0;

const fn options(on_fault: OnFault) -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        records_ergons: false,
        on_fault,
        threads: 1,
        is_unchecked: false,
    }
}

/// A hammer meets a cell through a contact of stiffness `k`, beside a bell; the cell's part has `units: ca` if a rate
/// is given.
fn hammered(k: f64, ca: Option<Rate>) -> Network {
    let mut network = Network::new();
    network.part("bell", None);
    let tie = Tie::Tuned {
        f: 440.0,
        t60: Some(1.0),
    };
    // Beside algorithmic energies, the energy of a moving bell would hide the created energy: here the bell is at rest.
    let x0 = if ca.is_some() { 0.0 } else { 1e-3 };
    network.cel("m", 1e-2, tie, 0.0, x0, 0.0).unwrap();
    network.part("stiff", ca);
    let tie = Tie::Tuned { f: 1369.0, t60: None };
    let cell = match ca {
        None => network.cel("t", 0.026, tie, 0.0, 0.0, 0.0).unwrap(),
        Some(_) => {
            let tie = Tie::Physical { k: 1e-3, z: 0.0 };
            network.cel("t", 0.026, tie, 0.0, 0.0, 0.0).unwrap()
        }
    };
    let hammer = network.mas("h", 1.7e-3, 0.0, 0.473).unwrap();
    let but = But {
        exponent: 1.5,
        ..But::plain(k, 0.0, 1e-4)
    };
    network.but("c", hammer, cell, but).unwrap();
    for (name, first) in [("bell", 0), ("stiff", cell)] {
        let (len, weight) = (1, 1.0);
        let term = Term::Position { first, len, weight };
        network.listen(name, vec![term]).unwrap();
    }
    network
}

fn begin(network: Network, on_fault: OnFault) -> Simulation {
    let timeline = Timeline::new(Rate::new(HERTZ).unwrap());
    Simulation::new(Arc::new(network), &timeline, options(on_fault)).unwrap()
}

fn play(simulation: &mut Simulation) -> Vec<f64> {
    let mut out = vec![0.0; 2 * 4_410];
    simulation.process(&mut out).unwrap();
    out
}

#[test]
fn too_stiff_contact_stops_a_render() {
    let mut simulation = begin(hammered(3e11, None), OnFault::Stop);
    let fault = simulation.skip(4_410).unwrap_err();
    assert_eq!((&*fault.module, &*fault.part), ("stiff.c", "stiff"));
    let sentence = fault.to_string();
    assert!(sentence.contains("stiff.c created energy"), "{sentence}");
    assert!(sentence.contains("created energy: 5.5 J until"), "{sentence}");
}

#[test]
fn mute_of_a_part_with_created_energy() {
    let mut simulation = begin(hammered(3e11, None), OnFault::Mute);
    let out = play(&mut simulation);
    let muted = simulation.muted_parts();
    assert_eq!((muted.len(), &*muted[0].0), (1, "stiff"));
    assert_eq!(simulation.energy_gains().len(), 0, "its links are gone");
    let healthy = play(&mut begin(hammered(1.0, None), OnFault::Stop));
    let bell = |out: &[f64]| out.iter().step_by(2).copied().collect::<Vec<_>>();
    assert_eq!(bell(&out), bell(&healthy));
}

#[test]
fn contact_slow_beside_its_steps_creates_no_energy() {
    let mut simulation = begin(hammered(1e7, None), OnFault::Stop);
    play(&mut simulation);
    assert_eq!(simulation.energy_gains(), []);
}

/// Energy that a contact created long ago is compared with the energy of that time, not with what damping has left.
#[test]
fn energy_created_and_lost_again_causes_no_fault() {
    let mut network = Network::new();
    network.part("key", None);
    let wall = network.sol("w", 0.0).unwrap();
    let tie = Tie::Tuned {
        f: 8_000.0,
        t60: Some(3e-3),
    };
    // The mass meets the contact with 50 mJ, and turns back before the contact has taken up energy.
    let key = network.cel("m", 1e-4, tie, 0.0, 1e-3, 0.0).unwrap();
    network.but("c", wall, key, But::plain(1e5, 0.0, 7e-4)).unwrap();
    let mut simulation = begin(network, OnFault::Stop);
    simulation.skip(44_100).unwrap();
    let gains = simulation.energy_gains();
    let [(_, _, sentence)] = &gains[..] else {
        panic!("{gains:?}");
    };
    assert!(
        sentence.contains("created energy: 3.1 mJ until 0.006 s, where the system held 50 mJ"),
        "{sentence}"
    );
}

/// If the steps define the instrument, created energy is reported but does not stop the run.
#[test]
fn created_energy_under_units_ca_is_reported() {
    let rate = Rate::new(HERTZ).ok();
    let mut simulation = begin(hammered(50.0, rate), OnFault::Stop);
    play(&mut simulation);
    let gains = simulation.energy_gains();
    assert_eq!((gains.len(), &*gains[0].0), (1, "stiff.c"), "{gains:?}");
    assert!(simulation.muted_parts().is_empty());
}

/// For IEQ, the energy that counts is that of its own scheme, not that of the masses and springs.
#[test]
fn mesh_energy_is_compared_by_its_laws() {
    let mut network = Network::new();
    network.part("wire", None);
    let wall = network.sol("w", 0.0).unwrap();
    let mut before = wall;
    for i in 0..12 {
        let x = if i == 4 { 1e-3 } else { 0.0 };
        let mass = network.mas(&format!("m{i}"), 8e-4, x, 0.0).unwrap();
        let law = ergon_engine::law::Law::hardening(1e5, 2e14, 0.0).unwrap();
        network.lnl(&format!("l{i}"), before, mass, Arc::new(law), 0.0).unwrap();
        before = mass;
    }
    let (first, len, weight) = (before, 1, 1.0);
    network
        .listen("o", vec![Term::Position { first, len, weight }])
        .unwrap();
    let (network, timeline) = (Arc::new(network), Timeline::new(Rate::new(HERTZ).unwrap()));
    let budget = Budget::Method(Method::Ieq);
    let plan = Plan::new(network, &timeline, &budget, None).unwrap();
    let mut simulation = Simulation::from_plan(Arc::new(plan), options(OnFault::Stop)).unwrap();
    let fault = simulation.skip(11_025).unwrap_err();
    assert!(fault.to_string().contains("created energy"), "{fault}");
}

/// A mass of 1 g between two springs of 50 kN/m of viscosity `z`, which meets a stop; the forces of the first `n_heard`
/// springs are heard, so that damped ones are stepped.
fn rattling(n_heard: usize, z: f64) -> Network {
    let mut network = Network::new();
    network.part("rattle", None);
    let [ground, stop] = [("g", 0.0), ("s", -1e-4)].map(|(name, x)| network.sol(name, x).unwrap());
    let mass = network.mas("m", 1e-3, 1e-3, 0.0).unwrap();
    let springs = ["l", "r"].map(|name| network.spring(name, ground, mass, 5e4, z, 0.0).unwrap());
    network.but("c", stop, mass, But::plain(1.5e5, 0.0, 0.0)).unwrap();
    let (len, weight) = (1, 1.0);
    let term = Term::Position {
        first: mass,
        len,
        weight,
    };
    network.listen("x", vec![term]).unwrap();
    for &first in &springs[..n_heard] {
        let term = Term::Force { first, len, weight };
        network.listen(&format!("f{first}"), vec![term]).unwrap();
    }
    network
}

/// Viscosity that leaves a thousandth of the motion after 7 s [N·s/m].
const Z: f64 = 1e-3;

/// Two seconds of it by a plan without trials, and its outputs.
fn rattled(n_heard: usize, z: f64, on_fault: OnFault) -> (Simulation, Result<Vec<f64>, String>) {
    let (network, timeline) = (Arc::new(rattling(n_heard, z)), Timeline::new(Rate::new(HERTZ).unwrap()));
    let budget = Budget::Error(-20.0);
    let known = PlanContext {
        allowance_share: 0.0,
        ..PlanContext::default()
    };
    let plan = Plan::in_context(network, &timeline, &budget, None, known).unwrap();
    let mut simulation = Simulation::from_plan(Arc::new(plan), options(on_fault)).unwrap();
    let mut out = vec![0.0; (1 + n_heard) * 88_200];
    let played = simulation.process(&mut out).map(|()| out);
    (simulation, played.map_err(|fault| fault.to_string()))
}

#[test]
fn small_body_in_contact_keeps_its_energy() {
    // The force of an undamped spring is a sum of positions.
    for n_heard in [0, 2] {
        let (simulation, out) = rattled(n_heard, 0.0, OnFault::Stop);
        let out: Vec<f64> = out.unwrap().into_iter().step_by(1 + n_heard).collect();
        let rise = rise(&out);
        assert!((rise - 1.0).abs() < 1e-3, "{n_heard}: {rise}");
        assert_eq!(simulation.energy_gains(), []);
    }
}

/// Ratio of the last to the first peak of the mass: where it turns away from the stop, all its energy is in the
/// springs.
fn rise(out: &[f64]) -> f64 {
    let peak = |part: &[f64]| part.iter().fold(0.0_f64, |most, x| most.max(*x));
    peak(&out[66_150..]) / peak(&out[..22_050])
}

/// By one spring that is stepped at a port of a body, or by two at a stepped mass: none is created, or it is told.
#[test]
fn created_energy_of_a_spring_beside_a_contact() {
    for n_heard in [1, 2] {
        let (simulation, out) = rattled(n_heard, Z, OnFault::Stop);
        match out {
            Ok(out) if simulation.energy_gains().is_empty() => {
                let out: Vec<f64> = out.into_iter().step_by(1 + n_heard).collect();
                assert!(rise(&out) < 1.005, "{n_heard}: {}", rise(&out));
            }
            Ok(_) => {}
            Err(fault) => assert!(fault.contains("rattle.c created energy"), "{fault}"),
        }
    }
}

#[test]
fn mute_with_energy_created_between_frames() {
    let (simulation, out) = rattled(2, Z, OnFault::Mute);
    let out = out.unwrap();
    let muted = simulation.muted_parts();
    assert_eq!((muted.len(), &*muted[0].0), (1, "rattle"));
    assert!(out.chunks(3).all(|row| row[0].abs() < 2e-3));
    assert!(out[out.len() - 3..].iter().all(|x| *x == 0.0));
}
