//! A pilot: plays the beginning of an island to choose how it is computed.
//!
//! It ends a while after the first contact, or after the first event if nothing touches. A `reference` is found first;
//! the `search` then compares candidates with it; at last modes that this score does not excite are left out. By ear
//! the plain ways come first, and others only if none of them is exact enough.

use std::cell::Cell;
use std::rc::Rc;

use crate::assembly::assemble::{Assembled, AssemblyOptions};
use crate::assembly::budget::Budget;
use crate::assembly::mesh::MethodChoice;
use crate::assembly::unit::IslandPlan;
use crate::island::FINE_SUBSTEPS_MIN;
use crate::network::Error;
use crate::plan::constants::{FAINT_SHARE, OVERSAMPLING_MAX, PARTED_DB, PILOT_PARTS, SEARCH_COST};
use crate::plan::row::Measured;
use crate::plan::trial::allowance::{Allowance, TrialError, unless_spent};
use crate::plan::trial::candidates::Candidate;
use crate::plan::trial::chaos::{Pair, Stretches};
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_result::{ChosenIsland, LongRun, PilotResult};
use crate::plan::trial::pilot_run::{Excerpt, PilotRun, find_excerpt, longer};
use crate::plan::trial::prune_modes::prune;
use crate::plan::trial::reference::{Climb, Reference, is_plain_first, plain_reference, reference};
use crate::plan::trial::runs::Runs;
use crate::plan::trial::search::{Search, Tried};
use crate::plan::trial::waveform_error::{Spans, amplitude_difference, amplitude_sum, power_sum};
use crate::waveform::is_still;

/// Finds the cheapest island within the budget; `assemble` puts the island together at some oversampling.
pub(in crate::plan) fn pilot(
    assemble: &impl Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>,
    budget: &Budget,
    allowance: &Allowance,
) -> Result<PilotResult, Error> {
    if let Budget::Method(_) = budget {
        return Ok(ChosenIsland::unmeasured(assemble(AssemblyOptions::fine(1, MethodChoice::ByBudget))?).into());
    }
    let island = lowest_stable(assemble)?;
    let timeline = &island.island_plan.timeline;
    if timeline.is_open || timeline.hands().next().is_some() {
        // Nobody knows beforehand what a hand or a session will do: nothing is left out.
        return Ok(ChosenIsland::unmeasured(island).into());
    }
    let excerpt = unless_spent(find_excerpt(&island.island_plan, allowance))?;
    let mut next_excerpt = excerpt.filter(|excerpt| excerpt.n_frames > 0);
    // Two plain runs of what sticks may agree by chance, both slipping too late.
    if let Some(excerpt) = next_excerpt.filter(|_| matches!(budget, Budget::Cents { .. }) && !island.sticks())
        && let Some(pilot) = Pilot::new((assemble, budget, allowance), (&island, 1), excerpt)?
        && let Some((result, _)) = pilot.find_plain()?
    {
        return Ok(result);
    }
    let substeps = first_substeps(&island, budget);
    while let Some(excerpt) = next_excerpt {
        let trial_setup = (assemble, budget, allowance);
        let Some(pilot) = Pilot::new(trial_setup, (&island, substeps), excerpt)? else {
            break;
        };
        let Some((result, pilot_run)) = pilot.find(&island)? else {
            break;
        };
        // Friction may hold what the first events strike: nothing is known then of those that are heard.
        let is_silent = island.sticks() && is_still(&pilot_run.sound, pilot.spans.n_out);
        next_excerpt = longer(&island.island_plan, pilot.runs.excerpt()).filter(|_| is_silent);
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
    runs: Runs,
    spans: Spans,
}

impl<'a, F: Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>> Pilot<'a, F> {
    /// Chooses what is played of an excerpt, given an island and the contact substeps of its first run; `None` if the
    /// allowance ended first.
    fn new(
        (assemble, budget, allowance): (&'a F, &'a Budget, &'a Allowance),
        first: (&Assembled, usize),
        excerpt: Excerpt,
    ) -> Result<Option<Self>, Error> {
        let chosen_runs = unless_spent(choose_heard(first, excerpt, allowance))?;
        Ok(chosen_runs.map(|(runs, spans)| Self {
            assemble,
            budget,
            allowance,
            runs,
            spans,
        }))
    }

    /// Finds the cheapest plain island that is not heard to differ from its finer twins; `None` if there is none.
    fn find_plain(&self) -> Result<Option<PilotOutcome>, Error> {
        let reference_result = plain_reference(&self.climb(), self.allowance);
        let Some(reference) = unless_spent(reference_result)?.flatten() else {
            return Ok(None);
        };
        let stretches = Stretches::new(&reference.run.sound, &self.spans);
        let plain_tried = self.search(&reference, None).find_plain()?;
        plain_tried
            .map(|plain_tried| self.finished(plain_tried, &stretches))
            .transpose()
    }

    fn climb(&self) -> Climb<'_, F> {
        Climb {
            assemble: self.assemble,
            runs: &self.runs,
            spans: &self.spans,
            budget: self.budget,
        }
    }

    fn search<'b>(&'b self, reference: &'b Reference, chaos: Option<(&'b Stretches, f64)>) -> Search<'b, F> {
        Search {
            assemble: self.assemble,
            budget: self.budget,
            allowance: self.allowance,
            runs: &self.runs,
            spans: &self.spans,
            reference,
            chaos,
        }
    }

    /// Finds the island; `None` if the allowance ended before anything was known.
    fn find(&self, island: &Assembled) -> Result<Option<PilotOutcome>, Error> {
        let substeps = first_substeps(island, self.budget);
        let first_run = self.runs.play((&island.island_plan, substeps), self.allowance);
        let Some(first_run) = unless_spent(first_run)? else {
            return Ok(None);
        };
        let first_candidate = Candidate::new(island.clone(), substeps, None).counted(&first_run);
        let reference_result = reference(&self.climb(), &first_candidate, self.allowance);
        let Some(reference) = unless_spent(reference_result)?.flatten() else {
            return Ok(Some(self.unmeasured(first_candidate, first_run)?));
        };
        let stretches = Stretches::new(&reference.run.sound, &self.spans);
        let growth = unless_spent(self.growth(&reference, &stretches))?.flatten();
        let is_unknown = !reference.is_sure(self.budget) && reference.error > PARTED_DB;
        if growth.is_none() && is_unknown {
            return Ok(Some(self.unmeasured(first_candidate, first_run)?)); // no two runs agree
        }
        let chaos_growth = growth.map(|growth| (&stretches, growth));
        match self.search(&reference, chaos_growth).find()? {
            Some(tried) => Ok(Some(self.finished(tried, &stretches)?)),
            None => Ok(Some(self.unmeasured(first_candidate, first_run)?)),
        }
    }

    /// How much a nudge of the reference grows, if that is unsure and the motion chaotic.
    fn growth(&self, reference: &Reference, stretches: &Stretches) -> Result<Option<f64>, TrialError> {
        if reference.is_sure(self.budget) {
            return Ok(None);
        }
        let run_pair = Pair {
            run: &reference.run,
            finer: &reference.run,
            spans: &self.spans,
            stretches,
        };
        let candidate = &reference.candidate;
        let played_plan = &candidate.island.island_plan;
        run_pair.chaos(played_plan, candidate.substeps, self.allowance)
    }

    /// The result of a search: the candidate without modes that are not heard, and its error.
    fn finished(&self, tried: Tried, stretches: &Stretches) -> Result<PilotOutcome, Error> {
        let (island, db) = match tried.parting {
            None if matches!(self.budget, Budget::Error(_)) => self.pruned_within(&tried)?,
            _ => (
                self.pruned((&tried.candidate, &tried.run), self.budget.left_out())?,
                tried.error,
            ),
        };
        let measured_error = match &tried.parting {
            Some(parting) => {
                let (db, valid_until) = parting.valid_span(self.budget.asked(), stretches);
                Measured {
                    db,
                    over: self.seconds(valid_until),
                    spectral: Some(parting.spectral),
                    audible: None,
                }
            }
            None => Measured {
                db,
                over: self.seconds(self.runs.excerpt().n_frames),
                spectral: None,
                audible: tried.audible,
            },
        };
        let full_island = tried.candidate.island;
        let is_open_ended = measured_error.spectral.is_none() && horizon::error_may_grow(&full_island.island_plan);
        let methods = full_island.mesh_methods();
        let more_exact = full_island.more_exact(&methods);
        let finer = is_open_ended.then(|| (self.assemble)(more_exact).ok()).flatten();
        let pilot_result = PilotResult {
            chosen: ChosenIsland {
                island,
                error: Some(measured_error),
                diverges: tried.run.has_diverged,
            },
            long_run: finer.map(|finer| LongRun {
                finer,
                contact_substeps: tried.candidate.substeps,
            }),
        };
        Ok((pilot_result, tried.run))
    }

    /// The time at which a number of frames of the excerpt has been played [s].
    fn seconds(&self, n_frames: usize) -> f64 {
        (self.runs.excerpt().from + n_frames) as f64 / self.spans.rate
    }

    fn pruned(&self, (candidate, run): (&Candidate, &PilotRun), limit: Option<f64>) -> Result<Assembled, Error> {
        let prune_context = (self.runs.excerpt(), self.budget, limit);
        prune(
            &candidate.island,
            (candidate.substeps, run),
            prune_context,
            self.allowance,
        )
    }

    /// The same, with no more left out than an error leaves of the budget; also returns the error to state, of both
    /// together: they may point the same way.
    fn pruned_within(&self, tried: &Tried) -> Result<(Assembled, f64), Error> {
        let level_left = amplitude_difference(self.budget.asked(), tried.error);
        let limit = self.budget.left_out().map(|limit| limit.min(level_left));
        let island = self.pruned((&tried.candidate, &tried.run), limit)?;
        let left_out = island.bodies.iter().filter_map(|body| body.left_out);
        let stated_error = match left_out.reduce(power_sum) {
            Some(left_out) => amplitude_sum([tried.error, left_out]),
            None => tried.error,
        };
        Ok((island, stated_error))
    }

    /// The island as it was played first, whose error is not known. If that run is lost, the island with meshes that
    /// cannot diverge, unless that is lost too.
    fn unmeasured(&self, first: Candidate, run: Rc<PilotRun>) -> Result<PilotOutcome, Error> {
        let (mut candidate, mut run) = (first, run);
        if run.is_lost
            && let Ok(island) = (self.assemble)(AssemblyOptions::fine(1, MethodChoice::Unconditional))
        {
            let safe_candidate = Candidate::new(island.clone(), island.island_plan.contact_substeps, None);
            let played_plan = (&safe_candidate.island.island_plan, safe_candidate.substeps);
            let safe_run = unless_spent(self.runs.play(played_plan, self.allowance))?;
            if let Some(safe_run) = safe_run.filter(|safe_run| !safe_run.is_lost) {
                (candidate, run) = (safe_candidate, safe_run);
            }
        }
        let island = self.pruned((&candidate, &run), self.budget.left_out())?;
        let left_out = island.bodies.iter().filter_map(|body| body.left_out).reduce(power_sum);
        // The network is the reference, so what is left out is the whole error. It may grow.
        let error = left_out.filter(|_| island.is_discrete()).map(|db| Measured {
            db,
            over: self.seconds(self.runs.excerpt().n_frames),
            spectral: None,
            audible: None,
        });
        let complete_island = error.is_some().then_some(candidate.island);
        let pilot_result = PilotResult {
            chosen: ChosenIsland {
                island,
                error,
                diverges: run.has_diverged,
            },
            long_run: complete_island.map(|finer| LongRun {
                finer,
                contact_substeps: candidate.substeps,
            }),
        };
        Ok((pilot_result, run))
    }
}

/// Chooses the runs of an island up to its first event that is more than faint, if friction may hold what earlier ones
/// strike.
fn choose_heard(
    (island, substeps): (&Assembled, usize),
    mut excerpt: Excerpt,
    allowance: &Allowance,
) -> Result<(Runs, Spans), TrialError> {
    let island_plan = &island.island_plan;
    loop {
        let (runs, spans) = choose_runs((island_plan, substeps), excerpt, allowance)?;
        if !island.sticks() {
            return Ok((runs, spans));
        }
        let first_run = runs.play((island_plan, substeps), allowance)?;
        match longer(island_plan, excerpt) {
            Some(longer) if first_run.loudest_share < FAINT_SHARE => excerpt = longer,
            _ => return Ok((runs, spans)),
        }
    }
}

/// Chooses the runs of an island and the spans over which they are compared: as long as the allowance pays for a
/// search. For an error budget a short comparison is better than none.
fn choose_runs(
    played: (&IslandPlan, usize),
    excerpt: Excerpt,
    allowance: &Allowance,
) -> Result<(Runs, Spans), TrialError> {
    let (runs, spans) = (Runs::new(excerpt), Spans::new(played.0, excerpt.n_frames));
    let (spent_before, _) = allowance.spent();
    let affordable_share = Cell::new(1.0);
    // A run that was stopped early is not kept: the shorter excerpt is played again as a whole.
    let frames_after_event = |frames: usize| frames.saturating_sub(spans.event()) as f64;
    runs.play_while(played, allowance, |frames, _| {
        let run_work = allowance.spent().0 - spent_before;
        let affordable = allowance.share_left(SEARCH_COST * run_work);
        affordable_share.set(affordable * frames_after_event(frames) / frames_after_event(excerpt.n_frames));
        affordable == 1.0 || frames <= spans.shortened(1).end()
    })?;
    let span_parts = (PILOT_PARTS as f64 * affordable_share.get()) as usize;
    if span_parts >= PILOT_PARTS {
        return Ok((runs, spans));
    }
    let spans = spans.shortened(span_parts);
    let excerpt = Excerpt {
        n_frames: spans.end(),
        ..excerpt
    };
    Ok((Runs::new(excerpt), spans))
}

/// The contact substeps of the first run: once a step where computing laws between frames is far dearer.
fn first_substeps(island: &Assembled, budget: &Budget) -> usize {
    let substeps = island.island_plan.contact_substeps;
    let may_be_fine = island.may_collocate && !matches!(budget, Budget::Method(_));
    match may_be_fine && !is_plain_first(island) {
        true => substeps.max(FINE_SUBSTEPS_MIN),
        false => substeps,
    }
}

/// The island at the lowest oversampling at which it is stable.
fn lowest_stable(assemble: &impl Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>) -> Result<Assembled, Error> {
    match assemble(AssemblyOptions::fine(1, MethodChoice::ByBudget)) {
        // An island that diverges at this rate may be stable at a higher one.
        Err(error @ Error::Unstable { .. }) => {
            let higher_rates = [2, 4, 8, 2 * OVERSAMPLING_MAX].into_iter();
            let mut stable_islands = higher_rates
                .filter_map(|oversampling| assemble(AssemblyOptions::fine(oversampling, MethodChoice::ByBudget)).ok());
            stable_islands.next().ok_or(error)
        }
        first_result => first_result,
    }
}
