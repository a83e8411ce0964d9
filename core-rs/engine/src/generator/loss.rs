//! Decays at several pitches: the dampers that a body needs for them.
//!
//! Z = M·s(M⁻¹K) has the modes of K, each with the loss s(λ). For two decays, of which the higher one is shorter by no
//! more than the square of the ratio of their pitches, s is α + β·λ: dampers from every mass to the ground, and in
//! parallel with every spring. Otherwise s is a polynomial. It is fitted to the named points and, between them, to
//! lines that are straight in logarithms. It needs dampers also between more distant neighbours, of either sign;
//! together they lose energy, because s > 0 at every mode.

use super::fit::{least_squares, polynomial};
use super::sparse::Sparse;
use super::tune::TunedLinks;
use super::{GeneratorError, Topology, TopologyRun, check_count, positive};
use crate::cell::{self, decay};
use crate::maths::{cos, exp, log, log1p};
use crate::units::{LN_1000, Rate};
use std::f64::consts::{PI, TAU};

/// How long a body sounds.
#[derive(Clone, Copy, Debug)]
pub enum Decay<'a> {
    /// The T60 of its lowest mode [s]; `None`: no decay.
    Lowest(Option<f64>),
    /// Decays [s] at frequencies [Hz], two or more.
    Points(&'a [(f64, f64)]),
}

impl From<Option<f64>> for Decay<'_> {
    fn from(t60: Option<f64>) -> Self {
        Self::Lowest(t60)
    }
}

/// Springs and dampers of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Losses {
    /// Spring and damper of every link of factor 1.
    pub tuned: TunedLinks,
    /// Damper from each MAT of mean mass to the ground [N·s/m].
    pub ground: f64,
    /// Dampers without springs, whose factors are [N·s/m].
    pub dampers: Vec<TopologyRun>,
}

/// Most masses whose decays are fitted.
const MAX_FITTED: usize = 20_000;
/// Most powers of the matrix: for a row, and for a mesh, where each power reaches one ring further in all directions.
const POWERS_ROW: usize = 8;
const POWERS_MESH: usize = 3;
/// Powers are added until the named decays are within this relative error.
const ERROR_SOUGHT: f64 = 0.003;
/// Decays with a larger relative error are refused.
const ERROR_MAX: f64 = 0.01;
/// Number of places at which the fit is evaluated.
const PLACES: usize = 256;
/// Relative rounding error of the square of a frequency.
const ROUNDING: f64 = 1e-9;
/// Weight of a named decay relative to a place between named decays.
const NAMED_WEIGHT: f64 = 1_000.0;

/// Stiffness (or κ) and loss (or ζ) of a mode, divided by its mass.
#[derive(Clone, Copy, Debug)]
struct Pole {
    lambda: f64,
    loss: f64,
}

impl Pole {
    fn new((f, t60): (f64, f64), discrete: Option<Rate>) -> Self {
        match discrete {
            Some(rate) => {
                let tuned_ratios = cell::tune(f, Some(t60), rate);
                Self {
                    lambda: tuned_ratios.kappa,
                    loss: tuned_ratios.zeta,
                }
            }
            None => {
                let (sigma, omega) = (decay(Some(t60)), TAU * f);
                Self {
                    lambda: omega * omega + sigma * sigma,
                    loss: 2.0 * sigma,
                }
            }
        }
    }

    fn t60(loss: f64, discrete: Option<Rate>) -> f64 {
        match discrete {
            Some(rate) => -2.0 * LN_1000 * rate.step() / log1p(-loss),
            None => 2.0 * LN_1000 / loss,
        }
    }
}

/// Loss as a function of λ.
enum Curve {
    /// α + β·λ
    Straight { alpha: f64, beta: f64 },
    /// Straight in logarithms from point to point, and continued beyond the outermost points.
    Bent(Vec<Pole>),
}

impl Curve {
    fn new(poles: Vec<Pole>) -> Self {
        if let [first_pole, second_pole] = poles[..] {
            let beta = (second_pole.loss - first_pole.loss) / (second_pole.lambda - first_pole.lambda);
            let alpha = first_pole.loss - beta * first_pole.lambda;
            if alpha >= 0.0 && beta >= 0.0 {
                return Self::Straight { alpha, beta };
            }
        }
        Self::Bent(poles)
    }

    fn value(&self, lambda: f64) -> f64 {
        match self {
            Self::Straight { alpha, beta } => alpha + beta * lambda,
            Self::Bent(poles) => {
                let upper_index = poles.partition_point(|pole| pole.lambda < lambda);
                let upper_index = upper_index.clamp(1, poles.len() - 1);
                let (lower_pole, upper_pole) = (poles[upper_index - 1], poles[upper_index]);
                let log_slope = log(upper_pole.loss / lower_pole.loss) / log(upper_pole.lambda / lower_pole.lambda);
                lower_pole.loss * exp(log_slope * log(lambda / lower_pole.lambda))
            }
        }
    }

    /// The pole of the mode that sounds at `f`.
    fn pole_of(&self, f: f64, discrete: Option<Rate>) -> Pole {
        let mut mode_pole = Pole::new((f, 1e3), discrete);
        // Damping shifts a pitch only by its square, so this converges at once if a body sounds at all.
        for _ in 0..64 {
            let decay_time = Pole::t60(self.value(mode_pole.lambda), discrete);
            mode_pole = Pole::new((f, decay_time), discrete);
        }
        mode_pole
    }
}

/// Springs and dampers that give the lowest mode the damped frequency `f` [Hz], and modes at the frequencies [Hz] of
/// `points` (two or more) the decays [s] there.
///
/// `mass` is the mean mass of a MAT [kg], or the algorithmic M at the rate `discrete`.
///
/// # Errors
/// Numbers out of range, a body without modes, or decays that no damper gives.
pub fn tune_points(
    topology: &Topology,
    mass: f64,
    f: f64,
    points: &[(f64, f64)],
    discrete: Option<Rate>,
) -> Result<Losses, GeneratorError> {
    positive("A mass", mass)?;
    positive("`f`", f)?;
    check_count("The number of decays in `t60`", points.len(), 2, 64)?;
    for &(frequency, t60) in points {
        positive("A frequency in `t60`", frequency)?;
        positive("`t60`", t60)?;
    }
    let mut points = points.to_vec();
    points.sort_by(|point, other_point| point.0.total_cmp(&other_point.0));
    if let Some(rate) = discrete
        && let Some(f) = [f, points[points.len() - 1].0]
            .into_iter()
            .find(|f| 2.0 * f >= rate.hertz())
    {
        let rate = rate.hertz();
        return Err(GeneratorError::Pitch { f, rate });
    }
    let poles: Vec<Pole> = points.iter().map(|point| Pole::new(*point, discrete)).collect();
    if let Some(pole_index) =
        (1..poles.len()).find(|&pole_index| poles[pole_index].lambda <= poles[pole_index - 1].lambda)
    {
        return Err(GeneratorError::Range {
            what: "Each frequency in `t60`",
            range: "above the one before, and its decay longer than a period",
            got: points[pole_index].0,
        });
    }
    let loss_curve = Curve::new(poles.clone());
    let lowest_lambda = topology.lowest_lambda()?;
    let lowest_pole = loss_curve.pole_of(f, discrete);
    let k = mass * lowest_pole.lambda / lowest_lambda;
    if let Curve::Straight { alpha, beta } = loss_curve {
        let tuned = TunedLinks { k, z: beta * k };
        return Ok(Losses {
            tuned,
            ground: alpha * mass,
            dampers: Vec::new(),
        });
    }
    check_count("`masses` of a body with such decays", topology.n_mat, 1, MAX_FITTED)?;
    let named_poles: Vec<(f64, Pole)> = points.iter().map(|(f, _)| *f).zip(poles).collect();
    let loss_fit = Fit::new(topology, lowest_lambda, lowest_pole, &loss_curve, &named_poles)?;
    let loss_coefficients = loss_fit.best_coefficients(discrete)?;
    let dampers = loss_fit.dampers(&loss_coefficients, mass);
    Ok(Losses {
        tuned: TunedLinks { k, z: 0.0 },
        ground: loss_coefficients[0] * mass,
        dampers,
    })
}

/// The fit of a polynomial of a body's matrix to the losses of a curve.
struct Fit<'a> {
    topology: &'a Topology,
    /// The plainer body whose matrix is the argument of the polynomial.
    base: &'a Topology,
    /// Upper bound of the eigenvalues of that matrix.
    lambda_max: f64,
    powers: usize,
    /// Eigenvalue over `lambda_max`, loss and weight of each place   (n_places,)
    places: Vec<[f64; 3]>,
    /// Frequency and loss of the named places, which are at the end of `places`.
    named_poles: Vec<(f64, f64)>,
}

impl<'a> Fit<'a> {
    fn new(
        topology: &'a Topology,
        lowest_lambda: f64,
        first: Pole,
        curve: &Curve,
        points: &[(f64, Pole)],
    ) -> Result<Self, GeneratorError> {
        let (base, scale_coefficients) = match &topology.base_polynomial {
            Some((base, coefficients)) => (base.as_ref(), coefficients.as_slice()),
            None => (topology, [1.0].as_slice()),
        };
        let mut row_sums = vec![0.0; base.n_mat];
        let mut mat_links = vec![0; base.n_mat];
        for run in &base.runs {
            for end in (0..run.len).flat_map(|i| [run.a + i, run.b + i]) {
                if end < base.n_mat {
                    row_sums[end] += run.factor.abs() / base.mass_share(end);
                    mat_links[end] += 1;
                }
            }
        }
        let lambda_max = 2.0 * row_sums.iter().copied().fold(0.0, f64::max);
        let is_single_row = mat_links.iter().all(|mat_links| *mat_links <= 2);
        let base_lowest = base.lowest_lambda()?;
        let scaled_lambda = |eigenvalue: f64| first.lambda * polynomial(scale_coefficients, eigenvalue) / lowest_lambda;
        let mut places = Vec::with_capacity(PLACES + points.len());
        for i in 0..PLACES {
            let chebyshev_share = 0.5 - 0.5 * cos(PI * i as f64 / (PLACES - 1) as f64);
            let eigenvalue = base_lowest + (lambda_max - base_lowest) * chebyshev_share;
            places.push([eigenvalue / lambda_max, curve.value(scaled_lambda(eigenvalue)), 1.0]);
        }
        let mut named_poles = Vec::new();
        for (f, pole) in points {
            // The margin keeps the lowest mode itself, however it was rounded.
            let range_start = scaled_lambda(base_lowest) * (1.0 - ROUNDING);
            if !(range_start..=scaled_lambda(lambda_max)).contains(&pole.lambda) {
                continue;
            }
            let (mut bracket_low, mut bracket_high) = (base_lowest, lambda_max);
            for _ in 0..100 {
                let bracket_middle = 0.5 * (bracket_low + bracket_high);
                match scaled_lambda(bracket_middle) < pole.lambda {
                    true => bracket_low = bracket_middle,
                    false => bracket_high = bracket_middle,
                }
            }
            places.push([bracket_low / lambda_max, pole.loss, NAMED_WEIGHT]);
            named_poles.push((*f, pole.loss));
        }
        Ok(Self {
            topology,
            base,
            lambda_max,
            powers: if is_single_row { POWERS_ROW } else { POWERS_MESH },
            places,
            named_poles,
        })
    }

    /// Coefficients, from the constant on, of the powers of the eigenvalue over `lambda_max`.
    fn best_coefficients(&self, discrete: Option<Rate>) -> Result<Vec<f64>, GeneratorError> {
        let mut best_fit: Option<(f64, Vec<f64>)> = None;
        for powers in 1..=self.powers {
            let mut coefficients = self.fit_coefficients(0, powers);
            if coefficients[0] < 0.0 {
                // The loss of a mass to the ground must not be negative.
                coefficients = self.fit_coefficients(1, powers);
            }
            let loses_everywhere = self
                .places
                .iter()
                .all(|[eigenvalue_ratio, loss, _]| value(&coefficients, *eigenvalue_ratio) > 0.01 * loss);
            let worst_error = self.worst_error(&coefficients).1;
            if loses_everywhere && best_fit.as_ref().is_none_or(|(least, _)| worst_error < *least) {
                best_fit = Some((worst_error, coefficients));
            }
            if best_fit
                .as_ref()
                .is_some_and(|(worst_error, _)| *worst_error <= ERROR_SOUGHT)
            {
                break;
            }
        }
        let (worst_error, coefficients) = best_fit.unwrap_or_else(|| (f64::INFINITY, self.fit_coefficients(0, 0)));
        if worst_error <= ERROR_MAX {
            return Ok(coefficients);
        }
        let (worst_index, _) = self.worst_error(&coefficients);
        let eigenvalue_ratio = self.places[self.places.len() - self.named_poles.len() + worst_index][0];
        let loss = value(&coefficients, eigenvalue_ratio);
        let nearest = if loss > 0.0 {
            Pole::t60(loss, discrete)
        } else {
            f64::INFINITY
        };
        Err(GeneratorError::Decays {
            f: self.named_poles[worst_index].0,
            t60: Pole::t60(self.named_poles[worst_index].1, discrete),
            nearest,
        })
    }

    fn fit_coefficients(&self, first_power: usize, powers: usize) -> Vec<f64> {
        let power_column = |power: usize| -> Vec<f64> {
            let weighted_power = |[u, loss, weight]: &[f64; 3]| weight * integer_power(*u, power) / loss;
            self.places.iter().map(weighted_power).collect()
        };
        let columns: Vec<Vec<f64>> = (first_power..=powers).map(power_column).collect();
        let target_column: Vec<f64> = self.places.iter().map(|place| place[2]).collect();
        let mut coefficients = vec![0.0; first_power];
        coefficients.extend(least_squares(&columns, &target_column));
        coefficients
    }

    /// Index and relative error of the named decay with the largest error.
    fn worst_error(&self, coefficients: &[f64]) -> (usize, f64) {
        let named_places = &self.places[self.places.len() - self.named_poles.len()..];
        let relative_error = |[u, loss, _]: &[f64; 3]| (value(coefficients, *u) / loss - 1.0).abs();
        let place_errors = named_places.iter().map(relative_error).enumerate();
        place_errors.fold(
            (0, 0.0),
            |worst, place_error| if place_error.1 > worst.1 { place_error } else { worst },
        )
    }

    fn dampers(&self, coefficients: &[f64], mass: f64) -> Vec<TopologyRun> {
        let base_matrix = Sparse::stiffness(self.base);
        let mut damper_matrix = Sparse::zero(self.base.n_mat);
        let mut matrix_power = base_matrix.clone();
        let mut power_scale = mass / self.lambda_max;
        for (i, coefficient) in coefficients[1..].iter().enumerate() {
            if i > 0 {
                // Powers of M⁻¹K, times M.
                for (row, row_entries) in matrix_power.0.iter_mut().enumerate() {
                    row_entries
                        .values_mut()
                        .for_each(|value| *value /= self.base.mass_share(row));
                }
                matrix_power = base_matrix.product(&matrix_power);
                power_scale /= self.lambda_max;
            }
            damper_matrix.add_scaled(coefficient * power_scale, &matrix_power);
        }
        damper_matrix.links(self.topology.n_mat, |_, _| false)
    }
}

fn value(coefficients: &[f64], u: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * u + c)
}

fn integer_power(u: f64, power: usize) -> f64 {
    (0..power).fold(1.0, |product, _| product * u)
}
