//! The interface through which the guard steps a mesh: it computes frames in finer steps, with the forces of the mesh.

use super::mesh::{Mesh, Scratch};
use crate::guard::{Guard, MatMotion, SubsteppedSystem};
use crate::kernel::thread_team::ThreadTeam;

/// The arrays of a mesh that finer steps need.
pub(super) struct MeshSystem<'a, 'b> {
    pub(super) mesh: &'a Mesh,
    pub(super) scratch: &'a mut Scratch,
    pub(super) force: &'a mut [f64],
    pub(super) x: &'a mut [f64],
    pub(super) d: &'a mut [f64],
    pub(super) team: &'a mut ThreadTeam<'b>,
}

impl SubsteppedSystem for MeshSystem<'_, '_> {
    fn compute_link_forces(&mut self) {
        let mat_motion = [&*self.x, &*self.d];
        self.mesh
            .set_total_forces(mat_motion, self.scratch, self.force, self.team);
    }

    fn mat_motion(&mut self) -> MatMotion<'_> {
        MatMotion {
            ties: self.mesh.scheme.mat_coefficients(),
            force: self.force,
            x: self.x,
            d: self.d,
        }
    }
}

impl MeshSystem<'_, '_> {
    /// Compute one frame in finer steps. `x` and `d` hold the state at the beginning of the frame, with its impulses
    /// already applied.
    pub(super) fn step_finer(mut self, guard: &mut Guard) {
        self.compute_link_forces();
        guard.compute_finer(&mut self);
    }
}
