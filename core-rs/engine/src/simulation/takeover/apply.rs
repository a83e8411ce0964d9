//! The takeover itself: transfers what [`Takeover::new`] has found, without allocating.

use std::sync::Arc;

use super::Takeover;
use crate::plan::Plan;
use crate::simulation::bodies::Workspace;
use crate::simulation::side::{MatLocation, UnitIndex};
use crate::simulation::{RunningUnit, Simulation};

impl Simulation {
    /// Transfer the state of `old`, consuming it. Returns false, and transfers nothing, if the two are at different
    /// frames or have other plans than those that `takeover` was made for. Does not allocate.
    pub fn take_over(&mut self, old: &mut Self, takeover: &mut Takeover) -> bool {
        let is_made_for = |[old_plan, new_plan]: &[Arc<Plan>; 2]| {
            Arc::ptr_eq(old_plan, &old.plan) && Arc::ptr_eq(new_plan, &self.plan)
        };
        // A takeover without plans (`Takeover::default`) transfers no modules: the new simulation begins anew.
        if self.frame != old.frame || !takeover.plans.as_ref().is_none_or(is_made_for) {
            return false;
        }
        self.derivatives
            .take_over(&old.derivatives, &takeover.new_output_indices);
        self.sounds_in.take_over(&old.sounds_in);
        for &(old_unit, new_unit) in &takeover.same_units {
            match (self.unit_mut(new_unit), old.unit_mut(old_unit)) {
                (RunningUnit::Island(running), RunningUnit::Island(old_island)) => running.continue_from(old_island),
                (RunningUnit::Bank(running), RunningUnit::Bank(old_bank)) => running.continue_from(old_bank),
                _ => {}
            }
        }
        for &(old_unit, new_unit, mode_count) in &takeover.same_mode_banks {
            if let (RunningUnit::Bank(running), RunningUnit::Bank(old)) =
                (self.unit_mut(new_unit), old.unit_mut(old_unit))
            {
                (0..mode_count).for_each(|mode| running.copy_motion(mode, old, mode));
            }
        }
        let Takeover {
            mat_pairs,
            old_bodies,
            new_bodies,
            workspace,
            ..
        } = takeover;
        old_bodies.iter().for_each(|body| body.read_masses(old, workspace));
        for &(old_location, new_location) in &*mat_pairs {
            self.transfer_mat_motion(old, workspace, old_location, new_location);
        }
        new_bodies
            .iter_mut()
            .for_each(|body| body.write_masses(self, workspace));
        for (old_unit, new_unit, item) in &takeover.items {
            if let (RunningUnit::Island(running), RunningUnit::Island(old)) =
                (self.unit_mut(*new_unit), old.unit_mut(*old_unit))
            {
                running.take_over(item, old);
            }
        }
        for &unit in &takeover.islands_to_place {
            if let RunningUnit::Island(island) = self.unit_mut(unit) {
                island.set_ports();
            }
        }
        self.continue_strikes(old);
        self.continue_ramps(old);
        true
    }

    /// Let live strikes that still act act on.
    fn continue_strikes(&mut self, old: &Self) {
        let old_units = old.groups.iter().flat_map(|group| &group.units);
        for old_unit in old_units {
            let RunningUnit::Island(old_island) = old_unit else {
                continue;
            };
            let running_units = self.groups.iter_mut().flat_map(|group| &mut group.units);
            for unit in running_units {
                if let RunningUnit::Island(island) = unit {
                    island.continue_strikes(old_island);
                }
            }
        }
    }

    pub(in crate::simulation) fn unit_mut(&mut self, (group, unit): UnitIndex) -> &mut RunningUnit {
        &mut self.groups[group].units[unit]
    }

    /// Transfers the motion of one MAT.
    fn transfer_mat_motion(
        &mut self,
        old: &mut Self,
        workspace: &mut Workspace,
        old_location: MatLocation,
        new_location: MatLocation,
    ) {
        let mat_motion = match old_location {
            MatLocation::Workspace(slot) => workspace.mass_motions[slot],
            MatLocation::Island(unit_index, mat) => match old.unit_mut(unit_index) {
                RunningUnit::Island(island) => island.motion(mat),
                RunningUnit::Bank(_) => return,
            },
            MatLocation::Bank(unit_index, old_oscillator, old_rest) => match old.unit_mut(unit_index) {
                RunningUnit::Bank(bank) => {
                    if let MatLocation::Bank(unit_index, new_oscillator, new_rest) = new_location
                        && new_rest == old_rest
                        && let RunningUnit::Bank(new_bank) = self.unit_mut(unit_index)
                    {
                        new_bank.copy_motion(new_oscillator, bank, old_oscillator);
                        return;
                    }
                    let (displacement, displacement_before) = bank.motion(old_oscillator);
                    (displacement + old_rest, displacement - displacement_before)
                }
                RunningUnit::Island(_) => return,
            },
        };
        match new_location {
            MatLocation::Workspace(slot) => workspace.mass_motions[slot] = mat_motion,
            MatLocation::Island(unit_index, mat) => {
                if let RunningUnit::Island(island) = self.unit_mut(unit_index) {
                    island.set_motion(mat, mat_motion);
                }
            }
            MatLocation::Bank(unit_index, oscillator, rest) => {
                if let RunningUnit::Bank(bank) = self.unit_mut(unit_index) {
                    let displacement = mat_motion.0 - rest;
                    bank.set_motion(oscillator, (displacement, displacement - mat_motion.1));
                }
            }
        }
    }
}
