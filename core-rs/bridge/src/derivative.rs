//! Derivatives for SOV and SOA outputs, from positions that were computed elsewhere.

use ergon_engine::derivative;
use numpy::PyReadwriteArray2;
use pyo3::prelude::*;

use crate::error::hertz;
use crate::frames::rows_mut;
use crate::network::Network;

/// SOV and SOA of a network, from positions at a given rate.
#[pyclass(module = "ergon._core")]
pub(crate) struct Derivatives {
    derivatives: derivative::Derivatives,
    n_out: usize,
}

#[pymethods]
impl Derivatives {
    #[new]
    fn new(network: &Network, rate: f64) -> PyResult<Self> {
        let rate = hertz(rate)?.hertz();
        Ok(Self {
            derivatives: derivative::Derivatives::new(&network.0, rate),
            n_out: network.0.outputs().len(),
        })
    }

    /// Replace in frames (n_frames, n_out) the positions of each SOV and SOA by their derivatives, in place.
    fn process(&mut self, mut frames: PyReadwriteArray2<'_, f64>) -> PyResult<()> {
        self.derivatives
            .process(rows_mut(&mut frames, "frames", self.n_out)?, self.n_out);
        Ok(())
    }
}
