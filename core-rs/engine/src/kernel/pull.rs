//! Forces of links on their two ends.

use crate::maths::wide::wide;

/// Add forces to MATs from `a` on, and subtract them from MATs from `b` on. At a MAT in both ranges the force is added
/// first.
#[inline(always)]
pub(super) fn add_link_forces(link_forces: &[f64], force: &mut [f64], a: usize, b: usize) {
    let (lower_end, upper_end) = (a.min(b), a.max(b));
    // Number of MATs at each side that belong to one range only.
    let unshared_count = upper_end - lower_end;
    if unshared_count >= link_forces.len() {
        let (forces_before, forces_behind) = force.split_at_mut(upper_end);
        let (lower_forces, upper_forces) = (
            &mut forces_before[lower_end..][..link_forces.len()],
            &mut forces_behind[..link_forces.len()],
        );
        let (forces_at_a, forces_at_b) = if a < b {
            (lower_forces, upper_forces)
        } else {
            (upper_forces, lower_forces)
        };
        for ((force_at_a, force_at_b), link_force) in forces_at_a.iter_mut().zip(forces_at_b).zip(link_forces) {
            *force_at_a += link_force;
            *force_at_b -= link_force;
        }
        return;
    }
    let shared_count = link_forces.len() - unshared_count;
    let (link_forces_a, link_forces_b) = (
        &link_forces[upper_end - a..][..shared_count],
        &link_forces[upper_end - b..][..shared_count],
    );
    for ((force, link_force_a), link_force_b) in force[upper_end..][..shared_count]
        .iter_mut()
        .zip(link_forces_a)
        .zip(link_forces_b)
    {
        *force = (*force + link_force_a) - link_force_b;
    }
    let (lower_rest, upper_rest) = (
        (lower_end, &link_forces[..unshared_count]),
        (upper_end + shared_count, &link_forces[shared_count..]),
    );
    let ((start_a, unshared_a), (start_b, unshared_b)) = if a < b {
        (lower_rest, upper_rest)
    } else {
        (upper_rest, lower_rest)
    };
    for (force, link_force) in force[start_a..][..unshared_count].iter_mut().zip(unshared_a) {
        *force += link_force;
    }
    for (force, link_force) in force[start_b..][..unshared_count].iter_mut().zip(unshared_b) {
        *force -= link_force;
    }
}

wide! {
    /// [`add_link_forces`] as a separate function, compiled for each vector width.
    pub(super) fn add_link_forces_wide(link_forces: &[f64], force: &mut [f64], a: usize, b: usize) {
        add_link_forces(link_forces, force, a, b);
    }
}
