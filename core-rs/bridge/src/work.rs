//! Work that can be stopped: by Ctrl-C, by a time limit, or by another thread.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use ergon_engine::interrupt::{self, Ask};
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    ergon._core,
    StoppedError,
    PyException,
    "A computation was ended before it was done; `why` is 'late' or 'cancelled'."
);

/// Time between two checks of limits and signals; a check of signals takes the GIL.
const CHECK_INTERVAL: Duration = Duration::from_millis(20);
/// Longest time limit [s]; a longer one is shortened.
const SECONDS_MAX: f64 = 1e6;

/// A limit on the work of a thread: a time limit, or a cancellation.
#[derive(Debug)]
struct Limit {
    until: Option<Instant>,
    /// Set by [`Work::cancel`].
    is_cancelled: Arc<AtomicBool>,
}

impl Limit {
    /// Why the work must end; None if it may go on.
    fn why(&self) -> Option<&'static str> {
        if self.is_cancelled.load(Ordering::Relaxed) {
            return Some("cancelled");
        }
        let is_late = self.until.is_some_and(|until| Instant::now() >= until);
        is_late.then_some("late")
    }
}

thread_local! {
    /// The limits of this thread, the innermost last.
    static LIMITS: RefCell<Vec<Arc<Limit>>> = const { RefCell::new(Vec::new()) };
}

/// Why the work of this thread must end; None if it may go on.
fn stop_reason(limits: &[Arc<Limit>]) -> Option<&'static str> {
    limits.iter().find_map(|limit| limit.why())
}

fn stopped(why: &'static str) -> PyErr {
    let message = match why {
        "late" => "the computation exceeded its time limit",
        _ => "the computation was cancelled",
    };
    let error = StoppedError::new_err(message);
    let set = Python::attach(|py| error.value(py).setattr("why", why));
    set.err().unwrap_or(error)
}

/// A limit for the computations of one thread, a context manager: work ends `seconds` [s] after it was entered, or once
/// it is cancelled.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Work {
    seconds: Option<f64>,
    is_cancelled: Arc<AtomicBool>,
}

#[pymethods]
impl Work {
    #[new]
    #[pyo3(signature = (seconds=None))]
    fn new(seconds: Option<f64>) -> Self {
        Self {
            seconds,
            is_cancelled: Arc::default(),
        }
    }

    /// Cancel the work, from any thread, also before it is entered.
    fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }

    fn __enter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        let own = slf.get();
        let until = own.seconds.map(|seconds| {
            // 0 for NaN too.
            let seconds = if seconds > 0.0 {
                seconds.min(SECONDS_MAX)
            } else {
                0.0
            };
            Instant::now() + Duration::from_secs_f64(seconds)
        });
        let limit = Arc::new(Limit {
            until,
            is_cancelled: own.is_cancelled.clone(),
        });
        LIMITS.with_borrow_mut(|limits| limits.push(limit));
        slf
    }

    #[pyo3(signature = (*_how))]
    fn __exit__(&self, _how: &Bound<'_, pyo3::types::PyTuple>) {
        LIMITS.with_borrow_mut(|limits| {
            let own = |limit: &Arc<Limit>| Arc::ptr_eq(&limit.is_cancelled, &self.is_cancelled);
            if let Some(innermost) = limits.iter().rposition(own) {
                limits.remove(innermost);
            }
        });
    }
}

/// Raise StoppedError if this thread is within a Work that ends; for long loops in Python, which Ctrl-C interrupts by
/// itself.
#[pyfunction]
pub(crate) fn poll() -> PyResult<()> {
    match LIMITS.with_borrow(|limits| stop_reason(limits)) {
        Some(why) => Err(stopped(why)),
        None => Ok(()),
    }
}

/// Run `compute` without the GIL, until a limit of this thread is reached or a signal's handler raises.
///
/// Fails with StoppedError, or with the exception of the handler. An object that `compute` was changing is then in an
/// undefined state.
pub(crate) fn computing<T: Send>(
    py: Python<'_>,
    compute: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    poll()?; // a computation shorter than CHECK_INTERVAL never checks by itself
    let raised = Arc::new(Mutex::new(None));
    let limits = LIMITS.with_borrow(Clone::clone);
    let to_raise = raised.clone();
    py.detach(move || interrupt::until(stop_check(limits, to_raise), compute))
        .map_err(|interrupt::Stopped| {
            let mut raised = raised.lock().unwrap_or_else(PoisonError::into_inner);
            raised.take().unwrap_or_else(|| stopped("cancelled"))
        })
}

fn stop_check(limits: Vec<Arc<Limit>>, raised: Arc<Mutex<Option<PyErr>>>) -> Ask {
    let mut next = Instant::now() + CHECK_INTERVAL;
    Box::new(move || {
        let now = Instant::now();
        if now < next {
            return false;
        }
        next = now + CHECK_INTERVAL;
        let why = match stop_reason(&limits) {
            Some(why) => Some(stopped(why)),
            // Signal handlers run only in the main thread; in other threads this does nothing.
            None => Python::attach(|py| py.check_signals()).err(),
        };
        let is_over = why.is_some();
        if is_over {
            *raised.lock().unwrap_or_else(PoisonError::into_inner) = why;
        }
        is_over
    })
}
