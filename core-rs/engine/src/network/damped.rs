//! Damped modes: poles s of (s² + s·Z + K) x = 0, in coordinates that make every mass 1.
//!
//! The problem is first solved in the span of undamped modes x and of the responses of the springs to the forces Z x.
//! Each pole is then refined by itself on the whole network.

use nalgebra::Complex;

use super::part_body::PartBody;
use crate::interrupt;
use crate::maths::sqrt;
use crate::spectrum::sparse::{Factor, Pattern, Values};
use crate::spectrum::springs::{self, Spring};
use crate::spectrum::vector::{add_scaled, dot, norm, normalise, orthogonalise, unit_vectors};
use crate::spectrum::{Mode, all_eigenvalues, general_eigensystem};

/// Damping couples a mode x with others if the part of Z x outside x is above this fraction of |Z x|. Modes are known
/// to 1e-10.
const UNCOUPLED_SHARE: f64 = 1e-6;
/// Rounding error of Z x, relative to the strongest damping.
const ROUNDING: f64 = 1e-13;
/// A response is dropped if the part of it that is new is below this fraction.
const NEW_SHARE_MIN: f64 = 1e-6;
/// Most corrections of a pole; each squares its relative error.
const CORRECTIONS_MAX: usize = 8;
/// A correction below this fraction of the pole is the last: the error that remains is its square.
const LAST_CORRECTION_MAX: f64 = 1e-8;
/// A pole needs no correction if the error that its residual implies is below this fraction of it.
const UNCORRECTED_ERROR_MAX: f64 = 1e-12;
/// A correction above this fraction of the pole leads to another pole; all corrections are then discarded.
const CORRECTION_MAX: f64 = 1e-2;

/// Largest relative error, implied by its residual, at which a pole counts as known (1e-6 cents).
const KNOWN_ERROR_MAX: f64 = 5e-10;
/// Rounding error of a residual, relative to the largest stiffness of the network.
const RESIDUAL_ROUNDING: f64 = 1e-12;
/// Two poles are the same one, found twice, if corrections reduced their distance to less than this fraction.
const MERGED_RATIO_MAX: f64 = 1e-3;

/// A pole and the motion x of the masses (n), scaled to xᵀ(2s + Z)x = 2i·Im s, or to length 1 if the pole is real.
pub(super) struct DampedMode {
    pub(super) pole: Complex<f64>,
    pub(super) shape: Vec<Complex<f64>>,
    /// Whether this is a pole, and distinct from all others.
    pub(super) is_known: bool,
}

/// Whether damping couples any of the modes with others.
pub(super) fn is_coupled(body: &PartBody, modes: &[Mode]) -> bool {
    let mat_count = body.springs.dimension();
    let alternating_vector: Vec<f64> = (0..mat_count).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
    let damping_image = damping_times(&body.dampers, &alternating_vector);
    // If damping does not act on a mode x, Z x is only rounding error; Z times a vector of alternating signs tells
    // its size.
    let rounding_size = ROUNDING * sqrt(dot(&damping_image, &damping_image) / mat_count as f64);
    modes.iter().any(|mode| {
        interrupt::poll_for(mat_count);
        let damping_image = damping_times(&body.dampers, &mode.vector);
        let damping_share = dot(&mode.vector, &damping_image);
        let residual = damping_image
            .iter()
            .zip(&mode.vector)
            .map(|(z, v)| z - damping_share * v);
        let residual: f64 = residual.map(|z| z * z).sum();
        residual > UNCOUPLED_SHARE * UNCOUPLED_SHARE * dot(&damping_image, &damping_image)
            && residual > rounding_size * rounding_size
    })
}

/// The `count` poles of smallest |s| that arise from undamped modes; `is_coupled` says whether damping couples these.
pub(super) fn damped_modes(body: &PartBody, modes: &[Mode], is_coupled: bool, count: usize) -> Vec<DampedMode> {
    if !is_coupled {
        let solve_mode = |mode: &Mode| {
            interrupt::poll_for(mode.vector.len());
            uncoupled_mode(mode, &damping_times(&body.dampers, &mode.vector))
        };
        return modes.iter().take(count).map(solve_mode).collect();
    }
    let modes = with_responses(body, modes);
    let damping_images: Vec<Vec<f64>> = modes
        .iter()
        .map(|mode| {
            interrupt::poll_for(mode.vector.len());
            damping_times(&body.dampers, &mode.vector)
        })
        .collect();
    let Some(mut coupled_poles) = coupled_modes(&modes, &damping_images) else {
        return Vec::new();
    };
    coupled_poles.truncate(count);
    let matrices = NetworkMatrices::new(body);
    let start_poles: Vec<Complex<f64>> = coupled_poles.iter().map(|mode| mode.pole).collect();
    for (i, mode) in coupled_poles.iter_mut().enumerate() {
        let other_poles = start_poles.iter().enumerate().filter(|(j, _)| *j != i);
        let pole_gap = other_poles.fold(f64::INFINITY, |gap_min, (_, other)| {
            gap_min.min((other - mode.pole).norm())
        });
        matrices.refine_pole(mode, pole_gap);
    }
    for i in 0..coupled_poles.len() {
        interrupt::poll();
        for j in 0..i {
            let (gap_before, gap_now) = (
                start_poles[i] - start_poles[j],
                coupled_poles[i].pole - coupled_poles[j].pole,
            );
            if gap_now.norm() < MERGED_RATIO_MAX * gap_before.norm() {
                (coupled_poles[i].is_known, coupled_poles[j].is_known) = (false, false);
            }
        }
    }
    coupled_poles
}

/// The pole of a mode that damping couples with no other: s² + ζs + λ = 0.
fn uncoupled_mode(mode: &Mode, image: &[f64]) -> DampedMode {
    let half_damping = 0.5 * dot(&mode.vector, image);
    let omega_squared = mode.lambda - half_damping * half_damping;
    let pole = if omega_squared >= 0.0 {
        Complex::new(-half_damping, sqrt(omega_squared.abs())) // abs also for −0
    } else {
        // Avoids the difference of two nearly equal numbers.
        Complex::new(-mode.lambda / (half_damping + sqrt(-omega_squared)), 0.0)
    };
    let shape = mode.vector.iter().map(|&x| Complex::from(x)).collect();
    DampedMode {
        pole,
        shape,
        is_known: true,
    }
}

/// The modes, extended by responses of the springs to damping: orthonormal vectors, each with its λ, as modes are.
fn with_responses(body: &PartBody, modes: &[Mode]) -> Vec<Mode> {
    let mat_count = body.springs.dimension();
    let responses_max = modes.len().min(mat_count - modes.len());
    let mut fresh_images: Vec<Vec<f64>> = Vec::new();
    let mode_vectors = |modes: &[Mode]| -> Vec<Vec<f64>> { modes.iter().map(|mode| mode.vector.clone()).collect() };
    let mut vectors = mode_vectors(modes);
    for mode in modes {
        let damping_image = damping_times(&body.dampers, &mode.vector);
        push_independent_part(&mut vectors, &mut fresh_images, damping_image);
    }
    fresh_images.truncate(responses_max);
    // Static responses, then responses at half the highest λ: two for each damped point, if there are few.
    let middle_lambda = modes.last().map_or(0.0, |mode| 0.5 * mode.lambda);
    let mut vectors = mode_vectors(modes);
    let mut responses: Vec<Vec<f64>> = Vec::new();
    for mut shift in [-1e-9 * body.springs.mean_diagonal(), middle_lambda] {
        if fresh_images.is_empty() {
            break;
        }
        let shifted_factor = body.springs.factor(&mut shift);
        for fresh_image in &fresh_images {
            if responses.len() < responses_max {
                push_independent_part(&mut vectors, &mut responses, shifted_factor.solve(fresh_image));
            }
        }
    }
    // Rotate the responses among themselves so that springs do not couple them.
    let mut extended_modes = modes.to_vec();
    let response_count = responses.len();
    if response_count == 0 {
        return extended_modes;
    }
    let spring_images: Vec<Vec<f64>> = responses
        .iter()
        .map(|response| body.springs.multiply(response))
        .collect();
    let reduced_matrix = (0..response_count * response_count)
        .map(|entry| {
            dot(
                &responses[entry / response_count],
                &spring_images[entry % response_count],
            )
        })
        .collect();
    if let Some((lambdas, eigen_rows)) = all_eigenvalues(reduced_matrix, &unit_vectors(response_count)) {
        for (entry, lambda) in lambdas.into_iter().enumerate() {
            let mut vector = vec![0.0; mat_count];
            for (response, row) in responses.iter().zip(&eigen_rows) {
                add_scaled(row[entry], response, &mut vector);
            }
            extended_modes.push(Mode { lambda, vector });
        }
    }
    extended_modes
}

/// Add the part of a vector outside an orthonormal basis to the basis and to `new_vectors`, unless that part is too
/// small.
fn push_independent_part(basis: &mut Vec<Vec<f64>>, new_vectors: &mut Vec<Vec<f64>>, mut vector: Vec<f64>) {
    let norm_before = norm(&vector);
    orthogonalise(&mut vector, basis);
    if normalise(&mut vector) <= NEW_SHARE_MIN * norm_before {
        return;
    }
    basis.push(vector.clone());
    new_vectors.push(vector);
}

/// Poles of modes that damping couples, by rising |s|: eigenvalues in (p, v) with p = ω·q, ṗ = ω·v, v̇ = −ω·p − Z·v.
fn coupled_modes(modes: &[Mode], images: &[Vec<f64>]) -> Option<Vec<DampedMode>> {
    let mode_count = modes.len();
    let matrix_size = 2 * mode_count;
    let mut state_matrix = vec![0.0; matrix_size * matrix_size];
    for (i, mode) in modes.iter().enumerate() {
        interrupt::poll();
        let omega = sqrt(mode.lambda.abs());
        state_matrix[i * matrix_size + mode_count + i] = omega;
        state_matrix[(mode_count + i) * matrix_size + i] = if mode.lambda < 0.0 { omega } else { -omega };
        for (j, image) in images.iter().enumerate() {
            state_matrix[(mode_count + i) * matrix_size + mode_count + j] = -dot(&mode.vector, image);
        }
    }
    let eigensystem = general_eigensystem(state_matrix)?;
    let mode_shape = |index: usize, is_pair: bool| -> Vec<Complex<f64>> {
        let speed_part = |row: usize| &eigensystem.vectors[row * matrix_size + mode_count..(row + 1) * matrix_size];
        let mut mode_shape = vec![Complex::from(0.0); modes[0].vector.len()];
        for (i, mode) in modes.iter().enumerate() {
            let im = if is_pair { speed_part(index + 1)[i] } else { 0.0 };
            let mode_weight = Complex::new(speed_part(index)[i], im);
            let shape_terms = mode_shape.iter_mut().zip(&mode.vector);
            shape_terms.for_each(|(sum, x)| *sum += mode_weight * x);
        }
        mode_shape
    };
    // An overdamped mode has two real poles, of which the slower is kept: as many real poles as there are modes left.
    let (mut real_poles, mut pole_indices): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    for (index, (_, im)) in eigensystem.values.iter().enumerate() {
        if *im > 0.0 {
            pole_indices.push(index);
        } else if *im == 0.0 {
            real_poles.push(index);
        }
    }
    real_poles.sort_by(|&a, &b| eigensystem.values[b].0.total_cmp(&eigensystem.values[a].0));
    real_poles.truncate(mode_count.saturating_sub(pole_indices.len()));
    pole_indices.extend(real_poles);
    let pole_square = |index: usize| {
        let (re, im) = eigensystem.values[index];
        re * re + im * im
    };
    pole_indices.sort_by(|&a, &b| pole_square(a).total_cmp(&pole_square(b)));
    let damped_mode = |index: usize| {
        let (re, im) = eigensystem.values[index];
        DampedMode {
            pole: Complex::new(re, im),
            shape: mode_shape(index, im != 0.0),
            is_known: true,
        }
    };
    Some(pole_indices.into_iter().map(damped_mode).collect())
}

/// Stiffness and damping of the whole network on one sparsity pattern.
pub(super) struct NetworkMatrices {
    pub(super) pattern: Pattern,
    stiffness: Values<f64>,
    damping: Values<f64>,
}

impl NetworkMatrices {
    pub(super) fn new(body: &PartBody) -> Self {
        let mat_count = body.springs.dimension();
        let all_springs = body.springs.springs().iter().chain(&body.dampers);
        let all_springs: Vec<Spring> = all_springs.copied().collect();
        let pattern = Pattern::new(mat_count, springs::coupled_points(&all_springs));
        Self {
            stiffness: springs::assemble_values(&pattern, body.springs.springs()),
            damping: springs::assemble_values(&pattern, &body.dampers),
            pattern,
        }
    }

    /// P(s) = s² + s·Z + K.
    pub(super) fn polynomial(&self, s: Complex<f64>) -> Values<Complex<f64>> {
        Values::combine(&self.stiffness, &self.damping, s * s, |k, z| s * z + k)
    }

    /// Refine a pole by Newton's method, s −= xᵀx / xᵀy with P(s) y = P′(s) x, unless its residual shows that it is
    /// exact; `gap` is the distance to the next pole. Source: Ruhe, SIAM J. Numer. Anal. 10 (1973).
    fn refine_pole(&self, mode: &mut DampedMode, gap: f64) {
        let mat_count = self.pattern.dimension();
        let mut applied_matrix = vec![Complex::from(0.0); mat_count];
        let (mut s, mut x) = (mode.pole, mode.shape.clone());
        let vector_norm = |x: &[Complex<f64>]| sqrt(x.iter().map(|x| x.norm_sqr()).sum());
        let slope_matrix =
            |s: Complex<f64>| Values::combine(&self.stiffness, &self.damping, s * 2.0, |_, z| Complex::from(z));
        for round in 0..CORRECTIONS_MAX {
            let pole_matrix = self.polynomial(s);
            if round == 0 {
                pole_matrix.multiply(&self.pattern, &x, &mut applied_matrix);
                let residual = vector_norm(&applied_matrix) / (2.0 * s.norm() * vector_norm(&x));
                if residual * residual <= UNCORRECTED_ERROR_MAX * s.norm() * gap {
                    break;
                }
            }
            slope_matrix(s).multiply(&self.pattern, &x, &mut applied_matrix);
            let Some(pole_factor) = Factor::new(&self.pattern, &pole_matrix, Complex::from(0.0)) else {
                break; // s is a pole to the last bit
            };
            let y = pole_factor.solve(&applied_matrix);
            let pole_step = bilinear(&x, &x) / bilinear(&x, &y);
            let norm_of_y = vector_norm(&y);
            if !(pole_step.norm() <= CORRECTION_MAX * mode.pole.norm() && norm_of_y.is_finite()) {
                (s, x) = (mode.pole, mode.shape.clone());
                break;
            }
            s -= pole_step;
            x = y.into_iter().map(|y| y / norm_of_y).collect();
            if pole_step.norm() <= LAST_CORRECTION_MAX * s.norm() {
                break;
            }
        }
        if mode.pole.im == 0.0 {
            s.im = 0.0;
        }
        self.polynomial(s).multiply(&self.pattern, &x, &mut applied_matrix);
        let stiffest = self.stiffness.diagonal.iter();
        let stiffest = stiffest.fold(0.0_f64, |stiffness_max, k| stiffness_max.max(k.abs()));
        let stiffness_max = 2.0 * KNOWN_ERROR_MAX * s.norm_sqr() + RESIDUAL_ROUNDING * stiffest;
        mode.is_known = vector_norm(&applied_matrix) <= stiffness_max * vector_norm(&x);
        slope_matrix(s).multiply(&self.pattern, &x, &mut applied_matrix);
        let shape_factor = if s.im == 0.0 {
            Complex::from(1.0 / vector_norm(&x))
        } else {
            complex_root(Complex::new(0.0, 2.0 * s.im) / bilinear(&x, &applied_matrix))
        };
        mode.pole = s;
        mode.shape = x.into_iter().map(|x| x * shape_factor).collect();
    }
}

fn bilinear(a: &[Complex<f64>], b: &[Complex<f64>]) -> Complex<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// √z with a non-negative real part.
fn complex_root(z: Complex<f64>) -> Complex<f64> {
    let modulus = sqrt(z.norm_sqr());
    let re = sqrt((0.5 * (modulus + z.re)).max(0.0));
    let im = sqrt((0.5 * (modulus - z.re)).max(0.0));
    Complex::new(re, if z.im < 0.0 { -im } else { im })
}

/// Z x.
fn damping_times(dampers: &[Spring], x: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; x.len()];
    for &((a, lever), other, z) in dampers {
        let damper_force = z * (lever * x[a] - other.map_or(0.0, |(b, other_lever)| other_lever * x[b]));
        y[a] += lever * damper_force;
        if let Some((b, other_lever)) = other {
            y[b] -= other_lever * damper_force;
        }
    }
    y
}
