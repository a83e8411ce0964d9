//! Quantities of a mesh that a step does not need: acceleration of one MAT, energies.

use super::mesh::Mesh;
use crate::scheme::Spring;
use crate::scheme::tension_energy;

impl Spring {
    /// Energy at elongation `e` [J].
    fn potential(&self, e: f64) -> f64 {
        0.5 * self.k * (e * e) + 0.25 * self.q * (e * e * e * e)
    }
}

impl Mesh {
    /// Turn last steps x[n] − x[n−1] into velocities per step at n, by adding half a step's acceleration; `scratch`,
    /// `x` and `v`: (n_mat).
    pub(super) fn velocities_from_steps(&self, x: &[f64], v: &mut [f64], scratch: &mut [f64]) {
        for (mat, half_acceleration) in scratch.iter_mut().enumerate() {
            *half_acceleration = 0.5 * self.acceleration(mat, &|i| x[i], &|i| v[i]);
        }
        for (v, half_acceleration) in v.iter_mut().zip(scratch) {
            *v += *half_acceleration;
        }
    }

    /// Acceleration per step squared of one MAT [m], for positions and velocities given as functions of a MAT's index.
    pub(super) fn acceleration(&self, mat: usize, x: &dyn Fn(usize) -> f64, v: &dyn Fn(usize) -> f64) -> f64 {
        let mesh_scheme = &self.scheme;
        let mut net_force = 0.0;
        let springs = self.springs.iter().map(|run| (run.a, run.b, run.len));
        let other_ends = self.other_runs.iter().map(|run| (run.a, run.b, run.len));
        for (run_index, (a, b, len)) in springs.chain(other_ends).enumerate() {
            for (end, sign) in [(a, 1.0), (b, -1.0)] {
                let Some(index_in_run) = mat.checked_sub(end).filter(|index_in_run| *index_in_run < len) else {
                    continue;
                };
                let (end_distance, distance_rate) = (
                    x(b + index_in_run) - x(a + index_in_run),
                    v(b + index_in_run) - v(a + index_in_run),
                );
                net_force += sign
                    * match self.springs.get(run_index) {
                        Some(run) => {
                            let e = end_distance - run.rest;
                            run.k * e + run.q * (e * e * e) + run.z * distance_rate
                        }
                        None => {
                            let run = &self.other_runs[run_index - self.springs.len()];
                            let elongation =
                                |index_in_run: usize| x(run.b + index_in_run) - x(run.a + index_in_run) - run.rest;
                            match run.shared_stiffness(elongation) {
                                0.0 => run.force(end_distance - run.rest, distance_rate),
                                stiffness => stiffness * (end_distance - run.rest),
                            }
                        }
                    };
            }
        }
        net_force * mesh_scheme.w[mat]
            - mesh_scheme.kappa[mat] * (x(mat) - mesh_scheme.rest[mat])
            - mesh_scheme.zeta[mat] * v(mat)
    }

    /// Kinetic energy at velocities `v` [J].
    pub(super) fn kinetic_energy(&self, v: &[f64]) -> f64 {
        self.scaled_masses.iter().zip(v).map(|(m, v)| 0.5 * m * (v * v)).sum()
    }

    /// Potential energy of all links and ties at positions `x` [J].
    pub(super) fn potential_energy(&self, x: &[f64]) -> f64 {
        let mut energy_sum = self.ground_energy(&|i| x[i], &|i| x[i]);
        for run in self.springs.iter() {
            energy_sum += sum_over(run.len, |i| run.potential(x[run.b + i] - x[run.a + i] - run.rest));
        }
        for run in &self.other_runs {
            let elongation = |i: usize| x[run.b + i] - x[run.a + i] - run.rest;
            let shared_stiffness = run.shared_stiffness(elongation);
            energy_sum += sum_over(run.len, |i| {
                run.potential_energy(elongation(i)) + tension_energy(shared_stiffness, elongation(i))
            });
        }
        energy_sum
    }

    /// The energy that a staggered scheme conserves between the last frame (x − d) and this one (x) [J]: ½k·e⁻e for
    /// springs, the mean of both values for every other energy. `is_damped` subtracts ¼Z(e − e⁻)² for each damper:
    /// damping that is computed from the last step reduces the effective mass.
    pub(super) fn staggered_energy(&self, x: &[f64], d: &[f64], is_damped: bool) -> f64 {
        let position_before = |i: usize| x[i] - d[i];
        let mut energy_sum = self.kinetic_energy(d) + self.ground_energy(&position_before, &|i| x[i]);
        let loss_factor = if is_damped { 0.25 } else { 0.0 };
        for (i, d) in d.iter().enumerate() {
            energy_sum -= loss_factor * self.scaled_masses[i] * self.scheme.zeta[i] * (d * d);
        }
        for run in self.springs.iter() {
            energy_sum += sum_over(run.len, |i| {
                let e = x[run.b + i] - x[run.a + i] - run.rest;
                let last_e = position_before(run.b + i) - position_before(run.a + i) - run.rest;
                let (square_term, fourth_term) =
                    (e * last_e, 0.5 * (e * e * e * e + last_e * last_e * last_e * last_e));
                0.5 * run.k * square_term + 0.25 * run.q * fourth_term
                    - loss_factor * run.z * ((e - last_e) * (e - last_e))
            });
        }
        for run in &self.other_runs {
            let elongation = |i: usize| x[run.b + i] - x[run.a + i] - run.rest;
            let last_elongation = |i: usize| position_before(run.b + i) - position_before(run.a + i) - run.rest;
            let shared_stiffnesses = [run.shared_stiffness(elongation), run.shared_stiffness(last_elongation)];
            energy_sum += sum_over(run.len, |i| {
                let [current_energy, last_energy] = [
                    (elongation(i), shared_stiffnesses[0]),
                    (last_elongation(i), shared_stiffnesses[1]),
                ]
                .map(|(e, shared_stiffness)| run.potential_energy(e) + tension_energy(shared_stiffness, e));
                0.5 * (current_energy + last_energy)
            });
        }
        energy_sum
    }

    /// Σ ½κM·(x − rest)(y − rest) [J].
    pub(super) fn ground_energy(&self, x: &dyn Fn(usize) -> f64, y: &dyn Fn(usize) -> f64) -> f64 {
        let mesh_scheme = &self.scheme;
        (0..self.n_mat())
            .filter(|&i| mesh_scheme.kappa[i] != 0.0)
            .map(|i| {
                let (x, y) = (x(i) - mesh_scheme.rest[i], y(i) - mesh_scheme.rest[i]);
                0.5 * self.scaled_masses[i] * mesh_scheme.kappa[i] * (x * y)
            })
            .sum()
    }
}

fn sum_over(n: usize, f: impl Fn(usize) -> f64) -> f64 {
    (0..n).map(f).sum()
}
