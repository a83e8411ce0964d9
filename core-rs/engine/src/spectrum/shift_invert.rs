//! The modes of a network near a frequency, with none left out: Lanczos on (A − σ)⁻¹, whose largest eigenvalues lie
//! next to the shift σ. The inertia of A − σ tells how many modes there are. One run sees only one vector of a multiple
//! eigenvalue; further runs find the missing modes outside the span of those found.
//!
//! Source: Grimes, Lewis, Simon, "A shifted block Lanczos algorithm for solving sparse symmetric generalized
//! eigenproblems", SIAM J. Matrix Anal. Appl. 15 (1994).

use super::sparse::Factor;
use super::springs::Springs;
use super::vector::{
    add, dot, norm, normalise, orthogonalise, orthogonalise_once, start_vector, units,
};
use super::{Mode, all_eigenvalues};
use crate::interrupt;

/// Largest number of modes sought at one shift: a longer basis costs more than another factorisation.
const SLICE: usize = 64;
/// Residual of (A − σ)⁻¹, relative to the eigenvalue, at which a pair counts as converged: the eigenvalue's error is
/// its square.
const CONVERGED: f64 = 1e-11;
/// A pair this much smaller than the largest of its run is lost in the rounding of that; another run finds it.
const RANGE: f64 = 1e-6;
/// Number of steps between two diagonalisations of the small matrix.
const CHECK_EVERY: usize = 12;
/// Smallest relative gap between two modes in which a border may lie: rounding does not move a mode across it.
const GAP: f64 = 1e-9;
/// Largest residual of a mode, relative to the largest element of the diagonal; also the largest scalar product of two
/// neighbouring modes.
const MODE_TOLERANCE: f64 = 1e-9;
/// Number of consecutive runs without a new mode after which the search ends, even if modes are missing.
const FRUITLESS_RUNS_MAX: usize = 3;

/// Modes by rising λ, and whether the inertia of the matrix confirms that none is missing among them.
#[derive(Debug)]
pub(crate) struct LowestModes {
    pub(crate) modes: Vec<Mode>,
    pub(crate) is_certified: bool,
}

/// How many modes have λ below a bound.
pub(crate) fn n_below(springs: &Springs, bound: f64) -> usize {
    let mut shift = bound;
    springs.factor(&mut shift).n_below()
}

/// The `count` modes of the smallest λ; fewer if there are not so many.
pub(crate) fn lowest_modes(springs: &Springs, count: usize) -> LowestModes {
    let n = springs.n();
    let count = count.min(n);
    // A shift below all eigenvalues: slightly below 0, or below the Gershgorin bound if the matrix has negative
    // eigenvalues.
    let mut shift = -1e-9 * springs.scale();
    let mut factor = springs.factor(&mut shift);
    if factor.n_below() > 0 {
        shift = 1.001 * springs.bottom() - 1e-9 * springs.scale();
        factor = springs.factor(&mut shift);
    }
    let mut modes: Vec<Mode> = Vec::new();
    let (mut known, mut fruitless, mut run) = (0, 0, 0);
    while known < count && modes.len() < n && fruitless < FRUITLESS_RUNS_MAX {
        run += 1;
        let wanted = (count - known).min(SLICE) + 2;
        let fresh = lanczos(springs, &factor, &modes, wanted, run);
        fruitless = if fresh.is_empty() { fruitless + 1 } else { 0 };
        modes.extend(fresh);
        sort(&mut modes);
        if modes.len() == n {
            break;
        }
        let Some(separator) = separator(&modes, count) else {
            continue;
        };
        let mut next = separator;
        let above = springs.factor(&mut next);
        let below = modes.iter().filter(|mode| mode.lambda < next).count();
        // If the numbers differ, modes of a multiple eigenvalue are missing: the same shift finds them in another run.
        if above.n_below() == below {
            known = below;
            factor = above;
        }
    }
    let is_counted = known >= count || modes.len() == n;
    modes.truncate(count);
    LowestModes {
        is_certified: is_counted && are_modes(springs, &modes),
        modes,
    }
}

/// The `count` modes whose λ lies nearest to `centre`.
pub(crate) fn modes_around(springs: &Springs, centre: f64, count: usize) -> LowestModes {
    let n = springs.n();
    let count = count.min(n);
    let mut shift = centre;
    let factor = springs.factor(&mut shift);
    let mut modes: Vec<Mode> = Vec::new();
    let (mut is_counted, mut fruitless, mut run) = (count == 0, 0, 0);
    let distance = |mode: &Mode| (mode.lambda - shift).abs();
    while !is_counted && fruitless < FRUITLESS_RUNS_MAX {
        run += 1;
        let wanted = (count + 2).saturating_sub(modes.len()).max(4);
        let fresh = lanczos(springs, &factor, &modes, wanted, run);
        fruitless = if fresh.is_empty() { fruitless + 1 } else { 0 };
        modes.extend(fresh);
        modes.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        if modes.len() == n {
            is_counted = true;
            break;
        }
        if modes.len() <= count {
            continue;
        }
        let index = (count..modes.len())
            .find(|&i| distance(&modes[i]) - distance(&modes[i - 1]) > GAP * shift);
        let Some(index) = index else { continue };
        let radius = 0.5 * (distance(&modes[index]) + distance(&modes[index - 1]));
        let inside = n_below(springs, shift + radius) - n_below(springs, shift - radius);
        is_counted = inside == index;
    }
    modes.truncate(count);
    sort(&mut modes);
    LowestModes {
        is_certified: is_counted && are_modes(springs, &modes),
        modes,
    }
}

/// Whether each vector is a mode, and no two neighbours (by rising λ) are the same one: counting eigenvalues cannot
/// tell.
pub(crate) fn are_modes(springs: &Springs, modes: &[Mode]) -> bool {
    let stiffest = springs.values.diagonal.iter();
    let stiffest = stiffest.fold(0.0_f64, |most, x| most.max(x.abs()));
    let is_mode = |mode: &Mode| {
        let mut rest = springs.times(&mode.vector);
        add(-mode.lambda, &mode.vector, &mut rest);
        norm(&rest) <= MODE_TOLERANCE * stiffest
    };
    let is_other = |pair: &[Mode]| dot(&pair[0].vector, &pair[1].vector).abs() <= MODE_TOLERANCE;
    modes.iter().all(is_mode) && modes.windows(2).all(is_other)
}

fn sort(modes: &mut [Mode]) {
    modes.sort_by(|a, b| a.lambda.total_cmp(&b.lambda));
}

/// A number in a gap between two modes: above the first `count` modes if there is such a gap, otherwise above as many
/// as possible.
fn separator(modes: &[Mode], count: usize) -> Option<f64> {
    let gap = |&i: &usize| {
        let (low, high) = (modes[i - 1].lambda, modes[i].lambda);
        high - low > GAP * high.abs()
    };
    let middle = |i: usize| 0.5 * (modes[i - 1].lambda + modes[i].lambda);
    let enough = (count.min(modes.len())..modes.len()).find(gap);
    enough
        .or_else(|| (1..modes.len()).rev().find(gap))
        .map(middle)
}

/// The modes that one Lanczos run finds outside the span of `modes_known`: from the nearest to the shift up to the first that
/// has not converged.
fn lanczos(
    springs: &Springs,
    factor: &Factor<'_, f64>,
    modes_known: &[Mode],
    wanted: usize,
    run: usize,
) -> Vec<Mode> {
    let n = springs.n();
    let free = n - modes_known.len();
    let steps_max = (4 * wanted + 80).min(free);
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let (mut alphas, mut betas): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let project_out = |x: &mut [f64]| {
        for mode in modes_known {
            let along = dot(&mode.vector, x);
            add(-along, &mode.vector, x);
        }
    };
    let mut next = start_vector(n, run);
    project_out(&mut next);
    project_out(&mut next);
    normalise(&mut next);
    let mut scale = 0.0_f64;
    let pairs = loop {
        interrupt::poll();
        let mut image = factor.solve(&next);
        if let (Some(before), Some(beta)) = (basis.last(), betas.last()) {
            add(-beta, before, &mut image);
        }
        let alpha = dot(&next, &image);
        add(-alpha, &next, &mut image);
        // This must come last: the recurrence would amplify any part along the found modes with each step.
        project_out(&mut image);
        let left = norm(&image);
        basis.push(next);
        alphas.push(alpha);
        orthogonalise_once(&mut image, &basis);
        if norm(&image) < 0.7 * left {
            project_out(&mut image);
            orthogonalise(&mut image, &basis);
        }
        let beta = normalise(&mut image);
        scale = scale.max(alpha.abs() + beta);
        let steps = basis.len();
        let is_whole = steps == free || beta <= 1e-14 * scale;
        if is_whole || steps == steps_max || (steps >= wanted && steps.is_multiple_of(CHECK_EVERY))
        {
            let beta = if steps == free { 0.0 } else { beta };
            let (pairs, is_limited) = converged_pairs(&alphas, &betas, beta);
            if is_whole || is_limited || steps == steps_max || pairs.len() >= wanted {
                break pairs;
            }
        }
        betas.push(beta);
        next = image;
    };
    let ritz = |weights: Vec<f64>| {
        interrupt::poll();
        let mut vector = vec![0.0; n];
        for (weight, direction) in weights.iter().zip(&basis) {
            add(*weight, direction, &mut vector);
        }
        project_out(&mut vector);
        normalise(&mut vector);
        // For slow modes, λ by the energy is exact, whereas σ + 1/θ is not.
        let lambda = springs.energy(&vector);
        Mode { lambda, vector }
    };
    pairs.into_iter().map(ritz).collect()
}

/// Eigenvectors of the tridiagonal matrix by falling |θ|, up to the first that has not converged; and whether rounding
/// is what ends the list.
fn converged_pairs(alphas: &[f64], betas: &[f64], beta: f64) -> (Vec<Vec<f64>>, bool) {
    let k = alphas.len();
    let mut small = vec![0.0; k * k];
    for i in 0..k {
        small[i * k + i] = alphas[i];
        if i + 1 < k {
            small[i * k + i + 1] = betas[i];
            small[(i + 1) * k + i] = betas[i];
        }
    }
    let Some((values, seen)) = all_eigenvalues(small, &units(k)) else {
        return (Vec::new(), false);
    };
    let mut order: Vec<usize> = (0..k).collect();
    order.sort_by(|&i, &j| values[j].abs().total_cmp(&values[i].abs()));
    let least = RANGE * values[order[0]].abs();
    let mut pairs = Vec::new();
    for i in order {
        if values[i].abs() <= least {
            return (pairs, true);
        }
        if (beta * seen[k - 1][i]).abs() > CONVERGED * values[i].abs() {
            break;
        }
        pairs.push(seen.iter().map(|row| row[i]).collect());
    }
    (pairs, false)
}
