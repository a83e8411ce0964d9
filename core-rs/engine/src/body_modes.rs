//! The modes of a linear body: normal modes, or complex ones where damping couples them.
//!
//! What a plan makes of them (which modes are computed, and how) is decided in `plan`.

pub(crate) mod complex_modes;
mod constants;
mod degenerate_modes;
pub(crate) mod linear;
pub(crate) mod mode_shapes;
pub(crate) mod normal_modes;
pub(crate) mod state_projection;
mod viscosity;

pub(crate) use constants::ANGLE_MIN;
