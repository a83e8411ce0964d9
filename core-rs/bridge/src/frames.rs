//! Shapes of blocks of frames, checked with a sentence.

use numpy::{Element, PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::error::said;

/// The rows of a C-contiguous (n_frames, `columns`) array that is only read.
pub(crate) fn rows<'a, T: Element>(
    array: &'a PyReadonlyArray2<'_, T>,
    name: &str,
    columns: usize,
) -> PyResult<&'a [T]> {
    check(array.shape(), array.is_c_contiguous(), name, columns)?;
    Ok(array.as_slice()?)
}

/// The rows of a C-contiguous (n_frames, `columns`) array that is filled.
pub(crate) fn rows_mut<'a, T: Element>(
    array: &'a mut PyReadwriteArray2<'_, T>,
    name: &str,
    columns: usize,
) -> PyResult<&'a mut [T]> {
    check(array.shape(), array.is_c_contiguous(), name, columns)?;
    Ok(array.as_slice_mut()?)
}

fn check(shape: &[usize], contiguous: bool, name: &str, columns: usize) -> PyResult<()> {
    if shape[1] != columns {
        let message = format!("{name} must be (n_frames, {columns}); it is {shape:?}");
        Err(said(message))
    } else if !contiguous {
        Err(said(format!("{name} must be C-contiguous")))
    } else {
        Ok(())
    }
}
