//! How an island is put together to be computed in one way: which bodies are cut out of it, by which modes or methods they
//! are computed, how finely contacts are, whether that is stable, and what it costs.
//!
//! Nothing is played here, and nothing is compared: `plan` does that, and decides between ways.

pub(crate) mod assemble;
pub(crate) mod audible;
pub(crate) mod body;
pub(crate) mod budget;
pub(crate) mod cells;
pub(crate) mod choice;
pub(crate) mod complex_body;
pub(crate) mod constants;
pub(crate) mod cost;
pub(crate) mod cost_table;
pub(crate) mod islands;
pub(crate) mod loudness;
pub(crate) mod mesh;
pub(crate) mod ported;
pub(crate) mod seen;
pub(crate) mod slow;
pub(crate) mod solved_modes;
pub(crate) mod split;
pub(crate) mod truncate;
pub(crate) mod unit;
pub(crate) mod wiring;
