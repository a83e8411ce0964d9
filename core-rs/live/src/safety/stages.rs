//! The stages, each in a module; [`Pipeline`](super::pipeline::Pipeline) has their order and the clamp to the greatest
//! force.

pub(super) mod fade;
pub(super) mod heat;
pub(super) mod passivity;
pub(super) mod slew;
pub(super) mod stale;
pub(super) mod travel;
pub(super) mod trip;
