//! The complete chunks of a file, and those of its bundles.

use super::ReadError;
use crate::bundle::{self, BundleError, UnpackedTotal};
use crate::motion::{self, ChunkError, FORMATS, MAGIC};
use crate::payload::{VERSION, kind};

/// One chunk, and where it is in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChunkRef {
    /// Its kind.
    pub kind: u16,
    /// Its instant [s].
    pub seconds: f64,
    /// First byte of its payload in the file; of a chunk in a bundle that of the bundle's.
    pub offset: usize,
    /// Length of its payload [bytes].
    pub n_bytes: usize,
    /// First byte of its payload among those out of bundles; `None` if it is in no bundle.
    pub(super) unpacked_offset: Option<usize>,
}

/// The bytes of a file, and its complete chunks.
#[derive(Clone, Debug)]
pub(super) struct Chunks {
    bytes: Vec<u8>,
    /// Payloads out of bundles, one after the other.
    unpacked_payloads: Vec<u8>,
    /// End of the last complete chunk in the file.
    chunks_end: usize,
    pub(super) refs: Vec<ChunkRef>,
}

impl Chunks {
    /// Cuts a file into chunks, up to the first that is not complete.
    pub(super) fn new(bytes: Vec<u8>) -> Result<Self, ReadError> {
        match bytes.get(..MAGIC.len()) {
            Some([b'E', b'R', b'G', b'M', format, 0, 0, 0]) if FORMATS.contains(format) => {}
            Some([b'E', b'R', b'G', b'M', format, 0, 0, 0]) => {
                return Err(ReadError::Format(*format));
            }
            _ => return Err(ReadError::Magic),
        }
        let (mut chunks, mut unpacked, mut end) = (Vec::new(), Vec::new(), MAGIC.len());
        let mut unpacked_total = UnpackedTotal::default();
        // As after a cut, nothing after a damaged chunk can be trusted.
        while let Ok((chunk, chunk_length)) = motion::read_chunk(&bytes[end..]) {
            let is_known = (kind::MANIFEST..=kind::LAST).contains(&chunk.kind);
            if is_known && chunk.version != VERSION {
                return Err(ReadError::Version(chunk.kind, chunk.version));
            }
            end += chunk_length;
            let chunk_ref = ChunkRef {
                kind: chunk.kind,
                seconds: chunk.seconds,
                offset: end - 4 - chunk.payload.len(),
                n_bytes: chunk.payload.len(),
                unpacked_offset: None,
            };
            if chunk.kind != kind::BUNDLE {
                chunks.push(chunk_ref);
                continue;
            }
            let position = chunk_ref.offset;
            let bundled_chunks =
                bundle::unpack(chunk.payload, end as u64, &mut unpacked_total).map_err(|error| match error {
                    BundleError::TooLong(length) => ReadError::Bundle(position, length),
                    BundleError::Damaged => ReadError::Payload(kind::BUNDLE, position),
                })?;
            for bundled in bundled_chunks {
                chunks.push(ChunkRef {
                    kind: bundled.kind,
                    seconds: bundled.seconds,
                    offset: position,
                    n_bytes: bundled.payload.len(),
                    unpacked_offset: Some(unpacked.len()),
                });
                unpacked.extend(bundled.payload);
            }
        }
        Ok(Self {
            bytes,
            unpacked_payloads: unpacked,
            chunks_end: end,
            refs: chunks,
        })
    }

    pub(super) fn payload(&self, chunk: &ChunkRef) -> &[u8] {
        match chunk.unpacked_offset {
            Some(start) => &self.unpacked_payloads[start..start + chunk.n_bytes],
            None => &self.bytes[chunk.offset..chunk.offset + chunk.n_bytes],
        }
    }

    /// Whether the file ends with its index.
    pub(super) fn is_complete(&self) -> bool {
        let is_index = |last: &ChunkRef| last.kind == kind::INDEX && last.unpacked_offset.is_none();
        self.refs.last().is_some_and(is_index) && self.chunks_end == self.bytes.len()
    }

    /// Whether the bytes after the last complete chunk are the beginning of a chunk.
    pub(super) fn is_truncated(&self) -> bool {
        self.chunks_end < self.bytes.len()
            && motion::read_chunk(&self.bytes[self.chunks_end..]) == Err(ChunkError::Truncated)
    }
}
