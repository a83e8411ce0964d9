//! Walls, and forces that act at a distance: every point of the second group is visited.
//!
//! Most points touch no wall. A vectorised test selects those that may touch, with a small margin, so that it misses
//! none.

use super::contact::TouchingPair;
use crate::maths::wide::wide;
use crate::network::{AXES_MAX, Measure, PairRun};
use crate::state::ContactHistory;

/// Number of points that are skipped together if none of them may touch.
const SKIP_LENGTH: usize = 8;
/// Allowance for the rounding of a squared length, relative to it.
const ROUNDING: f64 = 1e-12;

/// Add the forces of all pairs to the coordinates of the points, and set `pushes` to the sum of the pair forces on each
/// point of the second group [N].
pub(super) fn add_wall_forces(
    run: &PairRun,
    k_and_z: [f64; 2],
    (x, d): (&[f64], &[f64]),
    (may_touch, history): (&mut [bool], &mut ContactHistory),
    (pair_force, pushes): (&mut [f64], &mut [f64]),
) {
    let (pairs, link) = (&run.pairs, &run.pairs.link);
    pushes.fill(0.0);
    let mut add_pair = |first: usize, second: usize| {
        let pair_ends = (run.a + first, run.b + second);
        let (pair_distance, direction) = link.length_and_direction(pair_ends, |mat| x[mat]);
        let elongation = pair_distance - run.rest;
        if !link.law.acts_at(elongation) {
            return;
        }
        let stretch_step = link.length_step(pair_ends, direction, |mat| d[mat]);
        let elastic_force = link.law.elastic(k_and_z[0], elongation);
        let force = link
            .law
            .damped([k_and_z[0], elongation], elastic_force, k_and_z[1] * stretch_step);
        let mut pair_force_vector = direction.map(|along| force * along);
        if pairs.friction > 0.0 {
            let contact = TouchingPair {
                elongation,
                force,
                elastic_force,
                direction,
                offset: link.offset_between(pair_ends, |mat| x[mat]),
                relative_step: link.offset_between(pair_ends, |mat| d[mat]),
            };
            let friction_force = contact.friction_force(pairs, k_and_z, run.points(pair_ends), history);
            pair_force_vector = std::array::from_fn(|axis| pair_force_vector[axis] + friction_force[axis]);
        }
        for (axis, axis_force) in pair_force_vector.into_iter().enumerate().take(link.n_axes) {
            let (first_mat, second_mat) = link.pair(pair_ends, axis);
            pair_force[first_mat] += axis_force;
            pair_force[second_mat] -= axis_force;
        }
        // Within one group, half the force of each pair counts for each of its points.
        if pairs.is_within {
            pushes[first] += 0.5 * force;
            pushes[second] += 0.5 * force;
        } else {
            pushes[second] += force;
        }
    };
    for first in 0..pairs.n_first {
        if !link.law.is_contact() {
            pairs
                .partners(first, run.n_second)
                .for_each(|second| add_pair(first, second));
            continue;
        }
        select_touchable(run, first, x, may_touch);
        for (chunk, may_touch) in may_touch.chunks(SKIP_LENGTH).enumerate() {
            if !may_touch.contains(&true) {
                continue;
            }
            for (i, _) in may_touch.iter().enumerate().filter(|(_, may_touch)| **may_touch) {
                add_pair(first, SKIP_LENGTH * chunk + i);
            }
        }
    }
}

/// Set `may_touch` for the points of the second group that a wall may touch.
fn select_touchable(run: &PairRun, first: usize, x: &[f64], may_touch: &mut [bool]) {
    let link = &run.pairs.link;
    let coordinates = |axis: usize| link.pair((run.a + first, run.b), axis.min(link.n_axes - 1));
    let axis_ends: [(usize, usize); AXES_MAX] = std::array::from_fn(coordinates);
    let wall_position = axis_ends.map(|(a, _)| x[a]);
    let point_positions = axis_ends.map(|(_, b)| &x[b..b + run.n_second]);
    let depth_factor = if link.n_axes == AXES_MAX { 1.0 } else { 0.0 };
    let squared_rest = run.rest * run.rest;
    match &link.measure {
        Measure::Plane([nx, ny, nz]) => {
            select_below(
                [*nx, *ny, nz * depth_factor],
                run.rest,
                wall_position,
                point_positions,
                may_touch,
            );
        }
        Measure::Distance => {
            select_near(
                1.0,
                squared_rest * (1.0 + ROUNDING),
                depth_factor,
                wall_position,
                point_positions,
                may_touch,
            );
        }
        // This measure is minus the distance, so that a `rest` of 0 or more closes the contact everywhere.
        Measure::Within if run.rest < 0.0 => {
            select_near(
                -1.0,
                squared_rest * (1.0 - ROUNDING),
                depth_factor,
                wall_position,
                point_positions,
                may_touch,
            );
        }
        Measure::Within => may_touch.fill(true),
        Measure::Surface(facets) => select_inside(facets.bounds(), wall_position, point_positions, may_touch),
    }
}

wide! {
    /// Which points lie less than `rest` above a plane, or are NaN.
    fn select_below(
        normal: [f64; AXES_MAX],
        rest: f64,
        wall: [f64; AXES_MAX],
        points: [&[f64]; AXES_MAX],
        may_touch: &mut [bool],
    ) {
        let n = may_touch.len();
        let [x, y, z] = points.map(|coordinates| &coordinates[..n]);
        for i in 0..n {
            let [x, y, z] = [x[i] - wall[0], y[i] - wall[1], z[i] - wall[2]];
            let e = normal[0] * x + normal[1] * y + normal[2] * z - rest;
            let is_above = e >= 0.0;
            may_touch[i] = !is_above;
        }
    }
}

wide! {
    /// Which points are nearer than √`square`, or farther if `side` is −1 instead of 1; NaN counts as well.
    fn select_near(
        side: f64,
        square: f64,
        depth_factor: f64,
        wall: [f64; AXES_MAX],
        points: [&[f64]; AXES_MAX],
        may_touch: &mut [bool],
    ) {
        let n = may_touch.len();
        let [x, y, z] = points.map(|coordinates| &coordinates[..n]);
        let limit = side * square;
        for i in 0..n {
            let [x, y, z] = [x[i] - wall[0], y[i] - wall[1], depth_factor * (z[i] - wall[2])];
            let is_off = side * (x * x + y * y + z * z) >= limit;
            may_touch[i] = !is_off;
        }
    }
}

wide! {
    /// Which points are inside a box, or are NaN.
    fn select_inside(
        bounds: [[f64; AXES_MAX]; 2],
        wall: [f64; AXES_MAX],
        points: [&[f64]; AXES_MAX],
        may_touch: &mut [bool],
    ) {
        let n = may_touch.len();
        let [low, high] = bounds;
        let [x, y, z] = points.map(|coordinates| &coordinates[..n]);
        for i in 0..n {
            let [x, y, z] = [x[i] - wall[0], y[i] - wall[1], z[i] - wall[2]];
            let is_below = (x < low[0]) | (y < low[1]) | (z < low[2]);
            let is_above = (x > high[0]) | (y > high[1]) | (z > high[2]);
            may_touch[i] = !(is_below | is_above);
        }
    }
}
