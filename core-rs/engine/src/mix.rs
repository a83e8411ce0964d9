//! From outputs to loudspeakers and files.

pub mod glide;
pub mod limiter;
pub mod meter;
pub mod mixer;
pub mod pcm;
