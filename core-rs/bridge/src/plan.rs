//! Plans: how network and timeline are computed.

use std::sync::{Arc, Mutex, PoisonError};

use ergon_engine::interrupt;
use ergon_engine::plan::{
    self, Budget, Choice, ChoiceNumbers, Computation, Draft, LeftOutReason, ModeKind, PlanContext, TrialStore,
};
use ergon_engine::scheme::StabilityGuarantee;
use pyo3::prelude::*;

use crate::error::{from_engine, module_error, parse_choice};
use crate::named::{AudibleError, FullRatePart, IslandChoice, ModeCount, TrialRecord, TrialWork};
use crate::network::Network;
use crate::timeline::Timeline;
use crate::words;
use crate::work::computing;

/// The fields of a `TrialRecord`: (numbers, counts, reason).
type PythonRecord = (Vec<Option<f64>>, Vec<Vec<u32>>, Option<String>);

/// A store of trial records that a Python object implements.
struct PythonStore {
    object: Py<PyAny>,
    /// The exception of the object, which ended the planning.
    raised_error: Mutex<Option<PyErr>>,
}

impl PythonStore {
    fn call<T: Default>(&self, call: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>) -> T {
        let call_outcome = Python::attach(|py| call(self.object.bind(py)));
        call_outcome.unwrap_or_else(|error| {
            *self.raised_error.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            interrupt::stop()
        })
    }
}

impl TrialStore for PythonStore {
    fn get(&self, key: &str) -> Option<plan::TrialRecord> {
        let stored_record: Option<PythonRecord> = self.call(|store| store.call_method1("get", (key,))?.extract());
        stored_record.map(|(numbers, counts, reason)| plan::TrialRecord {
            numbers,
            counts,
            reason,
        })
    }

    fn put(&self, key: &str, record: plan::TrialRecord) {
        let record = TrialRecord {
            numbers: record.numbers,
            counts: record.counts,
            reason: record.reason,
        };
        self.call(|store| store.call_method1("put", (key, record)).map(drop));
    }
}

/// How network and timeline are computed: the cheapest method for each island that is heard.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Plan(pub(crate) Arc<plan::Plan>);

#[pymethods]
impl Plan {
    #[new]
    #[allow(clippy::too_many_arguments)]
    #[pyo3(signature = (network, timeline, *, method=None, error_db=None, cents=None, upto=None, pins=None, store=None, like=None, share=1.0, draft=None, seen=Vec::new(), seen_every=1))]
    fn new(
        py: Python<'_>,
        network: &Network,
        timeline: &Timeline,
        method: Option<&str>,
        error_db: Option<f64>,
        cents: Option<f64>,
        upto: Option<f64>,
        pins: Option<Vec<ChoiceNumbers>>,
        store: Option<Py<PyAny>>,
        like: Option<&Self>,
        share: f64,
        draft: Option<(f64, f64)>,
        seen: Vec<String>,
        seen_every: u32,
    ) -> PyResult<Self> {
        timeline.check_network(network)?;
        let draft_budget = draft.map(|(db, share)| Ok::<_, PyErr>((budget(None, Some(db), None, None)?, share)));
        let draft_budget = draft_budget.transpose()?;
        let budget = budget(method, error_db, cents, upto)?;
        let network = Arc::new(network.0.clone());
        let pins = pins
            .map(|pins| pins.into_iter().map(Choice::from_numbers).collect())
            .transpose()
            .map_err(from_engine)?;
        let store = store.map(|object| PythonStore {
            object,
            raised_error: Mutex::default(),
        });
        let plan_result = computing(py, || {
            let context = PlanContext {
                earlier_plan: like.map(|like| &*like.0),
                trial_store: store.as_ref().map(|store| store as &dyn TrialStore),
                allowance_share: share,
                draft: draft_budget.as_ref().map(|(budget, share)| Draft {
                    budget,
                    allowance_share: *share,
                }),
                displayed_parts: &seen,
                displayed_frame_interval: seen_every.max(1),
            };
            plan::Plan::in_context(network, &timeline.inner, &budget, pins, context)
        });
        if let Some(store) = store
            && let Some(store_error) = store.raised_error.into_inner().unwrap_or_else(PoisonError::into_inner)
        {
            return Err(store_error);
        }
        plan_result?.map(|plan| Self(Arc::new(plan))).map_err(from_engine)
    }

    /// Every module stepped as written, with contacts computed several times a frame.
    #[staticmethod]
    fn with_fine_contacts(py: Python<'_>, network: &Network, timeline: &Timeline) -> PyResult<Self> {
        timeline.check_network(network)?;
        let network = Arc::new(network.0.clone());
        computing(py, || plan::Plan::with_fine_contacts(network, &timeline.inner))?
            .map(|plan| Self(Arc::new(plan)))
            .map_err(from_engine)
    }

    /// The parts of the plan.
    fn rows(&self) -> Vec<PlanRow> {
        self.0.rows().iter().map(PlanRow::from_row).collect()
    }

    /// The parts that are computed although nobody hears them, because somebody looks at them.
    fn seen(&self) -> Vec<PlanRow> {
        self.0.displayed_rows().iter().map(PlanRow::from_row).collect()
    }

    /// The decisions, island by island.
    fn choices(&self) -> Vec<IslandChoice> {
        let named_choice = |choice: &Choice| {
            let (modules, oversampling, contact_substeps, bodies, counted_cost, contact_order) = choice.numbers();
            IslandChoice {
                modules,
                oversampling,
                contact_substeps,
                bodies,
                counted_cost,
                contact_order,
            }
        };
        self.0.choices().iter().map(named_choice).collect()
    }

    /// The parts with their own rate that are nevertheless computed at every frame, and why.
    fn stay(&self) -> Vec<FullRatePart> {
        let full_rate_parts = self.0.refused_rates().iter().cloned();
        full_rate_parts.map(|(name, why)| FullRatePart { name, why }).collect()
    }

    /// Work of its trials, and the most allowed, by the table of costs [s].
    #[getter]
    fn trials(&self) -> TrialWork {
        let (done, allowed) = self.0.trial_seconds();
        TrialWork { done, allowed }
    }

    /// A hash of the decisions (64 hex digits).
    #[getter]
    fn hash(&self) -> String {
        self.0.hash()
    }
}

fn budget(method: Option<&str>, error: Option<f64>, cents: Option<f64>, upto: Option<f64>) -> PyResult<Budget> {
    let check_number = |name: &str, value: f64, is_allowed: bool| {
        if value.is_finite() && is_allowed {
            Ok(value)
        } else {
            Err(module_error("accuracy", format!("{name} cannot be {value}")))
        }
    };
    match (method, error, cents, upto) {
        (None, None, None, None) => Ok(Budget::default()),
        (Some(method), None, None, None) => Ok(Budget::Method(parse_choice("method", method, words::PLAN_METHODS)?)),
        (None, Some(db), None, None) => Ok(Budget::Error(check_number("error_db", db, db < 0.0)?)),
        (None, None, Some(cents), upto) => {
            let cents = check_number("cents", cents, cents > 0.0)?;
            let upto = upto.unwrap_or(plan::PITCH_HERTZ_MAX);
            let upto = check_number("upto", upto, upto > 0.0)?;
            Ok(Budget::Cents {
                cents,
                frequency_hz_max: upto,
            })
        }
        _ => Err(module_error(
            "accuracy",
            "only one of method, error_db and cents (with upto) may be given",
        )),
    }
}

/// A part of a plan: what is computed together, and how; or what is not computed, and why.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct PlanRow {
    parts: Vec<String>,
    n_mat: usize,
    n_lia: usize,
    what: &'static str,
    modes: Option<ModeCount>,
    left_out_db: Option<f64>,
    oversampling: u32,
    every: u32,
    contact_substeps: usize,
    contact_order: u32,
    error_db: Option<f64>,
    error_s: Option<f64>,
    spectral_db: Option<f64>,
    audible: Option<AudibleError>,
    cost: f64,
    guarantee: Option<&'static str>,
    because: Option<String>,
    macrostep: Option<u32>,
    radius: Option<f64>,
    preserved: bool,
    stays: Option<String>,
    offered: bool,
    reference: bool,
    cut_short: bool,
    drafted: bool,
    diverges: bool,
    harder_at: Option<f64>,
    unchecked_from: Option<f64>,
}

/// Parts that a row names; the others are counted.
const PARTS_NAMED: usize = 4;

#[pymethods]
impl PlanRow {
    /// `<PlanRow k1 + bell: stepped, 12 MATs, 14 LIAs, -36.2 dB, cost 6.3e-3>`
    fn __repr__(&self) -> String {
        let mut part_names = self.parts[..self.parts.len().min(PARTS_NAMED)].join(" + ");
        if self.parts.len() > PARTS_NAMED {
            part_names += &format!(" + {} more", self.parts.len() - PARTS_NAMED);
        }
        let error_text = self.error_db.map_or(String::new(), |db| format!(", {db:.1} dB"));
        format!(
            "<PlanRow {part_names}: {}, {} MATs, {} LIAs{error_text}, cost {:.2e}>",
            self.what, self.n_mat, self.n_lia, self.cost
        )
    }
}

impl PlanRow {
    fn from_row(row: &plan::PlanRow) -> Self {
        let (what, modes, left_out_db) = match row.computation {
            Computation::Stepped => ("stepped", None, None),
            Computation::Mesh(method, _) => (method, None, None),
            Computation::Slow { is_exact: true, .. } => ("e4", None, None),
            Computation::Slow { .. } => ("stepped", None, None),
            Computation::Oscillators => ("oscillators", None, None),
            Computation::Modes {
                kind,
                n_modes: n_total,
                n_computed,
                left_out_db: left_out,
            } => {
                let what = match kind {
                    ModeKind::Normal => "modes",
                    ModeKind::Complex => "complex modes",
                };
                let mode_count = ModeCount {
                    computed: n_computed,
                    total: n_total,
                };
                (what, Some(mode_count), left_out)
            }
            Computation::LeftOut(LeftOutReason::Unheard) => ("unheard", None, None),
            Computation::LeftOut(LeftOutReason::Motionless) => ("still", None, None),
        };
        Self {
            parts: row.parts.clone(),
            n_mat: row.n_mats,
            n_lia: row.n_links,
            what,
            modes,
            left_out_db,
            oversampling: match row.computation {
                Computation::Mesh(_, substeps) => row.oversampling * substeps,
                _ => row.oversampling,
            },
            every: row.frame_interval,
            contact_substeps: row.contact_substeps,
            contact_order: row.contact_order,
            error_db: row.error.map(|error| error.waveform_db),
            error_s: row.error.map(|error| error.duration_seconds),
            spectral_db: row.error.and_then(|error| error.third_octave_db),
            audible: row.error.and_then(|error| error.audible).map(|audible| AudibleError {
                cents: audible.cents,
                t60: audible.t60,
                third_octave_db: audible.level,
                first_stroke_s: audible.first_stroke,
                later_stroke_s: audible.later_stroke,
                stroke_db: audible.stroke_level,
            }),
            cost: row.work_per_second,
            guarantee: row.stability.map(|word| match word {
                StabilityGuarantee::Proved => "proved",
                StabilityGuarantee::Guarded => "guarded",
                StabilityGuarantee::Tried => "tried",
            }),
            because: row.modes_refusal.clone(),
            // The engine's `every` counts steps; `macrostep` counts frames.
            macrostep: match row.computation {
                Computation::Slow { macrostep, .. } => Some(macrostep / row.oversampling.max(1)),
                _ => None,
            },
            radius: row.kick_growth_factor,
            preserved: row.is_preserved(),
            stays: row.rate_refusal.clone(),
            offered: row.is_slow_by_plan,
            reference: row.is_discrete_reference,
            cut_short: row.trials_cut_short,
            drafted: row.is_drafted,
            diverges: row.has_diverged,
            harder_at: row.harder_event_time,
            unchecked_from: row.unchecked_from_seconds,
        }
    }
}
