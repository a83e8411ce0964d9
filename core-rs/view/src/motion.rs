//! The `.motion` format: chunks of a kind, an instant and a payload, each closed by its CRC-32.
//!
//! A file is the eight bytes [`MAGIC`], then chunks. A chunk is `u16 kind, u16 version, u32 length, f64 seconds`, then
//! the payload, then the CRC-32 of all of these; numbers are little-endian. If a file ends within a chunk, the chunks
//! before it are valid.

use std::ops::RangeInclusive;

use thiserror::Error;

/// The first bytes of every file that is written.
pub const MAGIC: [u8; 8] = *b"ERGM\x03\0\0\0";

/// The formats that are read: one of them is the fifth byte of a file.
pub const FORMATS: RangeInclusive<u8> = 2..=3;

const HEAD_BYTES: usize = 16;
const CRC_BYTES: usize = 4;

/// Largest length of a payload [bytes]: a frame of 10⁶ points in f64 is an eighth of it.
pub const PAYLOAD_MAX: usize = 64 << 20;

/// One chunk, as it is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chunk<'a> {
    /// Kind of the payload.
    pub kind: u16,
    /// Version of the payload's format.
    pub version: u16,
    /// The instant at which it is heard \[s\].
    pub seconds: f64,
    /// The data, in the format of its kind.
    pub payload: &'a [u8],
}

/// Why bytes cannot be parsed as a chunk.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum ChunkError {
    /// The bytes end before the chunk does: more may follow.
    #[error("the bytes end within a chunk")]
    Truncated,
    /// A length above [`PAYLOAD_MAX`].
    #[error("a payload has {0} bytes; {PAYLOAD_MAX} is the most")]
    TooLong(usize),
    /// The checksum does not match.
    #[error("the CRC-32 of a chunk is wrong")]
    Crc,
}

/// Appends one chunk.
///
/// # Panics
///
/// If the payload is longer than [`PAYLOAD_MAX`].
pub fn write_chunk(out: &mut Vec<u8>, chunk: &Chunk) {
    assert!(
        chunk.payload.len() <= PAYLOAD_MAX,
        "a payload of {} bytes",
        chunk.payload.len()
    );
    let chunk_begin = out.len();
    out.extend_from_slice(&chunk.kind.to_le_bytes());
    out.extend_from_slice(&chunk.version.to_le_bytes());
    out.extend_from_slice(&(chunk.payload.len() as u32).to_le_bytes());
    out.extend_from_slice(&chunk.seconds.to_le_bytes());
    out.extend_from_slice(chunk.payload);
    let chunk_crc = crc32fast::hash(&out[chunk_begin..]);
    out.extend_from_slice(&chunk_crc.to_le_bytes());
}

/// The chunk at the beginning of `bytes`, and how many bytes it takes.
///
/// # Errors
///
/// [`ChunkError`] if there is no complete chunk.
pub fn read_chunk(bytes: &[u8]) -> Result<(Chunk<'_>, usize), ChunkError> {
    let head_bytes = bytes.get(..HEAD_BYTES).ok_or(ChunkError::Truncated)?;
    let number_at = |offset: usize| u16::from_le_bytes([head_bytes[offset], head_bytes[offset + 1]]);
    let payload_length = u32::from_le_bytes([head_bytes[4], head_bytes[5], head_bytes[6], head_bytes[7]]) as usize;
    if payload_length > PAYLOAD_MAX {
        return Err(ChunkError::TooLong(payload_length));
    }
    let payload_end = HEAD_BYTES + payload_length;
    let crc_bytes = bytes
        .get(payload_end..payload_end + CRC_BYTES)
        .ok_or(ChunkError::Truncated)?;
    if crc32fast::hash(&bytes[..payload_end]).to_le_bytes() != crc_bytes {
        return Err(ChunkError::Crc);
    }
    let seconds = f64::from_le_bytes(head_bytes[8..].try_into().expect("eight bytes"));
    Ok((
        Chunk {
            kind: number_at(0),
            version: number_at(2),
            seconds,
            payload: &bytes[HEAD_BYTES..payload_end],
        },
        payload_end + CRC_BYTES,
    ))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn chunk_round_trip_and_damage(
            kind: u16, version: u16, seconds: f64, payload: Vec<u8>, at: prop::sample::Index, bit in 0..8u32,
        ) {
            let chunk = Chunk { kind, version, seconds, payload: &payload };
            let mut bytes = Vec::new();
            write_chunk(&mut bytes, &chunk);
            let (found, n) = read_chunk(&bytes).expect("a chunk");
            prop_assert_eq!(n, bytes.len());
            prop_assert_eq!((found.kind, found.version, found.payload), (kind, version, &payload[..]));
            prop_assert_eq!(found.seconds.to_bits(), seconds.to_bits());
            let i = at.index(bytes.len());
            prop_assert_eq!(read_chunk(&bytes[..i]), Err(ChunkError::Truncated));
            bytes[i] ^= 1 << bit;
            prop_assert!(read_chunk(&bytes).is_err());
        }
    }
}
