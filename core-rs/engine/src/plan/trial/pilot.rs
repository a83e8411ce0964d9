//! A pilot: plays the beginning of an island to choose how it is computed.
//!
//! It ends a while after the first contact, or after the first event if nothing touches. It gives the contact substeps
//! (the beginning at S and 2S substeps: the difference is the error), the modes of each body that this score excites,
//! and the oversampling of the whole island (again by such a difference).

use std::cell::{Cell, OnceCell};
use std::rc::Rc;

use crate::network::Error;
use crate::plan::budget::Budget;
use crate::plan::passes::assemble::{Assembled, How};
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::report::row::Measured;
use crate::plan::trial::allowance::{Allowance, TrialError, unless_spent};
use crate::plan::trial::audible::Audible;
use crate::plan::trial::chaos::{Parting, Stretches};
use crate::plan::trial::contacts::{Contacts, contacts};
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_result::{ChosenIsland, LongRunPair, PilotResult};
use crate::plan::trial::pilot_run::{Excerpt, PilotRun, find_excerpt, is_still, longer};
use crate::plan::trial::prune_modes::prune;
use crate::plan::trial::runs::Runs;
use crate::plan::trial::search::{Candidate, Search, TIMES_MAX, Trial};
use crate::plan::trial::waveform_error::{
    PARTS, Spans, amplitude_difference, error_beside, power_sum,
};

/// Work of a search in multiples of its first run, if contacts dominate the cost: they are also computed twice and four
/// times as finely, and at half the step.
const SEARCH_COST: f64 = 12.0;
/// If the budget does not promise a waveform, other ways are tried if contacts take more than this part of the cost.
const DEAR: f64 = 0.5;
/// An event is faint where outputs hear less than this share of what they would hear if no motion were cancelled (-80
/// dB): what friction between frames lets through of a blow that it holds, 1e-8 of it, shrinks with every step.
const FAINT: f64 = 1e-4;

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
    while let Some(excerpt) = next {
        let Some(pilot) = Pilot::new((assemble, budget, allowance), &island, excerpt)? else {
            break;
        };
        let Some((result, run)) = pilot.find()? else {
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
type Found = (PilotResult, Rc<PilotRun>);

/// An island and what its trials share.
struct Pilot<'a, F> {
    assemble: &'a F,
    budget: &'a Budget,
    allowance: &'a Allowance,
    /// The island at its lowest stable oversampling.
    island: &'a Assembled,
    runs: Runs,
    spans: Spans,
    /// The stretches of the first run that was not lost.
    stretches: OnceCell<Stretches>,
}

impl<'a, F: Fn(How<'_>) -> Result<Assembled, Error>> Pilot<'a, F> {
    /// Chooses what is played of an excerpt; `None` if the allowance ended first.
    fn new(
        (assemble, budget, allowance): (&'a F, &'a Budget, &'a Allowance),
        island: &'a Assembled,
        excerpt: Excerpt,
    ) -> Result<Option<Self>, Error> {
        let chosen = unless_spent(choose_heard(island, excerpt, budget, allowance))?;
        Ok(chosen.map(|(runs, spans)| Self {
            assemble,
            budget,
            allowance,
            island,
            runs,
            spans,
            stretches: OnceCell::new(),
        }))
    }

    /// Finds the island; `None` if the allowance ended before anything was known.
    fn find(&self) -> Result<Option<Found>, Error> {
        if let Some(found) = self.find_plain()? {
            return Ok(Some(found));
        }
        // If the budget does not promise a waveform, laws are exact enough at one computation a step.
        let is_by_waveform = matches!(self.budget, Budget::Error(_));
        let Some(mut found) = self.contacts(is_by_waveform)? else {
            return Ok(None);
        };
        // A steep law that is computed once a frame may chatter, and friction may hold what it should not.
        let may_be_finer = self.island.may_collocate && !is_by_waveform;
        let mut best = self.best(&found, may_be_finer)?;
        let misses = |best: &Candidate| best.misses(self.budget) || best.is_held();
        if may_be_finer
            && best.as_ref().is_some_and(misses)
            && let Some(fine) = self.contacts(true)?
            && let Some(better) = self.best(&fine, false)?
        {
            (found, best) = (fine, Some(better));
        }
        let played = (&self.runs, &self.spans);
        let audible = found.audible(self.island, self.budget, played, self.allowance);
        let audible = unless_spent(audible)?.flatten().unwrap_or_default();
        let result = match best {
            Some(best) => self.finish_search((&found, audible), best)?,
            None => (self.contacts_alone(&found)?, found.run),
        };
        Ok(Some(result))
    }

    /// The island by a plain way, if that is tried first and keeps the budget.
    fn find_plain(&self) -> Result<Option<Found>, Error> {
        let stretches = OnceCell::new();
        let as_assembled = (self.island, self.island.island_plan.contact_substeps);
        let search = Search::new(self.trial(), (&self.spans, &stretches), as_assembled, None);
        let Some(best) = search.plain(self.island)? else {
            return Ok(None);
        };
        let (island, db) = self.pruned_within(&best)?;
        let error = Measured {
            db,
            over: self.seconds(self.runs.excerpt().n_frames),
            spectral: None,
            audible: None,
        };
        let run = best.run.clone();
        Ok(Some((finished(&search, best, island, Some(error)), run)))
    }

    /// The result if nothing was held against half its step.
    fn contacts_alone(&self, found: &Contacts) -> Result<PilotResult, Error> {
        if found.run.is_lost
            && let Some((island, run)) = self.unconditionally_stable()?
        {
            let steps = island.island_plan.contact_substeps;
            let island = match run {
                Some(run) => self.pruned(&island, (steps, &run), self.budget.left_out())?,
                None => island,
            };
            return Ok(ChosenIsland::unmeasured(island).into());
        }
        let own = (found.contact_substeps, &*found.run);
        let chosen = ChosenIsland {
            island: self.pruned(self.island, own, self.budget.left_out())?,
            // Only contacts and laws were held against finer ones. That is the error of the island if it is chaotic.
            error: found.parting.as_ref().and_then(|own| self.valid_span(own)),
            diverges: found.run.has_diverged,
        };
        Ok(chosen.into())
    }

    /// The best island that the search finds; `None` if none was held against half its step. If laws may be computed
    /// between frames, and that is not dear, nothing is searched once these are far off.
    fn best(&self, found: &Contacts, may_be_finer: bool) -> Result<Option<Candidate>, Error> {
        let search = self.search(found);
        let Some(start) = search.start(self.island, &found.run)? else {
            return Ok(None);
        };
        let is_far_off = may_be_finer && start.is_far_off(self.budget);
        if is_far_off && search.dear_cost(self.island).is_none() {
            return Ok(Some(start));
        }
        search.improve(start).map(Some)
    }

    /// The result of a search, or a cheaper island; `audible` is the audible error of contacts.
    fn finish_search(
        &self,
        (found, audible): (&Contacts, Audible),
        mut best: Candidate,
    ) -> Result<Found, Error> {
        let search = self.search(found);
        if best.run.is_lost
            && let Some((island, run)) = self.unconditionally_stable()?
        {
            let Some(run) = run else {
                return Ok((ChosenIsland::unmeasured(island).into(), best.run));
            };
            best = Candidate {
                contact_substeps: island.island_plan.contact_substeps,
                island,
                run,
                error: f64::NAN,
                parting: None,
                audible: None,
                ..best
            };
        }
        let parting = match best.parting.clone() {
            Some(parting) => Some(parting.with(found.parting.as_ref())),
            None => found.parting.clone(),
        };
        let parted = parting
            .as_ref()
            .and_then(|parting| self.valid_span(parting));
        // An island that is lost, or whose meshes cannot diverge, was compared with nothing.
        let is_compared = best.error.is_finite();
        let mut error = parted.or_else(|| {
            is_compared.then(|| Measured {
                db: power_sum(best.error, found.error.unwrap_or(f64::NEG_INFINITY)),
                over: self.seconds(self.runs.excerpt().n_frames),
                spectral: None,
                audible: best.audible.map(|own| own.with(audible)),
            })
        });
        let own = (best.contact_substeps, &*best.run);
        let mut island = self.pruned(&best.island, own, self.budget.left_out())?;
        if let Some(measured) = error
            && let Some(cost) = self.most_cost(&island, measured)
        {
            let cheaper = search.with_share(|search| search.cheapest((&best, cost), found.error));
            if let Some(cheaper) = cheaper? {
                best = cheaper;
                let (pruned, db) = self.pruned_within(&best)?;
                // This error includes that of contacts.
                error = Some(Measured {
                    db,
                    audible: best.audible,
                    ..measured
                });
                island = pruned;
            }
        }
        let run = best.run.clone();
        Ok((finished(&search, best, island, error), run))
    }

    /// The cost below which other ways are tried; `None` if none is.
    fn most_cost(&self, island: &Assembled, error: Measured) -> Option<f64> {
        let cost = island.island_plan.cost();
        match self.budget {
            _ if error.spectral.is_some() => None,
            // If the search ended above the budget, any way within it is better.
            Budget::Error(asked) if error.db > *asked => Some(f64::INFINITY),
            Budget::Error(_) => Some(cost),
            // A contact of a key that is as exact as is heard at first may be heard to differ later.
            Budget::Cents { .. } if horizon::error_may_grow(&island.island_plan) => None,
            // Contacts are kept more exact than is heard, which does not matter unless it is dear.
            Budget::Cents { .. } => {
                let of_contacts = island.island_plan.counted_cost.map_or(0.0, f64::from);
                (of_contacts > DEAR * cost).then_some(cost)
            }
            Budget::Method(_) => None,
        }
    }

    fn trial(&self) -> Trial<'_, F> {
        (self.assemble, &self.runs, self.budget, self.allowance)
    }

    /// A search that starts from the contact substeps that were found.
    fn search<'b>(&'b self, found: &'b Contacts) -> Search<'b, F> {
        let heard = (&self.spans, &self.stretches);
        let start = (self.island, found.contact_substeps);
        Search::new(self.trial(), heard, start, found.chaos())
    }

    /// Chooses the contact substeps; `None` if the allowance ended first.
    fn contacts(&self, are_laws_fine: bool) -> Result<Option<Contacts>, Error> {
        let fineness = (self.budget, are_laws_fine);
        let heard = (&self.spans, &self.stretches);
        let found = contacts(self.island, fineness, &self.runs, heard, self.allowance);
        unless_spent(found)
    }

    /// The time at which a number of frames of the excerpt has been played [s].
    fn seconds(&self, n_frames: usize) -> f64 {
        (self.runs.excerpt().from + n_frames) as f64 / self.spans.rate
    }

    /// The error of a chaotic motion, and how long it holds.
    fn valid_span(&self, parting: &Parting) -> Option<Measured> {
        let (db, until) = parting.valid_span(self.budget.asked(), self.stretches.get()?);
        Some(Measured {
            db,
            over: self.seconds(until),
            spectral: Some(parting.spectral),
            audible: None,
        })
    }

    fn pruned(
        &self,
        island: &Assembled,
        (steps, run): (usize, &PilotRun),
        most: Option<f64>,
    ) -> Result<Assembled, Error> {
        let played = (self.runs.excerpt(), self.budget, most);
        prune(island, (steps, run), played, self.allowance)
    }

    /// The same, with no more left out than an error leaves of the budget; also returns the error to state. A reader adds
    /// it to what is left out by power, but near the budget both may point the same way.
    fn pruned_within(&self, best: &Candidate) -> Result<(Assembled, f64), Error> {
        let left = amplitude_difference(self.budget.asked(), best.error);
        let most = self.budget.left_out().map(|most| most.min(left));
        let own = (best.contact_substeps, &*best.run);
        let island = self.pruned(&best.island, own, most)?;
        let left_out = island.bodies.iter().filter_map(|body| body.left_out);
        let db = match left_out.reduce(power_sum) {
            Some(left_out) => error_beside(best.error, left_out),
            None => best.error,
        };
        Ok((island, db))
    }

    /// Assembles the island with meshes that cannot diverge, and plays it if the allowance lets it; `None` if it is lost
    /// too.
    fn unconditionally_stable(&self) -> Result<Option<StableIsland>, Error> {
        let Ok(island) = (self.assemble)(How::fine(1, MethodChoice::Unconditional)) else {
            return Ok(None);
        };
        let played = (&island.island_plan, island.island_plan.contact_substeps);
        let run = unless_spent(self.runs.play(played, self.allowance))?;
        let is_lost = run.as_ref().is_some_and(|run| run.is_lost);
        Ok((!is_lost).then_some((island, run)))
    }
}

/// An island whose meshes cannot diverge, and its run, if the allowance paid for one.
type StableIsland = (Assembled, Option<Rc<PilotRun>>);

/// The result of a search: the best way, the same island without modes that are not heard, and its error.
fn finished<F: Fn(How<'_>) -> Result<Assembled, Error>>(
    search: &Search<'_, F>,
    best: Candidate,
    island: Assembled,
    error: Option<Measured>,
) -> PilotResult {
    let is_open_ended = error.is_some_and(|error| error.spectral.is_none())
        && horizon::error_may_grow(&best.island.island_plan);
    let finer = is_open_ended.then(|| search.finer(&best.island)).flatten();
    PilotResult {
        chosen: ChosenIsland {
            island,
            error,
            diverges: best.run.has_diverged,
        },
        long_run: finer.map(|finer| LongRunPair {
            contact_substeps: [&best.island, &finer].map(|island| search.contact_substeps(island)),
            own: best.island,
            finer,
        }),
    }
}

/// Chooses the runs of an island up to its first event that is more than faint, if friction may hold what earlier ones
/// strike.
fn choose_heard(
    island: &Assembled,
    mut excerpt: Excerpt,
    budget: &Budget,
    allowance: &Allowance,
) -> Result<(Runs, Spans), TrialError> {
    let plan = &island.island_plan;
    loop {
        let (runs, spans) = choose_runs(island, excerpt, budget, allowance)?;
        if !island.sticks() {
            return Ok((runs, spans));
        }
        let run = runs.play((plan, first_substeps(island, budget)), allowance)?;
        match longer(plan, excerpt) {
            Some(longer) if run.loudest_share < FAINT => excerpt = longer,
            _ => return Ok((runs, spans)),
        }
    }
}

/// Chooses the runs of an island and the spans over which they are compared: as long as the allowance pays for a
/// search. For an error budget a short comparison is better than none.
fn choose_runs(
    island: &Assembled,
    excerpt: Excerpt,
    budget: &Budget,
    allowance: &Allowance,
) -> Result<(Runs, Spans), TrialError> {
    let plan = &island.island_plan;
    let (runs, spans) = (Runs::new(excerpt), Spans::of(plan, excerpt.n_frames));
    if !matches!(budget, Budget::Error(_)) && plan.contact_substeps == 1 {
        return Ok((runs, spans));
    }
    let (before, _) = allowance.spent();
    let share = Cell::new(1.0);
    // A run that was stopped early is not kept: the shorter excerpt is played again as a whole.
    let heard = |frames: usize| frames.saturating_sub(spans.event()) as f64;
    let played = (plan, first_substeps(island, budget));
    runs.play_while(played, allowance, |frames, _| {
        let spent = allowance.spent().0 - before;
        let affordable = allowance.share_left(SEARCH_COST * spent);
        share.set(affordable * heard(frames) / heard(excerpt.n_frames));
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

/// The contact substeps that the search begins with.
fn first_substeps(island: &Assembled, budget: &Budget) -> usize {
    let own = island.island_plan.contact_substeps;
    let are_laws_fine = island.may_collocate && matches!(budget, Budget::Error(_));
    if are_laws_fine {
        own.max(Budget::STEPS_MIN)
    } else {
        own
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
