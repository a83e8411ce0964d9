//! Writes recordings: the real-time thread puts rows into a ring, an ordinary thread appends them to the file.

use std::fmt;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use rtrb::{Consumer, Producer, RingBuffer};

use super::reader::encode_start;
use super::row::{self, RecordedSample};
use super::{Header, RecordingError, chunk};

/// Time between two writes to the operating system, well below the half second that a killed process may lose.
const APPEND_INTERVAL: Duration = Duration::from_millis(200);
/// Time between two requests to the operating system to write to the disk.
const SYNC_INTERVAL: Duration = Duration::from_secs(1);
/// Time for which the ring holds rows while the disk does not answer [s].
const RING_SECONDS: f64 = 8.0;
const ROWS_MIN: f64 = 256.0;
/// Greatest size of the ring [bytes], because it is locked memory.
const RING_BYTES_MAX: usize = 64 << 20;
const EVENT_RING_BYTES: usize = 256 << 10;
/// Longest line of an event [bytes].
const LINE_BYTES_MAX: usize = 1024;
const EVENT_HEAD_BYTES: usize = 8 + 4;

/// Makes recordings.
pub struct Recorder;

impl Recorder {
    /// Begin a recording at `path`, which must not exist yet, and start the thread that writes it.
    ///
    /// The file has its final name from the start: what has been played must survive any end of the program. Call this
    /// from an ordinary thread, because the writing thread inherits its priority.
    pub fn start(path: &Path, header: &Header) -> Result<(RowSink, RecorderHandle), RecordingError> {
        header.check()?;
        let mut options = OpenOptions::new();
        let mut recording_file = options.append(true).create_new(true).open(path)?;
        let start_bytes = encode_start(header);
        if let Err(error) = recording_file
            .write_all(&start_bytes)
            .and_then(|()| recording_file.sync_all())
        {
            fs::remove_file(path).ok(); // so that no empty file is taken for a recording
            return Err(error.into());
        }
        sync_folder(path);

        let (row_sink, writer) = open_rings(header, recording_file, start_bytes.len() as u64);
        let writer_state = Arc::clone(&writer.writer_state);
        let thread = thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || writer.run())?;
        let thread = Some(thread);
        Ok((row_sink, RecorderHandle { writer_state, thread }))
    }
}

/// Both ends of the rings: the sink that fills them, and the writer that empties them into a file of `valid_len` bytes.
fn open_rings(header: &Header, file: File, valid_len: u64) -> (RowSink, RecordingWriter) {
    let n_axes = header.axes.len();
    let row_size = row::row_bytes(n_axes);
    let ring_rows = (header.tick_rate() * RING_SECONDS).ceil().max(ROWS_MIN) as usize;
    let (row_producer, row_consumer) = RingBuffer::new(row_size * ring_rows.min(RING_BYTES_MAX / row_size));
    let (event_producer, event_consumer) = RingBuffer::new(EVENT_RING_BYTES);
    let writer_state = Arc::new(WriterState::default());
    let writer = RecordingWriter {
        file,
        valid_len,
        rows: row_consumer,
        row_size,
        events: event_consumer,
        payload: Vec::with_capacity(chunk::PAYLOAD_MAX),
        pending_chunks: Vec::new(),
        pending_rows: 0,
        writer_state: Arc::clone(&writer_state),
    };
    let row_sink = RowSink {
        rows: row_producer,
        events: event_producer,
        row_bytes: vec![0; row_size],
        n_axes,
        last_tick: None,
        writer_state,
    };
    (row_sink, writer)
}

/// Write the folder's entry for the new file to the disk. If that fails, only a power cut within seconds loses the
/// file.
fn sync_folder(path: &Path) {
    let parent_folder = path
        .parent()
        .filter(|parent_folder| !parent_folder.as_os_str().is_empty());
    if let Ok(parent_folder) = File::open(parent_folder.unwrap_or_else(|| Path::new("."))) {
        parent_folder.sync_all().ok();
    }
}

#[derive(Default)]
struct WriterState {
    n_rows: AtomicU64,
    n_dropped: AtomicU64,
    is_stopping: AtomicBool,
    /// Shared by the writer and the handle; the sink never locks it.
    write_error: Mutex<Option<String>>,
}

impl WriterState {
    fn set_error(&self, error: Option<String>) {
        *self.write_error.lock().unwrap_or_else(PoisonError::into_inner) = error;
    }
}

/// The real-time thread's end of a recording: nothing here waits, allocates or fails; rows without room are counted.
///
/// Dropping it frees memory, so give it back to another thread for that.
pub struct RowSink {
    rows: Producer<u8>,
    events: Producer<u8>,
    row_bytes: Vec<u8>,
    n_axes: usize,
    last_tick: Option<u64>,
    writer_state: Arc<WriterState>,
}

impl RowSink {
    /// Record a tick, (n_axes,); false if there is no room, if the number of axes differs, or if the tick does not
    /// follow the last one.
    pub fn push_row(&mut self, tick: u64, samples: &[RecordedSample]) -> bool {
        let is_next = self.last_tick.is_none_or(|last| tick > last);
        if !is_next || samples.len() != self.n_axes {
            return self.count_dropped(false);
        }
        row::encode(&mut self.row_bytes, tick, samples);
        let has_room = self.rows.push_entire_slice(&self.row_bytes).is_ok();
        if has_room {
            self.last_tick = Some(tick);
        }
        self.count_dropped(has_room)
    }

    /// Record another event of a tick as a JSON line of at most 1 KiB, such as `format_args!(r#"{{"late":{n}}}"#)`.
    pub fn push_event(&mut self, tick: u64, line: fmt::Arguments<'_>) -> bool {
        let mut event_buffer = [0; EVENT_HEAD_BYTES + LINE_BYTES_MAX];
        let (event_head, line_buffer) = event_buffer.split_at_mut(EVENT_HEAD_BYTES);
        let mut space_left = &mut line_buffer[..];
        let line_fits = space_left.write_fmt(line).is_ok();
        let line_length = LINE_BYTES_MAX - space_left.len();
        event_head[..8].copy_from_slice(&tick.to_le_bytes());
        event_head[8..].copy_from_slice(&(line_length as u32).to_le_bytes());
        let event_bytes = &event_buffer[..EVENT_HEAD_BYTES + line_length];
        let is_stored = line_fits && self.events.push_entire_slice(event_bytes).is_ok();
        self.count_dropped(is_stored)
    }

    /// Whether there is room for a row now.
    pub fn has_room(&self) -> bool {
        self.rows.slots() >= self.row_bytes.len()
    }

    /// Rows and events that were dropped, mostly for lack of room.
    pub fn dropped_count(&self) -> u64 {
        self.writer_state.n_dropped.load(Ordering::Relaxed)
    }

    fn count_dropped(&self, is_stored: bool) -> bool {
        if !is_stored {
            self.writer_state.n_dropped.fetch_add(1, Ordering::Relaxed);
        }
        is_stored
    }
}

/// The status of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordingStatus {
    /// Rows that were given to the operating system.
    pub rows: u64,
    /// Rows and events that were dropped, mostly for lack of room.
    pub dropped: u64,
    /// Why nothing can be written at present; rows wait meanwhile, for some seconds.
    pub write_error: Option<String>,
}

/// The handle of a recording, for the thread that started it.
pub struct RecorderHandle {
    writer_state: Arc<WriterState>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl RecorderHandle {
    /// The present status.
    pub fn status(&self) -> RecordingStatus {
        let write_error = self.writer_state.write_error.lock();
        RecordingStatus {
            rows: self.writer_state.n_rows.load(Ordering::Relaxed),
            dropped: self.writer_state.n_dropped.load(Ordering::Relaxed),
            write_error: write_error.unwrap_or_else(PoisonError::into_inner).clone(),
        }
    }

    /// Write the rest of the rings and the end chunk, wait for the disk, and return the final status. Anything given to
    /// the sink afterwards is lost.
    pub fn stop(mut self) -> Result<RecordingStatus, RecordingError> {
        self.join()?;
        Ok(self.status())
    }

    fn join(&mut self) -> io::Result<()> {
        let Some(writer_thread) = self.thread.take() else {
            return Ok(());
        };
        self.writer_state.is_stopping.store(true, Ordering::Release);
        writer_thread.thread().unpark();
        let panic_error = |_| Err(io::Error::other("the thread that writes has panicked"));
        writer_thread.join().unwrap_or_else(panic_error)
    }
}

impl Drop for RecorderHandle {
    fn drop(&mut self) {
        self.join().ok();
    }
}

struct RecordingWriter {
    file: File,
    /// Length of the file up to its last whole chunk [bytes].
    valid_len: u64,
    rows: Consumer<u8>,
    row_size: usize,
    events: Consumer<u8>,
    payload: Vec<u8>,
    /// Chunks that are not in the file yet.
    pending_chunks: Vec<u8>,
    pending_rows: u64,
    writer_state: Arc<WriterState>,
}

impl RecordingWriter {
    fn run(mut self) -> io::Result<()> {
        let mut last_sync = Instant::now();
        loop {
            // Read before the rings are emptied, so that nothing follows the last append.
            let is_last = self.writer_state.is_stopping.load(Ordering::Acquire) || self.rows.is_abandoned();
            let mut write_result = self.append_all(is_last);
            if last_sync.elapsed() >= SYNC_INTERVAL || is_last {
                write_result = write_result.and_then(|()| self.file.sync_data());
                last_sync = Instant::now();
            }
            self.writer_state
                .set_error(write_result.as_ref().err().map(ToString::to_string));
            if is_last {
                return write_result;
            }
            thread::park_timeout(APPEND_INTERVAL);
        }
    }

    /// Append the contents of the rings, and the end chunk if it is the last time.
    fn append_all(&mut self, is_last: bool) -> io::Result<()> {
        self.append()?;
        while self.rows.slots() >= self.row_size || self.events.slots() > 0 {
            self.fill_pending_chunks();
            self.append()?;
        }
        if is_last {
            let dropped = self.writer_state.n_dropped.load(Ordering::Relaxed);
            chunk::append(&mut self.pending_chunks, chunk::END, &dropped.to_le_bytes());
            self.append()?;
        }
        Ok(())
    }

    /// Move the rows and the events of the rings into one chunk each.
    fn fill_pending_chunks(&mut self) {
        let payload_limit = chunk::PAYLOAD_MAX / self.row_size * self.row_size;
        let n_row_bytes = self.rows.slots() / self.row_size * self.row_size;
        if pop_bytes(&mut self.rows, n_row_bytes.min(payload_limit), &mut self.payload) {
            chunk::append(&mut self.pending_chunks, chunk::ROWS, &self.payload);
            self.pending_rows = (self.payload.len() / self.row_size) as u64;
        }
        // An event enters its ring at once, so the ring always holds whole events; all of them fit in a payload.
        let n_event_bytes = self.events.slots();
        if pop_bytes(&mut self.events, n_event_bytes, &mut self.payload) {
            chunk::append(&mut self.pending_chunks, chunk::EVENTS, &self.payload);
        }
    }

    /// Append the pending chunks to the file. If that fails (a full disk), the file keeps its whole chunks, and the
    /// next call tries again.
    fn append(&mut self) -> io::Result<()> {
        if self.pending_chunks.is_empty() {
            return Ok(());
        }
        if let Err(error) = self.file.write_all(&self.pending_chunks) {
            self.file.set_len(self.valid_len).ok();
            return Err(error);
        }
        self.valid_len += self.pending_chunks.len() as u64;
        self.writer_state.n_rows.fetch_add(self.pending_rows, Ordering::Relaxed);
        self.pending_chunks.clear();
        self.pending_rows = 0;
        Ok(())
    }
}

/// Move `n` bytes into `bytes`; false if `n` is 0 or there are fewer.
fn pop_bytes(consumer: &mut Consumer<u8>, n: usize, bytes: &mut Vec<u8>) -> bool {
    bytes.clear();
    let Ok(ring_chunk) = consumer.read_chunk(n) else {
        return false;
    };
    let (first_part, second_part) = ring_chunk.as_slices();
    bytes.extend_from_slice(first_part);
    bytes.extend_from_slice(second_part);
    ring_chunk.commit_all();
    n > 0
}

const _: () = assert!(EVENT_RING_BYTES <= chunk::PAYLOAD_MAX);

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::super::RecordedAxis;
    use super::super::reader::decode;
    use super::*;

    /// A header, the beginning of its file, and the path of an existing file.
    fn file(name: &str) -> (Header, Vec<u8>, std::path::PathBuf) {
        let header = Header {
            rate: 1e3,
            frames: 1,
            axes: vec![RecordedAxis::default()],
            about: String::new(),
        };
        let take_path = std::env::temp_dir().join(format!("ergon-{name}-{}.take", std::process::id()));
        let beginning = encode_start(&header);
        std::fs::write(&take_path, &beginning).unwrap();
        (header, beginning, take_path)
    }

    fn read_back(path: &Path) -> super::super::Recording {
        let written = std::fs::read(path).unwrap();
        std::fs::remove_file(path).unwrap();
        decode(&mut &written[..], written.len() as u64, None).unwrap()
    }

    #[test]
    fn writer_keeps_rows_on_a_full_disk() {
        let (header, beginning, take_path) = file("full");
        let full_file = OpenOptions::new().write(true).open("/dev/full").unwrap();
        let (mut row_sink, mut writer) = open_rings(&header, full_file, beginning.len() as u64);
        for tick in 0..3 {
            assert!(row_sink.push_row(tick, &[RecordedSample::default()]));
            assert!(writer.append_all(false).is_err());
        }
        assert_eq!(writer.writer_state.n_rows.load(Ordering::Relaxed), 0);
        writer.file = OpenOptions::new().append(true).open(&take_path).unwrap();
        writer.append_all(true).unwrap();
        assert_eq!(writer.writer_state.n_rows.load(Ordering::Relaxed), 3);
        let recording = read_back(&take_path);
        assert_eq!(recording.ticks, [0, 1, 2]);
        assert!(recording.is_complete() && recording.is_finished);
    }

    #[test]
    fn sink_without_room_counts_dropped_rows() {
        let (header, beginning, take_path) = file("room");
        let plain_file = OpenOptions::new().append(true).open(&take_path).unwrap();
        let (mut row_sink, mut writer) = open_rings(&header, plain_file, beginning.len() as u64);
        let row_samples = [RecordedSample::default()];
        assert!(row_sink.push_row(5, &row_samples));
        assert!(!row_sink.push_row(5, &row_samples), "a tick comes once");
        assert!(
            !row_sink.push_row(6, &row_samples.repeat(2)),
            "every axis has its place"
        );
        assert!(!row_sink.push_event(6, format_args!("{:2000}", 1)), "a long line");
        // Nothing empties the ring in this test.
        let ring_rows = (header.rate * RING_SECONDS) as u64;
        for tick in 0..ring_rows + 2 {
            assert_eq!(
                row_sink.push_row(10 + tick, &row_samples),
                tick < ring_rows - 1,
                "{tick}"
            );
        }
        assert_eq!(row_sink.dropped_count(), 3 + 3);
        writer.append_all(true).unwrap();
        assert_eq!(writer.writer_state.n_rows.load(Ordering::Relaxed), ring_rows);
        assert_eq!(read_back(&take_path).dropped, 6);
    }
}
