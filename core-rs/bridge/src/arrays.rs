//! Early import of numpy, and conversion of vectors to numpy arrays.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use numpy::{Complex64, Element, IntoPyArray, PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

/// Import numpy and its C interface, once, in a separate thread.
///
/// Signal handlers run only in the main thread. A handler that raises during the import there would abort it, and the
/// numpy crate panics if it cannot load the C interface.
pub(crate) fn load_numpy(py: Python<'_>) {
    static IS_LOADED: AtomicBool = AtomicBool::new(false);
    if IS_LOADED.swap(true, Ordering::Relaxed) {
        return;
    }
    let load_interface = || {
        Python::attach(|py| {
            let probe_array = PyArray1::<f64>::zeros(py, 1, false);
            drop(probe_array.readonly()); // also loads the shared borrow checker
        });
    };
    // If the thread cannot start or numpy cannot be loaded, the first use of an array reports the error.
    let _ = py.detach(|| {
        thread::Builder::new()
            .spawn(load_interface)
            .map(thread::JoinHandle::join)
    });
}

/// An array of complex numbers.
#[derive(Clone)]
pub(crate) struct ComplexArray {
    pub(crate) values: Vec<Complex64>,
    pub(crate) shape: Vec<usize>,
}

impl<'py> IntoPyObject<'py> for ComplexArray {
    type Target = PyArrayDyn<Complex64>;
    type Output = Bound<'py, Self::Target>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Self::Output> {
        self.values.into_pyarray(py).reshape(self.shape)
    }
}

/// A one-dimensional array of numbers.
#[derive(Clone)]
pub(crate) struct NumberArray<T>(pub(crate) Vec<T>);

impl<'py, T: Element> IntoPyObject<'py> for NumberArray<T> {
    type Target = PyArray1<T>;
    type Output = Bound<'py, Self::Target>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Self::Output> {
        Ok(self.0.into_pyarray(py))
    }
}
