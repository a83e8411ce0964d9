//! How far one sound is from another, by the metric of plans.

use ergon_engine::waveform::errors_until;
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::frames::rows;

/// The error of `sound` against `reference` [dB], both (n_frames, n_out), from the first frame to each of `ends`
/// [frames], which do not fall.
#[pyfunction]
pub(crate) fn waveform_errors(
    sound: PyReadonlyArray2<'_, f64>,
    reference: PyReadonlyArray2<'_, f64>,
    ends: Vec<usize>,
) -> PyResult<Vec<f64>> {
    let n_outputs = reference.shape()[1];
    let sound = rows(&sound, "sound", n_outputs)?;
    let reference = rows(&reference, "reference", n_outputs)?;
    Ok(errors_until(sound, reference, n_outputs, &ends))
}
