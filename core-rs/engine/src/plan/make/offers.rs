//! Parts that a plan makes slow without being asked: keys, and what is only seen.
//!
//! Such an offer is taken only after a measurement, if the island then costs less and sounds the same.

use super::{Maker, SolvedIsland};
use crate::assembly::budget::Budget;
use crate::assembly::choice::{BodyChoice, SteppedChoice};
use crate::assembly::cost;
use crate::assembly::split::OwnTimeline;
use crate::island::inside::BodyPlan;
use crate::network::Subset;
use crate::plan::constants::{PRESERVED_LIMITS, SEEN_SHARE, SLOW_COST_RATIO_MAX};
use crate::plan::row::Measured;
use crate::plan::trial::multirate::{self, Offered};

/// Why a part that asks for a rate of its own does not get it, if its island is better without.
const NO_GAIN: &str = "at every frame its island keeps the budget, or keeps it at less cost";

impl Maker<'_> {
    /// The island without slow parts that asked for it, if it misses its budget with them, takes more steps a frame for
    /// it, or has one that is dearer than without a rate, and is within the budget without them, at less cost if both
    /// are.
    pub(super) fn without_rates(
        &self,
        subset: &Subset,
        island_timeline: &OwnTimeline,
        slow: SolvedIsland,
    ) -> SolvedIsland {
        let is_within = slow.is_within(self.budget);
        let island_plan = &slow.chosen.island.island_plan;
        let is_dearer = |body: &BodyPlan| matches!(body, BodyPlan::Slow(slow_body) if cost::is_dearer(slow_body));
        let is_doubtful = !is_within || island_plan.oversampling > 1 || island_plan.bodies.iter().any(is_dearer);
        if slow.growth.is_none() || island_timeline.timeline.is_open || !is_doubtful {
            return slow;
        }
        let refused_slow = multirate::refuse_all(subset, NO_GAIN);
        let plain_subset = multirate::without_slow(subset, &refused_slow);
        match self.solve(&plain_subset, island_timeline, None) {
            Ok(plain_solved)
                if plain_solved.is_within(self.budget) && !(is_within && slow.cost() <= plain_solved.cost()) =>
            {
                SolvedIsland {
                    refused_slow,
                    ..plain_solved
                }
            }
            _ => slow,
        }
    }

    /// The island with what is only seen slow, and with its keys slow, wherever that is cheaper and sounds the same.
    pub(super) fn offered(&self, subset: &Subset, island_timeline: &OwnTimeline, plain: SolvedIsland) -> SolvedIsland {
        let (seldom_subset, mut best_solved) = self.offer_only_seen(subset, island_timeline, plain);
        let subset = seldom_subset.as_ref().unwrap_or(subset);
        for &(macrostep, error_limit) in &PRESERVED_LIMITS {
            // Without allowance an offer cannot be measured.
            if self.allowance.n_refused() > 0 {
                break;
            }
            let error_max = error_limit.min(self.budget.contact());
            let slow_keys =
                multirate::with_offered_slow(subset, island_timeline, self.budget, Offered::Keys, macrostep);
            let is_better = |solved: &SolvedIsland, best_solved: &SolvedIsland| {
                solved.slow_error.is_some_and(|error| error.db <= error_max)
                    && solved.cost() < SLOW_COST_RATIO_MAX * best_solved.cost()
                    && solved.is_as_exact(best_solved, self.budget)
            };
            if let Some(slow_subset) = slow_keys
                && let Some(solved) = self.try_offer(&slow_subset, island_timeline, &best_solved, is_better)
            {
                best_solved = solved;
            }
        }
        best_solved
    }

    /// The island with what is only seen computed as seldom as `seen_every` says, or more often if that would be heard.
    fn offer_only_seen(
        &self,
        subset: &Subset,
        island_timeline: &OwnTimeline,
        plain: SolvedIsland,
    ) -> (Option<Subset>, SolvedIsland) {
        let mut seen_every = self.seen_every;
        while seen_every > 1 && self.allowance.n_refused() == 0 {
            let seldom_subset =
                multirate::with_offered_slow(subset, island_timeline, self.budget, Offered::OnlySeen, seen_every);
            let is_better = |solved: &SolvedIsland, plain: &SolvedIsland| {
                solved.is_unheard(self.budget)
                    && solved.cost() < plain.cost()
                    && solved.sounds_as_exact(plain, self.budget)
            };
            if let Some(seldom_subset) = seldom_subset
                && let Some(solved) = self.try_offer(&seldom_subset, island_timeline, &plain, is_better)
            {
                return (Some(seldom_subset), solved);
            }
            seen_every /= 2;
        }
        (None, plain)
    }

    /// Solves an island with offered slow parts, and returns it if it `is_better` compared with the island without
    /// them.
    fn try_offer(
        &self,
        slow_subset: &Subset,
        island_timeline: &OwnTimeline,
        plain: &SolvedIsland,
        is_better: impl Fn(&SolvedIsland, &SolvedIsland) -> bool,
    ) -> Option<SolvedIsland> {
        let solved = self.solve(slow_subset, island_timeline, None).ok()?;
        is_better(&solved, plain).then(|| SolvedIsland {
            is_offered: true,
            refused_slow: plain.refused_slow.clone(),
            ..solved
        })
    }

    /// The island as it was decided before, if that made parts slow that did not ask for it, or not those that did.
    pub(super) fn pinned_offer(
        &self,
        subset: &Subset,
        island_timeline: &OwnTimeline,
        pin: &SteppedChoice,
    ) -> Option<SolvedIsland> {
        let plain_subset = multirate::without_slow(subset, &multirate::refuse_all(subset, NO_GAIN));
        if subset.network.has_slow_parts()
            && let Ok(solved) = self.solve(&plain_subset, island_timeline, Some(pin))
        {
            return Some(solved);
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
        let interval_pair = tried_intervals.iter().flat_map(|seen_interval| {
            tried_intervals
                .iter()
                .map(move |key_interval| (*seen_interval, *key_interval))
        });
        let mut first_offer = interval_pair
            .filter(|&interval_pair| interval_pair != (1, 1))
            .filter_map(|(seen_interval, key_interval)| {
                let slow_subset = offer_slow(subset, Offered::OnlySeen, seen_interval)?;
                let slow_subset = offer_slow(&slow_subset, Offered::Keys, key_interval)?;
                self.solve(&slow_subset, island_timeline, Some(pin)).ok()
            });
        Some(SolvedIsland {
            is_offered: true,
            ..first_offer.next()?
        })
    }
}

impl SolvedIsland {
    fn cost(&self) -> f64 {
        self.chosen.island.island_plan.cost()
    }

    /// Whether its error, and the one that slow parts add, are known to be within the budget.
    fn is_within(&self, budget: &Budget) -> bool {
        let is_within = |error: Measured| match budget {
            Budget::Cents { .. } => error.excess(budget) <= 1.0,
            Budget::Error(_) | Budget::Method(_) => error.db <= budget.asked(),
        };
        let is_known = |error: Measured| error.spectral.is_none() && is_within(error);
        self.chosen.error.is_some_and(is_known) && self.slow_error.is_none_or(is_known)
    }

    /// Whether the error that slow parts add stays within their share of what is allowed.
    fn is_unheard(&self, budget: &Budget) -> bool {
        self.slow_error.is_some_and(|error| {
            let error_excess = error.excess(budget);
            // If the waveforms part later, third octaves have to agree: their difference limen is 1 dB.
            let spectral_excess = match (error.spectral, budget) {
                (None, _) => 0.0,
                (Some(db), Budget::Cents { .. }) => db,
                (Some(_), _) => f64::INFINITY,
            };
            error.db <= budget.contact() && error_excess.max(spectral_excess) <= SEEN_SHARE
        })
    }

    /// The same as [`Self::is_as_exact`], but by audible errors if both are known.
    fn sounds_as_exact(&self, other: &Self, budget: &Budget) -> bool {
        let audible = |solved: &Self| solved.chosen.error.and_then(|error| error.audible);
        match (audible(self), audible(other)) {
            (Some(ours), Some(other)) => budget.excess(&ours) <= budget.excess(&other).max(1.0),
            _ => self.is_as_exact(other, budget),
        }
    }

    /// Whether the error is within the budget, or not larger than that of `other`.
    fn is_as_exact(&self, other: &Self, budget: &Budget) -> bool {
        let error_db = |solved: &Self| solved.chosen.error.map(|error| error.db);
        match (error_db(self), error_db(other)) {
            (Some(ours), Some(other)) => ours <= other.max(budget.asked()),
            (ours, other) => ours.is_none() == other.is_none(),
        }
    }
}
