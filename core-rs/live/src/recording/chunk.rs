//! The frame of every chunk: length, kind, checksum, payload.

use std::io::{self, Read};

/// length u32, kind u8, crc32 u32.
pub(super) const CHUNK_OVERHEAD: usize = 9;
/// Greatest size of a payload [bytes].
pub(super) const PAYLOAD_MAX: usize = 1 << 20;

/// Kinds of payload. Other numbers are of later versions and are skipped.
pub(super) const HEADER: u8 = 1;
pub(super) const ROWS: u8 = 2;
pub(super) const EVENTS: u8 = 3;
pub(super) const END: u8 = 4;

/// CRC-32 (that of zlib) over length, kind and payload. It rejects a run of zeros, which a power cut may leave.
fn checksum(length: u32, kind: u8, payload: &[u8]) -> u32 {
    let mut crc_hasher = crc32fast::Hasher::new();
    crc_hasher.update(&length.to_le_bytes());
    crc_hasher.update(&[kind]);
    crc_hasher.update(payload);
    crc_hasher.finalize()
}

/// Append a chunk whose payload is at most [`PAYLOAD_MAX`].
pub(super) fn append(bytes: &mut Vec<u8>, kind: u8, payload: &[u8]) {
    debug_assert!(payload.len() <= PAYLOAD_MAX);
    let payload_length = payload.len() as u32;
    bytes.extend_from_slice(&payload_length.to_le_bytes());
    bytes.push(kind);
    bytes.extend_from_slice(&checksum(payload_length, kind, payload).to_le_bytes());
    bytes.extend_from_slice(payload);
}

/// The state of the bytes where a chunk should begin.
#[derive(Debug, PartialEq)]
pub(super) enum ChunkState {
    /// A whole chunk of this kind; its payload is in the buffer.
    Complete(u8),
    /// Bytes that are not a valid chunk; the next chunk begins after them.
    Damaged,
    /// A length beyond the end of the file, or above [`PAYLOAD_MAX`]: where the next chunk begins is unknown.
    Cut,
}

/// Read the chunk that begins here, with `bytes_left` bytes to the end of the file; `payload` is overwritten.
pub(super) fn next_chunk(reader: &mut impl Read, bytes_left: u64, payload: &mut Vec<u8>) -> io::Result<ChunkState> {
    if bytes_left < CHUNK_OVERHEAD as u64 {
        return Ok(ChunkState::Cut);
    }
    let mut frame_bytes = [0; CHUNK_OVERHEAD];
    reader.read_exact(&mut frame_bytes)?;
    let payload_length = u32::from_le_bytes([frame_bytes[0], frame_bytes[1], frame_bytes[2], frame_bytes[3]]);
    let stored_crc = u32::from_le_bytes([frame_bytes[5], frame_bytes[6], frame_bytes[7], frame_bytes[8]]);
    if payload_length as usize > PAYLOAD_MAX || CHUNK_OVERHEAD as u64 + u64::from(payload_length) > bytes_left {
        return Ok(ChunkState::Cut);
    }
    payload.resize(payload_length as usize, 0);
    reader.read_exact(payload)?;
    if checksum(payload_length, frame_bytes[4], payload) == stored_crc {
        Ok(ChunkState::Complete(frame_bytes[4]))
    } else {
        Ok(ChunkState::Damaged)
    }
}
