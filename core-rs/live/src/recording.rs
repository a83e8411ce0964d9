//! Recordings of live hands in `*.take` files, which survive a crash.
//!
//! Chunks are only ever appended, each with its length and checksum, so a file that is cut loses only its last chunk. A
//! row holds one tick of the physics: for each axis, the position that was consumed and the force that resulted.
//! Between rows are the other events of a tick, such as commands. The layout, byte by byte, is in docs/takes.md.

mod chunk;
mod header;
mod reader;
mod row;
mod writer;

use std::io;

use thiserror::Error;

pub use header::{Header, RecordedAxis};
#[cfg(test)]
pub(crate) use reader::decode;
pub use reader::{Recording, read};
pub use row::{RecordedSample, flag};
pub use writer::{Recorder, RecorderHandle, RecordingStatus, RowSink};

/// The first bytes of every recording. The first byte is not text; the last four reveal a transfer that changed line
/// ends.
pub const MAGIC: [u8; 8] = *b"\x89TAKE\r\n\x1a";
/// Version of the layout.
pub const VERSION: u32 = 1;
/// Greatest number of rows × axes that are held in memory: five and a half hours of one axis at 1 kHz.
pub const MAX_SAMPLES: usize = 20_000_000;
/// Greatest size of all events that are held in memory [bytes].
pub const MAX_EVENTS: usize = 1 << 24;

/// Why a recording cannot be made or read.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file cannot be read or written.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The file is of another kind.
    #[error("this file is not a recording of hands")]
    NotARecording,
    /// The file is of a later version of ergon.
    #[error("this recording is of version {0}; this ergon reads version {VERSION}")]
    Version(u32),
    /// The header is missing or damaged; without it the rows cannot be interpreted.
    #[error("the header of this recording is damaged, and without it the rest cannot be read")]
    NoHeader,
    /// The header has impossible values.
    #[error("a recording cannot be made: {0}")]
    Header(&'static str),
    /// Rows that contradict each other.
    #[error("a recording cannot be made: {0}")]
    Rows(&'static str),
    /// The recording does not fit in memory.
    #[error(
        "this recording is too long: rows · axes exceed {MAX_SAMPLES}, or events exceed {MAX_EVENTS} bytes; read a part of it"
    )]
    TooLong,
}

#[cfg(test)]
mod tests;
