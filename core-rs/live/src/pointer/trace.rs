//! What happened in each tick of a led key, kept for measurements.

use std::sync::atomic::{AtomicU64, Ordering};

/// Numbers of a tick.
pub const TRACE_COLUMNS: usize = 6;

/// The first ticks of a key, written by the real-time thread and read by any.
#[derive(Debug)]
pub(super) struct Trace {
    rows: Box<[[AtomicU64; TRACE_COLUMNS]]>,
    n_written: AtomicU64,
}

impl Trace {
    /// A trace of at most `ticks` ticks.
    pub(super) fn new(ticks: usize) -> Self {
        Self {
            rows: (0..ticks).map(|_| Default::default()).collect(),
            n_written: AtomicU64::new(0),
        }
    }

    /// Keep a tick, if there is room.
    pub(super) fn push(&self, row: [f64; TRACE_COLUMNS]) {
        let n_written = self.n_written.load(Ordering::Relaxed);
        let Some(trace_row) = self.rows.get(n_written as usize) else {
            return;
        };
        for (cell, number) in trace_row.iter().zip(row) {
            cell.store(number.to_bits(), Ordering::Relaxed);
        }
        self.n_written.store(n_written + 1, Ordering::Release);
    }

    /// The ticks so far.
    pub(super) fn rows(&self) -> Vec<[f64; TRACE_COLUMNS]> {
        let n_written = self.n_written.load(Ordering::Acquire) as usize;
        let load_number = |cell: &AtomicU64| f64::from_bits(cell.load(Ordering::Relaxed));
        let written_rows = self.rows[..n_written].iter();
        written_rows.map(|row| row.each_ref().map(load_number)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trace_of_more_ticks_than_room() {
        let trace = Trace::new(2);
        assert!(trace.rows().is_empty());
        (0..5).for_each(|n| trace.push([f64::from(n); TRACE_COLUMNS]));
        assert_eq!(trace.rows(), [[0.0; TRACE_COLUMNS], [1.0; TRACE_COLUMNS]]);
    }
}
