//! Inner loops, one file for each kind of work. They use indices only, not the names of modules.

pub(crate) mod bank;
pub(crate) mod dense;
mod exact;
mod laws;
mod mats;
pub(crate) mod mesh_partition;
mod pairwise;
pub(crate) mod ports;
pub(crate) mod proxies;
mod pull;
pub(crate) mod pushed_modes;
mod runs;
mod space;
pub(crate) mod springs;
mod taps;
pub(crate) mod thread_team;

pub(crate) use exact::{Contact, SLIDE_DISTANCE_MIN, contacts, friction, rest};
pub(crate) use laws::Laws;
pub(crate) use mats::{advance, centred, fine_steps, force_to_reach, is_bounded, predict};
pub(crate) use pairwise::{Contact as PairContact, Neighbours};
pub(crate) use runs::{links, slide_bristles};
pub(crate) use taps::tap;

#[cfg(test)]
mod tests;
