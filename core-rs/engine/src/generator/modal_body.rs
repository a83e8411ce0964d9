//! MODES: masses at the places of a body whose modes are known, joined so that the body has these modes and levels.
//!
//! The motion at place p is Σ φ_kp·q_k, where the modes q have the mass M. An orthogonal change of coordinates turns
//! modes into masses: one at each place, the others inside. It exists if the places move independently of each other at
//! the first instant, as they do on a real body. A list of modes is finite, so short high modes are added to make this
//! true.

use super::{GeneratorError, count};
use crate::interrupt;
use crate::maths::sqrt;

/// Most modes of one body: each pair of masses has a link.
pub const MAX_MODAL: usize = 500;
/// Most places of one body.
pub const MAX_PLACES: usize = 64;
/// Fraction of a place's own mobility below which the remainder is rounding error.
const PIVOT_MIN: f64 = 1e-12;

/// Masses, and the stiffness and damping between them.
#[derive(Clone, Debug, PartialEq)]
pub struct ModalBody {
    /// Places first, then masses inside   (n,)
    pub masses: Vec<f64>,
    /// (n, n)
    pub stiffness: Vec<f64>,
    /// (n, n)
    pub damping: Vec<f64>,
}

/// The body whose modes have `poles` (ω² and ζ of a mass of 1, n_modes), `levels` (n_modes, n_places), and the modal
/// mass `mass` [kg] at a level of 1; `beyond` is the pole of the modes that are added.
///
/// ```
/// use ergon_engine::generator::modal_body;
///
/// let body = modal_body(0.25, &[(4e4, 3.0)], &[vec![1.0]], (1e10, 9.0))?;
/// assert_eq!((body.masses, body.stiffness, body.damping), (vec![0.25], vec![1e4], vec![0.75]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// No mode or too many, no place or too many, or a place that no mode moves.
pub fn modal_body(
    mass: f64,
    poles: &[(f64, f64)],
    levels: &[Vec<f64>],
    beyond: (f64, f64),
) -> Result<ModalBody, GeneratorError> {
    count("The number of modes", poles.len(), 1, MAX_MODAL)?;
    let places = levels.first().map_or(0, Vec::len);
    count("The number of places", places, 1, MAX_PLACES)?;
    for place in 0..places {
        let level_sum: f64 = levels.iter().map(|row| row[place] * row[place]).sum();
        if !(level_sum > 0.0 && level_sum.is_finite()) {
            return Err(GeneratorError::Still { place });
        }
    }
    let more = added(levels);
    let mut shapes: Vec<Vec<f64>> = levels.to_vec();
    shapes.extend(more.iter().cloned());
    let mut poles = poles.to_vec();
    poles.resize(shapes.len(), beyond);
    let n = shapes.len();
    // Coordinates x = Hᵀ q, of which the first are those of the places.
    let mut basis: Vec<Vec<f64>> = (0..places)
        .map(|place| shapes.iter().map(|row| row[place]).collect())
        .collect();
    let size: Vec<f64> = basis
        .iter()
        .map(|level_sum| sqrt(dot(level_sum, level_sum)))
        .collect();
    let mut stiffness = diagonal(poles.iter().map(|pole| pole.0), n);
    let mut damping = diagonal(poles.iter().map(|pole| pole.1), n);
    for step in 0..places {
        interrupt::poll();
        let Some(mirror) = mirror(&basis[step], step) else {
            continue;
        };
        for level_sum in &mut basis[step..] {
            reflect(level_sum, &mirror);
        }
        reflect_both(&mut stiffness, &mirror);
        reflect_both(&mut damping, &mirror);
    }
    let inside = mass / (size[0] * size[0]);
    let mut masses: Vec<f64> = size.iter().map(|size| mass / (size * size)).collect();
    masses.resize(n, inside);
    let root: Vec<f64> = masses.iter().map(|mass| sqrt(*mass)).collect();
    for matrix in [&mut stiffness, &mut damping] {
        for (i, row) in matrix.chunks_exact_mut(n).enumerate() {
            for (value, other) in row.iter_mut().zip(&root) {
                *value *= root[i] * other;
            }
        }
    }
    Ok(ModalBody {
        masses,
        stiffness,
        damping,
    })
}

/// Levels of additional modes, each at all places: with them, places move independently at the first instant.
///
/// With G = Σ φφᵀ of the known modes, they are the columns of L in E = L·Lᵀ, where G + E is diagonal. Each place gains
/// as much on the diagonal as it has in common with the others.
fn added(levels: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n = levels.first().map_or(0, Vec::len);
    let inner = |p: usize, q: usize| -> f64 { levels.iter().map(|row| row[p] * row[q]).sum() };
    let norms: Vec<f64> = (0..n).map(|p| sqrt(inner(p, p))).collect();
    // In units of the mobility of each place.
    let mut rest = vec![0.0; n * n];
    for p in 0..n {
        for q in (0..n).filter(|&q| q != p) {
            let common = inner(p, q) / (norms[p] * norms[q]);
            rest[p * n + q] = -common;
            rest[p * n + p] += common.abs();
        }
    }
    // Cholesky; pivots that are only rounding errors are skipped.
    let mut modes = Vec::new();
    for pivot_index in 0..n {
        let pivot = rest[pivot_index * n + pivot_index];
        if pivot <= PIVOT_MIN {
            continue;
        }
        let root = sqrt(pivot);
        let column: Vec<f64> = (0..n)
            .map(|row| rest[row * n + pivot_index] / root)
            .collect();
        for (row, a) in column.iter().enumerate() {
            for (other, b) in column.iter().enumerate() {
                rest[row * n + other] -= a * b;
            }
        }
        for done in 0..n {
            rest[pivot_index * n + done] = 0.0;
            rest[done * n + pivot_index] = 0.0;
        }
        modes.push(
            column
                .iter()
                .zip(&norms)
                .map(|(a, norms)| a * norms)
                .collect(),
        );
    }
    modes
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn diagonal(values: impl Iterator<Item = f64>, n: usize) -> Vec<f64> {
    let mut matrix = vec![0.0; n * n];
    for (i, value) in values.enumerate() {
        matrix[i * n + i] = value;
    }
    matrix
}

/// v of the reflection 1 - v·vᵀ that takes `vector` to a positive multiple of axis `first` and leaves the axes before it
/// alone.
fn mirror(vector: &[f64], first: usize) -> Option<Vec<f64>> {
    let mut v: Vec<f64> = vector.to_vec();
    v[..first].fill(0.0);
    let beyond = dot(&v[first + 1..], &v[first + 1..]);
    if beyond == 0.0 && v[first] >= 0.0 {
        return None;
    }
    let size = sqrt(v[first] * v[first] + beyond);
    // own - |own|·axis, without a difference of nearly equal numbers.
    v[first] = if v[first] > 0.0 {
        -beyond / (v[first] + size)
    } else {
        v[first] - size
    };
    let scale = sqrt(2.0 / dot(&v, &v));
    v.iter_mut().for_each(|value| *value *= scale);
    Some(v)
}

fn reflect(vector: &mut [f64], mirror: &[f64]) {
    let along = dot(vector, mirror);
    for (value, m) in vector.iter_mut().zip(mirror) {
        *value -= along * m;
    }
}

/// H·A·H of a symmetric A, exactly symmetric.
fn reflect_both(matrix: &mut [f64], mirror: &[f64]) {
    let n = mirror.len();
    let image: Vec<f64> = matrix.chunks_exact(n).map(|row| dot(row, mirror)).collect();
    let half = 0.5 * dot(&image, mirror);
    let turn: Vec<f64> = image
        .iter()
        .zip(mirror)
        .map(|(a, m)| a - half * m)
        .collect();
    for i in 0..n {
        for j in i..n {
            let value = matrix[i * n + j] - mirror[i] * turn[j] - turn[i] * mirror[j];
            matrix[i * n + j] = value;
            matrix[j * n + i] = value;
        }
    }
}
