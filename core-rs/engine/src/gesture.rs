//! Gestures: paths a hand goes, and the ergons that take a key there.

pub mod error;
pub mod placed;
pub mod profile;
pub mod quintic;
pub mod report;
pub mod script;
pub mod spline;
pub mod take;
pub mod written;
