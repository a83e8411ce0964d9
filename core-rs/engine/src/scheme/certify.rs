//! The stability certificate of the CA scheme: λmax(M⁻¹(K + 2Z)) < 4.
//!
//! CA with backward damping is leapfrog with mass M − Z/2, so the number of unstable roots is the number of negative
//! eigenvalues of 4M − K − 2Z. Every contact counts as closed, every law by its slope at rest. A certificate of a
//! network with such links is `Guarded`; without them it is `Proved`.
//!
//! Other methods need other multiples of Z and other bounds: `top` finds λmax(M⁻¹(K + c·Z)).

use std::collections::HashSet;

use nalgebra::DMatrix;

use super::{Kind, Run, Scheme};
use crate::interrupt;
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
    /// Upper bound of λmax(M⁻¹(K + c·Z)); c = 2 for CA.
    pub lambda_max: f64,
    /// Method of the bound.
    pub means: Means,
    /// What the certificate guarantees.
    pub word: StabilityGuarantee,
}

impl Certificate {
    /// Factor by which the rate must be multiplied for CA to be stable, ⌈√(λmax/4)⌉; 1 if it is stable.
    pub fn oversampling(&self) -> u32 {
        oversampling(self.lambda_max)
    }
}

fn oversampling(lambda: f64) -> u32 {
    (lambda / 4.0).sqrt().ceil().max(1.0) as u32
}

/// K + c·Z of one link in its stiffest known state.
fn weight(run: &Run, c: f64) -> f64 {
    match &run.kind {
        Kind::Ref | Kind::Hardening(_) => run.k + c * run.z,
        Kind::Dry { .. } => 0.0, // solved implicitly: it stops a motion, but never reverses it
        // The stiffness of a link in space along its line. Across the line it is less stiff: its matrix is K·nnᵀ +
        // (f/ℓ)(1 − nnᵀ), with f/ℓ ≤ K. So springs with this stiffness along all axes are an upper bound in any
        // position.
        Kind::Space(SpaceLink { law, .. }) => space_weight(law, run, c),
        Kind::Pairwise { by, .. } => space_weight(&by.link.law, run, c),
        Kind::But(but) if but.exponent == 1.0 => run.k + c * run.z,
        Kind::But(_) => c * run.z,
        Kind::Bristle { by, rate } => run.k + c * by.with(run.k, run.z).steepest_damping() * rate,
        Kind::Lnl { law, rate, .. } => law_weight(law, *rate, c),
        // The stiffest law that it can become: each constant at one end of its range.
        Kind::Followed { by, rate, .. } => {
            let weights = by.corners().map(|law| law_weight(&law, *rate, c));
            weights.fold(0.0, |greatest, weight_here| {
                if weight_here > greatest || weight_here.is_nan() {
                    weight_here
                } else {
                    greatest
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
        // An attraction is stiffest, along its line and across, if its two ends are at the same position.
        SpaceLaw::Spring
        | SpaceLaw::Yielding { .. }
        | SpaceLaw::Attraction { .. }
        | SpaceLaw::Lnl { .. }
        // While a contact pulls, it is softer than K along its line. It is softer across, too, as long as the depth at
        // which it rests is less than the distance of touch.
        | SpaceLaw::Cohesive { exponent: 1.0, .. }
        | SpaceLaw::Contact { exponent: 1.0, .. } => run.k + c * run.z,
        SpaceLaw::Contact { .. } | SpaceLaw::Cohesive { .. } => c * run.z,
        SpaceLaw::Gauge => 0.0,
    }
}

/// The MATs of points in contacts between all pairs, axis by axis, each with an upper bound of the sum of K + c·Z of
/// the contacts on it.
fn pairwise_weights(run: &Run, weight: f64) -> impl Iterator<Item = (usize, f64)> + '_ {
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

/// Whether each link of a run always joins the same two MATs.
fn has_fixed_pairs(run: &Run) -> bool {
    !matches!(run.kind, Kind::Pairwise { .. })
}

/// The stability limit of 4, reduced by the possible rounding error of an eigenvalue.
const LIMIT: f64 = 4.0 * (1.0 - 1e-14);
/// Up to this many MATs all eigenvalues are computed: this is exact at the limit, and just as quick.
const DENSE_MAX: usize = 200;

/// The largest eigenvalue of M⁻¹(K + c·Z), or an upper bound of it.
pub(crate) struct LargestEigenvalue {
    pub(crate) lambda: f64,
    pub(crate) means: Means,
    /// The MAT with the largest amplitude in the mode of `lambda`; 0 if only sums were computed.
    pub(crate) worst: usize,
}

/// λmax(M⁻¹(K + c·Z)): Gershgorin's bound if it is below `enough`, else an eigenvalue. Fails if a force at rest is not
/// finite.
pub(crate) fn top(
    scheme: &Scheme,
    network: &Network,
    c: f64,
    enough: f64,
) -> Result<LargestEigenvalue, Error> {
    top_up_to(scheme, network, c, enough, f64::INFINITY)
}

/// Does the same as [`top`], but stops as soon as λmax is known to be at least `beyond`.
pub(crate) fn top_up_to(
    scheme: &Scheme,
    network: &Network,
    c: f64,
    enough: f64,
    beyond: f64,
) -> Result<LargestEigenvalue, Error> {
    let weights: Vec<f64> = scheme.runs.iter().map(|run| weight(run, c)).collect();
    let lambda = by_sums(scheme, network, c, &weights)?;
    if lambda < enough {
        return Ok(LargestEigenvalue {
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
    // A body that resists bending has links with negative K; each counts by its absolute value.
    let joined = || links().filter(|(run, _)| has_fixed_pairs(run));
    let factor = proxy_factor(scheme);
    for (run, weight) in joined() {
        for i in interrupt::steps(0..run.len) {
            for (a, b) in run.pairs(i) {
                let weight = weight.abs() * factor(a) * factor(b);
                sums[a] += weight;
                sums[b] += weight;
            }
        }
    }
    // (Σshare·x)² ≤ Σ|share|·Σ|share|·x², and no share of a moving proxy is above 1.
    let mut proxied_mats = Vec::new();
    for proxy in interrupt::each(&scheme.proxies) {
        let mat_sum = sums[proxy.mat];
        if proxy.is_moving() {
            for mat in proxy.masses() {
                sums[mat] += mat_sum;
                proxied_mats.push(mat);
            }
        } else {
            proxy.for_each_share(
                |_| 0.0,
                |mat, share| {
                    sums[mat] += mat_sum * share.abs();
                    proxied_mats.push(mat);
                },
            );
        }
    }
    for (run, weight) in links() {
        pairwise_weights(run, *weight).for_each(|(mat, sum)| sums[mat] += sum);
    }
    if let Some(mat) = sums.iter().position(|sum| !sum.is_finite()) {
        return Err(Error::Refused {
            module: network.mat_name(mat),
            message: "a force on it is not a finite number at rest".to_owned(),
        });
    }
    let weighted = |i: usize| sums[i] * scheme.w[i];
    let edges = joined().flat_map(|(run, _)| {
        let pairs = interrupt::steps(0..run.len).flat_map(|i| run.pairs(i));
        pairs.map(|(a, b)| weighted(a) + weighted(b))
    });
    // Any two points of a pairwise run may touch.
    let pairwise = links().flat_map(|(run, weight)| pairwise_weights(run, *weight));
    let pairwise = pairwise.map(|(mat, _)| 2.0 * weighted(mat));
    let ends = joined().flat_map(|(run, _)| (0..run.len).flat_map(|i| run.pairs(i)));
    let ends = ends.filter(|&(a, b)| scheme.is_proxy(a) || scheme.is_proxy(b));
    proxied_mats.extend(ends.flat_map(|(a, b)| [a, b]));
    let proxied = proxied_mats.iter().map(|&mat| 2.0 * weighted(mat));
    Ok((0..n)
        .map(weighted)
        .chain(edges)
        .chain(pairwise)
        .chain(proxied)
        .fold(0.0, f64::max))
}

/// Factor for the weight of a link in the sum at each end: above 1 only at proxies with Σ|share| above 1.
fn proxy_factor(scheme: &Scheme) -> impl Fn(usize) -> f64 + '_ {
    |mat| {
        let mut proxies = interrupt::each(&scheme.proxies);
        let proxy = proxies.find(|proxy| proxy.mat == mat);
        proxy.map_or(1.0, |proxy| proxy.share_sum_max().max(1.0))
    }
}

/// The largest eigenvalue of M^-½ (K + c·Z) M^-½, with proxies at their initial positions.
fn by_eigenvalue(
    scheme: &Scheme,
    network: &Network,
    c: f64,
    weights: &[f64],
    beyond: f64,
) -> LargestEigenvalue {
    let n = scheme.n_mat();
    let mut root: Vec<f64> = scheme.w.iter().map(|w| w.sqrt()).collect();
    for proxy in &scheme.proxies {
        root[proxy.mat] = 1.0; // a proxy has no mass: its forces are passed on unscaled
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
            // The matrix of links between points that may touch is bounded by twice the sum at each point.
            pairwise_weights(run, *weight)
                .for_each(|(mat, sum)| y[mat] += 2.0 * sum * scheme.w[mat] * v[mat]);
            for (a, b) in interrupt::steps(0..run.len)
                .filter(|_| has_fixed_pairs(run))
                .flat_map(|i| run.pairs(i))
            {
                let f = weight * (scaled[b] - scaled[a]);
                y[a] -= f * root[a];
                y[b] += f * root[b];
            }
        }
        for proxy in &scheme.proxies {
            let pull = std::mem::take(&mut y[proxy.mat]);
            proxy.for_each_share(begin, |mat, share| y[mat] += share * pull * root[mat]);
        }
    };
    let worst = |vector: &dyn Fn(usize) -> f64| {
        (0..n)
            .max_by(|&i, &j| vector(i).abs().total_cmp(&vector(j).abs()))
            .unwrap_or(0)
    };
    if n > DENSE_MAX {
        let largest = spectrum::largest_up_to(n, &mut apply, beyond);
        return LargestEigenvalue {
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
    let index = eigen.eigenvalues.imax();
    LargestEigenvalue {
        lambda: eigen.eigenvalues[index],
        means: Means::Dense,
        worst: worst(&|i| eigen.eigenvectors[(i, index)]),
    }
}

/// How much is computed for a scheme that is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// The largest eigenvalue, and the module that would move most.
    Explained,
    /// Only the fact that it is refused, which is much quicker for a large network.
    Bare,
}

/// The lowest multiple of the rate at which the scheme is stable. Springs need a factor of √(λmax/4), dampers of
/// λmax/4, and for CELs it depends on their poles at that rate; so multiples are tried.
fn lowest_stable_multiple(scheme: &Scheme, network: &Network, lambda: f64) -> u32 {
    const MULTIPLE_MAX: u32 = 1 << 20;
    let first_links: HashSet<usize> = scheme.runs.iter().map(|run| run.first).collect();
    let is_stable = |times: u32| {
        let Ok(rate) = Rate::new(scheme.rate * f64::from(times)) else {
            return false;
        };
        Scheme::new(network, rate).is_ok_and(|mut finer| {
            finer.runs.retain(|run| first_links.contains(&run.first));
            let top = top_up_to(&finer, network, 2.0, LIMIT, LIMIT);
            top.is_ok_and(|top| top.lambda < LIMIT)
        })
    };
    let mut high = oversampling(lambda);
    if is_stable(high) {
        return high;
    }
    let mut low = high;
    while high < MULTIPLE_MAX {
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
    top_up_to(scheme, network, 0.0, LIMIT, LIMIT).is_ok_and(|top| top.lambda < LIMIT)
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
        Refusal::Bare => LIMIT,
    };
    let top = top_up_to(scheme, network, 2.0, LIMIT, beyond)?;
    // The eigenvalue holds for the initial position of a proxy only.
    let moves = scheme.proxies.iter().any(Proxy::is_moving);
    let word = match top.means {
        Means::Dense | Means::Lanczos if moves => StabilityGuarantee::Tried,
        _ => word,
    };
    if top.lambda < LIMIT {
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
            Refusal::Explained => lowest_stable_multiple(scheme, network, top.lambda),
            Refusal::Bare => oversampling(top.lambda),
        },
    })
}
