//! A law as machine code compiled elsewhere from [`Law::rows`], and the functions that such code calls.

use super::Law;
use super::table::{FIRST_ROW, Row};
use super::tree::{Binary, Unary};
use crate::maths::lanes;
use crate::maths::wide::wide;

/// Number of links that native code computes at once if it calls [`FUNCTIONS`].
pub const NATIVE_LANES: usize = 64;

/// Native code of a law: forces `out` of `n` links at elongations `d` and rates `v`.
///
/// `numbers` are the law's constants. If the code calls a function, `room` holds [`NATIVE_LANES`] numbers for d, for v
/// and for each row.
pub type Entry = unsafe extern "C" fn(
    d: *const f64,
    v: *const f64,
    out: *mut f64,
    numbers: *const f64,
    room: *mut f64,
    n: i64,
);

/// A function of the core over lanes: reads `room` from `a` (and `b`) on, writes `n` values from `to` on.
pub type Function = unsafe extern "C" fn(room: *mut f64, a: i64, b: i64, to: i64, n: i64);

/// Functions that native code calls, so that its results have the same bits as the core's.
pub const FUNCTIONS: [(&str, Function); 3] = [("exp", exp), ("tanh", tanh), ("power", power)];

/// The entry point of a law's native code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Native {
    entry: usize,
}

impl Law {
    /// Let runs of links be computed by native code, which gives the same bits as [`Law::force`].
    ///
    /// # Safety
    /// `entry` was made from this law's [`Law::rows`] and stays where it is until the process ends.
    pub unsafe fn set_native(&mut self, entry: Entry) {
        let entry = entry as usize;
        self.native = Some(Native { entry });
    }

    /// The law's constants in the order in which its native code reads them; empty without native code.
    pub(super) fn numbers(&self) -> Vec<f64> {
        let table = self.native.and_then(|_| self.table());
        table.map(|table| table.constants).unwrap_or_default()
    }

    /// Number of its operations that are [`FUNCTIONS`].
    pub(crate) fn n_functions(&self) -> usize {
        let calls = |row: &&Row| FUNCTIONS.iter().any(|(name, _)| *name == row.operation);
        self.rows()
            .map_or(0, |rows| rows.iter().filter(calls).count())
    }

    /// Length of the buffer that the native code needs; laws computed one after another can share one.
    pub(crate) fn room(&self) -> usize {
        let calls = |row: &Row| FUNCTIONS.iter().any(|(name, _)| *name == row.operation);
        match self.native.and_then(|_| self.rows()) {
            Some(rows) if rows.iter().any(calls) => {
                (FIRST_ROW as usize + rows.len()) * NATIVE_LANES
            }
            _ => 0,
        }
    }
}

impl Native {
    /// Compute forces; `numbers` and `room` are those of the same law, `room` at least as long as [`Law::room`] says.
    pub(super) fn run(
        self,
        d: &[f64],
        v: &[f64],
        out: &mut [f64],
        numbers: &[f64],
        room: &mut [f64],
    ) {
        let n = out.len();
        debug_assert!(d.len() == n && (v.len() == n || v.is_empty()));
        // SAFETY: `set_native` was given an entry.
        let entry = unsafe { std::mem::transmute::<usize, Entry>(self.entry) };
        let (d, v, numbers) = (d.as_ptr(), v.as_ptr(), numbers.as_ptr());
        // SAFETY: made from this law's rows, it reads n numbers of `d`, of `v` where the law has a damping, and
        // what `Law::numbers` made; it writes n numbers of `out`, and as much of the room as `Law::room` says.
        unsafe { entry(d, v, out.as_mut_ptr(), numbers, room.as_mut_ptr(), n as i64) };
    }
}

wide! {
    fn all_exp(a: &[f64], out: &mut [f64]) {
        lanes::exp(a, out);
    }
}

unsafe extern "C" fn exp(room: *mut f64, a: i64, _: i64, to: i64, n: i64) {
    // SAFETY: native code passes places of two rows of the room.
    let (a, out) = unsafe { (row(room, a, n), row_mut(room, to, n)) };
    // Most LNLs of a score are alone in their run.
    if let ([a], [out]) = (a, &mut *out) {
        *out = Unary::Exp.apply(*a);
    } else {
        all_exp(a, out);
    }
}

unsafe extern "C" fn tanh(room: *mut f64, a: i64, _: i64, to: i64, n: i64) {
    // SAFETY: native code passes places of two rows of the room.
    let (a, out) = unsafe { (row(room, a, n), row_mut(room, to, n)) };
    for (out, a) in out.iter_mut().zip(a) {
        *out = Unary::Tanh.apply(*a);
    }
}

unsafe extern "C" fn power(room: *mut f64, a: i64, b: i64, to: i64, n: i64) {
    // SAFETY: native code passes places of three rows of the room.
    let (a, b, out) = unsafe { (row(room, a, n), row(room, b, n), row_mut(room, to, n)) };
    for (out, (a, b)) in out.iter_mut().zip(a.iter().zip(b)) {
        *out = Binary::Power.apply(*a, *b);
    }
}

/// # Safety
/// `n` numbers lie in the room from `offset` on, and nothing writes them meanwhile.
unsafe fn row<'a>(room: *mut f64, offset: i64, n: i64) -> &'a [f64] {
    // SAFETY: as above.
    unsafe { std::slice::from_raw_parts(room.offset(offset as isize), n as usize) }
}

/// # Safety
/// `n` numbers lie in the room from `offset` on, and nothing else reads or writes them meanwhile.
unsafe fn row_mut<'a>(room: *mut f64, offset: i64, n: i64) -> &'a mut [f64] {
    // SAFETY: as above.
    unsafe { std::slice::from_raw_parts_mut(room.offset(offset as isize), n as usize) }
}
