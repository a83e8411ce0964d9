//! The passes that find what is computed and how: islands, bodies, methods. No island is simulated here.

pub(in crate::plan) mod assemble;
pub(in crate::plan) mod audible;
pub(in crate::plan) mod body;
pub(in crate::plan) mod cells;
pub(in crate::plan) mod complex_body;
pub(in crate::plan) mod islands;
pub(in crate::plan) mod loudness;
pub(in crate::plan) mod mesh;
pub(in crate::plan) mod ported;
pub(in crate::plan) mod seen;
pub(in crate::plan) mod slow;
pub(in crate::plan) mod solved_modes;
pub(in crate::plan) mod split;
pub(in crate::plan) mod truncate;
pub(in crate::plan) mod wiring;
