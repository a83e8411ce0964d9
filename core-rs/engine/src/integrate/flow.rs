//! The exact flow of slow masses, as a kick and straight motion in each frame (method E4).
//!
//! Let E = [[a, b], [c, d]] be the map of positions and velocities of the slow masses, alone, over a frame. It is split
//! exactly into half a kick, straight motion and half a kick. Successive half kicks are joined:
//! v ← B·v − A·x, x += v, with B = b·d·b⁻¹·a − b·c and A = −((a − 1) + b·c + b·d·b⁻¹·(1 − a)).
//! Fast links kick the same velocities. Velocities are in metres a frame.

use super::square::SquareMatrix;

/// The flow of some masses over a frame.
#[derive(Clone, Debug)]
pub(crate) struct Flow {
    /// B: the factor by which a kick multiplies the velocities   (n, n)
    pub(crate) velocity_factor: SquareMatrix,
    /// A: the velocity that a kick removes for each position   (n, n)
    pub(crate) position_pull: SquareMatrix,
    /// a − 1 and b: the velocity of the first straight motion
    start_factors: [SquareMatrix; 2],
}

impl Flow {
    /// The flow of masses whose map over one frame is `frame`. `None` if b has no inverse, as when a mode has exactly
    /// two kicks per period.
    pub(crate) fn new(frame: &SquareMatrix) -> Option<Self> {
        let n_masses = frame.n / 2;
        let [a, b] = [frame.block(0, 0, n_masses), frame.block(0, n_masses, n_masses)];
        let [c, d] = [
            frame.block(n_masses, 0, n_masses),
            frame.block(n_masses, n_masses, n_masses),
        ];
        let conjugated = b.times(&d).times_inverse(&b)?;
        let deviation = a.plus_scaled(&SquareMatrix::identity(n_masses), -1.0);
        let bc = b.times(&c);
        // b·d·b⁻¹·a = b·d·b⁻¹ + b·d·b⁻¹·(a − 1): a − 1 is small, and this form keeps its digits.
        let conjugated_deviation = conjugated.times(&deviation);
        let velocity_factor = conjugated
            .plus_scaled(&conjugated_deviation, 1.0)
            .plus_scaled(&bc, -1.0);
        let position_pull = deviation
            .clone()
            .plus_scaled(&bc, 1.0)
            .plus_scaled(&conjugated_deviation, -1.0);
        Some(Self {
            velocity_factor,
            position_pull: position_pull.scaled(-1.0),
            start_factors: [deviation, b],
        })
    }

    /// The velocity of the first straight motion, given positions and velocities at the start.
    pub(crate) fn start_velocities(&self, x: &[f64], v: &[f64]) -> Vec<f64> {
        let [by_x, by_v] = &self.start_factors;
        let velocity_pairs = by_x.times_vector(x).into_iter().zip(by_v.times_vector(v));
        velocity_pairs.map(|(from_x, from_v)| from_x + from_v).collect()
    }

    /// A frame as a map of positions and velocities: straight motion, then the kick   (2n, 2n).
    pub(crate) fn frame_map(&self) -> SquareMatrix {
        let n_masses = self.velocity_factor.n;
        let mut frame_map = SquareMatrix::identity(2 * n_masses);
        for column in 0..n_masses {
            *frame_map.entry_mut(column, n_masses + column) = 1.0;
            for row in 0..n_masses {
                let (keep_entry, pull_entry) = (
                    self.velocity_factor.value(row, column),
                    self.position_pull.value(row, column),
                );
                *frame_map.entry_mut(n_masses + row, column) = -pull_entry;
                *frame_map.entry_mut(n_masses + row, n_masses + column) = keep_entry - pull_entry;
            }
        }
        frame_map
    }

    /// The error of straight motion and a kick after a push of one mass by a metre a frame at the beginning of a frame.
    /// `end_state` holds the exact positions and velocities at its end. Returns what must be added to positions and
    /// velocities after the kick   (2n).
    pub(crate) fn push_deficit(&self, pushed_mass: usize, end_state: &[f64]) -> Vec<f64> {
        let n_masses = self.velocity_factor.n;
        let (x, v) = end_state.split_at(n_masses);
        let mut unit_push = vec![0.0; n_masses];
        unit_push[pushed_mass] = 1.0;
        let (retained_velocities, pulled_velocities) = (
            self.velocity_factor.times_vector(&unit_push),
            self.position_pull.times_vector(&unit_push),
        );
        let mut velocity_deficit = self.start_velocities(x, v);
        for ((velocity_lack, retained_velocities), pulled_velocities) in velocity_deficit
            .iter_mut()
            .zip(retained_velocities)
            .zip(pulled_velocities)
        {
            *velocity_lack += pulled_velocities - retained_velocities;
        }
        let mut deficit = x.to_vec();
        deficit[pushed_mass] -= 1.0;
        deficit.extend(velocity_deficit);
        deficit
    }
}

/// The map of positions and velocities [m a frame] over one frame, of masses with M⁻¹K and M⁻¹Z in units of a frame:
/// the continuous motion, or one step of CA if `is_discrete`.
pub(crate) fn frame_map(k: &SquareMatrix, z: &SquareMatrix, is_discrete: bool) -> SquareMatrix {
    let n_masses = k.n;
    let mut frame_map = SquareMatrix::zero(2 * n_masses);
    for column in 0..n_masses {
        for row in 0..n_masses {
            let diagonal = if row == column { 1.0 } else { 0.0 };
            let (k, z) = (k.value(row, column), z.value(row, column));
            let [a, b, c, d] = if is_discrete {
                [diagonal - k, diagonal - z, -k, diagonal - z]
            } else {
                [0.0, diagonal, -k, -z]
            };
            *frame_map.entry_mut(row, column) = a;
            *frame_map.entry_mut(row, n_masses + column) = b;
            *frame_map.entry_mut(n_masses + row, column) = c;
            *frame_map.entry_mut(n_masses + row, n_masses + column) = d;
        }
    }
    if is_discrete {
        frame_map
    } else {
        frame_map.exponential()
    }
}

/// M⁻¹K and M⁻¹Z of a row of three masses, for tests: unequal masses and damping of no proportion.
#[cfg(test)]
pub(crate) fn row_of_three() -> (SquareMatrix, SquareMatrix) {
    let (mut k, mut z) = (SquareMatrix::zero(3), SquareMatrix::zero(3));
    let entries = [
        (0, 0, 3e-3, 4e-3),
        (0, 1, -2e-3, -1e-3),
        (1, 0, -1e-3, -5e-4),
        (1, 1, 2.5e-3, 5e-4),
        (1, 2, -1.5e-3, 0.0),
        (2, 1, -3e-3, 0.0),
        (2, 2, 3e-3, 2e-2),
    ];
    for (row, column, stiffness, damping) in entries {
        (*k.entry_mut(row, column), *z.entry_mut(row, column)) = (stiffness, damping);
    }
    (k, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;
    use crate::units::Rate;

    fn scalar(value: f64) -> SquareMatrix {
        SquareMatrix {
            n: 1,
            entries: vec![value],
        }
    }

    /// For one CEL the kicks equal those of its exact CA scheme, here in frames of 10/44,100 s, in closed form.
    #[test]
    fn flow_of_a_cel_has_its_poles() {
        let (frame_rate, cell_mass) = (Rate::new(4410.0).unwrap(), 2e-3);
        let (pi, sigma) = (std::f64::consts::PI, 3.0 * crate::maths::log(10.0));
        let k = cell_mass * ((2.0 * pi * 440.0) * (2.0 * pi * 440.0) + sigma * sigma);
        let z = 2.0 * sigma * cell_mass;
        let time_step = frame_rate.step();
        let physical = frame_map(
            &scalar(k * time_step * time_step / cell_mass),
            &scalar(z * time_step / cell_mass),
            false,
        );
        let cell_ratios = Cell::new(cell_mass, k, z).ratios(frame_rate);
        let discrete = frame_map(&scalar(cell_ratios.kappa), &scalar(cell_ratios.zeta), true);
        for frame in [physical, discrete] {
            let frame_flow = Flow::new(&frame).unwrap();
            assert!((1.0 - frame_flow.velocity_factor.entries[0] - 0.003_127_866_834_001_569).abs() < 1e-13);
            assert!((frame_flow.position_pull.entries[0] - 0.379_699_981_290_506_4).abs() < 1e-12);
        }
    }

    /// Without fast links, kicks and straight motion agree with the exact flow at every kick, whatever the damping.
    #[test]
    fn flow_without_fast_links_is_exact() {
        let (k, z) = row_of_three();
        for is_discrete in [false, true] {
            let frame = frame_map(&k, &z, is_discrete);
            let frame_flow = Flow::new(&frame).unwrap();
            let (x0, v0) = (vec![1.0, -0.5, 2.0], vec![0.01, 0.03, -0.02]);
            let (mut x, mut v) = (x0.clone(), frame_flow.start_velocities(&x0, &v0));
            let mut exact_state = [x0, v0].concat();
            let joined_map = frame_flow.frame_map();
            for _ in 0..480 {
                let next_state = joined_map.times_vector(&[&x[..], &v].concat());
                x.copy_from_slice(&next_state[..3]);
                v.copy_from_slice(&next_state[3..]);
                exact_state = frame.times_vector(&exact_state);
                for (x, exact_state) in x.iter().zip(&exact_state) {
                    assert!((x - exact_state).abs() < 1e-11, "{x} {exact_state}");
                }
            }
        }
    }
}
