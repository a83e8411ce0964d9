//! Faults made on emulated devices, and the time until the force is zero.

use ergon_live::faults::{self, Measurement, Outcome};
use pyo3::prelude::*;

use crate::error::module_error;

/// Make every fault on every emulated device, in virtual time.
#[pyfunction]
pub(crate) fn measure_faults(py: Python<'_>) -> PyResult<Vec<FaultMeasurement>> {
    let measured = py.detach(faults::measure);
    let measured = measured.map_err(|error| module_error("measure_faults", error))?;
    Ok(measured.into_iter().map(FaultMeasurement).collect())
}

/// One fault on one emulated device.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct FaultMeasurement(Measurement);

#[pymethods]
impl FaultMeasurement {
    /// The fault in words.
    #[getter]
    fn fault(&self) -> &'static str {
        self.0.fault.name()
    }

    /// The device, as a URL names its kind.
    #[getter]
    fn device(&self) -> &'static str {
        self.0.emulator.name()
    }

    /// Time from the fault to zero force [s]; None: the force does not end, or the fault is excluded.
    #[getter]
    fn seconds(&self) -> Option<f64> {
        match self.0.outcome {
            Outcome::Zero(seconds) => Some(seconds),
            Outcome::Persists | Outcome::Excluded(_) => None,
        }
    }

    /// Longest time allowed [s]; None: no bound is set.
    #[getter]
    fn bound(&self) -> Option<f64> {
        self.0.bound.ok()
    }

    /// Why the fault is not made on this device.
    #[getter]
    fn excluded(&self) -> Option<&'static str> {
        match self.0.outcome {
            Outcome::Excluded(why) => Some(why),
            Outcome::Zero(_) | Outcome::Persists => None,
        }
    }

    /// Why no bound is set.
    #[getter]
    fn unbounded(&self) -> Option<&'static str> {
        self.0.bound.err()
    }

    /// Greatest force from the fault on [N].
    #[getter]
    fn force(&self) -> f64 {
        self.0.greatest[0]
    }

    /// Fastest growth of the force from the fault on [N/ms].
    #[getter]
    fn rise(&self) -> f64 {
        self.0.rise[0]
    }

    /// Whether time, force or growth exceeds its bound.
    #[getter]
    fn exceeds(&self) -> bool {
        self.0.exceeds()
    }
}
