//! Lists of points that may touch: a long list of all pairs that are near, searched rarely, and a short list of the
//! closest, which is selected from the long one.

use std::ops::Range;
use std::slice;

use super::batch::{BATCH, Batch, Forces, select_near};
use super::cells::{Cells, n_reserved_pairs};
use super::{Pair, Quad};
use crate::maths::wide::wide;
use crate::network::{AXES_MAX, Measure, PairRun, Pairwise};
use crate::state::ContactHistory;

/// Width of the long list: pairs are kept up to this much beyond the distance of touch, as a fraction of it.
const LONG_LIST_MARGIN: f64 = 0.36;
/// Width of the short list, whose pairs are examined in every frame. It stays valid until a point has moved half of
/// this.
const SHORT_LIST_MARGIN: f64 = 0.06;
/// Slightly less than half, so that rounding leaves out no pair.
const ALMOST_HALF: f64 = 0.499_999;
/// Active points with fewer inactive ones between them than this form one range: a short gap costs less than a loop.
const GAP_MIN: usize = 8;

/// The coordinates of a pair of points along the first axis.
pub(crate) type Ends = (usize, usize);

/// Lists of points that may touch, and the memory to compute their forces.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbours {
    /// Positions and last steps [m]; 0 along axes that the network does not have   (n each)
    x: Vec<Quad>,
    d: Vec<Quad>,
    /// Positions of the points when the long list was searched, and when the short list was selected [m]   (n each)
    searched_at: Vec<Quad>,
    narrowed_at: Vec<Quad>,
    cells: Cells,
    /// The long list of pairs; the short list is the first `n_close` of `close`.
    pairs: Vec<Pair>,
    close: Vec<Pair>,
    n_close: usize,
    /// Ranges that contain every point of the short list: only these are followed and pushed in each frame. Of a skin
    /// on which a few beads lie, they are a small part.
    active: Vec<Range<usize>>,
    /// Whether a point is in the short list, and the square of its way since the list was selected [m²]   (n each)
    is_active: Vec<bool>,
    squares: Vec<f64>,
    batch: Batch,
    forces: Forces,
    /// Which points a wall may touch   (n)
    may_touch_wall: Vec<bool>,
    is_made: bool,
    /// More points are near each other than contact forces allow.
    is_full: bool,
}

impl Neighbours {
    pub(crate) fn new(run: &PairRun) -> Self {
        let pairs = &run.pairs;
        if !pairs.is_searched() {
            return Self {
                may_touch_wall: vec![true; run.n],
                ..Self::default()
            };
        }
        let point_count = pairs.n_points(run.n);
        let zeroed_quads = || vec![Quad::default(); point_count];
        Self {
            x: zeroed_quads(),
            d: zeroed_quads(),
            searched_at: zeroed_quads(),
            narrowed_at: zeroed_quads(),
            cells: Cells::new(point_count, pairs.link.n_axes),
            pairs: Vec::with_capacity(n_reserved_pairs(point_count)),
            close: Vec::with_capacity(n_reserved_pairs(point_count)),
            active: Vec::with_capacity(point_count / GAP_MIN + 1),
            is_active: vec![false; point_count],
            squares: vec![0.0; point_count],
            batch: Batch::new(),
            forces: Forces {
                first: zeroed_quads(),
                second: zeroed_quads(),
            },
            ..Self::default()
        }
    }

    pub(super) fn may_touch_wall_mut(&mut self) -> &mut [bool] {
        &mut self.may_touch_wall
    }

    /// Calls `visit` for every pair that touches or attracts at positions `x`, with the MATs of the pair along the
    /// first axis, its distance − rest [m], and its direction. Returns false if there are too many pairs.
    pub(crate) fn touching(
        &mut self,
        run: &PairRun,
        x: impl Fn(usize) -> f64,
        mut visit: impl FnMut(Ends, f64, [f64; AXES_MAX]),
    ) -> bool {
        let pairs = &run.pairs;
        if !pairs.is_searched() {
            for first in 0..pairs.n_first {
                for second in pairs.others(first, run.n) {
                    let pair_ends = (run.a + first, run.b + second);
                    let (pair_distance, direction) = pairs.link.line(pair_ends, &x);
                    let elongation = pair_distance - run.rest;
                    if pairs.link.law.acts(elongation) {
                        visit(pair_ends, elongation, direction);
                    }
                }
            }
            return true;
        }
        self.update(run, x);
        for &[i, j] in &self.close[..self.n_close] {
            let [first_point, second_point] = [self.x[i as usize], self.x[j as usize]];
            if let Some((elongation, direction)) = meeting(run.rest, first_point, second_point) {
                visit(run.ends([i, j]), elongation, direction);
            }
        }
        !self.is_full
    }

    /// Update the lists and the positions of all points for positions `x`.
    fn update(&mut self, run: &PairRun, x: impl Fn(usize) -> f64) {
        let all_points = 0..self.x.len();
        gather(run, slice::from_ref(&all_points), &mut self.x, x);
        if !self.is_made || !are_within(&self.x, &self.narrowed_at, moved_square(SHORT_LIST_MARGIN * run.rest)) {
            self.narrow(run);
        }
    }

    /// Update the lists and the positions of the active points for positions `x` [m] (n_mat).
    fn follow(&mut self, run: &PairRun, x: &[f64]) {
        if self.is_made && self.is_narrow_for(run, x) {
            gather(run, &self.active, &mut self.x, |mat| x[mat]);
        } else {
            self.update(run, |mat| x[mat]);
        }
    }

    /// Whether no point has moved beyond the margin of the short list, by positions `x` [m] (n_mat).
    fn is_narrow_for(&mut self, run: &PairRun, x: &[f64]) -> bool {
        self.squares.fill(0.0);
        for (range, first_mats) in groups(run) {
            let (squares, narrowed_at) = (&mut self.squares[range.clone()], &self.narrowed_at[range.clone()]);
            for (axis, first_mat) in first_mats.into_iter().enumerate().take(run.pairs.link.n_axes) {
                add_squares(&x[first_mat..][..range.len()], narrowed_at, axis, squares);
            }
        }
        are_at_most(&self.squares, moved_square(SHORT_LIST_MARGIN * run.rest))
    }

    /// Select the short list for the positions of all points, and search the long one if it no longer holds.
    #[cold]
    fn narrow(&mut self, run: &PairRun) {
        let (skin_width, margin_width) = (LONG_LIST_MARGIN * run.rest, SHORT_LIST_MARGIN * run.rest);
        if !self.is_made || !are_within(&self.x, &self.searched_at, moved_square(skin_width - margin_width)) {
            let n_first = run.pairs.n_first;
            let reach = run.rest + skin_width;
            self.searched_at.copy_from_slice(&self.x);
            self.is_full = !self.cells.search(&self.x, n_first, reach, &mut self.pairs);
            if self.close.len() < self.pairs.len() {
                self.close.resize(self.pairs.len(), Pair::default());
            }
            self.is_made = true;
        }
        self.narrowed_at.copy_from_slice(&self.x);
        let squared_reach = square(run.rest + margin_width);
        self.n_close = select_near(&self.x, &self.pairs, squared_reach, &mut self.close);
        self.select_active();
    }

    /// Set `active` to ranges that contain every point of the short list.
    fn select_active(&mut self) {
        self.is_active.fill(false);
        for point in self.close[..self.n_close].iter().flatten() {
            self.is_active[*point as usize] = true;
        }
        self.active.clear();
        for point in (0..self.is_active.len()).filter(|&point| self.is_active[point]) {
            match self.active.last_mut() {
                Some(range) if point - range.end < GAP_MIN => range.end = point + 1,
                _ => self.active.push(point..point + 1),
            }
        }
    }

    /// Compute the forces of all pairs by the law of a run with K and Z in `k_and_z`, and by its friction.
    pub(super) fn push(
        &mut self,
        run: &PairRun,
        k_and_z: [f64; 2],
        (x, d): (&[f64], &[f64]),
        history: &mut ContactHistory,
    ) {
        self.follow(run, x);
        gather(run, &self.active, &mut self.d, |mat| d[mat]);
        for range in &self.active {
            self.forces.first[range.clone()].fill(Quad::default());
            self.forces.second[range.clone()].fill(Quad::default());
        }
        for pairs in self.close[..self.n_close].chunks(BATCH) {
            let motion = (&*self.x, &*self.d);
            self.batch.push(run, k_and_z, pairs, motion, history, &mut self.forces);
        }
    }

    /// Add the forces to `force` (n_mat), and set `pushes` to the sum of the pair forces on each point of the second
    /// group [N]   (run.n).
    pub(super) fn add_forces(&self, run: &PairRun, force: &mut [f64], pushes: &mut [f64]) {
        let Forces { first, second } = &self.forces;
        for (group, first_mats) in groups(run) {
            for range in within(&self.active, &group) {
                let zipped_forces = || first[range.clone()].iter().zip(&second[range.clone()]);
                for (axis, first_mat) in first_mats.into_iter().enumerate().take(run.pairs.link.n_axes) {
                    let point_forces = force[first_mat + range.start - group.start..].iter_mut();
                    for (force, (first, second)) in point_forces.zip(zipped_forces()) {
                        *force += second[axis] + first[axis];
                    }
                }
            }
        }
        let reported = first.len() - pushes.len()..first.len();
        pushes.fill(0.0);
        for range in within(&self.active, &reported) {
            let zipped_forces = first[range.clone()].iter().zip(&second[range.clone()]);
            for (push, (first, second)) in pushes[range.start - reported.start..].iter_mut().zip(zipped_forces) {
                *push = second[AXES_MAX] - first[AXES_MAX];
            }
        }
        if self.is_full {
            pushes.fill(f64::NAN);
            force[run.a] = f64::NAN;
        }
    }
}

fn square(x: f64) -> f64 {
    x * x
}

/// Square of the way that a point may have moved, for a list of this width to hold [m²].
fn moved_square(width: f64) -> f64 {
    square(ALMOST_HALF * width)
}

/// The parts of ranges that lie within another range.
fn within<'a>(ranges: &'a [Range<usize>], limits: &'a Range<usize>) -> impl Iterator<Item = Range<usize>> + 'a {
    let clipped_ranges = ranges
        .iter()
        .map(|range| range.start.max(limits.start)..range.end.min(limits.end));
    clipped_ranges.filter(|range| !range.is_empty())
}

/// The point indices of each group, and the MATs of its first point, axis by axis.
fn groups(run: &PairRun) -> [(Range<usize>, [usize; AXES_MAX]); 2] {
    let Pairwise { link, n_first, .. } = &run.pairs;
    let (a_point_mats, b_point_mats): ([usize; AXES_MAX], [usize; AXES_MAX]) = {
        let coordinates = |axis: usize| link.pair((run.a, run.b), axis.min(link.n_axes - 1));
        let axis_pairs: [(usize, usize); AXES_MAX] = std::array::from_fn(coordinates);
        (axis_pairs.map(|ends| ends.0), axis_pairs.map(|ends| ends.1))
    };
    let second_group = *n_first..run.pairs.n_points(run.n);
    [(0..*n_first, a_point_mats), (second_group, b_point_mats)]
}

/// Copy values of MATs to arrays in which the coordinates of a point lie together, for points in some ranges.
fn gather(run: &PairRun, ranges: &[Range<usize>], quads: &mut [Quad], value_of: impl Fn(usize) -> f64) {
    for (group, first_mats) in groups(run) {
        for range in within(ranges, &group) {
            for (axis, first_mat) in first_mats.into_iter().enumerate().take(run.pairs.link.n_axes) {
                let first_value = first_mat + range.start - group.start;
                for (i, quad) in quads[range.clone()].iter_mut().enumerate() {
                    quad[axis] = value_of(first_value + i);
                }
            }
        }
    }
}

wide! {
    /// Add the squares of what points have moved along an axis.
    fn add_squares(now: &[f64], then: &[Quad], axis: usize, squares: &mut [f64]) {
        let n = squares.len();
        let (now, then) = (&now[..n], &then[..n]);
        for i in 0..n {
            let moved = now[i] - then[i][axis];
            squares[i] += moved * moved;
        }
    }
}

wide! {
    /// Whether no number is above `most` or NaN.
    fn are_at_most(numbers: &[f64], most: f64) -> bool {
        let mut are_at_most = true;
        for number in numbers {
            are_at_most &= *number <= most;
        }
        are_at_most
    }
}

wide! {
    /// Whether no point has moved farther than √`most` [m] and no position is NaN.
    fn are_within(now: &[Quad], then: &[Quad], most: f64) -> bool {
        let mut are_within = true;
        for (now, then) in now.iter().zip(then) {
            let [x, y, z] = [now[0] - then[0], now[1] - then[1], now[2] - then[2]];
            are_within &= x * x + y * y + z * z <= most;
        }
        are_within
    }
}

/// Distance − rest and direction of a pair that touches. NaN counts as a touch, so that it is detected later.
#[inline(always)]
fn meeting(rest: f64, first_position: Quad, second_position: Quad) -> Option<(f64, [f64; AXES_MAX])> {
    let point_offset = [
        second_position[0] - first_position[0],
        second_position[1] - first_position[1],
        second_position[2] - first_position[2],
    ];
    let squared_distance =
        point_offset[0] * point_offset[0] + point_offset[1] * point_offset[1] + point_offset[2] * point_offset[2];
    if squared_distance >= rest * rest {
        return None;
    }
    let (pair_distance, direction) = Measure::Distance.length_and_direction(point_offset);
    let elongation = pair_distance - rest;
    // The squared distance is below that of `rest`, but the distance may round to `rest`: nothing is pressed then.
    if elongation >= 0.0 {
        None
    } else {
        Some((elongation, direction))
    }
}
