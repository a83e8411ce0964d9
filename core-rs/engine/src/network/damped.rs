//! Damped modes: poles s of (s² + s·Z + K) x = 0, in coordinates that make every mass 1.
//!
//! The problem is first solved in the span of undamped modes x and of the responses of the springs to the forces Z x.
//! Each pole is then refined by itself on the whole network.

use nalgebra::Complex;

use super::part_body::Body;
use crate::interrupt;
use crate::maths::sqrt;
use crate::spectrum::sparse::{Factor, Pattern, Values};
use crate::spectrum::springs::{self, Spring};
use crate::spectrum::vector::{add, dot, norm, normalise, orthogonalise, units};
use crate::spectrum::{Mode, all_eigenvalues, general};

/// Damping couples a mode x with others if the part of Z x outside x is above this fraction of |Z x|. Modes are known
/// to 1e-10.
const UNCOUPLED: f64 = 1e-6;
/// Rounding error of Z x, relative to the strongest damping.
const ROUNDING: f64 = 1e-13;
/// A response is dropped if the part of it that is new is below this fraction.
const NEW: f64 = 1e-6;
/// Most corrections of a pole; each squares its relative error.
const CORRECTIONS: usize = 8;
/// A correction below this fraction of the pole is the last: the error that remains is its square.
const STEP_LAST: f64 = 1e-8;
/// A pole needs no correction if the error that its residual implies is below this fraction of it.
const EXACT: f64 = 1e-12;
/// A correction above this fraction of the pole leads to another pole; all corrections are then discarded.
const STEP_MAX: f64 = 1e-2;

/// Largest relative error, implied by its residual, at which a pole counts as known (1e-6 cents).
const ERROR_KNOWN: f64 = 5e-10;
/// Rounding error of a residual, relative to the largest stiffness of the network.
const RESIDUAL_ROUNDING: f64 = 1e-12;
/// Two poles are the same one, found twice, if corrections reduced their distance to less than this fraction.
const MERGED: f64 = 1e-3;

/// A pole and the motion x of the masses (n), scaled to xᵀ(2s + Z)x = 2i·Im s, or to length 1 if the pole is real.
pub(super) struct DampedMode {
    pub(super) pole: Complex<f64>,
    pub(super) shape: Vec<Complex<f64>>,
    /// Whether this is a pole, and distinct from all others.
    pub(super) is_known: bool,
}

/// Whether damping couples any of the modes with others.
pub(super) fn is_coupled(body: &Body, modes: &[Mode]) -> bool {
    let n = body.springs.n();
    let alternating: Vec<f64> = (0..n)
        .map(|i| if i % 2 == 0 { 1.0 } else { -1.0 })
        .collect();
    let image = times(&body.dampers, &alternating);
    // If damping does not act on a mode x, Z x is only rounding error; Z times a vector of alternating signs tells
    // its size.
    let least = ROUNDING * sqrt(dot(&image, &image) / n as f64);
    modes.iter().any(|mode| {
        interrupt::poll_for(n);
        let image = times(&body.dampers, &mode.vector);
        let share = dot(&mode.vector, &image);
        let rest = image.iter().zip(&mode.vector).map(|(z, v)| z - share * v);
        let rest: f64 = rest.map(|z| z * z).sum();
        rest > UNCOUPLED * UNCOUPLED * dot(&image, &image) && rest > least * least
    })
}

/// The `count` poles of smallest |s| that arise from undamped modes; `is_coupled` says whether damping couples these.
pub(super) fn damped_modes(
    body: &Body,
    modes: &[Mode],
    is_coupled: bool,
    count: usize,
) -> Vec<DampedMode> {
    if !is_coupled {
        let solve = |mode: &Mode| {
            interrupt::poll_for(mode.vector.len());
            uncoupled_mode(mode, &times(&body.dampers, &mode.vector))
        };
        return modes.iter().take(count).map(solve).collect();
    }
    let modes = with_responses(body, modes);
    let images: Vec<Vec<f64>> = modes
        .iter()
        .map(|mode| {
            interrupt::poll_for(mode.vector.len());
            times(&body.dampers, &mode.vector)
        })
        .collect();
    let Some(mut modes_coupled) = coupled(&modes, &images) else {
        return Vec::new();
    };
    modes_coupled.truncate(count);
    let matrices = NetworkMatrices::new(body);
    let poles: Vec<Complex<f64>> = modes_coupled.iter().map(|mode| mode.pole).collect();
    for (i, mode) in modes_coupled.iter_mut().enumerate() {
        let others = poles.iter().enumerate().filter(|(j, _)| *j != i);
        let gap = others.fold(f64::INFINITY, |least, (_, other)| {
            least.min((other - mode.pole).norm())
        });
        matrices.correct(mode, gap);
    }
    for i in 0..modes_coupled.len() {
        interrupt::poll();
        for j in 0..i {
            let (before, now) = (
                poles[i] - poles[j],
                modes_coupled[i].pole - modes_coupled[j].pole,
            );
            if now.norm() < MERGED * before.norm() {
                (modes_coupled[i].is_known, modes_coupled[j].is_known) = (false, false);
            }
        }
    }
    modes_coupled
}

/// The pole of a mode that damping couples with no other: s² + ζs + λ = 0.
fn uncoupled_mode(mode: &Mode, image: &[f64]) -> DampedMode {
    let half = 0.5 * dot(&mode.vector, image);
    let squared = mode.lambda - half * half;
    let pole = if squared >= 0.0 {
        Complex::new(-half, sqrt(squared.abs())) // abs also for −0
    } else {
        // Avoids the difference of two nearly equal numbers.
        Complex::new(-mode.lambda / (half + sqrt(-squared)), 0.0)
    };
    let shape = mode.vector.iter().map(|&x| Complex::from(x)).collect();
    DampedMode {
        pole,
        shape,
        is_known: true,
    }
}

/// The modes, extended by responses of the springs to damping: orthonormal vectors, each with its λ, as modes are.
fn with_responses(body: &Body, modes: &[Mode]) -> Vec<Mode> {
    let n = body.springs.n();
    let room = modes.len().min(n - modes.len());
    let mut rests: Vec<Vec<f64>> = Vec::new();
    let basis = |modes: &[Mode]| -> Vec<Vec<f64>> {
        modes.iter().map(|mode| mode.vector.clone()).collect()
    };
    let mut vectors = basis(modes);
    for mode in modes {
        let image = times(&body.dampers, &mode.vector);
        push_new(&mut vectors, &mut rests, image);
    }
    rests.truncate(room);
    // Static responses, then responses at half the highest λ: two for each damped point, if there are few.
    let middle = modes.last().map_or(0.0, |mode| 0.5 * mode.lambda);
    let mut vectors = basis(modes);
    let mut responses: Vec<Vec<f64>> = Vec::new();
    for mut shift in [-1e-9 * body.springs.scale(), middle] {
        if rests.is_empty() {
            break;
        }
        let factor = body.springs.factor(&mut shift);
        for rest in &rests {
            if responses.len() < room {
                push_new(&mut vectors, &mut responses, factor.solve(rest));
            }
        }
    }
    // Rotate the responses among themselves so that springs do not couple them.
    let mut all = modes.to_vec();
    let k = responses.len();
    if k == 0 {
        return all;
    }
    let images: Vec<Vec<f64>> = responses
        .iter()
        .map(|own| body.springs.times(own))
        .collect();
    let small = (0..k * k)
        .map(|entry| dot(&responses[entry / k], &images[entry % k]))
        .collect();
    if let Some((lambdas, seen)) = all_eigenvalues(small, &units(k)) {
        for (entry, lambda) in lambdas.into_iter().enumerate() {
            let mut vector = vec![0.0; n];
            for (response, row) in responses.iter().zip(&seen) {
                add(row[entry], response, &mut vector);
            }
            all.push(Mode { lambda, vector });
        }
    }
    all
}

/// Add the part of a vector outside an orthonormal basis to the basis and to `fresh`, unless that part is too small.
fn push_new(basis: &mut Vec<Vec<f64>>, fresh: &mut Vec<Vec<f64>>, mut vector: Vec<f64>) {
    let length = norm(&vector);
    orthogonalise(&mut vector, basis);
    if normalise(&mut vector) <= NEW * length {
        return;
    }
    basis.push(vector.clone());
    fresh.push(vector);
}

/// Poles of modes that damping couples, by rising |s|: eigenvalues in (p, v) with p = ω·q, ṗ = ω·v, v̇ = −ω·p − Z·v.
fn coupled(modes: &[Mode], images: &[Vec<f64>]) -> Option<Vec<DampedMode>> {
    let n = modes.len();
    let size = 2 * n;
    let mut matrix = vec![0.0; size * size];
    for (i, mode) in modes.iter().enumerate() {
        interrupt::poll();
        let omega = sqrt(mode.lambda.abs());
        matrix[i * size + n + i] = omega;
        matrix[(n + i) * size + i] = if mode.lambda < 0.0 { omega } else { -omega };
        for (j, image) in images.iter().enumerate() {
            matrix[(n + i) * size + n + j] = -dot(&mode.vector, image);
        }
    }
    let eigen = general(matrix)?;
    let shape = |index: usize, is_pair: bool| -> Vec<Complex<f64>> {
        let speeds = |row: usize| &eigen.vectors[row * size + n..(row + 1) * size];
        let mut shape = vec![Complex::from(0.0); modes[0].vector.len()];
        for (i, mode) in modes.iter().enumerate() {
            let im = if is_pair { speeds(index + 1)[i] } else { 0.0 };
            let weight = Complex::new(speeds(index)[i], im);
            let each = shape.iter_mut().zip(&mode.vector);
            each.for_each(|(sum, x)| *sum += weight * x);
        }
        shape
    };
    // An overdamped mode has two real poles, of which the slower is kept: as many real poles as there are modes left.
    let (mut real, mut poles): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    for (index, (_, im)) in eigen.values.iter().enumerate() {
        if *im > 0.0 {
            poles.push(index);
        } else if *im == 0.0 {
            real.push(index);
        }
    }
    real.sort_by(|&a, &b| eigen.values[b].0.total_cmp(&eigen.values[a].0));
    real.truncate(n.saturating_sub(poles.len()));
    poles.extend(real);
    let square = |index: usize| {
        let (re, im) = eigen.values[index];
        re * re + im * im
    };
    poles.sort_by(|&a, &b| square(a).total_cmp(&square(b)));
    let damped_mode = |index: usize| {
        let (re, im) = eigen.values[index];
        DampedMode {
            pole: Complex::new(re, im),
            shape: shape(index, im != 0.0),
            is_known: true,
        }
    };
    Some(poles.into_iter().map(damped_mode).collect())
}

/// Stiffness and damping of the whole network on one sparsity pattern.
pub(super) struct NetworkMatrices {
    pub(super) pattern: Pattern,
    stiffness: Values<f64>,
    damping: Values<f64>,
}

impl NetworkMatrices {
    pub(super) fn new(body: &Body) -> Self {
        let n = body.springs.n();
        let all = body.springs.each().iter().chain(&body.dampers);
        let all: Vec<Spring> = all.copied().collect();
        let pattern = Pattern::new(n, springs::pairs(&all));
        Self {
            stiffness: springs::values(&pattern, body.springs.each()),
            damping: springs::values(&pattern, &body.dampers),
            pattern,
        }
    }

    /// P(s) = s² + s·Z + K.
    pub(super) fn polynomial(&self, s: Complex<f64>) -> Values<Complex<f64>> {
        Values::combine(&self.stiffness, &self.damping, s * s, |k, z| s * z + k)
    }

    /// Refine a pole by Newton's method, s −= xᵀx / xᵀy with P(s) y = P′(s) x, unless its residual shows that it is
    /// exact; `gap` is the distance to the next pole. Source: Ruhe, SIAM J. Numer. Anal. 10 (1973).
    fn correct(&self, mode: &mut DampedMode, gap: f64) {
        let n = self.pattern.n();
        let mut image = vec![Complex::from(0.0); n];
        let (mut s, mut x) = (mode.pole, mode.shape.clone());
        let size = |x: &[Complex<f64>]| sqrt(x.iter().map(|x| x.norm_sqr()).sum());
        let slope = |s: Complex<f64>| {
            Values::combine(&self.stiffness, &self.damping, s * 2.0, |_, z| {
                Complex::from(z)
            })
        };
        for round in 0..CORRECTIONS {
            let matrix = self.polynomial(s);
            if round == 0 {
                matrix.times(&self.pattern, &x, &mut image);
                let error = size(&image) / (2.0 * s.norm() * size(&x));
                if error * error <= EXACT * s.norm() * gap {
                    break;
                }
            }
            slope(s).times(&self.pattern, &x, &mut image);
            let Some(factor) = Factor::new(&self.pattern, &matrix, Complex::from(0.0)) else {
                break; // s is a pole to the last bit
            };
            let y = factor.solve(&image);
            let step = bilinear(&x, &x) / bilinear(&x, &y);
            let length = size(&y);
            if !(step.norm() <= STEP_MAX * mode.pole.norm() && length.is_finite()) {
                (s, x) = (mode.pole, mode.shape.clone());
                break;
            }
            s -= step;
            x = y.into_iter().map(|y| y / length).collect();
            if step.norm() <= STEP_LAST * s.norm() {
                break;
            }
        }
        if mode.pole.im == 0.0 {
            s.im = 0.0;
        }
        self.polynomial(s).times(&self.pattern, &x, &mut image);
        let stiffest = self.stiffness.diagonal.iter();
        let stiffest = stiffest.fold(0.0_f64, |stiffness_max, k| stiffness_max.max(k.abs()));
        let stiffness_max = 2.0 * ERROR_KNOWN * s.norm_sqr() + RESIDUAL_ROUNDING * stiffest;
        mode.is_known = size(&image) <= stiffness_max * size(&x);
        slope(s).times(&self.pattern, &x, &mut image);
        let by = if s.im == 0.0 {
            Complex::from(1.0 / size(&x))
        } else {
            root(Complex::new(0.0, 2.0 * s.im) / bilinear(&x, &image))
        };
        mode.pole = s;
        mode.shape = x.into_iter().map(|x| x * by).collect();
    }
}

fn bilinear(a: &[Complex<f64>], b: &[Complex<f64>]) -> Complex<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// √z with a non-negative real part.
fn root(z: Complex<f64>) -> Complex<f64> {
    let length = sqrt(z.norm_sqr());
    let re = sqrt((0.5 * (length + z.re)).max(0.0));
    let im = sqrt((0.5 * (length - z.re)).max(0.0));
    Complex::new(re, if z.im < 0.0 { -im } else { im })
}

/// Z x.
fn times(dampers: &[Spring], x: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; x.len()];
    for &((a, lever), other, z) in dampers {
        let pull = z * (lever * x[a] - other.map_or(0.0, |(b, there)| there * x[b]));
        y[a] += lever * pull;
        if let Some((b, there)) = other {
            y[b] -= there * pull;
        }
    }
    y
}
