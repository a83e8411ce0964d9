//! Interruption of long computations.
//!
//! A computation runs inside [`until`], which gets a function that says whether to stop. It calls [`poll`] after every
//! few milliseconds of work; if the function then returns true, it unwinds to [`until`]. In a thread outside [`until`],
//! such as the one that plays, a poll only reads a thread-local flag. Threads that share a computation
//! ([`on_threads`]) end with it.
//!
//! A computation also counts its work ([`spend`]) in steps of about a nanosecond on a machine of 2024: the entries of
//! matrices that it visits, and its visits of modules. The count is the same on every machine, however busy it is.

use std::cell::{Cell, RefCell};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

/// Steps of a long loop from poll to poll, of less than a microsecond each.
const POLL_STEPS: usize = 4096;
/// Steps of work after which a computation is asked again: some 65 microseconds. Reading a clock takes as long as a
/// short loop.
const QUERY_STEPS: usize = VISIT_STEPS * POLL_STEPS;
/// Steps that a visit of a module counts.
const VISIT_STEPS: usize = 16;
/// Time between two polls of a thread that waits for others.
const POLL_INTERVAL: Duration = Duration::from_millis(5);

/// Returns whether the computation is to stop. It is called in the thread that computes.
pub type StopQuery = Box<dyn FnMut() -> bool>;

/// The computation was stopped before its end: whatever it was changing is in an undefined state.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Stopped;

thread_local! {
    static HAS_STOP_QUERY: Cell<bool> = const { Cell::new(false) };
    /// Steps since the last time it was asked.
    static STEPS_SINCE_QUERY: Cell<usize> = const { Cell::new(0) };
    static STOP_QUERY: RefCell<Option<StopQuery>> = const { RefCell::new(None) };
    /// The count of this thread's computation.
    static SPENT_STEPS: RefCell<Arc<AtomicU64>> = RefCell::default();
}

/// On drop, restores the count of an outer computation.
struct OuterCount(Arc<AtomicU64>);

impl Drop for OuterCount {
    fn drop(&mut self) {
        SPENT_STEPS.set(std::mem::take(&mut self.0));
    }
}

/// On drop, restores the `StopQuery` of an outer computation.
struct OuterQuery(Option<StopQuery>);

impl Drop for OuterQuery {
    fn drop(&mut self) {
        replace_query(self.0.take());
    }
}

fn replace_query(stop_query: Option<StopQuery>) -> Option<StopQuery> {
    HAS_STOP_QUERY.set(stop_query.is_some());
    STOP_QUERY.replace(stop_query)
}

/// Run `work` to its end, or until `stop_query` returns true at one of its polls ([`poll`]).
///
/// ```
/// use ergon_engine::interrupt::{Stopped, poll, until};
///
/// assert_eq!(until(Box::new(|| false), || 6 * 7), Ok(42));
/// let endless = || loop {
///     poll();
/// };
/// assert_eq!(until(Box::new(|| true), endless), Err::<(), _>(Stopped));
/// ```
///
/// # Errors
/// [`Stopped`] if `stop_query` returns true at a poll of `work`.
pub fn until<T>(stop_query: StopQuery, work: impl FnOnce() -> T) -> Result<T, Stopped> {
    until_counted(stop_query, Arc::default(), work)
}

/// [`until`], with the count of steps that `work` spends.
///
/// # Errors
/// [`Stopped`] if `stop_query` returns true at a poll of `work`.
pub fn until_counted<T>(
    stop_query: StopQuery,
    spent_steps: Arc<AtomicU64>,
    work: impl FnOnce() -> T,
) -> Result<T, Stopped> {
    let _count = OuterCount(SPENT_STEPS.replace(spent_steps));
    let outer_query = OuterQuery(replace_query(Some(stop_query)));
    let work_result = catch_unwind(AssertUnwindSafe(work));
    drop(outer_query);
    work_result.or_else(|payload| match payload.downcast::<Stopped>() {
        Ok(stopped) => Err(*stopped),
        Err(panic) => resume_unwind(panic),
    })
}

/// Unwind if this computation is to stop. Call it only where an unwinding leaves nothing half-done outside this
/// computation.
#[inline]
pub fn poll() {
    if HAS_STOP_QUERY.get() {
        query_stop();
    }
}

/// Count steps of work that follows or is done, and [`poll`] after some.
#[inline]
pub fn spend(steps: usize) {
    if HAS_STOP_QUERY.get() {
        count(steps);
        let steps_since_query = STEPS_SINCE_QUERY.get().saturating_add(steps);
        if steps_since_query < QUERY_STEPS {
            STEPS_SINCE_QUERY.set(steps_since_query);
        } else {
            STEPS_SINCE_QUERY.set(0);
            query_stop();
        }
    }
}

#[cold]
fn count(steps: usize) {
    SPENT_STEPS.with_borrow(|spent| spent.fetch_add(steps as u64, Ordering::Relaxed));
}

/// Count a step over `n` modules, and [`poll`] if it takes longer than polls should.
#[inline]
pub fn poll_for(n: usize) {
    if HAS_STOP_QUERY.get() {
        count(n);
        if n >= POLL_STEPS {
            query_stop();
        }
    }
}

/// The numbers of a range, with a [`poll`] at every 4,096th: for loops over all modules of a network.
#[inline]
pub fn steps(range: Range<usize>) -> impl Iterator<Item = usize> + Clone {
    let range_end = range.end;
    range.inspect(move |&step| {
        if step.is_multiple_of(POLL_STEPS) {
            spend(VISIT_STEPS * POLL_STEPS.min(range_end - step));
        }
    })
}

/// The items of a list, with a [`poll`] at every 4,096th.
#[inline]
pub fn polled_items<T>(items: &[T]) -> impl Iterator<Item = &T> + Clone {
    items.iter().zip(0_usize..).map(|(item, step)| {
        if step.is_multiple_of(POLL_STEPS) {
            spend(VISIT_STEPS * POLL_STEPS.min(items.len() - step));
        }
        item
    })
}

/// Run `work` on `threads` threads, of which this is one, and wait for all. Where this computation is to stop, the
/// others end at their next poll as well.
pub fn on_threads(threads: usize, work: impl Fn() + Sync) {
    let is_over = Arc::new(AtomicBool::new(false));
    let has_stop_query = HAS_STOP_QUERY.get();
    let spent_steps = SPENT_STEPS.with_borrow(Arc::clone);
    let leader_thread = thread::current();
    thread::scope(|scope| {
        let _end = FlagOnDrop(&is_over); // dropped before the scope waits, also where this thread unwinds
        let helper = || {
            let is_over = is_over.clone();
            let stop_query = Box::new(move || is_over.load(Ordering::Relaxed));
            if has_stop_query {
                let _ = until_counted(stop_query, spent_steps.clone(), &work); // stopped only where the leader unwinds
            } else {
                work();
            }
            leader_thread.unpark();
        };
        let helpers: Vec<_> = (1..threads).map(|_| scope.spawn(helper)).collect();
        work();
        while has_stop_query && !helpers.iter().all(thread::ScopedJoinHandle::is_finished) {
            poll();
            thread::park_timeout(POLL_INTERVAL);
        }
        for helper in helpers {
            if let Err(panic_payload) = helper.join() {
                resume_unwind(panic_payload);
            }
        }
    });
}

/// On drop, tells other threads that the computation is over.
struct FlagOnDrop<'a>(&'a AtomicBool);

impl Drop for FlagOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Unwind to [`until`] without asking.
pub fn stop() -> ! {
    resume_unwind(Box::new(Stopped)) // no panic: nothing is printed
}

#[cold]
fn query_stop() {
    // `stop_query` may itself run a computation inside another [`until`].
    let Some(mut ask) = replace_query(None) else { return };
    let must_stop = ask();
    replace_query(Some(ask));
    if must_stop {
        stop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask_until(n: usize) -> (StopQuery, std::rc::Rc<Cell<usize>>) {
        let poll_count = std::rc::Rc::new(Cell::new(0));
        let counter = poll_count.clone();
        let stop_query = move || {
            counter.set(counter.get() + 1);
            counter.get() == n
        };
        (Box::new(stop_query), poll_count)
    }

    #[test]
    fn until_ends_at_the_first_positive_poll() {
        let (stop_query, poll_count) = ask_until(3);
        let loops_done = Cell::new(0);
        let work_result = until(stop_query, || {
            loop {
                poll();
                loops_done.set(loops_done.get() + 1);
            }
        });
        assert_eq!(work_result, Err::<(), _>(Stopped));
        assert_eq!((loops_done.get(), poll_count.get()), (2, 3));
    }

    #[test]
    fn until_polls_only_within_its_computation() {
        let (stop_query, poll_count) = ask_until(1);
        assert_eq!(until(stop_query, || 7), Ok(7));
        poll();
        assert_eq!(poll_count.get(), 0);
    }

    #[test]
    fn until_with_an_inner_computation() {
        let (outer_query, poll_count) = ask_until(2);
        let outer_result = until(outer_query, || {
            poll();
            let (inner_query, _) = ask_until(1);
            assert_eq!(until(inner_query, poll), Err(Stopped));
            poll();
        });
        assert_eq!((outer_result, poll_count.get()), (Err(Stopped), 2));
    }

    #[test]
    fn steps_and_each_poll_once_in_a_stride() {
        for n in [0, 1, POLL_STEPS, POLL_STEPS + 1, 3 * POLL_STEPS] {
            let seven_list = vec![7; n];
            for work in [
                (&|| assert_eq!(steps(0..n).count(), n)) as &dyn Fn(),
                &|| assert_eq!(polled_items(&seven_list).sum::<i32>(), 7 * n as i32),
                &|| (0..n).for_each(|at| assert_eq!(steps(at..at).count(), 0)),
            ] {
                let (stop_query, poll_count) = ask_until(usize::MAX);
                assert_eq!(until(stop_query, work), Ok(()));
                assert!([0, n / POLL_STEPS].contains(&poll_count.get()));
            }
        }
    }

    #[test]
    fn on_threads_ends_with_its_computation() {
        for last_poll in [1, 2, 40] {
            let (stop_query, poll_count) = ask_until(last_poll);
            let others_polled = AtomicBool::new(false);
            let leader_id = thread::current().id();
            let endless = || {
                while thread::current().id() != leader_id {
                    poll();
                    others_polled.store(true, Ordering::Relaxed);
                    thread::yield_now();
                }
                while !others_polled.load(Ordering::Relaxed) {
                    thread::yield_now();
                }
            };
            assert_eq!(until(stop_query, || on_threads(3, endless)), Err(Stopped));
            assert_eq!(poll_count.get(), last_poll);
        }
    }

    #[test]
    fn on_threads_without_a_computation_runs_each_thread() {
        let run_count = std::sync::atomic::AtomicUsize::new(0);
        on_threads(4, || {
            poll();
            run_count.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!(run_count.into_inner(), 4);
    }

    #[test]
    fn on_threads_passes_a_panic_on() {
        let leader_id = thread::current().id();
        let leader_work = || assert_eq!(thread::current().id(), leader_id, "another thread");
        for is_asked in [true, false] {
            let run_threads = || on_threads(2, leader_work);
            let panicked = catch_unwind(AssertUnwindSafe(|| {
                if is_asked {
                    let _ = until(Box::new(|| false), run_threads);
                } else {
                    run_threads();
                }
            }));
            assert!(panicked.is_err());
        }
    }

    #[test]
    fn until_passes_a_panic_on() {
        let (stop_query, _) = ask_until(9);
        let panicked = catch_unwind(AssertUnwindSafe(|| until(stop_query, || panic!("other"))));
        assert!(panicked.is_err());
    }
}
