//! The pilot of an island, or the record of an earlier one.

use super::PlanBuilder;
use crate::assembly::assemble::{Assembled, AssemblyOptions};
use crate::assembly::budget::Budget;
use crate::assembly::choice::SteppedChoice;
use crate::assembly::split::LocalTimeline;
use crate::content::island::IslandContent;
use crate::network::{Error, Subset};
use crate::plan::row::MeasuredError;
use crate::plan::trial::candidates::CostRule;
use crate::plan::trial::pilot;
use crate::plan::trial::pilot_result::{ChosenIsland, PilotResult};
use crate::plan::trial::record::TrialSeries;

impl PlanBuilder<'_> {
    /// Decides an island by its pilot, and by one of a stricter budget if the error of the first grows beyond the
    /// budget after its end.
    pub(super) fn choose_by_pilot(
        &self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        assemble: &impl Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>,
    ) -> Result<ChosenIsland, Error> {
        let trial_context = (&self.allowance, self.trial_store);
        let pilot_result = self.find_pilot_result((subset, island_timeline), self.budget, CostRule::Mean, assemble)?;
        let first_error = pilot_result.chosen.measured_error;
        let chosen = pilot_result.extend_error(self.budget, trial_context)?;
        let Some(stricter_budget) = chosen.stricter_budget(first_error, self.budget) else {
            return Ok(chosen);
        };
        let pilot_result =
            self.find_pilot_result((subset, island_timeline), &stricter_budget, CostRule::Mean, assemble)?;
        let stricter_island = pilot_result.extend_error(&stricter_budget, trial_context)?;
        let is_within = |error: MeasuredError| match self.budget {
            Budget::Cents { .. } => error.budget_excess(self.budget) <= 1.0,
            Budget::Error(_) | Budget::Method(_) => error.is_regular_within(self.budget),
        };
        let is_exact = stricter_island.island.is_discrete_reference() && stricter_island.measured_error.is_none();
        Ok(
            match is_exact || stricter_island.measured_error.is_some_and(is_within) {
                true => stricter_island,
                false => chosen,
            },
        )
    }

    /// The result of a pilot, or the record of an earlier one that would find the same.
    pub(super) fn find_pilot_result(
        &self,
        (subset, island_timeline): (&Subset, &LocalTimeline),
        budget: &Budget,
        cost_rule: CostRule,
        assemble: &impl Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>,
    ) -> Result<PilotResult, Error> {
        let needs_trials = !matches!(budget, Budget::Method(_));
        let trial_series = self.trial_store.filter(|_| needs_trials).map(|store| {
            let content_label = format_args!("pilot {budget:?} {cost_rule:?}");
            TrialSeries::new(
                store,
                IslandContent::new(&subset.network, &island_timeline.timeline, content_label),
            )
        });
        let recorded_result = trial_series.as_ref().and_then(|trial_series| {
            let (recorded_work, pilot_record) = trial_series.find_series(&self.allowance)?;
            let assemble = |options: AssemblyOptions<'_>, pin: Option<&SteppedChoice>| {
                Assembled::new(subset, island_timeline, self.budget, options, pin, &self.mode_cache)
            };
            let pilot_result = PilotResult::from_record(&pilot_record, &assemble)?;
            // The record includes the work of solving bodies.
            self.mode_cache.take_seconds();
            self.allowance.replay(&recorded_work);
            Some(pilot_result)
        });
        if let Some(pilot_result) = recorded_result {
            return Ok(pilot_result);
        }
        let allowance_left = self.allowance.begin_series();
        let pilot_result = pilot::choose_by_trials(assemble, budget, &self.allowance, cost_rule)?;
        if let Some(trial_series) = &trial_series {
            trial_series.store(&self.allowance, allowance_left, pilot_result.record());
        }
        Ok(pilot_result)
    }
}
