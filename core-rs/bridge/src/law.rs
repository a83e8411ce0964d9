//! LNL laws.

use ergon_engine::law;
use pyo3::prelude::*;
use pyo3::types::PyMapping;

use crate::error::from_law;

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
        let text = law::LawText {
            law: expression,
            damping,
            constants: constants.into_iter().collect(),
            points: points.as_deref(),
        };
        let law = py.detach(|| law::Law::new(&text)?.through(reach));
        law.map(Self).map_err(from_law)
    }

    /// Force at elongation d [m] and its rate v [m/s].
    #[pyo3(signature = (d, v=0.0))]
    fn force(&self, d: f64, v: f64) -> f64 {
        self.0.force(d, v)
    }

    /// Energy stored at elongation d [J]; zero at d = 0.
    fn potential(&self, d: f64) -> f64 {
        self.0.potential(d)
    }

    /// Whether damping·v < 0 somewhere in |d| <= d_max, |v| <= v_max: the link can give energy.
    fn is_active(&self, d_max: f64, v_max: f64) -> bool {
        self.0.is_active(d_max, v_max)
    }
}
