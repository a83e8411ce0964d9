//! A pilot: plays the beginning of an island to choose how it is computed.
//!
//! It ends a while after the first contact, or after the first event if nothing touches. A `reference` is found
//! first; the `search` then compares candidates with it; at last modes that this score does not excite are left out. By
//! ear the plain ways come first, and others only if none of them is exact enough.

use std::cell::Cell;
use std::rc::Rc;

use crate::assembly::assemble::{Assembled, AssemblyOptions};
use crate::assembly::budget::Budget;
use crate::assembly::mesh::MethodChoice;
use crate::assembly::unit::IslandPlan;
use crate::island::FINE_SUBSTEPS_MIN;
use crate::network::Error;
use crate::plan::constants::{
    FAINT_OUTPUT_SHARE, OVERSAMPLING_MAX, PILOT_SPANS, SEARCH_COST_IN_FIRST_RUNS, UNCORRELATED_DB,
};
use crate::plan::row::MeasuredError;
use crate::plan::trial::allowance::{Allowance, TrialError, none_if_spent};
use crate::plan::trial::candidates::{Candidate, CostRule};
use crate::plan::trial::chaos::{ComparedStretches, RunPair};
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_result::{ChosenIsland, LongComparison, PilotResult};
use crate::plan::trial::pilot_run::{Excerpt, PilotRun, extended_to_next_event, pilot_excerpt};
use crate::plan::trial::prune_modes::prune;
use crate::plan::trial::reference::{
    Reference, ReferenceSearch, find_reference, is_cheaper_once_per_step, once_per_step_reference,
};
use crate::plan::trial::run_cache::RunCache;
use crate::plan::trial::search::{CandidateSearch, CandidateTrial};
use crate::plan::trial::waveform_error::{ComparedSpans, amplitude_difference_db, amplitude_sum_db, power_sum_db};
use crate::waveform::is_still;

/// Finds the cheapest island within the budget; `assemble` puts the island together at some oversampling.
pub(in crate::plan) fn choose_by_trials(
    assemble: &impl Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>,
    budget: &Budget,
    allowance: &Allowance,
    cost_rule: CostRule,
) -> Result<PilotResult, Error> {
    if let Budget::Method(_) = budget {
        return Ok(
            ChosenIsland::unmeasured(assemble(AssemblyOptions::between_steps(1, MethodChoice::ByBudget))?).into(),
        );
    }
    let island = lowest_stable(assemble)?;
    let timeline = &island.island_plan.timeline;
    if timeline.hands().next().is_some() {
        // Nobody knows beforehand what a hand will do: nothing is left out.
        return Ok(ChosenIsland::unmeasured(island).into());
    }
    let excerpt = none_if_spent(pilot_excerpt(&island.island_plan, allowance))?;
    let mut next_excerpt = excerpt.filter(|excerpt| excerpt.n_frames > 0);
    // Two plain runs of what sticks may agree by chance, both slipping too late.
    if let Some(excerpt) =
        next_excerpt.filter(|_| matches!(budget, Budget::Cents { .. }) && !island.has_sticking_friction())
        && let Some(pilot) = Pilot::new((assemble, budget, allowance, cost_rule), (&island, 1), excerpt)?
        && let Some((result, _)) = pilot.find_once_per_step()?
    {
        return Ok(result);
    }
    let substeps = first_substeps(&island, budget);
    while let Some(excerpt) = next_excerpt {
        let trial_setup = (assemble, budget, allowance, cost_rule);
        let Some(pilot) = Pilot::new(trial_setup, (&island, substeps), excerpt)? else {
            break;
        };
        let Some((result, pilot_run)) = pilot.find_island(&island)? else {
            break;
        };
        // Friction may hold what the first events strike: nothing is known then of those that are heard.
        let is_silent = island.has_sticking_friction() && is_still(&pilot_run.sound, pilot.compared_spans.n_out);
        next_excerpt = extended_to_next_event(&island.island_plan, pilot.runs.excerpt()).filter(|_| is_silent);
        if next_excerpt.is_none() {
            return Ok(result);
        }
    }
    Ok(ChosenIsland::unmeasured(island).into())
}

/// What a pilot has found, and the run of the chosen island.
type PilotOutcome = (PilotResult, Rc<PilotRun>);

/// An island and what its trials share.
struct Pilot<'a, F> {
    assemble: &'a F,
    budget: &'a Budget,
    allowance: &'a Allowance,
    cost_rule: CostRule,
    runs: RunCache,
    compared_spans: ComparedSpans,
}

impl<'a, F: Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>> Pilot<'a, F> {
    /// Chooses what is played of an excerpt, given an island and the contact substeps of its first run; `None` if the
    /// allowance ended first.
    fn new(
        (assemble, budget, allowance, cost_rule): (&'a F, &'a Budget, &'a Allowance, CostRule),
        first: (&Assembled, usize),
        excerpt: Excerpt,
    ) -> Result<Option<Self>, Error> {
        let chosen_runs = none_if_spent(runs_until_heard(first, excerpt, allowance))?;
        Ok(chosen_runs.map(|(runs, spans)| Self {
            assemble,
            budget,
            allowance,
            cost_rule,
            runs,
            compared_spans: spans,
        }))
    }

    /// Finds the cheapest plain island that is not heard to differ from its finer twins; `None` if there is none.
    fn find_once_per_step(&self) -> Result<Option<PilotOutcome>, Error> {
        let reference_result = once_per_step_reference(&self.reference_search(), self.allowance);
        let Some(reference) = none_if_spent(reference_result)?.flatten() else {
            return Ok(None);
        };
        let stretches = ComparedStretches::new(&reference.run.sound, &self.compared_spans);
        let cheapest_trial = self.search(&reference, None).find_once_per_step(self.cost_rule)?;
        cheapest_trial
            .map(|plain_tried| self.outcome_without_modes(plain_tried, &stretches))
            .transpose()
    }

    fn reference_search(&self) -> ReferenceSearch<'_, F> {
        ReferenceSearch {
            assemble: self.assemble,
            runs: &self.runs,
            spans: &self.compared_spans,
            budget: self.budget,
        }
    }

    fn search<'b>(
        &'b self,
        reference: &'b Reference,
        chaos: Option<(&'b ComparedStretches, f64)>,
    ) -> CandidateSearch<'b, F> {
        CandidateSearch {
            assemble: self.assemble,
            budget: self.budget,
            allowance: self.allowance,
            runs: &self.runs,
            spans: &self.compared_spans,
            reference,
            chaotic_stretches: chaos,
        }
    }

    /// Finds the island; `None` if the allowance ended before anything was known.
    fn find_island(&self, island: &Assembled) -> Result<Option<PilotOutcome>, Error> {
        let substeps = first_substeps(island, self.budget);
        let first_run = self.runs.play((&island.island_plan, substeps), self.allowance);
        let Some(first_run) = none_if_spent(first_run)? else {
            return Ok(None);
        };
        let first_candidate = Candidate::new(island.clone(), substeps, None).with_counted_cost(&first_run);
        let reference_result = find_reference(&self.reference_search(), &first_candidate, self.allowance);
        let Some(reference) = none_if_spent(reference_result)?.flatten() else {
            return Ok(Some(self.outcome_of_first_run(first_candidate, first_run)?));
        };
        let stretches = ComparedStretches::new(&reference.run.sound, &self.compared_spans);
        let growth = none_if_spent(self.chaotic_growth_db(&reference, &stretches))?.flatten();
        let is_unknown = !reference.shows_regular_motion(self.budget) && reference.error_db > UNCORRELATED_DB;
        if growth.is_none() && is_unknown {
            return Ok(Some(self.outcome_of_first_run(first_candidate, first_run)?)); // no two runs agree
        }
        let chaos_growth = growth.map(|growth| (&stretches, growth));
        match self.search(&reference, chaos_growth).find()? {
            Some(tried) => Ok(Some(self.outcome_without_modes(tried, &stretches)?)),
            None => Ok(Some(self.outcome_of_first_run(first_candidate, first_run)?)),
        }
    }

    /// How much a nudge of the reference grows, if that is unsure and the motion chaotic.
    fn chaotic_growth_db(
        &self,
        reference: &Reference,
        stretches: &ComparedStretches,
    ) -> Result<Option<f64>, TrialError> {
        if reference.shows_regular_motion(self.budget) {
            return Ok(None);
        }
        let run_pair = RunPair {
            coarse_run: &reference.run,
            fine_run: &reference.run,
            spans: &self.compared_spans,
            stretches,
        };
        let candidate = &reference.candidate;
        let played_plan = &candidate.island.island_plan;
        run_pair.chaotic_growth_db(played_plan, candidate.contact_substeps, self.allowance)
    }

    /// The result of a search: the candidate without modes that are not heard, and its error.
    fn outcome_without_modes(
        &self,
        trial: CandidateTrial,
        stretches: &ComparedStretches,
    ) -> Result<PilotOutcome, Error> {
        let (island, db) = match trial.chaotic_comparison {
            None if matches!(self.budget, Budget::Error(_)) => self.without_modes_within_budget(&trial)?,
            _ => (
                self.without_inaudible_modes((&trial.candidate, &trial.run), self.budget.left_out_db_max())?,
                trial.error_db,
            ),
        };
        let measured_error = match &trial.chaotic_comparison {
            Some(parting) => {
                let (db, valid_until) = parting.valid_span(self.budget.waveform_error_db(), stretches);
                MeasuredError {
                    waveform_db: db,
                    duration_seconds: self.played_seconds(valid_until),
                    third_octave_db: Some(parting.third_octave_db),
                    audible: None,
                }
            }
            None => MeasuredError {
                waveform_db: db,
                duration_seconds: self.played_seconds(self.runs.excerpt().n_frames),
                third_octave_db: None,
                audible: trial.audible_error,
            },
        };
        let full_island = trial.candidate.island;
        let is_open_ended =
            measured_error.third_octave_db.is_none() && horizon::error_may_grow(&full_island.island_plan);
        let methods = full_island.mesh_methods();
        let more_exact = full_island.options_for_half_step(&methods);
        let finer_island = is_open_ended.then(|| (self.assemble)(more_exact).ok()).flatten();
        let pilot_result = PilotResult {
            chosen: ChosenIsland {
                island,
                measured_error: Some(measured_error),
                has_diverged: trial.run.has_diverged,
            },
            long_comparison: finer_island.map(|finer_island| LongComparison {
                finer_island,
                contact_substeps: trial.candidate.contact_substeps,
            }),
        };
        Ok((pilot_result, trial.run))
    }

    /// The time at which a number of frames of the excerpt has been played [s].
    fn played_seconds(&self, n_frames: usize) -> f64 {
        (self.runs.excerpt().first_frame + n_frames) as f64 / self.compared_spans.rate
    }

    fn without_inaudible_modes(
        &self,
        (candidate, run): (&Candidate, &PilotRun),
        left_out_limit_db: Option<f64>,
    ) -> Result<Assembled, Error> {
        let prune_context = (self.runs.excerpt(), self.budget, left_out_limit_db);
        prune(
            &candidate.island,
            (candidate.contact_substeps, run),
            prune_context,
            self.allowance,
        )
    }

    /// The same, with no more left out than an error leaves of the budget; also returns the error to state, of both
    /// together: they may point the same way.
    fn without_modes_within_budget(&self, trial: &CandidateTrial) -> Result<(Assembled, f64), Error> {
        let level_left = amplitude_difference_db(self.budget.waveform_error_db(), trial.error_db);
        let left_out_limit_db = self.budget.left_out_db_max().map(|limit_db| limit_db.min(level_left));
        let island = self.without_inaudible_modes((&trial.candidate, &trial.run), left_out_limit_db)?;
        let left_out = island.bodies.iter().filter_map(|body| body.left_out_db);
        let stated_error = match left_out.reduce(power_sum_db) {
            Some(left_out) => amplitude_sum_db([trial.error_db, left_out]),
            None => trial.error_db,
        };
        Ok((island, stated_error))
    }

    /// The island as it was played first, whose error is not known. If that run is lost, the island with meshes that
    /// cannot diverge, unless that is lost too.
    fn outcome_of_first_run(&self, first: Candidate, run: Rc<PilotRun>) -> Result<PilotOutcome, Error> {
        let (mut candidate, mut run) = (first, run);
        if run.is_unusable
            && let Ok(island) = (self.assemble)(AssemblyOptions::between_steps(1, MethodChoice::Unconditional))
        {
            let safe_candidate = Candidate::new(island.clone(), island.island_plan.contact_substeps, None);
            let played_plan = (&safe_candidate.island.island_plan, safe_candidate.contact_substeps);
            let safe_run = none_if_spent(self.runs.play(played_plan, self.allowance))?;
            if let Some(safe_run) = safe_run.filter(|safe_run| !safe_run.is_unusable) {
                (candidate, run) = (safe_candidate, safe_run);
            }
        }
        let island = self.without_inaudible_modes((&candidate, &run), self.budget.left_out_db_max())?;
        let left_out = island
            .bodies
            .iter()
            .filter_map(|body| body.left_out_db)
            .reduce(power_sum_db);
        // The network is the reference, so what is left out is the whole error. It may grow.
        let error = left_out
            .filter(|_| island.is_discrete_reference())
            .map(|db| MeasuredError {
                waveform_db: db,
                duration_seconds: self.played_seconds(self.runs.excerpt().n_frames),
                third_octave_db: None,
                audible: None,
            });
        let complete_island = error.is_some().then_some(candidate.island);
        let pilot_result = PilotResult {
            chosen: ChosenIsland {
                island,
                measured_error: error,
                has_diverged: run.has_diverged,
            },
            long_comparison: complete_island.map(|finer_island| LongComparison {
                finer_island,
                contact_substeps: candidate.contact_substeps,
            }),
        };
        Ok((pilot_result, run))
    }
}

/// Chooses the runs of an island up to its first event that is more than faint, if friction may hold what earlier ones
/// strike.
fn runs_until_heard(
    (island, substeps): (&Assembled, usize),
    mut excerpt: Excerpt,
    allowance: &Allowance,
) -> Result<(RunCache, ComparedSpans), TrialError> {
    let island_plan = &island.island_plan;
    loop {
        let (runs, spans) = affordable_runs((island_plan, substeps), excerpt, allowance)?;
        if !island.has_sticking_friction() {
            return Ok((runs, spans));
        }
        let first_run = runs.play((island_plan, substeps), allowance)?;
        match extended_to_next_event(island_plan, excerpt) {
            Some(longer) if first_run.loudest_share < FAINT_OUTPUT_SHARE => excerpt = longer,
            _ => return Ok((runs, spans)),
        }
    }
}

/// Chooses the runs of an island and the spans over which they are compared: as long as the allowance pays for a
/// search. For an error budget a short comparison is better than none.
fn affordable_runs(
    played: (&IslandPlan, usize),
    excerpt: Excerpt,
    allowance: &Allowance,
) -> Result<(RunCache, ComparedSpans), TrialError> {
    let (runs, spans) = (RunCache::new(excerpt), ComparedSpans::new(played.0, excerpt.n_frames));
    let spent_before = allowance.spent_seconds();
    let affordable_share = Cell::new(1.0);
    // A run that was stopped early is not kept: the shorter excerpt is played again as a whole.
    let frames_after_event = |frames: usize| frames.saturating_sub(spans.event_frame()) as f64;
    runs.play_while(played, allowance, |frames, _| {
        let run_work = allowance.spent_seconds() - spent_before;
        let affordable = allowance.share_left(SEARCH_COST_IN_FIRST_RUNS * run_work);
        affordable_share.set(affordable * frames_after_event(frames) / frames_after_event(excerpt.n_frames));
        affordable == 1.0 || frames <= spans.shortened(1).end()
    })?;
    let span_parts = (PILOT_SPANS as f64 * affordable_share.get()) as usize;
    if span_parts >= PILOT_SPANS {
        return Ok((runs, spans));
    }
    let spans = spans.shortened(span_parts);
    let excerpt = Excerpt {
        n_frames: spans.end(),
        ..excerpt
    };
    Ok((RunCache::new(excerpt), spans))
}

/// The contact substeps of the first run: once a step where computing laws between frames is far dearer.
fn first_substeps(island: &Assembled, budget: &Budget) -> usize {
    let substeps = island.island_plan.contact_substeps;
    let may_be_fine = island.can_solve_laws_between_steps && !matches!(budget, Budget::Method(_));
    match may_be_fine && !is_cheaper_once_per_step(island) {
        true => substeps.max(FINE_SUBSTEPS_MIN),
        false => substeps,
    }
}

/// The island at the lowest oversampling at which it is stable.
pub(in crate::plan) fn lowest_stable(
    assemble: &impl Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>,
) -> Result<Assembled, Error> {
    match assemble(AssemblyOptions::between_steps(1, MethodChoice::ByBudget)) {
        // An island that diverges at this rate may be stable at a higher one.
        Err(error @ Error::Unstable { .. }) => {
            let higher_rates = [2, 4, 8, 2 * OVERSAMPLING_MAX].into_iter();
            let mut stable_islands = higher_rates.filter_map(|oversampling| {
                assemble(AssemblyOptions::between_steps(oversampling, MethodChoice::ByBudget)).ok()
            });
            stable_islands.next().ok_or(error)
        }
        first_result => first_result,
    }
}
