//! Access to blocks of frames as slices, with a readable error for a wrong shape.

use numpy::{Element, PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::error::plain_error;

/// The samples of a C-contiguous (n_frames, `columns`) array, read-only.
pub(crate) fn rows<'a, T: Element>(
    array: &'a PyReadonlyArray2<'_, T>,
    name: &str,
    columns: usize,
) -> PyResult<&'a [T]> {
    check(array.shape(), array.is_c_contiguous(), name, columns)?;
    Ok(array.as_slice()?)
}

/// The samples of a C-contiguous (n_frames, `columns`) array, writable.
pub(crate) fn rows_mut<'a, T: Element>(
    array: &'a mut PyReadwriteArray2<'_, T>,
    name: &str,
    columns: usize,
) -> PyResult<&'a mut [T]> {
    check(array.shape(), array.is_c_contiguous(), name, columns)?;
    Ok(array.as_slice_mut()?)
}

fn check(shape: &[usize], is_contiguous: bool, name: &str, columns: usize) -> PyResult<()> {
    if shape[1] != columns {
        let message = format!("{name} must be (n_frames, {columns}); it is {shape:?}");
        Err(plain_error(message))
    } else if !is_contiguous {
        Err(plain_error(format!("{name} must be C-contiguous")))
    } else {
        Ok(())
    }
}
