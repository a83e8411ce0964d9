//! Outputs: sums over ranges by a fixed tree of eight lanes, independent of the vector width.

use crate::maths::wide::wide;
use crate::network::Term;
use crate::scheme::{Scheme, Tap};
use crate::state::ModuleState;

/// Write one frame of outputs, (n_out).
pub(crate) fn write_outputs(scheme: &Scheme, modules: &ModuleState, frame: &mut [f64]) {
    for (taps, sample) in scheme.taps.iter().zip(frame) {
        let tap_value = |tap: &Tap| match tap {
            Tap::Term(term) => term_value(scheme, modules, term),
            Tap::Scattered { mats, weight } => weight * scattered_sum(&modules.x, mats),
            Tap::Lengths { links, weight } => {
                let line_links = links.iter();
                let line_lengths =
                    line_links.map(|(ends, link)| link.length_and_direction(*ends, |mat| modules.x[mat]).0);
                weight * line_lengths.sum::<f64>()
            }
        };
        *sample = taps.iter().map(tap_value).sum();
    }
}

fn term_value(scheme: &Scheme, modules: &ModuleState, term: &Term) -> f64 {
    match *term {
        Term::Position { first, len, weight } => weight * range_sum(&modules.x[first..first + len]),
        Term::Length { .. } => 0.0, // summed by `Tap::Lengths`
        // A link with force f acts with −f on its second point.
        Term::Force { first, len, weight } => -weight * range_sum(&modules.link_forces[first..first + len]),
        Term::Ground { first, len, weight } => {
            let mat_range = first..first + len;
            let (stiffnesses, positions) = (&scheme.tie_stiffness[mat_range.clone()], &modules.x[mat_range.clone()]);
            weight * ground_force_sum(stiffnesses, positions, &scheme.rest[mat_range])
        }
    }
}

fn range_sum(range: &[f64]) -> f64 {
    match *range {
        [single_value] => single_value,
        _ => lane_sum(range),
    }
}

wide! {
    pub(super) fn lane_sum(range: &[f64]) -> f64 {
        let mut lanes = [0.0; 8];
        let eights = range.chunks_exact(8);
        let remainder = eights.remainder();
        for eight in eights {
            for (lane, value) in lanes.iter_mut().zip(eight) {
                *lane += value;
            }
        }
        for (lane, value) in lanes.iter_mut().zip(remainder) {
            *lane += value;
        }
        lane_total(lanes)
    }
}

wide! {
    pub(super) fn scattered_sum(x: &[f64], mats: &[u32]) -> f64 {
        let mut lanes = [0.0; 8];
        let eights = mats.chunks_exact(8);
        let remainder = eights.remainder();
        for eight in eights {
            for (lane, mat) in lanes.iter_mut().zip(eight) {
                *lane += x[*mat as usize];
            }
        }
        for (lane, mat) in lanes.iter_mut().zip(remainder) {
            *lane += x[*mat as usize];
        }
        lane_total(lanes)
    }
}

/// Sum of the forces of CELs on the ground, K·(x − rest) [N].
fn ground_force_sum(k: &[f64], x: &[f64], rest: &[f64]) -> f64 {
    let ground_force = |i: usize| k[i] * (x[i] - rest[i]);
    if x.len() == 1 {
        return ground_force(0);
    }
    let mut lane_sum = [0.0; 8];
    for i in 0..x.len() {
        lane_sum[i % 8] += ground_force(i);
    }
    lane_total(lane_sum)
}

#[inline(always)]
fn lane_total(lanes: [f64; 8]) -> f64 {
    ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]))
}

#[cfg(test)]
mod tests;
