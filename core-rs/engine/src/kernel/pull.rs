//! Forces of links on their two ends.

use crate::maths::wide::wide;

/// Add forces to MATs from `a` on, and subtract them from MATs from `b` on. At a MAT in both ranges the force is added
/// first.
#[inline(always)]
pub(super) fn add_link_forces(f: &[f64], force: &mut [f64], a: usize, b: usize) {
    let (lower_end, upper_end) = (a.min(b), a.max(b));
    // Number of MATs at each side that belong to one range only.
    let unshared_count = upper_end - lower_end;
    if unshared_count >= f.len() {
        let (forces_before, forces_behind) = force.split_at_mut(upper_end);
        let (lower_forces, upper_forces) = (
            &mut forces_before[lower_end..][..f.len()],
            &mut forces_behind[..f.len()],
        );
        let (forces_at_a, forces_at_b) = if a < b {
            (lower_forces, upper_forces)
        } else {
            (upper_forces, lower_forces)
        };
        for ((force_at_a, force_at_b), f) in forces_at_a.iter_mut().zip(forces_at_b).zip(f) {
            *force_at_a += f;
            *force_at_b -= f;
        }
        return;
    }
    let shared_count = f.len() - unshared_count;
    let (link_forces_a, link_forces_b) = (&f[upper_end - a..][..shared_count], &f[upper_end - b..][..shared_count]);
    for ((force, link_force_a), link_force_b) in force[upper_end..][..shared_count]
        .iter_mut()
        .zip(link_forces_a)
        .zip(link_forces_b)
    {
        *force = (*force + link_force_a) - link_force_b;
    }
    let (lower_rest, upper_rest) = (
        (lower_end, &f[..unshared_count]),
        (upper_end + shared_count, &f[shared_count..]),
    );
    let (unshared_a, unshared_b) = if a < b {
        (lower_rest, upper_rest)
    } else {
        (upper_rest, lower_rest)
    };
    for (force, f) in force[unshared_a.0..][..unshared_count].iter_mut().zip(unshared_a.1) {
        *force += f;
    }
    for (force, f) in force[unshared_b.0..][..unshared_count].iter_mut().zip(unshared_b.1) {
        *force -= f;
    }
}

wide! {
    /// [`add_link_forces`] as a separate function, compiled for each vector width.
    pub(super) fn pull(f: &[f64], force: &mut [f64], a: usize, b: usize) {
        add_link_forces(f, force, a, b);
    }
}
