//! Hands that play written gestures: ergons that move a key along its path.
//!
//! `framed` holds the frames at which positions are due. `voice` computes one force a frame, by `voice/answer`. `free`
//! is the key alone, on which the force is found. `particle` applies a force by a mass that strikes.

mod ergons_for_view;
pub(crate) mod framed;
pub(crate) mod free;
mod particle;
pub(crate) mod voice;

pub(crate) use ergons_for_view::SPARKS_MAX as SPARKS;
