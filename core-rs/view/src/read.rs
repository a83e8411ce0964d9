//! Reads the complete part of a motion file, and computes positions at any instant.

use ergon_engine::simulation::Oscillation;
use serde_json::Value;
use thiserror::Error;

use crate::frames::{PartFrames, interpolate_cubic};
use crate::motion::FORMATS;
use crate::payload::{ByteReader, half_value, kind};
use chunks::Chunks;

mod chunks;

pub use chunks::ChunkRef;

/// Why a file cannot be read.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ReadError {
    /// The file does not begin with the magic bytes.
    #[error("this is not a motion file: it does not begin with ERGM")]
    Magic,
    /// The file has the format of another version.
    #[error("this motion file has format {0}, and this ergon reads formats {first} and {last}: render the score again with --motion", first = FORMATS.start(), last = FORMATS.end())]
    Format(u8),
    /// The manifest or a table is incomplete or damaged.
    #[error("the {0} of this motion file is missing or damaged")]
    Table(&'static str),
    /// A payload of another version of the format.
    #[error("this motion file was written by a newer ergon: kind {0} has version {1}")]
    Version(u16, u16),
    /// A payload that does not match its kind.
    #[error("a chunk of kind {0} at byte {1} of this motion file is damaged")]
    Payload(u16, usize),
    /// A bundle that holds more than a reader takes.
    #[error(
        "the bundle at byte {0} of this motion file would unpack to {1} bytes, more than a file of this length may hold"
    )]
    Bundle(usize, usize),
}

/// The contents of a file, up to its last complete chunk.
#[derive(Clone, Debug)]
pub struct MotionFile {
    chunks: Chunks,
    /// The manifest, as JSON.
    pub manifest: String,
    /// Whether the last chunk is the index: the recording was finished.
    pub is_complete: bool,
    /// Number of points.
    pub n_points: usize,
    /// Number of modes.
    pub n_modes: usize,
    /// x, y, z, rest of each point [m]   (n_points)
    pub point_positions: Vec<[f64; 4]>,
    /// Names of points.
    pub point_names: Vec<String>,
    parts: Vec<MotionPart>,
    /// (n_points + n_modes)
    oscillations: Vec<Oscillation>,
}

#[derive(Clone, Debug)]
struct MotionPart {
    first_point: usize,
    n_points: usize,
    kind: PartMotion,
}

#[derive(Clone, Debug)]
enum PartMotion {
    Free,
    Sampled,
    Modal {
        first_mode: usize,
        n_modes: usize,
        /// Displacement of each point per unit of each mode   (n, n_modes)
        shapes: Vec<f64>,
    },
    NotComputed,
}

/// Largest number of points or modes: a larger one means damage.
const COUNT_MAX: usize = 1 << 24;

impl MotionFile {
    /// Read the complete chunks of a file.
    ///
    /// # Errors
    /// [`ReadError`] if its manifest or tables are incomplete, or a complete chunk does not match its kind.
    pub fn new(bytes: Vec<u8>) -> Result<Self, ReadError> {
        let chunks = Chunks::new(bytes)?;
        let mut motion_file = Self {
            is_complete: chunks.is_complete(),
            chunks,
            manifest: String::new(),
            n_points: 0,
            n_modes: 0,
            point_positions: Vec::new(),
            point_names: Vec::new(),
            parts: Vec::new(),
            oscillations: Vec::new(),
        };
        motion_file.read_manifest().ok_or(ReadError::Table("manifest"))?;
        motion_file.read_points().ok_or(ReadError::Table("table of points"))?;
        motion_file.read_names().ok_or(ReadError::Table("list of names"))?;
        motion_file.read_shapes().ok_or(ReadError::Table("table of shapes"))?;
        motion_file.check_payloads()?;
        Ok(motion_file)
    }

    /// Whether the bytes after the last complete chunk are the beginning of a chunk: the file was cut, not damaged.
    pub fn is_truncated(&self) -> bool {
        self.chunks.is_truncated()
    }

    /// All complete chunks; those of a bundle in its place, kind by kind.
    pub fn chunks(&self) -> &[ChunkRef] {
        &self.chunks.refs
    }

    /// The payload of a chunk.
    pub fn payload(&self, chunk: &ChunkRef) -> &[u8] {
        self.chunks.payload(chunk)
    }

    /// Duration [s]: up to the last frame or event.
    pub fn duration(&self) -> f64 {
        let chunk_end = |chunk: &ChunkRef| match chunk.kind {
            kind::FRAMES => {
                let mut head_reader = ByteReader(&self.payload(chunk)[4..]);
                let frame_count = head_reader.u32().unwrap_or(1).max(1);
                chunk.seconds + f64::from(frame_count - 1) * head_reader.f64().unwrap_or(0.0)
            }
            _ => chunk.seconds,
        };
        self.chunks().iter().map(chunk_end).fold(0.0, f64::max)
    }

    fn first_payload(&self, kind: u16) -> Option<&[u8]> {
        let chunk = self.chunks().iter().find(|chunk| chunk.kind == kind)?;
        Some(self.payload(chunk))
    }

    fn read_manifest(&mut self) -> Option<()> {
        let manifest_text = std::str::from_utf8(self.first_payload(kind::MANIFEST)?)
            .ok()?
            .to_owned();
        let manifest: Value = serde_json::from_str(&manifest_text).ok()?;
        let integer = |value: &Value, name: &str| -> Option<usize> {
            usize::try_from(value.get(name)?.as_u64()?)
                .ok()
                .filter(|n| *n <= COUNT_MAX)
        };
        (self.n_points, self.n_modes) = (integer(&manifest, "points")?, integer(&manifest, "modes")?);
        let mut points_end = 0;
        for part in manifest.get("parts")?.as_array()? {
            let (first_point, n_points) = (integer(part, "first")?, integer(part, "count")?);
            if first_point != points_end {
                return None;
            }
            points_end += n_points;
            let kind = match part.get("kind")?.as_str()? {
                "free" => PartMotion::Free,
                "sampled" => PartMotion::Sampled,
                "modal" => {
                    let mode_range = part.get("modes")?;
                    let (first_mode, mode_count) = (integer(mode_range, "first")?, integer(mode_range, "count")?);
                    if first_mode + mode_count > self.n_modes || mode_count * n_points > 8 * COUNT_MAX {
                        return None;
                    }
                    PartMotion::Modal {
                        first_mode,
                        n_modes: mode_count,
                        shapes: vec![0.0; mode_count * n_points],
                    }
                }
                "none" => PartMotion::NotComputed,
                _ => return None,
            };
            self.parts.push(MotionPart {
                first_point,
                n_points,
                kind,
            });
        }
        self.manifest = manifest_text;
        (points_end == self.n_points).then_some(())
    }

    fn read_points(&mut self) -> Option<()> {
        let point_count = self.n_points;
        let table_bytes = self.first_payload(kind::POINTS)?;
        if table_bytes.len() != 4 + 32 * point_count {
            return None;
        }
        let mut reader = ByteReader(table_bytes);
        if reader.u32()? as usize != point_count {
            return None;
        }
        let mut positions = vec![[0.0; 4]; point_count];
        for axis in 0..4 {
            for position in &mut positions {
                position[axis] = reader.f32()?;
            }
        }
        let no_oscillation = Oscillation { omega: 0.0, sigma: 0.0 };
        let mut oscillations = vec![no_oscillation; point_count + self.n_modes];
        for oscillation in &mut oscillations[..point_count] {
            oscillation.omega = reader.f64()?;
        }
        for oscillation in &mut oscillations[..point_count] {
            oscillation.sigma = reader.f64()?;
        }
        (self.point_positions, self.oscillations) = (positions, oscillations);
        Some(())
    }

    fn read_names(&mut self) -> Option<()> {
        let names_text = std::str::from_utf8(self.first_payload(kind::NAMES)?).ok()?;
        let point_names: Vec<String> = names_text.lines().map(str::to_owned).collect();
        (point_names.len() == self.n_points).then(|| self.point_names = point_names)
    }

    fn read_shapes(&mut self) -> Option<()> {
        for chunk in self.chunks.refs.iter().filter(|chunk| chunk.kind == kind::SHAPES) {
            let mut reader = ByteReader(self.chunks.payload(chunk));
            let (part, _) = (reader.u16()? as usize, reader.u16()?);
            let (first_mode, mode_count, point_count) =
                (reader.u32()? as usize, reader.u32()? as usize, reader.u32()? as usize);
            let part = self.parts.get_mut(part)?;
            let PartMotion::Modal {
                first_mode: part_first_mode,
                n_modes: part_modes,
                shapes: mode_shapes,
            } = &mut part.kind
            else {
                return None;
            };
            let mode_offset = first_mode.checked_sub(*part_first_mode)?;
            let payload_size = mode_count
                .checked_mul(point_count)?
                .checked_mul(2)?
                .checked_add(16 * mode_count)?;
            if point_count != part.n_points || mode_offset + mode_count > *part_modes || reader.0.len() != payload_size
            {
                return None;
            }
            for oscillation in &mut self.oscillations[self.n_points + first_mode..][..mode_count] {
                oscillation.omega = reader.f64()?;
            }
            for oscillation in &mut self.oscillations[self.n_points + first_mode..][..mode_count] {
                oscillation.sigma = reader.f64()?;
            }
            for row in mode_shapes.chunks_mut((*part_modes).max(1)) {
                for weight in &mut row[mode_offset..mode_offset + mode_count] {
                    *weight = half_value(reader.u16()?);
                }
            }
        }
        Some(())
    }

    /// Checks that every chunk that a player reads matches its kind.
    fn check_payloads(&self) -> Result<(), ReadError> {
        for chunk in self.chunks() {
            let payload = self.payload(chunk);
            let is_valid = match chunk.kind {
                kind::FLIGHTS | kind::STATE => self.read_flights(payload).is_some(),
                kind::FRAMES => payload.len() >= 16,
                kind::BROKEN => payload.len().is_multiple_of(8),
                kind::ERGONS => payload.len().is_multiple_of(20),
                kind::CONTACTS | kind::HANDS => payload.len().is_multiple_of(12),
                _ => true,
            };
            if !is_valid || !chunk.seconds.is_finite() {
                return Err(ReadError::Payload(chunk.kind, chunk.offset));
            }
        }
        Ok(())
    }

    fn read_flights(&self, payload: &[u8]) -> Option<Vec<(usize, f64, f64)>> {
        let mut reader = ByteReader(payload);
        let mut all_flights = Vec::with_capacity(payload.len() / 12);
        while !reader.0.is_empty() {
            let track_number = reader.u32()? as usize;
            if track_number >= self.oscillations.len() {
                return None;
            }
            all_flights.push((track_number, reader.f32()?, reader.f32()?));
        }
        Some(all_flights)
    }

    fn read_frames(&self, chunk: &ChunkRef) -> Option<PartFrames> {
        let n_points_of = |part: u16| self.parts.get(usize::from(part)).map(|part| part.n_points);
        PartFrames::read_payload(self.payload(chunk), n_points_of)
    }

    /// Displacements of all points [m] at rising instants [s]   (n_instants · n_points); NaN if unknown.
    ///
    /// # Errors
    /// [`ReadError`] if frames are damaged.
    pub fn displacements(&self, instants: &[f64]) -> Result<Vec<f64>, ReadError> {
        let point_count = self.n_points;
        let mut rows = vec![f64::NAN; instants.len() * point_count];
        self.evaluate_flights(instants, &mut rows);
        self.interpolate(instants, &mut rows)?;
        Ok(rows)
    }

    /// Points and modes that follow flights.
    fn evaluate_flights(&self, instants: &[f64], rows: &mut [f64]) {
        let point_count = self.n_points;
        let mut flights_now = vec![(0.0, 0.0, 0.0); self.oscillations.len()];
        let flight_chunks = self.chunks().iter();
        let mut flight_chunks = flight_chunks
            .filter(|flight_chunk| matches!(flight_chunk.kind, kind::FLIGHTS | kind::STATE))
            .peekable();
        for (&instant, row) in instants.iter().zip(rows.chunks_mut(point_count.max(1))) {
            while let Some(flight_chunk) = flight_chunks.next_if(|flight_chunk| flight_chunk.seconds <= instant) {
                if flight_chunk.kind == kind::STATE {
                    flights_now.fill((0.0, 0.0, 0.0));
                }
                for (oscillation, cosine_part, sine_part) in
                    self.read_flights(self.payload(flight_chunk)).unwrap_or_default()
                {
                    flights_now[oscillation] = (cosine_part, sine_part, flight_chunk.seconds);
                }
            }
            let displacement_of = |oscillation: usize| {
                let (cosine_part, sine_part, flight_start) = flights_now[oscillation];
                self.oscillations[oscillation]
                    .coefficients_after((cosine_part, sine_part), instant - flight_start)
                    .0
            };
            for part in &self.parts {
                let part_displacements = &mut row[part.first_point..part.first_point + part.n_points];
                match &part.kind {
                    PartMotion::Free => {
                        part_displacements
                            .iter_mut()
                            .zip(part.first_point..)
                            .for_each(|(x, point)| *x = displacement_of(point));
                    }
                    PartMotion::Modal {
                        first_mode,
                        n_modes,
                        shapes,
                    } => {
                        let mode_displacements: Vec<f64> = (0..*n_modes)
                            .map(|mode| displacement_of(point_count + first_mode + mode))
                            .collect();
                        for (x, shape) in part_displacements.iter_mut().zip(shapes.chunks((*n_modes).max(1))) {
                            *x = shape
                                .iter()
                                .zip(&mode_displacements)
                                .map(|(share, mode_displacement)| share * mode_displacement)
                                .sum();
                        }
                    }
                    PartMotion::Sampled | PartMotion::NotComputed => {}
                }
            }
        }
    }

    /// Sampled points, between frames as in [`interpolate_cubic`].
    fn interpolate(&self, instants: &[f64], rows: &mut [f64]) -> Result<(), ReadError> {
        let point_count = self.n_points;
        for (part_index, part) in self.parts.iter().enumerate() {
            if !matches!(part.kind, PartMotion::Sampled) {
                continue;
            }
            let is_of_part = |chunk: &&ChunkRef| {
                let chunk_part = ByteReader(self.payload(chunk)).u16();
                chunk.kind == kind::FRAMES && chunk_part == Some(part_index as u16)
            };
            let (mut frames, mut frame_index): (Vec<(f64, Vec<f64>)>, usize) = (Vec::new(), 0);
            let mut frame_chunks = self.chunks().iter().filter(is_of_part);
            for (&instant, row) in instants.iter().zip(rows.chunks_mut(point_count.max(1))) {
                while frames.iter().nth_back(1).is_none_or(|last| last.0 <= instant) {
                    let Some(chunk) = frame_chunks.next() else {
                        break;
                    };
                    let error = ReadError::Payload(chunk.kind, chunk.offset);
                    let chunk_frames = self.read_frames(chunk).ok_or(error)?;
                    // Of the past frames, only the last two are needed.
                    let past_frames = frames.partition_point(|frame| frame.0 <= instant);
                    frames.drain(..past_frames.saturating_sub(2));
                    frame_index = 0;
                    for (i, x) in chunk_frames.rows.chunks(part.n_points.max(1)).enumerate() {
                        frames.push((chunk.seconds + i as f64 * chunk_frames.frame_interval, x.to_vec()));
                    }
                }
                while frame_index + 1 < frames.len() && frames[frame_index + 1].0 <= instant {
                    frame_index += 1;
                }
                let part_displacements = &mut row[part.first_point..part.first_point + part.n_points];
                let Some((frame_time, x)) = frames.get(frame_index).filter(|frame| frame.0 <= instant) else {
                    continue;
                };
                let neighbour = |index: Option<usize>, point: usize| {
                    let x = frames.get(index?)?.1[point];
                    x.is_finite().then_some(x)
                };
                let Some((next_time, next_x)) = frames.get(frame_index + 1) else {
                    part_displacements.copy_from_slice(x);
                    continue;
                };
                let time_share = (instant - frame_time) / (next_time - frame_time);
                for (point, (displacement, ends)) in part_displacements.iter_mut().zip(x.iter().zip(next_x)).enumerate()
                {
                    let x_before = neighbour(frame_index.checked_sub(1), point);
                    let x_after = neighbour(Some(frame_index + 2), point);
                    *displacement = interpolate_cubic(time_share, (*ends.0, *ends.1), x_before, x_after);
                }
            }
        }
        Ok(())
    }
}
