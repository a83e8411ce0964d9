//! Forces of links on their two ends.

use crate::maths::wide::wide;

/// Add forces to MATs from `a` on, and subtract them from MATs from `b` on. At a MAT in both ranges the force is added
/// first.
#[inline(always)]
pub(super) fn add(f: &[f64], force: &mut [f64], a: usize, b: usize) {
    let (low, high) = (a.min(b), a.max(b));
    // Number of MATs at each side that belong to one range only.
    let alone = high - low;
    if alone >= f.len() {
        let (before, behind) = force.split_at_mut(high);
        let (low, high) = (&mut before[low..][..f.len()], &mut behind[..f.len()]);
        let (fa, fb) = if a < b { (low, high) } else { (high, low) };
        for ((fa, fb), f) in fa.iter_mut().zip(fb).zip(f) {
            *fa += f;
            *fb -= f;
        }
        return;
    }
    let n = f.len() - alone;
    let (fa, fb) = (&f[high - a..][..n], &f[high - b..][..n]);
    for ((force, fa), fb) in force[high..][..n].iter_mut().zip(fa).zip(fb) {
        *force = (*force + fa) - fb;
    }
    let (before, behind) = ((low, &f[..alone]), (high + n, &f[n..]));
    let (only_a, only_b) = if a < b {
        (before, behind)
    } else {
        (behind, before)
    };
    for (force, f) in force[only_a.0..][..alone].iter_mut().zip(only_a.1) {
        *force += f;
    }
    for (force, f) in force[only_b.0..][..alone].iter_mut().zip(only_b.1) {
        *force -= f;
    }
}

wide! {
    /// [`add`] as a separate function, compiled for each vector width.
    pub(super) fn pull(f: &[f64], force: &mut [f64], a: usize, b: usize) {
        add(f, force, a, b);
    }
}
