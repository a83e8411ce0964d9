//! Threads that compute one mesh together: a pass is divided into parts, and each free thread takes the next part.
//!
//! A pass over a mesh takes microseconds, less than waking a thread; so the threads spin between two passes. A helper
//! that the operating system does not schedule takes no part and delays no thread: the leader computes the parts that
//! no helper has taken.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::ptr::{from_ref, null_mut};
use std::sync::atomic::Ordering::{AcqRel, Acquire, Relaxed, Release};
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU64};
use std::thread::{Builder, scope, yield_now};

/// Number of spins before a waiting thread yields: longer than a pass, and than the work of one thread between two
/// passes.
const SPINS_MAX: u32 = 1_000;

/// A leader and its helpers, or a leader alone.
pub(crate) struct ThreadTeam<'a>(Option<&'a SharedPass>);

/// Memory that leader and helpers share.
#[derive(Default)]
struct SharedPass {
    /// Number of the pass, number of its parts, number of parts taken: packed into one word.
    state: AtomicU64,
    /// Parts of this pass that helpers have completed.
    completed_parts: AtomicU64,
    /// The work of the pass; valid until the pass ends, then null.
    task: AtomicPtr<Task>,
    is_over: AtomicBool,
}

/// A type-erased `&F` and the function that calls it, F: Fn(usize) + Sync.
struct Task {
    work: *const (),
    call: unsafe fn(*const (), usize),
}

/// Bits of each count in `state`; a pass has at most `COUNT_MASK` parts.
const COUNT_BITS: u32 = 8;
const COUNT_MASK: u64 = (1 << COUNT_BITS) - 1;

/// Number of parts, and index of the next part that no thread has taken.
fn unpack_counts(state: u64) -> (u64, u64) {
    (state >> COUNT_BITS & COUNT_MASK, state & COUNT_MASK)
}

impl ThreadTeam<'_> {
    /// A team of the calling thread only.
    pub(crate) const fn alone() -> Self {
        Self(None)
    }

    /// Call `run` with a team of `threads` threads, including the calling one; with fewer if the system starts fewer.
    pub(crate) fn with_threads<R>(threads: usize, run: impl FnOnce(&mut ThreadTeam<'_>) -> R) -> R {
        if threads < 2 {
            return run(&mut ThreadTeam::alone());
        }
        let shared_pass = SharedPass::default();
        scope(|scope| {
            let shared_pass = &shared_pass;
            // Dropped before the scope waits for the helpers, even where `run` panics.
            let _end = TeamEnd(shared_pass);
            for _ in 1..threads {
                // If a thread cannot be started, the team has one helper fewer.
                let _ = Builder::new().spawn_scoped(scope, || with_denormals_flushed(|| shared_pass.work_until_over()));
            }
            run(&mut ThreadTeam(Some(shared_pass)))
        })
    }

    /// Call `work` once on every element, each by one thread; all calls have ended when this returns or unwinds.
    pub(crate) fn for_each<T: Send>(&mut self, elements: &mut [T], work: impl Fn(&mut T) + Sync) {
        let Some(shared_pass) = self.0 else {
            elements.iter_mut().for_each(work);
            return;
        };
        debug_assert!(elements.len() as u64 <= COUNT_MASK);
        let parts_pointer = SharedElements(elements.as_mut_ptr());
        shared_pass.run_pass(elements.len(), &|index| {
            // SAFETY: `run_pass` gives each index below the length to one thread, once, while `elements` is borrowed.
            work(unsafe { parts_pointer.get(index) })
        });
    }
}

/// A slice whose elements are used by different threads.
struct SharedElements<T>(*mut T);

// SAFETY: each element is handed to one thread only, which is the same as sending it there.
unsafe impl<T: Send> Sync for SharedElements<T> {}

impl<T> SharedElements<T> {
    /// # Safety
    /// The slice is borrowed, `index` is within it, and no other thread has that element.
    #[allow(clippy::mut_from_ref)]
    unsafe fn get(&self, index: usize) -> &mut T {
        // SAFETY: the caller guarantees it.
        unsafe { &mut *self.0.add(index) }
    }
}

impl SharedPass {
    /// Call `work` on every number below `n`, on this thread and on helpers.
    fn run_pass<F: Fn(usize) + Sync>(&self, n: usize, work: &F) {
        unsafe fn call<F: Fn(usize)>(work: *const (), part_index: usize) {
            // SAFETY: `run_pass` made the pointer of a `&F`, and does not end before the call does.
            unsafe { (*work.cast::<F>())(part_index) }
        }
        let pass_task = Task {
            work: from_ref(work).cast(),
            call: call::<F>,
        };
        // A helper that still reads the state of the last pass finds no part left to take.
        self.task.store(from_ref(&pass_task).cast_mut(), Relaxed);
        self.completed_parts.store(0, Relaxed);
        let pass_number = (self.state.load(Relaxed) >> (2 * COUNT_BITS)) + 1;
        let packed_state = pass_number << (2 * COUNT_BITS) | (n as u64) << COUNT_BITS;
        self.state.store(packed_state, Release);
        let pass_end = PassEnd(self, Cell::new(0));
        while let Some((part_index, _)) = self.take_part() {
            pass_end.1.set(pass_end.1.get() + 1);
            work(part_index);
        }
    }

    /// Take the next free part: its index, and the work of the pass.
    fn take_part(&self) -> Option<(usize, *mut Task)> {
        let mut state = self.state.load(Acquire);
        loop {
            let (part_count, next_part) = unpack_counts(state);
            if next_part >= part_count {
                return None;
            }
            // This is the task of the pass in `state`: a pass cannot end before all its parts are taken, and then the
            // exchange fails.
            let pass_task = self.task.load(Relaxed);
            let state_exchange = self.state.compare_exchange(state, state + 1, AcqRel, Acquire);
            match state_exchange {
                Ok(_) => return Some((next_part as usize, pass_task)),
                Err(other) => state = other,
            }
        }
    }

    fn work_until_over(&self) {
        let mut panicked = None;
        let mut spin_count = 0;
        while !self.is_over.load(Acquire) {
            let Some((part_index, pass_task)) = self.take_part() else {
                spin_or_yield(&mut spin_count);
                continue;
            };
            spin_count = 0;
            let part_work = || {
                // SAFETY: the leader is in `run_pass`, where the task lives, until this part is counted as done; its
                // work is Sync.
                unsafe { ((*pass_task).call)((*pass_task).work, part_index) }
            };
            let part_result = catch_unwind(AssertUnwindSafe(part_work));
            panicked = panicked.or(part_result.err());
            self.completed_parts.fetch_add(1, Release);
        }
        if let Some(first_panic) = panicked {
            resume_unwind(first_panic);
        }
    }
}

/// On drop, waits until helpers have completed the parts they took; holds the number of the leader's own parts.
struct PassEnd<'a>(&'a SharedPass, Cell<u64>);

impl Drop for PassEnd<'_> {
    fn drop(&mut self) {
        let Self(shared_pass, leader_parts) = self;
        // If the leader unwinds, close the pass: parts that no thread has taken are skipped.
        let closed_state = |state: u64| Some(state & !COUNT_MASK | unpack_counts(state).0);
        let state_before = shared_pass.state.fetch_update(AcqRel, Acquire, closed_state);
        let (_, parts_taken) = unpack_counts(state_before.unwrap_or_else(|state| state));
        let mut spin_count = 0;
        while shared_pass.completed_parts.load(Acquire) + leader_parts.get() < parts_taken {
            spin_or_yield(&mut spin_count);
        }
        shared_pass.task.store(null_mut(), Relaxed);
    }
}

/// On drop, tells the helpers to stop.
struct TeamEnd<'a>(&'a SharedPass);

impl Drop for TeamEnd<'_> {
    fn drop(&mut self) {
        self.0.is_over.store(true, Release);
    }
}

/// Spin, or yield to other threads after [`SPINS_MAX`] spins.
fn spin_or_yield(spins: &mut u32) {
    if *spins < SPINS_MAX {
        *spins += 1;
        std::hint::spin_loop();
    } else {
        yield_now();
    }
}

/// Call `run` with denormals flushed to zero: decaying networks reach them, and they are slow.
pub(crate) fn with_denormals_flushed<T>(run: impl FnOnce() -> T) -> T {
    if cfg!(miri) {
        return run(); // Miri knows no modes of a processor
    }
    // SAFETY: nothing inside relies on gradual underflow; the guard restores the mode on the way out.
    unsafe { no_denormals::no_denormals(run) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thread_team_runs_every_part_once_per_round() {
        let round_count = if cfg!(miri) { 20 } else { 2_000 }; // Miri takes seconds for a hundred
        for threads in 1..=4 {
            let mut call_counts = [0_u64; 5];
            ThreadTeam::with_threads(threads, |team| {
                for round in 0..round_count {
                    team.for_each(&mut call_counts, |part| *part += 1);
                    assert_eq!(*call_counts.iter().max().unwrap(), round + 1);
                }
            });
            assert_eq!(call_counts, [round_count; 5], "{threads}");
        }
    }

    #[test]
    fn thread_team_with_a_panic_ends() {
        for failing_thread in 0..3 {
            let mut part_numbers = [0, 1, 2];
            let team_outcome = catch_unwind(AssertUnwindSafe(|| {
                ThreadTeam::with_threads(3, |team| {
                    team.for_each(&mut part_numbers, |part| assert_ne!(*part, failing_thread));
                    team.for_each(&mut part_numbers, |part| *part += 10);
                });
            }));
            assert!(team_outcome.is_err(), "{failing_thread}");
        }
    }
}
