//! A hand lifts a key by 6 mm and lets it down; prints the position of the key every 10 ms.
//!
//! `cargo run --release --example gesture`
#![allow(clippy::print_stdout)]

use std::error::Error;
use std::sync::Arc;

use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{Gesture, Manner};
use ergon_engine::gesture::written::{Approach, WrittenPoints};
use ergon_engine::network::{Term, Tie};
use ergon_engine::{Budget, Network, OnFault, Plan, Rate, Simulation, SimulationOptions, Timeline};

const RATE: f64 = 44_100.0;

/// Position of the key in each frame of half a second [m]; the gesture asks for 6 mm at 100 ms.
pub(crate) fn path() -> Result<Vec<f64>, Box<dyn Error>> {
    let mut network = Network::new();
    network.part("key", None);
    let mass = network.cel("key", 0.4, Tie::Physical { k: 60.0, z: 1.2 }, 0.0, 0.0, 0.0)?;
    network.listen(
        "key",
        vec![Term::Position {
            first: mass,
            len: 1,
            weight: 1.0,
        }],
    )?;

    let points = WrittenPoints {
        t: &[0.0, 0.1, 0.3],  // [s]
        x: &[0.0, 6e-3, 0.0], // [m]
        approaches: &[Approach::Path(Curve::Smooth); 3],
        sources: &[],
    };
    let manner = Manner::OPEN;
    let mut timeline = Timeline::new(Rate::new(RATE)?);
    let key = timeline.add_key("key", mass);
    timeline.add_gesture(Gesture::from_points(key, &points, manner)?)?;

    let plan = Plan::new(Arc::new(network), &timeline, &Budget::Error(-80.0), None)?;
    let options = SimulationOptions {
        keeps_ledger: false,
        records_ergons: false,
        on_fault: OnFault::Stop,
        threads: 1,
        is_unchecked: false,
    };
    let mut simulation = Simulation::from_plan(Arc::new(plan), options)?;
    let mut frames = vec![0.0; 22_050];
    simulation.process(&mut frames)?;
    Ok(frames)
}

#[allow(dead_code)] // a test calls `path` alone
fn main() -> Result<(), Box<dyn Error>> {
    for (number, x) in path()?.iter().enumerate().step_by(441) {
        println!("{:3.0} ms  {:6.3} mm", 1e3 * number as f64 / RATE, 1e3 * x);
    }
    Ok(())
}
