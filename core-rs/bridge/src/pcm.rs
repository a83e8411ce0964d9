//! Conversion of samples to the formats of sound files.

use ergon_engine::mix::pcm::{self as engine, SampleWidth};
use numpy::{Element, IxDyn, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::plain_error;

/// frames · gain as integers in the top bits of an int32, rounded half to even, clipped.
#[pyfunction]
pub(crate) fn pcm<'py>(
    py: Python<'py>,
    frames: PyReadonlyArrayDyn<'py, f64>,
    gain: f64,
    bits: u32,
) -> PyResult<Bound<'py, PyArrayDyn<i32>>> {
    let bits = SampleWidth::try_from(bits).map_err(|bits| plain_error(format!("bits must be 16 or 24, not {bits}")))?;
    convert_samples(py, &frames, |samples, codes| engine::pcm(samples, gain, bits, codes))
}

/// The top `width` bytes (1 to 4) of codes in C order, the lowest of each first.
#[pyfunction]
pub(crate) fn packed<'py>(
    py: Python<'py>,
    codes: PyReadonlyArrayDyn<'py, i32>,
    width: usize,
) -> PyResult<Bound<'py, PyBytes>> {
    if !codes.is_c_contiguous() || !(1..=4).contains(&width) {
        return Err(plain_error("codes must be C-contiguous, and 1 to 4 bytes wide"));
    }
    let codes = codes.as_slice()?;
    PyBytes::new_with(py, codes.len() * width, |bytes| {
        engine::pack(codes, width, bytes);
        Ok(())
    })
}

/// The CRC-32 (as of zlib) of bytes that come after those of which it is `start`.
#[pyfunction]
#[pyo3(signature = (bytes, start = 0))]
pub(crate) fn crc32(py: Python<'_>, bytes: PyReadonlyArray1<'_, u8>, start: u32) -> PyResult<u32> {
    let mut hasher = crc32fast::Hasher::new_with_initial(start);
    let bytes = bytes.as_slice()?;
    py.detach(|| hasher.update(bytes));
    Ok(hasher.finalize())
}

/// frames · gain in single precision.
#[pyfunction]
pub(crate) fn single<'py>(
    py: Python<'py>,
    frames: PyReadonlyArrayDyn<'py, f64>,
    gain: f64,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    convert_samples(py, &frames, |samples, singles| {
        engine::to_single(samples, gain, singles)
    })
}

/// A new array of the same shape, filled from the samples in C order.
fn convert_samples<'py, T: Element + Default>(
    py: Python<'py>,
    frames: &PyReadonlyArrayDyn<'py, f64>,
    convert: impl FnOnce(&[f64], &mut [T]) + Send,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    if !frames.is_c_contiguous() {
        return Err(plain_error("frames must be C-contiguous"));
    }
    let samples = frames.as_slice()?;
    let converted_array = PyArrayDyn::<T>::zeros(py, IxDyn(frames.shape()), false);
    {
        let mut write_access = converted_array.readwrite();
        let output_values = write_access.as_slice_mut()?;
        py.detach(|| convert(samples, output_values));
    }
    Ok(converted_array)
}
