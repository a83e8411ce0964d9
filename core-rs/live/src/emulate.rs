//! Emulated devices: they send and receive the same bytes as real ones, from a separate process or inside this one.
//!
//! A key here is a CEL with the engine's own arithmetic, a key model, or the key of a score; a hand may pull it along a
//! written path. There are two clocks: wall time, like the firmware of a board, or lockstep, in which every packet is
//! one period and nothing is late.

mod firmware;
mod hand;
mod key;
mod line;
mod serve;

pub(crate) use firmware::HAPLY_ID;
pub use firmware::{BoardConfig, Firmware, Protocol};
pub use hand::EmulatedHand;
pub use key::{EmulatedKeys, KeyConstants};
pub use line::Transport;
pub use serve::{EmulationOptions, ServeEvent, ServeSummary, serve};

/// Why a device cannot be emulated.
#[derive(Debug, thiserror::Error)]
pub enum EmulateError {
    /// The key model is impossible.
    #[error(transparent)]
    Key(#[from] ergon_engine::key_model::KeyError),
    /// The network of a score's key cannot be stepped at this rate.
    #[error(transparent)]
    Network(#[from] ergon_engine::network::Error),
    /// The rate is impossible.
    #[error(transparent)]
    Rate(#[from] ergon_engine::units::RateError),
    /// A number is out of range.
    #[error("{0}")]
    Refused(&'static str),
    /// The system refused a port.
    #[error("no port could be opened: {0}")]
    Port(#[from] std::io::Error),
}
