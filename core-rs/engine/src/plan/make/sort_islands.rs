//! Sorts the islands of a network by what becomes of them: stepped or by modes, as oscillators, only seen, or left out.

use std::collections::BTreeSet;

use super::PlanBuilder;
use crate::assembly::cells;
use crate::assembly::islands::IslandMembers;
use crate::assembly::seen;
use crate::interrupt;
use crate::network::{Error, Subset};
use crate::plan::row::{LeftOutReason, PlanRow};
use crate::scheme::Scheme;
use crate::timeline::Timeline;

/// The islands of a network by what becomes of them.
pub(super) struct SortedIslands {
    /// Those that are stepped or go by modes, then all loose MATs as one.
    pub(super) subsets: Vec<Subset>,
    /// The number of subsets without the loose MATs.
    pub(super) n_islands: usize,
    /// What is seen but not heard.
    pub(super) displayed_unheard: Vec<IslandMembers>,
    pub(super) refusals: Vec<Error>,
}

/// The number of modules of a subset.
pub(super) fn subset_size(subset: &Subset) -> usize {
    subset.network.n_mat() + subset.network.n_lia()
}

/// Modules that are computed because they are heard: those that nothing plays leave the trials as they are.
pub(super) fn n_heard_modules(islands: &[IslandMembers]) -> usize {
    let computed_islands = islands.iter().filter(|island| island.is_heard && island.can_move);
    computed_islands
        .map(|island| island.mats.len() + island.links.len())
        .sum()
}

impl PlanBuilder<'_> {
    /// Sorts islands, and reports those that are not computed.
    pub(super) fn sort_islands(&mut self, all_islands: Vec<IslandMembers>, timeline: &Timeline) -> SortedIslands {
        let network = self.plan.network.clone();
        let (mut refusals, mut displayed_only) = (Vec::new(), Vec::new());
        let (mut uncoupled_mats, mut subsets, mut gliding_mats) = (Vec::new(), Vec::new(), Vec::new());
        let glide_mats = timeline.glides.iter().map(|glide| glide.mat as u32);
        let glide_mats: BTreeSet<u32> = glide_mats.collect();
        for island in all_islands {
            interrupt::poll();
            let is_gliding = |mat: &u32| glide_mats.contains(mat);
            let is_uncoupled =
                || self.budget.allows_modes() && cells::is_uncoupled_cell(&network, &island, timeline.rate);
            if !island.can_move {
                self.plan.motionless_mats.extend(&island.mats);
            }
            match (island.is_heard, island.can_move) {
                (false, is_moved) => {
                    self.add_omitted_row(&island, LeftOutReason::Unheard);
                    if is_moved && seen::is_displayed(&network, &island, self.displayed_parts) {
                        displayed_only.push(island);
                    }
                }
                (true, false) => {
                    refusals.extend(self.add_constant(&island).err());
                    self.add_omitted_row(&island, LeftOutReason::Motionless);
                }
                (true, true) if is_uncoupled() => uncoupled_mats.extend(island.mats),
                // Gliding cells are stepped as one island: one island for each would take far longer.
                (true, true) if island.links.is_empty() && island.mats.iter().all(is_gliding) => {
                    gliding_mats.extend(island.mats);
                }
                (true, true) => {
                    subsets.push(network.subset(&island.mats, &island.foreign_held_mats, &island.links));
                }
            }
        }
        if !gliding_mats.is_empty() {
            subsets.push(network.subset(&gliding_mats, &[], &[]));
        }
        let n_islands = subsets.len();
        if !uncoupled_mats.is_empty() {
            subsets.push(network.subset(&uncoupled_mats, &[], &[]));
        }
        SortedIslands {
            subsets,
            n_islands,
            displayed_unheard: displayed_only,
            refusals,
        }
    }

    /// Reports an island that is not computed, in one row with others of its part.
    fn add_omitted_row(&mut self, island: &IslandMembers, reason: LeftOutReason) {
        let new_row = PlanRow::left_out(&self.plan.network, island, reason);
        if new_row.n_mats + new_row.n_links == 0 {
            return; // points that hold nothing
        }
        let is_same_row = |existing_row: &&mut PlanRow| {
            existing_row.computation == new_row.computation && existing_row.parts == new_row.parts
        };
        match self.plan.rows.iter_mut().find(is_same_row) {
            Some(existing_row) => {
                existing_row.n_mats += new_row.n_mats;
                existing_row.n_links += new_row.n_links;
            }
            None => self.plan.rows.push(new_row),
        }
    }

    /// Adds what outputs hear of modules that never move.
    fn add_constant(&mut self, island: &IslandMembers) -> Result<(), Error> {
        let island_subset = self
            .plan
            .network
            .subset(&island.mats, &island.foreign_held_mats, &island.links);
        let scheme = Scheme::new(&island_subset.network, self.plan.timeline_rate)?;
        let mut rest_outputs = vec![0.0; island_subset.outputs.len()];
        crate::island::outputs_at_rest(&island_subset.network, &scheme, &mut rest_outputs);
        for (&output, rest_level) in island_subset.outputs.iter().zip(rest_outputs) {
            self.plan.output_offsets[output as usize] += rest_level;
        }
        Ok(())
    }
}
