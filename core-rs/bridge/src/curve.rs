//! Values of a written curve at given instants.

use ergon_engine::gesture::profile::{Point, Profile};
use ergon_engine::gesture::written::Approach;
use pyo3::prelude::*;

use crate::error::{module_error, parse_choice};
use crate::words;

/// Values of the path through points (t, x, curve) at instants.
#[pyfunction]
pub(crate) fn path_values(points: Vec<(f64, f64, String)>, instants: Vec<f64>) -> PyResult<Vec<f64>> {
    let read_point = |(t, x, curve): &(f64, f64, String)| {
        let Approach::Path(curve) = parse_choice("curve", curve, words::APPROACHES)? else {
            return Err(module_error(
                "path_values",
                "a throw has no path of its own; choose smooth, line or hold",
            ));
        };
        Ok(Point { t: *t, x: *x, curve })
    };
    let points = points.iter().map(read_point).collect::<PyResult<Vec<_>>>()?;
    let path_profile = Profile::through_points(&points).map_err(|error| module_error("path_values", error))?;
    Ok(instants.into_iter().map(|t| path_profile.evaluate(t).0).collect())
}
