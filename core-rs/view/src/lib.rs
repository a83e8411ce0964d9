//! What is seen of a simulation: its motion as chunks of bytes, the same in a file and on a wire.

pub mod frames;
pub mod motion;
pub mod payload;
pub mod read;
pub mod record;
pub mod serve;
