//! Playing live: the real-time thread that owns the physics, the sound card on one side of it, the keys on the other.
//!
//! Adds clocks and wires to the engine, no physics: what it plays equals what a render writes, sample for sample,
//! wherever nobody's real hand is in it.

pub mod audio;
pub mod device;
pub mod doctor;
pub mod emulate;
pub mod faults;
pub mod metrology;
pub mod perform;
pub mod realtime;
pub mod recording;
pub mod safety;
pub mod stop;
pub mod wire;

#[cfg(test)]
mod tests;
