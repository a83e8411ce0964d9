//! Forces of springs one link after the other, for meshes in which runs are single links.
//!
//! Every force has the operations of [`super::add_total_forces`], and every MAT the order of its sums: the bits are the
//! same.

use super::ForcePart;
use crate::maths::wide::wide;
use crate::scheme::{LinkGroup, LoneLinks, PulledEnds};

/// Set `force` to the sum of forces on each MAT [N].
pub(super) fn compute_forces(lone_links: &LoneLinks, part: ForcePart, [x, v]: [&[f64]; 2], force: &mut [f64]) {
    force.fill(0.0);
    match part {
        ForcePart::Elastic => add_elastic_forces(lone_links, x, force),
        ForcePart::Viscous => add_viscous_forces(lone_links, v, force),
        ForcePart::Total => add_total_forces(lone_links, x, v, force),
    }
}

/// Add the force of every link of a group to the ends that it pulls: a function of the MATs of the link, its stiffness
/// and damping, its cubic stiffness, and its rest length.
#[inline(always)]
fn add_group_forces(
    lone_links: &LoneLinks,
    group: &LinkGroup,
    force: &mut [f64],
    link_force: impl Fn([usize; 2], [f64; 2], f64, f64) -> f64,
) {
    let links = group.links.clone();
    let (mats, force_ends) = (&lone_links.mats[links.clone()], &lone_links.force_ends[links.clone()]);
    let n = mats.len();
    let (k_and_z, q) = (
        &lone_links.k_and_z[links.clone()][..n],
        &lone_links.q[links.clone()][..n],
    );
    let (force_ends, rest) = (&force_ends[..n], &lone_links.rest[links][..n]);
    let force_of_link = |i: usize| link_force([mats[i][0] as usize, mats[i][1] as usize], k_and_z[i], q[i], rest[i]);
    match group.form.pulled_ends {
        PulledEnds::Both => {
            for i in 0..n {
                let push = force_of_link(i);
                force[force_ends[i][0] as usize] += push;
                force[force_ends[i][1] as usize] -= push;
            }
        }
        PulledEnds::A => (0..n).for_each(|i| force[force_ends[i][0] as usize] += force_of_link(i)),
        PulledEnds::B => (0..n).for_each(|i| force[force_ends[i][1] as usize] -= force_of_link(i)),
    }
}

wide! {
    fn add_elastic_forces(lone_links: &LoneLinks, x: &[f64], force: &mut [f64]) {
        for group in &lone_links.groups {
            if group.form.is_hardening {
                add_group_forces(lone_links, group, force, |[a, b], [k, _], q, rest| {
                    let e = x[b] - x[a] - rest;
                    k * e + q * (e * e * e)
                });
            } else {
                add_group_forces(lone_links, group, force, |[a, b], [k, _], _, rest| {
                    k * (x[b] - x[a] - rest)
                });
            }
        }
    }
}

wide! {
    fn add_viscous_forces(lone_links: &LoneLinks, v: &[f64], force: &mut [f64]) {
        for group in lone_links.groups.iter().filter(|group| group.form.is_damped) {
            add_group_forces(lone_links, group, force, |[a, b], [_, z], _, _| z * (v[b] - v[a]));
        }
    }
}

wide! {
    fn add_total_forces(lone_links: &LoneLinks, x: &[f64], v: &[f64], force: &mut [f64]) {
        for group in &lone_links.groups {
            if group.form.is_hardening {
                add_group_forces(lone_links, group, force, |[a, b], [k, z], q, rest| {
                    let e = x[b] - x[a] - rest;
                    k * e + q * (e * e * e) + z * (v[b] - v[a])
                });
            } else {
                add_group_forces(lone_links, group, force, |[a, b], [k, z], _, rest| {
                    k * (x[b] - x[a] - rest) + z * (v[b] - v[a])
                });
            }
        }
    }
}
