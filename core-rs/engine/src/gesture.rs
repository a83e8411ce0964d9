//! Gestures as data: paths of a key in seconds and metres, and how ergons make the key follow them.

pub mod error;
pub mod placed;
pub mod profile;
pub mod quintic;
pub mod report;
pub mod script;
pub mod spline;
pub mod take;
pub mod written;
