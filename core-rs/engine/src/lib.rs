//! The physics of ergon: CORDIS-ANIMA networks struck by ergons.
//!
//! No Python, no audio device, no clock: what a thing does is a function of its arguments.

pub mod maths;
