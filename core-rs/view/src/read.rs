//! Reads the complete part of a motion file, and computes positions at any instant.

use ergon_engine::simulation::Oscillation;
use serde_json::Value;
use thiserror::Error;

use crate::frames::{Frames, between};
use crate::motion::{self, ChunkError, MAGIC};
use crate::payload::{Reading, VERSION, from_half, kind};

/// Why a file cannot be read.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ReadError {
    /// The file does not begin with the magic bytes.
    #[error("this is not a motion file: it does not begin with ERGM")]
    Magic,
    /// The file has the format of another version.
    #[error("this motion file has format {0}, and this ergon reads format {number}: render the score again with --motion", number = MAGIC[4])]
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
}

/// One chunk, and where it is in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChunkRef {
    /// Its kind.
    pub kind: u16,
    /// Its instant [s].
    pub seconds: f64,
    /// First byte of its payload.
    pub position: usize,
    /// Length of its payload [bytes].
    pub len: usize,
}

/// The contents of a file, up to its last complete chunk.
#[derive(Clone, Debug)]
pub struct MotionFile {
    bytes: Vec<u8>,
    /// All complete chunks.
    pub chunks: Vec<ChunkRef>,
    /// The manifest, as JSON.
    pub manifest: String,
    /// Whether the last chunk is the index: the recording was finished.
    pub is_whole: bool,
    /// Number of points.
    pub n_points: usize,
    /// Number of modes.
    pub n_modes: usize,
    /// x, y, z, rest of each point [m]   (n_points)
    pub places: Vec<[f64; 4]>,
    /// Names of points.
    pub names: Vec<String>,
    parts: Vec<Part>,
    /// (n_points + n_modes)
    oscillations: Vec<Oscillation>,
}

#[derive(Clone, Debug)]
struct Part {
    first: usize,
    count: usize,
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Free,
    Sampled,
    /// Index of the first mode, number of modes, and the displacement of each point per unit of each mode   (n,
    /// n_modes)
    Modal(usize, usize, Vec<f64>),
    None,
}

/// Largest number of points or modes: a larger one means damage.
const NUMBERS_MAX: usize = 1 << 24;

impl MotionFile {
    /// Read the complete chunks of a file.
    ///
    /// # Errors
    /// [`ReadError`] if its manifest or tables are incomplete, or a complete chunk does not match its kind.
    pub fn new(bytes: Vec<u8>) -> Result<Self, ReadError> {
        match bytes.get(..MAGIC.len()) {
            Some(head) if head == MAGIC => {}
            Some([b'E', b'R', b'G', b'M', format, 0, 0, 0]) => {
                return Err(ReadError::Format(*format));
            }
            _ => return Err(ReadError::Magic),
        }
        let (mut chunks, mut offset) = (Vec::new(), MAGIC.len());
        // As after a cut, nothing after a damaged chunk can be trusted.
        while let Ok((chunk, n)) = motion::read(&bytes[offset..]) {
            let known = (kind::MANIFEST..=kind::LAST).contains(&chunk.kind);
            if known && chunk.version != VERSION {
                return Err(ReadError::Version(chunk.kind, chunk.version));
            }
            chunks.push(ChunkRef {
                kind: chunk.kind,
                seconds: chunk.seconds,
                position: offset + n - 4 - chunk.payload.len(),
                len: chunk.payload.len(),
            });
            offset += n;
        }
        let is_ended = chunks.last().is_some_and(|last| last.kind == kind::INDEX);
        let mut file = Self {
            is_whole: is_ended && offset == bytes.len(),
            bytes,
            chunks,
            manifest: String::new(),
            n_points: 0,
            n_modes: 0,
            places: Vec::new(),
            names: Vec::new(),
            parts: Vec::new(),
            oscillations: Vec::new(),
        };
        file.manifest().ok_or(ReadError::Table("manifest"))?;
        file.points().ok_or(ReadError::Table("table of points"))?;
        file.names().ok_or(ReadError::Table("list of names"))?;
        file.shapes().ok_or(ReadError::Table("table of shapes"))?;
        file.check()?;
        Ok(file)
    }

    /// Whether the bytes after the last complete chunk are the beginning of a chunk: the file was cut, not damaged.
    pub fn is_cut(&self) -> bool {
        let end = self
            .chunks
            .last()
            .map_or(MAGIC.len(), |last| last.position + last.len + 4);
        end < self.bytes.len() && motion::read(&self.bytes[end..]) == Err(ChunkError::Cut)
    }

    /// The payload of a chunk.
    pub fn payload(&self, chunk: &ChunkRef) -> &[u8] {
        &self.bytes[chunk.position..chunk.position + chunk.len]
    }

    /// Duration [s]: up to the last frame or event.
    pub fn duration(&self) -> f64 {
        let end = |chunk: &ChunkRef| match chunk.kind {
            kind::FRAMES => {
                let mut head = Reading(&self.payload(chunk)[4..]);
                let count = head.u32().unwrap_or(1).max(1);
                chunk.seconds + f64::from(count - 1) * head.f64().unwrap_or(0.0)
            }
            _ => chunk.seconds,
        };
        self.chunks.iter().map(end).fold(0.0, f64::max)
    }

    fn first(&self, kind: u16) -> Option<&[u8]> {
        let chunk = self.chunks.iter().find(|chunk| chunk.kind == kind)?;
        Some(self.payload(chunk))
    }

    fn manifest(&mut self) -> Option<()> {
        let text = std::str::from_utf8(self.first(kind::MANIFEST)?)
            .ok()?
            .to_owned();
        let manifest: Value = serde_json::from_str(&text).ok()?;
        let count = |value: &Value, name: &str| -> Option<usize> {
            usize::try_from(value.get(name)?.as_u64()?)
                .ok()
                .filter(|n| *n <= NUMBERS_MAX)
        };
        (self.n_points, self.n_modes) = (count(&manifest, "points")?, count(&manifest, "modes")?);
        let mut until = 0;
        for part in manifest.get("parts")?.as_array()? {
            let (first, count_here) = (count(part, "first")?, count(part, "count")?);
            if first != until {
                return None;
            }
            until += count_here;
            let kind = match part.get("kind")?.as_str()? {
                "free" => Kind::Free,
                "sampled" => Kind::Sampled,
                "modal" => {
                    let modes = part.get("modes")?;
                    let (first, m) = (count(modes, "first")?, count(modes, "count")?);
                    if first + m > self.n_modes || m * count_here > 8 * NUMBERS_MAX {
                        return None;
                    }
                    Kind::Modal(first, m, vec![0.0; m * count_here])
                }
                "none" => Kind::None,
                _ => return None,
            };
            self.parts.push(Part {
                first,
                count: count_here,
                kind,
            });
        }
        self.manifest = text;
        (until == self.n_points).then_some(())
    }

    fn points(&mut self) -> Option<()> {
        let n = self.n_points;
        let table = self.first(kind::POINTS)?;
        if table.len() != 4 + 32 * n {
            return None;
        }
        let mut from = Reading(table);
        if from.u32()? as usize != n {
            return None;
        }
        let mut places = vec![[0.0; 4]; n];
        for axis in 0..4 {
            for place in &mut places {
                place[axis] = from.f32()?;
            }
        }
        let still = Oscillation {
            omega: 0.0,
            sigma: 0.0,
        };
        let mut oscillations = vec![still; n + self.n_modes];
        for own in &mut oscillations[..n] {
            own.omega = from.f64()?;
        }
        for own in &mut oscillations[..n] {
            own.sigma = from.f64()?;
        }
        (self.places, self.oscillations) = (places, oscillations);
        Some(())
    }

    fn names(&mut self) -> Option<()> {
        let text = std::str::from_utf8(self.first(kind::NAMES)?).ok()?;
        let names: Vec<String> = text.lines().map(str::to_owned).collect();
        (names.len() == self.n_points).then(|| self.names = names)
    }

    fn shapes(&mut self) -> Option<()> {
        let places = self.chunks.to_vec();
        for chunk in places.iter().filter(|chunk| chunk.kind == kind::SHAPES) {
            let mut from = Reading(&self.bytes[chunk.position..chunk.position + chunk.len]);
            let (part, _) = (from.u16()? as usize, from.u16()?);
            let (first, m, n) = (
                from.u32()? as usize,
                from.u32()? as usize,
                from.u32()? as usize,
            );
            let part = self.parts.get_mut(part)?;
            let Kind::Modal(first_point, all, shapes) = &mut part.kind else {
                return None;
            };
            let offset = first.checked_sub(*first_point)?;
            let size = m.checked_mul(n)?.checked_mul(2)?.checked_add(16 * m)?;
            if n != part.count || offset + m > *all || from.0.len() != size {
                return None;
            }
            for first_point in &mut self.oscillations[self.n_points + first..][..m] {
                first_point.omega = from.f64()?;
            }
            for first_point in &mut self.oscillations[self.n_points + first..][..m] {
                first_point.sigma = from.f64()?;
            }
            for row in shapes.chunks_mut((*all).max(1)) {
                for share in &mut row[offset..offset + m] {
                    *share = from_half(from.u16()?);
                }
            }
        }
        Some(())
    }

    /// Checks that every chunk that a player reads matches its kind.
    fn check(&self) -> Result<(), ReadError> {
        for chunk in &self.chunks {
            let payload = self.payload(chunk);
            let is_right = match chunk.kind {
                kind::FLIGHTS | kind::STATE => self.flights(payload).is_some(),
                kind::FRAMES => payload.len() >= 16,
                kind::BROKEN => payload.len().is_multiple_of(8),
                kind::ERGONS => payload.len().is_multiple_of(20),
                kind::CONTACTS | kind::HANDS => payload.len().is_multiple_of(12),
                _ => true,
            };
            if !is_right || !chunk.seconds.is_finite() {
                return Err(ReadError::Payload(chunk.kind, chunk.position));
            }
        }
        Ok(())
    }

    fn flights(&self, payload: &[u8]) -> Option<Vec<(usize, f64, f64)>> {
        let mut from = Reading(payload);
        let mut all = Vec::with_capacity(payload.len() / 12);
        while !from.0.is_empty() {
            let number = from.u32()? as usize;
            if number >= self.oscillations.len() {
                return None;
            }
            all.push((number, from.f32()?, from.f32()?));
        }
        Some(all)
    }

    fn frames(&self, chunk: &ChunkRef) -> Option<Frames> {
        let points = |part: u16| self.parts.get(usize::from(part)).map(|part| part.count);
        Frames::read(self.payload(chunk), points)
    }

    /// Displacements of all points [m] at rising instants [s]   (n_instants · n_points); NaN if unknown.
    ///
    /// # Errors
    /// [`ReadError`] if frames are damaged.
    pub fn displacements(&self, instants: &[f64]) -> Result<Vec<f64>, ReadError> {
        let n = self.n_points;
        let mut out = vec![f64::NAN; instants.len() * n];
        self.evaluate_flights(instants, &mut out);
        self.interpolate(instants, &mut out)?;
        Ok(out)
    }

    /// Points and modes that follow flights.
    fn evaluate_flights(&self, instants: &[f64], out: &mut [f64]) {
        let n = self.n_points;
        let mut now = vec![(0.0, 0.0, 0.0); self.oscillations.len()];
        let flight_chunks = self.chunks.iter();
        let mut flight_chunks = flight_chunks
            .filter(|chunk| matches!(chunk.kind, kind::FLIGHTS | kind::STATE))
            .peekable();
        for (&instant, row) in instants.iter().zip(out.chunks_mut(n.max(1))) {
            while let Some(chunk) = flight_chunks.next_if(|chunk| chunk.seconds <= instant) {
                if chunk.kind == kind::STATE {
                    now.fill((0.0, 0.0, 0.0));
                }
                for (number, a, b) in self.flights(self.payload(chunk)).unwrap_or_default() {
                    now[number] = (a, b, chunk.seconds);
                }
            }
            let position_of = |number: usize| {
                let (a, b, since) = now[number];
                self.oscillations[number].later((a, b), instant - since).0
            };
            for part in &self.parts {
                let values = &mut row[part.first..part.first + part.count];
                match &part.kind {
                    Kind::Free => {
                        values
                            .iter_mut()
                            .zip(part.first..)
                            .for_each(|(x, number)| *x = position_of(number));
                    }
                    Kind::Modal(first, m, shapes) => {
                        let modes: Vec<f64> =
                            (0..*m).map(|mode| position_of(n + first + mode)).collect();
                        for (x, shape) in values.iter_mut().zip(shapes.chunks((*m).max(1))) {
                            *x = shape.iter().zip(&modes).map(|(share, q)| share * q).sum();
                        }
                    }
                    Kind::Sampled | Kind::None => {}
                }
            }
        }
    }

    /// Sampled points, between frames as in [`between`].
    fn interpolate(&self, instants: &[f64], out: &mut [f64]) -> Result<(), ReadError> {
        let n = self.n_points;
        for (number, part) in self.parts.iter().enumerate() {
            if !matches!(part.kind, Kind::Sampled) {
                continue;
            }
            let is_own = |chunk: &&ChunkRef| {
                let number_read = Reading(self.payload(chunk)).u16();
                chunk.kind == kind::FRAMES && number_read == Some(number as u16)
            };
            let (mut known, mut index): (Vec<(f64, Vec<f64>)>, usize) = (Vec::new(), 0);
            let mut blocks = self.chunks.iter().filter(is_own);
            for (&instant, row) in instants.iter().zip(out.chunks_mut(n.max(1))) {
                while known
                    .iter()
                    .nth_back(1)
                    .is_none_or(|last| last.0 <= instant)
                {
                    let Some(chunk) = blocks.next() else { break };
                    let damaged = ReadError::Payload(chunk.kind, chunk.position);
                    let frames = self.frames(chunk).ok_or(damaged)?;
                    // Of the past frames, only the last two are needed.
                    let past = known.partition_point(|frame| frame.0 <= instant);
                    known.drain(..past.saturating_sub(2));
                    index = 0;
                    for (i, x) in frames.rows.chunks(part.count.max(1)).enumerate() {
                        known.push((chunk.seconds + i as f64 * frames.hop, x.to_vec()));
                    }
                }
                while index + 1 < known.len() && known[index + 1].0 <= instant {
                    index += 1;
                }
                let number_read = &mut row[part.first..part.first + part.count];
                let Some((since, x)) = known.get(index).filter(|frame| frame.0 <= instant) else {
                    continue;
                };
                let neighbour = |number: Option<usize>, point: usize| {
                    let x = known.get(number?)?.1[point];
                    x.is_finite().then_some(x)
                };
                let Some((until, y)) = known.get(index + 1) else {
                    number_read.copy_from_slice(x);
                    continue;
                };
                let share = (instant - since) / (until - since);
                for (point, (number_read, ends)) in
                    number_read.iter_mut().zip(x.iter().zip(y)).enumerate()
                {
                    let before = neighbour(index.checked_sub(1), point);
                    let after = neighbour(Some(index + 2), point);
                    *number_read = between(share, (*ends.0, *ends.1), before, after);
                }
            }
        }
        Ok(())
    }
}
