//! The steady-state response of parts to a sinusoidal force: mechanical admittances, by one solution per frequency.

use std::f64::consts::{PI, TAU};

use nalgebra::Complex;

use super::Network;
use super::damped::NetworkMatrices;
use super::part_body::PartBody;
use crate::interrupt;
use crate::maths::{cos, sin};
use crate::spectrum::sparse::Factor;

/// Steps of iterative refinement of a solution: the first removes rounding errors, the second finds no more.
const REFINEMENTS: usize = 2;

impl Network {
    /// Mechanical admittance of some parts without the rest of the network: the velocity of each point of `output_mats`
    /// over a force at `forced_mats`   (n_listened · n_frequencies) [(m/s)/N]. Contacts are open, and laws have their
    /// slope at rest. The admittance is infinite at an undamped pole.
    ///
    /// A point is one or more masses, by their indices: each gets the force, and their velocities are added. In a part
    /// under `units: ca` the force is constant for one sample.
    ///
    /// ```
    /// use ergon_engine::Network;
    /// use ergon_engine::network::Tie;
    ///
    /// let mut network = Network::new();
    /// network.part("key", None);
    /// network.cel("", 0.4, Tie::Physical { k: 60.0, z: 1.2 }, 0.0, 0.0, 0.0)?;
    /// let resonance = (60.0_f64 / 0.4).sqrt() / std::f64::consts::TAU;
    /// let found = network.admittance(&[0], &[0], &[vec![0]], &[resonance]);
    /// assert!((found[0].re - 1.0 / 1.2).abs() < 1e-12 && found[0].im.abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn admittance(
        &self,
        parts: &[usize],
        forced_mats: &[usize],
        output_mats: &[Vec<usize>],
        frequencies: &[f64],
    ) -> Vec<Complex<f64>> {
        let body = PartBody::new(self.elements(parts));
        let mat_count = body.mats.len();
        let local_mats = |mats: &[usize]| -> Vec<usize> {
            let mat_slots = mats.iter().map(|mat| body.mats.binary_search(mat));
            mat_slots.filter_map(Result::ok).collect()
        };
        let output_mats: Vec<Vec<usize>> = output_mats.iter().map(|mats| local_mats(mats)).collect();
        let mut scaled_force = vec![Complex::from(0.0); mat_count];
        for slot in local_mats(forced_mats) {
            scaled_force[slot] += 1.0 / body.sqrt_masses[slot];
        }
        let matrices = NetworkMatrices::new(&body);
        let mut response = vec![Complex::from(0.0); output_mats.len() * frequencies.len()];
        for (column, &f) in frequencies.iter().enumerate() {
            interrupt::poll();
            let (s, point_gain) = evaluation_point(&body, f);
            let solution = solve_at(&matrices, s, &scaled_force);
            for (row, mat_slots) in output_mats.iter().enumerate() {
                let position = |x: &Vec<Complex<f64>>| -> Complex<f64> {
                    mat_slots.iter().map(|&slot| x[slot] / body.sqrt_masses[slot]).sum()
                };
                response[row * frequencies.len() + column] = match &solution {
                    Some(x) => position(x) * Complex::new(0.0, TAU * f) * point_gain,
                    None => Complex::from(f64::INFINITY),
                };
            }
        }
        response
    }
}

/// The s at which P(s) is solved for a frequency [Hz], and the factor of its solution.
fn evaluation_point(body: &PartBody, f: f64) -> (Complex<f64>, Complex<f64>) {
    let Some(rate) = body.ca_rate else {
        return (Complex::new(0.0, TAU * f), Complex::from(1.0));
    };
    // z − 1, written so that its real part does not cancel; P(z − 1) is z times the scheme.
    let half_angle = PI * f / rate.hertz();
    let z_minus_one = Complex::new(0.0, 2.0 * sin(half_angle)) * Complex::new(cos(half_angle), sin(half_angle));
    (z_minus_one, z_minus_one + 1.0)
}

/// The solution x of P(s) x = force; `None` at a pole.
fn solve_at(matrices: &NetworkMatrices, s: Complex<f64>, force: &[Complex<f64>]) -> Option<Vec<Complex<f64>>> {
    let matrix_at_s = matrices.polynomial(s);
    let matrix_factor = Factor::new(&matrices.pattern, &matrix_at_s, Complex::from(0.0))?;
    let mut x = matrix_factor.solve(force);
    let mut applied_matrix = vec![Complex::from(0.0); x.len()];
    for _ in 0..REFINEMENTS {
        matrix_at_s.multiply(&matrices.pattern, &x, &mut applied_matrix);
        let residual: Vec<Complex<f64>> = force.iter().zip(&applied_matrix).map(|(f, y)| f - y).collect();
        for (x, correction) in x.iter_mut().zip(matrix_factor.solve(&residual)) {
            *x += correction;
        }
    }
    x.iter().all(|x| x.re.is_finite() && x.im.is_finite()).then_some(x)
}
