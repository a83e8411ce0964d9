//! Energy that hands and imposed paths put into an island.

use crate::kernel;
use crate::scheme::Scheme;
use crate::state::{ImposedTarget, ModuleState};

/// The work of what imposes the motion of MATs, so far.
#[derive(Clone, Debug, Default)]
pub(super) struct ImposedWork {
    /// In the step before, of each imposed MAT: the force that held it on its way [N], and its last step [m].
    previous_forces_and_steps: Vec<(usize, [f64; 2])>,
    work: f64,
    /// The most of `work` [J].
    work_max: f64,
}

crate::archive::state!(ImposedWork { work, work_max });

impl ImposedWork {
    /// Reserve room for this many MATs, so that steps do not allocate.
    pub(super) fn reserve(&mut self, n_targets: usize) {
        self.previous_forces_and_steps.reserve(n_targets);
    }

    /// Whether a step in which nothing is imposed changes nothing.
    pub(super) fn is_idle(&self) -> bool {
        self.previous_forces_and_steps.is_empty() && self.work_max >= self.work
    }

    /// The most energy that was put in at any time, less what was taken out until then [J].
    pub(super) fn work_max(&self) -> f64 {
        self.work_max
    }

    /// Account for a step in which all forces are known and MATs have not moved yet.
    pub(super) fn step(&mut self, scheme: &Scheme, targets: &[ImposedTarget], modules: &ModuleState) {
        for (mat, [holding_force, last_step]) in self.previous_forces_and_steps.drain(..) {
            self.work += 0.5 * (last_step + modules.d[mat]) * holding_force;
        }
        self.work_max = self.work_max.max(self.work);
        self.previous_forces_and_steps.extend(targets.iter().map(|target| {
            let mat = target.mat;
            let holding_force = match scheme.w[mat] {
                0.0 => -modules.force[mat],
                _ => kernel::force_to_reach(scheme, modules, mat, target.x),
            };
            (mat, [holding_force, modules.d[mat]])
        }));
    }
}
