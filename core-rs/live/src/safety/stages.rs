//! What one stage does each; [`Pipeline`](super::pipeline::Pipeline) has their order.

pub(super) mod fade;
pub(super) mod heat;
pub(super) mod passivity;
pub(super) mod slew;
pub(super) mod stale;
pub(super) mod trip;
