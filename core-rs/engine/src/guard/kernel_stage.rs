//! Lets the guard step an island, by the kernels.

use super::{MatMotion, Stage};
use crate::kernel;
use crate::kernel::KernelScratch;
use crate::kernel::thread_team::ThreadTeam;
use crate::scheme::Scheme;
use crate::state::Body;

pub(crate) struct KernelStage<'a, 'b> {
    pub(crate) scheme: &'a Scheme,
    pub(crate) gates: &'a [f64],
    pub(crate) body: &'a mut Body,
    pub(crate) laws: &'a mut KernelScratch,
    pub(crate) team: &'a mut ThreadTeam<'b>,
}

impl Stage for KernelStage<'_, '_> {
    fn compute_link_forces(&mut self) {
        // The ledger still needs the outside forces of this frame.
        let outside = std::mem::take(&mut self.body.outside);
        kernel::proxies::set_from_masses(self.scheme, self.body);
        kernel::compute_link_forces(self.scheme, self.gates, self.body, self.laws, self.team);
        kernel::proxies::distribute_forces(self.scheme, self.body);
        self.body.outside = outside;
    }

    fn mat_motion(&mut self) -> MatMotion<'_> {
        MatMotion {
            ties: self.scheme.mat_coefficients(),
            force: &mut self.body.force,
            x: &mut self.body.x,
            d: &mut self.body.d,
        }
    }
}
