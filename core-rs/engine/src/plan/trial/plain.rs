//! Plain ways, with contacts and laws once a step, are tried first where computing those between frames costs more than
//! all of the island at the highest rate. Steep friction that is located between frames may cost so much that no trial
//! ends.

use crate::network::Error;
use crate::plan::budget::Budget;
use crate::plan::passes::assemble::{Assembled, How};
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::trial::allowance::{TrialError, unless_spent};
use crate::plan::trial::pilot_run::is_affordable;
use crate::plan::trial::search::{Candidate, Search, TIMES_MAX};
use crate::plan::trial::waveform_error::{DOUBLING, difference};

impl<F: Fn(How<'_>) -> Result<Assembled, Error>> Search<'_, F> {
    /// Returns the cheapest plain way within the budget. `None` if each costs more than the `island`, if none keeps the
    /// budget, if the motion is chaotic, or if the budget is not one of the waveform.
    pub(in crate::plan) fn plain(&self, island: &Assembled) -> Result<Option<Candidate>, Error> {
        let by_waveform = matches!(self.budget, Budget::Error(_));
        let Some(cost) = self.dear_cost(island).filter(|_| by_waveform) else {
            return Ok(None);
        };
        self.with_share(|search| {
            let reference = unless_spent(search.reference())?.flatten();
            match reference.filter(|reference| reference.parting.is_none()) {
                Some(reference) => search.cheapest((&reference, cost), None),
                None => Ok(None),
            }
        })
    }

    /// The cost of the `island` with contacts and laws between frames, if plain ways cost less even at the highest rate.
    pub(in crate::plan) fn dear_cost(&self, island: &Assembled) -> Option<f64> {
        let mut fine = island.island_plan.clone();
        if fine.contact_substeps == 1 && !island.may_collocate {
            return None;
        }
        fine.contact_substeps = fine.contact_substeps.max(Budget::STEPS_MIN);
        let cost = fine.cost();
        let plain = self.plainly(1)?.island_plan.cost();
        (f64::from(TIMES_MAX) * plain < cost).then_some(cost)
    }

    /// The island by the plain way at some oversampling; `None` if it would take too long, or is not stable.
    fn plainly(&self, times: u32) -> Option<Assembled> {
        let island = (self.assemble)(How::plain(times, MethodChoice::ByBudget)).ok()?;
        is_affordable(&island.island_plan, self.n_frames).then_some(island)
    }

    /// A plain way that is more exact than all up to `TIMES_MAX` steps a frame; `None` if those are too rough.
    fn reference(&self) -> Result<Option<Candidate>, TrialError> {
        let ways = [1, 2, 4, 8].map(|times| self.plainly(times * TIMES_MAX));
        let [Some(most), Some(twice), Some(own), Some(finer)] = ways else {
            return Ok(None);
        };
        let play = |island: &Assembled| self.runs.play((&island.island_plan, 1), self.allowance);
        let (most, twice) = (play(&most)?, play(&twice)?);
        if difference(&most.sound, &twice.sound, self.spans) > self.budget.asked() + DOUBLING {
            return Ok(None);
        }
        let run = play(&own)?;
        let last = difference(&twice.sound, &run.sound, self.spans);
        let any = (None, Some(last), f64::INFINITY);
        Ok(self.compare_with_finer(own, run, &finer, any)?.ok())
    }
}
