//! Frozen parts: outputs that were computed before; they are read from files and join those that are simulated.
//!
//! An ordinary thread reads ahead into a ring; the physics thread takes the frames that it needs and never waits.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use rtrb::chunks::ChunkError;
use rtrb::{Consumer, Producer, RingBuffer};

use crate::regular;

/// Number of frames read at once.
const BLOCK_FRAMES: u64 = 4_096;
/// Number of frames read ahead, 1.5 s at 44.1 kHz. The ring is in locked memory, so `RING_SAMPLES_MAX` limits it too.
const FRAMES_AHEAD: usize = 1 << 16;
const RING_SAMPLES_MAX: usize = (64 << 20) / size_of::<f64>();
/// Time between two checks of the reader for room.
const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// A file of outputs that were computed before, beginning with the first frame of the piece.
#[derive(Clone, Debug)]
pub struct Stem {
    /// The file, with frames of little-endian doubles.
    pub path: PathBuf,
    /// Offset of the first frame [bytes].
    pub offset: u64,
    /// Number of frames.
    pub n_frames: u64,
    /// The outputs of the simulation that the file replaces.
    pub outputs: Vec<usize>,
}

/// The consumer side of the ring, for the physics thread.
pub(super) struct FrozenOutputs {
    ring: Consumer<f64>,
    outputs: Vec<usize>,
    /// Number of the next frame in the ring.
    next_frame: u64,
}

/// The reading thread, which ends when this is dropped.
pub(super) struct FrozenReader {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Open stems at a frame of the piece and read ahead. An error comes with the file that cannot be read.
pub(super) fn open(stems: Vec<Stem>, start: u64) -> Result<(FrozenOutputs, FrozenReader), (PathBuf, io::Error)> {
    let outputs: Vec<usize> = stems.iter().flat_map(|stem| stem.outputs.clone()).collect();
    let width = outputs.len().max(1);
    let ring_frames = (RING_SAMPLES_MAX / width).clamp(2 * BLOCK_FRAMES as usize, FRAMES_AHEAD);
    let (to_ring, ring) = RingBuffer::new(ring_frames * width);
    let n_frames = stems.iter().map(|stem| stem.n_frames).min().unwrap_or(0);
    let mut stem_files = StemFiles {
        files: Vec::new(),
        frames_left: n_frames.saturating_sub(start),
        bytes: Vec::new(),
        frames: Vec::new(),
        width,
        ring_producer: to_ring,
    };
    for stem in stems {
        let width = stem.outputs.len();
        let byte_offset = stem.offset + start * (width * size_of::<f64>()) as u64;
        let stem_file = regular::open(&stem.path).and_then(|mut stem_file| {
            stem_file.seek(SeekFrom::Start(byte_offset))?;
            Ok(stem_file)
        });
        let stem_file = stem_file.map_err(|error| (stem.path.clone(), error))?;
        stem_files.files.push((stem.path, BufReader::new(stem_file), width));
    }
    stem_files.push_block()?;
    let stop = Arc::new(AtomicBool::new(false));
    let stop_flag = stop.clone();
    let thread = std::thread::Builder::new()
        .name("ergon frozen".into())
        .spawn(move || {
            // Frames that cannot be read are silent when they are due, and counted as missed.
            while !stop_flag.load(Ordering::Acquire) && matches!(stem_files.push_block(), Ok(true)) {
                std::thread::sleep(POLL_INTERVAL);
            }
        })
        .map_err(|error| (PathBuf::new(), error))?;
    let thread = Some(thread);
    let next = start;
    Ok((
        FrozenOutputs {
            ring,
            outputs,
            next_frame: next,
        },
        FrozenReader { stop, thread },
    ))
}

/// The files, and the producer side of the ring.
struct StemFiles {
    /// (path, file, number of outputs in a frame).
    files: Vec<(PathBuf, BufReader<File>, usize)>,
    /// Number of frames still to be read.
    frames_left: u64,
    bytes: Vec<u8>,
    /// A block of all files   (n_frames · width)
    frames: Vec<f64>,
    width: usize,
    ring_producer: Producer<f64>,
}

impl StemFiles {
    /// Read while there is room; false at the end.
    fn push_block(&mut self) -> Result<bool, (PathBuf, io::Error)> {
        while self.frames_left > 0 {
            let block_frames = self.frames_left.min(BLOCK_FRAMES) as usize;
            if self.ring_producer.slots() < block_frames * self.width {
                return Ok(true);
            }
            self.frames.resize(block_frames * self.width, 0.0);
            let mut first_output = 0;
            for (path, file, width) in &mut self.files {
                self.bytes.resize(block_frames * *width * size_of::<f64>(), 0);
                if let Err(error) = file.read_exact(&mut self.bytes) {
                    return Err((path.clone(), error));
                }
                let (samples, _) = self.bytes.as_chunks();
                let sample_rows = samples.chunks_exact((*width).max(1));
                for (frame, row) in self.frames.chunks_exact_mut(self.width).zip(sample_rows) {
                    for (out, &sample) in frame[first_output..].iter_mut().zip(row) {
                        *out = f64::from_le_bytes(sample);
                    }
                }
                first_output += *width;
            }
            match self.ring_producer.write_chunk_uninit(self.frames.len()) {
                Ok(chunk) => chunk.fill_from_iter(self.frames.iter().copied()),
                Err(ChunkError::TooFewSlots(_)) => return Ok(true), // never: room was checked
            };
            self.frames_left -= block_frames as u64;
        }
        Ok(false)
    }
}

impl Drop for FrozenReader {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

impl FrozenOutputs {
    /// Whether `n` frames from frame `frame` on are in the ring, or the reader has ended.
    pub(super) fn is_ready(&self, frame: u64, n: usize) -> bool {
        let frames_behind = frame.saturating_sub(self.next_frame) as usize;
        self.ring.slots() >= (frames_behind + n) * self.outputs.len() || self.ring.is_abandoned()
    }

    /// Write the frozen outputs from frame `first_frame` on into `frames` (n_frames, n_out). Frames that were not read
    /// in time are left unchanged; return their number.
    pub(super) fn join(&mut self, frames: &mut [f64], n_out: usize, first_frame: u64) -> u64 {
        let frame_width = self.outputs.len();
        let frames_wanted = frames.len() / n_out.max(1);
        let frames_ready = self.ring.slots() / frame_width.max(1);
        let stale_frames = (first_frame.saturating_sub(self.next_frame)).min(frames_ready as u64) as usize;
        if let Ok(ring_chunk) = self.ring.read_chunk(stale_frames * frame_width) {
            ring_chunk.commit_all();
            self.next_frame += stale_frames as u64;
        }
        let frames_read = if self.next_frame == first_frame {
            frames_wanted.min(frames_ready - stale_frames)
        } else {
            0
        };
        if let Ok(ring_chunk) = self.ring.read_chunk(frames_read * frame_width) {
            let mut samples = ring_chunk.into_iter();
            for frame in frames.chunks_exact_mut(n_out).take(frames_read) {
                for (&output, sample) in self.outputs.iter().zip(&mut samples) {
                    frame[output] = sample;
                }
            }
            self.next_frame += frames_read as u64;
        }
        (frames_wanted - frames_read) as u64
    }
}

#[cfg(test)]
mod tests;
