//! The sound card's side: the ring that the physics fills, and the outputs that empty it.
//!
//! `ring` makes the two halves; `open` gives one of them to a card, a server, a file or a clock. Without underruns and
//! panics, a card at the score's rate gets exactly the samples that were pushed, bit for bit.

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
mod sink;
mod source;
mod spec;
mod stream_state;
#[cfg(all(feature = "system", any(target_os = "macos", windows)))]
mod system;
#[cfg(not(all(feature = "system", any(target_os = "macos", windows))))]
#[path = "audio/no_system.rs"]
mod system;
mod tap;
mod wave;

use std::path::PathBuf;

pub use connect::survey;
pub use input::{Input, InputInfo, InputReader, open_input};
pub use jack::Capture;
pub use output::{AudioEvent, Output, OutputInfo, PlaybackTiming, SoundClock, open};
pub use ring::{CHANNELS_MAX, RingReader, RingWriter, ring};
pub use spec::{AudioSpec, Backend, USAGE};
pub use stream_state::{SilenceEdge, StreamState};
pub(crate) use tap::{AudioTap, open as tap};
pub use tap::{TapHandle, TapStatus};

/// Why the sound cannot be opened or was lost.
#[derive(Debug, thiserror::Error)]
pub enum AudioError {
    /// The text is not a valid output.
    #[error("'{text}': {reason} (it is {USAGE})")]
    Spec {
        /// The text.
        text: String,
        /// What is wrong with it.
        reason: String,
    },
    /// No such server, library or device.
    #[error("{reason}")]
    Unavailable {
        /// The backend that was asked for.
        backend: &'static str,
        /// A sentence.
        reason: String,
    },
    /// The output does not have so many channels.
    #[error("{channels} channels: {reason}")]
    Channels {
        /// The number of channels that was asked for.
        channels: usize,
        /// A sentence.
        reason: String,
    },
    /// No conversion between the two rates.
    #[error("no conversion from {from} Hz to {to} Hz: {reason}")]
    Rate {
        /// The score's [Hz].
        from: u32,
        /// The card's [Hz].
        to: u32,
        /// A sentence.
        reason: String,
    },
    /// A file that cannot be written.
    #[error("{}: {error}", path.display())]
    File {
        /// The path.
        path: PathBuf,
        /// The system's error.
        error: std::io::Error,
    },
    /// The sound broke off while it played.
    #[error("{0}")]
    Broken(String),
    /// The system refused a thread.
    #[error("the system refused a thread for the sound: {0}")]
    Thread(std::io::Error),
}
