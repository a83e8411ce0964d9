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
/// `constants` are those of the law. If the code calls a function, `room` holds [`NATIVE_LANES`] numbers for d, for v
/// and for each row.
pub type Entry =
    unsafe extern "C" fn(d: *const f64, v: *const f64, out: *mut f64, constants: *const f64, room: *mut f64, n: i64);

/// A function of the core over lanes: reads `room` from `a` (and `b`) on, writes `n` values from `target` on.
pub type Function = unsafe extern "C" fn(room: *mut f64, a: i64, b: i64, target: i64, n: i64);

/// Functions that native code calls, so that its results have the same bits as the core's.
pub const FUNCTIONS: [(&str, Function); 4] = [("exp", exp), ("tanh", tanh), ("noise", noise), ("power", power)];

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
    pub(super) fn constants(&self) -> Vec<f64> {
        let law_table = self.native.and_then(|_| self.table());
        law_table.map(|law_table| law_table.constants).unwrap_or_default()
    }

    /// Number of its operations that are [`FUNCTIONS`].
    pub(crate) fn n_function_calls(&self) -> usize {
        let calls_function = |row: &&Row| FUNCTIONS.iter().any(|(name, _)| *name == row.operation);
        self.rows().map_or(0, |rows| rows.iter().filter(calls_function).count())
    }

    /// Length of the buffer that the native code needs; laws computed one after another can share one.
    pub(crate) fn room_len(&self) -> usize {
        let calls_function = |row: &Row| FUNCTIONS.iter().any(|(name, _)| *name == row.operation);
        match self.native.and_then(|_| self.rows()) {
            Some(rows) if rows.iter().any(calls_function) => (FIRST_ROW as usize + rows.len()) * NATIVE_LANES,
            _ => 0,
        }
    }
}

impl Native {
    /// Compute forces; `constants` and `room` are those of the same law, `room` at least as long as [`Law::room_len`]
    /// says.
    pub(super) fn run(self, d: &[f64], v: &[f64], out: &mut [f64], constants: &[f64], room: &mut [f64]) {
        let link_count = out.len();
        debug_assert!(d.len() == link_count && (v.len() == link_count || v.is_empty()));
        // SAFETY: `set_native` was given an entry.
        let entry_point = unsafe { std::mem::transmute::<usize, Entry>(self.entry) };
        let (d, v, constants) = (d.as_ptr(), v.as_ptr(), constants.as_ptr());
        // SAFETY: made from this law's rows, it reads n numbers of `d`, of `v` where the law has a damping, and
        // what `Law::constants` made; it writes n numbers of `out`, and as much of the room as `Law::room_len` says.
        unsafe { entry_point(d, v, out.as_mut_ptr(), constants, room.as_mut_ptr(), link_count as i64) };
    }
}

wide! {
    fn all_exp(a: &[f64], out: &mut [f64]) {
        lanes::exp(a, out);
    }
}

unsafe extern "C" fn exp(room: *mut f64, operand: i64, _: i64, target: i64, n: i64) {
    // SAFETY: native code passes places of two rows of the room.
    let (operand, result) = unsafe { (room_values(room, operand, n), room_values_mut(room, target, n)) };
    // Most LNLs of a score are alone in their run.
    if let ([operand], [result]) = (operand, &mut *result) {
        *result = Unary::Exp.apply(*operand);
    } else {
        all_exp(operand, result);
    }
}

unsafe extern "C" fn tanh(room: *mut f64, operand: i64, _: i64, target: i64, n: i64) {
    // SAFETY: native code passes places of two rows of the room.
    unsafe { link_by_link(Unary::Tanh, room, operand, target, n) };
}

unsafe extern "C" fn noise(room: *mut f64, operand: i64, _: i64, target: i64, n: i64) {
    // SAFETY: as above.
    unsafe { link_by_link(Unary::Noise, room, operand, target, n) };
}

/// # Safety
/// `operand` and `target` are places of two rows of the room.
unsafe fn link_by_link(operation: Unary, room: *mut f64, operand: i64, target: i64, n: i64) {
    // SAFETY: as above.
    let (operand, result) = unsafe { (room_values(room, operand, n), room_values_mut(room, target, n)) };
    for (result, operand) in result.iter_mut().zip(operand) {
        *result = operation.apply(*operand);
    }
}

unsafe extern "C" fn power(room: *mut f64, power_base: i64, exponent: i64, target: i64, n: i64) {
    // SAFETY: native code passes places of three rows of the room.
    let (power_base, exponent, result) = unsafe {
        (
            room_values(room, power_base, n),
            room_values(room, exponent, n),
            room_values_mut(room, target, n),
        )
    };
    for (result, (power_base, exponent)) in result.iter_mut().zip(power_base.iter().zip(exponent)) {
        *result = Binary::Power.apply(*power_base, *exponent);
    }
}

/// # Safety
/// `n` numbers lie in the room from `offset` on, and nothing writes them meanwhile.
unsafe fn room_values<'a>(room: *mut f64, offset: i64, n: i64) -> &'a [f64] {
    // SAFETY: as above.
    unsafe { std::slice::from_raw_parts(room.offset(offset as isize), n as usize) }
}

/// # Safety
/// `n` numbers lie in the room from `offset` on, and nothing else reads or writes them meanwhile.
unsafe fn room_values_mut<'a>(room: *mut f64, offset: i64, n: i64) -> &'a mut [f64] {
    // SAFETY: as above.
    unsafe { std::slice::from_raw_parts_mut(room.offset(offset as isize), n as usize) }
}
