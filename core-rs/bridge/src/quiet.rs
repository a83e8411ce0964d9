//! Where a sound has faded.

use ergon_engine::mix::quiet;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use crate::frames::rows;

/// Looks for the end of a sound.
#[pyclass(module = "ergon._core")]
pub(crate) struct FadeFinder(quiet::FadeFinder);

#[pymethods]
impl FadeFinder {
    #[new]
    fn new(rate: f64, n_channels: usize, start: u64) -> Self {
        Self(quiet::FadeFinder::new(rate, n_channels, start))
    }

    /// Take (n_frames, n_channels).
    fn take(&mut self, py: Python<'_>, frames: PyReadonlyArray2<'_, f64>) -> PyResult<Option<u64>> {
        let frames = rows(&frames, "frames", self.0.n_channels())?;
        Ok(py.detach(|| self.0.take(frames)))
    }
}
