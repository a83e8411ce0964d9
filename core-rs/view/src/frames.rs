//! Displacements of the points of a part, frame by frame.

use crate::packed;
use crate::payload::{ByteReader, ByteWriter};

/// Largest number of values in one chunk.
const VALUES_MAX: usize = 1 << 24;
/// Codings: numbers of single precision, and steps for each point.
const CODING_PLAIN: u8 = 0;
const CODING_PACKED: u8 = 1;

/// Displacement from frame to frame below which a point rests \[m\]: its steps are then a micrometre at most.
const REST_METRES: f64 = 1.5e-6;

/// The displacement at a share of the time from frame x to the next one, y: on the cubic through these and the frames
/// before and after, on a parabola where one of those is not known, and on a straight line where the point rests.
pub fn interpolate_cubic(time_share: f64, (x, y): (f64, f64), before: Option<f64>, after: Option<f64>) -> f64 {
    let (before, after) = match (before, after) {
        (None, None) => return x + time_share * (y - x),
        (Some(before), None) => (before, 3.0 * (y - x) + before),
        (None, Some(after)) => (3.0 * (x - y) + after, after),
        (Some(before), Some(after)) => (before, after),
    };
    let is_still = |from: f64, to: f64| (to - from).abs() <= REST_METRES;
    if is_still(x, y) && (is_still(before, x) || is_still(y, after)) {
        return x + time_share * (y - x);
    }
    let (from_previous, from_next, from_after) = (time_share + 1.0, time_share - 1.0, time_share - 2.0);
    let outer_terms = time_share * from_next * (from_previous * after - from_after * before) / 6.0;
    outer_terms + from_previous * from_after * (from_next * x - time_share * y) / 2.0
}

/// Frames of one part.
#[derive(Clone, Debug, PartialEq)]
pub struct PartFrames {
    /// Index of the part.
    pub part: u16,
    /// Seconds from one frame to the next.
    pub frame_interval: f64,
    /// Displacements [m]   (count, n); NaN: unknown.
    pub rows: Vec<f64>,
    /// Number of frames.
    pub n_frames: usize,
}

impl PartFrames {
    /// The payload for a live page, which draws each frame by itself: in single precision.
    pub fn plain_payload(&self) -> Vec<u8> {
        let mut payload_bytes = self.payload_head(CODING_PLAIN);
        self.rows.iter().for_each(|x| payload_bytes.f32(*x));
        payload_bytes.0
    }

    /// The payload for a file, within [`packed_payload::ERROR_BOUNDS`]; plain if a displacement is not known.
    /// `amplitudes` [m] are those of the points so far, these frames included   (n)
    pub fn packed_payload(&self, amplitudes: &[f64]) -> Vec<u8> {
        if !self.rows.iter().all(|x| x.is_finite()) {
            return self.plain_payload();
        }
        let mut payload_bytes = self.payload_head(CODING_PACKED);
        packed::pack(&mut payload_bytes, &self.rows, amplitudes);
        payload_bytes.0
    }

    fn payload_head(&self, coding: u8) -> ByteWriter {
        let mut head_bytes = ByteWriter::default();
        head_bytes.u16(self.part);
        head_bytes.0.extend([coding, 0]);
        head_bytes.u32(self.n_frames as u32);
        head_bytes.f64(self.frame_interval);
        head_bytes
    }

    /// The frames of a payload; `n_points_of`: number of points of a part. `None` if the payload is damaged.
    pub fn read_payload(payload: &[u8], n_points_of: impl Fn(u16) -> Option<usize>) -> Option<Self> {
        let mut reader = ByteReader(payload);
        let part = reader.u16()?;
        let &[coding, _] = reader.take_bytes(2)? else {
            return None;
        };
        let (n_frames, frame_interval) = (reader.u32()? as usize, reader.f64()?);
        let point_count = n_points_of(part)?;
        let n_values = n_frames.checked_mul(point_count).filter(|all| *all <= VALUES_MAX)?;
        if !(frame_interval > 0.0 && frame_interval.is_finite()) || n_frames > VALUES_MAX {
            return None;
        }
        let rows = match coding {
            CODING_PLAIN if reader.0.len() == 4 * n_values => {
                let number_chunks = reader.0.chunks_exact(4);
                number_chunks.filter_map(|x| ByteReader(x).f32()).collect()
            }
            CODING_PACKED => packed::unpack(reader.0, n_frames, point_count)?,
            _ => return None,
        };
        Some(Self {
            part,
            frame_interval,
            rows,
            n_frames,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::packed::ERROR_BOUNDS;

    const POINTS: usize = 5;

    fn frames(rows: Vec<f64>) -> PartFrames {
        let count = rows.len() / POINTS;
        PartFrames {
            part: 3,
            frame_interval: 1.0 / 60.0,
            rows,
            n_frames: count,
        }
    }

    fn amplitudes(rows: &[f64]) -> Vec<f64> {
        let point_rows = (0..POINTS).map(|point| rows[point..].iter().step_by(POINTS));
        let extents = point_rows
            .map(|x| x.clone().copied().fold(f64::NEG_INFINITY, f64::max) - x.copied().fold(f64::INFINITY, f64::min));
        extents.map(|extent| 0.5 * extent).collect()
    }

    fn read(bytes: &[u8]) -> Option<PartFrames> {
        PartFrames::read_payload(bytes, |part| (part == 3).then_some(POINTS))
    }

    proptest! {
        /// Points of amplitudes from 1 nm to 1 km beside each other, far from where they rest or near.
        #[test]
        fn packed_points_return_within_their_bounds(
            exponents in prop::collection::vec(-9.0..3.0_f64, POINTS),
            offsets in prop::collection::vec(-500.0..500.0_f64, POINTS),
            shares in prop::collection::vec(prop::collection::vec(-1.0..1.0_f64, POINTS), 1..70),
        ) {
            let size = |point: usize| ergon_engine::maths::pow(10.0, exponents[point]);
            let rows: Vec<f64> = shares.iter()
                .flat_map(|row| row.iter().enumerate().map(|(point, x)| offsets[point] + size(point) * x))
                .collect();
            let (all, amplitudes) = (frames(rows), amplitudes(&shares.concat()));
            let amplitudes: Vec<f64> = amplitudes.iter().enumerate().map(|(point, x)| x * size(point)).collect();
            let bytes = all.packed_payload(&amplitudes);
            let copy = read(&bytes).expect("frames");
            prop_assert_eq!((copy.part, copy.n_frames, copy.frame_interval), (3, all.n_frames, all.frame_interval));
            for (i, (x, y)) in all.rows.iter().zip(&copy.rows).enumerate() {
                let bound = (ERROR_BOUNDS.amplitude_share * amplitudes[i % POINTS]).max(ERROR_BOUNDS.metres_min);
                prop_assert!((x - y).abs() <= 1.001 * bound, "{x} {y} {bound}");
            }
            prop_assert!(read(&bytes[..bytes.len() - 1]).is_none());
        }

        #[test]
        fn plain_frames_return_in_single_precision(
            rows in prop::collection::vec(prop::collection::vec(-1e3..1e3_f64, POINTS), 1..9),
        ) {
            let all = frames(rows.concat());
            let copy = read(&all.plain_payload()).expect("frames");
            for (x, y) in all.rows.iter().zip(&copy.rows) {
                prop_assert_eq!(f64::from(*x as f32), *y);
            }
        }

        #[test]
        fn decode_of_random_bytes(coding in 0..3_u8, bytes: Vec<u8>, n in 0..100_usize) {
            let _ = PartFrames::read_payload(&bytes, |_| Some(n));
            let head = PartFrames { rows: Vec::new(), n_frames: 3, ..frames(Vec::new()) }.payload_head(coding);
            let _ = PartFrames::read_payload(&[head.0, bytes].concat(), |_| Some(n));
        }
    }

    #[test]
    fn decode_of_point_at_rest() {
        let frame_rows: Vec<f64> = (0..120)
            .flat_map(|t| {
                let displacement = 0.123_456_789 * f64::from(t.min(40));
                [displacement, 0.0, -displacement, 0.5, 1e-3 * f64::from(t % 7)]
            })
            .collect();
        let all_frames = frames(frame_rows);
        let decoded = read(&all_frames.packed_payload(&amplitudes(&all_frames.rows))).expect("frames");
        for t in (0..120).filter(|t| *t >= 60) {
            for point in [0, 1, 2, 3] {
                let row_error = all_frames.rows[t * POINTS + point] - decoded.rows[t * POINTS + point];
                assert!(
                    row_error.abs() <= 1.001 * ERROR_BOUNDS.resting_metres,
                    "{t} {point} {row_error}"
                );
            }
        }
    }

    #[test]
    fn interpolate_cubic_and_rest() {
        let cubic = |t: f64| 1.0 + t * (2.0 - t * (0.5 - 0.25 * t));
        let parabola = |t: f64| 1.0 - t * (2.0 + t);
        for share in [0.0, 0.1, 0.5, 0.9] {
            let assert_close = |x: f64, y: f64| assert!((x - y).abs() < 1e-12, "{x} {y}");
            let end_positions = (cubic(0.0), cubic(1.0));
            assert_close(
                interpolate_cubic(share, end_positions, Some(cubic(-1.0)), Some(cubic(2.0))),
                cubic(share),
            );
            let end_positions = (parabola(0.0), parabola(1.0));
            assert_close(
                interpolate_cubic(share, end_positions, Some(parabola(-1.0)), None),
                parabola(share),
            );
            assert_close(
                interpolate_cubic(share, end_positions, None, Some(parabola(2.0))),
                parabola(share),
            );
            assert_close(interpolate_cubic(share, (1.0, 2.0), None, None), 1.0 + share);
            assert_close(interpolate_cubic(share, (0.5, 0.5), Some(0.5), Some(9.0)), 0.5);
            assert_close(interpolate_cubic(share, (0.5, 0.5), Some(-9.0), Some(0.5)), 0.5);
        }
    }

    #[test]
    fn unknown_positions_are_nan() {
        let frame_rows = vec![1.0, f64::NAN, 2.0, 1.0, 0.0];
        for bytes in [
            frames(frame_rows.clone()).plain_payload(),
            frames(frame_rows).packed_payload(&[1.0; POINTS]),
        ] {
            let decoded = read(&bytes).expect("frames");
            assert_eq!(decoded.rows[0], 1.0);
            assert!(decoded.rows[1].is_nan());
        }
    }
}
