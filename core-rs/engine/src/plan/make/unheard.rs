//! Plans what is seen but not heard: without trials, and at a lower rate if the score asks for one.
//!
//! This takes no allowance from what is heard. At a lower rate the error against the rate of the score is measured,
//! with an allowance of its own.

use std::sync::Arc;

use super::PlanBuilder;
use crate::assembly::budget::Budget;
use crate::assembly::cells;
use crate::assembly::islands::IslandMembers;
use crate::assembly::seen;
use crate::assembly::split::{LocalTimeline, split};
use crate::assembly::unit::ComputationUnit;
use crate::body_modes::linear::NoModes;
use crate::network::{Error, Network, Subset};
use crate::plan::trial::allowance::{Allowance, allowance_of_plan};
use crate::plan::trial::displayed_rate;
use crate::plan::{Plan, PlanContext};
use crate::timeline::Timeline;

/// Plans the islands that are seen but not heard.
pub(super) fn plan_displayed_islands(
    network: &Arc<Network>,
    timeline: &Timeline,
    budget: &Budget,
    context: PlanContext<'_>,
    unheard: Vec<IslandMembers>,
) -> Result<Plan, Error> {
    let module_count = network.n_mat() + network.n_lia();
    let (budget, share) = context.draft.map_or((budget, context.allowance_share), |draft| {
        (draft.budget, draft.allowance_share)
    });
    let allowance = Allowance::with_seconds(allowance_of_plan(module_count, share));
    let mut builder = PlanBuilder {
        frame_interval: context.displayed_frame_interval,
        ..PlanBuilder::new(network, timeline, budget)
    };
    let is_uncoupled =
        |members: &IslandMembers| budget.allows_modes() && cells::is_uncoupled_cell(network, members, timeline.rate);
    let (subsets, n_islands) = seen::subsets(network, unheard, is_uncoupled)?;
    for (index, (subset, island_timeline)) in split(subsets, timeline).into_iter().enumerate() {
        if index >= n_islands {
            builder.plan_cells(&subset, &island_timeline)?;
            continue;
        }
        let first_row = builder.plan.rows.len();
        builder.plan_island(subset.clone(), island_timeline.clone())?;
        if let Some(ComputationUnit::IslandPlan(island_plan)) = builder.plan.units.last()
            && island_plan.frame_interval > 1
        {
            let island_context = (&subset, &island_timeline, budget);
            let rate_error = displayed_rate::lower_rate_error(
                island_plan,
                island_context,
                (&builder.mode_cache, &allowance, context.trial_store),
            )?;
            let island_rows = builder.plan.rows[first_row..].iter_mut();
            island_rows.for_each(|row| row.error = rate_error);
        }
    }
    Ok(builder.plan)
}

impl PlanBuilder<'_> {
    /// Plans an island at the lowest rate at which it works, at least once in `self.frame_interval` frames.
    pub(super) fn plan_at_lower_rate(
        &mut self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        module_count: usize,
        modes_refusal: Option<NoModes>,
    ) -> Result<(), Error> {
        let network_parts = subset.network.parts();
        let mut mat_parts = subset.network.mats().part.iter();
        // A discrete network that is the reference has only one rate.
        let is_discrete = mat_parts.any(|&part| network_parts[part as usize].ca_rate.is_some());
        // If the whole island has a lower rate, its parts have none of their own.
        let uniform_subset = Subset {
            network: subset.network.with_macrosteps(|_, _| None),
            ..subset.clone()
        };
        let mut frame_interval = if is_discrete { 1 } else { self.frame_interval };
        while frame_interval > 1 {
            let counts_before = self.counts();
            let slower_timeline = island_timeline.with_lower_rate(frame_interval);
            let is_planned = slower_timeline.is_some_and(|slower_timeline| {
                self.plan_stepped(
                    &uniform_subset,
                    &slower_timeline,
                    module_count,
                    None,
                    modes_refusal.clone(),
                )
                .is_ok()
            });
            if is_planned && self.set_frame_interval(counts_before, frame_interval) {
                return Ok(());
            }
            self.truncate(counts_before);
            frame_interval /= 2;
        }
        let [_, first_row, ..] = self.counts();
        self.plan_stepped(subset, island_timeline, module_count, None, modes_refusal)?;
        let rate_refusal = if is_discrete {
            "its numbers are those of one rate (`units: ca`)"
        } else if island_timeline.with_lower_rate(self.frame_interval).is_none() {
            "it is played live, or a gesture is too fast for a slower one"
        } else {
            "it is not stable at a slower one"
        };
        let new_rows = self.plan.rows[first_row..].iter_mut();
        new_rows.for_each(|row| row.rate_refusal = Some(rate_refusal.to_owned()));
        Ok(())
    }

    /// The numbers of units, rows, choices and staying parts planned so far.
    pub(super) fn counts(&self) -> [usize; 4] {
        let current_plan = &self.plan;
        [
            current_plan.units.len(),
            current_plan.rows.len(),
            current_plan.choices.len(),
            current_plan.refused_rates.len(),
        ]
    }

    /// Takes back what was planned beyond these numbers.
    pub(super) fn truncate(&mut self, [unit_count, row_count, choice_count, refusal_count]: [usize; 4]) {
        self.plan.units.truncate(unit_count);
        self.plan.rows.truncate(row_count);
        self.plan.choices.truncate(choice_count);
        self.plan.refused_rates.truncate(refusal_count);
    }

    /// Sets what was just planned to be computed once in `frame_interval` frames. Returns false if it would then still
    /// take as many steps as frames.
    fn set_frame_interval(&mut self, [first_unit, first_row, ..]: [usize; 4], frame_interval: u32) -> bool {
        for unit in &mut self.plan.units[first_unit..] {
            if let ComputationUnit::IslandPlan(island_plan) = unit {
                if island_plan.oversampling >= frame_interval {
                    return false;
                }
                island_plan.frame_interval = frame_interval;
            }
        }
        for row in &mut self.plan.rows[first_row..] {
            row.frame_interval = frame_interval;
            // Only trials of what is heard count as cut short.
            row.trials_cut_short = false;
        }
        true
    }
}
