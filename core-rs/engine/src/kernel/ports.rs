//! Coupling between ports and a group of modes at instants within a frame: reads positions, applies impulses.

use super::bank::{LANES, LaneSum, Lanes, SUM_LANES, lane_total};
use crate::maths::wide::wide;

/// The sum of a group, lane by lane. The terms come from a loop of their own: fused with the sums they would be loaded
/// from memory one by one.
#[inline(always)]
fn sum_terms(terms: &Lanes) -> f64 {
    let mut lane_sum = LaneSum::ZERO;
    for lane_start in (0..LANES).step_by(SUM_LANES) {
        for (lane, lane_sum) in lane_sum.0.iter_mut().enumerate() {
            *lane_sum += terms.0[lane_start + lane];
        }
    }
    lane_total(&lane_sum)
}

/// Instants are padded to a multiple of this number, so that a table of them is read in whole vectors.
pub(crate) const PADDING: usize = 4;

wide! {
    /// Add to `path` [m], (n), the position of a port at each instant: the sum over modes of its row times the mode's
    /// position, interpolated between `positions` and `next_positions` with weights from `table`, (n_modes, 2, n
    /// padded).
    pub(crate) fn add_path(
        row: &Lanes,
        table: &[f64],
        positions: &Lanes,
        next_positions: &Lanes,
        path: &mut [f64],
    ) {
        // If their number is a constant, the sums stay in registers.
        match path.len().div_ceil(PADDING) {
            1 => add_padded::<4>(row, table, [positions, next_positions], path),
            2 => add_padded::<8>(row, table, [positions, next_positions], path),
            3 => add_padded::<12>(row, table, [positions, next_positions], path),
            4 => add_padded::<16>(row, table, [positions, next_positions], path),
            5 => add_padded::<20>(row, table, [positions, next_positions], path),
            _ => add_padded::<24>(row, table, [positions, next_positions], path),
        }
    }
}

#[inline(always)]
fn add_padded<const N: usize>(row: &Lanes, table: &[f64], [positions, next_positions]: [&Lanes; 2], path: &mut [f64]) {
    let (weight_rows, _) = table.as_chunks::<N>();
    let (mode_weights, _) = weight_rows.as_chunks::<2>();
    let mut path_sums = [0.0; N];
    for (mode, [weights, next_weights]) in mode_weights.iter().enumerate() {
        let [port_term, next_port_term] = [positions, next_positions].map(|lanes| row.0[mode] * lanes.0[mode]);
        for ((sum, weight), next_weight) in path_sums.iter_mut().zip(weights).zip(next_weights) {
            *sum += port_term * weight + next_port_term * next_weight;
        }
    }
    for (x, sum) in path.iter_mut().zip(path_sums) {
        *x += sum;
    }
}

wide! {
    /// Move `modes` by `impulses` at the instants of `table`: their positions at the next frame, and what has to be
    /// added at the one after it. `share`: the share of each mode in the impulses. Move the positions of `rows` of
    /// modes at the next frame too: those in `port_positions`, `stride` entries apart.
    pub(crate) fn apply_impulses(
        impulses: &[f64],
        table: &[[Lanes; 2]],
        share: &Lanes,
        modes: [&mut Lanes; 2],
        rows: &[Lanes],
        port_positions: (&mut [f64], usize),
    ) {
        let mut kicks = [[0.0; LANES]; 2];
        for (&impulse, pair) in impulses.iter().zip(table) {
            for (kick, lanes) in kicks.iter_mut().zip(pair) {
                for (kick, lane) in kick.iter_mut().zip(&lanes.0) {
                    *kick += lane * impulse;
                }
            }
        }
        for (kick, mode_positions) in kicks.iter_mut().zip(modes) {
            for ((kick, share), mode_position) in kick.iter_mut().zip(&share.0).zip(&mut mode_positions.0) {
                *kick *= share;
                *mode_position += *kick;
            }
        }
        let (port_positions, stride) = port_positions;
        for (row, port_position) in rows.iter().zip(port_positions.iter_mut().step_by(stride)) {
            *port_position += weighted_sum(row, &kicks[0]);
        }
    }
}

#[inline(always)]
fn weighted_sum(row: &Lanes, values: &[f64; LANES]) -> f64 {
    let mut lane_terms = Lanes::ZERO;
    for ((term, row), value) in lane_terms.0.iter_mut().zip(&row.0).zip(values) {
        *term = row * value;
    }
    sum_terms(&lane_terms)
}

wide! {
    /// x += factor·y.
    pub(crate) fn add_scaled(x: &mut Lanes, y: &Lanes, factor: f64) {
        for (x, y) in x.0.iter_mut().zip(&y.0) {
            *x += y * factor;
        }
    }
}

wide! {
    /// observed += force·response, as far as `observed` goes.
    pub(crate) fn add_response(observed: &mut [f64], response: &[f64], force: f64) {
        for (observed, response) in observed.iter_mut().zip(response) {
            *observed += response * force;
        }
    }
}

wide! {
    /// Change of the position of a port by a kick: the product of its row and the kick.
    pub(crate) fn port_displacement(row: &Lanes, kick: &Lanes) -> f64 {
        weighted_sum(row, &kick.0)
    }
}
