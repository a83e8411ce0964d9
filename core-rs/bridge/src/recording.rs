//! Recordings of live hands.

use std::path::PathBuf;

use ergon_live::recording::{self, Header, RecordedSample, RecordingError};
use numpy::ndarray::Array2;
use numpy::{Element, IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::plain_error;
use crate::frames::rows;
use crate::named::{RecordedAxis, RecordedEvent};

pub(crate) fn from_recording(error: RecordingError) -> PyErr {
    match error {
        RecordingError::Io(error) => error.into(),
        error => plain_error(error),
    }
}

/// The movement of live hands, tick by tick, and the events between ticks.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Recording(recording::Recording);

/// Read the undamaged rows of a `.take` file; `span` (from, to) keeps these ticks, counted from the first row.
#[pyfunction]
#[pyo3(signature = (path, span = None))]
pub(crate) fn read_recording(py: Python<'_>, path: PathBuf, span: Option<(u64, u64)>) -> PyResult<Recording> {
    let span = span.map(|(from, to)| from..to);
    py.detach(|| recording::read(&path, span))
        .map(Recording)
        .map_err(from_recording)
}

#[pymethods]
impl Recording {
    #[new]
    fn new(
        rate: f64,
        frames: u32,
        axes: Vec<(String, String)>,
        about: String,
        ticks: PyReadonlyArray1<'_, u64>,
        positions: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let axes: Vec<_> = axes
            .into_iter()
            .map(|(player, key)| recording::RecordedAxis { player, key })
            .collect();
        let positions = rows(&positions, "positions", axes.len())?;
        let position_sample = |&position| RecordedSample {
            position,
            ..RecordedSample::default()
        };
        let take_header = Header {
            rate,
            frames,
            axes,
            about,
        };
        let samples = positions.iter().map(position_sample).collect();
        recording::Recording::new(take_header, ticks.as_slice()?.to_vec(), samples)
            .map(Self)
            .map_err(from_recording)
    }

    #[getter]
    fn rate(&self) -> f64 {
        self.0.header.rate
    }

    #[getter]
    fn frames(&self) -> u32 {
        self.0.header.frames
    }

    #[getter]
    fn axes(&self) -> Vec<RecordedAxis> {
        let header_axes = self.0.header.axes.iter().cloned();
        header_axes
            .map(|recording::RecordedAxis { player, key }| RecordedAxis { player, key })
            .collect()
    }

    /// The names of the axes, all different.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.0.header.names()
    }

    #[getter]
    fn about(&self) -> &str {
        &self.0.header.about
    }

    #[getter]
    fn events(&self) -> Vec<RecordedEvent> {
        let recorded_events = self.0.events.iter().cloned();
        recorded_events
            .map(|(tick, line)| RecordedEvent { tick, line })
            .collect()
    }

    #[getter]
    fn dropped(&self) -> u64 {
        self.0.dropped
    }

    #[getter]
    fn lost_bytes(&self) -> u64 {
        self.0.lost_bytes
    }

    #[getter]
    fn is_complete(&self) -> bool {
        self.0.is_complete()
    }

    /// A sentence on what is wrong with the file, and what is left.
    #[getter]
    fn damage(&self) -> Option<String> {
        self.0.damage()
    }

    /// From the first tick to the end of the last [s].
    #[getter]
    fn duration(&self) -> f64 {
        self.0.duration()
    }

    #[getter]
    fn finished(&self) -> bool {
        self.0.is_finished
    }

    /// The tick of each row, rising, (n_ticks,).
    fn ticks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u64>> {
        PyArray1::from_slice(py, &self.0.ticks)
    }

    /// Positions that the simulation used [m], (n_ticks, n_axes).
    fn positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.column(py, |sample| sample.position)
    }

    /// Forces of the piece on the keys [N], (n_ticks, n_axes).
    fn forces<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.column(py, |sample| sample.force)
    }

    /// Forces sent to the devices, after the safety stages [N], (n_ticks, n_axes).
    fn sent<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        self.column(py, |sample| sample.sent_force)
    }

    /// Sums of 1 fresh, 2 touch, 4 force enabled, 8 stand-in, 16 tripped, (n_ticks, n_axes).
    fn flags<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u8>> {
        self.column(py, |sample| sample.flags)
    }

    /// The devices' own clocks [µs], (n_ticks, n_axes).
    fn clocks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u32>> {
        self.column(py, |sample| sample.clock)
    }

    /// Positions [m] at every tick from the first to the last, (n, n_axes); a gap holds its last value.
    fn held<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let filled_positions = py.detach(|| self.0.positions_filled()).map_err(from_recording)?;
        Ok(self.tick_array(py, filled_positions))
    }

    /// The bytes of a complete `.take` file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let mut file_bytes = Vec::new();
        py.detach(|| self.0.write(&mut file_bytes)).map_err(from_recording)?;
        Ok(PyBytes::new(py, &file_bytes))
    }
}

impl Recording {
    fn column<'py, T: Element>(
        &self,
        py: Python<'py>,
        sample_value: fn(&RecordedSample) -> T,
    ) -> Bound<'py, PyArray2<T>> {
        self.tick_array(py, self.0.samples.iter().map(sample_value).collect())
    }

    fn tick_array<'py, T: Element>(&self, py: Python<'py>, values: Vec<T>) -> Bound<'py, PyArray2<T>> {
        let n_axes = self.0.header.axes.len();
        let array_shape = (values.len() / n_axes, n_axes);
        let tick_array = Array2::from_shape_vec(array_shape, values).expect("a value for each tick and axis");
        tick_array.into_pyarray(py)
    }
}
