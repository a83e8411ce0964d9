//! The cheapest way within a budget: once the search has found an island within it, all cheaper ways are tried in order
//! of their cost, each compared with the most exact known run; once it has ended above the budget, all ways.
//!
//! The search goes from cheap to dear and estimates errors pessimistically from the change at half a step. So it often
//! ends at an island dearer than necessary, and a method that it has not reached may be cheaper.

use std::rc::Rc;

use crate::integrate::MeshMethod;
use crate::network::Error;
use crate::plan::budget::Budget;
use crate::plan::passes::assemble::{Assembled, How};
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::trial::allowance::{TrialError, unless_spent};
use crate::plan::trial::audible::Audible;
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_run::{CountedCost, PilotRun, is_affordable};
use crate::plan::trial::search::{Candidate, Search, TIMES_MAX};
use crate::plan::trial::waveform_error::{
    EarlyComparison, amplitude_difference, amplitude_sum, difference,
};

/// Steps a frame of the island, and the methods that are then tried for its meshes. At more than one step a frame single
/// laws beside a mesh gain too.
const MESH_METHODS: [(u32, (MeshMethod, u32)); 8] = [
    (1, (MeshMethod::Ca2p, 1)),
    (1, (MeshMethod::Ca2p, 2)),
    (1, (MeshMethod::Ca2p, 4)),
    (1, (MeshMethod::Bm4, 1)),
    (1, (MeshMethod::Bm4, 2)),
    (2, (MeshMethod::Ca2p, 1)),
    (4, (MeshMethod::Ca2p, 1)),
    (2, (MeshMethod::Bm4, 1)),
];
/// A way is tried only if it costs at most this part of the cost of the island found.
const WORTH: f64 = 0.9;
/// The part of the remaining allowance that these trials may take.
const SHARE: f64 = 0.5;
/// Margin below the budget for what comes after the pilot, over which the runs are compared [dB].
const MARGIN: f64 = 0.1;
/// The same if errors may grow after the pilot.
const MARGIN_OF_KEYS: f64 = 1.0;
/// Most attempts to find a more exact reference.
const REFINEMENTS_MAX: usize = 6;
/// Contacts are refined by this factor to measure their error. By their lowest order the error is above the measured
/// change by `MORE_THAN_CHANGE`, and that of the finer ones below it by `LESS_THAN_CHANGE` [dB].
const FINER_CONTACTS: usize = 4;
const MORE_THAN_CHANGE: f64 = 2.5;
const LESS_THAN_CHANGE: f64 = 9.5;

/// The reference that ways are compared with: the most exact known run.
struct Reference {
    run: Rc<PilotRun>,
    /// Its error [dB].
    error: f64,
    /// The candidate that gave the reference run.
    best: Candidate,
    /// The error of contacts and laws in its runs [dB].
    contacts: f64,
    /// Contact substeps a frame, once contacts have been refined.
    fine: Option<usize>,
    /// Attempts left to find a more exact reference.
    attempts_left: usize,
}

impl<F: Fn(How<'_>) -> Result<Assembled, Error>> Search<'_, F> {
    /// Makes trials with a part of the remaining allowance. If the part runs out, no other trial ends.
    pub(in crate::plan) fn with_share<T>(
        &self,
        trials: impl FnOnce(&Search<'_, F>) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let part = self.allowance.fraction(SHARE);
        let found = trials(&Search {
            allowance: &part,
            ..*self
        })?;
        self.allowance.spend_fraction(&part, SHARE);
        Ok(found)
    }

    /// Returns the cheapest way to compute the island that keeps the budget; `None` if none does that is cheaper than
    /// `cost` [ns a frame]. Ways are compared with the runs of `found`; `of_contacts` is the error of its contacts [dB],
    /// which the result's error includes.
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
        let mut reference = Reference::of(found, of_contacts);
        // Nothing is known to be more exact than the reference.
        if reference.error > aim {
            self.refine_reference(&mut reference, found)?;
        }
        let (mut within, mut open) = (None, Vec::new());
        let mut most_cost = WORTH * cost;
        for variant in self.variants(found, most_cost) {
            // What is known so far may have cost more than it was thought to.
            if variant.island_plan.cost() > most_cost {
                break;
            }
            let candidate = match self.try_variant(variant, found, (&reference, aim)) {
                Ok(candidate) => candidate,
                Err(TrialError::AllowanceSpent) if within.is_some() => return Ok(within),
                Err(error) => return Err(error),
            };
            let is_cheaper = |candidate: &Candidate| candidate.cost() <= most_cost;
            let Some(candidate) = candidate.filter(is_cheaper) else {
                continue;
            };
            let [least, most] = self.bounds(&candidate, &reference);
            if most <= aim {
                most_cost = WORTH * candidate.cost();
                within = Some(Candidate {
                    error: most,
                    ..candidate
                });
            } else if least <= aim {
                open.push(candidate);
            }
        }
        open.retain(|candidate| candidate.cost() <= most_cost);
        open.sort_by(|one, other| one.cost().total_cmp(&other.cost()));
        match self.decide(open, &mut within, (&mut reference, found, aim)) {
            Ok(()) | Err(TrialError::AllowanceSpent) => Ok(within),
            Err(error) => Err(error),
        }
    }

    /// Plays a variant as long as its error may be below `aim` [dB]; `None` if it is not, if the run is lost, or if its
    /// audible error is too large.
    fn try_variant(
        &self,
        mut variant: Assembled,
        found: &Candidate,
        (reference, aim): (&Reference, f64),
    ) -> Result<Option<Candidate>, TrialError> {
        let mut comparison = EarlyComparison::against(&reference.run.sound, self.spans);
        let goes_on = |frames: usize, sound: &[f64]| {
            let apart = comparison.update(frames, sound);
            apart.is_none_or(|apart| amplitude_difference(apart, reference.error) <= aim)
        };
        let plan = &mut variant.island_plan;
        let (contact_substeps, oversampling) = (plan.contact_substeps, plan.oversampling);
        let played = (&*plan, contact_substeps);
        let run = self.runs.play_while(played, self.allowance, goes_on)?;
        let Some(run) = run.filter(|run| !run.is_lost) else {
            return Ok(None);
        };
        plan.counted_cost = Some(run.counted_cost.all());
        let audible = Audible::of_budget(self.budget, (&run, &reference.run.sound), self.spans);
        if audible.is_some_and(|audible| audible.excess(self.budget) > 1.0) {
            return Ok(None);
        }
        Ok(Some(Candidate {
            contact_substeps,
            oversampling,
            island: variant,
            run,
            audible: audible.map(|own| own.with(found.audible.unwrap_or_default())),
            ..found.clone()
        }))
    }

    /// Decides with a more exact reference which of the cheaper candidates are within the budget too: the cheapest of
    /// these replaces `within`.
    fn decide(
        &self,
        mut open: Vec<Candidate>,
        within: &mut Option<Candidate>,
        (reference, found, aim): (&mut Reference, &Candidate, f64),
    ) -> Result<(), TrialError> {
        while !open.is_empty() && self.refine_reference(reference, found)? {
            for mut candidate in std::mem::take(&mut open) {
                let [least, most] = self.bounds(&candidate, reference);
                if most <= aim {
                    candidate.error = most;
                    *within = Some(candidate);
                    break;
                }
                if least <= aim {
                    open.push(candidate);
                }
            }
        }
        Ok(())
    }

    /// The least and the largest error that a candidate may have [dB].
    fn bounds(&self, candidate: &Candidate, reference: &Reference) -> [f64; 2] {
        let apart = difference(&candidate.run.sound, &reference.run.sound, self.spans);
        let least = amplitude_difference(apart, reference.error);
        [least, amplitude_sum([apart, reference.error])]
    }

    /// Tries to make the reference more exact, the cheapest means first. Returns whether there was anything left to
    /// try.
    fn refine_reference(
        &self,
        reference: &mut Reference,
        found: &Candidate,
    ) -> Result<bool, TrialError> {
        if reference.contacts > f64::NEG_INFINITY && reference.fine.is_none() {
            self.refine_contacts(reference, found)?;
            return Ok(true);
        }
        if reference.attempts_left == 0 {
            return Ok(false);
        }
        reference.attempts_left -= 1;
        let search = Search {
            substeps_per_frame: reference.fine.unwrap_or(self.substeps_per_frame),
            ..*self
        };
        let Some(better) = search.better(&reference.best)? else {
            reference.attempts_left = 0;
            return Ok(false);
        };
        reference.replace(better);
        Ok(true)
    }

    /// Measures the error of contacts by computing them finer, and takes those as the reference if they are more exact.
    fn refine_contacts(
        &self,
        reference: &mut Reference,
        found: &Candidate,
    ) -> Result<(), TrialError> {
        let island = &found.island;
        let play = |substeps| {
            self.runs
                .play((&island.island_plan, substeps), self.allowance)
        };
        let apart =
            |one: &PilotRun, other: &PilotRun| difference(&one.sound, &other.sound, self.spans);
        // With kinks two runs may agree by chance, so a third one is played. How finely laws divide a frame depends on
        // the frame unless there are more substeps than plans use.
        let has_kinks = island.may_collocate;
        let substeps = match has_kinks {
            true => Budget::STEPS_MAX.max(found.contact_substeps),
            false => found.contact_substeps,
        };
        let substeps = FINER_CONTACTS * substeps;
        let run = play(substeps)?;
        let change = apart(&found.run, &run);
        let (of_found, of_finer) = if has_kinks {
            let of_finer = apart(&*play(substeps / 2)?, &run);
            (amplitude_sum([change, of_finer]), of_finer)
        } else {
            (change + MORE_THAN_CHANGE, change - LESS_THAN_CHANGE)
        };
        let (run_of_found, error) = found.finest();
        reference.run = run_of_found.clone();
        reference.error = amplitude_sum([error, of_found]);
        reference.contacts = of_finer;
        let fine = substeps * island.island_plan.oversampling as usize;
        reference.fine = Some(fine);
        let Some(finer) = self.finer(island) else {
            return Ok(());
        };
        let search = Search {
            substeps_per_frame: fine,
            ..*self
        };
        let any = (found.method_index, None, f64::INFINITY);
        if let Ok(own) = search.compare_with_finer(island.clone(), run, &finer, any)? {
            reference.replace(own);
        }
        Ok(())
    }

    /// All ways to compute an island that cost at most `most` [ns a frame], in order of their cost. What is computed
    /// between frames is assumed to cost as much as in the run of `found`.
    fn variants(&self, found: &Candidate, most: f64) -> Vec<Assembled> {
        let times = (0..=TIMES_MAX.ilog2()).map(|doublings| 1 << doublings);
        let at = |times: u32| {
            let bodies = [MethodChoice::ByBudget, MethodChoice::Stepped];
            bodies.map(|bodies| (times, bodies))
        };
        let methods = MESH_METHODS.into_iter().flat_map(|(times, method)| {
            let bodies = [MethodChoice::Meshes(method), MethodChoice::All(method)];
            bodies.map(|bodies| (times, bodies))
        });
        let all = times
            .flat_map(at)
            .chain(methods)
            .flat_map(|(times, bodies)| [How::fine(times, bodies), How::plain(times, bodies)]);
        let mut variants: Vec<(f64, Assembled)> = Vec::new();
        for how in all {
            let Ok(mut variant) = (self.assemble)(how) else {
                continue;
            };
            variant.island_plan.counted_cost = found.counted_cost_of(&variant);
            variant.island_plan.contact_substeps = self.contact_substeps(&variant);
            let plan = &variant.island_plan;
            let cost = plan.cost();
            // A way with bit for bit the same cost is the same way under another name.
            let is_same =
                |known: &Assembled| known.island_plan.contact_substeps == plan.contact_substeps;
            let is_known =
                (variants.iter()).any(|(known, variant)| *known == cost && is_same(variant));
            if !is_known && cost <= most && is_affordable(plan, self.n_frames) {
                variants.push((cost, variant));
            }
        }
        variants.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        variants.into_iter().map(|(_, variant)| variant).collect()
    }
}

impl Candidate {
    /// Nanoseconds a frame.
    fn cost(&self) -> f64 {
        self.island.island_plan.cost()
    }

    /// What contacts and laws of another way cost between frames, by this run; `None` if one of both has none.
    fn counted_cost_of(&self, variant: &Assembled) -> Option<u32> {
        let has_fine = variant.may_collocate || variant.island_plan.contact_substeps > 1;
        if self.contact_substeps == 1 || !has_fine {
            return None;
        }
        let CountedCost { own, bodies } = self.run.counted_cost;
        Some(if variant.has_modes() {
            own.saturating_add(bodies)
        } else {
            own
        })
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
            fine: None,
            attempts_left: REFINEMENTS_MAX,
        }
    }

    /// Goes on from a candidate, and takes its most exact run if that has a smaller error than the present one.
    fn replace(&mut self, best: Candidate) {
        let (run, own) = best.finest();
        let error = amplitude_sum([own, self.contacts]);
        if error < self.error {
            (self.run, self.error) = (run.clone(), error);
        }
        self.best = best;
    }
}
