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
        let is_made_for =
            |[before, after]: &[Arc<Plan>; 2]| Arc::ptr_eq(before, &old.plan) && Arc::ptr_eq(after, &self.plan);
        // A takeover without plans (`Takeover::default`) transfers no modules: the new simulation begins anew.
        if self.frame != old.frame || !takeover.plans.as_ref().is_none_or(is_made_for) {
            return false;
        }
        self.derivatives.take_over(&old.derivatives, &takeover.outputs);
        self.sounds_in.take_over(&old.sounds_in);
        for &(old_unit, new_unit) in &takeover.units {
            match (self.playing(new_unit), old.playing(old_unit)) {
                (RunningUnit::Island(running), RunningUnit::Island(old_island)) => running.continue_from(old_island),
                (RunningUnit::Bank(running), RunningUnit::Bank(old_bank)) => running.continue_from(old_bank),
                _ => {}
            }
        }
        for &(old_unit, new_unit, n) in &takeover.modes {
            if let (RunningUnit::Bank(running), RunningUnit::Bank(old)) =
                (self.playing(new_unit), old.playing(old_unit))
            {
                (0..n).for_each(|mode| running.copy_motion(mode, old, mode));
            }
        }
        let Takeover {
            mats,
            old_bodies: from,
            new_bodies: to,
            workspace,
            ..
        } = takeover;
        from.iter().for_each(|body| body.read_masses(old, workspace));
        for &(old_location, new_location) in &*mats {
            self.pass(old, workspace, old_location, new_location);
        }
        to.iter_mut().for_each(|body| body.write_masses(self, workspace));
        for (old_unit, new_unit, item) in &takeover.items {
            if let (RunningUnit::Island(running), RunningUnit::Island(old)) =
                (self.playing(*new_unit), old.playing(*old_unit))
            {
                running.take_over(item, old);
            }
        }
        for &unit in &takeover.placed_islands {
            if let RunningUnit::Island(island) = self.playing(unit) {
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

    pub(in crate::simulation) fn playing(&mut self, (group, unit): UnitIndex) -> &mut RunningUnit {
        &mut self.groups[group].units[unit]
    }

    /// Transfers the motion of one MAT.
    fn pass(&mut self, old: &mut Self, workspace: &mut Workspace, from: MatLocation, to: MatLocation) {
        let mat_motion = match from {
            MatLocation::Workspace(slot) => workspace.mats[slot],
            MatLocation::Island(unit_index, mat) => match old.playing(unit_index) {
                RunningUnit::Island(island) => island.motion(mat),
                RunningUnit::Bank(_) => return,
            },
            MatLocation::Bank(unit_index, old_oscillator, rest) => match old.playing(unit_index) {
                RunningUnit::Bank(bank) => {
                    if let MatLocation::Bank(unit_index, new_oscillator, rest_here) = to
                        && rest_here == rest
                        && let RunningUnit::Bank(new_bank) = self.playing(unit_index)
                    {
                        new_bank.copy_motion(new_oscillator, bank, old_oscillator);
                        return;
                    }
                    let (displacement, displacement_before) = bank.motion(old_oscillator);
                    (displacement + rest, displacement - displacement_before)
                }
                RunningUnit::Island(_) => return,
            },
        };
        match to {
            MatLocation::Workspace(slot) => workspace.mats[slot] = mat_motion,
            MatLocation::Island(unit_index, mat) => {
                if let RunningUnit::Island(island) = self.playing(unit_index) {
                    island.set_motion(mat, mat_motion);
                }
            }
            MatLocation::Bank(unit_index, oscillator, rest) => {
                if let RunningUnit::Bank(bank) = self.playing(unit_index) {
                    let displacement = mat_motion.0 - rest;
                    bank.set_motion(oscillator, (displacement, displacement - mat_motion.1));
                }
            }
        }
    }
}
