//! From outputs of a simulation to loudspeakers and files.

pub mod curve;
pub mod delay;
pub mod filter;
pub mod fold;
pub mod frozen;
pub mod glide;
pub mod level_steps;
pub mod limiter;
pub mod meter;
pub mod mixer;
pub mod pcm;
pub mod room;
pub mod silence_detector;
pub mod true_peak;
