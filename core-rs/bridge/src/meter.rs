//! Meters of levels.

use ergon_engine::mix::{level_steps, meter, true_peak};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::plain_error;
use crate::frames::rows;

/// Peak and integrated loudness (ITU-R BS.1770) of all frames so far.
#[pyclass(module = "ergon._core")]
pub(crate) struct Meter(meter::Meter);

#[pymethods]
impl Meter {
    #[new]
    fn new(rate: f64, n_channels: usize) -> PyResult<Self> {
        meter::Meter::new(rate, n_channels).map(Self).map_err(plain_error)
    }

    /// Measure frames (n_frames, n_channels).
    fn process(&mut self, py: Python<'_>, frames: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let frames = rows(&frames, "frames", self.0.n_channels())?;
        py.detach(|| self.0.process(frames));
        Ok(())
    }

    /// Largest absolute sample so far.
    #[getter]
    fn peak(&self) -> f64 {
        self.0.peak()
    }

    /// Loudness of the last 400 ms [LUFS], without gating; -inf for silence.
    #[getter]
    fn momentary(&self) -> f64 {
        self.0.momentary_loudness()
    }

    /// Integrated loudness so far [LUFS]; -inf for silence.
    #[getter]
    fn loudness(&self) -> f64 {
        self.0.loudness()
    }
}

/// Loudness and peaks of a sound, every tenth of a second.
#[pyclass(module = "ergon._core")]
pub(crate) struct LevelSteps(level_steps::LevelSteps);

#[pymethods]
impl LevelSteps {
    #[new]
    fn new(rate: f64, n_channels: usize) -> PyResult<Self> {
        level_steps::LevelSteps::new(rate, n_channels)
            .map(Self)
            .map_err(plain_error)
    }

    /// Measure frames (n_frames, n_channels).
    fn process(&mut self, py: Python<'_>, frames: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let frames = rows(&frames, "frames", self.0.n_channels())?;
        py.detach(|| self.0.process(frames));
        Ok(())
    }

    /// What was measured of each complete step (n_steps · 11,): the level of the last 400 ms [LUFS], and ten peaks.
    #[getter]
    fn measured<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.levels())
    }

    /// What the levels of later frames depend on, besides the sound, as bytes.
    fn state<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.0.write_state())
    }

    /// Go on after frames whose levels are `measured`.
    fn set_state(&mut self, state: &[u8], measured: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        self.0.read_state(state, measured.as_slice()?).map_err(plain_error)
    }
}

/// The largest absolute value of a sound between its samples (ITU-R BS.1770).
#[pyclass(module = "ergon._core")]
pub(crate) struct TruePeak(true_peak::TruePeak);

#[pymethods]
impl TruePeak {
    #[new]
    fn new(n_channels: usize) -> Self {
        Self(true_peak::TruePeak::new(n_channels))
    }

    /// Measure frames (n_frames, n_channels).
    fn process(&mut self, py: Python<'_>, frames: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let frames = rows(&frames, "frames", self.0.n_channels())?;
        py.detach(|| self.0.process(frames));
        Ok(())
    }

    /// Largest absolute value so far, at four times the rate.
    #[getter]
    fn peak(&self) -> f64 {
        self.0.peak()
    }
}
