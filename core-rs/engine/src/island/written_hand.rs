//! Hands that play written gestures: ergons that take a key along its path.
//!
//! `framed` says at which frames something is due. `voice` makes one force a frame of it, by `voice/answer`. `free` is the
//! key alone, on which the force is found. `particle` is a force as a mass that strikes.

mod ergons_for_view;
pub(crate) mod framed;
pub(crate) mod free;
mod particle;
pub(crate) mod voice;

pub(crate) use ergons_for_view::ROOM as SPARKS;
