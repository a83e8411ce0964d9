//! The physics of ergon: CORDIS-ANIMA networks struck by ergons.
//!
//! The crate depends on no Python, audio device or clock: a result depends on its arguments alone, to the last bit,
//! whatever the number of threads, the block size and the vector instructions of the processor.
//!
//! # From network to sound
//!
//! 1. A [`Network`] holds masses (MAT) and the links between them (LIA), named, in SI units.
//! 2. A [`Timeline`] holds what will happen: strikes, written gestures, takes, couplings, in seconds.
//! 3. A [`Plan`] says what is computed, by which method and within which [`Budget`], and why the rest is not computed.
//! 4. A [`Simulation`] plays the plan, a block of frames at a time.
//!
//! # A struck string
//!
//! Two fixed points, sixty masses, sixty-one springs; a strike near one end, an output near the other.
//!
//! ```
//! use std::sync::Arc;
//!
//! use ergon_engine::network::Term;
//! use ergon_engine::{Budget, Network, OnFault, SimulationOptions, Plan, Rate, Simulation, Timeline};
//!
//! let mut network = Network::new();
//! network.part("string", None);
//! let left = network.sol("left", 0.0)?;
//! let first = network.mas("m", 1e-3, 0.0, 0.0)?; // 1 g, at rest at 0 m
//! for _ in 1..60 {
//!     network.mas("m", 1e-3, 0.0, 0.0)?;
//! }
//! let right = network.sol("right", 0.0)?;
//! for a in left..right {
//!     network.spring("s", a, a + 1, 50e3, 5e-3, 0.0)?; // 50 kN/m, 5 mN·s/m, no rest length
//! }
//! let near_the_end = Term::Position { first: first + 50, len: 1, weight: 1.0 };
//! network.listen("string", vec![near_the_end])?;
//!
//! let rate = Rate::new(44_100.0)?;
//! let mut timeline = Timeline::new(rate);
//! timeline.strike(&network, first + 7, 0.01, 1e-3, None, 0)?; // 1 mN·s after 10 ms
//!
//! let plan = Plan::new(Arc::new(network), &timeline, &Budget::Error(-80.0), None)?;
//! let options = SimulationOptions { keeps_ledger: false, records_ergons: false,
//! on_fault: OnFault::Stop, threads: 1, is_unchecked:
//! false }; let mut simulation = Simulation::from_plan(Arc::new(plan), options)?;
//! let mut sound = vec![0.0; 44_100];
//! simulation.process(&mut sound)?;
//!
//! assert!(sound[..441].iter().all(|x| *x == 0.0)); // before the strike
//! assert!(sound.iter().any(|x| x.abs() > 1e-6));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where things are
//!
//! | looking for | module |
//! |---|---|
//! | modules, links, outputs, why a network is refused | [`network`] |
//! | STRING, PLATE, BANK by pitch and decay | [`generator`] |
//! | laws of non-linear links | [`law`] |
//! | written gestures and captured takes | [`gesture`] |
//! | strikes, couplings, real hands, what changes while it plays | [`timeline`] |
//! | methods, error budgets, what a plan tells of itself | [`plan`] |
//! | stepping, snapshots, taking over from another version | [`simulation`] |
//! | a real key: dry friction, modes, delay, and the derivatives of its path | [`key_model`] |
//! | outputs to channels, limiter, levels | [`mix`] |

mod archive;
mod assembly;
mod bank;
mod body_modes;
pub mod cell;
pub mod chance;
mod content;
pub mod derivative;
mod dry;
pub mod generator;
pub mod gesture;
mod guard;
pub mod hearing;
// Only tests ask for the energy that a method conserves.
#[cfg_attr(not(test), allow(dead_code))]
mod integrate;
pub mod interrupt;
mod island;
mod kernel;
pub mod key_model;
pub mod law;
pub mod maths;
pub mod mix;
pub mod network;
pub mod plan;
pub mod scheme;
mod section;
pub mod simulation;
mod spectrum;
mod start;
mod state;
pub mod timeline;
pub mod units;
pub mod waveform;

pub use network::Network;
pub use plan::{Budget, Plan};
pub use simulation::{OnFault, Simulation, SimulationOptions};
pub use timeline::Timeline;
pub use units::Rate;
