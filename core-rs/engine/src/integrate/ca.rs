//! CA: the scheme itself, stepped by the same kernels as an island, so that the results are equal to the last bit.

use std::sync::Arc;

use super::Stepper;
use super::mesh::Mesh;
use crate::guard::{self, Guard, StabilityLimit};
use crate::kernel;
use crate::kernel::KernelScratch;
use crate::kernel::mesh_partition::MeshPartition;
use crate::kernel::thread_team::ThreadTeam;
use crate::network::{Error, Network};
use crate::scheme::Scheme;
use crate::start::backward_steps;
use crate::state::{ModuleState, PreviousState};
use crate::timeline::Timeline;
use crate::units::Rate;

#[derive(Clone, Debug)]
pub(super) struct Ca {
    mesh: Arc<Mesh>,
    scheme: Scheme,
    /// Its forces are those of the links at the current frame.
    modules: ModuleState,
    scratch: KernelScratch,
    guard: Option<Guard>,
}

crate::archive::state!(Ca { modules, guard });

impl Ca {
    pub(super) fn new(mesh: Arc<Mesh>, network: &Network, rate: Rate) -> Result<Self, Error> {
        let mut scheme = mesh.scheme.clone();
        let guard = Guard::new(&scheme, network, StabilityLimit::CA, &[])?;
        let start_positions = network.mats().x0.clone();
        let start_steps = backward_steps(network, &Timeline::new(rate), &scheme, &start_positions, &[], &|_| true);
        scheme.fuse_springs(|_| false);
        let (mut modules, mut scratch) = (
            ModuleState::new(&scheme, start_positions, start_steps),
            KernelScratch::new(&scheme),
        );
        modules.previous_state = guard.as_ref().map(|_| PreviousState::new(scheme.n_mat()));
        kernel::compute_link_forces(&scheme, &[], &mut modules, &mut scratch, &mut ThreadTeam::alone());
        Ok(Self {
            mesh,
            scheme,
            modules,
            scratch,
            guard,
        })
    }
}

impl Stepper for Ca {
    fn partition(&mut self, threads: usize) {
        self.scratch.mesh_partition =
            MeshPartition::for_threads(&self.scheme.fused_springs, self.scheme.n_mat(), threads);
    }

    fn can_share_work(&self) -> bool {
        self.scratch.mesh_partition.is_some()
    }

    fn step(&mut self, impulses: &[(usize, f64)], team: &mut ThreadTeam<'_>) {
        let scheme = &self.scheme;
        for &(mat, impulse) in impulses {
            self.modules.push(mat, impulse * scheme.rate);
        }
        kernel::solve_exact_contacts(scheme, &[], &[], &mut self.modules);
        let mesh_partition = self.scratch.mesh_partition.as_ref();
        kernel::advance_mats(scheme, &mut [], &mut self.modules, mesh_partition, team);
        if let (Some(guard), Some(previous)) = (&mut self.guard, &mut self.modules.previous_state)
            && guard.needs_finer(&self.modules.x, &self.modules.d, &scheme.w)
        {
            previous.swap(&mut self.modules.x, &mut self.modules.d);
            guard.compute_finer(&mut guard::KernelSystem {
                scheme,
                gates: &[],
                modules: &mut self.modules,
                scratch: &mut self.scratch,
                team,
            });
        }
        kernel::compute_link_forces(scheme, &[], &mut self.modules, &mut self.scratch, team);
    }

    fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    fn positions(&self) -> &[f64] {
        &self.modules.x
    }

    fn velocity(&self, mat: usize) -> f64 {
        kernel::centred_velocity(&self.mesh.scheme, &self.modules, mat)
    }

    fn last_step(&self, mat: usize) -> f64 {
        self.modules.d[mat]
    }

    fn set_motion(&mut self, mat: usize, x: f64, step: f64) {
        (self.modules.x[mat], self.modules.d[mat]) = (x, step);
    }

    fn update_after_motion(&mut self) {
        let lone_team = &mut ThreadTeam::alone();
        kernel::compute_link_forces(&self.scheme, &[], &mut self.modules, &mut self.scratch, lone_team);
    }

    fn velocities_mut(&mut self) -> &mut [f64] {
        &mut self.modules.d
    }

    fn guard(&self) -> Option<&Guard> {
        self.guard.as_ref()
    }

    fn guard_mut(&mut self) -> Option<&mut Guard> {
        self.guard.as_mut()
    }

    fn energy(&self) -> f64 {
        self.mesh.staggered_energy(&self.modules.x, &self.modules.d, true)
    }
}
