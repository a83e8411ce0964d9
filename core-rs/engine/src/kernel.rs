//! Inner loops, one file for each kind of work. They use indices only, not the names of modules.

pub(crate) mod bank;
pub(crate) mod dense;
mod exact;
mod mats;
pub(crate) mod mesh_partition;
mod pairwise;
pub(crate) mod ports;
pub(crate) mod proxies;
mod pull;
pub(crate) mod pushed_modes;
mod runs;
mod scratch;
mod space;
pub(crate) mod springs;
mod taps;
pub(crate) mod thread_team;

pub(crate) use exact::{ExactContact, SLIDE_DISTANCE_MIN, solve_exact_contacts, solve_friction, stop_resting_masses};
pub(crate) use mats::{
    advance_by_fraction, advance_mats, centred_velocity, force_to_reach, is_bounded, predict_position,
};
pub(crate) use pairwise::{Neighbours, TouchingPair as PairContact};
pub(crate) use runs::{compute_link_forces, slide_bristles};
pub(crate) use scratch::KernelScratch;
pub(crate) use taps::write_outputs;

#[cfg(test)]
mod tests;
