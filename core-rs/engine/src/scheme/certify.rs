//! The stability certificate of the CA scheme: λmax(M⁻¹(K + 2Z)) < 4.
//!
//! CA with backward damping is leapfrog with mass M − Z/2, so the number of unstable roots is the
//! number of negative eigenvalues of 4M − K − 2Z. Every contact is taken closed, every law at
//! its slope at rest; with such links the certificate guards, without them it proves.
//!
//! Other methods ask for other multiples of Z and other bounds: `top` finds λmax(M⁻¹(K + c·Z)).

use std::collections::HashSet;

use nalgebra::DMatrix;

use super::{Kind, Run, Scheme};
use crate::law::Law;
use crate::network::{Error, Network, Proxy, SpaceLaw, SpaceLink};
use crate::spectrum;
use crate::units::Rate;

/// What a certificate guarantees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StabilityGuarantee {
    /// The scheme cannot diverge.
    Proved,
    /// Each state of the contacts is stable; a law may stiffen, which is watched at every step.
    Guarded,
    /// No proof: a condition that held in every case tried.
    Tried,
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
    /// Method of the bound.
    pub means: Means,
    /// What the certificate guarantees.
    pub word: StabilityGuarantee,
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

/// K + c·Z of one link at its stiffest known state.
fn weight(run: &Run, c: f64) -> f64 {
    match &run.kind {
        Kind::Ref | Kind::Hardening(_) => run.k + c * run.z,
        Kind::Dry { .. } => 0.0, // it takes no more than what moves
        // Along its line a link in space is as stiff as this, and less across: its matrix is K·nnᵀ + (f/ℓ)(1 − nnᵀ), with
        // f/ℓ ≤ K. So springs along all axes are stiffer than it is in any position.
        Kind::Space(SpaceLink { law, .. }) => space_weight(law, run, c),
        Kind::Pairwise { by, .. } => space_weight(&by.link.law, run, c),
        Kind::But(but) if but.exponent == 1.0 => run.k + c * run.z,
        Kind::But(_) => c * run.z,
        Kind::Bristle { by, rate } => run.k + c * by.with(run.k, run.z).steepest_damping() * rate,
        Kind::Lnl { law, rate, .. } => law_weight(law, *rate, c),
        // The stiffest of the laws that it may become where each constant is at one of its ends.
        Kind::Followed { by, rate, .. } => {
            let weights = by.corners().map(|law| law_weight(&law, *rate, c));
            weights.fold(0.0, |most, own| {
                if own > most || own.is_nan() {
                    own
                } else {
                    most
                }
            })
        }
    }
}

fn law_weight(law: &Law, rate: f64, c: f64) -> f64 {
    law.slope(0.0).max(0.0) + c * (law.damping_slope(0.0) * rate).max(0.0)
}

fn space_weight(law: &SpaceLaw, run: &Run, c: f64) -> f64 {
    match law {
        // An attraction is stiffest where its ends are at one place, along it and across.
        SpaceLaw::Spring
        | SpaceLaw::Yielding { .. }
        | SpaceLaw::Attraction { .. }
        | SpaceLaw::Lnl { .. }
        // Where a contact pulls it is softer than K along its line, and across it as long as it sinks in by less than a gap.
        | SpaceLaw::Cohesive { exponent: 1.0, .. }
        | SpaceLaw::Contact { exponent: 1.0, .. } => run.k + c * run.z,
        SpaceLaw::Contact { .. } | SpaceLaw::Cohesive { .. } => c * run.z,
        SpaceLaw::Gauge => 0.0,
    }
}

/// The coordinates of points that meet in all pairs, each with the sum of K + c·Z of the contacts on it, at most.
fn crowded(run: &Run, weight: f64) -> impl Iterator<Item = (usize, f64)> + '_ {
    let pairs = match &run.kind {
        Kind::Pairwise { by, .. } => Some(by),
        _ => None,
    };
    let len = run.len;
    let (a, b) = (run.a, run.b);
    pairs.into_iter().flat_map(move |pairs| {
        let [first, second] = pairs.neighbours(len).map(|n| n * weight);
        let n_first = if pairs.is_within { 0 } else { pairs.n_first };
        (0..pairs.link.n_axes).flat_map(move |axis| {
            let (a, b) = pairs.link.pair((a, b), axis);
            let first = (a..a + n_first).map(move |mat| (mat, first));
            first.chain((b..b + len).map(move |mat| (mat, second)))
        })
    })
}

/// Whether each link of a run joins two MATs, for good.
fn joins(run: &Run) -> bool {
    !matches!(run.kind, Kind::Pairwise { .. })
}

/// Below the exact border of 4 by what rounding may take from an eigenvalue.
const BORDER: f64 = 4.0 * (1.0 - 1e-14);
/// Up to this many MATs all eigenvalues are computed: exact at the border, and as quick.
const DENSE_MAX: usize = 200;

/// The largest eigenvalue of M⁻¹(K + c·Z), or an upper bound of it.
pub(crate) struct Top {
    pub(crate) lambda: f64,
    pub(crate) means: Means,
    /// The MAT that moves most in its mode; 0 where only sums were taken.
    pub(crate) worst: usize,
}

/// λmax(M⁻¹(K + c·Z)): by the sums at the ends of each link where these stay below `enough`, else by
/// an eigenvalue. Fails where a force at rest is not finite.
pub(crate) fn top(scheme: &Scheme, network: &Network, c: f64, enough: f64) -> Result<Top, Error> {
    top_up_to(scheme, network, c, enough, f64::INFINITY)
}

/// The same; where λmax is at least `beyond` no more is found than that it is.
pub(crate) fn top_up_to(
    scheme: &Scheme,
    network: &Network,
    c: f64,
    enough: f64,
    beyond: f64,
) -> Result<Top, Error> {
    let weights: Vec<f64> = scheme.runs.iter().map(|run| weight(run, c)).collect();
    let lambda = by_sums(scheme, network, c, &weights)?;
    if lambda < enough {
        return Ok(Top {
            lambda,
            means: Means::Gershgorin,
            worst: 0,
        });
    }
    Ok(by_eigenvalue(scheme, network, c, &weights, beyond))
}

/// Gershgorin's bound, from the sums D = Σ(K + c·Z) at both ends of each link.
fn by_sums(scheme: &Scheme, network: &Network, c: f64, weights: &[f64]) -> Result<f64, Error> {
    let links = || {
        scheme
            .runs
            .iter()
            .zip(weights)
            .filter(|(_, weight)| **weight != 0.0)
    };
    let n = scheme.n_mat();
    let mut sums: Vec<f64> = (0..n)
        .map(|i| {
            if scheme.w[i] > 0.0 {
                (scheme.kappa[i] + c * scheme.zeta[i]) / scheme.w[i]
            } else {
                0.0
            }
        })
        .collect();
    // A body that resists bending has negative links; each counts as if it were positive.
    let joined = || links().filter(|(run, _)| joins(run));
    let reach = reach(scheme);
    for (run, weight) in joined() {
        for i in 0..run.len {
            for (a, b) in run.pairs(i) {
                let weight = weight.abs() * reach(a) * reach(b);
                sums[a] += weight;
                sums[b] += weight;
            }
        }
    }
    // (Σshare·x)² ≤ Σ|share|·Σ|share|·x², and no share of one that moves is above 1.
    let mut met = Vec::new();
    for proxy in &scheme.proxies {
        let own = sums[proxy.mat];
        if proxy.is_moving() {
            for mat in proxy.masses() {
                sums[mat] += own;
                met.push(mat);
            }
        } else {
            proxy.each(
                |_| 0.0,
                |mat, share| {
                    sums[mat] += own * share.abs();
                    met.push(mat);
                },
            );
        }
    }
    for (run, weight) in links() {
        crowded(run, *weight).for_each(|(mat, sum)| sums[mat] += sum);
    }
    if let Some(mat) = sums.iter().position(|sum| !sum.is_finite()) {
        return Err(Error::Refused {
            module: network.mat_name(mat),
            message: "a force on it is not a finite number at rest".to_owned(),
        });
    }
    let at = |i: usize| sums[i] * scheme.w[i];
    let edges = joined().flat_map(|(run, _)| {
        let pairs = (0..run.len).flat_map(|i| run.pairs(i));
        pairs.map(|(a, b)| at(a) + at(b))
    });
    // Any two points of a crowd may meet.
    let crowds = links().flat_map(|(run, weight)| crowded(run, *weight));
    let crowds = crowds.map(|(mat, _)| 2.0 * at(mat));
    let ends = joined().flat_map(|(run, _)| (0..run.len).flat_map(|i| run.pairs(i)));
    let ends = ends.filter(|&(a, b)| scheme.is_proxy(a) || scheme.is_proxy(b));
    met.extend(ends.flat_map(|(a, b)| [a, b]));
    let proxied = met.iter().map(|&mat| 2.0 * at(mat));
    Ok((0..n)
        .map(at)
        .chain(edges)
        .chain(crowds)
        .chain(proxied)
        .fold(0.0, f64::max))
}

/// How many times its own weight a link has in the sums at its ends, for each end: more than once only at proxies whose
/// shares add up to more than 1.
fn reach(scheme: &Scheme) -> impl Fn(usize) -> f64 + '_ {
    |mat| {
        let mut proxies = scheme.proxies.iter();
        let proxy = proxies.find(|proxy| proxy.mat == mat);
        proxy.map_or(1.0, |proxy| proxy.reach().max(1.0))
    }
}

/// The largest eigenvalue of M^-½ (K + c·Z) M^-½, proxies where they begin.
fn by_eigenvalue(scheme: &Scheme, network: &Network, c: f64, weights: &[f64], beyond: f64) -> Top {
    let n = scheme.n_mat();
    let mut root: Vec<f64> = scheme.w.iter().map(|w| w.sqrt()).collect();
    for proxy in &scheme.proxies {
        root[proxy.mat] = 1.0; // its forces are passed on whole
    }
    let begin = |mat: usize| network.mats().x0[mat];
    let mut scaled = vec![0.0; n];
    let mut apply = |v: &[f64], y: &mut [f64]| {
        for i in 0..n {
            scaled[i] = v[i] * root[i];
            y[i] = (scheme.kappa[i] + c * scheme.zeta[i]) * v[i];
        }
        for proxy in &scheme.proxies {
            scaled[proxy.mat] = proxy.sum(begin, |mat| scaled[mat]);
        }
        for (run, weight) in scheme.runs.iter().zip(weights) {
            // Links between whatever meets are no more than twice their sums.
            crowded(run, *weight)
                .for_each(|(mat, sum)| y[mat] += 2.0 * sum * scheme.w[mat] * v[mat]);
            for (a, b) in (0..run.len)
                .filter(|_| joins(run))
                .flat_map(|i| run.pairs(i))
            {
                let f = weight * (scaled[b] - scaled[a]);
                y[a] -= f * root[a];
                y[b] += f * root[b];
            }
        }
        for proxy in &scheme.proxies {
            let pull = std::mem::take(&mut y[proxy.mat]);
            proxy.each(begin, |mat, share| y[mat] += share * pull * root[mat]);
        }
    };
    let worst = |vector: &dyn Fn(usize) -> f64| {
        (0..n)
            .max_by(|&i, &j| vector(i).abs().total_cmp(&vector(j).abs()))
            .unwrap_or(0)
    };
    if n > DENSE_MAX {
        let largest = spectrum::largest_up_to(n, &mut apply, beyond);
        return Top {
            lambda: largest.theta + largest.residual,
            means: Means::Lanczos,
            worst: worst(&|i| largest.vector[i]),
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
        worst: worst(&|i| eigen.eigenvectors[(i, at)]),
    }
}

/// How much is found out of a scheme that is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// How far it is from stable, and the module that would move most.
    Explained,
    /// Only that it is refused, which is much quicker for a large network.
    Bare,
}

/// How many times the rate is stable: springs ask for the root of λmax/4, dampers for λmax/4 itself, and cells for what
/// their poles are there.
fn helping(scheme: &Scheme, network: &Network, lambda: f64) -> u32 {
    const MOST: u32 = 1 << 20;
    let own: HashSet<usize> = scheme.runs.iter().map(|run| run.first).collect();
    let is_stable = |times: u32| {
        let Ok(rate) = Rate::new(scheme.rate * f64::from(times)) else {
            return false;
        };
        Scheme::new(network, rate).is_ok_and(|mut finer| {
            finer.runs.retain(|run| own.contains(&run.first));
            let top = top_up_to(&finer, network, 2.0, BORDER, BORDER);
            top.is_ok_and(|top| top.lambda < BORDER)
        })
    };
    let mut high = oversampling(lambda);
    if is_stable(high) {
        return high;
    }
    let mut low = high;
    while high < MOST {
        high *= 2;
        if is_stable(high) {
            break;
        }
        low = high;
    }
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if is_stable(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

/// Whether the scheme is stable without its damping.
pub(super) fn bears_springs(scheme: &Scheme, network: &Network) -> bool {
    top_up_to(scheme, network, 0.0, BORDER, BORDER).is_ok_and(|top| top.lambda < BORDER)
}

pub(super) fn certify(
    scheme: &Scheme,
    network: &Network,
    refusal: Refusal,
) -> Result<Certificate, Error> {
    let word = if scheme.linear {
        StabilityGuarantee::Proved
    } else {
        StabilityGuarantee::Guarded
    };
    let beyond = match refusal {
        Refusal::Explained => f64::INFINITY,
        Refusal::Bare => BORDER,
    };
    let top = top_up_to(scheme, network, 2.0, BORDER, beyond)?;
    // An eigenvalue is that of the place where a proxy begins.
    let moves = scheme.proxies.iter().any(Proxy::is_moving);
    let word = match top.means {
        Means::Dense | Means::Lanczos if moves => StabilityGuarantee::Tried,
        _ => word,
    };
    if top.lambda < BORDER {
        return Ok(Certificate {
            lambda_max: top.lambda,
            means: top.means,
            word,
        });
    }
    Err(Error::Unstable {
        module: network.mat_name(top.worst),
        lambda: top.lambda,
        oversampling: match refusal {
            Refusal::Explained => helping(scheme, network, top.lambda),
            Refusal::Bare => oversampling(top.lambda),
        },
    })
}
