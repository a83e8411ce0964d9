//! Parts that a plan makes slow without being asked: keys, and what is only seen.
//!
//! Such an offer is taken only after a measurement, if the island then costs less and sounds the same.

use super::{PlanBuilder, PlannedIsland};
use crate::assembly::budget::Budget;
use crate::assembly::choice::{BodyChoice, SteppedChoice};
use crate::assembly::cost;
use crate::assembly::split::LocalTimeline;
use crate::island::bodies::BodyPlan;
use crate::network::Subset;
use crate::plan::constants::{DISPLAYED_ERROR_SHARE, PRESERVED_LIMITS, SLOW_COST_RATIO_MAX};
use crate::plan::row::MeasuredError;
use crate::plan::trial::multirate::{self, OfferedParts};

/// Why a part that asks for a rate of its own does not get it, if its island is better without.
const NO_GAIN_REASON: &str = "at every frame its island keeps the budget, or keeps it at less cost";

impl PlanBuilder<'_> {
    /// The island without slow parts that asked for it, if it misses its budget with them, takes more steps a frame for
    /// it, or has one that is dearer than without a rate, and is within the budget without them, at less cost if both
    /// are.
    pub(super) fn drop_unhelpful_rates(
        &self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        rated_island: PlannedIsland,
    ) -> PlannedIsland {
        let is_within = rated_island.is_within_budget(self.budget);
        let island_plan = &rated_island.chosen_island.island.island_plan;
        let is_costlier =
            |body: &BodyPlan| matches!(body, BodyPlan::Slow(slow_body) if cost::costs_more_than_stepping(slow_body));
        let needs_comparison = !is_within || island_plan.oversampling > 1 || island_plan.bodies.iter().any(is_costlier);
        if rated_island.slow_growth.is_none() || island_timeline.timeline.is_open || !needs_comparison {
            return rated_island;
        }
        let refused_slow = multirate::refuse_all(subset, NO_GAIN_REASON);
        let plain_subset = multirate::without_slow(subset, &refused_slow);
        match self.choose_stepping(&plain_subset, island_timeline, None) {
            Ok(plain_island)
                if plain_island.is_within_budget(self.budget)
                    && !(is_within && rated_island.frame_ns() <= plain_island.frame_ns()) =>
            {
                PlannedIsland {
                    refused_slow_parts: refused_slow,
                    ..plain_island
                }
            }
            _ => rated_island,
        }
    }

    /// The island with what is only seen slow, and with its keys slow, wherever that is cheaper and sounds the same.
    pub(super) fn offer_slow_parts(
        &self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        plain_island: PlannedIsland,
    ) -> PlannedIsland {
        let (slowed_subset, mut best_island) = self.offer_displayed_parts(subset, island_timeline, plain_island);
        let subset = slowed_subset.as_ref().unwrap_or(subset);
        for &(macrostep, error_limit) in &PRESERVED_LIMITS {
            // Without allowance an offer cannot be measured.
            if self.allowance.n_refused_trials() > 0 {
                break;
            }
            let error_max = error_limit.min(self.budget.contact_error_db_max());
            let slow_keys =
                multirate::with_offered_slow(subset, island_timeline, self.budget, OfferedParts::Keys, macrostep);
            let is_better = |candidate: &PlannedIsland, best_island: &PlannedIsland| {
                candidate.slow_error.is_some_and(|error| error.waveform_db <= error_max)
                    && candidate.frame_ns() < SLOW_COST_RATIO_MAX * best_island.frame_ns()
                    && candidate.is_as_exact(best_island, self.budget)
            };
            if let Some(slow_subset) = slow_keys
                && let Some(candidate) = self.planned_if_better(&slow_subset, island_timeline, &best_island, is_better)
            {
                best_island = candidate;
            }
        }
        best_island
    }

    /// The island with what is only seen computed as seldom as `displayed_frame_interval` says, or more often if that
    /// would be heard.
    fn offer_displayed_parts(
        &self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        plain_island: PlannedIsland,
    ) -> (Option<Subset>, PlannedIsland) {
        let mut macrostep = self.displayed_frame_interval;
        while macrostep > 1 && self.allowance.n_refused_trials() == 0 {
            let slower_subset = multirate::with_offered_slow(
                subset,
                island_timeline,
                self.budget,
                OfferedParts::DisplayedOnly,
                macrostep,
            );
            let is_better = |candidate: &PlannedIsland, plain_island: &PlannedIsland| {
                candidate.is_slow_error_inaudible(self.budget)
                    && candidate.frame_ns() < plain_island.frame_ns()
                    && candidate.sounds_as_exact(plain_island, self.budget)
            };
            if let Some(slowed_subset) = slower_subset
                && let Some(candidate) =
                    self.planned_if_better(&slowed_subset, island_timeline, &plain_island, is_better)
            {
                return (Some(slowed_subset), candidate);
            }
            macrostep /= 2;
        }
        (None, plain_island)
    }

    /// Solves an island with offered slow parts, and returns it if it `is_better` compared with the island without
    /// them.
    fn planned_if_better(
        &self,
        slow_subset: &Subset,
        island_timeline: &LocalTimeline,
        plain_island: &PlannedIsland,
        is_better: impl Fn(&PlannedIsland, &PlannedIsland) -> bool,
    ) -> Option<PlannedIsland> {
        let candidate = self.choose_stepping(slow_subset, island_timeline, None).ok()?;
        is_better(&candidate, plain_island).then(|| PlannedIsland {
            is_slow_by_plan: true,
            refused_slow_parts: plain_island.refused_slow_parts.clone(),
            ..candidate
        })
    }

    /// The island as it was decided before, if that made parts slow that did not ask for it, or not those that did.
    pub(super) fn planned_by_pin(
        &self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        pin: &SteppedChoice,
    ) -> Option<PlannedIsland> {
        let plain_subset = multirate::without_slow(subset, &multirate::refuse_all(subset, NO_GAIN_REASON));
        if subset.network.has_slow_parts()
            && let Ok(planned_island) = self.choose_stepping(&plain_subset, island_timeline, Some(pin))
        {
            return Some(planned_island);
        }
        let oversampling = pin.oversampling;
        let mut tried_intervals = vec![1];
        for body in &pin.bodies {
            if let BodyChoice::Slow { macrostep } = *body
                && macrostep > oversampling
                && !tried_intervals.contains(&(macrostep / oversampling))
            {
                tried_intervals.push(macrostep / oversampling);
            }
        }
        let offer_slow = |subset: &Subset, offered, macrostep| match macrostep {
            1 => Some(subset.clone()),
            _ => multirate::with_offered_slow(subset, island_timeline, self.budget, offered, macrostep),
        };
        let interval_pairs = tried_intervals.iter().flat_map(|displayed_interval| {
            tried_intervals
                .iter()
                .map(move |key_interval| (*displayed_interval, *key_interval))
        });
        let mut first_offer = interval_pairs
            .filter(|&interval_pair| interval_pair != (1, 1))
            .filter_map(|(displayed_interval, key_interval)| {
                let slow_subset = offer_slow(subset, OfferedParts::DisplayedOnly, displayed_interval)?;
                let slow_subset = offer_slow(&slow_subset, OfferedParts::Keys, key_interval)?;
                self.choose_stepping(&slow_subset, island_timeline, Some(pin)).ok()
            });
        Some(PlannedIsland {
            is_slow_by_plan: true,
            ..first_offer.next()?
        })
    }
}

impl PlannedIsland {
    fn frame_ns(&self) -> f64 {
        self.chosen_island.island.island_plan.frame_ns()
    }

    /// Whether its error, and the one that slow parts add, are known to be within the budget.
    fn is_within_budget(&self, budget: &Budget) -> bool {
        let is_within = |error: MeasuredError| error.is_regular_within(budget);
        self.chosen_island.measured_error.is_some_and(is_within) && self.slow_error.is_none_or(is_within)
    }

    /// Whether the error that slow parts add stays within their share of what is allowed.
    fn is_slow_error_inaudible(&self, budget: &Budget) -> bool {
        self.slow_error.is_some_and(|error| {
            let error_excess = error.budget_excess(budget);
            // If the waveforms part later, third octaves have to agree: their difference limen is 1 dB.
            let spectral_excess = match (error.third_octave_db, budget) {
                (None, _) => 0.0,
                (Some(db), Budget::Cents { .. }) => db,
                (Some(_), _) => f64::INFINITY,
            };
            error.waveform_db <= budget.contact_error_db_max()
                && error_excess.max(spectral_excess) <= DISPLAYED_ERROR_SHARE
        })
    }

    /// The same as [`Self::is_as_exact`], but by audible errors if both are known.
    fn sounds_as_exact(&self, other: &Self, budget: &Budget) -> bool {
        let audible = |solved: &Self| solved.chosen_island.measured_error.and_then(|error| error.audible);
        match (audible(self), audible(other)) {
            (Some(solved_error), Some(other)) => {
                budget.excess_ratio(&solved_error) <= budget.excess_ratio(&other).max(1.0)
            }
            _ => self.is_as_exact(other, budget),
        }
    }

    /// Whether the error is within the budget, or not larger than that of `other`.
    fn is_as_exact(&self, other: &Self, budget: &Budget) -> bool {
        let error_db = |solved: &Self| solved.chosen_island.measured_error.map(|error| error.waveform_db);
        match (error_db(self), error_db(other)) {
            (Some(error_db), Some(other)) => error_db <= other.max(budget.waveform_error_db()),
            (ours, other) => ours.is_none() == other.is_none(),
        }
    }
}
