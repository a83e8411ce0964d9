//! Hands that play written gestures: ergons that take a key along its path.

pub(crate) mod framed;
pub(crate) mod free;
mod particle;
mod sparks;
pub(crate) mod voice;

pub(crate) use sparks::ROOM as SPARKS;
