//! The pilot of an island, or the record of an earlier one.

use super::Maker;
use crate::network::{Error, Subset};
use crate::plan::budget::Budget;
use crate::plan::choice::SteppedChoice;
use crate::plan::passes::assemble::{Assembled, How};
use crate::plan::passes::split::OwnTimeline;
use crate::plan::report::content::IslandContent;
use crate::plan::report::row::Measured;
use crate::plan::trial::pilot;
use crate::plan::trial::pilot_result::{ChosenIsland, PilotResult};
use crate::plan::trial::record::Series;

impl Maker<'_> {
    /// Decides an island by its pilot, and by one of a stricter budget if the error of the first grows beyond the budget
    /// after its end.
    pub(super) fn choose_by_pilot(
        &self,
        subset: &Subset,
        island_timeline: &OwnTimeline,
        assemble: &impl Fn(How<'_>) -> Result<Assembled, Error>,
    ) -> Result<ChosenIsland, Error> {
        let known = (&self.allowance, self.store);
        let result = self.pilot((subset, island_timeline), self.budget, assemble)?;
        let first_error = result.chosen.error;
        let chosen = result.extend_error(self.budget, known)?;
        let Some(stricter) = chosen.stricter(first_error, self.budget) else {
            return Ok(chosen);
        };
        let result = self.pilot((subset, island_timeline), &stricter, assemble)?;
        let other = result.extend_error(&stricter, known)?;
        let is_within = |error: Measured| match self.budget {
            Budget::Cents { .. } => error.excess(self.budget) <= 1.0,
            Budget::Error(_) | Budget::Method(_) => {
                error.spectral.is_none() && error.db <= self.budget.asked()
            }
        };
        Ok(match other.error.is_some_and(is_within) {
            true => other,
            false => chosen,
        })
    }

    /// The result of a pilot, or the record of an earlier one that would find the same.
    fn pilot(
        &self,
        (subset, island_timeline): (&Subset, &OwnTimeline),
        budget: &Budget,
        assemble: &impl Fn(How<'_>) -> Result<Assembled, Error>,
    ) -> Result<PilotResult, Error> {
        let is_tried = !matches!(budget, Budget::Method(_)) && !island_timeline.timeline.is_open;
        let series = self.store.filter(|_| is_tried).map(|store| {
            let also = format_args!("pilot {budget:?}");
            Series::new(
                store,
                IslandContent::new(&subset.network, &island_timeline.timeline, also),
            )
        });
        let recalled = series.as_ref().and_then(|series| {
            let (taken, record) = series.find(&self.allowance)?;
            let assemble = |how: How<'_>, pin: Option<&SteppedChoice>| {
                Assembled::new(subset, island_timeline, self.budget, how, pin, &self.memo)
            };
            let result = PilotResult::recalled(&record, &assemble)?;
            // The record includes the work of solving bodies.
            self.memo.take_work();
            self.allowance.replay(&taken);
            Some(result)
        });
        if let Some(result) = recalled {
            return Ok(result);
        }
        let left = self.allowance.begin();
        let result = pilot::pilot(assemble, budget, &self.allowance)?;
        if let Some(series) = &series {
            series.keep(&self.allowance, left, result.record());
        }
        Ok(result)
    }
}
