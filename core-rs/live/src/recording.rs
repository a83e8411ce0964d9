//! What live hands did, in a file that a crash does not empty: `*.take`.
//!
//! Chunks are only ever appended, each with its length and checksum, so that a cut file loses its last chunk and
//! no more. A row is a tick of the physics: what it consumed and what it answered, axis by axis; between rows lie
//! the events that it consumed besides. The layout, byte by byte, is in docs/takes.md.

mod chunk;
mod header;
mod reader;
mod row;
mod writer;

use std::io;

use thiserror::Error;

pub use header::{Axis, Header};
#[cfg(test)]
pub(crate) use reader::decode;
pub use reader::{Recording, read};
pub use row::{Sample, flag};
pub use writer::{Recorder, RecorderHandle, RowSink, Status};

/// What every recording begins with. The first byte is no text, the last four tell a transfer that changed line ends.
pub const MAGIC: [u8; 8] = *b"\x89TAKE\r\n\x1a";
/// Of the layout.
pub const VERSION: u32 = 1;
/// Most rows × axes that are held in memory: five and a half hours of one axis at 1 kHz.
pub const MAX_SAMPLES: usize = 20_000_000;
/// Most bytes of events that are held in memory.
pub const MAX_EVENTS: usize = 1 << 24;

/// Why a recording cannot be made or read.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file itself.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// Another kind of file.
    #[error("this file is not a recording of hands")]
    NotOne,
    /// Of a later ergon.
    #[error("this recording is of version {0}; this ergon reads version {VERSION}")]
    Version(u32),
    /// Without its header nothing says what the rows are.
    #[error("the header of this recording is damaged, and without it the rest cannot be read")]
    NoHeader,
    /// A header that says what cannot be.
    #[error("a recording cannot be made: {0}")]
    Header(&'static str),
    /// Rows that contradict each other.
    #[error("a recording cannot be made: {0}")]
    Rows(&'static str),
    /// More than fits.
    #[error(
        "this recording is too long: rows · axes exceed {MAX_SAMPLES}, or events exceed {MAX_EVENTS} bytes; read a part of it"
    )]
    TooLong,
}

#[cfg(test)]
mod tests;
