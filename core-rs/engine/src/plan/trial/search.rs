//! The search: candidates are tried in rising order of cost, each against the reference, and the first within the
//! budget is taken.
//!
//! The error of a candidate does not depend on the budget. So a stricter budget finds one that is at least as exact,
//! and a looser one finds one that costs at most as much. If none is within the budget, the best of those tried is
//! taken.

use std::collections::BTreeMap;
use std::rc::Rc;

use crate::assembly::assemble::{Assembled, AssemblyOptions};
use crate::assembly::budget::Budget;
use crate::assembly::mesh::MethodChoice;
use crate::hearing::Audible;
use crate::island::{ContactOrder, FINE_SUBSTEPS_MIN};
use crate::maths::{decibels, sqrt};
use crate::network::Error;
use crate::plan::constants::{
    CREATED_SHARE_MAX, EQUAL_ERRORS_DB, ESTIMATE_MARGIN_DB, OVERSAMPLING_MAX, SPECTRUM_NOISE,
};
use crate::plan::trial::allowance::{Allowance, TrialError, unless_spent};
use crate::plan::trial::candidates::{Candidate, candidates, has_fine};
use crate::plan::trial::chaos::{Pair, Parting, Stretches};
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_run::{Created, PilotRun, is_affordable};
use crate::plan::trial::reference::Reference;
use crate::plan::trial::runs::Runs;
use crate::plan::trial::waveform_error::{EarlyComparison, Spans, amplitude_difference, amplitude_sum, difference};

/// What the trials of one island share.
pub(in crate::plan) struct Search<'a, F> {
    pub(in crate::plan) assemble: &'a F,
    pub(in crate::plan) budget: &'a Budget,
    pub(in crate::plan) allowance: &'a Allowance,
    pub(in crate::plan) runs: &'a Runs,
    pub(in crate::plan) spans: &'a Spans,
    pub(in crate::plan) reference: &'a Reference,
    /// The stretches of the reference, and how much a nudge grows, if the motion is chaotic.
    pub(in crate::plan) chaos: Option<(&'a Stretches, f64)>,
}

/// A candidate that was played.
#[derive(Clone)]
pub(in crate::plan) struct Tried {
    pub(in crate::plan) candidate: Candidate,
    pub(in crate::plan) run: Rc<PilotRun>,
    /// A bound of its error [dB].
    pub(in crate::plan) error: f64,
    /// How it parts from the reference; `None` if the motion is not chaotic.
    pub(in crate::plan) parting: Option<Parting>,
    /// The audible error; `None` unless the budget is one of pitch and the motion is not chaotic.
    pub(in crate::plan) audible: Option<Audible>,
}

impl<F: Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>> Search<'_, F> {
    /// The cheapest candidate within the budget, or the best of those tried; without any, the reference if a plan may
    /// choose it.
    pub(in crate::plan) fn find(&self) -> Result<Option<Tried>, Error> {
        let (cheapest, nearest) = self.try_candidates(|_| true)?;
        let cheapest = match cheapest {
            Some(tried) => {
                let lower_order = unless_spent(self.lower_order(&tried))?.flatten();
                Some(lower_order.unwrap_or(tried))
            }
            None => None,
        };
        Ok(cheapest.or(nearest).or_else(|| self.reference_itself()))
    }

    /// The cheapest candidate within the budget whose contacts and laws are computed once a step, or one step a frame
    /// with contacts between frames, if that is within the budget too and costs less than several steps.
    pub(in crate::plan) fn find_plain(&self) -> Result<Option<Tried>, Error> {
        let (cheapest, _) = self.try_candidates(|candidate| candidate.substeps == 1)?;
        let Some(plain_tried) = cheapest else {
            return Ok(None);
        };
        let between_frames = match plain_tried.candidate.island.island_plan.oversampling {
            1 => None,
            _ => unless_spent(self.between_frames(&plain_tried))?.flatten(),
        };
        Ok(Some(between_frames.unwrap_or(plain_tried)))
    }

    /// The same with contacts of a lower order, if it is within the budget and costs less.
    fn lower_order(&self, tried: &Tried) -> Result<Option<Tried>, TrialError> {
        let Candidate { island, substeps, .. } = &tried.candidate;
        if *substeps != FINE_SUBSTEPS_MIN || !has_fine(island) {
            return Ok(None);
        }
        let mut orders = self.budget.contact_orders().iter();
        match orders.find(|order| order.number() < island.island_plan.contact_order.number()) {
            Some(&order) => self.cheaper_with_order(&tried.candidate, order, tried),
            None => Ok(None),
        }
    }

    /// A candidate with contacts of this order, if it is within the budget and costs less than `limit`. Contacts that
    /// are open cost nothing, so its run ends where it is known to cost more.
    fn cheaper_with_order(
        &self,
        candidate: &Candidate,
        order: ContactOrder,
        limit: &Tried,
    ) -> Result<Option<Tried>, TrialError> {
        let mut candidate = candidate.clone();
        candidate.island.island_plan.contact_order = order;
        let (spent_before, _) = self.allowance.spent();
        let goes_on = |_, _: &[f64]| self.allowance.spent().0 - spent_before <= limit.run.work;
        let played_plan = (&candidate.island.island_plan, candidate.substeps);
        let run = self.runs.play_while(played_plan, self.allowance, goes_on)?;
        let run = run.filter(|run| !run.is_lost && !self.creates_energy(&candidate.island, run));
        let tried = run.map(|run| self.compare(candidate, run));
        Ok(tried.filter(|tried| tried.candidate.cost < limit.candidate.cost && !self.misses(tried)))
    }

    /// The island at one step a frame with contacts between frames, if it is within the budget and costs less than
    /// `plain`.
    fn between_frames(&self, plain: &Tried) -> Result<Option<Tried>, TrialError> {
        let Ok(island) = (self.assemble)(AssemblyOptions::fine(1, MethodChoice::ByBudget)) else {
            return Ok(None);
        };
        if !has_fine(&island) {
            return Ok(None);
        }
        let candidate = Candidate::new(island, FINE_SUBSTEPS_MIN, None);
        for &order in self.budget.contact_orders() {
            if let Some(tried) = self.cheaper_with_order(&candidate, order, plain)? {
                return Ok(Some(tried));
            }
        }
        Ok(None)
    }

    /// The cheapest candidate within the budget of those that are offered, and the nearest that is not within it.
    fn try_candidates(&self, is_offered: impl Fn(&Candidate) -> bool) -> Result<(Option<Tried>, Option<Tried>), Error> {
        let reference = (&self.reference.candidate, &*self.reference.run);
        let (mut cheapest, mut nearest): (Option<Tried>, Option<Tried>) = (None, None);
        let mut gains = Gains::default();
        let all_candidates = candidates(self.assemble, reference);
        for candidate in all_candidates.into_iter().filter(is_offered) {
            // Candidates that were played may have cost more than was estimated; with more substeps they cost still
            // more.
            if let Some(cheapest) = &cheapest {
                if candidate.cost >= cheapest.candidate.cost {
                    break;
                }
                if candidate.is_finer_than(&cheapest.candidate) {
                    continue;
                }
            }
            let n_frames = self.runs.excerpt().n_frames;
            let fits_work_limit = is_affordable(&candidate.island.island_plan, n_frames);
            let is_paid_for = candidate.is_within(self.allowance, n_frames);
            if !fits_work_limit || !is_paid_for || gains.is_idle(&candidate) {
                continue;
            }
            // Once the allowance is spent, what was tried is all there is.
            let Some(tried_result) = unless_spent(self.measure(candidate, nearest.as_ref()))? else {
                break;
            };
            let Some(tried) = tried_result else { continue };
            gains.add(&tried);
            if !self.misses(&tried) {
                let is_cheaper = |cheapest: &Tried| tried.candidate.cost < cheapest.candidate.cost;
                if cheapest.as_ref().is_none_or(is_cheaper) {
                    cheapest = Some(tried);
                }
            } else if nearest.as_ref().is_none_or(|nearest| self.beats(&tried, nearest)) {
                nearest = Some(tried);
            }
        }
        Ok((cheapest, nearest))
    }

    /// The reference as a candidate, if its steps are no more than a plan may choose.
    fn reference_itself(&self) -> Option<Tried> {
        let Reference { candidate, run, .. } = self.reference;
        let is_allowed = candidate.island.island_plan.oversampling <= 2 * OVERSAMPLING_MAX;
        is_allowed.then(|| self.compare(candidate.clone(), run.clone()))
    }

    /// The error that a candidate has to stay below [dB].
    fn aim(&self) -> f64 {
        let error_margin = match horizon::error_may_grow(&self.reference.candidate.island.island_plan) {
            true => ESTIMATE_MARGIN_DB,
            false => 0.0,
        };
        self.budget.asked() - error_margin
    }

    /// Plays a candidate, as long as its error may be within the budget or below that of `nearest`; `None` if it is
    /// not, or if the run is lost.
    fn measure(&self, candidate: Candidate, nearest: Option<&Tried>) -> Result<Option<Tried>, TrialError> {
        let is_by_waveform = matches!(self.budget, Budget::Error(_)) && self.chaos.is_none();
        let error_limit = match nearest {
            Some(nearest) if is_by_waveform => self.aim().max(nearest.error - EQUAL_ERRORS_DB),
            _ => f64::INFINITY,
        };
        let mut comparison = EarlyComparison::against(&self.reference.run.sound, self.spans);
        let goes_on = |frames: usize, sound: &[f64]| {
            let run_difference = comparison.update(frames, sound);
            run_difference
                .is_none_or(|run_difference| amplitude_difference(run_difference, self.reference.error) <= error_limit)
        };
        let played_plan = (&candidate.island.island_plan, candidate.substeps);
        let run = self.runs.play_while(played_plan, self.allowance, goes_on)?;
        let run = run.filter(|run| !run.is_lost && !self.creates_energy(&candidate.island, run));
        Ok(run.map(|run| self.compare(candidate, run)))
    }

    /// Whether links will have created more energy by the end of the piece than is allowed. Contacts create energy by
    /// chance, in proportion to the square root of their number; laws as in the second half of a run, if they created
    /// more there than in the first.
    fn creates_energy(&self, island: &Assembled, run: &PilotRun) -> bool {
        // In a chaotic motion it is chance how much contacts create that lose nothing.
        if self.chaos.is_some() && island.has_lossless_steps() {
            return true;
        }
        let excerpt = self.runs.excerpt();
        let [start_time, played_time] = [excerpt.from, excerpt.n_frames].map(|n| n as f64 / self.spans.rate);
        let time_to_end = horizon::end(&self.reference.candidate.island.island_plan) - start_time;
        let length_ratio = (time_to_end / played_time).max(1.0);
        let Created { contacts, laws } = run.created;
        let late_growth = (laws[1] - laws[0]).max(0.0);
        sqrt(length_ratio) * contacts > CREATED_SHARE_MAX
            || laws[1] + 2.0 * (length_ratio - 1.0) * late_growth > CREATED_SHARE_MAX
    }

    /// Compares a run with the reference.
    fn compare(&self, candidate: Candidate, run: Rc<PilotRun>) -> Tried {
        let reference = self.reference;
        let run_difference = difference(&run.sound, &reference.run.sound, self.spans);
        let parting = self.chaos.map(|(stretches, growth)| {
            let run_pair = Pair {
                run: &run,
                finer: &reference.run,
                spans: self.spans,
                stretches,
            };
            run_pair.compare(growth)
        });
        let audible = self
            .spans
            .audible_error(self.budget, (&run.sound, &reference.run.sound));
        let audible = audible.zip(reference.audible).filter(|_| parting.is_none());
        Tried {
            error: amplitude_sum([run_difference, reference.error]),
            audible: audible.map(|(run_audible, reference_audible)| run_audible.plus(reference_audible)),
            parting,
            candidate: candidate.counted(&run),
            run,
        }
    }

    /// Whether the error of a candidate is above the budget.
    pub(in crate::plan) fn misses(&self, tried: &Tried) -> bool {
        match (self.budget, &tried.parting) {
            (Budget::Error(_), None) => tried.error > self.aim(),
            // No waveform can be kept: the attack is judged by its waveform, the rest by its spectrum.
            (Budget::Error(_), Some(parting)) => {
                let error_aim = self.aim();
                (parting.attack > error_aim && parting.is_attainable(error_aim)) || parting.spectral > SPECTRUM_NOISE
            }
            (_, Some(parting)) => parting.spectral > SPECTRUM_NOISE,
            (_, None) => self.excess(tried) > 1.0,
        }
    }

    /// The audible error, as a multiple of what a budget of pitch allows.
    fn excess(&self, tried: &Tried) -> f64 {
        tried.audible.map_or(0.0, |audible| self.budget.excess(&audible))
    }

    /// Whether a candidate that misses the budget is enough better than `other` to be worth its cost.
    fn beats(&self, tried: &Tried, other: &Tried) -> bool {
        match (&tried.parting, &other.parting) {
            (Some(parting), Some(other_parting)) => {
                let spectral_limit = other_parting.spectral.max(SPECTRUM_NOISE);
                parting.spectral < spectral_limit - EQUAL_ERRORS_DB
                    || (parting.attack < other_parting.attack - EQUAL_ERRORS_DB && parting.spectral <= spectral_limit)
            }
            _ => match self.budget {
                Budget::Error(_) => tried.error < other.error - EQUAL_ERRORS_DB,
                _ => self.excess(tried) < self.excess(other) / decibels(EQUAL_ERRORS_DB),
            },
        }
    }
}

/// What more substeps gained, for each group of candidates: the least error so far, and whether the last one gained
/// nothing.
#[derive(Default)]
struct Gains(BTreeMap<usize, (f64, bool)>);

impl Gains {
    /// Whether more substeps are known to gain nothing.
    fn is_idle(&self, candidate: &Candidate) -> bool {
        let group_gain = self.0.get(&candidate.group);
        candidate.substeps > 1 && group_gain.is_some_and(|(_, is_idle)| *is_idle)
    }

    fn add(&mut self, tried: &Tried) {
        if tried.candidate.substeps > 1 {
            let group_gain = self.0.get(&tried.candidate.group);
            let is_idle = group_gain.is_some_and(|(least_error, _)| tried.error >= *least_error);
            let least_error = group_gain.map_or(tried.error, |(least_error, _)| least_error.min(tried.error));
            self.0.insert(tried.candidate.group, (least_error, is_idle));
        }
    }
}
