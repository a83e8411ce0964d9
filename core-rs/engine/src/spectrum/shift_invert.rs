//! The modes of a network near a frequency, with none left out: Lanczos on (A − σ)⁻¹, whose largest eigenvalues lie
//! next to the shift σ. The inertia of A − σ tells how many modes there are. One run sees only one vector of a multiple
//! eigenvalue; further runs find the missing modes outside the span of those found.
//!
//! Source: Grimes, Lewis, Simon, "A shifted block Lanczos algorithm for solving sparse symmetric generalized
//! eigenproblems", SIAM J. Matrix Anal. Appl. 15 (1994).

use super::sparse::Factor;
use super::springs::Springs;
use super::vector::{add_scaled, dot, norm, normalise, orthogonalise, orthogonalise_once, start_vector, unit_vectors};
use super::{Mode, all_eigenvalues};
use crate::interrupt;

/// Largest number of modes sought at one shift: a longer basis costs more than another factorisation.
const MODES_PER_SHIFT: usize = 64;
/// Residual of (A − σ)⁻¹, relative to the eigenvalue, at which a pair counts as converged: the eigenvalue's error is
/// its square.
const CONVERGED_RESIDUAL: f64 = 1e-11;
/// A pair this much smaller than the largest of its run is lost in the rounding of that; another run finds it.
const RELATIVE_EIGENVALUE_MIN: f64 = 1e-6;
/// Number of steps between two diagonalisations of the small matrix.
const CHECK_EVERY: usize = 12;
/// Smallest relative gap between two modes in which a border may lie: rounding does not move a mode across it.
const RELATIVE_GAP_MIN: f64 = 1e-9;
/// Largest residual of a mode, relative to the largest element of the diagonal; also the largest scalar product of two
/// neighbouring modes.
const MODE_TOLERANCE: f64 = 1e-9;
/// Number of consecutive runs without a new mode after which the search ends, even if modes are missing.
const FRUITLESS_RUNS_MAX: usize = 3;

/// Modes by rising λ, and whether the inertia of the matrix confirms that none is missing among them.
#[derive(Debug)]
pub(crate) struct CertifiedModes {
    pub(crate) modes: Vec<Mode>,
    pub(crate) is_certified: bool,
}

/// How many modes have λ below a bound.
pub(crate) fn n_below(springs: &Springs, bound: f64) -> usize {
    let mut used_shift = bound;
    springs.factor(&mut used_shift).n_below_shift()
}

/// The `count` modes of the smallest λ; fewer if there are not so many.
pub(crate) fn lowest_modes(springs: &Springs, count: usize) -> CertifiedModes {
    let dimension = springs.dimension();
    let count = count.min(dimension);
    // A shift below all eigenvalues: slightly below 0, or below the Gershgorin bound if the matrix has negative
    // eigenvalues.
    let mut shift = -1e-9 * springs.mean_diagonal();
    let mut factor = springs.factor(&mut shift);
    if factor.n_below_shift() > 0 {
        shift = 1.001 * springs.eigenvalue_lower_bound() - 1e-9 * springs.mean_diagonal();
        factor = springs.factor(&mut shift);
    }
    let mut modes: Vec<Mode> = Vec::new();
    let (mut certified_count, mut fruitless_runs, mut run_number) = (0, 0, 0);
    while certified_count < count && modes.len() < dimension && fruitless_runs < FRUITLESS_RUNS_MAX {
        run_number += 1;
        let modes_wanted = (count - certified_count).min(MODES_PER_SHIFT) + 2;
        let new_modes = lanczos(springs, &factor, &modes, modes_wanted, run_number);
        fruitless_runs = if new_modes.is_empty() { fruitless_runs + 1 } else { 0 };
        modes.extend(new_modes);
        sort(&mut modes);
        if modes.len() == dimension {
            break;
        }
        let Some(separator) = separator(&modes, count) else {
            continue;
        };
        let mut next_shift = separator;
        let next_factor = springs.factor(&mut next_shift);
        let count_below = modes.iter().filter(|mode| mode.lambda < next_shift).count();
        // If the numbers differ, modes of a multiple eigenvalue are missing: the same shift finds them in another run.
        if next_factor.n_below_shift() == count_below {
            certified_count = count_below;
            factor = next_factor;
        }
    }
    let is_counted = certified_count >= count || modes.len() == dimension;
    modes.truncate(count);
    CertifiedModes {
        is_certified: is_counted && are_distinct_modes(springs, &modes),
        modes,
    }
}

/// The `count` modes whose λ lies nearest to `centre`.
pub(crate) fn modes_around(springs: &Springs, centre: f64, count: usize) -> CertifiedModes {
    let dimension = springs.dimension();
    let count = count.min(dimension);
    let mut shift = centre;
    let factor = springs.factor(&mut shift);
    let mut modes: Vec<Mode> = Vec::new();
    let (mut is_counted, mut fruitless_runs, mut run_number) = (count == 0, 0, 0);
    let distance = |mode: &Mode| (mode.lambda - shift).abs();
    while !is_counted && fruitless_runs < FRUITLESS_RUNS_MAX {
        run_number += 1;
        let modes_wanted = (count + 2).saturating_sub(modes.len()).max(4);
        let new_modes = lanczos(springs, &factor, &modes, modes_wanted, run_number);
        fruitless_runs = if new_modes.is_empty() { fruitless_runs + 1 } else { 0 };
        modes.extend(new_modes);
        modes.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        if modes.len() == dimension {
            is_counted = true;
            break;
        }
        if modes.len() <= count {
            continue;
        }
        let gap_index =
            (count..modes.len()).find(|&i| distance(&modes[i]) - distance(&modes[i - 1]) > RELATIVE_GAP_MIN * shift);
        let Some(gap_index) = gap_index else { continue };
        let radius = 0.5 * (distance(&modes[gap_index]) + distance(&modes[gap_index - 1]));
        let count_inside = n_below(springs, shift + radius) - n_below(springs, shift - radius);
        is_counted = count_inside == gap_index;
    }
    modes.truncate(count);
    sort(&mut modes);
    CertifiedModes {
        is_certified: is_counted && are_distinct_modes(springs, &modes),
        modes,
    }
}

/// Whether each vector is a mode, and no two neighbours (by rising λ) are the same one: counting eigenvalues cannot
/// tell.
pub(crate) fn are_distinct_modes(springs: &Springs, modes: &[Mode]) -> bool {
    let largest_diagonal = springs.values.diagonal.iter();
    let largest_diagonal = largest_diagonal.fold(0.0_f64, |largest_yet, x| largest_yet.max(x.abs()));
    let is_eigenpair = |mode: &Mode| {
        let mut residual = springs.multiply(&mode.vector);
        add_scaled(-mode.lambda, &mode.vector, &mut residual);
        norm(&residual) <= MODE_TOLERANCE * largest_diagonal
    };
    let are_orthogonal = |pair: &[Mode]| dot(&pair[0].vector, &pair[1].vector).abs() <= MODE_TOLERANCE;
    modes.iter().all(is_eigenpair) && modes.windows(2).all(are_orthogonal)
}

fn sort(modes: &mut [Mode]) {
    modes.sort_by(|a, b| a.lambda.total_cmp(&b.lambda));
}

/// A number in a gap between two modes: above the first `count` modes if there is such a gap, otherwise above as many
/// as possible.
fn separator(modes: &[Mode], count: usize) -> Option<f64> {
    let is_separated = |&i: &usize| {
        let (lambda_below, lambda_above) = (modes[i - 1].lambda, modes[i].lambda);
        lambda_above - lambda_below > RELATIVE_GAP_MIN * lambda_above.abs()
    };
    let gap_middle = |i: usize| 0.5 * (modes[i - 1].lambda + modes[i].lambda);
    let gap_index = (count.min(modes.len())..modes.len()).find(is_separated);
    gap_index
        .or_else(|| (1..modes.len()).rev().find(is_separated))
        .map(gap_middle)
}

/// The modes that one Lanczos run finds outside the span of `modes_known`: from the nearest to the shift up to the
/// first that has not converged.
fn lanczos(
    springs: &Springs,
    factor: &Factor<'_, f64>,
    modes_known: &[Mode],
    mode_count: usize,
    run: usize,
) -> Vec<Mode> {
    let dimension = springs.dimension();
    let free_dimension = dimension - modes_known.len();
    let steps_max = (4 * mode_count + 80).min(free_dimension);
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let (mut alphas, mut betas): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let project_out = |x: &mut [f64]| {
        for mode in modes_known {
            let projection = dot(&mode.vector, x);
            add_scaled(-projection, &mode.vector, x);
        }
    };
    let mut next_vector = start_vector(dimension, run);
    project_out(&mut next_vector);
    project_out(&mut next_vector);
    normalise(&mut next_vector);
    let mut operator_scale = 0.0_f64;
    let ritz_weights = loop {
        interrupt::poll();
        let mut image = factor.solve(&next_vector);
        if let (Some(previous_vector), Some(beta)) = (basis.last(), betas.last()) {
            add_scaled(-beta, previous_vector, &mut image);
        }
        let alpha = dot(&next_vector, &image);
        add_scaled(-alpha, &next_vector, &mut image);
        // This must come last: the recurrence would amplify any part along the found modes with each step.
        project_out(&mut image);
        let norm_before = norm(&image);
        basis.push(next_vector);
        alphas.push(alpha);
        orthogonalise_once(&mut image, &basis);
        if norm(&image) < 0.7 * norm_before {
            project_out(&mut image);
            orthogonalise(&mut image, &basis);
        }
        let beta = normalise(&mut image);
        operator_scale = operator_scale.max(alpha.abs() + beta);
        let step_count = basis.len();
        let is_space_exhausted = step_count == free_dimension || beta <= 1e-14 * operator_scale;
        if is_space_exhausted
            || step_count == steps_max
            || (step_count >= mode_count && step_count.is_multiple_of(CHECK_EVERY))
        {
            let beta = if step_count == free_dimension { 0.0 } else { beta };
            let (ritz_weights, is_ended_by_rounding) = converged_pairs(&alphas, &betas, beta);
            if is_space_exhausted || is_ended_by_rounding || step_count == steps_max || ritz_weights.len() >= mode_count
            {
                break ritz_weights;
            }
        }
        betas.push(beta);
        next_vector = image;
    };
    let ritz_mode = |weights: Vec<f64>| {
        interrupt::poll();
        let mut vector = vec![0.0; dimension];
        for (weight, direction) in weights.iter().zip(&basis) {
            add_scaled(*weight, direction, &mut vector);
        }
        project_out(&mut vector);
        normalise(&mut vector);
        // For slow modes, λ by the energy is exact, whereas σ + 1/θ is not.
        let lambda = springs.energy(&vector);
        Mode { lambda, vector }
    };
    ritz_weights.into_iter().map(ritz_mode).collect()
}

/// Eigenvectors of the tridiagonal matrix by falling |θ|, up to the first that has not converged; and whether rounding
/// is what ends the list.
fn converged_pairs(alphas: &[f64], betas: &[f64], beta: f64) -> (Vec<Vec<f64>>, bool) {
    let dimension = alphas.len();
    let mut tridiagonal = vec![0.0; dimension * dimension];
    for i in 0..dimension {
        tridiagonal[i * dimension + i] = alphas[i];
        if i + 1 < dimension {
            tridiagonal[i * dimension + i + 1] = betas[i];
            tridiagonal[(i + 1) * dimension + i] = betas[i];
        }
    }
    let Some((eigenvalues, components)) = all_eigenvalues(tridiagonal, &unit_vectors(dimension)) else {
        return (Vec::new(), false);
    };
    let mut falling_order: Vec<usize> = (0..dimension).collect();
    falling_order.sort_by(|&i, &j| eigenvalues[j].abs().total_cmp(&eigenvalues[i].abs()));
    let range_limit = RELATIVE_EIGENVALUE_MIN * eigenvalues[falling_order[0]].abs();
    let mut converged = Vec::new();
    for i in falling_order {
        if eigenvalues[i].abs() <= range_limit {
            return (converged, true);
        }
        if (beta * components[dimension - 1][i]).abs() > CONVERGED_RESIDUAL * eigenvalues[i].abs() {
            break;
        }
        converged.push(components.iter().map(|row| row[i]).collect());
    }
    (converged, false)
}
