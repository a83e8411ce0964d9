//! The visible motion of a simulation as chunks of bytes, in the same format for files and for live pages.

pub mod bundle;
pub mod frames;
pub mod motion;
pub mod packed;
pub mod payload;
mod range;
pub mod read;
pub mod record;
pub mod serve;
