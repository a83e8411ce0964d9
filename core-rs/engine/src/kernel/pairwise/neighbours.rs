//! Lists of points that may touch: a long list of all pairs that are near, searched rarely, and a short list of the
//! closest, which is selected from the long one.

use std::ops::Range;
use std::slice;

use super::batch::{BATCH_PAIRS, Batch, PointForces, select_near};
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
pub(crate) type PairEnds = (usize, usize);

/// Lists of points that may touch, and the memory to compute their forces.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbours {
    /// Positions and last steps [m]; 0 along axes that the network does not have   (n each)
    positions: Vec<Quad>,
    steps: Vec<Quad>,
    /// Positions of the points when the long list was searched, and when the short list was selected [m]   (n each)
    searched_positions: Vec<Quad>,
    narrowed_positions: Vec<Quad>,
    cells: Cells,
    /// The long list of pairs; the short list is the first `n_short_list` of `short_list`.
    long_list: Vec<Pair>,
    short_list: Vec<Pair>,
    n_short_list: usize,
    /// Ranges that contain every point of the short list: only these are followed and pushed in each frame. Of a skin
    /// on which a few beads lie, they are a small part.
    active_ranges: Vec<Range<usize>>,
    /// Whether a point is in the short list, and the square of the distance that it moved since the list was selected
    /// [m²]   (n each)
    is_active: Vec<bool>,
    squared_distances: Vec<f64>,
    batch: Batch,
    forces: PointForces,
    /// Which points a wall may touch   (n)
    may_touch_wall: Vec<bool>,
    has_lists: bool,
    /// More points are near each other than contact forces allow.
    has_too_many_pairs: bool,
}

impl Neighbours {
    pub(crate) fn new(run: &PairRun) -> Self {
        let pairs = &run.pairs;
        if !pairs.is_searched() {
            return Self {
                may_touch_wall: vec![true; run.n_second],
                ..Self::default()
            };
        }
        let point_count = pairs.n_points(run.n_second);
        let zeroed_quads = || vec![Quad::default(); point_count];
        Self {
            positions: zeroed_quads(),
            steps: zeroed_quads(),
            searched_positions: zeroed_quads(),
            narrowed_positions: zeroed_quads(),
            cells: Cells::new(point_count, pairs.link.n_axes),
            long_list: Vec::with_capacity(n_reserved_pairs(point_count)),
            short_list: Vec::with_capacity(n_reserved_pairs(point_count)),
            active_ranges: Vec::with_capacity(point_count / GAP_MIN + 1),
            is_active: vec![false; point_count],
            squared_distances: vec![0.0; point_count],
            batch: Batch::new(),
            forces: PointForces {
                on_first: zeroed_quads(),
                on_second: zeroed_quads(),
            },
            ..Self::default()
        }
    }

    pub(super) fn may_touch_wall_mut(&mut self) -> &mut [bool] {
        &mut self.may_touch_wall
    }

    /// Calls `visit` for every pair that touches or attracts at positions `x`, with the MATs of the pair along the
    /// first axis, its distance − rest [m], and its direction. Returns false if there are too many pairs.
    pub(crate) fn for_each_touching(
        &mut self,
        run: &PairRun,
        x: impl Fn(usize) -> f64,
        mut visit: impl FnMut(PairEnds, f64, [f64; AXES_MAX]),
    ) -> bool {
        let pairs = &run.pairs;
        if !pairs.is_searched() {
            for first in 0..pairs.n_first {
                for second in pairs.partners(first, run.n_second) {
                    let pair_ends = (run.a + first, run.b + second);
                    let (pair_distance, direction) = pairs.link.length_and_direction(pair_ends, &x);
                    let elongation = pair_distance - run.rest;
                    if pairs.link.law.acts_at(elongation) {
                        visit(pair_ends, elongation, direction);
                    }
                }
            }
            return true;
        }
        self.update(run, x);
        for &[i, j] in &self.short_list[..self.n_short_list] {
            let [first_point, second_point] = [self.positions[i as usize], self.positions[j as usize]];
            if let Some((elongation, direction)) = touching_elongation(run.rest, first_point, second_point) {
                visit(run.ends([i, j]), elongation, direction);
            }
        }
        !self.has_too_many_pairs
    }

    /// Update the lists and the positions of all points for positions `x`.
    fn update(&mut self, run: &PairRun, x: impl Fn(usize) -> f64) {
        let all_points = 0..self.positions.len();
        copy_coordinates(run, slice::from_ref(&all_points), &mut self.positions, x);
        if !self.has_lists
            || !are_points_within(
                &self.positions,
                &self.narrowed_positions,
                squared_movement_max(SHORT_LIST_MARGIN * run.rest),
            )
        {
            self.select_short_list(run);
        }
    }

    /// Update the lists and the positions of the active points for positions `x` [m] (n_mat).
    fn update_active(&mut self, run: &PairRun, x: &[f64]) {
        if self.has_lists && self.is_short_list_valid(run, x) {
            copy_coordinates(run, &self.active_ranges, &mut self.positions, |mat| x[mat]);
        } else {
            self.update(run, |mat| x[mat]);
        }
    }

    /// Whether no point has moved beyond the margin of the short list, by positions `x` [m] (n_mat).
    fn is_short_list_valid(&mut self, run: &PairRun, x: &[f64]) -> bool {
        self.squared_distances.fill(0.0);
        for (range, first_mats) in point_groups(run) {
            let (squares, narrowed_at) = (
                &mut self.squared_distances[range.clone()],
                &self.narrowed_positions[range.clone()],
            );
            for (axis, first_mat) in first_mats.into_iter().enumerate().take(run.pairs.link.n_axes) {
                add_squared_distances(&x[first_mat..][..range.len()], narrowed_at, axis, squares);
            }
        }
        are_at_most(
            &self.squared_distances,
            squared_movement_max(SHORT_LIST_MARGIN * run.rest),
        )
    }

    /// Select the short list for the positions of all points, and search the long list if it is no longer valid.
    #[cold]
    fn select_short_list(&mut self, run: &PairRun) {
        let (skin_width, margin_width) = (LONG_LIST_MARGIN * run.rest, SHORT_LIST_MARGIN * run.rest);
        if !self.has_lists
            || !are_points_within(
                &self.positions,
                &self.searched_positions,
                squared_movement_max(skin_width - margin_width),
            )
        {
            let n_first = run.pairs.n_first;
            let search_radius = run.rest + skin_width;
            self.searched_positions.copy_from_slice(&self.positions);
            self.has_too_many_pairs = !self
                .cells
                .search(&self.positions, n_first, search_radius, &mut self.long_list);
            if self.short_list.len() < self.long_list.len() {
                self.short_list.resize(self.long_list.len(), Pair::default());
            }
            self.has_lists = true;
        }
        self.narrowed_positions.copy_from_slice(&self.positions);
        let squared_reach = square(run.rest + margin_width);
        self.n_short_list = select_near(&self.positions, &self.long_list, squared_reach, &mut self.short_list);
        self.select_active();
    }

    /// Set `active_ranges` to ranges that contain every point of the short list.
    fn select_active(&mut self) {
        self.is_active.fill(false);
        for point in self.short_list[..self.n_short_list].iter().flatten() {
            self.is_active[*point as usize] = true;
        }
        self.active_ranges.clear();
        for point in (0..self.is_active.len()).filter(|&point| self.is_active[point]) {
            match self.active_ranges.last_mut() {
                Some(range) if point - range.end < GAP_MIN => range.end = point + 1,
                _ => self.active_ranges.push(point..point + 1),
            }
        }
    }

    /// Compute the forces of all pairs by the law of a run with K and Z in `k_and_z`, and by its friction.
    pub(super) fn compute_forces(
        &mut self,
        run: &PairRun,
        k_and_z: [f64; 2],
        (x, d): (&[f64], &[f64]),
        history: &mut ContactHistory,
    ) {
        self.update_active(run, x);
        copy_coordinates(run, &self.active_ranges, &mut self.steps, |mat| d[mat]);
        for range in &self.active_ranges {
            self.forces.on_first[range.clone()].fill(Quad::default());
            self.forces.on_second[range.clone()].fill(Quad::default());
        }
        for pairs in self.short_list[..self.n_short_list].chunks(BATCH_PAIRS) {
            let motion = (&*self.positions, &*self.steps);
            self.batch
                .add_forces(run, k_and_z, pairs, motion, history, &mut self.forces);
        }
    }

    /// Add the forces to `force` (n_mat), and set `pushes` to the sum of the pair forces on each point of the second
    /// group [N]   (run.n).
    pub(super) fn add_forces(&self, run: &PairRun, force: &mut [f64], pushes: &mut [f64]) {
        let PointForces { on_first, on_second } = &self.forces;
        for (group, first_mats) in point_groups(run) {
            for range in clipped_to(&self.active_ranges, &group) {
                let zipped_forces = || on_first[range.clone()].iter().zip(&on_second[range.clone()]);
                for (axis, first_mat) in first_mats.into_iter().enumerate().take(run.pairs.link.n_axes) {
                    let point_forces = force[first_mat + range.start - group.start..].iter_mut();
                    for (force, (first, second)) in point_forces.zip(zipped_forces()) {
                        *force += second[axis] + first[axis];
                    }
                }
            }
        }
        let reported_points = on_first.len() - pushes.len()..on_first.len();
        pushes.fill(0.0);
        for range in clipped_to(&self.active_ranges, &reported_points) {
            let zipped_forces = on_first[range.clone()].iter().zip(&on_second[range.clone()]);
            for (push, (first, second)) in pushes[range.start - reported_points.start..]
                .iter_mut()
                .zip(zipped_forces)
            {
                *push = second[AXES_MAX] - first[AXES_MAX];
            }
        }
        if self.has_too_many_pairs {
            pushes.fill(f64::NAN);
            force[run.a] = f64::NAN;
        }
    }
}

fn square(x: f64) -> f64 {
    x * x
}

/// Square of the distance that a point may move before a list of this width is invalid [m²].
fn squared_movement_max(width: f64) -> f64 {
    square(ALMOST_HALF * width)
}

/// The parts of ranges that lie within another range.
fn clipped_to<'a>(ranges: &'a [Range<usize>], limits: &'a Range<usize>) -> impl Iterator<Item = Range<usize>> + 'a {
    let clipped_ranges = ranges
        .iter()
        .map(|range| range.start.max(limits.start)..range.end.min(limits.end));
    clipped_ranges.filter(|range| !range.is_empty())
}

/// The point indices of each group, and the MATs of its first point, axis by axis.
fn point_groups(run: &PairRun) -> [(Range<usize>, [usize; AXES_MAX]); 2] {
    let Pairwise { link, n_first, .. } = &run.pairs;
    let (a_point_mats, b_point_mats): ([usize; AXES_MAX], [usize; AXES_MAX]) = {
        let coordinates = |axis: usize| link.pair((run.a, run.b), axis.min(link.n_axes - 1));
        let axis_pairs: [(usize, usize); AXES_MAX] = std::array::from_fn(coordinates);
        (axis_pairs.map(|ends| ends.0), axis_pairs.map(|ends| ends.1))
    };
    let second_group = *n_first..run.pairs.n_points(run.n_second);
    [(0..*n_first, a_point_mats), (second_group, b_point_mats)]
}

/// Copy values of MATs to arrays in which the coordinates of a point lie together, for points in some ranges.
fn copy_coordinates(run: &PairRun, ranges: &[Range<usize>], quads: &mut [Quad], value_of: impl Fn(usize) -> f64) {
    for (group, first_mats) in point_groups(run) {
        for range in clipped_to(ranges, &group) {
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
    fn add_squared_distances(coordinates: &[f64], earlier_points: &[Quad], axis: usize, squares: &mut [f64]) {
        let n = squares.len();
        let (coordinates, earlier_points) = (&coordinates[..n], &earlier_points[..n]);
        for i in 0..n {
            let moved_distance = coordinates[i] - earlier_points[i][axis];
            squares[i] += moved_distance * moved_distance;
        }
    }
}

wide! {
    /// Whether no number is above `limit` or NaN.
    fn are_at_most(numbers: &[f64], limit: f64) -> bool {
        let mut is_none_above = true;
        for number in numbers {
            is_none_above &= *number <= limit;
        }
        is_none_above
    }
}

wide! {
    /// Whether no point has moved farther than √`squared_limit` [m] and no position is NaN.
    fn are_points_within(points: &[Quad], earlier_points: &[Quad], squared_limit: f64) -> bool {
        let mut is_none_beyond = true;
        for (point, earlier) in points.iter().zip(earlier_points) {
            let [x, y, z] = [point[0] - earlier[0], point[1] - earlier[1], point[2] - earlier[2]];
            is_none_beyond &= x * x + y * y + z * z <= squared_limit;
        }
        is_none_beyond
    }
}

/// Distance − rest and direction of a pair that touches. NaN counts as a touch, so that it is detected later.
#[inline(always)]
fn touching_elongation(rest: f64, first_position: Quad, second_position: Quad) -> Option<(f64, [f64; AXES_MAX])> {
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
