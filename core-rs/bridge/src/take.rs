//! Takes: recorded movements.

use ergon_engine::gesture::take::{self, Preparation, TakeError};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::error::{EngineError, with_attributes};
use crate::named::PathPoint;
use crate::work::computing;

/// A recorded movement: the natural quintic spline through samples (t [s], x [m]), both (n,).
#[pyclass(module = "ergon._core", frozen)]
pub(crate) struct Take(pub(crate) take::Take);

#[pymethods]
impl Take {
    #[new]
    #[pyo3(signature = (t, x, *, trim = None, smooth = None))]
    fn new(
        py: Python<'_>,
        t: PyReadonlyArray1<'_, f64>,
        x: PyReadonlyArray1<'_, f64>,
        trim: Option<(f64, f64)>,
        smooth: Option<f64>,
    ) -> PyResult<Self> {
        let (t, x) = (t.as_slice()?, x.as_slice()?);
        computing(py, || take::Take::new(t, x, Preparation { trim, smooth }))?
            .map(Self)
            .map_err(take_error)
    }

    /// Duration [s], from the first instant to the last.
    #[getter]
    fn duration(&self) -> f64 {
        self.0.duration()
    }

    /// The part between two instants [s], which begins at zero.
    fn part(&self, first: f64, last: f64) -> PyResult<Self> {
        self.0.part(first, last).map(Self).map_err(take_error)
    }

    /// Position, velocity, acceleration at t [s].
    fn evaluate(&self, t: f64) -> PathPoint {
        let (x, v, a) = self.0.profile().evaluate(t);
        PathPoint { x, v, a }
    }

    /// Positions [m] at instants t [s], both (n,); fastest where t rises.
    fn positions<'py>(&self, py: Python<'py>, t: PyReadonlyArray1<'py, f64>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (profile, t) = (self.0.profile(), t.as_slice()?);
        let mut search_cursor = 0;
        let mut position = |&t: &f64| profile.evaluate_from(&mut search_cursor, t).0;
        let path_positions: Vec<f64> = py.detach(|| t.iter().map(&mut position).collect());
        Ok(path_positions.into_pyarray(py))
    }
}

/// EngineError whose `module` is the argument at fault; None if the samples are at fault.
fn take_error(error: TakeError) -> PyErr {
    let argument = match error {
        TakeError::Trim { .. } => Some("trim"),
        TakeError::Smooth { .. } => Some("smooth"),
        _ => None,
    };
    let python_error = EngineError::new_err(error.to_string());
    with_attributes(python_error, argument, |_| Ok(()))
}
