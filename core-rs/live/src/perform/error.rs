//! Why a piece cannot be played, or a change not be made.

use std::path::PathBuf;

use super::status::HANDS_MAX;
use crate::audio::AudioError;
use crate::device::DeviceError;
use crate::recording::RecordingError;

/// Why nothing can be played.
#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    /// The sound.
    #[error(transparent)]
    Audio(#[from] AudioError),
    /// A key.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A prepared part.
    #[error("{}: {error}", path.display())]
    Frozen {
        /// Its file.
        path: PathBuf,
        /// Why it cannot be read.
        error: std::io::Error,
    },
    /// The system refused a thread.
    #[error("no thread for the physics: {0}")]
    Thread(#[source] std::io::Error),
    /// The physics thread panicked: forces are zero, nothing sounds.
    #[error("the physics failed; this is a mistake in ergon")]
    Failed,
    /// More hands than are told of.
    #[error("{0} real hands: there can be {HANDS_MAX}")]
    Hands(usize),
    /// A scene that a key would swing up against.
    #[error(
        "hand {hand}: the scene is {stiffness:.0} N/m stiff there, and the device bears {limit:.0} N/m"
    )]
    Stiff {
        /// Which hand.
        hand: usize,
        /// What it would meet [N/m].
        stiffness: f64,
        /// What its device bears [N/m].
        limit: f64,
    },
}

/// Why a change cannot be asked for.
#[derive(Debug, thiserror::Error)]
pub enum ChangeError {
    /// Not the first frame of a tick.
    #[error("frame {0} begins no tick: ticks have {1} frames")]
    Frame(u64, usize),
    /// A simulation of another frame.
    #[error("the simulation begins at frame {0}, not at {1}")]
    Begins(u64, u64),
    /// Prepared parts fill outputs by their places.
    #[error("with prepared parts the outputs stay as many as they are")]
    Frozen,
    /// Another number of channels.
    #[error("the sound card was opened with {0} channels")]
    Channels(usize),
    /// Too much at once.
    #[error("too many changes at once")]
    Busy,
}
