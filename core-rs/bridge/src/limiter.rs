//! The limiter at the end of the output chain.

use ergon_engine::mix::limiter;
use numpy::PyReadwriteArray2;
use pyo3::prelude::*;

use crate::error::plain_error;
use crate::frames::rows_mut;

/// Look-ahead limiter of sample peaks: 5 ms ahead, 50 ms release, one gain for all channels.
#[pyclass(module = "ergon._core")]
pub(crate) struct Limiter(limiter::Limiter);

#[pymethods]
impl Limiter {
    #[new]
    fn new(rate: f64, n_channels: usize, ceiling: f64) -> PyResult<Self> {
        limiter::Limiter::new(rate, n_channels, ceiling)
            .map(Self)
            .map_err(plain_error)
    }

    /// Delay of the output [frames].
    #[getter]
    fn latency(&self) -> usize {
        self.0.latency()
    }

    /// Limit frames (n_frames, n_channels) in place; the output is `latency` frames late.
    fn process(&mut self, py: Python<'_>, mut frames: PyReadwriteArray2<'_, f64>) -> PyResult<()> {
        let frames = rows_mut(&mut frames, "frames", self.0.n_channels())?;
        py.detach(|| self.0.process(frames));
        Ok(())
    }
}
