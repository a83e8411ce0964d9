//! Errors of performances and of changes.

use std::path::PathBuf;

use super::status::HANDS_MAX;
use crate::audio::AudioError;
use crate::device::DeviceError;
use crate::recording::RecordingError;

/// Why a performance cannot begin, or failed.
#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    /// The sound output.
    #[error(transparent)]
    Audio(#[from] AudioError),
    /// A device.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The recording of the hands.
    #[error("the recording cannot be written: {0}")]
    Recording(#[from] RecordingError),
    /// A frozen part.
    #[error("{}: {error}", path.display())]
    Frozen {
        /// The file.
        path: PathBuf,
        /// The error of reading it.
        error: std::io::Error,
    },
    /// The system could not start a thread.
    #[error("the system refused a thread for the physics: {0}")]
    Thread(#[source] std::io::Error),
    /// The physics thread panicked; forces are zero and the sound is silent.
    #[error("the physics thread panicked; this is a bug in ergon")]
    Failed,
    /// More hands than a performance can have.
    #[error("{0} real hands: at most {HANDS_MAX} are supported")]
    Hands(usize),
    /// A piece that is too stiff for a device to be stable.
    #[error(
        "the piece is {stiffness:.0} N/m stiff at this key, and the device is stable up to {limit:.0} N/m; \
         use a smaller K or a larger Z in what the key touches"
    )]
    Stiff {
        /// The hand.
        hand: usize,
        /// Stiffness of the piece [N/m].
        stiffness: f64,
        /// Greatest stable stiffness [N/m].
        limit: f64,
    },
}

/// Why a change is refused.
#[derive(Debug, thiserror::Error)]
pub enum ChangeError {
    /// Its frame is not the first of a tick.
    #[error("frame {0} is not the first of a tick: ticks have {1} frames")]
    Frame(u64, usize),
    /// Its simulation is not at the frame of the change.
    #[error("the simulation starts at frame {0}, and the change is at frame {1}")]
    Begins(u64, u64),
    /// Its outputs differ, and frozen parts fill outputs by their indices.
    #[error("the number of outputs cannot change while frozen parts play")]
    Frozen,
    /// Its number of channels differs.
    #[error("the number of channels cannot change: the sound card was opened with {0}")]
    Channels(usize),
    /// Too many commands wait for the physics thread.
    #[error("too many commands wait for the physics thread; try again")]
    Busy,
}
