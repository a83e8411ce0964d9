//! Smooth functions of the time within a frame, 0 to 1, as sums of Chebyshev polynomials.

use crate::maths::cos;
use std::f64::consts::PI;

/// Most polynomials in a sum.
pub(super) const POLYNOMIALS_MAX: usize = 24;
/// Fewest polynomials: a parabola and one to spare.
const POLYNOMIALS_MIN: usize = 4;
/// Error of the sum, relative to the function.
pub(super) const RELATIVE_ERROR: f64 = 1e-10;
/// The same for dry friction: the motion of a held mass is small against its position.
pub(super) const RELATIVE_ERROR_OF_FRICTION: f64 = 1e-15;

/// Polynomials of a frame and the instants at which a function is sampled for them.
#[derive(Clone, Debug)]
pub(super) struct Basis {
    /// Rising instants of a frame   (n)
    pub(super) instants: Vec<f64>,
    /// Weight of the value at instant m in coefficient k   (n, n)
    pub(super) fit: Vec<f64>,
}

/// Every polynomial, and its slope, at one instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instant {
    /// 0 to 1.
    pub(super) s: f64,
    pub(super) values: [f64; POLYNOMIALS_MAX],
    pub(super) slopes: [f64; POLYNOMIALS_MAX],
}

impl Basis {
    /// A basis for motions e^(λs) with |λ| up to `fastest_rate` [1/frame], to an error relative to them.
    pub(super) fn new(fastest_rate: f64, error_max: f64) -> Self {
        let n_instants = (POLYNOMIALS_MIN..POLYNOMIALS_MAX)
            .find(|&n_instants| relative_error(fastest_rate, n_instants) <= error_max);
        let n_instants = n_instants.unwrap_or(POLYNOMIALS_MAX);
        let node_angle = |m: usize| PI * ((n_instants - 1 - m) as f64 + 0.5) / n_instants as f64;
        let fit_factor = |k: usize| if k == 0 { 1.0 } else { 2.0 } / n_instants as f64;
        let fit_weight = |entry: usize| {
            fit_factor(entry / n_instants) * cos((entry / n_instants) as f64 * node_angle(entry % n_instants))
        };
        Self {
            instants: (0..n_instants).map(|m| 0.5 + 0.5 * cos(node_angle(m))).collect(),
            fit: (0..n_instants * n_instants).map(fit_weight).collect(),
        }
    }

    pub(super) fn n_polynomials(&self) -> usize {
        self.instants.len()
    }

    /// Coefficients of a function from its values at the instants   (n each)
    pub(super) fn fit(&self, values: &[f64], coefficients: &mut [f64]) {
        for (coefficient, row) in coefficients.iter_mut().zip(self.fit.chunks(self.n_polynomials())) {
            *coefficient = dot(row, values);
        }
    }

    /// Weights of the values at the instants in a sum of the polynomials with given factors   (n)
    pub(super) fn weights(&self, factors: &[f64]) -> Vec<f64> {
        let n_instants = self.n_polynomials();
        let instant_weight = |m: usize| (0..n_instants).map(|k| factors[k] * self.fit[k * n_instants + m]).sum();
        (0..n_instants).map(instant_weight).collect()
    }

    /// Replace the values of a function of two instants by its coefficients   (n·n)
    pub(super) fn fit_pair_values(&self, pair_values: &mut [f64]) {
        let n_instants = self.n_polynomials();
        let (mut column_values, mut coefficients) = ([0.0; POLYNOMIALS_MAX], [0.0; POLYNOMIALS_MAX]);
        for row in pair_values.chunks_mut(n_instants) {
            self.fit(row, &mut coefficients[..n_instants]);
            row.copy_from_slice(&coefficients[..n_instants]);
        }
        for l in 0..n_instants {
            for (m, value) in column_values[..n_instants].iter_mut().enumerate() {
                *value = pair_values[m * n_instants + l];
            }
            self.fit(&column_values[..n_instants], &mut coefficients[..n_instants]);
            for (k, value) in coefficients[..n_instants].iter().enumerate() {
                pair_values[k * n_instants + l] = *value;
            }
        }
    }
}

/// The relative error of n polynomials of e^(λs), |λ| = `rate`: 2(|λ|/4)^n / n!.
fn relative_error(rate: f64, n: usize) -> f64 {
    (1..=n).fold(2.0, |error, k| error * 0.25 * rate / k as f64)
}

/// Add rows of polynomials, each times a factor, to a sum of them   (n, n and n; n)
pub(super) fn add_rows(rows: &[f64], factors: &[f64], sum: &mut [f64]) {
    // If their number is known when this is compiled, the sum stays in registers. Most bases are as small as these.
    match sum.len() {
        4 => add_fixed_rows::<4>(rows, factors, sum),
        5 => add_fixed_rows::<5>(rows, factors, sum),
        6 => add_fixed_rows::<6>(rows, factors, sum),
        7 => add_fixed_rows::<7>(rows, factors, sum),
        8 => add_fixed_rows::<8>(rows, factors, sum),
        9 => add_fixed_rows::<9>(rows, factors, sum),
        10 => add_fixed_rows::<10>(rows, factors, sum),
        n => {
            for (row, factor) in rows.chunks_exact(n).zip(factors) {
                for (sum_entry, row_entry) in sum.iter_mut().zip(row) {
                    *sum_entry += factor * row_entry;
                }
            }
        }
    }
}

fn add_fixed_rows<const N: usize>(rows: &[f64], factors: &[f64], polynomial_sum: &mut [f64]) {
    let (rows, []) = rows.as_chunks::<N>() else {
        return;
    };
    let ([polynomial_sum], []) = polynomial_sum.as_chunks_mut::<N>() else {
        return;
    };
    for (row, factor) in rows.iter().zip(factors) {
        for (sum_entry, row_entry) in polynomial_sum.iter_mut().zip(row) {
            *sum_entry += factor * row_entry;
        }
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Instant {
    pub(super) fn new(n: usize, s: f64) -> Self {
        let (u, mut instant) = (
            2.0 * s - 1.0,
            Self {
                s,
                values: [0.0; POLYNOMIALS_MAX],
                slopes: [0.0; POLYNOMIALS_MAX],
            },
        );
        (instant.values[0], instant.values[1], instant.slopes[1]) = (1.0, u, 2.0);
        for k in 2..n {
            instant.values[k] = 2.0 * u * instant.values[k - 1] - instant.values[k - 2];
            instant.slopes[k] = 4.0 * instant.values[k - 1] + 2.0 * u * instant.slopes[k - 1] - instant.slopes[k - 2];
        }
        instant
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::sin;

    #[test]
    fn basis_rows_are_added_in_order() {
        for n in POLYNOMIALS_MIN..POLYNOMIALS_MAX {
            let test_number = |at: usize| sin(at as f64 + 0.3);
            let rows: Vec<f64> = (0..n * n).map(test_number).collect();
            let factors: Vec<f64> = (0..n).map(|k| test_number(k + 777)).collect();
            let mut polynomial_sum: Vec<f64> = (0..n).map(|k| test_number(k + 999)).collect();
            let mut plain_sum = polynomial_sum.clone();
            for k in 0..n {
                for (plain_term, by) in plain_sum.iter_mut().zip(&rows[k * n..]) {
                    *plain_term += factors[k] * by;
                }
            }
            add_rows(&rows, &factors, &mut polynomial_sum);
            assert_eq!(polynomial_sum, plain_sum, "{n} polynomials");
        }
    }

    #[test]
    fn basis_fit_of_a_swing_between_instants() {
        for reach in [0.3, 2.0, 6.0, 12.0] {
            let basis = Basis::new(reach, RELATIVE_ERROR);
            let n_instants = basis.n_polynomials();
            let sine_values: Vec<f64> = basis.instants.iter().map(|s| sin(reach * s)).collect();
            let mut coefficients = vec![0.0; n_instants];
            basis.fit(&sine_values, &mut coefficients);
            for s in [0.0, 0.123, 0.5, 0.97, 1.0] {
                let instant = Instant::new(n_instants, s);
                assert!((dot(&coefficients, &instant.values[..n_instants]) - sin(reach * s)).abs() < 1e-8);
                let sine_slope = reach * cos(reach * s);
                assert!((dot(&coefficients, &instant.slopes[..n_instants]) - sine_slope).abs() < 1e-6 * reach.max(1.0));
            }
        }
    }
}
