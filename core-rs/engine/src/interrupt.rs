//! Long computations that end where somebody asks them to.
//!
//! A computation runs inside [`until`] with a question, and calls [`poll`] after every few milliseconds of work. Where
//! the answer is yes it unwinds to [`until`]. A thread outside [`until`], such as the one that plays, pays for a poll
//! one look at a flag of its own.

use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// Whether a computation is to end. It is asked in the thread that computes.
pub type Ask = Box<dyn FnMut() -> bool>;

/// A computation was ended before it was done: what it changed is in no defined state.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Stopped;

thread_local! {
    static IS_ASKED: Cell<bool> = const { Cell::new(false) };
    static ASK: RefCell<Option<Ask>> = const { RefCell::new(None) };
}

/// Puts the question of an outer computation back.
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
/// [`Stopped`] where `ask` returns true at a poll of `work`.
pub fn until<T>(ask: Ask, work: impl FnOnce() -> T) -> Result<T, Stopped> {
    let outer = Outer(set(Some(ask)));
    let done = catch_unwind(AssertUnwindSafe(work));
    drop(outer);
    done.or_else(|payload| match payload.downcast::<Stopped>() {
        Ok(stopped) => Err(*stopped),
        Err(panic) => resume_unwind(panic),
    })
}

/// Unwind if this computation is to end. Call it where nothing but this computation would miss its end.
#[inline]
pub fn poll() {
    if IS_ASKED.get() {
        ask();
    }
}

/// Unwind to [`until`], whatever its question would say.
pub fn stop() -> ! {
    resume_unwind(Box::new(Stopped)) // no panic: nothing is printed
}

#[cold]
fn ask() {
    // The question may itself compute something, with a question of its own.
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
