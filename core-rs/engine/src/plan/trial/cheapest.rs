//! The cheapest way within a budget: once the search has found an island within it, all cheaper ways are tried in order
//! of their cost, each compared with the most exact known run.
//!
//! The search goes from cheap to dear and estimates errors pessimistically from the change at half a step. So it often
//! ends at an island dearer than necessary, and a method that it has not reached may be cheaper.

use std::rc::Rc;

use crate::integrate::MeshMethod;
use crate::network::Error;
use crate::plan::budget::Budget;
use crate::plan::passes::assemble::{Assembled, Shape};
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::trial::allowance::{TrialError, unless_spent};
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_run::{PilotRun, is_affordable};
use crate::plan::trial::search::{Candidate, Search, TIMES_MAX};
use crate::plan::trial::waveform_error::{
    DOUBLING, EarlyComparison, ORDERS, amplitude_difference, amplitude_sum, difference,
};

/// Methods that are tried for meshes.
const MESH_METHODS: [(MeshMethod, u32); 5] = [
    (MeshMethod::Ca2p, 1),
    (MeshMethod::Ca2p, 2),
    (MeshMethod::Ca2p, 4),
    (MeshMethod::Bm4, 1),
    (MeshMethod::Bm4, 2),
];
/// A way is tried only if it costs at most this part of the cost of the island found.
const WORTH: f64 = 0.9;
/// The part of the remaining allowance that these trials may take.
pub(in crate::plan) const SHARE: f64 = 0.25;
/// Errors above this say nothing about the order of convergence [dB].
const ROUGH: f64 = -25.0;
/// Margin below the budget for what comes after the pilot, over which the runs are compared [dB].
const MARGIN: f64 = 0.1;
/// The same if errors may grow after the pilot.
const MARGIN_OF_KEYS: f64 = 3.0;
/// Most attempts to find a more exact reference.
const REFINEMENTS_MAX: usize = 6;
/// Contacts are refined by this factor to measure their error. By their lowest order the error is above the measured
/// change by `MORE_THAN_CHANGE` [dB].
const FINER_CONTACTS: usize = 4;
const MORE_THAN_CHANGE: f64 = 2.5;

/// A way that was not exact enough. Ways of the same shape at a little higher rate are then skipped.
struct Refused {
    shape: Shape,
    oversampling: u32,
    /// Lower bound of its error [dB].
    error: f64,
}

/// The reference that ways are compared with: the most exact known run.
struct Reference {
    run: Rc<PilotRun>,
    /// Its error [dB].
    error: f64,
    /// The candidate that gave the reference run.
    best: Candidate,
    /// The error of contacts and laws at the substeps of the search [dB].
    contacts: f64,
    /// Whether `contacts` was measured rather than taken from the search.
    are_measured: bool,
    /// Factor by which contacts have been refined so far.
    contact_refinement: usize,
    /// Attempts left to find a more exact reference.
    attempts_left: usize,
}

impl<F: Fn((u32, MethodChoice<'_>)) -> Result<Assembled, Error>> Search<'_, F> {
    /// Returns the cheapest way to compute the island that keeps the budget; `None` if no way is cheaper. `found` keeps
    /// the budget at `cost` [ns a frame]; `of_contacts` is the error of its contacts [dB], which the result's error
    /// includes.
    pub(in crate::plan) fn cheapest(
        &self,
        (found, cost): (&Candidate, f64),
        of_contacts: Option<f64>,
    ) -> Result<Option<Candidate>, Error> {
        let variant = self.cheaper((found, cost), of_contacts);
        Ok(unless_spent(variant)?.flatten())
    }

    fn cheaper(
        &self,
        (found, cost): (&Candidate, f64),
        of_contacts: Option<f64>,
    ) -> Result<Option<Candidate>, TrialError> {
        let margin = if horizon::error_may_grow(&found.island.island_plan) {
            MARGIN_OF_KEYS
        } else {
            MARGIN
        };
        let aim = self.budget.asked() - margin;
        let mut refused: Vec<Refused> = Vec::new();
        let mut reference = Reference::of(found, of_contacts);
        for variant in self.variants(WORTH * cost) {
            let plan = &variant.island_plan;
            let (shape, oversampling) = (variant.shape, plan.oversampling);
            let is_in_vain = |other: &Refused| {
                let doublings = (oversampling / other.oversampling).max(1).ilog2();
                let falls = ORDERS.1 * DOUBLING * f64::from(doublings);
                other.shape == shape
                    && shape != Shape::Meshes
                    && other.error < ROUGH
                    && other.error - falls > aim
            };
            if refused.iter().any(is_in_vain) {
                continue;
            }
            let substeps = plan.contact_substeps;
            let mut comparison = EarlyComparison::against(&reference.run.sound, self.spans);
            let run = self
                .runs
                .play_while((plan, substeps), self.allowance, |frames, sound| {
                    let apart = comparison.update(frames, sound);
                    apart.is_none_or(|apart| amplitude_difference(apart, reference.error) <= aim)
                })?;
            let Some(run) = run else {
                let error = amplitude_difference(comparison.lower_bound, reference.error);
                refused.push(Refused {
                    shape,
                    oversampling,
                    error,
                });
                continue;
            };
            if run.is_lost {
                continue;
            }
            loop {
                let apart = difference(&run.sound, &reference.run.sound, self.spans);
                let most = amplitude_sum([apart, reference.error]);
                if most <= aim {
                    return Ok(Some(Candidate {
                        error: most,
                        contact_substeps: substeps,
                        oversampling,
                        island: variant,
                        run,
                        ..found.clone()
                    }));
                }
                let error = amplitude_difference(apart, reference.error);
                // The reference may not be exact enough.
                if error > aim || !self.refine_reference(&mut reference, found)? {
                    refused.push(Refused {
                        shape,
                        oversampling,
                        error,
                    });
                    break;
                }
            }
        }
        Ok(None)
    }

    /// Tries to make the reference more exact, the cheapest means first. Returns whether there was anything left to
    /// try.
    fn refine_reference(
        &self,
        reference: &mut Reference,
        found: &Candidate,
    ) -> Result<bool, TrialError> {
        if reference.contacts > f64::NEG_INFINITY && !reference.are_measured {
            let finer = FINER_CONTACTS * found.contact_substeps;
            let finer = (&found.island.island_plan, finer);
            let finer = self.runs.play(finer, self.allowance)?;
            let change = difference(&found.run.sound, &finer.sound, self.spans);
            reference.contacts = reference.contacts.min(change + MORE_THAN_CHANGE);
            reference.are_measured = true;
            let (run, error) = reference.best.finest();
            reference.replace_if_better(run.clone(), amplitude_sum([error, reference.contacts]));
            self.refine_reference_contacts(reference)?;
            return Ok(true);
        }
        // If laws have kinks, the change at half the step is partly an error of the laws.
        if found.island.may_collocate && self.refine_reference_contacts(reference)? {
            return Ok(true);
        }
        if reference.attempts_left == 0 {
            return Ok(false);
        }
        reference.attempts_left -= 1;
        let Some(better) = self.better(&reference.best)? else {
            reference.attempts_left = 0;
            return Ok(false);
        };
        reference.best = better;
        let (run, error) = reference.best.finest();
        reference.replace_if_better(run.clone(), amplitude_sum([error, reference.contacts]));
        Ok(true)
    }

    /// Tries the reference island with more contact substeps, if that is possible. Returns whether that is more exact.
    fn refine_reference_contacts(&self, reference: &mut Reference) -> Result<bool, TrialError> {
        let times = FINER_CONTACTS * reference.contact_refinement;
        let finer_search = Search {
            substeps_per_frame: times * self.substeps_per_frame,
            ..*self
        };
        let island = &reference.best.island;
        let substeps = finer_search.contact_substeps(island);
        let is_finer = substeps > reference.best.contact_substeps && substeps <= Budget::STEPS_MAX;
        let Some(finer) = self.finer(island).filter(|_| is_finer) else {
            return Ok(false);
        };
        let run = self
            .runs
            .play((&island.island_plan, substeps), self.allowance)?;
        let any = (reference.best.method_index, None, f64::INFINITY);
        let own = finer_search.compare_with_finer(island.clone(), run, &finer, any)?;
        reference.contact_refinement = times;
        let falls = ORDERS.0 * DOUBLING * f64::from(times.ilog2());
        let Some(own) = own else {
            return Ok(false);
        };
        let (run, error) = own.finest();
        Ok(reference.replace_if_better(
            run.clone(),
            amplitude_sum([error, reference.contacts - falls]),
        ))
    }

    /// All ways to compute an island that cost at most `most` [ns a frame], in order of their cost.
    fn variants(&self, most: f64) -> Vec<Assembled> {
        let times = (0..=TIMES_MAX.ilog2()).map(|doublings| 1 << doublings);
        let at = |times: u32| {
            [
                MethodChoice::ByBudget,
                MethodChoice::Stepped,
                MethodChoice::Plain { has_bodies: true },
                MethodChoice::Plain { has_bodies: false },
            ]
            .map(|choice| (times, choice))
        };
        let fixed = MESH_METHODS.map(|method| {
            [
                (1, MethodChoice::Meshes(method)),
                (1, MethodChoice::All(method)),
            ]
        });
        let all = times.flat_map(at).chain(fixed.into_iter().flatten());
        let mut found: Vec<(f64, Assembled)> = Vec::new();
        for how in all {
            let Ok(mut variant) = (self.assemble)(how) else {
                continue;
            };
            variant.island_plan.contact_substeps = self.contact_substeps(&variant);
            let plan = &variant.island_plan;
            let cost = plan.cost();
            // A way with bit for bit the same cost is the same way under another name.
            let is_same =
                |known: &Assembled| known.island_plan.contact_substeps == plan.contact_substeps;
            let is_known =
                (found.iter()).any(|(known, variant)| *known == cost && is_same(variant));
            if !is_known && cost <= most && is_affordable(plan, self.n_frames) {
                found.push((cost, variant));
            }
        }
        found.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        found.into_iter().map(|(_, variant)| variant).collect()
    }
}

impl Reference {
    /// Starts with the most exact run of a search; `contacts` is the error of its contacts [dB].
    fn of(found: &Candidate, contacts: Option<f64>) -> Self {
        let (run, error) = found.finest();
        let contacts = contacts.unwrap_or(f64::NEG_INFINITY);
        Self {
            run: run.clone(),
            error: amplitude_sum([error, contacts]),
            best: found.clone(),
            contacts,
            are_measured: false,
            contact_refinement: 1,
            attempts_left: REFINEMENTS_MAX,
        }
    }

    /// Takes a run as the reference if its error [dB] is smaller than the present one. Returns whether it is.
    fn replace_if_better(&mut self, run: Rc<PilotRun>, error: f64) -> bool {
        let is_better = error < self.error;
        if is_better {
            (self.run, self.error) = (run, error);
        }
        is_better
    }
}
