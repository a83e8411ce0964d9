//! The constant data of links between frames: their points, and the response of each point to a push on another.

use super::ContactOrder;
use super::basis::{Basis, Instant, add_rows};
use super::crowded::CrowdedBody;
use super::joint::Joint;
use crate::scheme::LinkRun;
use crate::units::Rate;

/// Links whose pushes change each other's velocity by less than this part of their own are not coupled.
const UNCOUPLED_SHARE_MAX: f64 = 1e-6;

/// The constant data of links and their points.
#[derive(Clone, Debug)]
pub(super) struct FineScript {
    /// Least number of steps a frame, and of steps per radian of a contact's own oscillation, for splitting of order 4.
    pub(super) steps_min: usize,
    /// The order of the splitting that steps closed contacts.
    pub(super) contact_order: ContactOrder,
    pub(super) rate: Rate,
    pub(super) basis: Basis,
    pub(super) links: Vec<LinkRun>,
    /// The two joints of each link.
    pub(super) link_joints: Vec<(usize, usize)>,
    pub(super) joints: Vec<Joint>,
    /// Bodies of which the modes are pushed.
    pub(super) crowded_bodies: Vec<CrowdedBody>,
    /// Body and row of each joint that is on one of them   (n_joints)
    pub(super) crowded_rows: Vec<Option<(usize, usize)>>,
    /// Response of one joint's path to an impulse at another   (n_joints², n·n); empty between those of a crowded body.
    pub(super) path_responses: Vec<Vec<f64>>,
    /// Change at once of one joint's velocity by an impulse at another [m/frame per N·s]   (n_joints²)
    pub(super) velocity_jumps: Vec<f64>,
    /// Whether a push of one link changes the velocity of another at once.
    pub(super) is_coupled: bool,
    /// Number of products by which an impulse on each joint changes all paths in `path_responses`   (n_joints)
    pub(super) impulse_products: Vec<u64>,
    /// Displacement of one joint at the instants of a frame by an impulse at another at its start; empty but between
    /// ports, and between those of a crowded body   (n_joints²)
    pub(super) displacement_responses: Vec<Vec<f64>>,
    /// Number of products that the free paths of all joints take in each frame.
    pub(super) free_path_products: u64,
}

impl FineScript {
    /// Change of a link's rate of elongation by an impulse of the link [m/frame per N·s].
    pub(super) fn velocity_jump(&self, a: usize, b: usize) -> f64 {
        self.velocity_jump_between((a, b), (a, b))
    }

    /// Change of the rate of elongation of the second link, given by its joints, by an impulse of the first [m/frame
    /// per N·s].
    pub(super) fn velocity_jump_between(&self, (a, b): (usize, usize), (c, d): (usize, usize)) -> f64 {
        let jump = |pushed_joint: usize, moved_joint: usize| {
            self.velocity_jumps[pushed_joint * self.joints.len() + moved_joint]
        };
        jump(a, c) + jump(b, d) - jump(a, d) - jump(b, c)
    }

    /// Whether a push of one link changes the velocity of another at once, by more than `UNCOUPLED_SHARE_MAX` of what
    /// it changes its own.
    pub(super) fn has_coupled_links(&self) -> bool {
        let link_ends = self.link_joints.iter().enumerate();
        let mut link_pairs = link_ends.flat_map(|(first_index, first_ends)| {
            self.link_joints[..first_index]
                .iter()
                .map(move |second_ends| (first_ends, second_ends))
        });
        link_pairs.any(|(first_ends, second_ends)| {
            let self_jumps = [*first_ends, *second_ends].map(|link| self.velocity_jump_between(link, link));
            self.velocity_jump_between(*first_ends, *second_ends).abs()
                > UNCOUPLED_SHARE_MAX * self_jumps[0].min(self_jumps[1])
        })
    }

    /// Change the paths of all joints by an impulse on one of them [N·s].
    pub(super) fn add_impulse(&self, joint: usize, impulse: f64, instant: &Instant, path: &mut [f64]) {
        let (n_instants, n_joints) = (self.basis.n_polynomials(), self.joints.len());
        let impulse_shares = instant.values.map(|value| impulse * value);
        let joint_responses = &self.path_responses[joint * n_joints..(joint + 1) * n_joints];
        for (joint_responses, path) in joint_responses.iter().zip(path.chunks_mut(n_instants)) {
            if !joint_responses.is_empty() {
                add_rows(joint_responses, &impulse_shares[..n_instants], path);
            }
        }
    }
}
