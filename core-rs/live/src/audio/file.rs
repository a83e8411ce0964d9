//! A WAVE file, written as fast as the frames come or by the clock; it gets its final name when it is complete.

use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::AudioError;
use super::ring::RingReader;
use super::sink::{OpenedOutput, RingThread, SINK_THREAD_PRIORITY, Sink};
use super::{null, wave};
use crate::realtime;

const BLOCK_FRAMES: u32 = 1024;
const POLL_INTERVAL: Duration = Duration::from_micros(200);

/// A new file; until it is closed it has a temporary name in the same folder.
///
/// `clock_block`: if given, frames are taken by the clock, as a card would take them, in blocks of this size (`None`:
/// the default).
pub(super) fn open(
    path: &Path,
    rate: u32,
    channels: usize,
    clock_block: Option<Option<u32>>,
) -> Result<OpenedOutput, AudioError> {
    let mut wave_writer = WaveFileWriter::create(path, rate, channels)?;
    let block = clock_block.map_or(BLOCK_FRAMES, |block| block.unwrap_or(null::BLOCK_FRAMES));
    Ok(OpenedOutput {
        backend: "file",
        device: path.display().to_string(),
        rate,
        block,
        is_paced: clock_block.is_some(),
        remarks: Vec::new(),
        start: Box::new(move |ring_reader| {
            ring_reader.stream_state().set_timing(block, 0);
            let writer_thread = RingThread::start("ergon file", ring_reader, move |ring_reader, stop| {
                let run_result = match clock_block {
                    Some(_) => wave_writer.write_by_clock(ring_reader, stop, block),
                    None => wave_writer.write_until_closed(ring_reader, stop),
                };
                run_result
                    .and_then(|()| wave_writer.finish())
                    .map_err(|error| wave_writer.failure_sentence(&error))
            })?;
            Ok(Box::new(writer_thread) as Box<dyn Sink>)
        }),
    })
}

/// A new file beside `path`: `.NAME.PID.part`, or `.NAME.PID-1.part` and so on where a file has that name.
fn create_unfinished_file(path: &Path) -> io::Result<(PathBuf, File)> {
    let file_name = path.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
    let process_id = std::process::id();
    let mut attempt = 0;
    loop {
        let mut part_name = std::ffi::OsString::from(".");
        part_name.push(file_name);
        part_name.push(match attempt {
            0 => format!(".{process_id}.part"),
            _ => format!(".{process_id}-{attempt}.part"),
        });
        let unfinished_path = path.with_file_name(part_name);
        match File::create_new(&unfinished_path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => attempt += 1,
            create_result => return create_result.map(|file| (unfinished_path, file)),
        }
    }
}

/// Rename a file, but never over another one that has got the name meanwhile.
fn rename_to_final(unfinished_path: &Path, path: &Path) -> io::Result<()> {
    match fs::hard_link(unfinished_path, path) {
        Ok(()) => fs::remove_file(unfinished_path),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Err(error),
        // A file system without links.
        Err(_) if !path.exists() => fs::rename(unfinished_path, path),
        Err(error) => Err(error),
    }
}

/// A WAVE file that is being written.
pub(super) struct WaveFileWriter {
    path: PathBuf,
    unfinished_path: PathBuf,
    writer: BufWriter<File>,
    rate: u32,
    channels: usize,
    frames: u64,
    /// Frames that the header in the file declares.
    frames_in_header: u64,
}

impl WaveFileWriter {
    /// A new file, with a temporary name until it is complete.
    pub(super) fn create(path: &Path, rate: u32, channels: usize) -> Result<Self, AudioError> {
        let file_error = |error| AudioError::File {
            path: path.to_owned(),
            error,
        };
        if path.exists() {
            let sentence = "this file exists; played sound never overwrites a file: choose another name";
            return Err(file_error(io::Error::new(io::ErrorKind::AlreadyExists, sentence)));
        }
        Self::start_writing(path, rate, channels).map_err(file_error)
    }

    fn start_writing(path: &Path, rate: u32, channels: usize) -> io::Result<Self> {
        let (unfinished_path, file) = create_unfinished_file(path)?;
        let mut writer = BufWriter::with_capacity(1 << 18, file);
        writer.write_all(&wave::header(rate, channels, 0))?;
        Ok(Self {
            path: path.to_owned(),
            unfinished_path,
            writer,
            rate,
            channels,
            frames: 0,
            frames_in_header: 0,
        })
    }

    fn write_until_closed(&mut self, ring_reader: &mut RingReader, stop: &AtomicBool) -> io::Result<()> {
        let mut block_samples = vec![0.0; BLOCK_FRAMES as usize * self.channels];
        loop {
            // `stop` is read first, so that everything pushed before it was set is written.
            let stop_requested = stop.load(Ordering::Acquire);
            match ring_reader.take_waiting(&mut block_samples) {
                0 if stop_requested => return Ok(()),
                0 => std::thread::sleep(POLL_INTERVAL),
                frames => self.write(&block_samples[..frames * self.channels], frames)?,
            }
        }
    }

    fn write_by_clock(&mut self, ring_reader: &mut RingReader, stop: &AtomicBool, block: u32) -> io::Result<()> {
        ring_reader
            .stream_state()
            .set_priority(realtime::set_priority(SINK_THREAD_PRIORITY));
        let sample_rate = self.rate;
        null::pace_by_clock(ring_reader, stop, sample_rate, block, |block_samples| {
            self.write(block_samples, block as usize)
        })
    }

    pub(super) fn write(&mut self, samples: &[f32], frames: usize) -> io::Result<()> {
        for sample in samples {
            self.writer.write_all(&sample.to_le_bytes())?;
        }
        self.frames += frames as u64;
        // Update the header from time to time, so that the file of a killed performance can be read up to its last
        // seconds.
        if self.frames - self.frames_in_header > 5 * u64::from(self.rate) {
            self.write_header()?;
        }
        Ok(())
    }

    fn write_header(&mut self) -> io::Result<()> {
        let header = wave::header(self.rate, self.channels, self.frames);
        self.writer.seek(SeekFrom::Start(0))?;
        self.writer.write_all(&header)?;
        self.writer.seek(SeekFrom::End(0))?;
        self.frames_in_header = self.frames;
        Ok(())
    }

    /// Finish the file and give it its final name.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.write_header()?;
        self.writer.get_ref().sync_all()?;
        rename_to_final(&self.unfinished_path, &self.path)
    }

    /// A sentence on why the file could not be written.
    pub(super) fn failure_sentence(&self, error: &io::Error) -> String {
        let (final_path, unfinished_path) = (self.path.display(), self.unfinished_path.display());
        format!("{final_path} could not be written ({error}); the unfinished file is {unfinished_path}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("ergon-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder");
        folder
    }

    #[test]
    fn recording_keeps_a_file_with_its_unfinished_name() {
        let folder = folder("unfinished");
        let wave_path = folder.join("a.wav");
        let other_part = folder.join(format!(".a.wav.{}.part", std::process::id()));
        fs::write(&other_part, "mine").expect("written");
        let mut recording = WaveFileWriter::create(&wave_path, 1000, 1).expect("a recording");
        recording.write(&[1.0, 2.0], 2).expect("written");
        recording.finish().expect("ended");
        assert_eq!(fs::read(&other_part).expect("it is there"), b"mine");
        assert!(wave_path.exists());
        assert_eq!(fs::read_dir(&folder).expect("a folder").count(), 2);
        fs::remove_dir_all(&folder).expect("removed");
    }

    #[test]
    fn recording_keeps_a_file_created_meanwhile() {
        let folder = folder("meanwhile");
        let wave_path = folder.join("a.wav");
        let mut recording = WaveFileWriter::create(&wave_path, 1000, 1).expect("a recording");
        recording.write(&[1.0, 2.0], 2).expect("written");
        fs::write(&wave_path, "mine").expect("written");
        let end_error = recording.finish().expect_err("the name is taken");
        assert!(
            recording
                .failure_sentence(&end_error)
                .contains("the unfinished file is ")
        );
        assert_eq!(fs::read(&wave_path).expect("it is there"), b"mine");
        assert!(recording.unfinished_path.exists());
        fs::remove_dir_all(&folder).expect("removed");
    }
}
