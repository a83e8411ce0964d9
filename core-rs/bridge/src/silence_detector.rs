//! Detector of the frame at which a sound has faded.

use ergon_engine::mix::silence_detector;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use crate::frames::rows;

/// Looks for the first tenth of a second, after frame `start`, that begins a quiet second.
#[pyclass(module = "ergon._core")]
pub(crate) struct SilenceDetector(silence_detector::SilenceDetector);

#[pymethods]
impl SilenceDetector {
    #[new]
    fn new(rate: f64, n_channels: usize, start: u64) -> Self {
        Self(silence_detector::SilenceDetector::new(rate, n_channels, start))
    }

    /// Take (n_frames, n_channels); the frame at which the sound has faded, once that is known.
    fn take(&mut self, py: Python<'_>, frames: PyReadonlyArray2<'_, f64>) -> PyResult<Option<u64>> {
        let frames = rows(&frames, "frames", self.0.n_channels())?;
        Ok(py.detach(|| self.0.process(frames)))
    }
}
