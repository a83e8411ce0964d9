//! Sound outputs, and a recorder of what a JACK client sends.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use ergon_live::audio::{self, AudioError, AudioSpec, Output, OutputInfo, RingWriter};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::error::{plain_error, unwritten};
use crate::frames::rows;

/// Time between two checks for Ctrl-C during a wait.
const CHECK_INTERVAL: Duration = Duration::from_millis(50);
const POLL_INTERVAL: Duration = Duration::from_micros(500);

fn audio_error(error: AudioError) -> PyErr {
    match error {
        AudioError::File { .. } => unwritten(error),
        error => plain_error(error),
    }
}

/// A sound output that takes frames of float32.
#[pyclass(module = "ergon._core")]
pub(crate) struct AudioOut {
    /// Only accessed through `&mut self`, never locked; the mutex only makes the type `Sync`.
    ring_writer: Mutex<RingWriter>,
    output: Output,
    n_channels: usize,
}

#[pymethods]
impl AudioOut {
    #[new]
    #[pyo3(signature = (spec, rate, n_channels, capacity = 4096))]
    fn new(py: Python<'_>, spec: &str, rate: u32, n_channels: usize, capacity: usize) -> PyResult<Self> {
        let spec: AudioSpec = spec.parse().map_err(audio_error)?;
        if !(1..=audio::CHANNELS_MAX).contains(&n_channels) || rate == 0 {
            let channel_limit = audio::CHANNELS_MAX;
            return Err(plain_error(format!(
                "an output must have 1 to {channel_limit} channels and a rate above 0"
            )));
        }
        py.detach(|| {
            let (frame_writer, frame_reader) = audio::ring(n_channels, capacity);
            let output = audio::open(&spec, rate, n_channels, frame_reader)?;
            Ok(Self {
                ring_writer: Mutex::new(frame_writer),
                output,
                n_channels,
            })
        })
        .map_err(audio_error)
    }

    /// Free frames of the ring.
    #[getter]
    fn room(&mut self) -> usize {
        self.ring_writer().free_frames()
    }

    /// Begin, and begin again after an underrun, once the ring holds `n_frames`.
    fn set_prefill(&mut self, n_frames: usize) {
        self.ring_writer().set_prefill(n_frames);
    }

    /// Write frames (n_frames, n_channels) without waiting; the number of frames that were taken.
    fn push(&mut self, frames: PyReadonlyArray2<'_, f32>) -> PyResult<usize> {
        let frames = rows(&frames, "frames", self.n_channels)?;
        Ok(self.ring_writer().push(frames))
    }

    /// Write all frames (n_frames, n_channels), waiting for room.
    fn play(&mut self, py: Python<'_>, frames: PyReadonlyArray2<'_, f32>) -> PyResult<()> {
        let mut frames = rows(&frames, "frames", self.n_channels)?;
        while !frames.is_empty() {
            let frame_writer = self.ring_writer();
            frames = py.detach(|| push_until_deadline(frame_writer, frames));
            py.check_signals()?;
        }
        Ok(())
    }

    /// Mark the end and wait until all frames were heard; False if `limit` [s] passes first.
    fn finish(&mut self, py: Python<'_>, limit: f64) -> PyResult<bool> {
        self.ring_writer().close();
        let deadline = Instant::now() + Duration::from_secs_f64(limit.clamp(0.0, 1e6));
        loop {
            let audio_output = &self.output;
            if py.detach(|| audio_output.wait(CHECK_INTERVAL)) {
                return Ok(true);
            }
            py.check_signals()?;
            if Instant::now() >= deadline {
                return Ok(false);
            }
        }
    }

    /// Close the output; a file gets its final name.
    fn close(&mut self, py: Python<'_>) -> PyResult<()> {
        let audio_output = &mut self.output;
        py.detach(|| audio_output.close()).map_err(audio_error)
    }

    /// Silence within 5 ms, until `release`.
    fn panic(&self) {
        self.output.stream_state().panic();
    }

    /// Sound again, faded in.
    fn release(&self) {
        self.output.stream_state().release();
    }

    /// Where the frames go.
    #[getter]
    fn info(&self) -> AudioInfo {
        let OutputInfo {
            backend,
            device,
            rate,
            block,
            latency_s,
            description: sentence,
            ..
        } = self.output.info();
        AudioInfo {
            backend,
            device,
            rate,
            block,
            latency: latency_s,
            sentence,
        }
    }

    /// All events so far.
    #[getter]
    fn events(&self) -> Vec<AudioEvent> {
        let output_events = self.output.events().into_iter();
        output_events
            .map(|event| AudioEvent {
                time: event.time,
                frame: event.frame,
                sentence: event.sentence,
            })
            .collect()
    }

    /// Whether a card or server takes frames.
    #[getter]
    fn alive(&self) -> bool {
        self.output.stream_state().is_alive()
    }

    /// Whether the JACK server runs as fast as it can.
    #[getter]
    fn freewheeling(&self) -> bool {
        self.output.stream_state().is_freewheeling()
    }

    /// Number of underruns.
    #[getter]
    fn underruns(&self) -> u64 {
        self.output.stream_state().underruns()
    }

    /// Frames of silence that underruns put in.
    #[getter]
    fn missing(&self) -> u64 {
        self.output.stream_state().missing_frames()
    }

    /// Frames of the score that went to the card.
    #[getter]
    fn played(&self) -> u64 {
        self.output.stream_state().played_frames()
    }

    /// Frames that a panic threw away.
    #[getter]
    fn discarded(&self) -> u64 {
        self.output.stream_state().discarded_frames()
    }

    /// Late cycles that the server, the card or the silent clock reported.
    #[getter]
    fn xruns(&self) -> u64 {
        self.output.stream_state().xruns()
    }
}

impl AudioOut {
    fn ring_writer(&mut self) -> &mut RingWriter {
        let lock_result = self.ring_writer.get_mut();
        lock_result.unwrap_or_else(PoisonError::into_inner)
    }
}

/// Push frames for at most `CHECK_INTERVAL`; returns those that are left.
fn push_until_deadline<'a>(ring_writer: &mut RingWriter, mut frames: &'a [f32]) -> &'a [f32] {
    let deadline = Instant::now() + CHECK_INTERVAL;
    while !frames.is_empty() && Instant::now() < deadline {
        match ring_writer.push(frames) {
            0 => std::thread::sleep(POLL_INTERVAL),
            n_pushed => frames = &frames[n_pushed * ring_writer.channels()..],
        }
    }
    frames
}

/// Play frames (n_frames, n_channels) to their end; the output as a sentence.
#[pyfunction]
#[pyo3(signature = (frames, rate, spec = "auto"))]
pub(crate) fn play_frames(
    py: Python<'_>,
    frames: PyReadonlyArray2<'_, f32>,
    rate: u32,
    spec: &str,
) -> PyResult<String> {
    let [n_frames, n_channels] = [frames.shape()[0], frames.shape()[1]];
    let mut audio_output = AudioOut::new(py, spec, rate, n_channels, rate.max(4096) as usize / 2)?;
    audio_output.play(py, frames)?;
    let seconds = n_frames as f64 / f64::from(rate);
    let is_complete = audio_output.finish(py, seconds + 10.0)?;
    let sentence = audio_output.output.info().description;
    audio_output.close(py)?;
    if is_complete {
        Ok(sentence)
    } else {
        Err(plain_error(format!("{sentence}: the output did not accept all frames")))
    }
}

/// Where the frames of an output go.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct AudioInfo {
    backend: String,
    device: String,
    /// [Hz]
    rate: u32,
    /// [frames]
    block: u32,
    /// [s]
    latency: f64,
    /// All of the above in words.
    sentence: String,
}

/// An event of an output, e.g. an underrun or a server that died.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct AudioEvent {
    /// Time since the output was opened [s].
    time: f64,
    frame: u64,
    sentence: String,
}

/// A sound system, available or not.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct AudioBackend {
    name: String,
    available: bool,
    /// What it is, or why it is not available.
    sentence: String,
}

/// Every sound system that ergon knows; starts no server.
#[pyfunction]
pub(crate) fn survey_audio(py: Python<'_>) -> Vec<AudioBackend> {
    let backends = py.detach(audio::survey).into_iter();
    backends
        .map(|(name, description)| {
            let available = description.is_ok();
            let (Ok(sentence) | Err(sentence)) = description;
            AudioBackend {
                name,
                available,
                sentence,
            }
        })
        .collect()
}

/// A JACK client that records another client.
#[pyclass(module = "ergon._core")]
pub(crate) struct JackCapture {
    capture: Option<audio::Capture>,
    n_channels: usize,
}

#[pymethods]
impl JackCapture {
    /// Record at most `n_frames` frames.
    #[new]
    fn new(py: Python<'_>, name: &str, n_channels: usize, n_frames: usize) -> PyResult<Self> {
        let capture = py
            .detach(|| audio::Capture::open(name, n_channels, n_frames))
            .map_err(audio_error)?;
        Ok(Self {
            capture: Some(capture),
            n_channels,
        })
    }

    /// Connect to the outputs of client `source`, waiting up to `limit` [s]; whether all are connected.
    fn connect(&self, py: Python<'_>, source: &str, limit: f64) -> PyResult<bool> {
        let capture = self.open()?;
        let limit = Duration::from_secs_f64(limit.clamp(0.0, 60.0));
        Ok(py.detach(|| capture.connect(source, limit)))
    }

    /// Frames recorded so far.
    #[getter]
    fn recorded(&self) -> PyResult<usize> {
        Ok(self.open()?.recorded())
    }

    /// Switch the freewheel mode of the server, in which it runs as fast as its clients; returns whether the server
    /// accepted.
    fn freewheel(&self, py: Python<'_>, on: bool) -> PyResult<bool> {
        let capture = self.open()?;
        Ok(py.detach(|| capture.freewheel(on)))
    }

    /// End the recording; its frames, (n_frames, n_channels).
    fn finish<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let capture = self.capture.take();
        let capture = capture.ok_or_else(|| plain_error("the recording has ended"))?;
        let samples = py.detach(|| capture.finish());
        let n_frames = samples.len() / self.n_channels;
        samples.into_pyarray(py).reshape([n_frames, self.n_channels])
    }
}

impl JackCapture {
    fn open(&self) -> PyResult<&audio::Capture> {
        self.capture
            .as_ref()
            .ok_or_else(|| plain_error("the recording has ended"))
    }
}
