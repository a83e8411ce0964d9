//! The stability certificate: λmax(M⁻¹(K + 2Z)) < 4.
//!
//! CA with backward damping is leapfrog with mass M − Z/2, so the number of unstable roots is the
//! number of negative eigenvalues of 4M − K − 2Z. Every contact is taken closed, every law at
//! its slope at rest; with such links the certificate guards, without them it proves.

use nalgebra::DMatrix;

use super::{Kind, Run, Scheme};
use crate::network::{Error, Network};
use crate::spectrum;

/// How sure a certificate is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Word {
    /// The scheme cannot diverge.
    Proved,
    /// Each state of the contacts is stable; a law may stiffen, which is watched at every step.
    Guarded,
}

/// How the largest eigenvalue was bounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Means {
    /// From the sums at the two ends of each link.
    Gershgorin,
    /// All eigenvalues of a small network.
    Dense,
    /// By Lanczos, with its residual.
    Lanczos,
}

/// A stability certificate.
#[derive(Clone, Copy, Debug)]
pub struct Certificate {
    /// Upper bound of λmax(M⁻¹(K + 2Z)).
    pub lambda_max: f64,
    /// How it was found.
    pub means: Means,
    /// What it is worth.
    pub word: Word,
}

impl Certificate {
    /// How many times the rate would have to be multiplied, ⌈√(λmax/4)⌉; 1 when stable.
    pub fn oversampling(&self) -> u32 {
        oversampling(self.lambda_max)
    }
}

fn oversampling(lambda: f64) -> u32 {
    (lambda / 4.0).sqrt().ceil().max(1.0) as u32
}

/// K + 2Z of one link at its stiffest known state.
fn weight(run: &Run) -> f64 {
    match &run.kind {
        Kind::Ref => run.k + 2.0 * run.z,
        Kind::But(but) if but.exponent == 1.0 => run.k + 2.0 * run.z,
        Kind::But(_) => 2.0 * run.z,
        Kind::Lnl { law, rate, .. } => {
            law.slope(0.0).max(0.0) + 2.0 * (law.damping_slope(0.0) * rate).max(0.0)
        }
    }
}

/// Below the exact border of 4 by what rounding may take from an eigenvalue.
const BORDER: f64 = 4.0 * (1.0 - 1e-14);
/// Up to this many MATs all eigenvalues are computed: exact at the border, and as quick.
const DENSE_MAX: usize = 200;

/// The largest eigenvalue, or an upper bound of it, and its vector (n_mat).
struct Top {
    lambda: f64,
    means: Means,
    vector: Vec<f64>,
}

/// The largest eigenvalue of M^-½ (K + 2Z) M^-½.
fn top(scheme: &Scheme, weights: &[f64]) -> Top {
    let n = scheme.n_mat();
    let root: Vec<f64> = scheme.w.iter().map(|w| w.sqrt()).collect();
    let mut scaled = vec![0.0; n];
    let mut apply = |v: &[f64], y: &mut [f64]| {
        for i in 0..n {
            scaled[i] = v[i] * root[i];
            y[i] = (scheme.kappa[i] + 2.0 * scheme.zeta[i]) * v[i];
        }
        for (run, weight) in scheme.runs.iter().zip(weights) {
            for i in 0..run.len {
                let (a, b) = (run.a + i, run.b + i);
                let f = weight * (scaled[b] - scaled[a]);
                y[a] -= f * root[a];
                y[b] += f * root[b];
            }
        }
    };
    if n > DENSE_MAX {
        let largest = spectrum::largest(n, &mut apply);
        return Top {
            lambda: largest.theta + largest.residual,
            means: Means::Lanczos,
            vector: largest.vector,
        };
    }
    let mut matrix = DMatrix::zeros(n, n);
    let (mut unit, mut column) = (vec![0.0; n], vec![0.0; n]);
    for i in 0..n {
        unit[i] = 1.0;
        apply(&unit, &mut column);
        unit[i] = 0.0;
        matrix.column_mut(i).copy_from_slice(&column);
    }
    let eigen = matrix.symmetric_eigen();
    let at = eigen.eigenvalues.imax();
    Top {
        lambda: eigen.eigenvalues[at],
        means: Means::Dense,
        vector: eigen.eigenvectors.column(at).iter().copied().collect(),
    }
}

pub(super) fn certify(scheme: &Scheme, network: &Network) -> Result<Certificate, Error> {
    let word = if scheme.linear {
        Word::Proved
    } else {
        Word::Guarded
    };
    let weights: Vec<f64> = scheme.runs.iter().map(weight).collect();
    let links = || {
        scheme
            .runs
            .iter()
            .zip(&weights)
            .filter(|(_, weight)| **weight != 0.0)
    };
    let n = scheme.n_mat();
    // Sums at each MAT: D = Σ(K + 2Z).
    let mut sums: Vec<f64> = (0..n)
        .map(|i| {
            if scheme.w[i] > 0.0 {
                (scheme.kappa[i] + 2.0 * scheme.zeta[i]) / scheme.w[i]
            } else {
                0.0
            }
        })
        .collect();
    for (run, weight) in links() {
        for i in 0..run.len {
            sums[run.a + i] += weight;
            sums[run.b + i] += weight;
        }
    }
    if let Some(mat) = sums.iter().position(|sum| !sum.is_finite()) {
        return Err(Error::Refused {
            module: network.mat_name(mat),
            message: "a force on it is not a finite number at rest".to_owned(),
        });
    }
    let at = |i: usize| sums[i] * scheme.w[i];
    let edges = links().flat_map(|(run, _)| (0..run.len).map(|i| at(run.a + i) + at(run.b + i)));
    let bound = (0..n).map(at).chain(edges).fold(0.0, f64::max);
    if bound < BORDER {
        return Ok(Certificate {
            lambda_max: bound,
            means: Means::Gershgorin,
            word,
        });
    }
    let top = top(scheme, &weights);
    if top.lambda < BORDER {
        return Ok(Certificate {
            lambda_max: top.lambda,
            means: top.means,
            word,
        });
    }
    let worst = (0..n)
        .max_by(|&i, &j| top.vector[i].abs().total_cmp(&top.vector[j].abs()))
        .unwrap_or(0);
    Err(Error::Unstable {
        module: network.mat_name(worst),
        lambda: top.lambda,
        oversampling: oversampling(top.lambda),
    })
}
