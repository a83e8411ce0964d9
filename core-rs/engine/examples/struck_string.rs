//! A string of sixty masses is struck near one end; prints the sound as one number a line.
//!
//! `cargo run --release --example struck_string > string.txt`
#![allow(clippy::print_stdout)]

use std::error::Error;
use std::sync::Arc;

use ergon_engine::network::Term;
use ergon_engine::{Budget, Network, OnFault, Plan, Rate, Simulation, SimulationOptions, Timeline};

/// Number of masses between the two fixed ends.
const MASSES: usize = 60;

/// A second of the string's motion near one end [m].
pub(crate) fn sound() -> Result<Vec<f64>, Box<dyn Error>> {
    let mut network = Network::new();
    network.part("string", None);
    let left = network.sol("left", 0.0)?;
    let first = network.mas("m", 1e-3, 0.0, 0.0)?; // 1 g, at rest at 0 m
    for _ in 1..MASSES {
        network.mas("m", 1e-3, 0.0, 0.0)?;
    }
    let right = network.sol("right", 0.0)?;
    for a in left..right {
        network.spring("s", a, a + 1, 50e3, 5e-3, 0.0)?; // 50 kN/m, 5 mN·s/m, no rest length
    }
    let near_the_end = Term::Position {
        first: first + 50,
        len: 1,
        weight: 1.0,
    };
    network.listen("string", vec![near_the_end])?;

    let rate = Rate::new(44_100.0)?;
    let mut timeline = Timeline::new(rate);
    timeline.strike(&network, first + 7, 0.01, 1e-3, Some(0.0), 0)?; // 1 mN·s after 10 ms

    let plan = Plan::new(Arc::new(network), &timeline, &Budget::Error(-80.0), None)?;
    let options = SimulationOptions {
        keeps_ledger: false,
        records_ergons: false,
        on_fault: OnFault::Stop,
        threads: 1,
        is_unchecked: false,
    };
    let mut simulation = Simulation::from_plan(Arc::new(plan), options)?;
    let mut frames = vec![0.0; 44_100];
    simulation.process(&mut frames)?;
    Ok(frames)
}

#[allow(dead_code)] // a test calls `sound` alone
fn main() -> Result<(), Box<dyn Error>> {
    for x in sound()? {
        println!("{x:e}");
    }
    Ok(())
}
