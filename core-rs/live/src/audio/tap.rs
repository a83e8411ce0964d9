//! Recording of sound to a WAVE file during a performance, whatever the backend is.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use rtrb::{Consumer, Producer, RingBuffer};

use super::AudioError;
use super::file::WaveFileWriter;

/// Capacity of the ring [s]: if the disk stalls for longer, frames are lost.
const RING_SECONDS: usize = 8;
const POLL_INTERVAL: Duration = Duration::from_millis(5);

/// State shared by both ends of a tap.
#[derive(Debug)]
struct TapState {
    /// Whether `first_frame`, the first frame of the file, is known.
    has_begun: AtomicBool,
    first_frame: AtomicU64,
    /// Frames that found no room; the file has silence in their place.
    missing_frames: AtomicU64,
    /// Frames in the file.
    written_frames: AtomicU64,
    has_ended: AtomicBool,
    /// No more frames will be pushed.
    is_closing: AtomicBool,
    error: Mutex<Option<String>>,
}

impl TapState {
    fn is_over(&self, consumer: &Consumer<f32>) -> bool {
        consumer.is_abandoned() || self.is_closing.load(Ordering::Acquire)
    }
}

/// The end of a tap on the physics thread; it neither allocates nor waits. Dropping it ends the file.
#[derive(Debug)]
pub(crate) struct AudioTap {
    producer: Producer<f32>,
    tap_state: Arc<TapState>,
    channels: usize,
    /// Samples of silence still to be written in place of frames that found no room.
    silence_samples: usize,
}

/// The end of a tap for other threads.
#[derive(Debug)]
pub struct TapHandle {
    tap_state: Arc<TapState>,
    thread: Option<JoinHandle<()>>,
}

/// State of a tap.
#[derive(Clone, Debug, PartialEq)]
pub struct TapStatus {
    /// The first frame of the file; `None`: not begun.
    pub first_frame: Option<u64>,
    /// Frames in the file so far.
    pub frames: u64,
    /// Silent frames among them, because the disk was too slow.
    pub missing_frames: u64,
    /// Whether the file is closed.
    pub has_ended: bool,
    /// Why it could not be written.
    pub error: Option<String>,
}

/// Open a tap into a new file.
///
/// # Errors
/// [`AudioError::File`] if the file exists or cannot be created.
pub(crate) fn open(path: &Path, rate: u32, channels: usize) -> Result<(AudioTap, TapHandle), AudioError> {
    let mut recording = WaveFileWriter::create(path, rate, channels)?;
    let (producer, mut consumer) = RingBuffer::new(RING_SECONDS * rate as usize * channels);
    let tap_state = Arc::new(TapState {
        has_begun: AtomicBool::new(false),
        first_frame: AtomicU64::new(0),
        missing_frames: AtomicU64::new(0),
        written_frames: AtomicU64::new(0),
        has_ended: AtomicBool::new(false),
        is_closing: AtomicBool::new(false),
        error: Mutex::new(None),
    });
    let tap = AudioTap {
        producer,
        tap_state: tap_state.clone(),
        channels,
        silence_samples: 0,
    };
    let shared_state = tap_state.clone();
    let thread = std::thread::Builder::new()
        .name("ergon recording of sound".into())
        .spawn(move || {
            let pump_result = write_until_over(&mut recording, &mut consumer, channels, &shared_state);
            if let Err(error) = pump_result.and_then(|()| recording.finish()) {
                *shared_state.error.lock().unwrap_or_else(PoisonError::into_inner) =
                    Some(recording.failure_sentence(&error));
                // Keep the ring alive until the tap is dropped: the physics thread must not free memory.
                while !shared_state.is_over(&consumer) {
                    std::thread::sleep(POLL_INTERVAL);
                }
            }
            shared_state.has_ended.store(true, Ordering::Release);
        })
        .map_err(|error| AudioError::Broken(error.to_string()))?;
    let handle = TapHandle {
        tap_state,
        thread: Some(thread),
    };
    Ok((tap, handle))
}

fn write_until_over(
    recording: &mut WaveFileWriter,
    consumer: &mut Consumer<f32>,
    channels: usize,
    tap_state: &TapState,
) -> std::io::Result<()> {
    loop {
        // The end is read first, so that everything pushed before it is written.
        let is_last = tap_state.is_over(consumer);
        let sample_count = consumer.slots() / channels * channels;
        if sample_count == 0 {
            if is_last {
                return Ok(());
            }
            std::thread::sleep(POLL_INTERVAL);
            continue;
        }
        let Ok(ring_chunk) = consumer.read_chunk(sample_count) else {
            continue;
        };
        let (first_slice, second_slice) = ring_chunk.as_slices();
        recording.write(first_slice, first_slice.len() / channels)?;
        recording.write(second_slice, second_slice.len() / channels)?;
        ring_chunk.commit_all();
        tap_state
            .written_frames
            .fetch_add((sample_count / channels) as u64, Ordering::Relaxed);
    }
}

impl AudioTap {
    /// Write frames, the first of which is frame `frame` of the performance; zeros if `is_silent`.
    pub(crate) fn push(&mut self, frame: u64, samples: &[f32], is_silent: bool) {
        if samples.is_empty() {
            return;
        }
        if !self.tap_state.has_begun.load(Ordering::Relaxed) {
            self.tap_state.first_frame.store(frame, Ordering::Relaxed);
            self.tap_state.has_begun.store(true, Ordering::Release);
        }
        let sample_count = self.silence_samples + samples.len();
        let Ok(ring_chunk) = self.producer.write_chunk_uninit(sample_count) else {
            self.silence_samples = sample_count;
            let missing_frames = (samples.len() / self.channels) as u64;
            self.tap_state
                .missing_frames
                .fetch_add(missing_frames, Ordering::Relaxed);
            return;
        };
        let silence = std::iter::repeat_n(0.0, self.silence_samples);
        let sound_gain = if is_silent { 0.0 } else { 1.0 };
        ring_chunk.fill_from_iter(silence.chain(samples.iter().map(|x| x * sound_gain)));
        self.silence_samples = 0;
    }
}

impl TapHandle {
    /// The state now.
    pub fn status(&self) -> TapStatus {
        let tap_state = &self.tap_state;
        let has_begun = tap_state.has_begun.load(Ordering::Acquire);
        TapStatus {
            first_frame: has_begun.then(|| tap_state.first_frame.load(Ordering::Relaxed)),
            has_ended: tap_state.has_ended.load(Ordering::Acquire),
            frames: tap_state.written_frames.load(Ordering::Relaxed),
            missing_frames: tap_state.missing_frames.load(Ordering::Relaxed),
            error: tap_state.error.lock().unwrap_or_else(PoisonError::into_inner).clone(),
        }
    }
}

impl Drop for TapHandle {
    /// Waits until the file is closed. The physics thread has ended before, so everything it pushed is written.
    fn drop(&mut self) {
        self.tap_state.is_closing.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ended(handle: &TapHandle) -> TapStatus {
        while !handle.status().has_ended {
            std::thread::sleep(POLL_INTERVAL);
        }
        handle.status()
    }

    #[test]
    fn tap_writes_pushed_frames_to_its_file() {
        let folder = std::env::temp_dir().join(format!("ergon-tap-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let wave_path = folder.join("a.wav");
        let (mut tap, handle) = open(&wave_path, 44_100, 2).expect("a tap");
        assert_eq!(handle.status().first_frame, None);
        for block in 0..100_u64 {
            let samples: Vec<f32> = (0..128).map(|i| (block * 128 + i) as f32).collect();
            tap.push(640 + block * 64, &samples, block == 99);
        }
        drop(tap);
        let tap_status = ended(&handle);
        assert_eq!(
            (tap_status.first_frame, tap_status.frames, tap_status.missing_frames),
            (Some(640), 6400, 0)
        );
        let file_bytes = std::fs::read(&wave_path).expect("a file");
        let sample_bytes = &file_bytes[file_bytes.len() - 6400 * 8..];
        let samples: Vec<f32> = sample_bytes
            .chunks_exact(4)
            .map(|x| f32::from_le_bytes(x.try_into().expect("four bytes")))
            .collect();
        assert!(samples[..99 * 128].iter().enumerate().all(|(i, &x)| x == i as f32));
        assert!(samples[99 * 128..].iter().all(|&x| x == 0.0));
        assert!(open(&wave_path, 44_100, 2).is_err(), "it exists");
        std::fs::remove_dir_all(&folder).expect("removed");
    }

    #[test]
    fn tap_without_room_writes_silence() {
        let folder = std::env::temp_dir().join(format!("ergon-tap-full-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let wave_path = folder.join("a.wav");
        let (small_producer, mut small_consumer) = RingBuffer::new(4);
        let (mut tap, handle) = open(&wave_path, 1000, 1).expect("a tap");
        let real_producer = std::mem::replace(&mut tap.producer, small_producer);
        tap.push(0, &[1.0, 2.0, 3.0], false);
        tap.push(3, &[4.0, 5.0], false); // no room
        assert_eq!(handle.status().missing_frames, 2);
        let read_samples: Vec<f32> = small_consumer.read_chunk(3).expect("three").into_iter().collect();
        assert_eq!(read_samples, [1.0, 2.0, 3.0]);
        tap.push(5, &[6.0, 7.0], false);
        let read_samples: Vec<f32> = small_consumer.read_chunk(4).expect("four").into_iter().collect();
        assert_eq!(read_samples, [0.0, 0.0, 6.0, 7.0]);
        tap.producer = real_producer;
        drop(tap);
        ended(&handle);
        std::fs::remove_dir_all(&folder).expect("removed");
    }
}
