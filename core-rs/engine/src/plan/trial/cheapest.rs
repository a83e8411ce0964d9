//! The cheapest way within a budget: when the search has found one that is, all others are tried in the order of what
//! they cost, each held against the most exact run that is known.
//!
//! The search goes from cheap to dear by what half a step changes, and believes of that the worst. So it often ends where
//! less would do, and a method that it did not come to may be cheaper.

use crate::integrate::MeshMethod;
use crate::maths::{decibels, log10};
use crate::network::Error;
use crate::plan::passes::assemble::{Assembled, Shape};
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::trial::allowance::{TrialError, unless_spent};
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_run::{is_worth, play};
use crate::plan::trial::search::{Candidate, Search, TIMES_MAX};
use crate::plan::trial::waveform_error::{DOUBLING, ORDERS, difference};

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
const SHARPER: usize = 3;
/// Contacts are computed so many times as finely to see what error they have, and by their lowest order it is so much more
/// than what that changes [dB].
const FINER_CONTACTS: usize = 4;
const MORE_THAN_CHANGE: f64 = 2.5;

/// An error that is made of several.
pub(in crate::plan) fn sum(errors: impl IntoIterator<Item = f64>) -> f64 {
    20.0 * log10(errors.into_iter().map(decibels).sum::<f64>().max(1e-15))
}

/// What is left of a budget beside an error; nothing where that is above it.
pub(in crate::plan) fn left_of(budget: f64, error: f64) -> f64 {
    20.0 * log10((decibels(budget) - decibels(error)).max(1e-15))
}

/// A way of a kind that was not exact enough: nothing is expected of the same a little more often.
struct Refused {
    shape: Shape,
    oversampling: u32,
    /// Its error at least [dB].
    error: f64,
}

impl<F: Fn((u32, MethodChoice<'_>)) -> Result<Assembled, Error>> Search<'_, F> {
    /// The cheapest of all ways to compute the island that keep the budget, where `found` keeps it at a cost of so many
    /// nanoseconds a frame, with an error that has that of contacts in it; `None` where there is none cheaper.
    pub(in crate::plan) fn cheapest(
        &self,
        (found, cost): (&Candidate, f64),
        of_contacts: Option<f64>,
    ) -> Result<Option<Candidate>, Error> {
        let mut of_contacts = of_contacts.unwrap_or(f64::NEG_INFINITY);
        let mut are_measured = of_contacts == f64::NEG_INFINITY;
        let margin = if horizon::may_grow(&found.island.island_plan) {
            MARGIN_OF_KEYS
        } else {
            MARGIN
        };
        let aim = self.budget.asked() - margin;
        let mut refused: Vec<Refused> = Vec::new();
        let (mut best, mut sharper) = (found.clone(), SHARPER);
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
            let run = play(plan, substeps, self.n_frames, self.allowance);
            let Some(run) = unless_spent(run)? else {
                return Ok(None);
            };
            if run.is_lost {
                continue;
            }
            loop {
                let truth = best.finest();
                let apart = difference(&run.sound, truth.0, self.spans);
                let most = sum([apart, truth.1, of_contacts]);
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
                if sum([apart, truth.1]) <= aim && !are_measured {
                    let Some(measured) = unless_spent(self.of_contacts(found))? else {
                        return Ok(None);
                    };
                    (of_contacts, are_measured) = (of_contacts.min(measured), true);
                    continue;
                }
                let least = left_of(apart, truth.1);
                if least > aim || sharper == 0 {
                    refused.push(Refused {
                        shape,
                        oversampling,
                        error: least,
                    });
                    break;
                }
                // The truth is not known well enough.
                sharper -= 1;
                let Some(better) = unless_spent(self.better(&best))? else {
                    return Ok(None);
                };
                match better {
                    Some(better) => best = better,
                    None => sharper = 0,
                }
            }
        }
        Ok(None)
    }

    /// The error that contacts and laws have by how finely they are computed [dB].
    fn of_contacts(&self, found: &Candidate) -> Result<f64, TrialError> {
        let substeps = FINER_CONTACTS * found.contact_substeps;
        let plan = &found.island.island_plan;
        let finer = play(plan, substeps, self.n_frames, self.allowance)?;
        Ok(difference(&found.run.sound, &finer.sound, self.spans) + MORE_THAN_CHANGE)
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
