//! The sound card's side: the ring that the physics fills, and what empties it.
//!
//! `ring` makes two halves; `open` gives one to a card, a server, a file or a clock. What arrives there untroubled is
//! what was pushed, bit for bit, wherever the card runs at the score's rate.

mod connect;
mod file;
mod input;
mod jack;
mod null;
mod output;
mod output_fades;
mod pulse;
mod rate;
mod ring;
mod shared;
mod sink;
mod source;
mod spec;
#[cfg(all(feature = "system", any(target_os = "macos", windows)))]
mod system;
#[cfg(not(all(feature = "system", any(target_os = "macos", windows))))]
#[path = "audio/no_system.rs"]
mod system;
mod tap;
mod wave;

use std::path::PathBuf;

pub use connect::survey;
pub use input::{Input, InputInfo, Intake, listen};
pub use jack::Capture;
pub use output::{Event, Info, News, Output, Sounding, open};
pub use ring::{CHANNELS_MAX, Drain, Feed, ring};
pub use shared::{Edge, Shared};
pub use spec::{Backend, Spec, USAGE};
pub(crate) use tap::{Tap, open as tap};
pub use tap::{TapHandle, TapStatus};

/// Why there is no sound.
#[derive(Debug, thiserror::Error)]
pub enum AudioError {
    /// The text names no output.
    #[error("'{text}': {why} (it is {USAGE})")]
    Spec {
        /// As it was given.
        text: String,
        /// What is wrong with it.
        why: String,
    },
    /// No server, no library, no device.
    #[error("{why}")]
    Unavailable {
        /// Which was asked.
        backend: &'static str,
        /// A sentence.
        why: String,
    },
    /// More channels than it has.
    #[error("{channels} channels: {why}")]
    Channels {
        /// How many were asked.
        channels: usize,
        /// A sentence.
        why: String,
    },
    /// No way from one rate to the other.
    #[error("no conversion from {from} Hz to {to} Hz: {why}")]
    Rate {
        /// The score's [Hz].
        from: u32,
        /// The card's [Hz].
        to: u32,
        /// A sentence.
        why: String,
    },
    /// A file that cannot be written.
    #[error("{}: {error}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What the system says.
        error: std::io::Error,
    },
    /// It broke while it played.
    #[error("{0}")]
    Broken(String),
    /// No thread to be had.
    #[error("the system refused a thread for the sound: {0}")]
    Thread(std::io::Error),
}
