//! Lets the guard step an island, by the kernels.

use super::{MatMotion, SubsteppedSystem};
use crate::kernel;
use crate::kernel::KernelScratch;
use crate::kernel::thread_team::ThreadTeam;
use crate::scheme::Scheme;
use crate::state::ModuleState;

pub(crate) struct KernelSystem<'a, 'b> {
    pub(crate) scheme: &'a Scheme,
    pub(crate) gates: &'a [f64],
    pub(crate) modules: &'a mut ModuleState,
    pub(crate) scratch: &'a mut KernelScratch,
    pub(crate) team: &'a mut ThreadTeam<'b>,
}

impl SubsteppedSystem for KernelSystem<'_, '_> {
    fn compute_link_forces(&mut self) {
        // The ledger still needs the outside forces of this frame.
        let outside_forces = std::mem::take(&mut self.modules.outside_forces);
        kernel::proxies::set_from_masses(self.scheme, self.modules);
        kernel::compute_link_forces(self.scheme, self.gates, self.modules, self.scratch, self.team);
        kernel::proxies::distribute_forces(self.scheme, self.modules);
        self.modules.outside_forces = outside_forces;
    }

    fn mat_motion(&mut self) -> MatMotion<'_> {
        MatMotion {
            ties: self.scheme.mat_coefficients(),
            force: &mut self.modules.force,
            x: &mut self.modules.x,
            d: &mut self.modules.d,
        }
    }
}
