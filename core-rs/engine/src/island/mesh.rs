//! A body inside an island that is stepped by a method of its own: a non-linear mesh, or a linear body that is not
//! computed by modes.

use crate::archive::{Archive, Damaged, State, state_of};
use std::sync::Arc;

use super::energy_account::{self, EnergyAccount, EnergyGain};
use crate::guard::FinerFrames;
use crate::integrate::{Integrator, MeshMethod};
use crate::interrupt;
use crate::kernel::thread_team::ThreadTeam;
use crate::network::{Error, Network};
use crate::state::ModuleState;
use crate::timeline::Lead;
use crate::units::Rate;

/// The plan of a mesh.
#[derive(Clone, Debug)]
pub(crate) struct Mesh {
    pub(crate) network: Arc<Network>,
    pub(crate) rate: Rate,
    pub(crate) method: MeshMethod,
    pub(crate) substeps: u32,
    /// MATs that other modules touch: index in the mesh, and in the island.
    pub(crate) ports: Vec<(usize, usize)>,
    /// Outputs that hear it, each a weighted sum of positions.
    pub(crate) outputs: Vec<(u32, Vec<(usize, f64)>)>,
    /// Frame, MAT and impulse [N·s] of what strikes it, by rising frame.
    pub(crate) strikes: Vec<(u64, usize, f64)>,
    /// How K and Z of its links change in time.
    pub(crate) leads: Vec<Lead>,
}

/// A mesh that plays.
#[derive(Clone, Debug)]
pub(crate) struct RunningMesh {
    plan: Arc<Mesh>,
    integrator: Integrator,
    impulses: Vec<(usize, f64)>,
    /// Positions of the ports one frame ago, and the steps that followed from inertia and outside forces alone [m]
    /// (n_ports)
    previous_positions: Vec<f64>,
    inertial_steps: Vec<f64>,
    next_strike: usize,
    /// Factor on all velocities at each frame.
    velocity_factor: f64,
    /// Account of its energy, if its method may create energy, and the most that it created.
    energy_account: Option<EnergyAccount>,
    worst_gain: Option<EnergyGain>,
}

impl State for RunningMesh {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        archive.list(&mut self.impulses)?;
        state_of!(
            self,
            archive,
            integrator,
            previous_positions,
            inertial_steps,
            next_strike,
            velocity_factor,
            energy_account,
            worst_gain
        )
    }
}

impl Mesh {
    /// Whether its method steps over motions that are faster than frames, without following them.
    pub(crate) fn steps_over_fast_motion(&self) -> bool {
        self.method == MeshMethod::Ieq
    }

    /// Whether network, method, ports and led links are those of another mesh. Strikes, and how the links are led, may
    /// differ: each step reads both again.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let method_key = |mesh: &Self| (mesh.rate.hertz(), mesh.method, mesh.substeps);
        let port_indices = |mesh: &Self| mesh.ports.iter().map(|port| port.0).collect::<Vec<_>>();
        let led_links = |mesh: &Self| mesh.leads.iter().map(Lead::links).collect::<Vec<_>>();
        method_key(self) == method_key(other)
            && port_indices(self) == port_indices(other)
            && led_links(self) == led_links(other)
            && self.network.is_same(&other.network)
    }

    /// Take from the motion of the ports half the impulse that each gets in the first frame: as for any MAT, the step
    /// before frame 0 has felt only half of it.
    fn subtract_half_impulses(&self, integrator: &mut Integrator, port_forces: &[f64]) {
        if self.ports.iter().all(|&(_, mat)| port_forces[mat] == 0.0) {
            return;
        }
        let n_mat = integrator.positions().len();
        let mut motions: Vec<(f64, f64)> = (0..n_mat).map(|mat| integrator.mat_motion(mat)).collect();
        let time_step = self.rate.step();
        for &(port, mat) in &self.ports {
            let port_mass = self.network.mats().m[port];
            if port_mass > 0.0 {
                motions[port].1 -= 0.5 * time_step * time_step * port_forces[mat] / port_mass;
            }
        }
        for (mat, motion) in motions.into_iter().enumerate() {
            integrator.set_mat_motion(mat, motion);
        }
        integrator.update_after_motion();
    }
}

impl RunningMesh {
    /// A mesh whose ports feel `port_forces` at frame 0 [N], (n_mat of the island).
    pub(crate) fn new(plan: &Mesh, port_forces: &[f64]) -> Result<Self, Error> {
        let mut integrator = Integrator::new(&plan.network, plan.rate, plan.method, plan.substeps)?;
        integrator.set_led_links(0, &plan.leads);
        plan.subtract_half_impulses(&mut integrator, port_forces);
        let port_indices: Vec<usize> = plan.ports.iter().map(|&(port_index, _)| port_index).collect();
        let mut velocities = vec![0.0; port_indices.len()];
        integrator.velocities(&port_indices, &mut velocities);
        let positions = integrator.positions();
        let time_step = plan.rate.step();
        let positions_before = port_indices
            .iter()
            .zip(&velocities)
            .map(|(&port, v)| positions[port] - v * time_step);
        // Room for one impulse of each port and for the most strikes of one frame, so that steps do not allocate.
        let strikes_at_once = plan.strikes.chunk_by(|a, b| a.0 == b.0).map(<[_]>::len);
        Ok(Self {
            previous_positions: positions_before.collect(),
            inertial_steps: velocities.iter().map(|v| v * time_step).collect(),
            impulses: Vec::with_capacity(port_indices.len() + strikes_at_once.max().unwrap_or(0)),
            next_strike: 0,
            velocity_factor: 1.0,
            // K that changes in time gives and takes energy, as a hand does.
            energy_account: (plan.leads.is_empty() && integrator.may_create_energy())
                .then(|| EnergyAccount::new(integrator.stored_energy())),
            worst_gain: None,
            integrator,
            plan: Arc::new(plan.clone()),
        })
    }

    /// Make its motion decay by an additional factor in each frame.
    pub(crate) fn damp(&mut self, decay_factor: f64) {
        self.velocity_factor = decay_factor * decay_factor;
    }

    /// Position of a MAT [m], and its step in a frame [m].
    pub(crate) fn motion(&self, mat: usize) -> (f64, f64) {
        self.integrator.mat_motion(mat)
    }

    /// How strongly it moves: twice its kinetic energy [kg·m² a frame²].
    pub(crate) fn double_kinetic_energy(&self) -> f64 {
        let indexed_masses = self.plan.network.mats().m.iter().enumerate();
        let double_energy = |(mat, mass): (usize, &f64)| {
            let (_, mat_step) = self.integrator.mat_motion(mat);
            if mass.is_finite() {
                mass * mat_step * mat_step
            } else {
                0.0
            }
        };
        indexed_masses.map(double_energy).sum()
    }

    /// Set positions and steps [m] of MATs to values from elsewhere: (mat, (x, step)).
    pub(crate) fn set_motions(&mut self, mat_motions: &[(usize, (f64, f64))]) {
        for &(mat, motion) in mat_motions {
            self.integrator.set_mat_motion(mat, motion);
        }
        self.integrator.update_after_motion();
        self.restart_account();
        let port_motions = self
            .plan
            .ports
            .iter()
            .zip(self.previous_positions.iter_mut().zip(&mut self.inertial_steps));
        for (&(port, _), (previous, inertial_step)) in port_motions {
            let (x, port_step) = self.integrator.mat_motion(port);
            (*previous, *inertial_step) = (x - port_step, port_step);
        }
    }

    /// The first frame, `n` or later, in which anything strikes it or leads its links.
    pub(crate) fn next_event_frame(&self, n: u64) -> u64 {
        let next_strike = self.plan.strikes.get(self.next_strike).map(|next_strike| next_strike.0);
        let lead_frames = self.plan.leads.iter().map(|lead| lead.next_change_frame(n));
        lead_frames.chain(next_strike).min().unwrap_or(u64::MAX)
    }

    /// Begin at frame `n`.
    pub(crate) fn seek(&mut self, n: u64) {
        self.integrator.set_led_links(n, &self.plan.leads);
        self.next_strike = self.plan.strikes.partition_point(|strike| strike.0 < n);
    }

    /// Take over the state of an equal mesh; its strikes may differ.
    pub(crate) fn continue_from(&mut self, old: &mut Self) {
        std::mem::swap(&mut self.integrator, &mut old.integrator);
        std::mem::swap(&mut self.previous_positions, &mut old.previous_positions);
        std::mem::swap(&mut self.inertial_steps, &mut old.inertial_steps);
        std::mem::swap(&mut self.energy_account, &mut old.energy_account);
    }

    /// Prepare for a team of `threads` threads.
    pub(crate) fn prepare_team(&mut self, threads: usize) {
        if self.plan.leads.is_empty() {
            self.integrator.partition(threads);
        }
    }

    /// Whether a team of threads can share its work.
    pub(crate) fn can_share_work(&self) -> bool {
        self.integrator.can_share_work()
    }

    /// Reserve room for all impulses of a frame, because a cloned vector has no spare capacity.
    pub(crate) fn reserve(&mut self) {
        let strikes_at_once = self.plan.strikes.chunk_by(|a, b| a.0 == b.0).map(<[_]>::len);
        let impulses_max = self.plan.ports.len() + strikes_at_once.max().unwrap_or(0);
        self.impulses.reserve(impulses_max.saturating_sub(self.impulses.len()));
        if !self.plan.leads.is_empty() {
            self.integrator.unshare_parameters();
        }
    }

    /// Add its outputs to `out` (n_out).
    pub(crate) fn add_outputs(&self, out: &mut [f64]) {
        let positions = self.integrator.positions();
        for (output, row) in &self.plan.outputs {
            out[*output as usize] += row.iter().map(|&(mat, weight)| weight * positions[mat]).sum::<f64>();
        }
    }

    /// Set positions and steps of the ports in the island; `free_port_motion` is the part of the last step that the
    /// mesh's own forces made.
    pub(crate) fn set_ports(&self, modules: &mut ModuleState) {
        let positions = self.integrator.positions();
        let port_history = self.previous_positions.iter().zip(&self.inertial_steps);
        for (&(port, mat), (previous, inertial_step)) in self.plan.ports.iter().zip(port_history) {
            let port_step = positions[port] - previous;
            modules.x[mat] = positions[port];
            modules.d[mat] = port_step;
            modules.free_port_motion[mat] = port_step - inertial_step;
        }
    }

    /// Step from frame `n` to the next, under the forces at the ports (n_mat).
    pub(crate) fn step(&mut self, n: u64, force: &[f64], team: &mut ThreadTeam<'_>) {
        interrupt::poll_for(self.integrator.positions().len());
        let time_step = self.plan.rate.step();
        self.impulses.clear();
        for (row, &(port, mat)) in self.plan.ports.iter().enumerate() {
            let port_position = self.integrator.positions()[port];
            let port_mass = self.plan.network.mats().m[port];
            // The next step without the mesh's own forces: inertia, and the force at the port.
            self.inertial_steps[row] =
                (port_position - self.previous_positions[row]) + force[mat] * time_step * time_step / port_mass;
            self.previous_positions[row] = port_position;
            if force[mat] != 0.0 {
                self.impulses.push((port, force[mat] * time_step));
            }
        }
        while let Some(&(_, mat, impulse)) = self.plan.strikes.get(self.next_strike).filter(|strike| strike.0 <= n) {
            self.next_strike += 1;
            self.impulses.push((mat, impulse));
        }
        if self.velocity_factor < 1.0 {
            self.integrator.scale_velocities(self.velocity_factor);
            self.restart_account();
        }
        if let Some(account) = &mut self.energy_account
            && !self.impulses.is_empty()
        {
            account.add_work(self.integrator.impulse_work(&self.impulses));
        }
        let mesh_leads = &self.plan.leads;
        self.integrator.step_led(n, mesh_leads, &self.impulses, team);
    }

    /// Restart the account.
    fn restart_account(&mut self) {
        if let Some(account) = &mut self.energy_account {
            *account = EnergyAccount::new(self.integrator.stored_energy());
        }
    }

    /// Check whether it created energy by frame `n`; now and then only, where that takes long to compute.
    pub(super) fn check_energy_gain(&mut self, n: u64) -> Option<EnergyGain> {
        if !(n - 1).is_multiple_of(energy_account::RARE_CHECK_STEPS) && self.integrator.n_integrated_links() > 0 {
            return None;
        }
        let gain = self
            .energy_account
            .as_mut()?
            .energy_gain(self.integrator.stored_energy(), 0.0, n);
        if !gain.is_reportable() {
            return None;
        }
        self.worst_gain = Some(gain.worse_of(self.worst_gain));
        Some(gain)
    }

    /// The most energy that it created.
    pub(super) fn energy_gain(&self) -> Option<EnergyGain> {
        self.worst_gain
    }

    /// The name and part of its first MAT that moves.
    pub(super) fn first_moving_mat(&self) -> Option<(String, usize)> {
        let network = &self.plan.network;
        let moving_mat = network.mats().kind.iter().position(|kind| kind.moves())?;
        Some((network.mat_name(moving_mat), network.mats().part[moving_mat] as usize))
    }

    /// Whether a MAT of the island is one of its ports.
    pub(crate) fn has_port(&self, mat: usize) -> bool {
        self.plan.ports.iter().any(|&(_, port)| port == mat)
    }

    /// Whether a port is among some MATs (n_mat), or any of its own in a part.
    pub(crate) fn touches_part(&self, mats: &[bool], part: usize) -> bool {
        let mat_part = &self.plan.network.mats().part;
        self.plan.ports.iter().any(|&(_, mat)| mats[mat]) || mat_part.iter().any(|&mat_part| mat_part as usize == part)
    }

    /// Outputs that hear it.
    pub(crate) fn outputs(&self) -> Vec<u32> {
        self.plan.outputs.iter().map(|&(output, _)| output).collect()
    }

    /// The name and part of a MAT whose position is beyond all bounds.
    pub(crate) fn diverged_mat(&self) -> Option<(String, usize)> {
        let x = self.integrator.positions();
        let diverged_mat = x.iter().position(|&x| !crate::kernel::is_bounded(x))?;
        let network = &self.plan.network;
        Some((
            network.mat_name(diverged_mat),
            network.mats().part[diverged_mat] as usize,
        ))
    }

    /// The name of a part whose links stiffened, and which frames were computed finer for it.
    pub(crate) fn finer_frames(&self) -> Option<(&str, FinerFrames)> {
        let finer_frames = self.integrator.finer_frames()?;
        let network = &self.plan.network;
        let part_index = network.mats().part[finer_frames.stiffest_mat] as usize;
        Some((&network.parts()[part_index].name, finer_frames))
    }

    /// Whether all positions are finite and plausible.
    pub(crate) fn is_bounded(&self) -> bool {
        self.integrator.is_bounded()
    }
}
