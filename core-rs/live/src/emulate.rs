//! Devices that are not there: the same bytes, from a process of their own.
//!
//! A key here is a CEL by the engine's own numbers, or what a key's model adds to it, and a hand that pulls it along a written path. Two clocks: by the
//! wall, as a board's firmware goes, or in lockstep, where every packet is one period and nobody is late.

mod firmware;
mod hand;
mod key;
mod line;
mod serve;

pub(crate) use firmware::HAPLY_ID;
pub use firmware::{Board, Firmware, Protocol};
pub use hand::Hand;
pub use key::{Key, Keys};
pub use line::Transport;
pub use serve::{Event, Options, Outcome, serve};

/// A device that cannot be emulated so.
#[derive(Debug, thiserror::Error)]
pub enum EmulateError {
    /// A key that its model does not allow.
    #[error(transparent)]
    Key(#[from] ergon_engine::key_model::KeyError),
    /// A key of a score that no engine steps at this rate.
    #[error(transparent)]
    Network(#[from] ergon_engine::network::Error),
    /// A rate that is none.
    #[error(transparent)]
    Rate(#[from] ergon_engine::units::RateError),
    /// A number that is none for this.
    #[error("{0}")]
    Refused(&'static str),
    /// The system gives no port.
    #[error("no port could be opened: {0}")]
    Port(#[from] std::io::Error),
}
