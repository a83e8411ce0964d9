//! Hands without force: a stream of positions, such as that of a pointer on a page, leads a virtual finger, and the
//! finger holds the key of a device that exists only here.
//!
//! [`PointerStream`] takes the stream from any thread. [`path`] makes an even path of it, [`finger`] moves finger and
//! key, and
//! `device::led` is the driver, through which the key is a device like all others.

mod arrival;
pub mod finger;
pub mod path;
mod stream;
mod trace;

pub use arrival::ArrivalTimes;
pub use finger::{FingerConstants, HeldKey};
pub use stream::{PointerStream, PointerStreamOptions, PointerTally, PositionRefusal, find};
pub use trace::TRACE_COLUMNS;
