//! What was decided for each island, stored for drafts: an island goes by what an earlier plan has decided, or else is
//! planned at a low cost.
//!
//! Sound that an earlier render has computed can be recalled if its island is planned as it was then. No other plan
//! reads these decisions, so a draft changes none.

use super::PlanBuilder;
use crate::assembly::budget::Budget;
use crate::assembly::choice::{Choice, PinnedChoices};
use crate::assembly::split::LocalTimeline;
use crate::content::island::IslandContent;
use crate::network::{Error, Subset};
use crate::plan::trial::record::TrialRecord;

impl<'a> PlanBuilder<'a> {
    /// Plans an island, and stores what was decided; of a draft, as was decided before, if anything was.
    pub(super) fn island_from_store(&mut self, subset: Subset, island_timeline: LocalTimeline) -> Result<(), Error> {
        let Some(store) = self.trial_store.filter(|_| !island_timeline.timeline.is_open) else {
            return self.plan_island(subset, island_timeline);
        };
        // Whatever happens when: an island with other strikes goes by the same decision.
        let label = format_args!("choice {:?}", self.budget);
        let key = IslandContent::new(&subset.network, &island_timeline.timeline, label).static_hash();
        let stored_choice = store.get(&key).and_then(|record| choice_of_record(&record));
        if let Some(draft_budget) = self.draft_budget {
            return self.plan_drafted(subset, island_timeline, stored_choice, draft_budget);
        }
        self.plan_island(subset, island_timeline)?;
        let choice = self.plan.choices.last();
        if let Some(choice) = choice.filter(|choice| stored_choice.as_ref() != Some(choice)) {
            store.put(&key, record_of_choice(choice));
        }
        Ok(())
    }

    /// Plans an island as was decided before, or else by the budget of drafts.
    fn plan_drafted(
        &mut self,
        subset: Subset,
        island_timeline: LocalTimeline,
        stored_choice: Option<Choice>,
        draft_budget: &'a Budget,
    ) -> Result<(), Error> {
        let counts_before = self.counts();
        if let Some(choice) = stored_choice {
            self.pins = PinnedChoices::new(Some(vec![choice]));
            let stored_result = self.plan_island(subset.clone(), island_timeline.clone());
            self.pins = PinnedChoices::new(None);
            if stored_result.is_ok() {
                return stored_result;
            }
            self.truncate(counts_before);
        }
        let budget = std::mem::replace(&mut self.budget, draft_budget);
        let drafted_result = self.plan_island(subset, island_timeline);
        self.budget = budget;
        let [_, first_row, ..] = counts_before;
        let drafted_rows = self.plan.rows[first_row..].iter_mut();
        drafted_rows.for_each(|row| row.is_drafted = true);
        drafted_result
    }
}

/// A record of what was decided: first its numbers, then those of each body.
fn record_of_choice(choice: &Choice) -> TrialRecord {
    let (modules, oversampling, contact_substeps, bodies, counted_cost, contact_order) = choice.numbers();
    let counted_cost = counted_cost.map_or(0, |cost| cost.saturating_add(1));
    let sizes = [modules, contact_substeps].map(|size| u32::try_from(size).unwrap_or(u32::MAX));
    let choice_counts = vec![sizes[0], oversampling, sizes[1], counted_cost, contact_order];
    TrialRecord::without_trial(Vec::new(), [vec![choice_counts], bodies].concat())
}

/// What was decided by a record; `None` if it says nothing of the kind.
fn choice_of_record(record: &TrialRecord) -> Option<Choice> {
    let (choice_counts, bodies) = record.counts.split_first().filter(|_| record.is_without_trial())?;
    let [modules, oversampling, contact_substeps, counted_cost, contact_order] = choice_counts[..] else {
        return None;
    };
    let numbers = (
        modules as usize,
        oversampling,
        contact_substeps as usize,
        bodies.to_vec(),
        counted_cost.checked_sub(1),
        contact_order,
    );
    Choice::from_numbers(numbers).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn record_of_a_choice_and_back() {
        for counted_cost in [None, Some(0), Some(70)] {
            let numbers = (9, 2, 3, vec![vec![0, 1, 4], vec![2, 5]], counted_cost, 4);
            let choice = Choice::from_numbers(numbers).unwrap();
            assert_eq!(choice_of_record(&record_of_choice(&choice)), Some(choice));
        }
        assert_eq!(choice_of_record(&TrialRecord::default()), None);
    }
}
