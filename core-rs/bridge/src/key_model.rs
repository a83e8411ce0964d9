//! Path of a real key by its model, and the derivatives of the path.

use ergon_engine::key_model::KeyModel;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::error::module_error;
use crate::work::computing;

type PathAndJacobian<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// Path (n,) [m] of a real key under forces (n,) [N], and the derivatives of the path (n, columns).
#[pyfunction]
#[pyo3(signature = (parameters, force, rate, *, columns=None, steps=None))]
pub(crate) fn key_path<'py>(
    py: Python<'py>,
    parameters: PyReadonlyArray1<'py, f64>,
    force: PyReadonlyArray1<'py, f64>,
    rate: f64,
    columns: Option<Vec<usize>>,
    steps: Option<usize>,
) -> PyResult<PathAndJacobian<'py>> {
    let (parameter_row, force) = (parameters.as_slice()?, force.as_slice()?);
    let columns = columns.unwrap_or_else(|| (0..parameter_row.len()).collect());
    let (path, jacobian) = computing(py, || {
        let key_model = KeyModel::from_row(parameter_row)?;
        if columns.is_empty() {
            return Ok((key_model.path(force, rate, steps)?, Vec::new()));
        }
        key_model.path_and_jacobian(force, rate, steps, &columns)
    })?
    .map_err(|error: ergon_engine::key_model::KeyError| module_error("key_path", error))?;
    let jacobian =
        Array2::from_shape_vec((force.len(), columns.len()), jacobian).expect("a derivative for each tick and column");
    Ok((path.into_pyarray(py), jacobian.into_pyarray(py)))
}

/// Derivatives [m/N] of the path of `key_path` with respect to the forces of some ticks, (n, ticks).
#[pyfunction]
#[pyo3(signature = (parameters, force, rate, ticks, *, steps=None))]
pub(crate) fn key_force_derivatives<'py>(
    py: Python<'py>,
    parameters: PyReadonlyArray1<'py, f64>,
    force: PyReadonlyArray1<'py, f64>,
    rate: f64,
    ticks: Vec<usize>,
    steps: Option<usize>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (parameter_row, force) = (parameters.as_slice()?, force.as_slice()?);
    let derivatives = computing(py, || {
        KeyModel::from_row(parameter_row)?.force_derivatives(force, rate, steps, &ticks)
    })?
    .map_err(|error| module_error("key_force_derivatives", error))?;
    let derivatives =
        Array2::from_shape_vec((force.len(), ticks.len()), derivatives).expect("a derivative for each tick and force");
    Ok(derivatives.into_pyarray(py))
}
