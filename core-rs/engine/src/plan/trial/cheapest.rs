//! The cheapest way within a budget: when the search has found one that is, all others are tried in the order of what
//! they cost, each held against the most exact run that is known.
//!
//! The search goes from cheap to dear by what half a step changes, and believes of that the worst. So it often ends where
//! less would do, and a method that it did not come to may be cheaper.

use std::rc::Rc;

use crate::integrate::MeshMethod;
use crate::network::Error;
use crate::plan::budget::Budget;
use crate::plan::passes::assemble::{Assembled, Shape};
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::trial::allowance::{TrialError, unless_spent};
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_run::{PilotRun, is_worth};
use crate::plan::trial::search::{Candidate, Search, TIMES_MAX};
use crate::plan::trial::waveform_error::{DOUBLING, Held, ORDERS, difference, left_of, sum};

/// All of an island by one method.
const WAYS: [(MeshMethod, u32); 5] = [
    (MeshMethod::Ca2p, 1),
    (MeshMethod::Ca2p, 2),
    (MeshMethod::Ca2p, 4),
    (MeshMethod::Bm4, 1),
    (MeshMethod::Bm4, 2),
];
/// One that costs nearly as much is not worth a trial.
const WORTH: f64 = 0.9;
/// Of the work that is left all this may take so much.
pub(in crate::plan) const SHARE: f64 = 0.25;
/// Errors above this tell nothing of how fast they fall [dB].
const ROUGH: f64 = -25.0;
/// Two runs are compared over the pilot; of the same budget so much is left for what comes after [dB].
const MARGIN: f64 = 0.1;
/// Where errors may grow after the pilot, so much.
const MARGIN_OF_KEYS: f64 = 3.0;
/// A more exact run is looked for so often.
const SHARPER: usize = 6;
/// Contacts are computed so many times as finely to see what error they have, and by their lowest order it is so much more
/// than what that changes [dB].
const FINER_CONTACTS: usize = 4;
const MORE_THAN_CHANGE: f64 = 2.5;

/// A way of a kind that was not exact enough: nothing is expected of the same a little more often.
struct Refused {
    shape: Shape,
    oversampling: u32,
    /// Its error at least [dB].
    error: f64,
}

/// What ways are held against: the most exact run that is known.
struct Truth {
    run: Rc<PilotRun>,
    /// Its error [dB].
    error: f64,
    /// By what it was found.
    best: Candidate,
    /// The error that contacts and laws have by how finely the search computed them [dB].
    contacts: f64,
    /// That was measured, not only stated.
    are_measured: bool,
    /// In it they were computed so many times as finely.
    times: usize,
    /// A more exact one is looked for so often.
    left: usize,
}

impl<F: Fn((u32, MethodChoice<'_>)) -> Result<Assembled, Error>> Search<'_, F> {
    /// The cheapest of all ways to compute the island that keep the budget, where `found` keeps it at a cost of so many
    /// nanoseconds a frame, with an error that has that of contacts in it; `None` where there is none cheaper.
    pub(in crate::plan) fn cheapest(
        &self,
        (found, cost): (&Candidate, f64),
        of_contacts: Option<f64>,
    ) -> Result<Option<Candidate>, Error> {
        let way = self.cheaper((found, cost), of_contacts);
        Ok(unless_spent(way)?.flatten())
    }

    fn cheaper(
        &self,
        (found, cost): (&Candidate, f64),
        of_contacts: Option<f64>,
    ) -> Result<Option<Candidate>, TrialError> {
        let margin = if horizon::may_grow(&found.island.island_plan) {
            MARGIN_OF_KEYS
        } else {
            MARGIN
        };
        let aim = self.budget.asked() - margin;
        let mut refused: Vec<Refused> = Vec::new();
        let mut truth = Truth::of(found, of_contacts);
        for way in self.ways(WORTH * cost) {
            let plan = &way.island_plan;
            let (shape, oversampling) = (way.shape, plan.oversampling);
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
            let mut held = Held::against(&truth.run.sound, self.spans);
            let run = self
                .runs
                .play_while((plan, substeps), self.allowance, |frames, sound| {
                    let apart = held.look(frames, sound);
                    apart.is_none_or(|apart| left_of(apart, truth.error) <= aim)
                })?;
            let Some(run) = run else {
                let error = left_of(held.least, truth.error);
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
                let apart = difference(&run.sound, &truth.run.sound, self.spans);
                let most = sum([apart, truth.error]);
                if most <= aim {
                    return Ok(Some(Candidate {
                        error: most,
                        contact_substeps: substeps,
                        oversampling,
                        island: way,
                        run,
                        ..found.clone()
                    }));
                }
                let error = left_of(apart, truth.error);
                // The truth may not be known well enough.
                if error > aim || !self.sharpen(&mut truth, found)? {
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

    /// Find a more exact run, by what costs least; whether there is one.
    fn sharpen(&self, truth: &mut Truth, found: &Candidate) -> Result<bool, TrialError> {
        if truth.contacts > f64::NEG_INFINITY && !truth.are_measured {
            let finer = FINER_CONTACTS * found.contact_substeps;
            let finer = (&found.island.island_plan, finer);
            let finer = self.runs.play(finer, self.allowance)?;
            let change = difference(&found.run.sound, &finer.sound, self.spans);
            truth.contacts = truth.contacts.min(change + MORE_THAN_CHANGE);
            truth.are_measured = true;
            let (run, error) = truth.best.finest();
            truth.take(run.clone(), sum([error, truth.contacts]));
            self.sharpen_contacts(truth)?;
            return Ok(true);
        }
        // Where laws have kinks even what half the step changes is an error of theirs.
        if found.island.may_collocate && self.sharpen_contacts(truth)? {
            return Ok(true);
        }
        if truth.left == 0 {
            return Ok(false);
        }
        truth.left -= 1;
        let Some(better) = self.better(&truth.best)? else {
            truth.left = 0;
            return Ok(false);
        };
        truth.best = better;
        let (run, error) = truth.best.finest();
        truth.take(run.clone(), sum([error, truth.contacts]));
        Ok(true)
    }

    /// The same with contacts that are computed more finely, where that may be; whether it is more exact.
    fn sharpen_contacts(&self, truth: &mut Truth) -> Result<bool, TrialError> {
        let times = FINER_CONTACTS * truth.times;
        let finely = Search {
            once: times * self.once,
            ..*self
        };
        let island = &truth.best.island;
        let substeps = finely.contact_substeps(island);
        let is_finer = substeps > truth.best.contact_substeps && substeps <= Budget::STEPS_MAX;
        let Some(finer) = self.finer(island).filter(|_| is_finer) else {
            return Ok(false);
        };
        let run = self
            .runs
            .play((&island.island_plan, substeps), self.allowance)?;
        let any = (truth.best.rung, None, f64::INFINITY);
        let own = finely.compare_with_finer(island.clone(), run, &finer, any)?;
        truth.times = times;
        let falls = ORDERS.0 * DOUBLING * f64::from(times.ilog2());
        let Some(own) = own else {
            return Ok(false);
        };
        let (run, error) = own.finest();
        Ok(truth.take(run.clone(), sum([error, truth.contacts - falls])))
    }

    /// All ways to compute an island for less than that, by what they cost.
    fn ways(&self, most: f64) -> Vec<Assembled> {
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
        let ways = WAYS.map(|way| [(1, MethodChoice::Meshes(way)), (1, MethodChoice::All(way))]);
        let all = times.flat_map(at).chain(ways.into_iter().flatten());
        let mut found: Vec<(f64, Assembled)> = Vec::new();
        for how in all {
            let Ok(mut way) = (self.assemble)(how) else {
                continue;
            };
            way.island_plan.contact_substeps = self.contact_substeps(&way);
            let plan = &way.island_plan;
            let cost = plan.cost();
            // One that costs the same to the last bit is the same by another name.
            let is_same =
                |known: &Assembled| known.island_plan.contact_substeps == plan.contact_substeps;
            let is_known = (found.iter()).any(|(known, way)| *known == cost && is_same(way));
            if !is_known && cost <= most && is_worth(plan, self.n_frames) {
                found.push((cost, way));
            }
        }
        found.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        found.into_iter().map(|(_, way)| way).collect()
    }
}

impl Truth {
    /// The most exact run of a search, whose contacts have such an error.
    fn of(found: &Candidate, contacts: Option<f64>) -> Self {
        let (run, error) = found.finest();
        let contacts = contacts.unwrap_or(f64::NEG_INFINITY);
        Self {
            run: run.clone(),
            error: sum([error, contacts]),
            best: found.clone(),
            contacts,
            are_measured: false,
            times: 1,
            left: SHARPER,
        }
    }

    /// A run with such an error [dB], where that is less; whether it is.
    fn take(&mut self, run: Rc<PilotRun>, error: f64) -> bool {
        let is_better = error < self.error;
        if is_better {
            (self.run, self.error) = (run, error);
        }
        is_better
    }
}
