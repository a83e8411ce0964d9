//! Faults made on emulated devices, and the time until the force is zero.

use ergon_live::faults::{self, FaultOutcome};
use pyo3::prelude::*;

use crate::error::module_error;

/// Make every fault on every emulated device, in virtual time.
#[pyfunction]
pub(crate) fn measure_faults(py: Python<'_>) -> PyResult<Vec<FaultMeasurement>> {
    let measurements = py.detach(faults::measure);
    let measurements = measurements.map_err(|error| module_error("measure_faults", error))?;
    Ok(measurements.into_iter().map(FaultMeasurement).collect())
}

/// One fault on one emulated device.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct FaultMeasurement(faults::FaultMeasurement);

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
            FaultOutcome::Zero(seconds) => Some(seconds),
            FaultOutcome::Persists | FaultOutcome::Excluded(_) => None,
        }
    }

    /// Longest time allowed [s]; None: no bound is set.
    #[getter]
    fn bound(&self) -> Option<f64> {
        self.0.time_limit.ok()
    }

    /// Why the fault is not made on this device.
    #[getter]
    fn excluded(&self) -> Option<&'static str> {
        match self.0.outcome {
            FaultOutcome::Excluded(reason) => Some(reason),
            FaultOutcome::Zero(_) | FaultOutcome::Persists => None,
        }
    }

    /// Why no bound is set.
    #[getter]
    fn unbounded(&self) -> Option<&'static str> {
        self.0.time_limit.err()
    }

    /// Greatest force from the fault on [N].
    #[getter]
    fn force(&self) -> f64 {
        self.0.peak_force_and_limit[0]
    }

    /// Fastest growth of the force from the fault on [N/ms].
    #[getter]
    fn rise(&self) -> f64 {
        self.0.force_rise_and_limit[0]
    }

    /// Whether time, force or growth exceeds its bound.
    #[getter]
    fn exceeds(&self) -> bool {
        self.0.exceeds()
    }
}
