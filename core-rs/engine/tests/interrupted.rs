//! Looks for an interrupt are counted: a body of many masses has at least one for every few thousand of them, wherever
//! all of them are passed over.

use std::cell::Cell;
use std::rc::Rc;
use std::sync::Arc;

use ergon_engine::generator::{Ends, string};
use ergon_engine::interrupt::{Stopped, until};
use ergon_engine::network::Term;
use ergon_engine::plan::{Budget, Method, Plan};
use ergon_engine::{Network, OnFault, Rate, Simulation, SimulationOptions, Timeline};

const MASSES: usize = 200_000;
/// Masses for which there is at least one poll in each pass over all.
const MASSES_PER_POLL: usize = 8_192;

/// The result of `work`, and how often it looked for an interrupt.
fn looks<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let count = Rc::new(Cell::new(0));
    let single = count.clone();
    let ask = move || {
        single.set(single.get() + 1);
        false
    };
    let done = until(Box::new(ask), work).expect("nobody stops it");
    (done, count.get())
}

fn options(threads: usize) -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        records_ergons: false,
        on_fault: OnFault::Stop,
        threads,
        is_unchecked: false,
    }
}

/// Two long strings that an output hears, the first of them struck.
fn strings() -> (Network, Timeline) {
    let mut network = Network::new();
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    let topology = string(MASSES, Ends::Fixed, 0.0).unwrap();
    let mut listened = Vec::new();
    for name in ["first", "second"] {
        network.part(name, None);
        let first = network.mesh("", &topology, 1.0, 0.05, None, 0.0).unwrap();
        listened.push(first);
    }
    let terms = listened.iter().map(|&first| Term::Position {
        first,
        len: 1,
        weight: 1.0,
    });
    network.listen("out", terms.collect()).unwrap();
    for &mat in &listened {
        timeline.strike(&network, mat, 0.0, 1e-3, Some(0.0), 0).unwrap();
    }
    (network, timeline)
}

#[test]
fn plan_and_simulation_of_large_bodies_poll_often() {
    let (network, timeline) = strings();
    let network = Arc::new(network);
    let budget = Budget::Method(Method::Ca);
    let (plan, planning) = looks(|| Plan::new(network, &timeline, &budget, None).unwrap());
    // Islands, and for each string its subset, its bodies and its certificate.
    assert!(planning >= 5 * 2 * MASSES / MASSES_PER_POLL, "{planning}");
    let plan = Arc::new(plan);
    let (simulation, building) = looks(|| Simulation::from_plan(plan.clone(), options(1)));
    assert!(building >= 2 * MASSES / MASSES_PER_POLL, "{building}");
    let mut simulation = simulation.unwrap();
    let ((), computing) = looks(|| simulation.process(&mut [0.0; 20]).unwrap());
    assert!(computing >= 2 * 20, "{computing}: not at every frame");
}

#[test]
fn simulation_threads_end_with_an_interrupted_computation() {
    let (network, timeline) = strings();
    let budget = Budget::Method(Method::Ca);
    let plan = Plan::new(Arc::new(network), &timeline, &budget, None).unwrap();
    let plan = Arc::new(plan);
    for threads in [1, 2, 3] {
        let mut simulation = Simulation::from_plan(plan.clone(), options(threads)).unwrap();
        let count = Cell::new(0);
        let ask = move || {
            count.set(count.get() + 1);
            count.get() == 5
        };
        // A minute of sound would take hours: the test ends only if every thread does.
        let minute = until(Box::new(ask), || simulation.skip(60 * 44_100));
        assert_eq!(minute.map(|done| done.is_ok()), Err(Stopped));
    }
}
