//! The reference: the most exact run of an island that is worth its work, with a bound of its error.
//!
//! Candidates of several families are played in doubling steps. The change from one run to the next bounds the error of
//! the finer one, for each method is at least of order 1. Families of the highest order come first.

use std::ops::RangeInclusive;
use std::rc::Rc;

use crate::assembly::assemble::{Assembled, AssemblyOptions};
use crate::assembly::budget::Budget;
use crate::assembly::constants::{INAUDIBLE_ERROR_DB, SUBSTEPS_MAX};
use crate::hearing::{Audible, Scatter};
use crate::island::FINE_SUBSTEPS_MIN;
use crate::maths::{amplitude_ratio, pow};
use crate::network::Error;
use crate::plan::constants::{
    CONVERGENCE_ORDERS, DOUBLING_WORK_FACTOR, EQUAL_ERRORS_DB, FAMILY_ALLOWANCE_SHARE, OVERSAMPLING_MAX,
    REFERENCE_ERROR_DB_MAX, REFERENCE_MARGIN_DB, SHORT_RUN_SECONDS, UNCORRELATED_DB,
};
use crate::plan::trial::allowance::{Allowance, TrialError};
use crate::plan::trial::candidates::{Candidate, CandidateFamily, has_fine_links};
use crate::plan::trial::pilot_run::{PilotRun, is_affordable};
use crate::plan::trial::run_cache::RunCache;
use crate::plan::trial::waveform_error::{ComparedSpans, FACTOR_TWO_DB, difference_db};
use crate::waveform::is_still;

/// Contact substeps a step of a reference with laws, which divide a frame only as far as they have to: never a limit.
const REFERENCE_LAW_SUBSTEPS: usize = 4 * SUBSTEPS_MAX;

/// The most exact run.
pub(in crate::plan) struct Reference {
    pub(in crate::plan) candidate: Candidate,
    pub(in crate::plan) run: Rc<PilotRun>,
    /// A bound of its error [dB].
    pub(in crate::plan) error_db: f64,
    /// A bound of its audible error, if the budget is one of pitch.
    pub(in crate::plan) audible_error: Option<Audible>,
}

impl Reference {
    /// Whether it is as exact as a reference should be.
    fn is_exact_enough(&self, budget: &Budget) -> bool {
        match self.audible_error {
            Some(audible) => budget.excess_ratio(&audible) <= amplitude_ratio(-REFERENCE_MARGIN_DB),
            None => self.error_db <= (budget.waveform_error_db() - REFERENCE_MARGIN_DB).min(REFERENCE_ERROR_DB_MAX),
        }
    }

    /// Whether it shows that the motion is not chaotic.
    pub(in crate::plan) fn shows_regular_motion(&self, budget: &Budget) -> bool {
        self.error_db <= INAUDIBLE_ERROR_DB || (self.audible_error.is_some() && self.is_exact_enough(budget))
    }

    /// Whether what differs from it is error, and not the chance of a motion that it does not know.
    pub(in crate::plan) fn scatter(&self) -> Scatter {
        if self.error_db <= INAUDIBLE_ERROR_DB {
            Scatter::Counted
        } else {
            Scatter::Deducted
        }
    }

    /// Whether it has nothing in common with the run before it, by waveform or by ear: how far these two are apart is
    /// chance, and does not say how exact they are.
    fn is_uncorrelated(&self, budget: &Budget) -> bool {
        let is_audibly_apart = self
            .audible_error
            .is_none_or(|audible| budget.excess_ratio(&audible) > 1.0);
        self.error_db > UNCORRELATED_DB && is_audibly_apart
    }

    fn is_better_than(&self, other: &Self, budget: &Budget) -> bool {
        if self.is_uncorrelated(budget) {
            return false;
        }
        match (self.audible_error, other.audible_error) {
            (Some(audible), Some(other_audible)) => budget.excess_ratio(&audible) < budget.excess_ratio(&other_audible),
            _ => self.error_db < other.error_db,
        }
    }
}

/// What a search for a reference plays, and how.
pub(in crate::plan) struct ReferenceSearch<'a, F> {
    pub(in crate::plan) assemble: &'a F,
    pub(in crate::plan) runs: &'a RunCache,
    pub(in crate::plan) spans: &'a ComparedSpans,
    pub(in crate::plan) budget: &'a Budget,
}

/// Finds the reference of an island whose first run was `first`; `None` if no two runs of one family can be played.
pub(in crate::plan) fn find_reference<F: Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>>(
    search: &ReferenceSearch<'_, F>,
    first: &Candidate,
    allowance: &Allowance,
) -> Result<Option<Reference>, TrialError> {
    let budget = search.budget;
    let steps_max = 8 * OVERSAMPLING_MAX;
    let substeps = first_substeps(first);
    let mut best_reference: Option<Reference> = None;
    for family in CandidateFamily::REFERENCE_FAMILIES {
        let family_allowance = allowance.split_off(FAMILY_ALLOWANCE_SHARE);
        let lowest_steps = if family.links_once_per_step {
            OVERSAMPLING_MAX
        } else {
            1
        };
        let family_reference = search.best_of_family((family, substeps), lowest_steps..=steps_max, &family_allowance);
        allowance.spend_split(&family_allowance, FAMILY_ALLOWANCE_SHARE);
        match family_reference {
            // By CA a strike that friction can stop within a step moves nothing, at any rate.
            Ok(Some(reached)) if is_stuck(&reached, family, search.spans) => {}
            Ok(Some(reached)) => {
                if best_reference
                    .as_ref()
                    .is_none_or(|best_reference| reached.is_better_than(best_reference, budget))
                {
                    best_reference = Some(reached);
                }
            }
            Ok(None) | Err(TrialError::AllowanceSpent) => {}
            Err(error) => return Err(error),
        }
        if best_reference
            .as_ref()
            .is_some_and(|best_reference| best_reference.is_exact_enough(budget))
        {
            break;
        }
    }
    Ok(best_reference)
}

/// The reference by ear of the plain ways, from one step a frame on; `None` if it is not exact enough.
pub(in crate::plan) fn once_per_step_reference<F: Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>>(
    search: &ReferenceSearch<'_, F>,
    allowance: &Allowance,
) -> Result<Option<Reference>, TrialError> {
    let family_allowance = allowance.split_off(FAMILY_ALLOWANCE_SHARE);
    let family_reference = search.best_of_family(
        (CandidateFamily::ONCE_PER_STEP, 1),
        1..=2 * OVERSAMPLING_MAX,
        &family_allowance,
    );
    allowance.spend_split(&family_allowance, FAMILY_ALLOWANCE_SHARE);
    match family_reference {
        Ok(reached) => Ok(reached.filter(|reached| reached.is_exact_enough(search.budget))),
        Err(TrialError::AllowanceSpent) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Contact substeps a step of all runs, given the first one.
fn first_substeps(first: &Candidate) -> usize {
    match first.island.can_solve_laws_between_steps {
        true if !first.island.has_dry_friction() => REFERENCE_LAW_SUBSTEPS,
        _ => FINE_SUBSTEPS_MIN,
    }
}

/// Whether dry friction, computed once a step, holds all that is heard.
fn is_stuck(reference: &Reference, family: CandidateFamily, spans: &ComparedSpans) -> bool {
    let island = &reference.candidate.island;
    family.links_once_per_step && island.has_sticking_friction() && is_still(&reference.run.sound, spans.n_out)
}

/// Whether contacts and laws between frames cost more than all of the island by the plain way at the highest rate.
pub(in crate::plan) fn is_cheaper_once_per_step(island: &Assembled) -> bool {
    let mut island_plan = island.island_plan.clone();
    (island_plan.contact_substeps, island_plan.counted_cost) = (1, None);
    let plain_cost = island_plan.frame_ns();
    island_plan.contact_substeps = FINE_SUBSTEPS_MIN;
    island.can_solve_laws_between_steps && island_plan.frame_ns() > f64::from(OVERSAMPLING_MAX) * plain_cost
}

impl<F: Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>> ReferenceSearch<'_, F> {
    /// Plays a family in doubling steps until a run is exact enough, or gains no more. Of a plain family that begins at
    /// one step a frame, three runs have to agree: two that both miss a short contact may agree by chance.
    fn best_of_family(
        &self,
        (family, substeps): (CandidateFamily, usize),
        step_range: RangeInclusive<u32>,
        allowance: &Allowance,
    ) -> Result<Option<Reference>, TrialError> {
        let mut best_reference: Option<Reference> = None;
        // The last two runs.
        let mut last_runs: [Option<Rc<PilotRun>>; 2] = [None, None];
        let mut previous_change_db: Option<f64> = None;
        let mut work_spent = 0.0;
        let is_coarse = family.links_once_per_step && step_range.contains(&1);
        let mut step_count = *step_range.start();
        while step_range.contains(&step_count) {
            let family_member = (self.assemble)(family.options_for_steps(step_count));
            step_count *= 2;
            let Ok(island) = family_member else {
                continue;
            };
            let substeps = if has_fine_links(&island) { substeps } else { 1 };
            let candidate = Candidate::new(island, substeps, None);
            let n_frames = self.runs.excerpt().n_frames;
            let is_paid_for = allowance.share_left(DOUBLING_WORK_FACTOR * work_spent) >= 1.0;
            if !is_affordable(&candidate.island.island_plan, n_frames) || !is_paid_for {
                break;
            }
            let spent_before = allowance.spent_seconds();
            let played_plan = (&candidate.island.island_plan, substeps);
            let run = match self.runs.play(played_plan, allowance) {
                Err(TrialError::AllowanceSpent) if best_reference.is_some() => break,
                run => run?,
            };
            work_spent = allowance.spent_seconds() - spent_before;
            if run.is_unusable {
                last_runs = [None, None];
                continue;
            }
            let [coarsest_run, coarser_run] = last_runs;
            last_runs = [coarser_run.clone(), Some(run.clone())];
            let Some(coarser_run) = coarser_run else {
                continue;
            };
            let run_change = difference_db(&coarser_run.sound, &run.sound, self.spans);
            let change_before = previous_change_db.replace(run_change);
            if is_coarse && change_before.is_none() {
                continue;
            }
            let new_reference = Reference {
                candidate: candidate.with_counted_cost(&run),
                error_db: error_of_finer(run_change, change_before),
                audible_error: self.audible_change(&coarser_run, &run),
                run,
            };
            let gains_by_ear = || {
                let coarser_change = self.audible_change(coarsest_run.as_ref()?, &coarser_run)?;
                let [ratio, ratio_before] =
                    [new_reference.audible_error?, coarser_change].map(|audible| self.budget.excess_ratio(&audible));
                Some(ratio < ratio_before / amplitude_ratio(EQUAL_ERRORS_DB))
            };
            let gains_nothing = change_before.is_some_and(|change_before| run_change > change_before - EQUAL_ERRORS_DB)
                && !gains_by_ear().unwrap_or(false);
            let is_last_run = gains_nothing || new_reference.is_exact_enough(self.budget);
            // Of runs without anything in common the finest says most.
            let is_preferred = best_reference.as_ref().is_none_or(|best_reference| {
                new_reference.is_better_than(best_reference, self.budget) || best_reference.is_uncorrelated(self.budget)
            });
            if is_preferred {
                best_reference = Some(new_reference);
            }
            if is_last_run {
                break;
            }
        }
        Ok(best_reference)
    }

    fn audible_change(&self, coarser_run: &PilotRun, run: &PilotRun) -> Option<Audible> {
        let scatter = if run.work_seconds < SHORT_RUN_SECONDS {
            Scatter::Counted
        } else {
            Scatter::Deducted
        };
        self.spans
            .audible_error(self.budget, (&coarser_run.sound, &run.sound), scatter)
    }
}

/// The error of the finer of two runs [dB], from the change between them and the one `change_before` at twice the
/// steps: at order 1, which the first two are assumed to have, it is the change.
fn error_of_finer(change: f64, change_before: Option<f64>) -> f64 {
    let [lowest_order, highest_order] = CONVERGENCE_ORDERS;
    let error_order = change_before
        .map_or(1.0, |change_before| (change_before - change) / FACTOR_TWO_DB)
        .clamp(lowest_order, highest_order);
    change - 20.0 * crate::maths::log10(pow(2.0, error_order) - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_of_finer_by_order() {
        assert!((error_of_finer(-40.0, None) + 40.0).abs() < 1e-9);
        assert!((error_of_finer(-40.0, Some(-38.0)) + 32.34).abs() < 0.01);
        assert!((error_of_finer(-40.0, Some(-10.0)) + 40.0).abs() < 1e-9);
    }
}
