//! Reads the intact parts of a recording, and reports the damaged ones.

use std::io::{BufReader, Read, Write};
use std::ops::Range;
use std::path::Path;

use super::chunk::{self, ChunkState};
use super::row::{self, RecordedSample};
use super::{Header, MAGIC, MAX_EVENTS, MAX_SAMPLES, RecordingError, VERSION};
use crate::regular;

/// Payload of a chunk of rows that is written at once: small, so that damage to one chunk costs little.
const ROWS_PAYLOAD_BYTES: usize = 1 << 16;
const EVENT_HEADER_SIZE: usize = 8 + 4;

/// Rows and events in memory; columns are (n_ticks × n_axes), row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The header, which says how to interpret the rows.
    pub header: Header,
    /// Rising ticks; tick k begins with audio frame k·`header.frames`. (n_ticks,)
    pub ticks: Vec<u64>,
    /// Every axis at every tick. (n_ticks × n_axes)
    pub samples: Vec<RecordedSample>,
    /// Other events: tick, JSON line.
    pub events: Vec<(u64, String)>,
    /// Number of rows and events that were dropped while recording.
    pub dropped: u64,
    /// Number of bytes that are not in a valid chunk.
    pub lost_bytes: u64,
    /// Whether the recorder ended normally; otherwise it was killed or is still at work.
    pub is_finished: bool,
}

impl Recording {
    /// A recording of rows made elsewhere; checks that they are consistent.
    pub fn new(header: Header, ticks: Vec<u64>, samples: Vec<RecordedSample>) -> Result<Self, RecordingError> {
        header.check()?;
        if samples.len() != ticks.len() * header.axes.len() {
            let error_text = "there must be one position for each tick and axis";
            return Err(RecordingError::Rows(error_text));
        }
        if !ticks.is_sorted_by(|a, b| a < b) {
            return Err(RecordingError::Rows("ticks must rise"));
        }
        if samples.len() > MAX_SAMPLES {
            return Err(RecordingError::TooLong);
        }
        Ok(Self {
            is_finished: true,
            ..Self::empty(header)
        }
        .with_rows(ticks, samples))
    }

    fn empty(header: Header) -> Self {
        Self {
            header,
            ticks: Vec::new(),
            samples: Vec::new(),
            events: Vec::new(),
            dropped: 0,
            lost_bytes: 0,
            is_finished: false,
        }
    }

    fn with_rows(self, ticks: Vec<u64>, samples: Vec<RecordedSample>) -> Self {
        Self { ticks, samples, ..self }
    }

    /// Whether all bytes of the file could be read.
    pub fn is_complete(&self) -> bool {
        self.lost_bytes == 0
    }

    /// Time from the first tick to the end of the last one [s].
    pub fn duration(&self) -> f64 {
        let end_ticks = self.ticks.first().zip(self.ticks.last());
        end_ticks.map_or(0.0, |(first_tick, last_tick)| {
            ((last_tick - first_tick) as f64 + 1.0) / self.header.tick_rate()
        })
    }

    /// A sentence about the damage and what is left; `None` if the file is intact and finished.
    pub fn damage(&self) -> Option<String> {
        let intact_seconds = self.duration();
        if self.lost_bytes > 0 {
            let lost_bytes = self.lost_bytes;
            Some(format!(
                "{lost_bytes} bytes of this recording are damaged; what is left lasts {intact_seconds:.2} s"
            ))
        } else if !self.is_finished {
            Some(format!(
                "this recording was never finished, so its last half second may be missing; what is there lasts \
                 {intact_seconds:.2} s"
            ))
        } else {
            None
        }
    }

    /// Positions [m] at every tick from the first to the last, (n × n_axes), as the physics consumes them when the
    /// recording is played back. A missing tick holds the previous position, as for a late device.
    pub fn positions_filled(&self) -> Result<Vec<f64>, RecordingError> {
        let (Some(&first_tick), Some(&last_tick)) = (self.ticks.first(), self.ticks.last()) else {
            return Ok(Vec::new());
        };
        let n_axes = self.header.axes.len();
        if last_tick - first_tick >= (MAX_SAMPLES / n_axes) as u64 {
            return Err(RecordingError::TooLong);
        }
        let mut positions = Vec::with_capacity((last_tick - first_tick + 1) as usize * n_axes);
        for (tick, row) in self.ticks.iter().zip(self.samples.chunks_exact(n_axes)) {
            let missing_ticks = (tick - first_tick) as usize - positions.len() / n_axes;
            for _ in 0..missing_ticks {
                positions.extend_from_within(positions.len() - n_axes..);
            }
            positions.extend(row.iter().map(|sample| sample.position));
        }
        Ok(positions)
    }

    /// Write the recording as a whole, finished file.
    pub fn write(&self, writer: &mut impl Write) -> Result<(), RecordingError> {
        let mut file_bytes = encode_start(&self.header);
        let n_axes = self.header.axes.len();
        let row_size = row::row_bytes(n_axes);
        let rows_per_chunk = (ROWS_PAYLOAD_BYTES / row_size).max(1);
        let mut payload = Vec::new();
        let sample_chunks = self.samples.chunks(n_axes * rows_per_chunk);
        for (ticks, samples) in self.ticks.chunks(rows_per_chunk).zip(sample_chunks) {
            payload.resize(row_size * ticks.len(), 0);
            let tick_rows = ticks.iter().zip(samples.chunks_exact(n_axes));
            for (row_bytes, (&tick, samples)) in payload.chunks_exact_mut(row_size).zip(tick_rows) {
                row::encode(row_bytes, tick, samples);
            }
            chunk::append(&mut file_bytes, chunk::ROWS, &payload);
            writer.write_all(&file_bytes)?;
            file_bytes.clear();
        }
        payload.clear();
        for (tick, line) in &self.events {
            if payload.len() + EVENT_HEADER_SIZE + line.len() > chunk::PAYLOAD_MAX {
                chunk::append(&mut file_bytes, chunk::EVENTS, &payload);
                payload.clear();
            }
            payload.extend_from_slice(&tick.to_le_bytes());
            payload.extend_from_slice(&(line.len() as u32).to_le_bytes());
            payload.extend_from_slice(line.as_bytes());
        }
        if !payload.is_empty() {
            chunk::append(&mut file_bytes, chunk::EVENTS, &payload);
        }
        chunk::append(&mut file_bytes, chunk::END, &self.dropped.to_le_bytes());
        writer.write_all(&file_bytes)?;
        Ok(())
    }
}

/// The bytes before the first row.
pub(super) fn encode_start(header: &Header) -> Vec<u8> {
    let mut start_bytes = MAGIC.to_vec();
    start_bytes.extend_from_slice(&VERSION.to_le_bytes());
    chunk::append(&mut start_bytes, chunk::HEADER, &header.encode());
    start_bytes
}

/// Read the rows and events of `ticks`, counted from the first row, or all of them. Memory is bounded, whatever the
/// file contains.
pub fn read(path: &Path, ticks: Option<Range<u64>>) -> Result<Recording, RecordingError> {
    let recording_file = regular::open(path)?;
    let file_length = recording_file.metadata()?.len();
    decode(&mut BufReader::new(recording_file), file_length, ticks)
}

/// Decode the recording in `file_length` bytes.
pub(crate) fn decode(
    source: &mut impl Read,
    file_length: u64,
    ticks: Option<Range<u64>>,
) -> Result<Recording, RecordingError> {
    let mut file_prefix = [0; MAGIC.len() + 4];
    if file_length < file_prefix.len() as u64 {
        return Err(RecordingError::NotARecording);
    }
    source.read_exact(&mut file_prefix)?;
    let (magic_bytes, version) = file_prefix.split_at(MAGIC.len());
    if magic_bytes != MAGIC {
        return Err(RecordingError::NotARecording);
    }
    let version = u32::from_le_bytes([version[0], version[1], version[2], version[3]]);
    if version != VERSION {
        return Err(RecordingError::Version(version));
    }
    let mut chunk_offset = file_prefix.len() as u64;
    let mut payload = Vec::new();
    let header = match chunk::next_chunk(source, file_length - chunk_offset, &mut payload)? {
        ChunkState::Complete(chunk::HEADER) => Header::decode(&payload),
        _ => None,
    };
    let header = header.ok_or(RecordingError::NoHeader)?;
    let mut collector = RecordingCollector::new(header, ticks);
    chunk_offset += (chunk::CHUNK_OVERHEAD + payload.len()) as u64;
    while chunk_offset < file_length {
        let chunk_state = chunk::next_chunk(source, file_length - chunk_offset, &mut payload)?;
        let chunk_size = match chunk_state {
            ChunkState::Cut => file_length - chunk_offset,
            _ => (chunk::CHUNK_OVERHEAD + payload.len()) as u64,
        };
        let is_valid_chunk = match chunk_state {
            ChunkState::Complete(kind) => collector.add_chunk(kind, &payload)?,
            _ => false,
        };
        if !is_valid_chunk {
            collector.recording.lost_bytes += chunk_size;
        }
        chunk_offset += chunk_size;
        if chunk_state == ChunkState::Cut {
            break;
        }
    }
    Ok(collector.recording)
}

/// The parts that were read so far.
struct RecordingCollector {
    recording: Recording,
    wanted_ticks: Option<Range<u64>>,
    first_tick: Option<u64>,
    last_tick: Option<u64>,
    event_bytes: usize,
}

impl RecordingCollector {
    fn new(header: Header, ticks: Option<Range<u64>>) -> Self {
        Self {
            recording: Recording::empty(header),
            wanted_ticks: ticks,
            first_tick: None,
            last_tick: None,
            event_bytes: 0,
        }
    }

    /// Take a payload; false if it is invalid or does not follow what came before.
    fn add_chunk(&mut self, kind: u8, payload: &[u8]) -> Result<bool, RecordingError> {
        match kind {
            _ if self.recording.is_finished => Ok(false), // nothing follows the end
            chunk::HEADER => Ok(false),
            chunk::ROWS => self.add_rows(payload),
            chunk::EVENTS => self.add_events(payload),
            chunk::END => Ok(payload.first_chunk().is_some_and(|count_bytes| {
                self.recording.dropped = u64::from_le_bytes(*count_bytes);
                self.recording.is_finished = true;
                true
            })),
            _ => Ok(true), // a kind of a later version
        }
    }

    /// Whether a tick is in the wanted range; events before the first row count as part of its tick.
    fn is_wanted(&self, tick: u64) -> bool {
        let tick_offset = tick.saturating_sub(self.first_tick.unwrap_or(tick));
        self.wanted_ticks
            .as_ref()
            .is_none_or(|ticks| ticks.contains(&tick_offset))
    }

    fn add_rows(&mut self, payload: &[u8]) -> Result<bool, RecordingError> {
        let n_axes = self.recording.header.axes.len();
        let payload_rows = payload.chunks_exact(row::row_bytes(n_axes));
        if !payload_rows.remainder().is_empty() {
            return Ok(false);
        }
        let (mut first_tick, mut previous_tick) = (self.first_tick, self.last_tick);
        for row_tick in payload_rows.clone().map(row::decode_tick) {
            if previous_tick.is_some_and(|previous_tick| row_tick <= previous_tick) {
                return Ok(false);
            }
            first_tick = first_tick.or(Some(row_tick));
            previous_tick = Some(row_tick);
        }
        (self.first_tick, self.last_tick) = (first_tick, previous_tick);
        for row in payload_rows {
            let row_tick = row::decode_tick(row);
            if self.is_wanted(row_tick) {
                if self.recording.samples.len() + n_axes > MAX_SAMPLES {
                    return Err(RecordingError::TooLong);
                }
                self.recording.ticks.push(row_tick);
                self.recording.samples.extend(row::decode_samples(row));
            }
        }
        Ok(true)
    }

    fn add_events(&mut self, payload: &[u8]) -> Result<bool, RecordingError> {
        let Some(events) = decode_events(payload) else {
            return Ok(false);
        };
        for (tick, line) in events {
            if self.is_wanted(tick) {
                self.event_bytes += EVENT_HEADER_SIZE + line.len();
                if self.event_bytes > MAX_EVENTS {
                    return Err(RecordingError::TooLong);
                }
                self.recording.events.push((tick, line.to_owned()));
            }
        }
        Ok(true)
    }
}

/// The events of a payload; `None` if it holds anything else.
fn decode_events(mut bytes_left: &[u8]) -> Option<Vec<(u64, &str)>> {
    let mut events = Vec::new();
    while !bytes_left.is_empty() {
        let (tick_bytes, bytes_after) = bytes_left.split_first_chunk::<8>()?;
        let (length_bytes, bytes_after) = bytes_after.split_first_chunk::<4>()?;
        let (line_bytes, bytes_after) = bytes_after.split_at_checked(u32::from_le_bytes(*length_bytes) as usize)?;
        events.push((u64::from_le_bytes(*tick_bytes), std::str::from_utf8(line_bytes).ok()?));
        bytes_left = bytes_after;
    }
    Some(events)
}
