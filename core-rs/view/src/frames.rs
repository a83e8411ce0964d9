//! Displacements of the points of a part, frame by frame.

use miniz_oxide::deflate::compress_to_vec_zlib;
use miniz_oxide::inflate::decompress_to_vec_zlib_with_limit;

use crate::payload::{Bytes, Reading};

/// Largest number of values in one chunk.
const NUMBERS_MAX: usize = 1 << 24;
/// Number of steps up to the largest displacement: in a file, and live.
const STEPS_IN_FILE: f64 = 511.0;
const STEPS_LIVE: f64 = 32_767.0;
/// Compression level, 0 to 10.
const COMPRESSION_LEVEL: u8 = 6;

/// Frames of one part.
#[derive(Clone, Debug, PartialEq)]
pub struct Frames {
    /// Index of the part.
    pub part: u16,
    /// Seconds from one frame to the next.
    pub hop: f64,
    /// Displacements [m]   (count, n); NaN: unknown.
    pub rows: Vec<f64>,
    /// Number of frames.
    pub count: usize,
}

impl Frames {
    /// The payload: ten bits a value and compressed, or 16 bits a value and not compressed.
    pub fn bytes(&self, is_compressed: bool) -> Vec<u8> {
        let n = self.rows.len() / self.count.max(1);
        let steps = if is_compressed {
            STEPS_IN_FILE
        } else {
            STEPS_LIVE
        };
        let mut out = Bytes::default();
        out.u16(self.part);
        out.0.extend([u8::from(is_compressed), 0]);
        out.u32(self.count as u32);
        out.f64(self.hop);
        let (mut scales, mut planes) = (Bytes::default(), Vec::new());
        for row in self.rows.chunks(n.max(1)) {
            let is_known = row.iter().all(|x| x.is_finite());
            let most = row.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            // The scale as the reader gets it, in single precision.
            let scale = f64::from((most / steps) as f32).max(f64::from(f32::MIN_POSITIVE));
            let told = if is_known { scale } else { f64::NAN };
            let steps_of = |x: &f64| {
                let q = (x / scale).round_ties_even().clamp(-steps, steps);
                if is_known { q as i32 } else { 0 }
            };
            if !is_compressed {
                out.f32(told);
                for x in row {
                    out.0.extend((steps_of(x) as i16).to_le_bytes());
                }
                continue;
            }
            scales.f32(told);
            let mut last = 0;
            let zigzags: Vec<u16> = row
                .iter()
                .map(|x| {
                    let q = steps_of(x);
                    let step = q - std::mem::replace(&mut last, q);
                    ((step << 1) ^ (step >> 31)) as u16
                })
                .collect();
            planes.extend(zigzags.iter().map(|z| *z as u8));
            planes.extend(zigzags.iter().map(|z| (z >> 8) as u8));
        }
        if is_compressed {
            scales.0.extend(planes);
            out.0
                .extend(compress_to_vec_zlib(&scales.0, COMPRESSION_LEVEL));
        }
        out.0
    }

    /// The frames of a payload; `points_of`: number of points of a part. `None` if the payload is damaged.
    pub fn read(payload: &[u8], points_of: impl Fn(u16) -> Option<usize>) -> Option<Self> {
        let mut from = Reading(payload);
        let part = from.u16()?;
        let &[coding, _] = from.take(2)? else {
            return None;
        };
        let (count, hop) = (from.u32()? as usize, from.f64()?);
        let n = points_of(part)?;
        let numbers = count.checked_mul(n).filter(|all| *all <= NUMBERS_MAX)?;
        if !(hop > 0.0 && hop.is_finite()) || count > NUMBERS_MAX {
            return None;
        }
        let mut rows = Vec::new();
        match coding {
            0 => {
                for _ in 0..count {
                    let scale = from.f32()?;
                    for _ in 0..n {
                        rows.push(scale * f64::from(from.u16()? as i16));
                    }
                }
            }
            1 => {
                let size = 4 * count + 2 * numbers;
                let plain = decompress_to_vec_zlib_with_limit(from.0, size).ok()?;
                if plain.len() != size {
                    return None;
                }
                let (scales, planes) = plain.split_at(4 * count);
                let mut scales = Reading(scales);
                for row in planes.chunks(2 * n.max(1)).take(count) {
                    let scale = scales.f32()?;
                    let (low, high) = row.split_at(n);
                    let mut q = 0_i32;
                    for (low, high) in low.iter().zip(high) {
                        let z = i32::from(u16::from_le_bytes([*low, *high]));
                        q += (z >> 1) ^ -(z & 1);
                        rows.push(scale * f64::from(q));
                    }
                }
                from = Reading(&[]);
            }
            _ => return None,
        }
        from.0.is_empty().then_some(Self {
            part,
            hop,
            rows,
            count,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn frames_come_back_within_half_a_step(
            rows in prop::collection::vec(prop::collection::vec(-1e-3..1e-3_f64, 7), 1..9), is_compressed: bool,
        ) {
            let frames = Frames { part: 3, hop: 1.0 / 60.0, count: rows.len(), rows: rows.concat() };
            let bytes = frames.bytes(is_compressed);
            let found = Frames::read(&bytes, |part| (part == 3).then_some(7)).expect("frames");
            prop_assert_eq!((found.part, found.count, found.hop), (3, rows.len(), frames.hop));
            let steps = if is_compressed { 511.0 } else { 32_767.0 };
            for (row, own) in rows.iter().zip(found.rows.chunks(7)) {
                let most = row.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
                for (x, y) in row.iter().zip(own) {
                    prop_assert!((x - y).abs() <= 0.501 * most / steps);
                }
            }
            // More bytes, fewer bytes, or another number of points are refused.
            prop_assert!(Frames::read(&bytes[..bytes.len() - 1], |_| Some(7)).is_none());
            prop_assert!(Frames::read(&bytes, |_| Some(8)).is_none());
        }

        #[test]
        fn any_bytes_are_frames_or_none(bytes: Vec<u8>, n in 0..100_usize) {
            let _ = Frames::read(&bytes, |_| Some(n));
        }
    }

    #[test]
    fn what_is_not_known_is_told() {
        for is_compressed in [false, true] {
            let rows = vec![1.0, f64::NAN, 2.0, 1.0];
            let frames = Frames {
                part: 0,
                hop: 0.1,
                count: 2,
                rows,
            };
            let found = Frames::read(&frames.bytes(is_compressed), |_| Some(2)).expect("frames");
            assert!(found.rows[0].is_nan() && found.rows[1].is_nan());
            assert!((found.rows[2] - 2.0).abs() < 1e-3);
        }
    }
}
