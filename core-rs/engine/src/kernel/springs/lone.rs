//! Forces of springs one link after the other, for meshes in which runs are single links.
//!
//! All forces are computed first, then summed at each MAT: a link that adds to both its ends waits for the link before
//! it. Every force has the operations of [`super::add_total_forces`], and every MAT the order of its sums: the bits are
//! the same.

use super::ForcePart;
use crate::maths::wide::wide;
use crate::scheme::{ForceSums, LINK_LANES, LinkBlock, LoneLinks, SUM_LANES};

/// The forces of each block of links, and their negatives [N]   (n_blocks); then zeros, for sums of fewer terms.
pub(super) type SignedForces = Vec<[[f64; LINK_LANES]; 2]>;

/// Set `force` to the sum of forces on each MAT [N].
pub(super) fn compute_forces(
    lone_links: &LoneLinks,
    part: ForcePart,
    [x, v]: [&[f64]; 2],
    signed_forces: &mut SignedForces,
    force: &mut [f64],
) {
    let blocks = &lone_links.blocks[..];
    signed_forces.resize(blocks.len() + 1, [[0.0; LINK_LANES]; 2]);
    force.fill(0.0);
    match part {
        ForcePart::Viscous if !lone_links.are_damped => return,
        ForcePart::Viscous => set_viscous_forces(blocks, v, signed_forces),
        ForcePart::Total if lone_links.are_damped => set_total_forces(blocks, x, v, signed_forces),
        ForcePart::Elastic | ForcePart::Total => set_elastic_forces(blocks, x, signed_forces),
    }
    sum_forces(&lone_links.force_sums, signed_forces, force);
}

/// The difference of a value at the two ends of each link.
#[inline(always)]
fn end_differences(block: &LinkBlock, values: &[f64]) -> [f64; LINK_LANES] {
    let mut differences = [0.0; LINK_LANES];
    let mut lane = 0;
    while lane < LINK_LANES {
        differences[lane] = values[block.b[lane] as usize] - values[block.a[lane] as usize];
        lane += 1;
    }
    differences
}

/// Set the forces of a block of links and their negatives.
#[inline(always)]
fn set_block_forces(block_forces: &mut [[f64; LINK_LANES]; 2], link_force: impl Fn(usize) -> f64) {
    let mut lane = 0;
    while lane < LINK_LANES {
        let pull = link_force(lane);
        block_forces[0][lane] = pull;
        block_forces[1][lane] = -pull;
        lane += 1;
    }
}

wide! {
    fn set_elastic_forces(blocks: &[LinkBlock], x: &[f64], signed_forces: &mut [[[f64; LINK_LANES]; 2]]) {
        let mut i = 0;
        while i < blocks.len() {
            let (block, offsets) = (&blocks[i], end_differences(&blocks[i], x));
            set_block_forces(&mut signed_forces[i], |lane| {
                let e = offsets[lane] - block.rest[lane];
                block.k[lane] * e + block.q[lane] * (e * e * e)
            });
            i += 1;
        }
    }
}

wide! {
    fn set_viscous_forces(blocks: &[LinkBlock], v: &[f64], signed_forces: &mut [[[f64; LINK_LANES]; 2]]) {
        let mut i = 0;
        while i < blocks.len() {
            let (block, stretches) = (&blocks[i], end_differences(&blocks[i], v));
            set_block_forces(&mut signed_forces[i], |lane| block.z[lane] * stretches[lane]);
            i += 1;
        }
    }
}

wide! {
    fn set_total_forces(blocks: &[LinkBlock], x: &[f64], v: &[f64], signed_forces: &mut [[[f64; LINK_LANES]; 2]]) {
        let mut i = 0;
        while i < blocks.len() {
            let block = &blocks[i];
            let (offsets, stretches) = (end_differences(block, x), end_differences(block, v));
            set_block_forces(&mut signed_forces[i], |lane| {
                let e = offsets[lane] - block.rest[lane];
                block.k[lane] * e + block.q[lane] * (e * e * e) + block.z[lane] * stretches[lane]
            });
            i += 1;
        }
    }
}

wide! {
    /// Set the force on each MAT that a link pulls.
    fn sum_forces(force_sums: &ForceSums, signed_forces: &[[[f64; LINK_LANES]; 2]], force: &mut [f64]) {
        let signed_forces = signed_forces.as_flattened().as_flattened();
        for block in &force_sums.blocks {
            let terms = &force_sums.terms[block.terms.clone()];
            let mut lane_sums = [0.0; SUM_LANES];
            let mut row = 0;
            while row < terms.len() {
                let term_row = terms[row];
                let mut lane = 0;
                while lane < SUM_LANES {
                    lane_sums[lane] += signed_forces[term_row[lane] as usize];
                    lane += 1;
                }
                row += 1;
            }
            let mut lane = 0;
            while lane < SUM_LANES {
                force[block.mats[lane] as usize] = lane_sums[lane];
                lane += 1;
            }
        }
    }
}
