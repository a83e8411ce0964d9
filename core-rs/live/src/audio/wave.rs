//! Header of a WAVE file of float samples: RIFF with a placeholder for `ds64`, or RF64 if the sizes need 64 bits (EBU
//! Tech 3306).
//!
//! `ergon/exchange/wave_header.py` reads and writes the headers of renders in all formats. This header has the same
//! layout; it is written here because a performance records sound without Python.

const RIFF_LIMIT: u64 = u32::MAX as u64;
const DS64_BYTES: usize = 28;
const BEXT_BYTES: usize = 602;
const GUID_TAIL: [u8; 14] = [0, 0, 0, 0, 0x10, 0, 0x80, 0, 0, 0xAA, 0, 0x38, 0x9B, 0x71];

/// The bytes before the samples of a file of `frames`.
pub(super) fn header(rate: u32, channels: usize, frames: u64) -> Vec<u8> {
    header_above(rate, channels, frames, RIFF_LIMIT)
}

fn header_above(rate: u32, channels: usize, frames: u64, limit: u64) -> Vec<u8> {
    let frame_bytes = channels as u32 * 4;
    let data_bytes = frames * u64::from(frame_bytes);
    let mut chunk_bytes = Vec::new();
    chunk(&mut chunk_bytes, b"fmt ", &format(rate, channels, frame_bytes));
    let fact_frames = u32::try_from(frames).unwrap_or(u32::MAX);
    chunk(&mut chunk_bytes, b"fact", &fact_frames.to_le_bytes());
    chunk(&mut chunk_bytes, b"bext", &broadcast_extension());
    // A frame of floats has an even number of bytes: no padding.
    let riff_bytes = 4 + (8 + DS64_BYTES as u64) + chunk_bytes.len() as u64 + 8 + data_bytes;
    let mut header_bytes = Vec::new();
    if riff_bytes <= limit {
        header_bytes.extend(b"RIFF");
        header_bytes.extend((riff_bytes as u32).to_le_bytes());
        header_bytes.extend(b"WAVE");
        chunk(&mut header_bytes, b"JUNK", &[0; DS64_BYTES]);
        header_bytes.extend(chunk_bytes);
        header_bytes.extend(b"data");
        header_bytes.extend((data_bytes as u32).to_le_bytes());
    } else {
        header_bytes.extend(b"RF64\xff\xff\xff\xffWAVE");
        let mut ds64_bytes = Vec::new();
        for size in [riff_bytes, data_bytes, frames] {
            ds64_bytes.extend(size.to_le_bytes());
        }
        ds64_bytes.extend([0; 4]);
        chunk(&mut header_bytes, b"ds64", &ds64_bytes);
        header_bytes.extend(chunk_bytes);
        header_bytes.extend(b"data\xff\xff\xff\xff");
    }
    header_bytes
}

fn chunk(out: &mut Vec<u8>, name: &[u8; 4], content: &[u8]) {
    out.extend(name);
    out.extend((content.len() as u32).to_le_bytes());
    out.extend(content);
}

fn format(rate: u32, channels: usize, frame_bytes: u32) -> Vec<u8> {
    let speakers: u32 = match channels {
        1 => 0x4,
        2 => 0x3,
        _ => 0,
    };
    let mut format_bytes = Vec::new();
    format_bytes.extend(0xFFFE_u16.to_le_bytes());
    format_bytes.extend((channels as u16).to_le_bytes());
    format_bytes.extend(rate.to_le_bytes());
    format_bytes.extend(rate.saturating_mul(frame_bytes).to_le_bytes());
    format_bytes.extend((frame_bytes as u16).to_le_bytes());
    format_bytes.extend(32_u16.to_le_bytes());
    format_bytes.extend(22_u16.to_le_bytes()); // bytes that follow
    format_bytes.extend(32_u16.to_le_bytes());
    format_bytes.extend(speakers.to_le_bytes());
    format_bytes.extend(3_u16.to_le_bytes()); // float
    format_bytes.extend(GUID_TAIL);
    format_bytes
}

/// Broadcast data: the originator, and a fixed date, so that equal sounds give equal files.
fn broadcast_extension() -> Vec<u8> {
    let mut bext_bytes = vec![0; BEXT_BYTES];
    bext_bytes[256..261].copy_from_slice(b"ergon");
    bext_bytes[320..330].copy_from_slice(b"1970-01-01");
    bext_bytes[330..338].copy_from_slice(b"00:00:00");
    bext_bytes[346] = 1; // version
    bext_bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wave_headers_of_both_containers_have_equal_layout() {
        let (riff_header, rf64_header) = (header_above(48_000, 24, 10, u64::MAX), header_above(48_000, 24, 10, 0));
        assert_eq!(riff_header.len(), rf64_header.len());
        assert_eq!((&riff_header[..4], &rf64_header[..4]), (&b"RIFF"[..], &b"RF64"[..]));
        assert_eq!(rf64_header[20..28], riff_size(&riff_header).to_le_bytes());
    }

    fn riff_size(header: &[u8]) -> u64 {
        u32::from_le_bytes(header[4..8].try_into().expect("four bytes")).into()
    }

    #[test]
    fn wave_header_of_a_long_recording() {
        let frames = 16 * 60 * 48_000; // 16 minutes of 24 channels: more than 4 GiB
        let long_header = header(48_000, 24, frames);
        assert_eq!(&long_header[..4], b"RF64");
        assert_eq!(long_header[28..36], (frames * 96).to_le_bytes());
        assert_eq!(long_header[36..44], frames.to_le_bytes());
    }
}
