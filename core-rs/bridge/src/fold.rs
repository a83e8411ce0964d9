//! Conversion of loudspeaker channels to other channels.

use ergon_engine::mix::fold;
use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::error::plain_error;
use crate::frames::{rows, rows_mut};

/// Filters from each input channel to each output channel.
#[pyclass(module = "ergon._core")]
pub(crate) struct Fold(pub(crate) fold::Fold);

#[pymethods]
impl Fold {
    #[new]
    fn new(filters: PyReadonlyArray3<'_, f64>) -> PyResult<Self> {
        let filter_shape = filters.shape();
        let (n_inputs, n_outputs) = (filter_shape[0], filter_shape[1]);
        let filter_taps: Vec<f64> = filters.as_array().iter().copied().collect();
        fold::Fold::new(n_inputs, n_outputs, &filter_taps)
            .map(Self)
            .map_err(plain_error)
    }

    /// Frames that sound on after the last input frame.
    #[getter]
    fn tail(&self) -> usize {
        self.0.tail_frames()
    }

    /// Filter frames (n_frames, n_in) into `output` (n_frames, n_out), which is overwritten.
    fn process(
        &mut self,
        py: Python<'_>,
        frames: PyReadonlyArray2<'_, f64>,
        mut output: PyReadwriteArray2<'_, f64>,
    ) -> PyResult<()> {
        if frames.shape()[0] != output.shape()[0] {
            return Err(plain_error("as many frames go out as come in"));
        }
        let frames = rows(&frames, "frames", self.0.n_in())?;
        let output = rows_mut(&mut output, "output", self.0.n_out())?;
        py.detach(|| self.0.process(frames, output));
        Ok(())
    }
}
