//! A WAVE file, written as fast as the frames come or by the clock; it gets its final name when it is complete.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::AudioError;
use super::ring::Drain;
use super::sink::{Opened, PRIORITY, Sink, ThreadSink};
use super::{null, wave};
use crate::realtime;

const BLOCK: u32 = 1024;
const POLL: Duration = Duration::from_micros(200);

/// A new file; until it is closed it has a temporary name in the same folder.
///
/// `clock`: if given, frames are taken by the clock, as a card would take them, in blocks of this size (`None`: the
/// default).
pub(super) fn open(
    path: &Path,
    rate: u32,
    channels: usize,
    clock: Option<Option<u32>>,
) -> Result<Opened, AudioError> {
    let mut recording = Recording::create(path, rate, channels)?;
    let block = clock.map_or(BLOCK, |block| block.unwrap_or(null::BLOCK));
    Ok(Opened {
        backend: "file",
        device: path.display().to_string(),
        rate,
        block,
        paced: clock.is_some(),
        remarks: Vec::new(),
        start: Box::new(move |drain| {
            drain.shared().set_timing(block, 0);
            let pump = ThreadSink::start("ergon file", drain, move |drain, stop| {
                let run = match clock {
                    Some(_) => recording.run_by_the_clock(drain, stop, block),
                    None => recording.run(drain, stop),
                };
                run.and_then(|()| recording.end())
                    .map_err(|error| recording.failure_sentence(&error))
            })?;
            Ok(Box::new(pump) as Box<dyn Sink>)
        }),
    })
}

/// A WAVE file that is being written.
pub(super) struct Recording {
    path: PathBuf,
    unfinished: PathBuf,
    to: BufWriter<File>,
    rate: u32,
    channels: usize,
    frames: u64,
    /// Frames that the header in the file declares.
    frames_in_header: u64,
}

impl Recording {
    /// A new file, with a temporary name until it is complete.
    pub(super) fn create(path: &Path, rate: u32, channels: usize) -> Result<Self, AudioError> {
        let failed = |error| AudioError::File {
            path: path.to_owned(),
            error,
        };
        if path.exists() {
            return Err(failed(io::ErrorKind::AlreadyExists.into()));
        }
        Self::begin(path, rate, channels).map_err(failed)
    }

    fn begin(path: &Path, rate: u32, channels: usize) -> io::Result<Self> {
        let mut name = std::ffi::OsString::from(".");
        name.push(path.file_name().ok_or(io::ErrorKind::InvalidFilename)?);
        name.push(format!(".{}.part", std::process::id()));
        let unfinished = path.with_file_name(name);
        // What a killed process of the same number has left; a link that somebody has put there is not followed.
        let _ = std::fs::remove_file(&unfinished);
        let mut to = BufWriter::with_capacity(1 << 18, File::create_new(&unfinished)?);
        to.write_all(&wave::header(rate, channels, 0))?;
        Ok(Self {
            path: path.to_owned(),
            unfinished,
            to,
            rate,
            channels,
            frames: 0,
            frames_in_header: 0,
        })
    }

    fn run(&mut self, drain: &mut Drain, stop: &AtomicBool) -> io::Result<()> {
        let mut out = vec![0.0; BLOCK as usize * self.channels];
        loop {
            // `stop` is read first, so that everything pushed before it was set is written.
            let last = stop.load(Ordering::Acquire);
            match drain.take(&mut out) {
                0 if last => return Ok(()),
                0 => std::thread::sleep(POLL),
                frames => self.write(&out[..frames * self.channels], frames)?,
            }
        }
    }

    fn run_by_the_clock(
        &mut self,
        drain: &mut Drain,
        stop: &AtomicBool,
        block: u32,
    ) -> io::Result<()> {
        drain
            .shared()
            .set_priority(realtime::set_priority(PRIORITY));
        let rate = self.rate;
        null::by_the_clock(drain, stop, rate, block, |out| {
            self.write(out, block as usize)
        })
    }

    pub(super) fn write(&mut self, samples: &[f32], frames: usize) -> io::Result<()> {
        for sample in samples {
            self.to.write_all(&sample.to_le_bytes())?;
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
        self.to.seek(SeekFrom::Start(0))?;
        self.to.write_all(&header)?;
        self.to.seek(SeekFrom::End(0))?;
        self.frames_in_header = self.frames;
        Ok(())
    }

    /// Finish the file and give it its final name.
    pub(super) fn end(&mut self) -> io::Result<()> {
        self.write_header()?;
        self.to.get_ref().sync_all()?;
        std::fs::rename(&self.unfinished, &self.path)
    }

    /// A sentence on why the file could not be written.
    pub(super) fn failure_sentence(&self, error: &io::Error) -> String {
        let (path, unfinished) = (self.path.display(), self.unfinished.display());
        format!("{path} could not be written ({error}); the unfinished file is {unfinished}")
    }
}
