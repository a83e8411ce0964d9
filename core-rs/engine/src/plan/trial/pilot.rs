//! A pilot: plays the beginning of an island to choose how it is computed.
//!
//! It ends a while after the first contact, or after the first event if nothing touches. A `reference` is found first;
//! the `search` then compares candidates with it; at last modes that this score does not excite are left out. By ear
//! the plain ways come first, and others only if none of them is exact enough.

use std::cell::Cell;
use std::rc::Rc;

use crate::network::Error;
use crate::plan::IslandPlan;
use crate::plan::budget::Budget;
use crate::plan::constants::{FAINT, PARTED, PARTS, SEARCH_COST, SUBSTEPS_MIN, TIMES_MAX};
use crate::plan::passes::assemble::{Assembled, How};
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::report::row::Measured;
use crate::plan::trial::allowance::{Allowance, TrialError, unless_spent};
use crate::plan::trial::candidates::Candidate;
use crate::plan::trial::chaos::{Pair, Stretches};
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_result::{ChosenIsland, LongRunPair, PilotResult};
use crate::plan::trial::pilot_run::{Excerpt, PilotRun, find_excerpt, longer};
use crate::plan::trial::prune_modes::prune;
use crate::plan::trial::reference::{Climb, Reference, is_plain_first, plain_reference, reference};
use crate::plan::trial::runs::Runs;
use crate::plan::trial::search::{Search, Tried};
use crate::plan::trial::waveform_error::{Spans, amplitude_difference, error_beside, power_sum};
use crate::waveform::is_still;

/// Finds the cheapest island within the budget; `assemble` puts the island together at some oversampling.
pub(in crate::plan) fn pilot(
    assemble: &impl Fn(How<'_>) -> Result<Assembled, Error>,
    budget: &Budget,
    allowance: &Allowance,
) -> Result<PilotResult, Error> {
    if let Budget::Method(_) = budget {
        return Ok(
            ChosenIsland::unmeasured(assemble(How::fine(1, MethodChoice::ByBudget))?).into(),
        );
    }
    let island = lowest_stable(assemble)?;
    let timeline = &island.island_plan.timeline;
    if timeline.is_open || timeline.hands().next().is_some() {
        // Nobody knows beforehand what a hand or a session will do: nothing is left out.
        return Ok(ChosenIsland::unmeasured(island).into());
    }
    let excerpt = unless_spent(find_excerpt(&island.island_plan, allowance))?;
    let mut next = excerpt.filter(|excerpt| excerpt.n_frames > 0);
    // Two plain runs of what sticks may agree by chance, both slipping too late.
    if let Some(excerpt) =
        next.filter(|_| matches!(budget, Budget::Cents { .. }) && !island.sticks())
        && let Some(pilot) = Pilot::new((assemble, budget, allowance), (&island, 1), excerpt)?
        && let Some((result, _)) = pilot.find_plain()?
    {
        return Ok(result);
    }
    let substeps = first_substeps(&island, budget);
    while let Some(excerpt) = next {
        let trial = (assemble, budget, allowance);
        let Some(pilot) = Pilot::new(trial, (&island, substeps), excerpt)? else {
            break;
        };
        let Some((result, run)) = pilot.find(&island)? else {
            break;
        };
        // Friction may hold what the first events strike: nothing is known then of those that are heard.
        let is_silent = island.sticks() && is_still(&run.sound, pilot.spans.n_out);
        next = longer(&island.island_plan, pilot.runs.excerpt()).filter(|_| is_silent);
        if next.is_none() {
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

impl<'a, F: Fn(How<'_>) -> Result<Assembled, Error>> Pilot<'a, F> {
    /// Chooses what is played of an excerpt, given an island and the contact substeps of its first run; `None` if the
    /// allowance ended first.
    fn new(
        (assemble, budget, allowance): (&'a F, &'a Budget, &'a Allowance),
        first: (&Assembled, usize),
        excerpt: Excerpt,
    ) -> Result<Option<Self>, Error> {
        let chosen = unless_spent(choose_heard(first, excerpt, allowance))?;
        Ok(chosen.map(|(runs, spans)| Self {
            assemble,
            budget,
            allowance,
            runs,
            spans,
        }))
    }

    /// Finds the cheapest plain island that is not heard to differ from its finer twins; `None` if there is none.
    fn find_plain(&self) -> Result<Option<PilotOutcome>, Error> {
        let outcome = plain_reference(&self.climb(), self.allowance);
        let Some(reference) = unless_spent(outcome)?.flatten() else {
            return Ok(None);
        };
        let stretches = Stretches::new(&reference.run.sound, &self.spans);
        let tried = self.search(&reference, None).find_plain()?;
        tried
            .map(|tried| self.finished(tried, &stretches))
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

    fn search<'b>(
        &'b self,
        reference: &'b Reference,
        chaos: Option<(&'b Stretches, f64)>,
    ) -> Search<'b, F> {
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
        let run = self
            .runs
            .play((&island.island_plan, substeps), self.allowance);
        let Some(run) = unless_spent(run)? else {
            return Ok(None);
        };
        let first = Candidate::new(island.clone(), substeps, None).counted(&run);
        let outcome = reference(&self.climb(), &first, self.allowance);
        let Some(reference) = unless_spent(outcome)?.flatten() else {
            return Ok(Some(self.unmeasured(first, run)?));
        };
        let stretches = Stretches::new(&reference.run.sound, &self.spans);
        let growth = unless_spent(self.growth(&reference, &stretches))?.flatten();
        let is_unknown = !reference.is_sure(self.budget) && reference.error > PARTED;
        if growth.is_none() && is_unknown {
            return Ok(Some(self.unmeasured(first, run)?)); // no two runs agree
        }
        let chaos = growth.map(|growth| (&stretches, growth));
        match self.search(&reference, chaos).find()? {
            Some(tried) => Ok(Some(self.finished(tried, &stretches)?)),
            None => Ok(Some(self.unmeasured(first, run)?)),
        }
    }

    /// How much a nudge of the reference grows, if that is unsure and the motion chaotic.
    fn growth(
        &self,
        reference: &Reference,
        stretches: &Stretches,
    ) -> Result<Option<f64>, TrialError> {
        if reference.is_sure(self.budget) {
            return Ok(None);
        }
        let pair = Pair {
            run: &reference.run,
            finer: &reference.run,
            spans: &self.spans,
            stretches,
        };
        let candidate = &reference.candidate;
        let played = &candidate.island.island_plan;
        pair.chaos(played, candidate.substeps, self.allowance)
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
        let error = match &tried.parting {
            Some(parting) => {
                let (db, until) = parting.valid_span(self.budget.asked(), stretches);
                Measured {
                    db,
                    over: self.seconds(until),
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
        let coarse = tried.candidate.island;
        let is_open_ended =
            error.spectral.is_none() && horizon::error_may_grow(&coarse.island_plan);
        let methods = coarse.mesh_methods();
        let twice = coarse.again(2 * coarse.island_plan.oversampling, &methods);
        let finer = is_open_ended.then(|| (self.assemble)(twice).ok()).flatten();
        let result = PilotResult {
            chosen: ChosenIsland {
                island,
                error: Some(error),
                diverges: tried.run.has_diverged,
            },
            long_run: finer.map(|finer| LongRunPair {
                contact_substeps: [tried.candidate.substeps; 2],
                full: coarse,
                finer,
            }),
        };
        Ok((result, tried.run))
    }

    /// The time at which a number of frames of the excerpt has been played [s].
    fn seconds(&self, n_frames: usize) -> f64 {
        (self.runs.excerpt().from + n_frames) as f64 / self.spans.rate
    }

    fn pruned(
        &self,
        (candidate, run): (&Candidate, &PilotRun),
        limit: Option<f64>,
    ) -> Result<Assembled, Error> {
        let played = (self.runs.excerpt(), self.budget, limit);
        prune(
            &candidate.island,
            (candidate.substeps, run),
            played,
            self.allowance,
        )
    }

    /// The same, with no more left out than an error leaves of the budget; also returns the error to state. A reader adds
    /// it to what is left out by power, but near the budget both may point the same way.
    fn pruned_within(&self, tried: &Tried) -> Result<(Assembled, f64), Error> {
        let left = amplitude_difference(self.budget.asked(), tried.error);
        let limit = self.budget.left_out().map(|limit| limit.min(left));
        let island = self.pruned((&tried.candidate, &tried.run), limit)?;
        let left_out = island.bodies.iter().filter_map(|body| body.left_out);
        let db = match left_out.reduce(power_sum) {
            Some(left_out) => error_beside(tried.error, left_out),
            None => tried.error,
        };
        Ok((island, db))
    }

    /// The island as it was played first, whose error is not known. If that run is lost, the island with meshes that cannot
    /// diverge, unless that is lost too.
    fn unmeasured(&self, first: Candidate, run: Rc<PilotRun>) -> Result<PilotOutcome, Error> {
        let (mut candidate, mut run) = (first, run);
        if run.is_lost
            && let Ok(island) = (self.assemble)(How::fine(1, MethodChoice::Unconditional))
        {
            let safe = Candidate::new(island.clone(), island.island_plan.contact_substeps, None);
            let played = (&safe.island.island_plan, safe.substeps);
            let other = unless_spent(self.runs.play(played, self.allowance))?;
            if let Some(other) = other.filter(|other| !other.is_lost) {
                (candidate, run) = (safe, other);
            }
        }
        let chosen = ChosenIsland {
            island: self.pruned((&candidate, &run), self.budget.left_out())?,
            error: None,
            diverges: run.has_diverged,
        };
        Ok((chosen.into(), run))
    }
}

/// Chooses the runs of an island up to its first event that is more than faint, if friction may hold what earlier ones
/// strike.
fn choose_heard(
    (island, substeps): (&Assembled, usize),
    mut excerpt: Excerpt,
    allowance: &Allowance,
) -> Result<(Runs, Spans), TrialError> {
    let plan = &island.island_plan;
    loop {
        let (runs, spans) = choose_runs((plan, substeps), excerpt, allowance)?;
        if !island.sticks() {
            return Ok((runs, spans));
        }
        let run = runs.play((plan, substeps), allowance)?;
        match longer(plan, excerpt) {
            Some(longer) if run.loudest_share < FAINT => excerpt = longer,
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
    let (before, _) = allowance.spent();
    let share = Cell::new(1.0);
    // A run that was stopped early is not kept: the shorter excerpt is played again as a whole.
    let audible_frames = |frames: usize| frames.saturating_sub(spans.event()) as f64;
    runs.play_while(played, allowance, |frames, _| {
        let spent = allowance.spent().0 - before;
        let affordable = allowance.share_left(SEARCH_COST * spent);
        share.set(affordable * audible_frames(frames) / audible_frames(excerpt.n_frames));
        affordable == 1.0 || frames <= spans.shortened(1).end()
    })?;
    let parts = (PARTS as f64 * share.get()) as usize;
    if parts >= PARTS {
        return Ok((runs, spans));
    }
    let spans = spans.shortened(parts);
    let excerpt = Excerpt {
        n_frames: spans.end(),
        ..excerpt
    };
    Ok((Runs::new(excerpt), spans))
}

/// The contact substeps of the first run: once a step where computing laws between frames is far dearer.
fn first_substeps(island: &Assembled, budget: &Budget) -> usize {
    let substeps = island.island_plan.contact_substeps;
    let is_fine = island.may_collocate && !matches!(budget, Budget::Method(_));
    match is_fine && !is_plain_first(island) {
        true => substeps.max(SUBSTEPS_MIN),
        false => substeps,
    }
}

/// The island at the lowest oversampling at which it is stable.
fn lowest_stable(
    assemble: &impl Fn(How<'_>) -> Result<Assembled, Error>,
) -> Result<Assembled, Error> {
    match assemble(How::fine(1, MethodChoice::ByBudget)) {
        // An island that diverges at this rate may be stable at a higher one.
        Err(error @ Error::Unstable { .. }) => {
            let higher = [2, 4, 8, 2 * TIMES_MAX].into_iter();
            let mut stable = higher.filter_map(|oversampling| {
                assemble(How::fine(oversampling, MethodChoice::ByBudget)).ok()
            });
            stable.next().ok_or(error)
        }
        other => other,
    }
}
