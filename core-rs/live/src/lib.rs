//! Playing live: the real-time thread that owns the physics, the sound card on one side of it, the keys on the other.
//!
//! Adds clocks and wires to the engine, no physics: what it plays equals what a render writes, sample for sample,
//! wherever nobody's real hand is in it.

pub mod device;
pub mod emulate;
pub mod realtime;
<<<<<<< HEAD
pub mod safety;
=======
pub mod recording;
>>>>>>> c76eabf4f31a34cc513ac8c8d1af58aa0e8f15b4
