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
        for (mat, half) in scratch.iter_mut().enumerate() {
            *half = 0.5 * self.acceleration(mat, &|i| x[i], &|i| v[i]);
        }
        for (v, half) in v.iter_mut().zip(scratch) {
            *v += *half;
        }
    }

    /// Acceleration per step squared of one MAT [m], for positions and velocities given as functions of a MAT's index.
    pub(super) fn acceleration(
        &self,
        mat: usize,
        x: &dyn Fn(usize) -> f64,
        v: &dyn Fn(usize) -> f64,
    ) -> f64 {
        let scheme = &self.scheme;
        let mut force = 0.0;
        let springs = self.springs.iter().map(|run| (run.a, run.b, run.len));
        let others = self.others.iter().map(|run| (run.a, run.b, run.len));
        for (run_index, (a, b, len)) in springs.chain(others).enumerate() {
            for (end, sign) in [(a, 1.0), (b, -1.0)] {
                let Some(i) = mat.checked_sub(end).filter(|i| *i < len) else {
                    continue;
                };
                let (e, de) = (x(b + i) - x(a + i), v(b + i) - v(a + i));
                force += sign
                    * match self.springs.get(run_index) {
                        Some(run) => {
                            let e = e - run.rest;
                            run.k * e + run.q * (e * e * e) + run.z * de
                        }
                        None => {
                            let run = &self.others[run_index - self.springs.len()];
                            let run_index = |i: usize| x(run.b + i) - x(run.a + i) - run.rest;
                            match run.tension(run_index) {
                                0.0 => run.force(e - run.rest, de),
                                tension => tension * (e - run.rest),
                            }
                        }
                    };
            }
        }
        force * scheme.w[mat]
            - scheme.kappa[mat] * (x(mat) - scheme.rest[mat])
            - scheme.zeta[mat] * v(mat)
    }

    /// Kinetic energy at velocities `v` [J].
    pub(super) fn kinetic(&self, v: &[f64]) -> f64 {
        self.m.iter().zip(v).map(|(m, v)| 0.5 * m * (v * v)).sum()
    }

    /// Potential energy of all links and ties at positions `x` [J].
    pub(super) fn stored(&self, x: &[f64]) -> f64 {
        let mut sum = self.grounds(&|i| x[i], &|i| x[i]);
        for run in &self.springs {
            sum += total(run.len, |i| {
                run.potential(x[run.b + i] - x[run.a + i] - run.rest)
            });
        }
        for run in &self.others {
            let elongation = |i: usize| x[run.b + i] - x[run.a + i] - run.rest;
            let tension = run.tension(elongation);
            sum += total(run.len, |i| {
                run.potential(elongation(i)) + tension_energy(tension, elongation(i))
            });
        }
        sum
    }

    /// The energy that a staggered scheme conserves between the last frame (x − d) and this one (x) [J]: ½k·e⁻e for
    /// springs, the mean of both values for every other energy. `damped` subtracts ¼Z(e − e⁻)² for each damper: damping
    /// that is computed from the last step reduces the effective mass.
    pub(super) fn staggered(&self, x: &[f64], d: &[f64], damped: bool) -> f64 {
        let before = |i: usize| x[i] - d[i];
        let mut sum = self.kinetic(d) + self.grounds(&before, &|i| x[i]);
        let less = if damped { 0.25 } else { 0.0 };
        for (i, d) in d.iter().enumerate() {
            sum -= less * self.m[i] * self.scheme.zeta[i] * (d * d);
        }
        for run in &self.springs {
            sum += total(run.len, |i| {
                let e = x[run.b + i] - x[run.a + i] - run.rest;
                let last = before(run.b + i) - before(run.a + i) - run.rest;
                let (two, four) = (e * last, 0.5 * (e * e * e * e + last * last * last * last));
                0.5 * run.k * two + 0.25 * run.q * four - less * run.z * ((e - last) * (e - last))
            });
        }
        for run in &self.others {
            let now = |i: usize| x[run.b + i] - x[run.a + i] - run.rest;
            let last = |i: usize| before(run.b + i) - before(run.a + i) - run.rest;
            let tensions = [run.tension(now), run.tension(last)];
            sum += total(run.len, |i| {
                let [now, last] = [(now(i), tensions[0]), (last(i), tensions[1])]
                    .map(|(e, tension)| run.potential(e) + tension_energy(tension, e));
                0.5 * (now + last)
            });
        }
        sum
    }

    /// Σ ½κM·(x − rest)(y − rest) [J].
    pub(super) fn grounds(&self, x: &dyn Fn(usize) -> f64, y: &dyn Fn(usize) -> f64) -> f64 {
        let scheme = &self.scheme;
        (0..self.n_mat())
            .filter(|&i| scheme.kappa[i] != 0.0)
            .map(|i| {
                let (x, y) = (x(i) - scheme.rest[i], y(i) - scheme.rest[i]);
                0.5 * self.m[i] * scheme.kappa[i] * (x * y)
            })
            .sum()
    }
}

fn total(n: usize, f: impl Fn(usize) -> f64) -> f64 {
    (0..n).map(f).sum()
}
