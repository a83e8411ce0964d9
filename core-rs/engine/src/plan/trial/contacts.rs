//! Chooses the number of substeps for contacts and laws: the smallest at which doubling it no longer changes the
//! result.

use std::cell::OnceCell;
use std::rc::Rc;

use crate::plan::budget::Budget;
use crate::plan::passes::assemble::Assembled;
use crate::plan::trial::allowance::{Allowance, TrialError};
use crate::plan::trial::audible::Audible;
use crate::plan::trial::chaos::{Pair, Parting, Stretches};
use crate::plan::trial::pilot_run::PilotRun;
use crate::plan::trial::runs::Runs;
use crate::plan::trial::waveform_error::{
    DOUBLING, ORDERS, Spans, at_most_first_order, difference, estimate_errors,
};

/// Orders of the error of contacts, also where they close or open, and of laws, many of which have a kink.
const CONTACT: f64 = 4.0;
const LAW: f64 = 2.0;
/// Refinement stops after `IDLE` doublings in a row that each gain less than `GAIN` [dB]: the remaining difference does
/// not come from contacts. (A steep law may begin to gain later.)
const IDLE: usize = 2;
const GAIN: f64 = 3.0;

/// The contact substeps that were chosen, and the run with them.
pub(in crate::plan) struct Contacts {
    pub(in crate::plan) contact_substeps: usize,
    pub(in crate::plan) error: Option<f64>,
    pub(in crate::plan) run: Rc<PilotRun>,
    /// How runs part, if the motion is chaotic; the error is then that of the time until they part.
    pub(in crate::plan) parting: Option<Parting>,
    /// More contact substeps gain nothing.
    is_idle: bool,
}

impl Contacts {
    /// The audible error of contacts; `None` if contacts are exact enough, the motion is chaotic, or the budget is not
    /// one of pitch.
    pub(in crate::plan) fn audible(
        &self,
        island: &Assembled,
        budget: &Budget,
        (runs, spans): (&Runs, &Spans),
        allowance: &Allowance,
    ) -> Result<Option<Audible>, TrialError> {
        let is_missed = self.error.is_some_and(|error| error > budget.contact());
        if !is_missed || self.parting.is_some() || !matches!(budget, Budget::Cents { .. }) {
            return Ok(None);
        }
        let finer = (&island.island_plan, 2 * self.contact_substeps);
        let finer = runs.play(finer, allowance)?;
        Ok(Audible::of_budget(budget, (&self.run, &finer.sound), spans))
    }

    /// How runs part if more contact substeps gain nothing because the motion is chaotic.
    pub(in crate::plan) fn chaos(&self) -> Option<&Parting> {
        self.parting.as_ref().filter(|_| self.is_idle)
    }

    /// The result of a run in which part of the island diverged: nothing else is known.
    fn lost(contact_substeps: usize, run: Rc<PilotRun>) -> Self {
        Self {
            contact_substeps,
            error: None,
            run,
            parting: None,
            is_idle: false,
        }
    }
}

/// Finds the fewest contact substeps that are enough, or as many as are worth it. Laws that are computed once a step
/// stay so unless `are_laws_fine`.
pub(in crate::plan) fn contacts(
    island: &Assembled,
    (budget, are_laws_fine): (&Budget, bool),
    runs: &Runs,
    (spans, stretches): (&Spans, &OnceCell<Stretches>),
    allowance: &Allowance,
) -> Result<Contacts, TrialError> {
    let island_plan = &island.island_plan;
    let n_frames = runs.excerpt().n_frames;
    let may_collocate = island.may_collocate && are_laws_fine;
    if island_plan.contact_substeps == 1 && !may_collocate {
        return Ok(Contacts {
            contact_substeps: 1,
            error: None,
            run: runs.play((island_plan, 1), allowance)?,
            parting: None,
            is_idle: false,
        });
    }
    let aim = budget.contact();
    let order = if island.may_collocate { LAW } else { CONTACT };
    let mut contact_substeps = island_plan.contact_substeps;
    let mut run = runs.play((island_plan, contact_substeps), allowance)?;
    let (mut last, mut before) = (None, None);
    let (mut parting, mut until) = (None, n_frames);
    // The error of the present run, and how it parts from others, if known.
    let mut known: Option<(f64, Option<Parting>)> = None;
    // The last run whose doubling still gained something; `idle` counts the doublings since then.
    let mut settled: Option<Contacts> = None;
    // A run that may agree with the finer one by chance.
    let mut unsure: Option<Contacts> = None;
    let mut idle = 0;
    loop {
        let finer = runs.play((island_plan, 2 * contact_substeps), allowance);
        let finer = match (finer, known.take()) {
            (Ok(finer), _) => finer,
            (Err(TrialError::AllowanceSpent), Some((error, parting))) => {
                return Ok(Contacts {
                    contact_substeps,
                    error: Some(error),
                    run,
                    parting,
                    is_idle: false,
                });
            }
            (Err(TrialError::AllowanceSpent), None) if run.is_lost => {
                return Ok(Contacts::lost(contact_substeps, run));
            }
            (Err(halt), _) => return Err(halt),
        };
        let pair = (!run.is_lost).then(|| Pair {
            run: &run,
            finer: &finer,
            spans,
            stretches: stretches.get_or_init(|| Stretches::of(&run.sound, spans)),
        });
        if let Some(pair) = pair {
            let was_chaotic = parting.is_some();
            if was_chaotic && pair.frames_until_parting().is_none() {
                // The runs seemed chaotic only because they were computed too roughly.
                parting = None;
            } else if !was_chaotic {
                parting = pair.parting(island_plan, contact_substeps, allowance)?;
            }
            if was_chaotic != parting.is_some() {
                // Chaotic runs are compared only until they part.
                let comparable = parting.as_ref().and_then(|_| pair.frames_until_parting());
                (until, last, before) = (comparable.unwrap_or(n_frames), None, None);
            }
        }
        let parting_of = |is_finer| {
            parting
                .as_ref()
                .zip(pair)
                .map(|(own, pair)| own.compare_other(&pair, is_finer))
        };
        let change = difference(&run.sound, &finer.sound, &spans.within(until));
        let last_change = last;
        let (own, left) = estimate_errors(change, last, order);
        // One substep is a different method: its change says nothing about the order of convergence.
        let is_between = contact_substeps > 1;
        let has_kinks = island.may_collocate && is_between;
        let stated = at_most_first_order(own, before);
        let stated_left = at_most_first_order(left, has_kinks.then_some(own));
        before = has_kinks.then_some(own);
        if let Some(found) = unsure.take()
            && own + DOUBLING <= aim
        {
            return Ok(Contacts {
                error: found.error.map(|error| error.max(own + DOUBLING)),
                ..found
            });
        }
        // With friction or a kinked law two runs may agree by chance; three in a row do not.
        let is_sure = last.is_some() || !(island.sticks() || island.may_collocate);
        let is_idle = !island.may_collocate && last.is_some_and(|last| change > last - GAIN);
        idle = if is_idle { idle + 1 } else { 0 };
        last = is_between.then_some(change);
        if own <= aim && stated <= budget.asked() && is_sure {
            let parting = parting_of(false);
            return Ok(Contacts {
                contact_substeps,
                error: Some(stated),
                run,
                parting,
                is_idle: false,
            });
        }
        contact_substeps *= 2;
        // With kinks, only a run that was compared with a finer one has a known error.
        let is_enough = left <= aim && is_sure && !island.may_collocate;
        if is_enough || 2 * contact_substeps > Budget::STEPS_MAX {
            return Ok(Contacts {
                contact_substeps,
                error: Some(stated_left),
                parting: parting_of(true),
                run: finer,
                is_idle: false,
            });
        }
        if idle == IDLE
            && let Some(settled) = settled
        {
            let chaos = pair.map(|pair| pair.chaos(island_plan, contact_substeps / 2, allowance));
            return Ok(Contacts {
                parting: chaos.transpose()?.flatten().or(settled.parting),
                is_idle: true,
                ..settled
            });
        }
        // If refinement ends here, no finer run has confirmed the order of smooth contacts.
        let (_, unproved) = estimate_errors(change, last_change, order.min(ORDERS.1));
        known = Some((stated_left.max(unproved), parting_of(true)));
        let found = Contacts {
            contact_substeps: contact_substeps / 2,
            error: Some(stated),
            parting: parting_of(false),
            run,
            is_idle: false,
        };
        if own <= aim && !is_sure {
            unsure = Some(found);
        } else if idle == 0 {
            settled = Some(found);
        }
        run = finer;
    }
}
