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
    #[error("the recording cannot be written: {0}")]
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
    #[error("the system refused a thread for the physics: {0}")]
    Thread(#[source] std::io::Error),
    /// The physics thread panicked: forces are zero, nothing sounds.
    #[error("the physics thread panicked; this is a bug in ergon")]
    Failed,
    /// More hands than are told of.
    #[error("{0} real hands: at most {HANDS_MAX} are supported")]
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
    #[error("frame {0} is not the first of a tick: ticks have {1} frames")]
    Frame(u64, usize),
    /// A simulation of another frame.
    #[error("the simulation starts at frame {0}, and the change is at frame {1}")]
    Begins(u64, u64),
    /// Prepared parts fill outputs by their places.
    #[error("the number of outputs cannot change while frozen parts play")]
    Frozen,
    /// Another number of channels.
    #[error("the number of channels cannot change: the sound card was opened with {0}")]
    Channels(usize),
    /// Too much at once.
    #[error("too many commands wait for the physics thread")]
    Busy,
}
