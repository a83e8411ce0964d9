//! numpy, loaded before the core is given its first array; arrays of numbers.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use numpy::{Complex64, Element, IntoPyArray, PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

/// Load numpy and its interface for C, once, in a thread of its own.
///
/// Handlers of signals run in the main thread alone. There one that raises would end the import, and what looks for the
/// interface panics.
pub(crate) fn load_numpy(py: Python<'_>) {
    static IS_LOADED: AtomicBool = AtomicBool::new(false);
    if IS_LOADED.swap(true, Ordering::Relaxed) {
        return;
    }
    let load = || {
        Python::attach(|py| {
            let array = PyArray1::<f64>::zeros(py, 1, false);
            drop(array.readonly()); // its check of borrows is looked for as well
        });
    };
    // Without a thread, or where numpy cannot be loaded, the first array says so.
    let _ = py.detach(|| {
        thread::Builder::new()
            .spawn(load)
            .map(thread::JoinHandle::join)
    });
}

/// An array of complex numbers.
#[derive(Clone)]
pub(crate) struct Complexes {
    pub(crate) values: Vec<Complex64>,
    pub(crate) shape: Vec<usize>,
}

impl<'py> IntoPyObject<'py> for Complexes {
    type Target = PyArrayDyn<Complex64>;
    type Output = Bound<'py, Self::Target>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Self::Output> {
        self.values.into_pyarray(py).reshape(self.shape)
    }
}

/// A row of numbers.
#[derive(Clone)]
pub(crate) struct Numbers<T>(pub(crate) Vec<T>);

impl<'py, T: Element> IntoPyObject<'py> for Numbers<T> {
    type Target = PyArray1<T>;
    type Output = Bound<'py, Self::Target>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Self::Output> {
        Ok(self.0.into_pyarray(py))
    }
}
