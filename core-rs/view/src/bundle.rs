//! Bundles: chunks of a file in one chunk, deflated.
//!
//! Chunks of one kind stand together as a group, and of all their records first the first byte, then the second, and
//! so on: bytes that are alike stand side by side. A group is `u16 kind, u16 record_width, u32 n`, the seconds and the
//! lengths of its n chunks, and their payloads one after the other, the last in records of `width` bytes.

use miniz_oxide::deflate::compress_to_vec_zlib;
use miniz_oxide::inflate::TINFLStatus;
use miniz_oxide::inflate::core::inflate_flags::{
    TINFL_FLAG_PARSE_ZLIB_HEADER, TINFL_FLAG_USING_NON_WRAPPING_OUTPUT_BUF,
};
use miniz_oxide::inflate::core::{DecompressorOxide, decompress};

use crate::motion::{self, PAYLOAD_MAX};
use crate::payload::{self, ByteReader, ByteWriter, kind};

/// Compression level, 0 to 10.
const COMPRESSION_LEVEL: u8 = 9;
/// What all bundles of a file may hold unpacked [bytes]: so much, and so many times the length of the file up to there.
const UNPACKED_BYTES_FREE: u64 = 16 << 20;
const UNPACKED_RATIO_MAX: u64 = 32;

/// How many bytes the bundles of a file hold so far, unpacked.
#[derive(Clone, Copy, Debug, Default)]
pub struct UnpackedTotal(u64);

impl UnpackedTotal {
    /// Whether a bundle that holds `length` bytes unpacked may end at byte `end` of a file; if so, it counts.
    fn admit(&mut self, length: usize, end: u64) -> bool {
        let total = self.0.saturating_add(length as u64);
        let is_admitted = length <= PAYLOAD_MAX
            && total <= UNPACKED_BYTES_FREE.saturating_add(end.saturating_mul(UNPACKED_RATIO_MAX));
        if is_admitted {
            self.0 = total;
        }
        is_admitted
    }
}

/// Why a bundle cannot be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BundleError {
    /// It would hold this many bytes, which are more than a reader takes.
    TooLong(usize),
    /// It is not what a bundle is.
    Damaged,
}

/// The seconds and the payload of a chunk in a group.
type GroupMember<'a> = (f64, &'a [u8]);

/// A chunk out of a bundle.
#[derive(Clone, Debug, PartialEq)]
pub struct BundledChunk {
    /// Its kind.
    pub kind: u16,
    /// Its instant [s].
    pub seconds: f64,
    /// Its payload.
    pub payload: Vec<u8>,
}

/// Appends `chunks`, complete chunks one after the other: as one bundle at `seconds` where that is shorter and readers
/// take it. `file_offset`: bytes of the file before `out`.
pub fn write_bundle(
    out: &mut Vec<u8>,
    seconds: f64,
    chunks: &[u8],
    file_offset: u64,
    unpacked_total: &mut UnpackedTotal,
) {
    let groups = group_chunks(chunks);
    let mut bundle_payload = ByteWriter::default();
    if groups.len() <= PAYLOAD_MAX {
        bundle_payload.u32(groups.len() as u32);
        bundle_payload
            .0
            .extend(compress_to_vec_zlib(&groups, COMPRESSION_LEVEL));
    }
    let mut bundle_bytes = Vec::new();
    payload::write_chunk(&mut bundle_bytes, kind::BUNDLE, seconds, &bundle_payload.0);
    let bundle_end = file_offset + (out.len() + bundle_bytes.len()) as u64;
    if bundle_bytes.len() < chunks.len() && unpacked_total.admit(groups.len(), bundle_end) {
        out.extend(bundle_bytes);
    } else {
        out.extend(chunks);
    }
}

/// The groups of complete chunks, as bytes.
fn group_chunks(mut chunk_bytes: &[u8]) -> Vec<u8> {
    let mut chunk_groups: Vec<(u16, Vec<GroupMember<'_>>)> = Vec::new();
    while let Ok((chunk, chunk_length)) = motion::read_chunk(chunk_bytes) {
        let member = (chunk.seconds, chunk.payload);
        match chunk_groups.iter_mut().find(|(kind, _)| *kind == chunk.kind) {
            Some((_, members)) => members.push(member),
            None => chunk_groups.push((chunk.kind, vec![member])),
        }
        chunk_bytes = &chunk_bytes[chunk_length..];
    }
    let mut group_bytes = ByteWriter::default();
    for (kind, members) in chunk_groups {
        let width = record_width(kind, &members);
        group_bytes.u16(kind);
        group_bytes.u16(width);
        group_bytes.u32(members.len() as u32);
        let (mut instants, mut lengths, mut payloads) = (ByteWriter::default(), ByteWriter::default(), Vec::new());
        for (seconds, payload) in members {
            instants.f64(seconds);
            lengths.u32(payload.len() as u32);
            payloads.extend_from_slice(payload);
        }
        split_columns(&mut group_bytes.0, &instants.0, 8);
        split_columns(&mut group_bytes.0, &lengths.0, 4);
        split_columns(&mut group_bytes.0, &payloads, usize::from(width));
    }
    group_bytes.0
}

/// The bytes of a record of a kind; of what is written in each frame, all of the frame.
fn record_width(kind: u16, members: &[GroupMember<'_>]) -> u16 {
    match kind {
        kind::LEVELS | kind::HANDS | kind::PEAKS => {
            let frame_length = members[0].1.len();
            let are_alike = members.iter().all(|(_, payload)| payload.len() == frame_length);
            u16::try_from(frame_length)
                .ok()
                .filter(|length| are_alike && *length > 0)
                .unwrap_or(4)
        }
        kind::ERGONS => 20,
        kind::FLIGHTS | kind::STATE | kind::CONTACTS => 12,
        kind::LINKS | kind::BROKEN => 8,
        kind::POINTS => 4,
        kind::SHAPES => 2,
        _ => 1,
    }
}

/// Appends records of `width` bytes: the first byte of each, then the second of each, and so on; then what is
/// left.
fn split_columns(out: &mut Vec<u8>, records: &[u8], width: usize) {
    let (full_records, remainder) = records.split_at(records.len() - records.len() % width);
    if !full_records.is_empty() {
        (0..width).for_each(|byte_index| out.extend(full_records[byte_index..].iter().step_by(width)));
    }
    out.extend(remainder);
}

/// The records of which [`split_columns`] made bytes.
fn join_columns(split_bytes: &[u8], width: usize) -> Vec<u8> {
    let record_count = split_bytes.len() / width;
    let mut records = split_bytes.to_vec();
    if record_count > 0 {
        for (byte_index, column) in split_bytes.chunks_exact(record_count).take(width).enumerate() {
            (column.iter().zip(records[byte_index..].iter_mut().step_by(width)))
                .for_each(|(byte, record_byte)| *record_byte = *byte);
        }
    }
    records
}

/// The chunks of a bundle that ends at byte `end` of a file, kind by kind.
///
/// # Errors
/// [`BundleError`] if it holds too much, or is damaged.
pub fn unpack(payload: &[u8], end: u64, unpacked_total: &mut UnpackedTotal) -> Result<Vec<BundledChunk>, BundleError> {
    let mut byte_reader = ByteReader(payload);
    let length = byte_reader.u32().ok_or(BundleError::Damaged)? as usize;
    if !unpacked_total.admit(length, end) {
        return Err(BundleError::TooLong(length));
    }
    inflate(byte_reader.0, length)
        .and_then(|group_bytes| ungroup_chunks(&group_bytes))
        .ok_or(BundleError::Damaged)
}

/// A zlib stream of known length; `None` unless it is whole and nothing follows it.
fn inflate(stream: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut inflated_bytes = vec![0; length];
    let flags = TINFL_FLAG_PARSE_ZLIB_HEADER | TINFL_FLAG_USING_NON_WRAPPING_OUTPUT_BUF;
    let (status, n_read, n_written) = decompress(&mut DecompressorOxide::new(), stream, &mut inflated_bytes, 0, flags);
    let is_whole = status == TINFLStatus::Done && n_read == stream.len() && n_written == length;
    is_whole.then_some(inflated_bytes)
}

fn ungroup_chunks(group_bytes: &[u8]) -> Option<Vec<BundledChunk>> {
    let (mut byte_reader, mut bundled_chunks) = (ByteReader(group_bytes), Vec::new());
    while !byte_reader.0.is_empty() {
        let (kind, width) = (byte_reader.u16()?, usize::from(byte_reader.u16()?));
        let count = byte_reader.u32()? as usize;
        if kind == kind::BUNDLE || width == 0 {
            return None;
        }
        let instants = join_columns(byte_reader.take_bytes(count.checked_mul(8)?)?, 8);
        let lengths = join_columns(byte_reader.take_bytes(count.checked_mul(4)?)?, 4);
        let mut length_reader = ByteReader(&lengths);
        let lengths: Vec<usize> = (0..count)
            .map_while(|_| length_reader.u32())
            .map(|n| n as usize)
            .collect();
        let payload_length = lengths
            .iter()
            .try_fold(0_usize, |sum, length| sum.checked_add(*length))?;
        let payloads = join_columns(byte_reader.take_bytes(payload_length)?, width);
        let (mut instants, mut payloads) = (ByteReader(&instants), ByteReader(&payloads));
        for length in lengths {
            bundled_chunks.push(BundledChunk {
                kind,
                seconds: instants.f64()?,
                payload: payloads.take_bytes(length)?.to_vec(),
            });
        }
    }
    Some(bundled_chunks)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn chunk_bytes(chunks: &[(u16, f64, Vec<u8>)]) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (kind, seconds, payload) in chunks {
            payload::write_chunk(&mut bytes, *kind, *seconds, payload);
        }
        bytes
    }

    /// A bundle's payload, of groups as bytes.
    fn bundle_of(group_bytes: &[u8]) -> Vec<u8> {
        let mut bytes = (group_bytes.len() as u32).to_le_bytes().to_vec();
        bytes.extend(compress_to_vec_zlib(group_bytes, COMPRESSION_LEVEL));
        bytes
    }

    fn opened(payload: &[u8]) -> Result<Vec<BundledChunk>, BundleError> {
        unpack(payload, payload.len() as u64, &mut UnpackedTotal::default())
    }

    proptest! {
        #[test]
        fn bundle_round_trip_and_damage(
            chunks in prop::collection::vec((1..18_u16, -1.0..9.0_f64, prop::collection::vec(0..3_u8, 0..70)), 0..30),
            at: prop::sample::Index, bit in 0..8_u32,
        ) {
            let mut payload = bundle_of(&group_chunks(&chunk_bytes(&chunks)));
            let bundled = opened(&payload).expect("chunks");
            // Of one kind in the order in which they were.
            for kind in 1..18 {
                let before: Vec<_> = chunks.iter().filter(|one| one.0 == kind).map(|one| (one.1, &one.2)).collect();
                let after: Vec<_> = bundled.iter().filter(|one| one.kind == kind).map(|one| (one.seconds, &one.payload)).collect();
                prop_assert_eq!(before, after);
            }
            prop_assert_eq!(bundled.len(), chunks.len());
            let i = at.index(payload.len());
            prop_assert!(opened(&payload[..i]).is_err());
            payload.push(0);
            prop_assert_eq!(opened(&payload), Err(BundleError::Damaged));
            payload.pop();
            payload[i] ^= 1 << bit;
            let _ = opened(&payload); // whatever it is, it ends
        }

        #[test]
        fn open_of_any_groups(group_bytes in prop::collection::vec(0..4_u8, 0..200)) {
            let _ = opened(&bundle_of(&group_bytes));
        }
    }

    #[test]
    fn open_refuses_more_than_a_file_may_hold() {
        let length = UNPACKED_BYTES_FREE as usize;
        let payload = bundle_of(&vec![0; length]);
        let mut unpacked = UnpackedTotal::default();
        // The first is within what every file may hold, but no group has a width of 0.
        assert_eq!(unpack(&payload, 1 << 10, &mut unpacked), Err(BundleError::Damaged));
        assert_eq!(
            unpack(&payload, 1 << 16, &mut unpacked),
            Err(BundleError::TooLong(length))
        );
        let longer = (PAYLOAD_MAX as u32 + 1).to_le_bytes();
        assert_eq!(
            unpack(&longer, 1 << 30, &mut UnpackedTotal::default()),
            Err(BundleError::TooLong(PAYLOAD_MAX + 1))
        );
    }

    #[test]
    fn open_refuses_bundles_in_bundles() {
        let inner = chunk_bytes(&[(kind::BUNDLE, 0.0, vec![0; 9])]);
        assert_eq!(opened(&bundle_of(&group_chunks(&inner))), Err(BundleError::Damaged));
    }

    #[test]
    fn put_keeps_chunks_beyond_the_bound() {
        let silence = chunk_bytes(&[(kind::LEVELS, 0.0, vec![0; 1 << 20])]);
        let (mut out, mut unpacked) = (Vec::new(), UnpackedTotal(UNPACKED_BYTES_FREE));
        write_bundle(&mut out, 0.0, &silence, 0, &mut unpacked);
        assert_eq!(out, silence);
        out.clear();
        write_bundle(&mut out, 0.0, &silence, 1 << 20, &mut unpacked);
        assert!(out.len() < silence.len() / 100);
    }

    #[test]
    fn put_keeps_chunks_shorter_than_a_bundle() {
        let short = chunk_bytes(&[(kind::PEAKS, 0.0, vec![1, 2, 3, 4])]);
        let mut out = Vec::new();
        write_bundle(&mut out, 0.0, &short, 0, &mut UnpackedTotal::default());
        assert_eq!(out, short);
    }
}
