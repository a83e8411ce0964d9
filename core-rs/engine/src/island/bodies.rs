//! Bodies inside an island, each computed by a method of its own.

use std::sync::Arc;

use super::energy_account::EnergyGain;
use super::mesh::{self, Mesh};
use super::modal::{self, Modal};
use super::slow::{self, Slow};
use crate::archive::{Archive, Damaged, State};
use crate::guard::FinerFrames;
use crate::integrate::MeshMethod;
use crate::kernel::thread_team::ThreadTeam;
use crate::network::{Error, Network, PartOrder};
use crate::state::ModuleState;

/// A body as the plan describes it.
#[derive(Clone, Debug)]
pub(crate) enum BodyPlan {
    Modal(Modal),
    Mesh(Mesh),
    Slow(Slow),
}

/// A running body.
#[derive(Clone, Debug)]
pub(crate) enum RunningBody {
    Modal(Box<modal::RunningModal>),
    Mesh(Box<mesh::RunningMesh>),
    Slow(Box<slow::RunningSlow>),
}

impl State for RunningBody {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        match self {
            Self::Modal(body) => body.archive(archive),
            Self::Mesh(body) => body.archive(archive),
            Self::Slow(body) => body.archive(archive),
        }
    }
}

impl BodyPlan {
    /// Start the body at frame 0, against forces that act on its ports there (n_mat of the island); in `modules`, the
    /// ports are plain masses.
    pub(super) fn start(&self, port_forces: &[f64], modules: &ModuleState) -> Result<RunningBody, Error> {
        Ok(match self {
            Self::Modal(modal) => {
                RunningBody::Modal(Box::new(modal::RunningModal::new(&modal.started_against(port_forces))))
            }
            Self::Mesh(mesh) => RunningBody::Mesh(Box::new(mesh::RunningMesh::new(mesh, port_forces)?)),
            Self::Slow(slow) => RunningBody::Slow(Box::new(slow::RunningSlow::new(slow, modules))),
        })
    }

    /// A copy of the body without strikes and names, with parts renumbered by their rank in `order`.
    pub(crate) fn without_strikes_and_names(&self, order: &PartOrder) -> Self {
        let mut anonymous_plan = self.clone();
        let network = Arc::new(self.network().anonymous(order));
        match &mut anonymous_plan {
            Self::Modal(modal) => {
                modal
                    .struck_points
                    .iter_mut()
                    .for_each(|struck_point| struck_point.strikes.clear());
                modal.network = network;
            }
            Self::Mesh(mesh) => {
                mesh.strikes.clear();
                mesh.network = network;
            }
            Self::Slow(slow) => {
                slow.part = order.rank(slow.part);
                slow.network = network;
            }
        }
        anonymous_plan
    }

    /// The network of its modules.
    pub(crate) fn network(&self) -> &Network {
        match self {
            Self::Modal(modal) => &modal.network,
            Self::Mesh(mesh) => &mesh.network,
            Self::Slow(slow) => &slow.network,
        }
    }

    /// Its strikes: frame, struck point or MAT, and [part of a frame, impulse [N·s]].
    pub(crate) fn strikes(&self) -> Box<dyn Iterator<Item = (u64, usize, [f64; 2])> + '_> {
        match self {
            Self::Modal(modal) => Box::new(modal.struck_points.iter().enumerate().flat_map(
                |(point_index, struck_point)| {
                    let point_strikes = struck_point.strikes.iter();
                    point_strikes.map(move |&(frame, fraction, impulse)| (frame, point_index, [fraction, impulse]))
                },
            )),
            Self::Mesh(mesh) => {
                let strikes = mesh.strikes.iter();
                Box::new(strikes.map(|&(frame, mat, impulse)| (frame, mat, [0.0, impulse])))
            }
            // Strikes on a slow body go through its ports.
            Self::Slow(_) => Box::new(std::iter::empty()),
        }
    }

    /// Number of modes by which the body is computed.
    pub(crate) fn n_modes(&self) -> usize {
        match self {
            Self::Modal(modal) => modal.modes.len(),
            Self::Mesh(_) | Self::Slow(_) => 0,
        }
    }

    /// Frame of its first strike from a frame on [frames]; infinite if it has none.
    pub(crate) fn next_strike_frame(&self, start_frame: f64) -> f64 {
        let earlier_frame = |earliest: f64, frame: u64| match frame as f64 {
            frame if frame >= start_frame => earliest.min(frame),
            _ => earliest,
        };
        match self {
            Self::Modal(modal) => {
                let body_strikes = modal
                    .struck_points
                    .iter()
                    .flat_map(|struck_point| &struck_point.strikes);
                body_strikes.map(|strike| strike.0).fold(f64::INFINITY, earlier_frame)
            }
            Self::Mesh(mesh) => {
                let strikes = mesh.strikes.iter();
                strikes.map(|strike| strike.0).fold(f64::INFINITY, earlier_frame)
            }
            // Strikes on a slow body go through its ports.
            Self::Slow(_) => f64::INFINITY,
        }
    }

    /// Whether another body is equal, so that one can continue from the state of the other. `name_of` and
    /// `other_name_of` give the names of port MATs in either island.
    pub(crate) fn is_same(
        &self,
        other: &Self,
        name_of: impl Fn(usize) -> String,
        other_name_of: impl Fn(usize) -> String,
    ) -> bool {
        let port_names = |body_plan: &Self, name: &dyn Fn(usize) -> String| -> Vec<String> {
            body_plan.ports().into_iter().map(name).collect()
        };
        let bodies_match = match (self, other) {
            (Self::Modal(body), Self::Modal(other)) => body.is_same(other),
            (Self::Mesh(body), Self::Mesh(other)) => body.is_same(other),
            (Self::Slow(body), Self::Slow(other)) => body.is_same(other),
            _ => false,
        };
        bodies_match && port_names(self, &name_of) == port_names(other, &other_name_of)
    }

    /// For a mesh: its method, and steps a frame.
    pub(crate) fn mesh_method(&self) -> Option<(MeshMethod, u32)> {
        match self {
            Self::Mesh(mesh) => Some((mesh.method, mesh.substeps)),
            Self::Modal(_) | Self::Slow(_) => None,
        }
    }

    /// MATs of the island that are its ports, in order.
    pub(crate) fn ports(&self) -> Vec<usize> {
        match self {
            Self::Modal(modal) => modal.ports.iter().map(|port| port.mat).collect(),
            Self::Mesh(mesh) => mesh.ports.iter().map(|&(_, mat)| mat).collect(),
            Self::Slow(slow) => slow.ports.iter().map(|&(_, mat)| mat).collect(),
        }
    }
}

impl RunningBody {
    pub(crate) fn add_outputs(&self, out: &mut [f64]) {
        match self {
            Self::Modal(modal) => modal.add_outputs(out),
            Self::Mesh(mesh) => mesh.add_outputs(out),
            Self::Slow(slow) => slow.add_outputs(out),
        }
    }

    pub(crate) fn set_ports(&self, modules: &mut ModuleState) {
        match self {
            Self::Modal(modal) => modal.set_ports(modules),
            Self::Mesh(mesh) => mesh.set_ports(modules),
            Self::Slow(slow) => slow.set_ports(modules),
        }
    }

    pub(crate) fn apply_strikes(&mut self, n: u64, modules: &mut ModuleState) {
        if let Self::Modal(modal_body) = self {
            modal_body.apply_strikes(n, modules);
        }
    }

    /// Take the velocity that a hand gives a MAT of the island at the end of this frame [m a frame].
    pub(crate) fn add_velocity(&mut self, mat: usize, velocity: f64) {
        if let Self::Slow(slow_body) = self {
            slow_body.add_velocity(mat, velocity);
        }
    }

    /// Take note of a strike on a MAT of the island in this frame [N]; its force is in the sum already.
    pub(crate) fn record_strike(&mut self, mat: usize, force: f64) {
        if let Self::Slow(slow_body) = self {
            slow_body.record_strike(mat, force);
        }
    }

    pub(crate) fn step(&mut self, n: u64, force: &[f64], team: &mut ThreadTeam<'_>) {
        match self {
            Self::Modal(modal) => modal.step(n, force),
            Self::Mesh(mesh) => mesh.step(n, force, team),
            Self::Slow(slow) => slow.step(n, force),
        }
    }

    /// How strongly it moves, in a unit of its own; infinite if that is not known.
    pub(super) fn motion_level(&self) -> f64 {
        match self {
            Self::Modal(modal) => modal.motion_level(),
            Self::Mesh(mesh) => mesh.double_kinetic_energy(),
            Self::Slow(slow) => slow.spring_energy(),
        }
    }

    /// Whether a MAT of the island is one of its ports.
    pub(crate) fn has_port(&self, mat: usize) -> bool {
        match self {
            Self::Modal(modal) => modal.ports().any(|port| port == mat),
            Self::Mesh(mesh) => mesh.has_port(mat),
            Self::Slow(slow) => slow.has_port(mat),
        }
    }

    /// Whether one of its ports is among the marked MATs (n_mat), or one of its own MATs is in a part.
    pub(crate) fn touches_part(&self, mats: &[bool], part: usize) -> bool {
        match self {
            Self::Modal(modal) => modal.has_port_among(mats),
            Self::Mesh(mesh) => mesh.touches_part(mats, part),
            Self::Slow(slow) => slow.is_in_part(part),
        }
    }

    /// Outputs that hear it.
    pub(crate) fn outputs(&self) -> Vec<u32> {
        match self {
            Self::Modal(modal) => modal.outputs(),
            Self::Mesh(mesh) => mesh.outputs(),
            Self::Slow(slow) => slow.outputs(),
        }
    }

    /// The name and part of a MAT whose position is beyond all bounds.
    pub(crate) fn diverged_mat(&self) -> Option<(String, usize)> {
        match self {
            Self::Modal(_) => None,
            Self::Mesh(mesh) => mesh.diverged_mat(),
            Self::Slow(slow) => slow.diverged_mat(),
        }
    }

    /// Its modes, if it is computed by modes.
    pub(crate) fn modal(&self) -> Option<&modal::RunningModal> {
        match self {
            Self::Modal(modal) => Some(modal),
            Self::Mesh(_) | Self::Slow(_) => None,
        }
    }

    /// Its modes, if it is computed by modes.
    pub(crate) fn modal_mut(&mut self) -> Option<&mut modal::RunningModal> {
        match self {
            Self::Modal(modal) => Some(modal),
            Self::Mesh(_) | Self::Slow(_) => None,
        }
    }

    /// Whether it moves on by itself while nothing pushes it: by its modes, or by the flow of its linear springs.
    pub(crate) fn can_coast(&self) -> bool {
        match self {
            Self::Modal(_) => true,
            Self::Mesh(_) => false,
            Self::Slow(slow) => slow.is_linear(),
        }
    }

    /// Add its outputs to `out` (n_out) in `frames` frames of coasting; a slow body is already there.
    pub(crate) fn add_outputs_ahead(&self, frames: usize, out: &mut [f64]) {
        match self {
            Self::Modal(modal) => modal.add_outputs_ahead(frames, out),
            Self::Mesh(_) => {}
            Self::Slow(slow) => slow.add_outputs(out),
        }
    }

    /// Set its ports as they are after `frames` frames of coasting, one more than at the last call: modes were computed
    /// ahead, a slow body moves now. Returns whether all positions are finite and plausible.
    pub(crate) fn set_ports_ahead(&mut self, frames: usize, modules: &mut ModuleState) -> bool {
        match self {
            Self::Modal(modal) => modal.set_ports_ahead(frames, modules),
            Self::Mesh(_) => {}
            Self::Slow(slow) => {
                slow.step_flow();
                slow.set_ports(modules);
                return slow.is_bounded();
            }
        }
        true
    }

    /// Make its motion decay by an additional factor in each frame.
    pub(crate) fn damp(&mut self, decay_factor: f64) {
        match self {
            Self::Modal(modal) => modal.damp(decay_factor),
            Self::Mesh(mesh) => mesh.damp(decay_factor),
            Self::Slow(slow) => slow.damp(decay_factor),
        }
    }

    /// Begin at frame `n`: strikes before it are skipped.
    pub(crate) fn seek(&mut self, n: u64) {
        match self {
            Self::Modal(modal) => modal.seek(n),
            Self::Mesh(mesh) => mesh.seek(n),
            Self::Slow(slow) => slow.seek(n),
        }
    }

    /// Take over the state of an equal body of another version.
    pub(crate) fn continue_from(&mut self, old: &mut Self) {
        match (self, old) {
            (Self::Modal(running_body), Self::Modal(old)) => running_body.continue_from(old),
            (Self::Mesh(running_body), Self::Mesh(old)) => running_body.continue_from(old),
            (Self::Slow(running_body), Self::Slow(old)) => running_body.continue_from(old),
            _ => {}
        }
    }

    /// Prepare for a team of `threads` threads, if the body gains by it.
    pub(crate) fn prepare_team(&mut self, threads: usize) {
        if let Self::Mesh(mesh_body) = self {
            mesh_body.prepare_team(threads);
        }
    }

    /// Whether a team of threads can share its work.
    pub(crate) fn can_share_work(&self) -> bool {
        match self {
            Self::Modal(_) | Self::Slow(_) => false,
            Self::Mesh(mesh) => mesh.can_share_work(),
        }
    }

    /// The part of a mesh whose links stiffened, and which frames were computed finer for it.
    pub(crate) fn finer_frames(&self) -> Option<(&str, FinerFrames)> {
        match self {
            Self::Modal(_) | Self::Slow(_) => None,
            Self::Mesh(mesh) => mesh.finer_frames(),
        }
    }

    /// Check whether it created energy.
    pub(super) fn check_energy_gain(&mut self, n: u64) -> Option<EnergyGain> {
        match self {
            Self::Modal(_) | Self::Slow(_) => None,
            Self::Mesh(mesh) => mesh.check_energy_gain(n),
        }
    }

    /// The most energy that it created.
    pub(super) fn energy_gain(&self) -> Option<EnergyGain> {
        match self {
            Self::Modal(_) | Self::Slow(_) => None,
            Self::Mesh(mesh) => mesh.energy_gain(),
        }
    }

    /// The name and part of the first MAT of a mesh that moves.
    pub(super) fn first_moving_mat(&self) -> Option<(String, usize)> {
        match self {
            Self::Modal(_) | Self::Slow(_) => None,
            Self::Mesh(mesh) => mesh.first_moving_mat(),
        }
    }

    /// Reserve room, so that steps do not allocate.
    pub(crate) fn reserve(&mut self) {
        if let Self::Mesh(mesh_body) = self {
            mesh_body.reserve();
        }
    }

    /// Whether all positions are finite and plausible; those of modes always are.
    pub(crate) fn is_bounded(&self) -> bool {
        match self {
            Self::Modal(_) => true,
            Self::Mesh(mesh) => mesh.is_bounded(),
            Self::Slow(slow) => slow.is_bounded(),
        }
    }
}
