//! LNL laws.

use ergon_engine::law;
use numpy::{PyReadonlyArray1, PyReadwriteArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyMapping;

use crate::error::from_law;
use crate::named::{LawFunction, LawRow};

/// An LNL law: `f = expression(d) + damping(d, v)`, or straight lines through `points`.
#[pyclass(frozen, module = "ergon._core")]
#[derive(Clone)]
pub(crate) struct Law(pub(crate) law::Law);

#[pymethods]
impl Law {
    #[new]
    #[pyo3(signature = (expression=None, damping=None, constants=None, points=None, reach=1.0))]
    fn new(
        py: Python<'_>,
        expression: Option<&str>,
        damping: Option<&str>,
        constants: Option<&Bound<'_, PyMapping>>,
        points: Option<Vec<(f64, f64)>>,
        reach: f64,
    ) -> PyResult<Self> {
        let constants = match constants {
            Some(constants) => constants.items()?.extract::<Vec<(String, f64)>>()?,
            None => Vec::new(),
        };
        let law_text = law::LawText {
            law: expression,
            damping,
            constants: constants.into_iter().collect(),
            points: points.as_deref(),
            ..law::LawText::default()
        };
        let parsed_law = py.detach(|| law::Law::new(&law_text)?.behind_lever(reach));
        parsed_law.map(Self).map_err(from_law)
    }

    /// Force at elongation d [m] and its rate v [m/s].
    #[pyo3(signature = (d, v=0.0))]
    fn force(&self, d: f64, v: f64) -> f64 {
        self.0.force(d, v)
    }

    /// Stored energy [J] at elongation d [m]; zero at d = 0.
    fn potential(&self, d: f64) -> f64 {
        self.0.potential(d)
    }

    /// Whether the link can give energy: damping·v < 0 somewhere in |d| <= d_max, |v| <= v_max.
    fn is_active(&self, d_max: f64, v_max: f64) -> bool {
        self.0.is_active(d_max, v_max)
    }

    /// The operations, in order; None for `points`.
    fn rows(&self) -> Option<Vec<LawRow>> {
        let operation_rows = self.0.rows()?;
        Some(operation_rows.iter().map(named_row).collect())
    }

    /// The same law, computed by native code of its rows at `address`.
    fn native(&self, address: usize) -> PyResult<Self> {
        if address == 0 || self.0.rows().is_none() {
            return Err(PyValueError::new_err("this law has no native code"));
        }
        let mut native_law = self.0.clone();
        // SAFETY: `ergon.instruments.native`, the only caller, passes what was compiled of these rows.
        unsafe { native_law.set_native(entry(address)) };
        Ok(Self(native_law))
    }

    /// Write forces [N] for elongations d [m] and their rates v [m/s] into `out`, all (n_links,); computed `times`
    /// times.
    #[pyo3(signature = (d, v, out, times=1))]
    fn forces(
        &self,
        py: Python<'_>,
        d: PyReadonlyArray1<'_, f64>,
        v: PyReadonlyArray1<'_, f64>,
        mut out: PyReadwriteArray1<'_, f64>,
        times: usize,
    ) -> PyResult<()> {
        let (d, v, out) = (d.as_slice()?, v.as_slice()?, out.as_slice_mut()?);
        if d.len() != out.len() || v.len() != out.len() {
            return Err(PyValueError::new_err("d, v and out must have the same length"));
        }
        py.detach(|| {
            let mut scratch = self.0.scratch();
            for _ in 0..times {
                self.0.eval_run(d, v, std::hint::black_box(&mut *out), &mut scratch);
            }
        });
        Ok(())
    }
}

pub(crate) fn named_row(row: &law::Row) -> LawRow {
    let [a, b, c] = row.operands;
    LawRow {
        operation: row.operation,
        a,
        b,
        c,
    }
}

/// The native code at `address` as a function.
///
/// # Safety
/// Machine code with the signature of [`law::Entry`] begins at `address`, which is not 0.
pub(crate) unsafe fn entry(address: usize) -> law::Entry {
    // SAFETY: as above.
    unsafe { std::mem::transmute(address) }
}

/// The functions of the core, with their addresses, that native code of a law calls.
#[pyfunction]
pub(crate) fn law_functions() -> Vec<LawFunction> {
    let functions = law::FUNCTIONS.iter();
    functions
        .map(|(name, function)| LawFunction {
            name,
            address: *function as usize,
        })
        .collect()
}
