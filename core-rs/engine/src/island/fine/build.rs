//! Builds contacts and laws between frames from a network: their joints, and the response of each joint to a push on
//! another.

use std::sync::Arc;

use super::basis::{Basis, Instant, RELATIVE_ERROR, RELATIVE_ERROR_OF_FRICTION, dot};
use super::crowded::{CrowdedBody, crowded_bodies};
use super::joint::{Joint, RESPONSE_PRODUCTS, fastest_rate, new_joint, path_responses};
use super::laws::LawScript;
use super::slides::Frictions;
use super::stepped_points::SteppedPoints;
use super::{FineLinks, FineScript, FineWork};
use crate::island::StepNumbers;
use crate::island::bodies::RunningBody;
use crate::island::modal::RunningModal;
use crate::network::Network;
use crate::scheme::{LinkRun, Scheme};
use crate::timeline::{DriveKind, Timeline};

impl FineLinks {
    /// `links` were taken out of the scheme: single contacts and laws whose ends are masses or ports.
    pub(in crate::island) fn new(
        links: Vec<LinkRun>,
        network: &Network,
        scheme: &Scheme,
        bodies: &[RunningBody],
        steps: StepNumbers,
        timeline: &Timeline,
    ) -> Self {
        let rate = timeline.rate;
        let mut joint_mats: Vec<usize> = links.iter().flat_map(|run| [run.a, run.b]).collect();
        joint_mats.sort_unstable();
        joint_mats.dedup();
        let fit_error = match links.iter().any(LinkRun::is_dry) {
            true => RELATIVE_ERROR_OF_FRICTION,
            false => RELATIVE_ERROR,
        };
        let basis = Basis::new(fastest_rate(&joint_mats, network, scheme, bodies, timeline), fit_error);
        let n_instants = basis.n_polynomials();
        let is_imposed = |mat: usize| {
            let mut timeline_drives = timeline.drives.iter();
            timeline_drives.any(|drive| drive.mat == mat && drive.kind == DriveKind::Position)
        };
        let new_joint = |&mat: &usize| new_joint(mat, is_imposed(mat), network, scheme, bodies, (&basis, rate));
        let joints: Vec<Joint> = joint_mats.iter().map(new_joint).collect();
        let joint_of = |mat: usize| joint_mats.binary_search(&mat).unwrap_or(0);
        let link_joints = links.iter().map(|run| (joint_of(run.a), joint_of(run.b))).collect();
        let n_joints = joints.len();
        let many_joint_bodies = crowded_bodies(&links, &joints, bodies, (&basis, rate));
        let has_many_joints = |body_index: usize| many_joint_bodies.iter().any(|body| body.body_index() == body_index);
        // Number of modes that give the position of a joint; 1 for a mass.
        let mode_count = |joint: &Joint| {
            let body = joint.port.and_then(|(body_index, _)| bodies[body_index].modal());
            body.map_or(1, RunningModal::n_modes) as u64
        };
        let pair_count = |joint: &Joint| {
            let is_same_body = |other: &&Joint| match (joint.port, other.port) {
                (Some((body_index, _)), Some((other_body_index, _))) => body_index == other_body_index,
                _ => false,
            };
            joints.iter().filter(is_same_body).count().max(1) as u64
        };
        let instant_count = n_instants as u64;
        let has_path_responses = |joint: &&Joint| joint.port.is_none_or(|(body_index, _)| !has_many_joints(body_index));
        let table_products = |body: &CrowdedBody| {
            let motion_entries = 2 * instant_count * body.n_modes() as u64;
            motion_entries * (RESPONSE_PRODUCTS + instant_count)
        };
        let response_products = joints
            .iter()
            .filter(has_path_responses)
            .map(|joint| (RESPONSE_PRODUCTS + pair_count(joint)) * mode_count(joint) * instant_count * instant_count)
            .sum::<u64>();
        let crowded_products: u64 = many_joint_bodies.iter().map(table_products).sum();
        let free_path_products = joints
            .iter()
            .map(|joint| (2 * mode_count(joint) + instant_count) * instant_count)
            .sum();
        let responses_from = |joint: &Joint| path_responses(joint, &joints, bodies, (&basis, rate), has_many_joints);
        let (path_responses, velocity_jumps): (Vec<_>, _) = joints.iter().flat_map(responses_from).unzip();
        let product_count = |joint_responses: &[Vec<f64>]| joint_responses.iter().map(Vec::len).sum::<usize>() as u64;
        let impulse_products = path_responses.chunks(n_joints.max(1)).map(product_count).collect();
        let displacement_responses = displacement_responses(&path_responses, &joints, &basis);
        let mut script = FineScript {
            is_coupled: false,
            steps_min: steps.contact_substeps,
            contact_order: steps.contact_order,
            rate,
            basis,
            links,
            link_joints,
            crowded_rows: CrowdedBody::joint_rows(&many_joint_bodies, n_joints),
            crowded_bodies: many_joint_bodies,
            joints,
            path_responses,
            velocity_jumps,
            impulse_products,
            displacement_responses,
            free_path_products,
        };
        script.is_coupled = script.has_coupled_links();
        let law_script = LawScript::new(&script);
        let stepped_points = SteppedPoints::new(&script, network);
        let n_links = script.links.len();
        Self {
            paths: vec![0.0; n_joints * n_instants],
            impulse_sums: vec![0.0; n_joints * n_instants],
            saved_paths_and_sums: [vec![0.0; n_joints * n_instants], vec![0.0; n_joints * n_instants]],
            free_paths: vec![0.0; n_joints * n_instants],
            frame_impulses: vec![0.0; n_joints * n_instants],
            crowded_motions: script.crowded_bodies.iter().map(CrowdedBody::resting_motion).collect(),
            carried_forces: vec![0.0; n_joints],
            steady_forces: vec![0.0; n_joints],
            may_close: vec![false; n_links],
            is_pushing: vec![false; n_links],
            has_rested: vec![false; n_links],
            is_instant_known: vec![false; n_links],
            forces: vec![0.0; n_links],
            penetrations: vec![0.0; n_links],
            link_constants: script.links.iter().map(|run| [[run.k, run.z]; 2]).collect(),
            joint_constants: script.joints.iter().map(|joint| joint.constants).collect(),
            has_glided: vec![false; n_joints],
            stepped_points,
            step_stages: &[],
            has_contact_closed: false,
            work: FineWork {
                evaluations: 0,
                products: response_products + crowded_products,
                couplings: 0,
            },
            laws: law_script.build_states(&script),
            law_script: Arc::new(law_script),
            frictions: Frictions::new(&script),
            script: Arc::new(script),
        }
    }
}

/// Displacement of one joint at the instants of a frame by an impulse at another at its start, from `path_responses`
/// (n_joints²)
fn displacement_responses(path_responses: &[Vec<f64>], joints: &[Joint], basis: &Basis) -> Vec<Vec<f64>> {
    let (n_instants, start_instant) = (basis.n_polynomials(), Instant::new(basis.n_polynomials(), 0.0));
    let response = |(pair, pair_response): (usize, &Vec<f64>)| {
        if joints[pair / joints.len()].port.is_none() || pair_response.is_empty() {
            return Vec::new();
        }
        let displacement_at = |&s: &f64| {
            let end_instant = Instant::new(n_instants, s);
            let response_rows = pair_response.chunks(n_instants).zip(&start_instant.values);
            response_rows
                .map(|(row, share)| share * dot(row, &end_instant.values))
                .sum()
        };
        basis.instants.iter().map(displacement_at).collect()
    };
    path_responses.iter().enumerate().map(response).collect()
}
