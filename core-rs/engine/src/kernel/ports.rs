//! Coupling between ports and a group of modes at instants within a frame: reads positions, applies impulses.

use super::bank::{LANES, Lanes, SUMS, Sum, lane_total};
use crate::maths::wide::wide;

/// The sum of a group, lane by lane. The terms come from a loop of their own: fused with the sums they would be loaded
/// from memory one by one.
#[inline(always)]
fn group_total(terms: &Lanes) -> f64 {
    let mut lane_sum = Sum::ZERO;
    for lane_start in (0..LANES).step_by(SUMS) {
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
    /// position, interpolated between `now` and `next` with weights from `table`, (n_modes, 2, n padded).
    pub(crate) fn add_path(
        row: &Lanes,
        table: &[f64],
        now: &Lanes,
        next: &Lanes,
        path: &mut [f64],
    ) {
        // If their number is known when this is compiled, the sums stay in registers.
        match path.len().div_ceil(PADDING) {
            1 => add_padded::<4>(row, table, [now, next], path),
            2 => add_padded::<8>(row, table, [now, next], path),
            3 => add_padded::<12>(row, table, [now, next], path),
            4 => add_padded::<16>(row, table, [now, next], path),
            5 => add_padded::<20>(row, table, [now, next], path),
            _ => add_padded::<24>(row, table, [now, next], path),
        }
    }
}

#[inline(always)]
fn add_padded<const N: usize>(
    row: &Lanes,
    table: &[f64],
    [positions_now, positions_next]: [&Lanes; 2],
    path: &mut [f64],
) {
    let (weights, _) = table.as_chunks::<N>();
    let (weights, _) = weights.as_chunks::<2>();
    let mut path_sums = [0.0; N];
    for (mode, [by_now, by_next]) in weights.iter().enumerate() {
        let [port_now, port_next] = [positions_now, positions_next].map(|positions| row.0[mode] * positions.0[mode]);
        for ((sum, by_now), by_next) in path_sums.iter_mut().zip(by_now).zip(by_next) {
            *sum += port_now * by_now + port_next * by_next;
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
    pub(crate) fn kick(
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
            *port_position += weighted(row, &kicks[0]);
        }
    }
}

#[inline(always)]
fn weighted(row: &Lanes, values: &[f64; LANES]) -> f64 {
    let mut lane_terms = Lanes::ZERO;
    for ((term, row), value) in lane_terms.0.iter_mut().zip(&row.0).zip(values) {
        *term = row * value;
    }
    group_total(&lane_terms)
}

wide! {
    /// x += factor·y.
    pub(crate) fn add(x: &mut Lanes, y: &Lanes, factor: f64) {
        for (x, y) in x.0.iter_mut().zip(&y.0) {
            *x += y * factor;
        }
    }
}

wide! {
    /// seen += force·response, as far as `seen` goes.
    pub(crate) fn add_response(seen: &mut [f64], response: &[f64], force: f64) {
        for (seen, response) in seen.iter_mut().zip(response) {
            *seen += response * force;
        }
    }
}

wide! {
    /// Change of the position of a port by a kick: the product of its row and the kick.
    pub(crate) fn see(row: &Lanes, kick: &Lanes) -> f64 {
        weighted(row, &kick.0)
    }
}
