//! A pilot: plays the beginning of an island to choose how it is computed.
//!
//! It ends a while after the first contact, or after the first event if nothing touches. It gives the contact substeps
//! (the beginning at S and 2S substeps: the difference is the error), the modes of each body that this score excites,
//! and the oversampling of the whole island (again by such a difference).

use std::cell::{Cell, OnceCell};
use std::rc::Rc;

use crate::network::Error;
use crate::plan::budget::Budget;
use crate::plan::passes::assemble::Assembled;
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::report::row::Measured;
use crate::plan::trial::allowance::{Allowance, TrialError, unless_spent};
use crate::plan::trial::audible::Audible;
use crate::plan::trial::chaos::Parting;
use crate::plan::trial::cheapest;
use crate::plan::trial::contacts::contacts;
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_result::{ChosenIsland, LongRunPair, PilotResult};
use crate::plan::trial::pilot_run::{Excerpt, PilotRun, find_excerpt};
use crate::plan::trial::prune_modes::prune;
use crate::plan::trial::runs::Runs;
use crate::plan::trial::search::{Candidate, Search, TIMES_MAX};
use crate::plan::trial::waveform_error::{PARTS, Spans, amplitude_difference, power_sum};

/// Work of a search in multiples of its first run, if contacts dominate the cost: they are also computed twice and four
/// times as finely, and at half the step.
const SEARCH_COST: f64 = 12.0;

/// Finds the cheapest island within the budget; `assemble` puts the island together at some oversampling.
pub(in crate::plan) fn pilot(
    assemble: &impl Fn((u32, MethodChoice<'_>)) -> Result<Assembled, Error>,
    budget: &Budget,
    allowance: &Allowance,
) -> Result<PilotResult, Error> {
    if let Budget::Method(_) = budget {
        return Ok(ChosenIsland::unmeasured(assemble((1, MethodChoice::ByBudget))?).into());
    }
    let island = lowest_stable(assemble)?;
    let timeline = &island.island_plan.timeline;
    if timeline.is_open || timeline.hands().next().is_some() {
        // Nobody knows beforehand what a hand or a session will do: nothing is left out.
        return Ok(ChosenIsland::unmeasured(island).into());
    }
    let excerpt = unless_spent(find_excerpt(&island.island_plan, allowance))?;
    let Some(excerpt) = excerpt.filter(|excerpt| excerpt.n_frames > 0) else {
        return Ok(ChosenIsland::unmeasured(island).into());
    };
    let chosen = unless_spent(choose_runs(&island, excerpt, budget, allowance))?;
    let Some((runs, spans)) = chosen else {
        return Ok(ChosenIsland::unmeasured(island).into());
    };
    let (excerpt, stretches) = (runs.excerpt(), OnceCell::new());
    let heard = (&spans, &stretches);
    let trial = (assemble, &runs, budget, allowance);
    let seconds = |frames: usize| (excerpt.from + frames) as f64 / spans.rate;
    let pruned = |island: &Assembled, (steps, run): (usize, &PilotRun), most: Option<f64>| {
        prune(island, (steps, run), (excerpt, budget, most), allowance)
    };
    let pruned_within = |best: &Candidate| {
        let left = amplitude_difference(budget.asked(), best.error);
        let most = budget.left_out().map(|most| most.min(left));
        pruned(&best.island, (best.contact_substeps, &best.run), most)
    };
    let first = OnceCell::new();
    let as_assembled = (&island, island.island_plan.contact_substeps);
    let plainly = Search::new(trial, (&spans, &first), as_assembled, None);
    if let Some(best) = plainly.plain(&island)? {
        let error = Measured {
            db: best.error,
            over: seconds(excerpt.n_frames),
            spectral: None,
            audible: None,
        };
        let island = pruned_within(&best)?;
        return Ok(finished(&plainly, best, island, Some(error)));
    }
    let contacts = |are_laws_fine: bool| {
        let fineness = (budget, are_laws_fine);
        unless_spent(contacts(&island, fineness, &runs, heard, allowance))
    };
    // If the budget does not promise a waveform, laws are exact enough at one computation a step.
    let is_by_waveform = matches!(budget, Budget::Error(_));
    let Some(mut found) = contacts(is_by_waveform)? else {
        return Ok(ChosenIsland::unmeasured(island).into());
    };
    let mut search = Search::new(
        trial,
        heard,
        (&island, found.contact_substeps),
        found.chaos(),
    );
    let mut start = search.start(&island, &found.run)?;
    // A steep law that is computed once a frame may chatter; two runs then differ as if the motion were chaotic.
    let may_chatter = island.may_collocate && !is_by_waveform;
    if may_chatter
        && start.as_ref().is_some_and(Candidate::differs_by_spectrum)
        && let Some(fine) = contacts(true)?
    {
        found = fine;
        search = Search::new(
            trial,
            heard,
            (&island, found.contact_substeps),
            found.chaos(),
        );
        start = search.start(&island, &found.run)?;
    }
    let of_contacts = unless_spent(found.audible(&island, budget, (&runs, &spans), allowance))?;
    let stated_error = |own: Option<f64>, parting: Option<&Parting>, audible: Option<Audible>| {
        if let (Some(parting), Some(stretches)) = (parting, stretches.get()) {
            let (db, until) = parting.valid_span(budget.asked(), stretches);
            return Some(Measured {
                db,
                over: seconds(until),
                spectral: Some(parting.spectral),
                audible: None,
            });
        }
        own.map(|own| Measured {
            db: power_sum(own, found.error.unwrap_or(f64::NEG_INFINITY)),
            over: seconds(excerpt.n_frames),
            spectral: None,
            audible: audible.map(|own| own.with(of_contacts.flatten().unwrap_or_default())),
        })
    };
    let Some(start) = start else {
        if found.run.is_lost
            && let Some((island, run)) = unconditionally_stable(assemble, &runs, allowance)?
        {
            let steps = island.island_plan.contact_substeps;
            let island = match run {
                Some(run) => pruned(&island, (steps, &run), budget.left_out())?,
                None => island,
            };
            return Ok(ChosenIsland::unmeasured(island).into());
        }
        // Only contacts and laws were held against finer ones. That is the error of the island if it is chaotic.
        let error = stated_error(None, found.parting.as_ref(), None);
        let own = (found.contact_substeps, &*found.run);
        let chosen = ChosenIsland {
            island: pruned(&island, own, budget.left_out())?,
            error,
            diverges: found.run.is_lost,
        };
        return Ok(chosen.into());
    };
    let mut best = search.improve(start, budget)?;
    if best.run.is_lost
        && let Some((island, run)) = unconditionally_stable(assemble, &runs, allowance)?
    {
        let Some(run) = run else {
            return Ok(ChosenIsland::unmeasured(island).into());
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
    // An island that is lost, or whose meshes cannot diverge, was compared with nothing.
    let own = Some(best.error).filter(|own| own.is_finite());
    let parting = match best.parting.clone() {
        Some(parting) => Some(parting.with(found.parting.as_ref())),
        None => found.parting.clone(),
    };
    let mut error = stated_error(own, parting.as_ref(), best.audible);
    let own = (best.contact_substeps, &*best.run);
    let mut island = pruned(&best.island, own, budget.left_out())?;
    if let Some(measured) = error
        && matches!(budget, Budget::Error(_))
        && measured.spectral.is_none()
    {
        let part = allowance.fraction(cheapest::SHARE);
        let search = Search {
            allowance: &part,
            ..search
        };
        // If the search ended above the budget, any way within it is better.
        let cost = match measured.db <= budget.asked() {
            true => island.island_plan.cost(),
            false => f64::INFINITY,
        };
        let cheaper = search.cheapest((&best, cost), found.error)?;
        allowance.spend_fraction(&part, cheapest::SHARE);
        if let Some(cheaper) = cheaper {
            best = cheaper;
            // This error includes that of contacts.
            error = Some(Measured {
                db: best.error,
                ..measured
            });
            island = pruned_within(&best)?;
        }
    }
    Ok(finished(&search, best, island, error))
}

/// The result of a search: the best way, the same island without modes that are not heard, and its error.
fn finished<F: Fn((u32, MethodChoice<'_>)) -> Result<Assembled, Error>>(
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
            diverges: best.run.is_lost,
        },
        long_run: finer.map(|finer| LongRunPair {
            contact_substeps: [&best.island, &finer].map(|island| search.contact_substeps(island)),
            own: best.island,
            finer,
        }),
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
    if !matches!(budget, Budget::Error(_)) {
        return Ok((runs, spans));
    }
    let (before, _) = allowance.spent();
    let share = Cell::new(1.0);
    // A run that was stopped early is not kept: the shorter excerpt is played again as a whole.
    let heard = |frames: usize| frames.saturating_sub(spans.event()) as f64;
    let played = (plan, plan.contact_substeps);
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

/// An island whose meshes cannot diverge, and its run, if the allowance paid for one.
type StableIsland = (Assembled, Option<Rc<PilotRun>>);

/// Assembles the island with meshes that cannot diverge, and plays it if the allowance lets it; `None` if it is lost
/// too.
fn unconditionally_stable(
    assemble: &impl Fn((u32, MethodChoice<'_>)) -> Result<Assembled, Error>,
    runs: &Runs,
    allowance: &Allowance,
) -> Result<Option<StableIsland>, Error> {
    let Ok(island) = assemble((1, MethodChoice::Unconditional)) else {
        return Ok(None);
    };
    let steps = island.island_plan.contact_substeps;
    let run = unless_spent(runs.play((&island.island_plan, steps), allowance))?;
    let is_lost = run.as_ref().is_some_and(|run| run.is_lost);
    Ok((!is_lost).then_some((island, run)))
}

/// The island at the lowest oversampling at which it is stable.
fn lowest_stable(
    assemble: &impl Fn((u32, MethodChoice<'_>)) -> Result<Assembled, Error>,
) -> Result<Assembled, Error> {
    match assemble((1, MethodChoice::ByBudget)) {
        // An island that diverges at this rate may be stable at a higher one.
        Err(error @ Error::Unstable { .. }) => {
            let higher = [2, 4, 8, 2 * TIMES_MAX].into_iter();
            let mut stable = higher
                .filter_map(|oversampling| assemble((oversampling, MethodChoice::ByBudget)).ok());
            stable.next().ok_or(error)
        }
        other => other,
    }
}
