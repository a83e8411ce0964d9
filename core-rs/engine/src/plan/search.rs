//! The search for an island that is exact enough: its meshes by better methods, all of it more often.

use super::assemble::Assembled;
use super::budget::Budget;
use super::mesh::Ways;
use super::pilot::{ORDERS, Spans, TIMES_MAX, Take, difference, errors, is_worth, play};
use crate::integrate::Way;
use crate::network::Error;

/// Methods of meshes where the budget's first is not exact enough, each dearer than the one before.
const RUNGS: [(Way, u32); 5] = [
    (Way::Ca2p, 1),
    (Way::Ca2p, 2),
    (Way::Bm4, 1),
    (Way::Bm4, 2),
    (Way::Bm4, 4),
];
/// The way to an island that is exact enough: meshes by better methods, all of it more often.
pub(super) struct Search<'a, F> {
    pub(super) assemble: &'a F,
    pub(super) spans: Spans,
    /// How often a frame contacts are computed, whatever the rate.
    pub(super) once: usize,
    pub(super) n_frames: usize,
}

/// An island on that way.
pub(super) struct Standing {
    pub(super) island: Assembled,
    /// Which of `RUNGS` its meshes go by; `None`: as the budget said.
    pub(super) rung: Option<usize>,
    pub(super) times: u32,
    pub(super) steps: usize,
    pub(super) take: Take,
    /// Its error by what half the step changes [dB]; infinite where it is lost.
    pub(super) own: f64,
    /// What that change was.
    pub(super) change: f64,
}

/// A step on the way is worth it where it gains so much [dB]: by another method, and by a higher rate.
const GAINS: (f64, f64) = (6.0, 3.0);

impl<F: Fn((u32, Ways<'_>)) -> Result<Assembled, Error>> Search<'_, F> {
    /// An island put together with the error that it has; `None` where that would take long, or it is not stable.
    fn stand(
        &self,
        times: u32,
        ways: Ways<'_>,
        rung: Option<usize>,
        last: Option<f64>,
    ) -> Result<Option<Standing>, Error> {
        let Ok(island) = (self.assemble)((times, ways)) else {
            return Ok(None);
        };
        let Some(finer) = self.finer(&island) else {
            return Ok(None);
        };
        let take = play(&island.isle, self.steps(times), self.n_frames)?;
        self.hold(island, take, &finer, rung, last).map(Some)
    }

    /// Half the step by the same methods, else a finer plan could be the same one; `None` where it would take long to
    /// play, or is not stable.
    pub(super) fn finer(&self, island: &Assembled) -> Option<Assembled> {
        let finer = (self.assemble)((2 * island.isle.times, Ways::As(&island.ways()))).ok()?;
        is_worth(&finer.isle, self.n_frames + self.n_frames / 2).then_some(finer)
    }

    /// Hold an island that was played against half its step.
    pub(super) fn hold(
        &self,
        island: Assembled,
        take: Take,
        finer: &Assembled,
        rung: Option<usize>,
        last: Option<f64>,
    ) -> Result<Standing, Error> {
        let times = island.isle.times;
        let fine = play(&finer.isle, self.steps(2 * times), self.n_frames)?;
        let change = difference(&take.sound, &fine.sound, &self.spans);
        let (own, _) = errors(change, last, ORDERS.1);
        Ok(Standing {
            own: if take.is_lost { f64::INFINITY } else { own },
            island,
            rung,
            times,
            steps: self.steps(times),
            take,
            change,
        })
    }

    /// How often a step contacts are computed at `times` the rate.
    fn steps(&self, times: u32) -> usize {
        (self.once / times as usize).max(1)
    }

    /// As far as the budget asks, or as it helps.
    pub(super) fn climb(&self, mut best: Standing, budget: &Budget) -> Result<Standing, Error> {
        let is_short = |best: &Standing| match budget {
            // Contacts and modes have their share too.
            Budget::Error(_) => best.own > budget.contact(),
            Budget::Cents { .. } | Budget::Method(_) => best.take.is_lost,
        };
        while is_short(&best) {
            match self.better(&best)? {
                Some(better) => best = better,
                None => break,
            }
        }
        Ok(best)
    }

    fn better(&self, best: &Standing) -> Result<Option<Standing>, Error> {
        let next = best.rung.map_or(0, |rung| rung + 1);
        for (rung, &way) in RUNGS.iter().enumerate().skip(next) {
            let stand = self.stand(best.times, Ways::All(way), Some(rung), None)?;
            if let Some(stand) = stand.filter(|stand| stand.own < best.own - GAINS.0) {
                return Ok(Some(stand));
            }
        }
        if 2 * best.times > TIMES_MAX {
            return Ok(None);
        }
        let ways = best.island.ways();
        let last = (!best.take.is_lost).then_some(best.change);
        let stand = self.stand(2 * best.times, Ways::As(&ways), best.rung, last)?;
        Ok(stand.filter(|stand| stand.own < best.own - GAINS.1))
    }
}
