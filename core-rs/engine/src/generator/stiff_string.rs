//! STRING with `inharmonicity`: a row of masses that resists bending, with the partials of a stiff string.
//!
//! Let L be the matrix of plain springs on a row of masses. Every polynomial p(L) has the modes of the row, and the
//! stiffness p(u) where L has u = 4·sin²(θ/2). The coefficients of p are fitted to the stiffness that each of the first
//! partials needs; this includes bending and the dispersion of the lattice. L² is the square of the curvature: a link
//! of −1 between neighbours but one and of 4 between neighbours. If p(u) > 0 for every mode, the whole is passive,
//! although some links are negative.

use std::f64::consts::PI;

use super::fit::{least_squares, polynomial};
use super::string::{Ends, Row, string};
use super::{GeneratorError, Links, Topology, check_count};
use crate::maths::{log, sin};

/// Number of partials that are in tune.
const PARTIALS: usize = 20;
/// Most neighbours on either side that links reach.
const REACH_MAX: usize = 8;
/// The reach grows until all partials are within this error [cents].
const NEAR: f64 = 0.25;
/// A string with a larger error is refused [cents].
const FAR: f64 = 1.0;
/// Most masses: with more, sums of large links of either sign lose the lowest mode in rounding errors.
const MAX_BENT: usize = 5_000;

/// `n_masses` MATs in a row with partials f₁·n·√((1 + B·n²)/(1 + B)), where B is the `inharmonicity`.
///
/// If only the left end is held, n counts 1, 3, 5 ….
///
/// # Errors
/// Numbers out of range, or too few masses for the first 20 partials within 1 cent.
pub fn stiff_string(n_masses: usize, ends: Ends, inharmonicity: f64) -> Result<Topology, GeneratorError> {
    let masses_label = "`masses` of a string with inharmonicity";
    check_count(masses_label, n_masses, 1, MAX_BENT)?;
    if !(0.0..=0.1).contains(&inharmonicity) {
        return Err(GeneratorError::Range {
            what: "`inharmonicity`",
            range: "from 0 to 0.1",
            got: inharmonicity,
        });
    }
    let partials = |n_masses: usize| Partials::new(n_masses, ends, inharmonicity);
    let Some(coefficients) = partials(n_masses).fitted() else {
        let enough_masses = (n_masses + 1..=MAX_BENT)
            .step_by(1 + n_masses / 8)
            .find(|n_masses| partials(*n_masses).fitted().is_some());
        return Err(GeneratorError::FewMasses {
            masses: n_masses,
            enough: enough_masses.unwrap_or(MAX_BENT),
        });
    };
    let string_row = Row::new(n_masses, ends);
    let lowest_lambda = polynomial(&coefficients, partials(n_masses).u[0]);
    let row_symbol = stencil(&coefficients);
    let mut bent_links = Links::new();
    for offset in 1..row_symbol.len() {
        for i in 0..n_masses.saturating_sub(offset) {
            let entry = entry(&row_symbol, i, i + offset, n_masses, ends);
            bent_links.join_bent(i, i + offset, -entry, offset == 1);
        }
    }
    // The sum of a row of the matrix is a link to a fixed end.
    if string_row.n_fixed() > 0 {
        let stencil_reach = row_symbol.len() - 1;
        let near_an_end = |i: &usize| *i < stencil_reach || *i + stencil_reach >= n_masses;
        for i in (0..n_masses).filter(near_an_end) {
            let row_sum: f64 = (i.saturating_sub(stencil_reach)..n_masses.min(i + stencil_reach + 1))
                .map(|j| entry(&row_symbol, i, j, n_masses, ends))
                .sum();
            let is_towards_right = ends == Ends::Fixed && 2 * i >= n_masses;
            let (end_point, outermost) = match is_towards_right {
                true => (n_masses + 1, i + 1 == n_masses),
                false => (n_masses, i == 0),
            };
            let is_rounding = row_sum.abs() <= 1e-13 * row_symbol[0];
            if !is_rounding {
                bent_links.join_bent(end_point, i, row_sum, outermost);
            }
        }
    }
    Ok(Topology {
        lowest_lambda: Some(lowest_lambda),
        base_polynomial: Some((Box::new(string(n_masses, ends, 0.0)?), coefficients)),
        ..Topology::new(n_masses, bent_links.runs, string_row.positions)
    })
}

/// The eigenvalues of a row, and the stiffness that its first modes need.
struct Partials {
    /// Eigenvalue of L for every mode, rising   (n_modes)
    u: Vec<f64>,
    /// The stiffness of each partial relative to the first   (n_partials)
    target_partials: Vec<f64>,
}

impl Partials {
    fn new(n_masses: usize, ends: Ends, b: f64) -> Self {
        let n = n_masses as f64;
        let (angle_step, n_modes) = match ends {
            Ends::Fixed => (PI / (n + 1.0), n_masses),
            Ends::Free => (PI / n, n_masses - 1),
            Ends::Left => (PI / (2.0 * n + 1.0), n_masses),
        };
        let partial_number = |i: usize| match ends {
            Ends::Left => 2.0 * i as f64 + 1.0,
            _ => i as f64 + 1.0,
        };
        let squared_sine = |angle: f64| 4.0 * sin(0.5 * angle) * sin(0.5 * angle);
        let u = (0..n_modes)
            .map(|i| squared_sine(partial_number(i) * angle_step))
            .collect();
        let stiff_partial = |n: f64| n * n * (1.0 + b * n * n) / (1.0 + b);
        let wanted_partials = (0..PARTIALS.min(n_modes))
            .map(partial_number)
            .map(stiff_partial)
            .collect();
        Self {
            u,
            target_partials: wanted_partials,
        }
    }

    /// Coefficients of p, from L¹ on, that tune the partials; `None` if none are near enough.
    fn fitted(&self) -> Option<Vec<f64>> {
        let mut best_fit: Option<(f64, Vec<f64>)> = None;
        for reach in 2..=REACH_MAX.min(self.u.len()) {
            let coefficients = self.with_reach(reach);
            let mode_lambdas: Vec<f64> = self.u.iter().map(|u| polynomial(&coefficients, *u)).collect();
            let is_rising = mode_lambdas[0] > 0.0 && mode_lambdas.windows(2).all(|pair| pair[0] < pair[1]);
            let worst_cents = self.error(&mode_lambdas);
            if is_rising && best_fit.as_ref().is_none_or(|(least, _)| worst_cents < *least) {
                best_fit = Some((worst_cents, coefficients));
            }
            if best_fit.as_ref().is_some_and(|(worst_cents, _)| *worst_cents <= NEAR) {
                break;
            }
        }
        best_fit
            .filter(|(worst_cents, _)| *worst_cents <= FAR)
            .map(|(_, coefficients)| coefficients)
    }

    fn with_reach(&self, reach: usize) -> Vec<f64> {
        let n_partials = self.target_partials.len();
        let greatest = self.u[n_partials.saturating_sub(1)];
        // Each partial counts by its relative error. Powers of u are relative to the largest u, so that none is tiny.
        let scaled_lambdas: Vec<f64> = self.u[..n_partials].iter().map(|u| u / greatest).collect();
        let mut lambda_powers = vec![1.0; n_partials];
        let columns: Vec<Vec<f64>> = (0..reach)
            .map(|_| {
                lambda_powers.iter_mut().zip(&scaled_lambdas).for_each(|(p, u)| *p *= u);
                lambda_powers
                    .iter()
                    .zip(&self.target_partials)
                    .map(|(p, w)| p / w)
                    .collect()
            })
            .collect();
        let mut power_scale = 1.0;
        let weights = least_squares(&columns, &vec![1.0; n_partials]);
        weights
            .into_iter()
            .map(|weight| {
                power_scale /= greatest;
                weight * power_scale
            })
            .collect()
    }

    /// The largest error of a partial relative to the first one [cents].
    fn error(&self, partials: &[f64]) -> f64 {
        let cents_off = |(partial, target): (&f64, &f64)| 600.0 / log(2.0) * log(partial / partials[0] / target);
        let partial_errors = partials.iter().zip(&self.target_partials).map(cents_off);
        partial_errors.map(f64::abs).fold(0.0, f64::max)
    }
}

/// A row of p(L) without ends, from its diagonal on: a_0, a_1 …, with L^j = Σ (-1)^d·C(2j, j + d).
fn stencil(coefficients: &[f64]) -> Vec<f64> {
    let mut row_symbol = vec![0.0; coefficients.len() + 1];
    for (j, c) in coefficients.iter().enumerate() {
        let j = j + 1;
        // C(2j, j + d), from the middle outwards.
        let mut binomial = (1..=j).fold(1.0, |b, i| b * (j + i) as f64 / i as f64);
        for (d, a) in row_symbol.iter_mut().enumerate().take(j + 1) {
            *a += if d % 2 == 0 { c * binomial } else { -c * binomial };
            binomial *= (j - d) as f64 / (j + d + 1) as f64;
        }
    }
    row_symbol
}

/// An entry of p(L) on a row: that of the endless row, plus its reflections at both ends.
fn entry(symbol: &[f64], i: usize, j: usize, n_masses: usize, ends: Ends) -> f64 {
    let coefficient = |offset: usize| symbol.get(offset).copied().unwrap_or(0.0);
    let right_image = 2 * n_masses - 1 - i - j;
    let mirrored = match ends {
        Ends::Fixed => -coefficient(i + j + 2) - coefficient(right_image + 1),
        Ends::Free => coefficient(i + j + 1) + coefficient(right_image),
        Ends::Left => -coefficient(i + j + 2) + coefficient(right_image),
    };
    coefficient(i.abs_diff(j)) + mirrored
}
