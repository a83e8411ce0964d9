//! Hands that play written gestures: ergons that take a key along its path.

mod ergons_for_view;
pub(crate) mod framed;
pub(crate) mod free;
mod particle;
pub(crate) mod voice;

pub(crate) use ergons_for_view::ROOM as SPARKS;
