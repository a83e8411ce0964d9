//! Decays at several pitches: the dampers that a body needs for them.
//!
//! Z = M·s(M⁻¹K) has the modes of K, each with the loss s(λ). For two decays, of which the higher one is shorter by no
//! more than the square of the ratio of their pitches, s is α + β·λ: dampers from every mass to the ground, and in
//! parallel with every spring. Otherwise s is a polynomial. It is fitted to the named points and, between them, to
//! lines that are straight in logarithms. It needs dampers also between more distant neighbours, of either sign;
//! together they lose energy, because s > 0 at every mode.

use super::fit::{least_squares, polynomial};
use super::sparse::Sparse;
use super::tune::Tuned;
use super::{GeneratorError, LinkRun, Topology, count, positive};
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
    pub tuned: Tuned,
    /// Damper from each MAT of mean mass to the ground [N·s/m].
    pub ground: f64,
    /// Dampers without springs, whose factors are [N·s/m].
    pub dampers: Vec<LinkRun>,
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
                let ratios = cell::tune(f, Some(t60), rate);
                Self {
                    lambda: ratios.kappa,
                    loss: ratios.zeta,
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
        if let [first, two] = poles[..] {
            let beta = (two.loss - first.loss) / (two.lambda - first.lambda);
            let alpha = first.loss - beta * first.lambda;
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
                let above = poles.partition_point(|pole| pole.lambda < lambda);
                let above = above.clamp(1, poles.len() - 1);
                let (lower, two) = (poles[above - 1], poles[above]);
                let slope = log(two.loss / lower.loss) / log(two.lambda / lower.lambda);
                lower.loss * exp(slope * log(lambda / lower.lambda))
            }
        }
    }

    /// The pole of the mode that sounds at `f`.
    fn pole_of(&self, f: f64, discrete: Option<Rate>) -> Pole {
        let mut pole = Pole::new((f, 1e3), discrete);
        // Damping shifts a pitch only by its square, so this converges at once if a body sounds at all.
        for _ in 0..64 {
            let t60 = Pole::t60(self.value(pole.lambda), discrete);
            pole = Pole::new((f, t60), discrete);
        }
        pole
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
    count("The number of decays in `t60`", points.len(), 2, 64)?;
    for &(frequency, t60) in points {
        positive("A frequency in `t60`", frequency)?;
        positive("`t60`", t60)?;
    }
    let mut points = points.to_vec();
    points.sort_by(|one, two| one.0.total_cmp(&two.0));
    if let Some(rate) = discrete
        && let Some(f) = [f, points[points.len() - 1].0]
            .into_iter()
            .find(|f| 2.0 * f >= rate.hertz())
    {
        let rate = rate.hertz();
        return Err(GeneratorError::Pitch { f, rate });
    }
    let poles: Vec<Pole> = points
        .iter()
        .map(|frequency| Pole::new(*frequency, discrete))
        .collect();
    if let Some(i) = (1..poles.len()).find(|&i| poles[i].lambda <= poles[i - 1].lambda) {
        return Err(GeneratorError::Range {
            what: "Each frequency in `t60`",
            range: "above the one before, and its decay longer than a period",
            got: points[i].0,
        });
    }
    let curve = Curve::new(poles.clone());
    let lowest = topology.lowest()?;
    let first = curve.pole_of(f, discrete);
    let k = mass * first.lambda / lowest;
    if let Curve::Straight { alpha, beta } = curve {
        let tuned = Tuned { k, z: beta * k };
        return Ok(Losses {
            tuned,
            ground: alpha * mass,
            dampers: Vec::new(),
        });
    }
    count(
        "`masses` of a body with such decays",
        topology.n_mat,
        1,
        MAX_FITTED,
    )?;
    let named: Vec<(f64, Pole)> = points.iter().map(|(f, _)| *f).zip(poles).collect();
    let fit = Fit::new(topology, lowest, first, &curve, &named)?;
    let fitted = fit.best(discrete)?;
    let dampers = fit.dampers(&fitted, mass);
    Ok(Losses {
        tuned: Tuned { k, z: 0.0 },
        ground: fitted[0] * mass,
        dampers,
    })
}

/// The fit of a polynomial of a body's matrix to the losses of a curve.
struct Fit<'a> {
    topology: &'a Topology,
    /// The plainer body whose matrix is the argument of the polynomial.
    base: &'a Topology,
    /// Upper bound of the eigenvalues of that matrix.
    top: f64,
    powers: usize,
    /// Eigenvalue over `top`, loss and weight of each place   (n_places,)
    places: Vec<[f64; 3]>,
    /// Frequency and loss of the named places, which are at the end of `places`.
    named: Vec<(f64, f64)>,
}

impl<'a> Fit<'a> {
    fn new(
        topology: &'a Topology,
        lowest: f64,
        first: Pole,
        curve: &Curve,
        points: &[(f64, Pole)],
    ) -> Result<Self, GeneratorError> {
        let (base, polynomial_terms) = match &topology.base_polynomial {
            Some((base, coefficients)) => (base.as_ref(), coefficients.as_slice()),
            None => (topology, [1.0].as_slice()),
        };
        let mut sums = vec![0.0; base.n_mat];
        let mut links = vec![0; base.n_mat];
        for run in &base.runs {
            for end in (0..run.len).flat_map(|i| [run.a + i, run.b + i]) {
                if end < base.n_mat {
                    sums[end] += run.factor.abs() / base.share(end);
                    links[end] += 1;
                }
            }
        }
        let top = 2.0 * sums.iter().copied().fold(0.0, f64::max);
        let is_row = links.iter().all(|links| *links <= 2);
        let low = base.lowest()?;
        let lambda = |u: f64| first.lambda * polynomial(polynomial_terms, u) / lowest;
        let mut places = Vec::with_capacity(PLACES + points.len());
        for i in 0..PLACES {
            let share = 0.5 - 0.5 * cos(PI * i as f64 / (PLACES - 1) as f64);
            let u = low + (top - low) * share;
            places.push([u / top, curve.value(lambda(u)), 1.0]);
        }
        let mut named = Vec::new();
        for (f, pole) in points {
            // The margin keeps the lowest mode itself, however it was rounded.
            let from = lambda(low) * (1.0 - ROUNDING);
            if !(from..=lambda(top)).contains(&pole.lambda) {
                continue;
            }
            let (mut below, mut above) = (low, top);
            for _ in 0..100 {
                let middle = 0.5 * (below + above);
                match lambda(middle) < pole.lambda {
                    true => below = middle,
                    false => above = middle,
                }
            }
            places.push([below / top, pole.loss, NAMED_WEIGHT]);
            named.push((*f, pole.loss));
        }
        Ok(Self {
            topology,
            base,
            top,
            powers: if is_row { POWERS_ROW } else { POWERS_MESH },
            places,
            named,
        })
    }

    /// Coefficients, from the constant on, of the powers of the eigenvalue over `top`.
    fn best(&self, discrete: Option<Rate>) -> Result<Vec<f64>, GeneratorError> {
        let mut best: Option<(f64, Vec<f64>)> = None;
        for powers in 1..=self.powers {
            let mut fitted = self.fitted(0, powers);
            if fitted[0] < 0.0 {
                // The loss of a mass to the ground must not be negative.
                fitted = self.fitted(1, powers);
            }
            let loses = self
                .places
                .iter()
                .all(|[u, loss, _]| value(&fitted, *u) > 0.01 * loss);
            let error = self.worst(&fitted).1;
            if loses && best.as_ref().is_none_or(|(least, _)| error < *least) {
                best = Some((error, fitted));
            }
            if best
                .as_ref()
                .is_some_and(|(error, _)| *error <= ERROR_SOUGHT)
            {
                break;
            }
        }
        let (error, fitted) = best.unwrap_or_else(|| (f64::INFINITY, self.fitted(0, 0)));
        if error <= ERROR_MAX {
            return Ok(fitted);
        }
        let (index, _) = self.worst(&fitted);
        let u = self.places[self.places.len() - self.named.len() + index][0];
        let loss = value(&fitted, u);
        let nearest = if loss > 0.0 {
            Pole::t60(loss, discrete)
        } else {
            f64::INFINITY
        };
        Err(GeneratorError::Decays {
            f: self.named[index].0,
            t60: Pole::t60(self.named[index].1, discrete),
            nearest,
        })
    }

    fn fitted(&self, from: usize, powers: usize) -> Vec<f64> {
        let column = |power: usize| -> Vec<f64> {
            let value = |[u, loss, weight]: &[f64; 3]| weight * integer_power(*u, power) / loss;
            self.places.iter().map(value).collect()
        };
        let columns: Vec<Vec<f64>> = (from..=powers).map(column).collect();
        let target: Vec<f64> = self.places.iter().map(|place| place[2]).collect();
        let mut fitted = vec![0.0; from];
        fitted.extend(least_squares(&columns, &target));
        fitted
    }

    /// Index and relative error of the named decay with the largest error.
    fn worst(&self, fitted: &[f64]) -> (usize, f64) {
        let places = &self.places[self.places.len() - self.named.len()..];
        let error = |[u, loss, _]: &[f64; 3]| (value(fitted, *u) / loss - 1.0).abs();
        let errors = places.iter().map(error).enumerate();
        errors.fold(
            (0, 0.0),
            |worst, own| if own.1 > worst.1 { own } else { worst },
        )
    }

    fn dampers(&self, fitted: &[f64], mass: f64) -> Vec<LinkRun> {
        let matrix = Sparse::stiffness(self.base);
        let mut sum = Sparse::zero(self.base.n_mat);
        let mut power = matrix.clone();
        let mut scale = mass / self.top;
        for (i, coefficient) in fitted[1..].iter().enumerate() {
            if i > 0 {
                // Powers of M⁻¹K, times M.
                for (row, row_entries) in power.0.iter_mut().enumerate() {
                    row_entries
                        .values_mut()
                        .for_each(|value| *value /= self.base.share(row));
                }
                power = matrix.times(&power);
                scale /= self.top;
            }
            sum.add_times(coefficient * scale, &power);
        }
        sum.links(self.topology.n_mat, |_, _| false)
    }
}

fn value(fitted: &[f64], u: f64) -> f64 {
    fitted.iter().rev().fold(0.0, |sum, c| sum * u + c)
}

fn integer_power(u: f64, power: usize) -> f64 {
    (0..power).fold(1.0, |product, _| product * u)
}
