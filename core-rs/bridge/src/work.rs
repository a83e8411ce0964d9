//! Work that can be stopped: by Ctrl-C, by a limit of its steps, or by another thread.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use ergon_engine::interrupt::{self, StopQuery};
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    ergon._core,
    StoppedError,
    PyException,
    "A computation was ended before it was done; `why` is 'costly' or 'cancelled'."
);

/// Time between two checks of limits and signals; a check of signals takes the GIL.
const CHECK_INTERVAL: Duration = Duration::from_millis(20);

/// A limit on the work of a thread: a number of steps ([`interrupt::spend`]), or a cancellation.
#[derive(Debug)]
struct WorkLimit {
    steps_max: Option<u64>,
    /// The steps of computations that have ended, and of Python.
    steps_spent: AtomicU64,
    /// Set by [`Work::cancel`].
    is_cancelled: Arc<AtomicBool>,
}

impl WorkLimit {
    /// Why the work must end, of which a computation has `uncounted_steps` steps; None if it may go on.
    fn stop_reason(&self, uncounted_steps: u64) -> Option<&'static str> {
        if self.is_cancelled.load(Ordering::Relaxed) {
            return Some("cancelled");
        }
        let steps_spent = self.steps_spent.load(Ordering::Relaxed).saturating_add(uncounted_steps);
        self.steps_max
            .is_some_and(|steps_max| steps_spent > steps_max)
            .then_some("costly")
    }
}

thread_local! {
    /// The limits of this thread, the innermost last.
    static WORK_LIMITS: RefCell<Vec<Arc<WorkLimit>>> = const { RefCell::new(Vec::new()) };
}

/// Why the work of a thread must end, of which a computation has `uncounted_steps` steps; None if it may go on.
fn stop_reason(limits: &[Arc<WorkLimit>], uncounted_steps: u64) -> Option<&'static str> {
    limits.iter().find_map(|limit| limit.stop_reason(uncounted_steps))
}

/// Count steps of work that is done.
fn count_steps(limits: &[Arc<WorkLimit>], steps: u64) {
    for limit in limits {
        limit.steps_spent.fetch_add(steps, Ordering::Relaxed);
    }
}

fn stopped_error(cause: &'static str) -> PyErr {
    let message = match cause {
        "costly" => "the computation exceeded its limit of steps",
        _ => "the computation was cancelled",
    };
    let stopped_error = StoppedError::new_err(message);
    let set_result = Python::attach(|py| stopped_error.value(py).setattr("why", cause));
    set_result.err().unwrap_or(stopped_error)
}

/// A limit for the computations of one thread, a context manager: work ends after `steps` of about a nanosecond, which
/// are counted, not timed, or once it is cancelled.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Work {
    steps_max: Option<u64>,
    is_cancelled: Arc<AtomicBool>,
}

#[pymethods]
impl Work {
    #[new]
    #[pyo3(signature = (steps=None))]
    fn new(steps: Option<u64>) -> Self {
        Self {
            steps_max: steps,
            is_cancelled: Arc::default(),
        }
    }

    /// Cancel the work, from any thread, also before it is entered.
    fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }

    fn __enter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        let entered_work = slf.get();
        let work_limit = Arc::new(WorkLimit {
            steps_max: entered_work.steps_max,
            steps_spent: AtomicU64::new(0),
            is_cancelled: entered_work.is_cancelled.clone(),
        });
        WORK_LIMITS.with_borrow_mut(|limits| limits.push(work_limit));
        slf
    }

    #[pyo3(signature = (*_how))]
    fn __exit__(&self, _how: &Bound<'_, pyo3::types::PyTuple>) {
        WORK_LIMITS.with_borrow_mut(|limits| {
            let is_same_limit = |limit: &Arc<WorkLimit>| Arc::ptr_eq(&limit.is_cancelled, &self.is_cancelled);
            if let Some(innermost) = limits.iter().rposition(is_same_limit) {
                limits.remove(innermost);
            }
        });
    }
}

/// Count steps of work in Python, and raise StoppedError if this thread is within a Work that ends; for long loops in
/// Python, which Ctrl-C interrupts by itself.
#[pyfunction]
#[pyo3(signature = (steps=0))]
pub(crate) fn poll(steps: u64) -> PyResult<()> {
    let end_reason = WORK_LIMITS.with_borrow(|limits| {
        count_steps(limits, steps);
        stop_reason(limits, 0)
    });
    match end_reason {
        Some(end_reason) => Err(stopped_error(end_reason)),
        None => Ok(()),
    }
}

/// Run `compute` without the GIL, until a limit of this thread is reached or a signal's handler raises.
/// Whether a limit is reached depends on the steps alone, also where it is looked at less often.
///
/// Fails with StoppedError, or with the exception of the handler. An object that `compute` was changing is then in an
/// undefined state.
pub(crate) fn computing<T: Send>(py: Python<'_>, compute: impl FnOnce() -> T + Send) -> PyResult<T> {
    poll(0)?; // a computation shorter than CHECK_INTERVAL never checks by itself
    let (raised_error, steps_spent) = (Arc::new(Mutex::new(None)), Arc::<AtomicU64>::default());
    let work_limits = WORK_LIMITS.with_borrow(Clone::clone);
    let (error_slot, step_counter, checked_limits) = (raised_error.clone(), steps_spent.clone(), work_limits.clone());
    let work_outcome = py.detach(move || {
        let should_stop = stop_check(checked_limits, step_counter.clone(), error_slot);
        interrupt::until_counted(should_stop, step_counter, compute)
    });
    count_steps(&work_limits, steps_spent.load(Ordering::Relaxed));
    let work_outcome = work_outcome.map_err(|interrupt::Stopped| {
        let mut raised_error = raised_error.lock().unwrap_or_else(PoisonError::into_inner);
        raised_error.take().unwrap_or_else(|| stopped_error("cancelled"))
    })?;
    poll(0)?;
    Ok(work_outcome)
}

fn stop_check(
    limits: Vec<Arc<WorkLimit>>,
    step_counter: Arc<AtomicU64>,
    error_slot: Arc<Mutex<Option<PyErr>>>,
) -> StopQuery {
    let mut next_check = Instant::now() + CHECK_INTERVAL;
    Box::new(move || {
        let check_time = Instant::now();
        if check_time < next_check {
            return false;
        }
        next_check = check_time + CHECK_INTERVAL;
        let stop_error = match stop_reason(&limits, step_counter.load(Ordering::Relaxed)) {
            Some(reason) => Some(stopped_error(reason)),
            // Signal handlers run only in the main thread; in other threads this does nothing.
            None => Python::attach(|py| py.check_signals()).err(),
        };
        let must_stop = stop_error.is_some();
        if must_stop {
            *error_slot.lock().unwrap_or_else(PoisonError::into_inner) = stop_error;
        }
        must_stop
    })
}
