//! Contacts and attractions between all pairs of points of two groups.
//!
//! Points that meet each other are found by cells, and kept while nothing has moved far (`neighbours`); what touches is
//! computed a batch at a time (`batch`). Walls, and what acts from afar, look at every point (`walls`).
//!
//! Pairs are taken in the order of their points, whatever the cells and batches: the same sums in the same order, however
//! long a list of neighbours was kept.

mod batch;
mod cells;
mod contact;
mod neighbours;
mod walls;

pub(crate) use contact::Contact;
pub(crate) use neighbours::Neighbours;

use crate::network::{AXES_MAX, PairRun};
use crate::scheme::Run;
use crate::state::Body;

/// Coordinates of a point, or components of a force, and one number more: a single load takes them all.
type Quad = [f64; AXES_MAX + 1];

/// The numbers of a pair of points: the first group, then the second where it is another.
type Pair = [u32; 2];

/// Add the forces of all pairs to the coordinates of the points, and note how strongly each point of the second group is
/// pushed [N].
pub(super) fn forces(
    run: &Run,
    pairs: &PairRun,
    gates: &[f64],
    body: &mut Body,
    (room, neighbours): (usize, &mut Neighbours),
) {
    let open = run.gate.map_or(1.0, |gate| gates[gate]);
    let by = [open * run.k, open * run.z];
    let Body {
        x,
        d,
        pair_force,
        link,
        histories,
        ..
    } = body;
    let own = &mut link[run.first..run.first + run.len];
    let history = &mut histories[room];
    history.begin();
    if pairs.pairs.is_searched() {
        neighbours.push(pairs, by, (x, d), history);
        neighbours.tell(pairs, pair_force, own);
    } else {
        let seen = neighbours.seen();
        walls::push(pairs, by, (x, d), (seen, history), (pair_force, own));
    }
    history.end();
}
