//! Threads that go through one mesh together: parts of a pass, each taken by whoever is free.
//!
//! A pass over a mesh takes microseconds, less than it takes to wake a thread; so between two passes they spin. A
//! helper that the system keeps waiting takes no part, and holds nobody up: the leader does all that nobody took.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::ptr::{from_ref, null_mut};
use std::sync::atomic::Ordering::{AcqRel, Acquire, Relaxed, Release};
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU64};
use std::thread::{Builder, scope, yield_now};

/// So often a thread looks for what it waits for before it lets others run: longer than a pass, or than what is done
/// between two of them by one thread.
const LOOKS: u32 = 1_000;

/// A leader and its helpers, or a leader alone.
pub(crate) struct ThreadTeam<'a>(Option<&'a Hall>);

/// Where they meet.
#[derive(Default)]
struct Hall {
    /// The pass, how many parts it has, and how many are taken.
    state: AtomicU64,
    /// Of this pass, parts that helpers have done.
    done: AtomicU64,
    /// What is to be done: there while the pass lasts.
    task: AtomicPtr<Task>,
    is_over: AtomicBool,
}

/// A `&F` and how to call it, where F: Fn(usize) + Sync.
struct Task {
    work: *const (),
    call: unsafe fn(*const (), usize),
}

/// Bits of a count in `state`; a pass has far fewer parts.
const BITS: u32 = 8;
const MASK: u64 = (1 << BITS) - 1;

/// How many parts there are, and which is the next that nobody has.
fn parts(state: u64) -> (u64, u64) {
    (state >> BITS & MASK, state & MASK)
}

impl ThreadTeam<'_> {
    /// A leader alone.
    pub(crate) const fn alone() -> Self {
        Self(None)
    }

    /// Run with a crew of so many threads, this one among them, or as many as can be had.
    pub(crate) fn with<R>(threads: usize, run: impl FnOnce(&mut ThreadTeam<'_>) -> R) -> R {
        if threads < 2 {
            return run(&mut ThreadTeam::alone());
        }
        let hall = Hall::default();
        scope(|scope| {
            let hall = &hall;
            // Dropped before the scope waits for the helpers, whatever happens in `run`.
            let _end = End(hall);
            for _ in 1..threads {
                // One that cannot be had is one fewer.
                let _ = Builder::new().spawn_scoped(scope, || flushed(|| hall.help()));
            }
            run(&mut ThreadTeam(Some(hall)))
        })
    }

    /// `work` on every part, each by one thread; all are done when it returns, or unwinds.
    pub(crate) fn each<T: Send>(&mut self, all: &mut [T], work: impl Fn(&mut T) + Sync) {
        let Some(hall) = self.0 else {
            all.iter_mut().for_each(work);
            return;
        };
        debug_assert!(all.len() as u64 <= MASK);
        let parts = Parts(all.as_mut_ptr());
        // SAFETY: `meet` gives each index below the length to one thread, once, while `all` is borrowed here.
        hall.meet(all.len(), &|at| work(unsafe { parts.get(at) }));
    }
}

/// A slice whose elements go to different threads.
struct Parts<T>(*mut T);

// SAFETY: it hands out each element to one thread alone, which is sending it there.
unsafe impl<T: Send> Sync for Parts<T> {}

impl<T> Parts<T> {
    /// # Safety
    /// The slice is borrowed, `at` lies in it, and nobody else has that element.
    #[allow(clippy::mut_from_ref)]
    unsafe fn get(&self, at: usize) -> &mut T {
        // SAFETY: as the caller says.
        unsafe { &mut *self.0.add(at) }
    }
}

impl Hall {
    /// `work` on every number below `n`, here and by helpers.
    fn meet<F: Fn(usize) + Sync>(&self, n: usize, work: &F) {
        unsafe fn call<F: Fn(usize)>(work: *const (), at: usize) {
            // SAFETY: `meet` made the pointer of a `&F`, and does not end before the call does.
            unsafe { (*work.cast::<F>())(at) }
        }
        let task = Task {
            work: from_ref(work).cast(),
            call: call::<F>,
        };
        // Whoever still looks at the last pass finds that all of it is taken.
        self.task.store(from_ref(&task).cast_mut(), Relaxed);
        self.done.store(0, Relaxed);
        let pass = (self.state.load(Relaxed) >> (2 * BITS)) + 1;
        let state = pass << (2 * BITS) | (n as u64) << BITS;
        self.state.store(state, Release);
        let all = Everybody(self, Cell::new(0));
        while let Some((at, _)) = self.take() {
            all.1.set(all.1.get() + 1);
            work(at);
        }
    }

    /// The next part that nobody has, and what is to be done of it.
    fn take(&self) -> Option<(usize, *mut Task)> {
        let mut state = self.state.load(Acquire);
        loop {
            let (n, next) = parts(state);
            if next >= n {
                return None;
            }
            // Of this pass: it cannot end while a part of it is not taken, and so `state` would be another.
            let task = self.task.load(Relaxed);
            let taken = self
                .state
                .compare_exchange(state, state + 1, AcqRel, Acquire);
            match taken {
                Ok(_) => return Some((next as usize, task)),
                Err(other) => state = other,
            }
        }
    }

    fn help(&self) {
        let mut panicked = None;
        let mut looks = 0;
        while !self.is_over.load(Acquire) {
            let Some((at, task)) = self.take() else {
                look(&mut looks);
                continue;
            };
            looks = 0;
            let work = || {
                // SAFETY: the leader is in `meet`, where the task lives, until this part is counted as done; its
                // work is Sync.
                unsafe { ((*task).call)((*task).work, at) }
            };
            let done = catch_unwind(AssertUnwindSafe(work));
            panicked = panicked.or(done.err());
            self.done.fetch_add(1, Release);
        }
        if let Some(panic) = panicked {
            resume_unwind(panic);
        }
    }
}

/// Waits until helpers have done what they took; the leader's own parts are counted.
struct Everybody<'a>(&'a Hall, Cell<u64>);

impl Drop for Everybody<'_> {
    fn drop(&mut self) {
        let Self(hall, own) = self;
        // Where the leader unwinds, what nobody has taken is not done.
        let close = |state: u64| Some(state & !MASK | parts(state).0);
        let found = hall.state.fetch_update(AcqRel, Acquire, close);
        let (_, taken) = parts(found.unwrap_or_else(|state| state));
        let mut looks = 0;
        while hall.done.load(Acquire) + own.get() < taken {
            look(&mut looks);
        }
        hall.task.store(null_mut(), Relaxed);
    }
}

/// Lets the helpers go.
struct End<'a>(&'a Hall);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.is_over.store(true, Release);
    }
}

fn look(looks: &mut u32) {
    if *looks < LOOKS {
        *looks += 1;
        std::hint::spin_loop();
    } else {
        yield_now();
    }
}

/// Run with denormals flushed to zero: decaying networks end in them, and they are slow.
pub(crate) fn flushed<T>(run: impl FnOnce() -> T) -> T {
    // SAFETY: nothing inside relies on gradual underflow; the guard restores the mode on the way out.
    unsafe { no_denormals::no_denormals(run) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_is_done_once_a_round() {
        for threads in 1..=4 {
            let mut parts = [0_u64; 5];
            ThreadTeam::with(threads, |team| {
                for round in 0..2_000 {
                    team.each(&mut parts, |part| *part += 1);
                    assert_eq!(*parts.iter().max().unwrap(), round + 1);
                }
            });
            assert_eq!(parts, [2_000; 5], "{threads}");
        }
    }

    #[test]
    fn whoever_panics_leaves_nobody_behind() {
        for bad in 0..3 {
            let mut parts = [0, 1, 2];
            let end = catch_unwind(AssertUnwindSafe(|| {
                ThreadTeam::with(3, |team| {
                    team.each(&mut parts, |part| assert_ne!(*part, bad));
                    team.each(&mut parts, |part| *part += 10);
                });
            }));
            assert!(end.is_err(), "{bad}");
        }
    }
}
