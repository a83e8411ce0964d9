//! Meters of levels.

use ergon_engine::mix::{meter, true_peak};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

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
        self.0.momentary()
    }

    /// Integrated loudness so far [LUFS]; -inf for silence.
    #[getter]
    fn loudness(&self) -> f64 {
        self.0.loudness()
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
