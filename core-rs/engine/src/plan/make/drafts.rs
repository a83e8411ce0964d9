//! Drafts, island by island: by the plan that an earlier render has made, or else at a low cost.
//!
//! Sound that an earlier render has computed can be recalled if its island is planned as it was then. That takes no
//! trial if the results of all of them are stored. Every other island is planned anew, for a larger error and with few
//! trials. What a draft stores is what it found out for its own budget, so no other plan changes by it.

use super::Maker;
use crate::network::{Error, Subset};
use crate::plan::budget::Budget;
use crate::plan::passes::split::OwnTimeline;
use crate::plan::report::content::IslandContent;
use crate::plan::trial::allowance::Allowance;
use crate::plan::trial::record::TrialRecord;
use crate::plan::{Draft, Known};

/// How the islands are planned that no earlier plan has tried.
pub(super) struct Drafting<'a> {
    budget: &'a Budget,
    allowance: Allowance,
    /// How many islands were planned so.
    n_islands: usize,
}

impl<'a> Drafting<'a> {
    pub(super) fn new(draft: Draft<'a>, n_modules: usize) -> Self {
        Self {
            budget: draft.budget,
            allowance: Allowance::new(n_modules, draft.share),
            n_islands: 0,
        }
    }
}

/// The allowance of a plan of `n_modules`. Where the rest is drafted, it plays no trial.
pub(super) fn allowance(n_modules: usize, known: Known<'_>) -> Allowance {
    let allowance = Allowance::new(n_modules, known.share);
    match known.draft {
        Some(_) => allowance.for_known(),
        None => allowance,
    }
}

impl Maker<'_> {
    /// Plans an island as an earlier plan did, or drafts it if no earlier plan has tried it.
    pub(super) fn island_or_draft(&mut self, subset: Subset, island_timeline: OwnTimeline) -> Result<(), Error> {
        if self.draft.is_none() {
            return self.island(subset, island_timeline);
        }
        let (counts_before, allowance_before) = (self.counts(), self.allowance.clone());
        let known_result = self.island(subset.clone(), island_timeline.clone());
        if known_result.is_ok() && !self.allowance.is_missed() {
            return Ok(());
        }
        self.truncate(counts_before);
        self.allowance = allowance_before;
        self.allowance.forgive();
        let Some(mut drafting) = self.draft.take() else {
            return known_result;
        };
        std::mem::swap(&mut self.budget, &mut drafting.budget);
        std::mem::swap(&mut self.allowance, &mut drafting.allowance);
        let drafted_result = self.island(subset, island_timeline);
        std::mem::swap(&mut self.budget, &mut drafting.budget);
        std::mem::swap(&mut self.allowance, &mut drafting.allowance);
        drafting.n_islands += 1;
        self.draft = Some(drafting);
        let [_, first_row, ..] = counts_before;
        self.plan.rows[first_row..]
            .iter_mut()
            .for_each(|row| row.is_drafted = true);
        drafted_result
    }

    /// Whether a bank may be planned by the present budget: always, but where drafts are made only if an earlier plan
    /// did so. A bank takes no trials, so that a record without numbers says it.
    pub(super) fn may_use_bank(&self, subset: &Subset, island_timeline: &OwnTimeline) -> bool {
        let Some(store) = self.store.filter(|_| !matches!(self.budget, Budget::Method(_))) else {
            return true;
        };
        let label = format_args!("bank {:?}", self.budget);
        let key = IslandContent::new(&subset.network, &island_timeline.timeline, label).fixed();
        let is_known = store.get(&key).is_some();
        if self.draft.is_some() && !is_known {
            self.allowance.miss();
            return false;
        }
        if !is_known {
            store.put(&key, TrialRecord::without_trial(Vec::new(), Vec::new()));
        }
        true
    }

    /// Work that trials have taken in this plan, and the most that they may [s].
    pub(super) fn trials(&self) -> (f64, f64) {
        let drafting = self.draft.as_ref().filter(|drafting| drafting.n_islands > 0);
        drafting.map_or(&self.allowance, |drafting| &drafting.allowance).spent()
    }
}
