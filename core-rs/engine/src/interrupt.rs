//! Interruption of long computations.
//!
//! A computation runs inside [`until`], which gets a function that says whether to stop. It calls [`poll`] after every
//! few milliseconds of work; if the function then returns true, it unwinds to [`until`]. In a thread outside [`until`],
//! such as the one that plays, a poll only reads a thread-local flag.

use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// Returns whether the computation is to stop. It is called in the thread that computes.
pub type Ask = Box<dyn FnMut() -> bool>;

/// The computation was stopped before its end: whatever it was changing is in an undefined state.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Stopped;

thread_local! {
    static IS_ASKED: Cell<bool> = const { Cell::new(false) };
    static ASK: RefCell<Option<Ask>> = const { RefCell::new(None) };
}

/// On drop, restores the `Ask` of an outer computation.
struct Outer(Option<Ask>);

impl Drop for Outer {
    fn drop(&mut self) {
        set(self.0.take());
    }
}

fn set(ask: Option<Ask>) -> Option<Ask> {
    IS_ASKED.set(ask.is_some());
    ASK.replace(ask)
}

/// Run `work` to its end, or until `ask` returns true at one of its polls ([`poll`]).
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
/// [`Stopped`] if `ask` returns true at a poll of `work`.
pub fn until<T>(ask: Ask, work: impl FnOnce() -> T) -> Result<T, Stopped> {
    let outer = Outer(set(Some(ask)));
    let done = catch_unwind(AssertUnwindSafe(work));
    drop(outer);
    done.or_else(|payload| match payload.downcast::<Stopped>() {
        Ok(stopped) => Err(*stopped),
        Err(panic) => resume_unwind(panic),
    })
}

/// Unwind if this computation is to stop. Call it only where an unwinding leaves nothing half-done outside this
/// computation.
#[inline]
pub fn poll() {
    if IS_ASKED.get() {
        ask();
    }
}

/// Unwind to [`until`] without asking.
pub fn stop() -> ! {
    resume_unwind(Box::new(Stopped)) // no panic: nothing is printed
}

#[cold]
fn ask() {
    // `ask` may itself run a computation inside another [`until`].
    let Some(mut ask) = set(None) else { return };
    let is_over = ask();
    set(Some(ask));
    if is_over {
        stop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(n: usize) -> (Ask, std::rc::Rc<Cell<usize>>) {
        let polls = std::rc::Rc::new(Cell::new(0));
        let own = polls.clone();
        let ask = move || {
            own.set(own.get() + 1);
            own.get() == n
        };
        (Box::new(ask), polls)
    }

    #[test]
    fn ends_at_the_poll_that_says_so() {
        let (ask, polls) = at(3);
        let done = Cell::new(0);
        let end = until(ask, || {
            loop {
                poll();
                done.set(done.get() + 1);
            }
        });
        assert_eq!(end, Err::<(), _>(Stopped));
        assert_eq!((done.get(), polls.get()), (2, 3));
    }

    #[test]
    fn asks_nobody_outside() {
        let (ask, polls) = at(1);
        assert_eq!(until(ask, || 7), Ok(7));
        poll();
        assert_eq!(polls.get(), 0);
    }

    #[test]
    fn an_inner_computation_has_its_own_question() {
        let (outer, polls) = at(2);
        let ended = until(outer, || {
            poll();
            let (inner, _) = at(1);
            assert_eq!(until(inner, poll), Err(Stopped));
            poll();
        });
        assert_eq!((ended, polls.get()), (Err(Stopped), 2));
    }

    #[test]
    fn a_panic_goes_on() {
        let (ask, _) = at(9);
        let panicked = catch_unwind(AssertUnwindSafe(|| until(ask, || panic!("other"))));
        assert!(panicked.is_err());
    }
}
