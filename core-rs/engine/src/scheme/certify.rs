//! The stability certificate of the CA scheme: λmax(M⁻¹(K + 2Z)) < 4.
//!
//! CA with backward damping is leapfrog with mass M − Z/2, so the number of unstable roots is the number of negative
//! eigenvalues of 4M − K − 2Z. Every contact counts as closed, every law by its slope at rest. A certificate of a
//! network with such links is `Guarded`; without them it is `Proved`.
//!
//! Other methods need other multiples of Z and other bounds: `largest_eigenvalue` finds λmax(M⁻¹(K + c·Z)).

use std::collections::HashSet;

use nalgebra::DMatrix;

use super::{LinkRun, LinkRunKind, Scheme};
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
pub enum BoundMethod {
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
    pub bound_method: BoundMethod,
    /// What the certificate guarantees.
    pub guarantee: StabilityGuarantee,
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
fn weighted_stiffness(run: &LinkRun, c: f64) -> f64 {
    match &run.kind {
        LinkRunKind::Ref | LinkRunKind::Hardening(_) => run.k + c * run.z,
        LinkRunKind::Dry { .. } => 0.0, // solved implicitly: it stops a motion, but never reverses it
        // The stiffness of a link in space along its line. Across the line it is less stiff: its matrix is K·nnᵀ +
        // (f/ℓ)(1 − nnᵀ), with f/ℓ ≤ K. So springs with this stiffness along all axes are an upper bound in any
        // position.
        LinkRunKind::Space(SpaceLink { law, .. }) => space_weight(law, run, c),
        LinkRunKind::Pairwise { pairs, .. } => space_weight(&pairs.link.law, run, c),
        LinkRunKind::But(but) if but.exponent == 1.0 => run.k + c * run.z,
        LinkRunKind::But(_) => c * run.z,
        LinkRunKind::Bristle { law, velocity_factor } => {
            run.k + c * law.with_stiffness_and_level(run.k, run.z).steepest_damping() * velocity_factor
        }
        LinkRunKind::Lnl {
            law, velocity_factor, ..
        } => law_weight(law, *velocity_factor, c),
        // The stiffest law that it can become: each constant at one end of its range.
        LinkRunKind::Followed {
            law: followed_law,
            velocity_factor,
            ..
        } => {
            let weights = followed_law
                .end_value_laws()
                .map(|law| law_weight(&law, *velocity_factor, c));
            weights.fold(0.0, |greatest, corner_weight| {
                if corner_weight > greatest || corner_weight.is_nan() {
                    corner_weight
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

fn space_weight(law: &SpaceLaw, run: &LinkRun, c: f64) -> f64 {
    match law {
        // An attraction is stiffest, along its line and across, if its two ends are at the same position.
        SpaceLaw::Spring | SpaceLaw::Yielding { .. } | SpaceLaw::Attraction { .. } | SpaceLaw::Lnl { .. } => {
            run.k + c * run.z
        }
        // While a contact pulls, it is softer than K along its line. It is softer across, too, as long as the depth at
        // which it rests is less than the distance of touch.
        SpaceLaw::Cohesive { exponent: 1.0, .. } | SpaceLaw::Contact { exponent: 1.0, .. } => run.k + c * run.z,
        SpaceLaw::Contact { .. } | SpaceLaw::Cohesive { .. } => c * run.z,
        SpaceLaw::Gauge => 0.0,
    }
}

/// The MATs of points in contacts between all pairs, axis by axis, each with an upper bound of the sum of K + c·Z of
/// the contacts on it.
fn pairwise_weights(run: &LinkRun, weight: f64) -> impl Iterator<Item = (usize, f64)> + '_ {
    let point_pairs = match &run.kind {
        LinkRunKind::Pairwise { pairs, .. } => Some(pairs),
        _ => None,
    };
    let point_count = run.len;
    let (first_start, second_start) = (run.a, run.b);
    point_pairs.into_iter().flat_map(move |point_pairs| {
        let [first_sum, second_sum] = point_pairs.neighbours(point_count).map(|n| n * weight);
        let first_count = if point_pairs.is_within { 0 } else { point_pairs.n_first };
        (0..point_pairs.link.n_axes).flat_map(move |axis| {
            let (first_start, second_start) = point_pairs.link.pair((first_start, second_start), axis);
            let first_weights = (first_start..first_start + first_count).map(move |mat| (mat, first_sum));
            first_weights.chain((second_start..second_start + point_count).map(move |mat| (mat, second_sum)))
        })
    })
}

/// Whether each link of a run always joins the same two MATs.
fn has_fixed_pairs(run: &LinkRun) -> bool {
    !matches!(run.kind, LinkRunKind::Pairwise { .. })
}

/// The stability limit of 4, reduced by the possible rounding error of an eigenvalue.
const STABILITY_LIMIT: f64 = 4.0 * (1.0 - 1e-14);
/// Up to this many MATs all eigenvalues are computed: this is exact at the limit, and just as quick.
const DENSE_MAX: usize = 200;

/// The largest eigenvalue of M⁻¹(K + c·Z), or an upper bound of it.
pub(crate) struct LargestEigenvalue {
    pub(crate) lambda: f64,
    pub(crate) bound_method: BoundMethod,
    /// The MAT with the largest amplitude in the mode of `lambda`; 0 if only sums were computed.
    pub(crate) worst_mat: usize,
}

/// λmax(M⁻¹(K + c·Z)): Gershgorin's bound if it is below `sufficient_bound`, else an eigenvalue. Fails if a force at
/// rest is not finite.
pub(crate) fn largest_eigenvalue(
    scheme: &Scheme,
    network: &Network,
    c: f64,
    sufficient_bound: f64,
) -> Result<LargestEigenvalue, Error> {
    largest_eigenvalue_up_to(scheme, network, c, sufficient_bound, f64::INFINITY)
}

/// Does the same as [`largest_eigenvalue`], but stops as soon as λmax is known to be at least `search_limit`.
pub(crate) fn largest_eigenvalue_up_to(
    scheme: &Scheme,
    network: &Network,
    c: f64,
    sufficient_bound: f64,
    search_limit: f64,
) -> Result<LargestEigenvalue, Error> {
    let weights: Vec<f64> = scheme.runs.iter().map(|run| weighted_stiffness(run, c)).collect();
    let lambda = gershgorin_bound(scheme, network, c, &weights)?;
    if lambda < sufficient_bound {
        return Ok(LargestEigenvalue {
            lambda,
            bound_method: BoundMethod::Gershgorin,
            worst_mat: 0,
        });
    }
    Ok(exact_largest_eigenvalue(scheme, network, c, &weights, search_limit))
}

/// Gershgorin's bound, from the sums D = Σ(K + c·Z) at both ends of each link.
fn gershgorin_bound(scheme: &Scheme, network: &Network, c: f64, weights: &[f64]) -> Result<f64, Error> {
    let weighted_runs = || scheme.runs.iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
    let mat_count = scheme.n_mat();
    let mut mat_sums: Vec<f64> = (0..mat_count)
        .map(|i| {
            if scheme.w[i] > 0.0 {
                (scheme.kappa[i] + c * scheme.zeta[i]) / scheme.w[i]
            } else {
                0.0
            }
        })
        .collect();
    // A body that resists bending has links with negative K; each counts by its absolute value.
    let joined_runs = || weighted_runs().filter(|(run, _)| has_fixed_pairs(run));
    let end_factor = proxy_factor(scheme);
    for (run, weight) in joined_runs() {
        for i in interrupt::steps(0..run.len) {
            for (a, b) in run.pairs(i) {
                let weight = weight.abs() * end_factor(a) * end_factor(b);
                mat_sums[a] += weight;
                mat_sums[b] += weight;
            }
        }
    }
    // (Σshare·x)² ≤ Σ|share|·Σ|share|·x², and no share of a moving proxy is above 1.
    let mut proxied_mats = Vec::new();
    for proxy in interrupt::polled_items(&scheme.proxies) {
        let proxy_sum = mat_sums[proxy.mat];
        if proxy.is_moving() {
            for mat in proxy.masses() {
                mat_sums[mat] += proxy_sum;
                proxied_mats.push(mat);
            }
        } else {
            proxy.for_each_share(
                |_| 0.0,
                |mat, share| {
                    mat_sums[mat] += proxy_sum * share.abs();
                    proxied_mats.push(mat);
                },
            );
        }
    }
    for (run, weight) in weighted_runs() {
        pairwise_weights(run, *weight).for_each(|(mat, sum)| mat_sums[mat] += sum);
    }
    if let Some(mat) = mat_sums.iter().position(|sum| !sum.is_finite()) {
        return Err(Error::Refused {
            module: network.mat_name(mat),
            message: "a force on it is not a finite number at rest".to_owned(),
        });
    }
    let weighted = |i: usize| mat_sums[i] * scheme.w[i];
    let edge_sums = joined_runs().flat_map(|(run, _)| {
        let run_pairs = interrupt::steps(0..run.len).flat_map(|i| run.pairs(i));
        run_pairs.map(|(a, b)| weighted(a) + weighted(b))
    });
    // Any two points of a pairwise run may touch.
    let pairwise = weighted_runs().flat_map(|(run, weight)| pairwise_weights(run, *weight));
    let pairwise = pairwise.map(|(mat, _)| 2.0 * weighted(mat));
    let end_pairs = joined_runs().flat_map(|(run, _)| (0..run.len).flat_map(|i| run.pairs(i)));
    let end_pairs = end_pairs.filter(|&(a, b)| scheme.is_proxy(a) || scheme.is_proxy(b));
    proxied_mats.extend(end_pairs.flat_map(|(a, b)| [a, b]));
    let proxied = proxied_mats.iter().map(|&mat| 2.0 * weighted(mat));
    Ok((0..mat_count)
        .map(weighted)
        .chain(edge_sums)
        .chain(pairwise)
        .chain(proxied)
        .fold(0.0, f64::max))
}

/// Factor for the weight of a link in the sum at each end: above 1 only at proxies with Σ|share| above 1.
fn proxy_factor(scheme: &Scheme) -> impl Fn(usize) -> f64 + '_ {
    |mat| {
        let mut proxies = interrupt::polled_items(&scheme.proxies);
        let proxy = proxies.find(|proxy| proxy.mat == mat);
        proxy.map_or(1.0, |proxy| proxy.share_sum_max().max(1.0))
    }
}

/// The largest eigenvalue of M^-½ (K + c·Z) M^-½, with proxies at their initial positions.
fn exact_largest_eigenvalue(
    scheme: &Scheme,
    network: &Network,
    c: f64,
    weights: &[f64],
    search_limit: f64,
) -> LargestEigenvalue {
    let mat_count = scheme.n_mat();
    let mut inverse_roots: Vec<f64> = scheme.w.iter().map(|w| w.sqrt()).collect();
    for proxy in &scheme.proxies {
        inverse_roots[proxy.mat] = 1.0; // a proxy has no mass: its forces are passed on unscaled
    }
    let start_position = |mat: usize| network.mats().x0[mat];
    let mut scaled_vector = vec![0.0; mat_count];
    let mut apply_matrix = |v: &[f64], y: &mut [f64]| {
        for i in 0..mat_count {
            scaled_vector[i] = v[i] * inverse_roots[i];
            y[i] = (scheme.kappa[i] + c * scheme.zeta[i]) * v[i];
        }
        for proxy in &scheme.proxies {
            scaled_vector[proxy.mat] = proxy.weighted_sum(start_position, |mat| scaled_vector[mat]);
        }
        for (run, weight) in scheme.runs.iter().zip(weights) {
            // The matrix of links between points that may touch is bounded by twice the sum at each point.
            pairwise_weights(run, *weight).for_each(|(mat, sum)| y[mat] += 2.0 * sum * scheme.w[mat] * v[mat]);
            for (a, b) in interrupt::steps(0..run.len)
                .filter(|_| has_fixed_pairs(run))
                .flat_map(|i| run.pairs(i))
            {
                let link_force = weight * (scaled_vector[b] - scaled_vector[a]);
                y[a] -= link_force * inverse_roots[a];
                y[b] += link_force * inverse_roots[b];
            }
        }
        for proxy in &scheme.proxies {
            let proxy_force = std::mem::take(&mut y[proxy.mat]);
            proxy.for_each_share(start_position, |mat, share| {
                y[mat] += share * proxy_force * inverse_roots[mat]
            });
        }
    };
    let largest_entry = |vector: &dyn Fn(usize) -> f64| {
        (0..mat_count)
            .max_by(|&i, &j| vector(i).abs().total_cmp(&vector(j).abs()))
            .unwrap_or(0)
    };
    if mat_count > DENSE_MAX {
        let largest = spectrum::largest_eigenvalue_up_to(mat_count, &mut apply_matrix, search_limit);
        return LargestEigenvalue {
            lambda: largest.theta + largest.residual,
            bound_method: BoundMethod::Lanczos,
            worst_mat: largest_entry(&|i| largest.vector[i]),
        };
    }
    let mut dense_matrix = DMatrix::zeros(mat_count, mat_count);
    let (mut unit_vector, mut matrix_column) = (vec![0.0; mat_count], vec![0.0; mat_count]);
    for i in 0..mat_count {
        unit_vector[i] = 1.0;
        apply_matrix(&unit_vector, &mut matrix_column);
        unit_vector[i] = 0.0;
        dense_matrix.column_mut(i).copy_from_slice(&matrix_column);
    }
    let eigensystem = dense_matrix.symmetric_eigen();
    let largest_index = eigensystem.eigenvalues.imax();
    LargestEigenvalue {
        lambda: eigensystem.eigenvalues[largest_index],
        bound_method: BoundMethod::Dense,
        worst_mat: largest_entry(&|i| eigensystem.eigenvectors[(i, largest_index)]),
    }
}

/// How much is computed for a scheme that is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RefusalDetail {
    /// The largest eigenvalue, and the module that would move most.
    Full,
    /// Only the fact that it is refused, which is much quicker for a large network.
    VerdictOnly,
}

/// The lowest multiple of the rate at which the scheme is stable. Springs need a factor of √(λmax/4), dampers of
/// λmax/4, and for CELs it depends on their poles at that rate; so multiples are tried.
fn lowest_stable_multiple(scheme: &Scheme, network: &Network, lambda: f64) -> u32 {
    const MULTIPLE_MAX: u32 = 1 << 20;
    let first_links: HashSet<usize> = scheme.runs.iter().map(|run| run.first_link).collect();
    let is_stable = |multiple: u32| {
        let Ok(finer_rate) = Rate::new(scheme.rate * f64::from(multiple)) else {
            return false;
        };
        Scheme::new(network, finer_rate).is_ok_and(|mut finer| {
            finer.runs.retain(|run| first_links.contains(&run.first_link));
            let largest_eigen = largest_eigenvalue_up_to(&finer, network, 2.0, STABILITY_LIMIT, STABILITY_LIMIT);
            largest_eigen.is_ok_and(|largest_eigen| largest_eigen.lambda < STABILITY_LIMIT)
        })
    };
    let mut high_multiple = oversampling(lambda);
    if is_stable(high_multiple) {
        return high_multiple;
    }
    let mut low_multiple = high_multiple;
    while high_multiple < MULTIPLE_MAX {
        high_multiple *= 2;
        if is_stable(high_multiple) {
            break;
        }
        low_multiple = high_multiple;
    }
    while high_multiple - low_multiple > 1 {
        let middle_multiple = low_multiple + (high_multiple - low_multiple) / 2;
        if is_stable(middle_multiple) {
            high_multiple = middle_multiple;
        } else {
            low_multiple = middle_multiple;
        }
    }
    high_multiple
}

/// Whether the scheme is stable without its damping.
pub(super) fn is_stable_undamped(scheme: &Scheme, network: &Network) -> bool {
    largest_eigenvalue_up_to(scheme, network, 0.0, STABILITY_LIMIT, STABILITY_LIMIT)
        .is_ok_and(|largest| largest.lambda < STABILITY_LIMIT)
}

pub(super) fn certify(scheme: &Scheme, network: &Network, refusal_detail: RefusalDetail) -> Result<Certificate, Error> {
    let guarantee = if scheme.is_linear {
        StabilityGuarantee::Proved
    } else {
        StabilityGuarantee::Guarded
    };
    let search_limit = match refusal_detail {
        RefusalDetail::Full => f64::INFINITY,
        RefusalDetail::VerdictOnly => STABILITY_LIMIT,
    };
    let largest_eigen = largest_eigenvalue_up_to(scheme, network, 2.0, STABILITY_LIMIT, search_limit)?;
    // The eigenvalue holds for the initial position of a proxy only.
    let has_moving_proxy = scheme.proxies.iter().any(Proxy::is_moving);
    let guarantee = match largest_eigen.bound_method {
        BoundMethod::Dense | BoundMethod::Lanczos if has_moving_proxy => StabilityGuarantee::Tried,
        _ => guarantee,
    };
    if largest_eigen.lambda < STABILITY_LIMIT {
        return Ok(Certificate {
            lambda_max: largest_eigen.lambda,
            bound_method: largest_eigen.bound_method,
            guarantee,
        });
    }
    Err(Error::Unstable {
        module: network.mat_name(largest_eigen.worst_mat),
        lambda: largest_eigen.lambda,
        oversampling: match refusal_detail {
            RefusalDetail::Full => lowest_stable_multiple(scheme, network, largest_eigen.lambda),
            RefusalDetail::VerdictOnly => oversampling(largest_eigen.lambda),
        },
    })
}
