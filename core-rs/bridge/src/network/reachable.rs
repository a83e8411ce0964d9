//! The part of a network that a hand can move.

use ergon_engine::network;
use ergon_engine::units::Rate;
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::from_engine;
use crate::work::computing;

/// The part of a network that a hand can move, made linear and at rest, with all contacts closed.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct ReachableNetwork {
    pub(super) reached: network::ReachableNetwork,
    pub(super) rate: Rate,
}

#[pymethods]
impl ReachableNetwork {
    /// Number of other hands that feel this hand.
    #[getter]
    fn others(&self) -> usize {
        self.reached.n_other_hands
    }

    /// Bytes that determine `response`: equal bytes, equal response.
    fn key<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let mut key_bytes = self.reached.network.parameter_bytes();
        key_bytes.extend((self.reached.mat as u64).to_le_bytes());
        key_bytes.extend(self.rate.hertz().to_le_bytes());
        PyBytes::new(py, &key_bytes)
    }

    /// Force against the hand [N/m] in each tick after it was 1 m away for one tick, (n_ticks,).
    fn response<'py>(
        &self,
        py: Python<'py>,
        tick_frames: u32,
        ticks: [usize; 2],
    ) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        let response = computing(py, || self.reached.response(self.rate, tick_frames, ticks))?;
        Ok(response
            .map_err(from_engine)?
            .map(|response_values| response_values.into_pyarray(py)))
    }
}
