//! Stability certificates of each method, before the first frame; that of CA is computed by `scheme::certify`.
//!
//! | method | condition on undamped bodies, at rest   | linear             | non-linear links   |
//! |--------|-----------------------------------------|--------------------|--------------------|
//! | CA     | λmax(M⁻¹(K + 2Z)) < 4                   | proved             | guarded            |
//! | CA2P   | λmax(M⁻¹K) < 12, with Z M⁻¹(K + 6Z) < 6 | proved             | guarded            |
//! | CA2P   | λmax(M⁻¹(K + 6Z)) < 12                  | tried              | tried              |
//! | BM4    | λmax(M⁻¹(K + 2Z)) < 3.164²              | tried              | tried              |
//! | IEQ    | none                                    | proved             | guarded            |
//!
//! BM4's kicks among losses are stable for κ < 3.164² with ζ < 7.5 mode by mode, which K + 2Z keeps well.
//! CA2P's 12 is exact mode by mode (κ + 6ζ < 12). Where Z has other modes than K it is not safe; 6 is taken
//! then, below the smallest unstable case (6.04) that a search for such cases found.

use super::mesh::Mesh;
use super::method::{BM4_LIMIT, MeshMethod};
use super::{ieq, substep_rate};
use crate::guard::StabilityLimit;
use crate::network::{Error, Network};
use crate::scheme::{
    Certificate, LargestEigenvalue, RefusalDetail, Scheme, StabilityGuarantee, largest_eigenvalue_up_to,
};
use crate::units::Rate;

/// Factor on a limit that allows for the rounding error of an eigenvalue.
const ROUNDING: f64 = 1.0 - 1e-14;
/// CA2P: largest λ if K and Z share their modes.
const LAMBDA_MAX_SHARED: f64 = 12.0 * ROUNDING;
/// CA2P: largest λ for any modes.
const LAMBDA_MAX_ANY: f64 = 6.0 * ROUNDING;
/// BM4: the weight c of Z in λmax(M⁻¹(K + c·Z)).
const LOSS_WEIGHT: f64 = 2.0;

/// Certify that a method steps a network stably.
///
/// # Errors
/// If the network is unstable: names the module that would move most.
pub(crate) fn certify(network: &Network, rate: Rate, method: MeshMethod, substeps: u32) -> Result<Certificate, Error> {
    let rate = substep_rate(rate, substeps)?;
    if method == MeshMethod::Ca {
        return Scheme::new(network, rate)?.certify_with_detail(network, RefusalDetail::VerdictOnly);
    }
    let network_mesh = Mesh::new(network, rate, method)?;
    let mesh_scheme = &network_mesh.scheme;
    let largest_lambda = |loss_weight: f64, proved_lambda: f64, lambda_limit: f64| {
        largest_eigenvalue_up_to(mesh_scheme, network, loss_weight, proved_lambda, lambda_limit)
    };
    let certificate = |largest: &LargestEigenvalue, guarantee: StabilityGuarantee| Certificate {
        lambda_max: largest.lambda,
        bound_method: largest.bound_method,
        guarantee,
    };
    let guarantee = if mesh_scheme.is_linear {
        StabilityGuarantee::Proved
    } else {
        StabilityGuarantee::Guarded
    };
    match method {
        MeshMethod::Ca2p => {
            let (loss_weight, proved_lambda) = ca2p_bound(&network_mesh);
            let largest_value = largest_lambda(loss_weight, proved_lambda, LAMBDA_MAX_SHARED)?;
            if largest_value.lambda < proved_lambda {
                Ok(certificate(&largest_value, guarantee))
            } else if largest_value.lambda < LAMBDA_MAX_SHARED {
                Ok(certificate(&largest_value, StabilityGuarantee::Tried))
            } else {
                Err(unstable_error(network, method, &largest_value, LAMBDA_MAX_SHARED))
            }
        }
        MeshMethod::Bm4 => {
            let lambda_limit = BM4_LIMIT * BM4_LIMIT;
            let largest_value = largest_lambda(LOSS_WEIGHT, lambda_limit, lambda_limit)?;
            if largest_value.lambda < lambda_limit {
                Ok(certificate(&largest_value, StabilityGuarantee::Tried))
            } else {
                Err(unstable_error(network, method, &largest_value, lambda_limit))
            }
        }
        MeshMethod::Ca | MeshMethod::Ieq => {
            ieq::check_supported(&network_mesh, network)?;
            // IEQ has no stability limit, but for non-linear links it conserves an energy that is not that of their
            // laws.
            Ok(certificate(
                &largest_lambda(0.0, f64::INFINITY, f64::INFINITY)?,
                guarantee,
            ))
        }
    }
}

/// The stability limit that CA2P's guard watches. The trusted part is the bound for any modes: a stiffened link need
/// not share modes with the network at rest.
pub(super) fn ca2p_guard_limit(mesh: &Mesh) -> StabilityLimit {
    StabilityLimit {
        damping_weight: ca2p_bound(mesh).0,
        trusted_lambda: 0.9 * LAMBDA_MAX_ANY,
        accepted_lambda: LAMBDA_MAX_SHARED,
        has_poles: false,
    }
}

/// CA2P: the weight c of Z in λmax(M⁻¹(K + c·Z)), and the bound below which stability is proved.
fn ca2p_bound(mesh: &Mesh) -> (f64, f64) {
    let has_losses = mesh.is_damped || mesh.scheme.zeta.iter().any(|zeta| *zeta != 0.0);
    if has_losses {
        (6.0, LAMBDA_MAX_ANY)
    } else {
        (0.0, LAMBDA_MAX_SHARED)
    }
}

fn unstable_error(network: &Network, method: MeshMethod, largest: &LargestEigenvalue, limit: f64) -> Error {
    let (method_name, lambda_max) = (method.properties().name, largest.lambda);
    let rate_factor = (lambda_max / limit).sqrt().ceil();
    Error::Refused {
        module: network.mat_name(largest.worst_mat),
        message: format!(
            "unstable with method {method_name} at this rate: λmax is at least {lambda_max:.6} and must be below {limit:.3}; use \
             {rate_factor} times the rate or more, a larger M, or a smaller K or Z"
        ),
    }
}
