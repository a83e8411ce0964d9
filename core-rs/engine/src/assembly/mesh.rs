//! A mesh inside an island: chooses a method that is exact enough and stable.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use crate::assembly::body::position_and_spring_sums;
use crate::assembly::budget::Budget;
use crate::assembly::choice::MeshChoice;
use crate::assembly::split::local_links;
use crate::assembly::wiring::WiredBody;
use crate::integrate::{MeshMethod, certify};
use crate::island::mesh::Mesh;
use crate::maths::sqrt;
use crate::network::{Error, Network};
use crate::timeline::{Lead, Timeline, strike_forces, with_greatest_factors};
use crate::units::Rate;

/// Methods, with their steps a frame and their cost in steps of CA a frame (docs/benchmarks.md), in the order in which
/// they are tried. IEQ, the last, cannot diverge.
pub(crate) const MESH_METHODS: [(MeshMethod, u32, f64); 10] = [
    (MeshMethod::Ca, 1, 1.0),
    (MeshMethod::Ca2p, 1, 1.5),
    (MeshMethod::Ca, 2, 2.0),
    (MeshMethod::Ca2p, 2, 3.0),
    (MeshMethod::Ca2p, 4, 6.0),
    (MeshMethod::Bm4, 1, 6.7),
    (MeshMethod::Bm4, 2, 13.4),
    (MeshMethod::Bm4, 4, 26.8),
    (MeshMethod::Ieq, 1, 14.0),
    (MeshMethod::Ieq, 2, 28.0),
];

/// Which methods the meshes of an island are computed by.
#[derive(Clone, Copy, Debug)]
pub(crate) enum MethodChoice<'a> {
    /// The budget decides.
    ByBudget,
    /// By a method that is stable at any step.
    Unconditional,
    /// The methods of the meshes among these bodies, in order: the same island at another rate.
    Repeated(&'a [Option<(MeshMethod, u32)>]),
    /// One method for all meshes.
    All((MeshMethod, u32)),
    /// No bodies: all of the island module by module.
    Stepped,
    /// One method for all that it can step, linear and small bodies too.
    Meshes((MeshMethod, u32)),
}

/// Error of a pitch [cents] by a method, with x = ωT for its step T.
fn pitch_error_cents(method: MeshMethod, x: f64) -> f64 {
    match method {
        MeshMethod::Ca | MeshMethod::Ieq => 72.13 * x * x,
        MeshMethod::Ca2p => 2.404 * x * x * x * x,
        MeshMethod::Bm4 => 0.0255 * x * x * x * x,
    }
}

/// A mesh by the cheapest method that is exact enough and stable; `None` if that is CA once a frame, which needs no
/// mesh, or if there is none.
pub(crate) fn mesh(
    network: &Network,
    timeline: &Timeline,
    body: &WiredBody,
    budget: &Budget,
    pin: Option<MeshChoice>,
    (choice, index): (MethodChoice<'_>, usize),
) -> Option<Mesh> {
    let mesh_subset = network.subset(&body.mats, &body.foreign_held_mats, &body.links);
    if is_discrete(network, &mesh_subset.network) {
        return None; // the discrete network is the reference
    }
    let rate = timeline.rate;
    let leads: Vec<Lead> = timeline
        .leads
        .iter()
        .filter_map(|lead| local_links(&mesh_subset, lead.links()).map(|(first, len)| lead.on_links(first, len)))
        .collect();
    let stiffest_network = with_greatest_factors(&mesh_subset.network, &leads).ok()?;
    let has_leads = !leads.is_empty();
    let (method, substeps) = match pin {
        Some(pin) => (pin.method, pin.substeps),
        None => match choice {
            MethodChoice::Repeated(body_methods) => (*body_methods.get(index)?)?,
            MethodChoice::All((method, substeps)) | MethodChoice::Meshes((method, substeps)) => {
                let method = if has_leads { MeshMethod::Bm4 } else { method };
                certify(&stiffest_network, rate, method, substeps).ok()?;
                (method, substeps)
            }
            MethodChoice::Stepped => return None,
            MethodChoice::Unconditional if !has_leads => method_within_budget(&stiffest_network, rate, budget, true)?,
            _ if has_leads => method_for_led_mesh(&stiffest_network, rate, budget)?,
            _ => method_within_budget(&stiffest_network, rate, budget, false)?,
        },
    };
    let outputs = position_and_spring_sums(&mesh_subset.network).ok()?;
    let local_mat = |mat: u32| mesh_subset.mat(mat as usize);
    let port_pairs = body.ports.iter().map(|&mat| Some((local_mat(mat)?, mat as usize)));
    let mesh_strikes = timeline.strikes.iter().filter(|strike| local_mat(strike.mat).is_some());
    let struck_timeline = Timeline {
        strikes: mesh_strikes.copied().collect(),
        ..Timeline::new(rate)
    };
    let strikes = strike_forces(network, &struck_timeline, |mat| network.degree(mat) == 0)
        .into_iter()
        .map(|push| Some((push.frame, local_mat(push.mat)?, push.force * rate.step())));
    Some(Mesh {
        rate,
        method,
        substeps,
        ports: port_pairs.collect::<Option<_>>()?,
        outputs: mesh_subset.outputs.iter().copied().zip(outputs.position_rows).collect(),
        strikes: strikes.collect::<Option<_>>()?,
        network: Arc::new(mesh_subset.network),
        leads,
    })
}

/// Refuses a mesh with links that IEQ cannot step, if IEQ is asked for by name: without this the mesh would be stepped
/// by CA.
///
/// # Errors
/// With the name of a module of it.
pub(crate) fn check_supported(
    network: &Network,
    rate: Rate,
    body: &WiredBody,
    method: MeshMethod,
) -> Result<(), Error> {
    let mesh_subset = network.subset(&body.mats, &body.foreign_held_mats, &body.links);
    if method != MeshMethod::Ieq || is_discrete(network, &mesh_subset.network) {
        return Ok(()); // CA steps a discrete network, whatever method is asked for
    }
    certify(&mesh_subset.network, rate, method, 1).map(|_| ())
}

/// Whether the discrete network is the reference for any of its parts.
fn is_discrete(network: &Network, island: &Network) -> bool {
    let mat_parts = island.mats().part.iter().map(|&part| part as usize);
    let link_parts = island.runs().iter().map(|run| run.part);
    mat_parts
        .chain(link_parts)
        .any(|part| network.parts()[part].ca_rate.is_some())
}

/// BM4 with as many steps as the budget asks for: among the methods only BM4 preserves, to its own order, the action of
/// an oscillation of changing frequency, and so its amplitude.
fn method_for_led_mesh(network: &Network, rate: Rate, budget: &Budget) -> Option<(MeshMethod, u32)> {
    let mesh_method = MeshMethod::Bm4;
    let mut stable_substeps = [1, 2, 4]
        .into_iter()
        .filter(|&substeps| certify(network, rate, mesh_method, substeps).is_ok());
    let Budget::Cents {
        cents: cents_max,
        frequency_hz_max: frequency_max,
    } = *budget
    else {
        return stable_substeps.next().map(|substeps| (mesh_method, substeps));
    };
    let frame_angle = TAU * frequency_max * rate.step();
    let is_exact = |substeps: &u32| pitch_error_cents(mesh_method, frame_angle / f64::from(*substeps)) <= cents_max;
    stable_substeps.find(is_exact).map(|substeps| (mesh_method, substeps))
}

/// The first method of `MESH_METHODS` that is stable and exact enough by its formula; `is_safe`: only methods that
/// cannot diverge.
fn method_within_budget(network: &Network, rate: Rate, budget: &Budget, is_safe: bool) -> Option<(MeshMethod, u32)> {
    if let Budget::Method(method) = budget {
        let method = method.mesh_method()?;
        return certify(network, rate, method, 1).ok().map(|_| (method, 1));
    }
    // The highest frequency of the mesh at rest; CA shifts it to 2·asin(√λ/2).
    let lambda_max = certify(network, rate, MeshMethod::Ca2p, 1).map_or(4.0, |certificate| certificate.lambda_max);
    let angle_max = sqrt(lambda_max.max(0.0)).min(PI);
    for (method, substeps, _) in MESH_METHODS {
        let step_count = f64::from(substeps);
        let is_exact = match *budget {
            Budget::Cents {
                cents: cents_max,
                frequency_hz_max: frequency_max,
            } => {
                let substep_angle = (TAU * frequency_max * rate.step()).min(angle_max) / step_count;
                pitch_error_cents(method, substep_angle) <= cents_max
            }
            // The pilot finds better methods if necessary.
            Budget::Error(_) | Budget::Method(_) => true,
        };
        let cannot_diverge = matches!(method, MeshMethod::Ieq);
        if is_safe && !cannot_diverge {
            continue;
        }
        if (is_exact || cannot_diverge) && certify(network, rate, method, substeps).is_ok() {
            return ((method, substeps) != (MeshMethod::Ca, 1)).then_some((method, substeps));
        }
    }
    None
}
