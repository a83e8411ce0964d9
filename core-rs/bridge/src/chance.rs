//! Keyed random numbers.

use ergon_engine::chance;
use pyo3::prelude::*;

use crate::error::plain_error;

/// Random numbers: PCG64 keyed by SHA-256 of (seed, kind, name, member, occurrence), so that no stream depends on
/// another.
#[pyclass(module = "ergon._core")]
pub(crate) struct Chance(chance::Chance);

#[pymethods]
impl Chance {
    #[new]
    fn new(seed: i128, kind: &str, name: &str, member: u64, occurrence: u64) -> Self {
        Self(chance::Chance::new(seed, kind, name, member, occurrence))
    }

    /// A number from low to high, uniformly.
    fn uniform(&mut self, low: f64, high: f64) -> PyResult<f64> {
        check(low.is_finite() && high.is_finite(), "low and high must be finite")?;
        Ok(self.0.uniform(low, high))
    }

    /// A number from low to high, both above zero, whose logarithm is uniform.
    fn logarithmic(&mut self, low: f64, high: f64) -> PyResult<f64> {
        let is_in_domain = low > 0.0 && high > 0.0 && low.is_finite() && high.is_finite();
        check(is_in_domain, "low and high must be finite and above zero")?;
        Ok(self.0.logarithmic(low, high))
    }

    /// A number with an exponential distribution of this mean.
    fn exponential(&mut self, mean: f64) -> PyResult<f64> {
        check(
            mean >= 0.0 && mean.is_finite(),
            "the mean must be finite and at least zero",
        )?;
        Ok(self.0.exponential(mean))
    }
}

fn check(is_valid: bool, sentence: &'static str) -> PyResult<()> {
    if is_valid { Ok(()) } else { Err(plain_error(sentence)) }
}
