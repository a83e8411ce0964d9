//! The physics of ergon: CORDIS-ANIMA networks struck by ergons.
//!
//! No Python, no audio device, no clock: what a thing does is a function of its arguments.
//!
//! `Network` (what is) and `Timeline` (what will happen) make a `Plan` (what is computed, how, and why the
//! rest is not); a `Simulation` plays it.

mod bank;
pub mod cell;
pub mod chance;
pub mod generator;
pub mod gesture;
mod guard;
// What energy a method keeps is asked by its tests alone.
#[cfg_attr(not(test), allow(dead_code))]
mod integrate;
mod island;
mod kernel;
pub mod law;
pub mod maths;
pub mod mix;
pub mod network;
pub mod plan;
pub mod scheme;
mod section;
pub mod simulation;
pub mod spectrum;
mod state;
pub mod stop;
pub mod timeline;
pub mod units;
