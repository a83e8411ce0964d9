//! Contacts and attractions between all pairs of points of two groups.
//!
//! Pairs of near points are found by cells; the list is kept until a point has moved too far (`neighbours`). Pairs that
//! touch are computed in batches (`batch`). For walls, and for forces that act at a distance, every point is visited
//! (`walls`).
//!
//! Pairs are always added in the order of their points, whatever the cells and batches and however long a list of
//! neighbours was kept: the sums have the same order and the same bits.

mod batch;
mod cells;
mod contact;
mod neighbours;
mod walls;

pub(crate) use contact::TouchingPair;
pub(crate) use neighbours::Neighbours;

use crate::network::{AXES_MAX, PairRun};
use crate::scheme::LinkRun;
use crate::state::ModuleState;

/// Coordinates of a point, or components of a force, and one more number, so that a single vector load takes all.
type Quad = [f64; AXES_MAX + 1];

/// Indices of a pair of points. Points of the second group, if there is one, are counted after those of the first.
type Pair = [u32; 2];

/// Add the forces of all pairs to the coordinates of the points. Also store the sum of the pair forces on each point of
/// the second group [N].
pub(super) fn add_pair_forces(
    run: &LinkRun,
    pair_run: &PairRun,
    gates: &[f64],
    modules: &mut ModuleState,
    (history_index, neighbours): (usize, &mut Neighbours),
) {
    let gate_opening = run.gate.map_or(1.0, |gate| gates[gate]);
    let gated_k_and_z = [gate_opening * run.k, gate_opening * run.z];
    let ModuleState {
        x,
        d,
        pair_forces: pair_force,
        link_forces: link,
        contact_histories: histories,
        ..
    } = modules;
    let run_forces = &mut link[run.first_link..run.first_link + run.len];
    let history = &mut histories[history_index];
    history.begin_pass();
    if pair_run.pairs.is_searched() {
        neighbours.compute_forces(pair_run, gated_k_and_z, (x, d), history);
        neighbours.add_forces(pair_run, pair_force, run_forces);
    } else {
        let may_touch = neighbours.may_touch_wall_mut();
        walls::add_wall_forces(
            pair_run,
            gated_k_and_z,
            (x, d),
            (may_touch, history),
            (pair_force, run_forces),
        );
    }
    history.end_pass();
}
