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
use crate::maths::{amplitude_ratio, sqrt};
use crate::network::Error;
use crate::plan::constants::{
    CREATED_ENERGY_SHARE_MAX, EQUAL_ERRORS_DB, ESTIMATE_MARGIN_DB, OVERSAMPLING_MAX, SPECTRUM_NOISE_DB,
};
use crate::plan::trial::allowance::{Allowance, TrialError, none_if_spent};
use crate::plan::trial::candidates::{Candidate, Candidates, CostRule, has_fine_links};
use crate::plan::trial::chaos::{ChaoticComparison, ComparedStretches, RunPair};
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_run::{EnergyGainShares, PilotRun, is_affordable};
use crate::plan::trial::reference::Reference;
use crate::plan::trial::run_cache::RunCache;
use crate::plan::trial::waveform_error::{
    ComparedSpans, EarlyComparison, amplitude_difference_db, amplitude_sum_db, difference_db,
};

/// What the trials of one island share.
pub(in crate::plan) struct CandidateSearch<'a, F> {
    pub(in crate::plan) assemble: &'a F,
    pub(in crate::plan) budget: &'a Budget,
    pub(in crate::plan) allowance: &'a Allowance,
    pub(in crate::plan) runs: &'a RunCache,
    pub(in crate::plan) spans: &'a ComparedSpans,
    pub(in crate::plan) reference: &'a Reference,
    /// The stretches of the reference, and how much a nudge grows, if the motion is chaotic.
    pub(in crate::plan) chaotic_stretches: Option<(&'a ComparedStretches, f64)>,
}

/// A candidate that was played.
#[derive(Clone)]
pub(in crate::plan) struct CandidateTrial {
    pub(in crate::plan) candidate: Candidate,
    pub(in crate::plan) run: Rc<PilotRun>,
    /// A bound of its error [dB].
    pub(in crate::plan) error_db: f64,
    /// How it parts from the reference; `None` if the motion is not chaotic.
    pub(in crate::plan) chaotic_comparison: Option<ChaoticComparison>,
    /// The audible error; `None` unless the budget is one of pitch and the motion is not chaotic.
    pub(in crate::plan) audible_error: Option<Audible>,
}

impl<F: Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>> CandidateSearch<'_, F> {
    /// The cheapest candidate within the budget, or the best of those tried; without any, the reference if a plan may
    /// choose it.
    pub(in crate::plan) fn find(&self) -> Result<Option<CandidateTrial>, Error> {
        let (cheapest, nearest) = self.try_candidates(false)?;
        let cheapest = match cheapest {
            Some(tried) => {
                let lower_order = none_if_spent(self.with_lower_order(&tried))?.flatten();
                Some(lower_order.unwrap_or(tried))
            }
            None => None,
        };
        Ok(cheapest.or(nearest).or_else(|| self.reference_as_trial()))
    }

    /// The cheapest candidate within the budget whose contacts and laws are computed once a step, or one step a frame
    /// with contacts between frames, if that is within the budget too and costs less than several steps in the mean.
    pub(in crate::plan) fn find_once_per_step(&self, cost_rule: CostRule) -> Result<Option<CandidateTrial>, Error> {
        let (cheapest, _) = self.try_candidates(true)?;
        let Some(cheapest_trial) = cheapest else {
            return Ok(None);
        };
        let between_frames = match (cheapest_trial.candidate.island.island_plan.oversampling, cost_rule) {
            (1, _) | (_, CostRule::Busiest) => None,
            (_, CostRule::Mean) => none_if_spent(self.with_contacts_between_frames(&cheapest_trial))?.flatten(),
        };
        Ok(Some(between_frames.unwrap_or(cheapest_trial)))
    }

    /// The same with contacts of a lower order, if it is within the budget and costs less.
    fn with_lower_order(&self, tried: &CandidateTrial) -> Result<Option<CandidateTrial>, TrialError> {
        let Candidate {
            island,
            contact_substeps: substeps,
            ..
        } = &tried.candidate;
        if *substeps != FINE_SUBSTEPS_MIN || !has_fine_links(island) {
            return Ok(None);
        }
        let mut orders = self.budget.contact_orders().iter();
        match orders.find(|order| order.number() < island.island_plan.contact_order.number()) {
            Some(&order) => self.cheaper_trial_with_order(&tried.candidate, order, tried),
            None => Ok(None),
        }
    }

    /// A candidate with contacts of this order, if it is within the budget and costs less than `limit`. Contacts that
    /// are open cost nothing, so its run ends where it is known to cost more.
    fn cheaper_trial_with_order(
        &self,
        candidate: &Candidate,
        order: ContactOrder,
        limit: &CandidateTrial,
    ) -> Result<Option<CandidateTrial>, TrialError> {
        let mut candidate = candidate.clone();
        candidate.island.island_plan.contact_order = order;
        let spent_before = self.allowance.spent_seconds();
        let should_continue = |_, _: &[f64]| self.allowance.spent_seconds() - spent_before <= limit.run.work_seconds;
        let played_plan = (&candidate.island.island_plan, candidate.contact_substeps);
        let run = self.runs.play_while(played_plan, self.allowance, should_continue)?;
        let run = run.filter(|run| !run.is_unusable && !self.creates_energy(&candidate.island, run));
        let tried = run.map(|run| self.compare(candidate, run));
        Ok(tried.filter(|tried| tried.candidate.frame_ns < limit.candidate.frame_ns && !self.misses_budget(tried)))
    }

    /// The island at one step a frame with contacts between frames, if it is within the budget and costs less than
    /// `once_per_step_trial`.
    fn with_contacts_between_frames(
        &self,
        once_per_step_trial: &CandidateTrial,
    ) -> Result<Option<CandidateTrial>, TrialError> {
        let Ok(island) = (self.assemble)(AssemblyOptions::between_steps(1, MethodChoice::ByBudget)) else {
            return Ok(None);
        };
        if !has_fine_links(&island) {
            return Ok(None);
        }
        let candidate = Candidate::new(island, FINE_SUBSTEPS_MIN, None);
        for &order in self.budget.contact_orders() {
            if let Some(tried) = self.cheaper_trial_with_order(&candidate, order, once_per_step_trial)? {
                return Ok(Some(tried));
            }
        }
        Ok(None)
    }

    /// The cheapest candidate within the budget, and the nearest that is not within it, of all or of those whose
    /// contacts and laws are computed once a step.
    fn try_candidates(
        &self,
        is_once_a_step_only: bool,
    ) -> Result<(Option<CandidateTrial>, Option<CandidateTrial>), Error> {
        let reference = (&self.reference.candidate, &*self.reference.run);
        let (mut cheapest, mut nearest): (Option<CandidateTrial>, Option<CandidateTrial>) = (None, None);
        let mut gains = SubstepGains::default();
        let mut candidates = Candidates::new(self.assemble, reference, is_once_a_step_only);
        // Candidates that were played may have cost more than was estimated; with more substeps they cost still more.
        let cost_limit = |cheapest: &Option<CandidateTrial>| {
            cheapest
                .as_ref()
                .map_or(f64::INFINITY, |tried| tried.candidate.frame_ns)
        };
        while let Some(candidate) = candidates.next_below(cost_limit(&cheapest)) {
            if (cheapest.iter()).any(|cheapest| candidate.is_finer_than(&cheapest.candidate)) {
                continue;
            }
            let n_frames = self.runs.excerpt().n_frames;
            let fits_work_limit = is_affordable(&candidate.island.island_plan, n_frames);
            let is_paid_for = candidate.is_affordable(self.allowance, n_frames);
            if !fits_work_limit || !is_paid_for || gains.gains_nothing(&candidate) {
                continue;
            }
            // Once the allowance is spent, what was tried is all there is.
            let Some(tried_result) = none_if_spent(self.measure(candidate, nearest.as_ref()))? else {
                break;
            };
            let Some(tried) = tried_result else { continue };
            gains.add(&tried);
            candidates.add_played(&tried.candidate, &tried.run);
            if !self.misses_budget(&tried) {
                let is_cheaper = |cheapest: &CandidateTrial| tried.candidate.frame_ns < cheapest.candidate.frame_ns;
                if cheapest.as_ref().is_none_or(is_cheaper) {
                    cheapest = Some(tried);
                }
            } else if nearest
                .as_ref()
                .is_none_or(|nearest| self.is_worth_its_cost(&tried, nearest))
            {
                nearest = Some(tried);
            }
        }
        Ok((cheapest, nearest))
    }

    /// The reference as a candidate, if its steps are no more than a plan may choose.
    fn reference_as_trial(&self) -> Option<CandidateTrial> {
        let Reference { candidate, run, .. } = self.reference;
        let is_allowed = candidate.island.island_plan.oversampling <= 2 * OVERSAMPLING_MAX;
        is_allowed.then(|| self.compare(candidate.clone(), run.clone()))
    }

    /// The error that a candidate has to stay below [dB].
    fn error_limit_db(&self) -> f64 {
        let error_margin = match horizon::error_may_grow(&self.reference.candidate.island.island_plan) {
            true => ESTIMATE_MARGIN_DB,
            false => 0.0,
        };
        self.budget.waveform_error_db() - error_margin
    }

    /// Plays a candidate, as long as its error may be within the budget or below that of `nearest`; `None` if it is
    /// not, or if the run is lost.
    fn measure(
        &self,
        candidate: Candidate,
        nearest: Option<&CandidateTrial>,
    ) -> Result<Option<CandidateTrial>, TrialError> {
        let is_by_waveform = matches!(self.budget, Budget::Error(_)) && self.chaotic_stretches.is_none();
        let error_limit = match nearest {
            Some(nearest) if is_by_waveform => self.error_limit_db().max(nearest.error_db - EQUAL_ERRORS_DB),
            _ => f64::INFINITY,
        };
        let mut comparison = EarlyComparison::with_reference(&self.reference.run.sound, self.spans);
        let should_continue = |frames: usize, sound: &[f64]| {
            let run_difference = comparison.update(frames, sound);
            run_difference.is_none_or(|run_difference| {
                amplitude_difference_db(run_difference, self.reference.error_db) <= error_limit
            })
        };
        let played_plan = (&candidate.island.island_plan, candidate.contact_substeps);
        let run = self.runs.play_while(played_plan, self.allowance, should_continue)?;
        let run = run.filter(|run| !run.is_unusable && !self.creates_energy(&candidate.island, run));
        Ok(run.map(|run| self.compare(candidate, run)))
    }

    /// Whether links will have created more energy by the end of the piece than is allowed. Contacts create energy by
    /// chance, in proportion to the square root of their number; laws as in the second half of a run, if they created
    /// more there than in the first.
    fn creates_energy(&self, island: &Assembled, run: &PilotRun) -> bool {
        // In a chaotic motion it is chance how much contacts create that lose nothing.
        if self.chaotic_stretches.is_some() && island.has_lossless_steps() {
            return true;
        }
        let excerpt = self.runs.excerpt();
        let [start_time, played_time] = [excerpt.first_frame, excerpt.n_frames].map(|n| n as f64 / self.spans.rate);
        let time_to_end = horizon::end_seconds(&self.reference.candidate.island.island_plan) - start_time;
        let length_ratio = (time_to_end / played_time).max(1.0);
        let EnergyGainShares {
            contact_share: contacts,
            law_shares: laws,
        } = run.energy_gains;
        let late_growth = (laws[1] - laws[0]).max(0.0);
        sqrt(length_ratio) * contacts > CREATED_ENERGY_SHARE_MAX
            || laws[1] + 2.0 * (length_ratio - 1.0) * late_growth > CREATED_ENERGY_SHARE_MAX
    }

    /// Compares a run with the reference.
    fn compare(&self, candidate: Candidate, run: Rc<PilotRun>) -> CandidateTrial {
        let reference = self.reference;
        let run_difference = difference_db(&run.sound, &reference.run.sound, self.spans);
        let chaotic_comparison = self.chaotic_stretches.map(|(stretches, growth)| {
            let run_pair = RunPair {
                coarse_run: &run,
                fine_run: &reference.run,
                spans: self.spans,
                stretches,
            };
            run_pair.compare(growth)
        });
        let audible = self
            .spans
            .audible_error(self.budget, (&run.sound, &reference.run.sound), reference.scatter());
        let audible = audible
            .zip(reference.audible_error)
            .filter(|_| chaotic_comparison.is_none());
        CandidateTrial {
            error_db: amplitude_sum_db([run_difference, reference.error_db]),
            audible_error: audible.map(|(run_audible, reference_audible)| run_audible.plus(reference_audible)),
            chaotic_comparison,
            candidate: candidate.with_counted_cost(&run),
            run,
        }
    }

    /// Whether the error of a candidate is above the budget.
    pub(in crate::plan) fn misses_budget(&self, tried: &CandidateTrial) -> bool {
        match (self.budget, &tried.chaotic_comparison) {
            (Budget::Error(_), None) => tried.error_db > self.error_limit_db(),
            // No waveform can be kept: the attack is judged by its waveform, the rest by its spectrum.
            (Budget::Error(_), Some(parting)) => {
                let error_aim = self.error_limit_db();
                (parting.attack_error_db > error_aim && parting.is_attainable(error_aim))
                    || parting.third_octave_db > SPECTRUM_NOISE_DB
            }
            (_, Some(parting)) => parting.third_octave_db > SPECTRUM_NOISE_DB,
            (_, None) => self.budget_excess(tried) > 1.0,
        }
    }

    /// The audible error, as a multiple of what a budget of pitch allows.
    fn budget_excess(&self, tried: &CandidateTrial) -> f64 {
        tried
            .audible_error
            .map_or(0.0, |audible| self.budget.excess_ratio(&audible))
    }

    /// Whether a candidate that misses the budget is enough better than `other` to be worth its cost.
    fn is_worth_its_cost(&self, tried: &CandidateTrial, other: &CandidateTrial) -> bool {
        match (&tried.chaotic_comparison, &other.chaotic_comparison) {
            (Some(parting), Some(other_parting)) => {
                let spectral_limit = other_parting.third_octave_db.max(SPECTRUM_NOISE_DB);
                parting.third_octave_db < spectral_limit - EQUAL_ERRORS_DB
                    || (parting.attack_error_db < other_parting.attack_error_db - EQUAL_ERRORS_DB
                        && parting.third_octave_db <= spectral_limit)
            }
            _ => match self.budget {
                Budget::Error(_) => tried.error_db < other.error_db - EQUAL_ERRORS_DB,
                _ => self.budget_excess(tried) < self.budget_excess(other) / amplitude_ratio(EQUAL_ERRORS_DB),
            },
        }
    }
}

/// What more substeps gained, for each group of candidates: the least error so far, and whether the last one gained
/// nothing.
#[derive(Default)]
struct SubstepGains(BTreeMap<usize, (f64, bool)>);

impl SubstepGains {
    /// Whether more substeps are known to gain nothing.
    fn gains_nothing(&self, candidate: &Candidate) -> bool {
        let group_gain = self.0.get(&candidate.group_index);
        candidate.contact_substeps > 1 && group_gain.is_some_and(|(_, is_idle)| *is_idle)
    }

    fn add(&mut self, tried: &CandidateTrial) {
        if tried.candidate.contact_substeps > 1 {
            let group_gain = self.0.get(&tried.candidate.group_index);
            let is_idle = group_gain.is_some_and(|(least_error, _)| tried.error_db >= *least_error);
            let least_error = group_gain.map_or(tried.error_db, |(least_error, _)| least_error.min(tried.error_db));
            self.0.insert(tried.candidate.group_index, (least_error, is_idle));
        }
    }
}
