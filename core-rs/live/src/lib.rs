//! Playing live: a real-time thread owns the simulation, between the sound card and the keys.
//!
//! This crate adds clocks and wires to the engine, no physics: unless a person's hand plays, the sound equals that of a
//! render, sample for sample.

pub mod audio;
pub mod device;
pub mod doctor;
pub mod emulate;
pub mod faults;
pub mod metrology;
pub mod perform;
pub mod pointer;
pub mod realtime;
pub mod recording;
pub mod regular;
pub mod safety;
pub mod stop;
pub mod wire;

#[cfg(test)]
mod tests;
