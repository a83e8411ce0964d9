//! Pairs of points that touch, one batch at a time. They are found without branches; their directions and forces are
//! computed in vectors, and added to the points one pair after the other.

use super::contact::TouchingPair;
use super::{Pair, Quad};
use crate::maths::wide::wide;
use crate::network::{AXES_MAX, PairRun, SpaceLaw, difference, length_and_unit_vector};
use crate::state::ContactHistory;

/// Number of pairs in a batch: its arrays fit into the first-level cache.
pub(super) const BATCH_PAIRS: usize = 128;

/// Forces on points and, as last number, the sum of the pair forces on each [N]; kept apart for points that are the
/// first and those that are the second of a pair.
#[derive(Clone, Debug, Default)]
pub(super) struct PointForces {
    /// (n each)
    pub(super) on_first: Vec<Quad>,
    pub(super) on_second: Vec<Quad>,
}

/// Scratch memory for the pairs of a batch   (BATCH each).
#[derive(Clone, Debug, Default)]
pub(super) struct Batch {
    touching_pairs: Vec<Pair>,
    /// The unit vector from the first point to the second, and the change of the vector between them in the last step
    /// [m].
    directions: [Vec<f64>; AXES_MAX],
    relative_steps: [Vec<f64>; AXES_MAX],
    /// Distance − rest [m], and its change in the last step.
    elongations: Vec<f64>,
    elongation_steps: Vec<f64>,
    /// Force that pulls the ends together [N], and its elastic part.
    pair_forces: Vec<f64>,
    elastic_forces: Vec<f64>,
    point_forces: Vec<Quad>,
}

impl Batch {
    pub(super) fn new() -> Self {
        let zeroed_batch = || vec![0.0; BATCH_PAIRS];
        Self {
            touching_pairs: vec![Pair::default(); BATCH_PAIRS],
            directions: std::array::from_fn(|_| zeroed_batch()),
            relative_steps: std::array::from_fn(|_| zeroed_batch()),
            elongations: zeroed_batch(),
            elongation_steps: zeroed_batch(),
            pair_forces: zeroed_batch(),
            elastic_forces: zeroed_batch(),
            point_forces: vec![Quad::default(); BATCH_PAIRS],
        }
    }

    /// Add the forces of those pairs that touch, of at most `BATCH_PAIRS` pairs: by the law of a run with K and Z in
    /// `k_and_z`, and by its friction.
    pub(super) fn add_forces(
        &mut self,
        run: &PairRun,
        k_and_z: [f64; 2],
        pairs: &[Pair],
        (x, d): (&[Quad], &[Quad]),
        history: &mut ContactHistory,
        forces: &mut PointForces,
    ) {
        let touch_count = self.find_touching(run.rest, pairs, x);
        let pair_ends = &self.touching_pairs[..touch_count];
        let directions = self
            .directions
            .each_ref()
            .map(|axis_values| &axis_values[..touch_count]);
        let [moved_x, moved_y, moved_z] = self
            .relative_steps
            .each_mut()
            .map(|axis_values| &mut axis_values[..touch_count]);
        let (elongations, stretch_steps) = (
            &mut self.elongations[..touch_count],
            &mut self.elongation_steps[..touch_count],
        );
        let (pair_forces, elastic) = (
            &mut self.pair_forces[..touch_count],
            &mut self.elastic_forces[..touch_count],
        );
        subtract_pairs(d, pair_ends, [&mut *moved_x, &mut *moved_y, &mut *moved_z]);
        dot_products(directions, [&*moved_x, &*moved_y, &*moved_z], stretch_steps);
        match &run.pairs.link.law {
            SpaceLaw::Contact {
                exponent: 1.0,
                is_clamped,
            } => set_linear_forces(
                k_and_z,
                *is_clamped,
                [&*elongations, &*stretch_steps],
                [&mut *elastic, &mut *pair_forces],
            ),
            law => {
                for i in 0..touch_count {
                    elastic[i] = law.elastic(k_and_z[0], elongations[i]);
                    pair_forces[i] =
                        law.damped([k_and_z[0], elongations[i]], elastic[i], k_and_z[1] * stretch_steps[i]);
                }
            }
        }
        // The last number sums the pair forces on a point. Within one group each point of a pair gets half the force;
        // of two groups only the sum at the second is read, and gets all of it.
        let point_share = if run.pairs.is_within { 0.5 } else { 1.0 };
        let point_force = &mut self.point_forces[..touch_count];
        set_force_components(pair_forces, directions, -point_share, point_force);
        if run.pairs.friction > 0.0 {
            for (k, (&[i, j], point_force)) in pair_ends.iter().zip(&mut *point_force).enumerate() {
                let (first_point, second_point) = (x[i as usize], x[j as usize]);
                let quad_vector = |quad: Quad| [quad[0], quad[1], quad[2]];
                let contact = TouchingPair {
                    elongation: elongations[k],
                    force: pair_forces[k],
                    elastic_force: elastic[k],
                    direction: directions.map(|axis_values| axis_values[k]),
                    offset: difference(quad_vector(second_point), quad_vector(first_point)),
                    relative_step: [moved_x[k], moved_y[k], moved_z[k]],
                };
                let friction_force = contact.friction_force(&run.pairs, k_and_z, [i, j], history);
                for (point_force, friction_force) in point_force.iter_mut().zip(friction_force) {
                    *point_force += friction_force;
                }
            }
        }
        add_to_points(pair_ends, point_force, &mut forces.on_first, &mut forces.on_second);
    }

    /// Store the ends of the pairs that touch, their directions and e; returns their number. NaN counts as a touch, so
    /// that it reaches the positions, where it is detected.
    fn find_touching(&mut self, rest: f64, pairs: &[Pair], x: &[Quad]) -> usize {
        let touch_count = select_near(x, pairs, rest * rest, &mut self.touching_pairs);
        let pair_ends = &self.touching_pairs[..touch_count];
        let [direction_x, direction_y, direction_z] = self
            .directions
            .each_mut()
            .map(|axis_values| &mut axis_values[..touch_count]);
        subtract_pairs(x, pair_ends, [&mut *direction_x, &mut *direction_y, &mut *direction_z]);
        set_directions_and_elongations(
            rest,
            [direction_x, direction_y, direction_z],
            &mut self.elongations[..touch_count],
        );
        if has_rounded(&self.elongations[..touch_count]) {
            self.drop_rounded(touch_count)
        } else {
            touch_count
        }
    }

    /// Drops pairs whose squared distance is below that of `rest`, but whose distance rounds to `rest`: nothing is
    /// pressed there.
    #[cold]
    fn drop_rounded(&mut self, n: usize) -> usize {
        let mut n_retained = 0;
        for i in 0..n {
            if self.elongations[i] >= 0.0 {
                continue;
            }
            self.touching_pairs[n_retained] = self.touching_pairs[i];
            self.elongations[n_retained] = self.elongations[i];
            for axis_values in &mut self.directions {
                axis_values[n_retained] = axis_values[i];
            }
            n_retained += 1;
        }
        n_retained
    }
}

wide! {
    /// Turns vectors between ends into unit vectors, and computes distances − rest.
    fn set_directions_and_elongations(rest: f64, offsets: [&mut [f64]; AXES_MAX], e: &mut [f64]) {
        let n = e.len();
        let [x, y, z] = offsets;
        let (x, y, z) = (&mut x[..n], &mut y[..n], &mut z[..n]);
        for i in 0..n {
            let length;
            (length, [x[i], y[i], z[i]]) = length_and_unit_vector([x[i], y[i], z[i]]);
            e[i] = length - rest;
        }
    }
}

wide! {
    /// Copies the pairs whose squared distance is below `square`, or NaN, to `near_pairs`, in their order; returns
    /// their number.
    pub(super) fn select_near(x: &[Quad], pairs: &[Pair], square: f64, near_pairs: &mut [Pair]) -> usize {
        let near_pairs = &mut near_pairs[..pairs.len()];
        let mut n = 0;
        for &[i, j] in pairs {
            let (first_point, second_point) = (&x[i as usize], &x[j as usize]);
            let [x, y, z] = [second_point[0] - first_point[0], second_point[1] - first_point[1], second_point[2] - first_point[2]];
            near_pairs[n] = [i, j];
            let is_far = x * x + y * y + z * z >= square;
            n += usize::from(!is_far);
        }
        n
    }
}

wide! {
    /// Value of the second point of each pair minus that of the first, axis by axis.
    fn subtract_pairs(values: &[Quad], ends: &[Pair], differences: [&mut [f64]; AXES_MAX]) {
        let n = ends.len();
        let [x, y, z] = differences;
        let (x, y, z) = (&mut x[..n], &mut y[..n], &mut z[..n]);
        for (k, &[i, j]) in ends.iter().enumerate() {
            let (first_value, second_value) = (&values[i as usize], &values[j as usize]);
            x[k] = second_value[0] - first_value[0];
            y[k] = second_value[1] - first_value[1];
            z[k] = second_value[2] - first_value[2];
        }
    }
}

wide! {
    /// Whether any entry is 0 or more.
    fn has_rounded(e: &[f64]) -> bool {
        let mut is_any_rounded = false;
        for e in e {
            is_any_rounded |= *e >= 0.0;
        }
        is_any_rounded
    }
}

wide! {
    /// Scalar products.
    fn dot_products(a: [&[f64]; AXES_MAX], b: [&[f64]; AXES_MAX], products: &mut [f64]) {
        let n = products.len();
        let [ax, ay, az] = a.map(|component| &component[..n]);
        let [bx, by, bz] = b.map(|component| &component[..n]);
        for i in 0..n {
            products[i] = ax[i] * bx[i] + ay[i] * by[i] + az[i] * bz[i];
        }
    }
}

wide! {
    /// A contact that pushes by K·p + Z·dp/dt: its elastic force and its total force.
    fn set_linear_forces(
        k_and_z: [f64; 2],
        is_clamped: bool,
        elongations_and_steps: [&[f64]; 2],
        elastic_and_total: [&mut [f64]; 2],
    ) {
        let n = elongations_and_steps[0].len();
        let ([k, z], [e, step], [elastic, f]) = (k_and_z, elongations_and_steps, elastic_and_total);
        let (e, step) = (&e[..n], &step[..n]);
        let (elastic, f) = (&mut elastic[..n], &mut f[..n]);
        for i in 0..n {
            elastic[i] = -k * -e[i];
            f[i] = elastic[i] + z * step[i];
        }
        if is_clamped {
            for f in f {
                *f = f.min(0.0);
            }
        }
    }
}

wide! {
    /// Components of forces along directions, and `sum_share` times each force.
    fn set_force_components(f: &[f64], directions: [&[f64]; AXES_MAX], sum_share: f64, force_parts: &mut [Quad]) {
        let n = f.len();
        let [x, y, z] = directions.map(|component| &component[..n]);
        let force_parts = &mut force_parts[..n];
        for i in 0..n {
            force_parts[i] = [f[i] * x[i], f[i] * y[i], f[i] * z[i], sum_share * f[i]];
        }
    }
}

wide! {
    /// Add each part to the first point of its pair, and subtract it from the second.
    fn add_to_points(ends: &[Pair], parts: &[Quad], first: &mut [Quad], second: &mut [Quad]) {
        for (&[i, j], part) in ends.iter().zip(parts) {
            let first_force = &mut first[i as usize];
            for axis in 0..=AXES_MAX {
                first_force[axis] += part[axis];
            }
            let second_force = &mut second[j as usize];
            for axis in 0..=AXES_MAX {
                second_force[axis] -= part[axis];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::distance;

    /// Friction divides by the penetration, which rounding could make 0.
    #[test]
    fn batch_find_presses_touching_pairs() {
        let mut batch = Batch::new();
        let mut n_rounded = 0;
        for i in 1..20_000 {
            let rest_distance = 1e-6 * f64::from(i);
            let (x, y) = (0.6 * rest_distance, 0.8 * rest_distance);
            let is_near = x * x + y * y < rest_distance * rest_distance;
            n_rounded += u32::from(is_near && distance(x, y, 0.0) >= rest_distance);
            // A second pair that certainly touches comes after it.
            let point_quads = [[0.0; 4], [x, y, 0.0, 0.0], [0.5 * rest_distance, 0.0, 0.0, 0.0]];
            let touch_count = batch.find_touching(rest_distance, &[[0, 1], [0, 2]], &point_quads);
            assert!(batch.elongations[..touch_count].iter().all(|e| *e < 0.0), "{x} {y}");
            assert_eq!(batch.touching_pairs[touch_count - 1], [0, 2]);
            assert!((batch.directions[0][touch_count - 1] - 1.0).abs() < 1e-15);
        }
        assert!(n_rounded > 0, "the loop has no such length");
    }
}
