//! Forces of links on their two ends.

use crate::maths::wide::wide;

wide! {
    /// Add forces to MATs from `a` on, and subtract them from MATs from `b` on.
    pub(super) fn pull(f: &[f64], force: &mut [f64], a: usize, b: usize) {
        for (force, f) in force[a..a + f.len()].iter_mut().zip(f) {
            *force += f;
        }
        for (force, f) in force[b..b + f.len()].iter_mut().zip(f) {
            *force -= f;
        }
    }
}
