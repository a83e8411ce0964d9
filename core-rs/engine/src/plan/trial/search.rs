//! The search for an island that is exact enough: its meshes by better methods, all of it more often.

use crate::plan::trial::waveform_error::{ORDERS, Spans, difference, errors};
use std::cell::OnceCell;

use crate::integrate::MeshMethod;
use crate::maths::decibels;
use crate::network::Error;
use crate::plan::IslandPlan;
use crate::plan::budget::Budget;
use crate::plan::passes::assemble::Assembled;
use crate::plan::passes::mesh::Ways;
use crate::plan::trial::allowance::{Allowance, Halt, unless_spent};
use crate::plan::trial::audible::Audible;
use crate::plan::trial::chaos::{Pair, Parting, Stretches};
use crate::plan::trial::take::{Take, is_worth, play};

/// An island is stepped at most so often a frame.
pub(in crate::plan) const TIMES_MAX: u32 = 8;
/// Methods of meshes where the budget's first is not exact enough, each dearer than the one before.
const RUNGS: [(MeshMethod, u32); 5] = [
    (MeshMethod::Ca2p, 1),
    (MeshMethod::Ca2p, 2),
    (MeshMethod::Bm4, 1),
    (MeshMethod::Bm4, 2),
    (MeshMethod::Bm4, 4),
];
/// The way to an island that is exact enough: meshes by better methods, all of it more often.
pub(in crate::plan) struct Search<'a, F> {
    pub(in crate::plan) assemble: &'a F,
    pub(in crate::plan) spans: &'a Spans,
    /// Of the first take that was not lost.
    pub(in crate::plan) stretches: &'a OnceCell<Stretches>,
    /// Contact substeps a frame, whatever the oversampling.
    pub(in crate::plan) once: usize,
    pub(in crate::plan) n_frames: usize,
    pub(in crate::plan) budget: &'a Budget,
    pub(in crate::plan) allowance: &'a Allowance,
}

/// An island on that way.
pub(in crate::plan) struct Standing {
    pub(in crate::plan) island: Assembled,
    /// Which of `RUNGS` its meshes go by; `None`: as the budget said.
    pub(in crate::plan) rung: Option<usize>,
    pub(in crate::plan) oversampling: u32,
    pub(in crate::plan) contact_substeps: usize,
    pub(in crate::plan) take: Take,
    /// Its error by what half the step changes [dB]; infinite where it is lost.
    pub(in crate::plan) own: f64,
    /// What that change was.
    pub(in crate::plan) change: f64,
    /// Where it is chaotic.
    pub(in crate::plan) parting: Option<Parting>,
    /// What is heard of its error, where pitch is what counts and it is not chaotic.
    pub(in crate::plan) audible: Option<Audible>,
}

/// A step on the way is worth it where it gains so much [dB]: by another method, and by a higher rate.
const GAINS: (f64, f64) = (6.0, 3.0);
/// Or where what is heard of its error is so many times less.
const AUDIBLE_GAIN: f64 = 1.5;
/// Third octaves of takes that have parted: two that differ by rounding alone are up to 2 dB apart over 0.3 s (the
/// bundled tamtam, struck softly to hard), so what is within that is as good as the same; beyond it a step has to
/// gain so much [dB].
const ALIKE: f64 = 2.0;
const GAIN: f64 = 1.0;

impl<F: Fn((u32, Ways<'_>)) -> Result<Assembled, Error>> Search<'_, F> {
    /// Assemble an island and measure its error; `None` if that would take too long or the island is unstable.
    fn stand(
        &self,
        oversampling: u32,
        ways: Ways<'_>,
        rung: Option<usize>,
        last: Option<f64>,
    ) -> Result<Option<Standing>, Halt> {
        let Ok(island) = (self.assemble)((oversampling, ways)) else {
            return Ok(None);
        };
        let Some(finer) = self.finer(&island) else {
            return Ok(None);
        };
        let take = play(
            &island.island_plan,
            self.contact_substeps(oversampling),
            self.n_frames,
            self.allowance,
        )?;
        self.hold(island, take, &finer, rung, last).map(Some)
    }

    /// Half the step by the same methods, else a finer plan could be the same one; `None` where it would take long to
    /// play, or is not stable.
    pub(in crate::plan) fn finer(&self, island: &Assembled) -> Option<Assembled> {
        let finer = (self.assemble)((
            2 * island.island_plan.oversampling,
            Ways::As(&island.ways()),
        ))
        .ok()?;
        is_worth(&finer.island_plan, self.n_frames + self.n_frames / 2).then_some(finer)
    }

    /// How an island and one of half its step are played.
    pub(in crate::plan) fn ways<'b>(
        &self,
        own: &'b IslandPlan,
        finer: &'b IslandPlan,
    ) -> [(&'b IslandPlan, usize); 2] {
        [own, finer].map(|plan| (plan, self.contact_substeps(plan.oversampling)))
    }

    /// Hold an island that was played against half its step.
    pub(in crate::plan) fn hold(
        &self,
        island: Assembled,
        take: Take,
        finer: &Assembled,
        rung: Option<usize>,
        last: Option<f64>,
    ) -> Result<Standing, Halt> {
        let oversampling = island.island_plan.oversampling;
        let fine = play(
            &finer.island_plan,
            self.contact_substeps(2 * oversampling),
            self.n_frames,
            self.allowance,
        )?;
        let change = difference(&take.sound, &fine.sound, self.spans);
        let (own, _) = errors(change, last, ORDERS.1);
        let contact_substeps = self.contact_substeps(oversampling);
        let first = || Stretches::of(&take.sound, self.spans);
        let parting = if take.is_lost {
            None
        } else {
            let pair = Pair {
                take: &take,
                finer: &fine,
                spans: self.spans,
                stretches: self.stretches.get_or_init(first),
            };
            pair.parting(&island.island_plan, contact_substeps, self.allowance)?
        };
        let audible = Audible::of_budget(self.budget, (&take, &fine.sound), self.spans)
            .filter(|_| parting.is_none())
            .map(|audible| audible.times(decibels(own - change)));
        Ok(Standing {
            parting,
            audible,
            own: if take.is_lost { f64::INFINITY } else { own },
            island,
            rung,
            oversampling,
            contact_substeps,
            take,
            change,
        })
    }

    /// How often a step contacts are computed at `times` the rate.
    fn contact_substeps(&self, oversampling: u32) -> usize {
        (self.once / oversampling as usize).max(1)
    }

    /// Improve the island until the budget is met, nothing helps any more, or the allowance is spent.
    pub(in crate::plan) fn climb(
        &self,
        mut best: Standing,
        budget: &Budget,
    ) -> Result<Standing, Error> {
        let is_short = |best: &Standing| match (budget, &best.parting) {
            // Contacts and modes have their share too.
            (Budget::Error(_), None) => best.own > budget.contact(),
            // No waveform can be kept: of it the attack counts, and of all the spectrum.
            (Budget::Error(_), Some(parting)) => {
                let most = budget.contact();
                (parting.attack > most && parting.may_have(most)) || parting.spectral > ALIKE
            }
            (_, Some(parting)) => parting.spectral > ALIKE,
            (_, None) => best.take.is_lost || best.excess(budget) > 1.0,
        };
        let mut fair = None;
        while is_short(&best) {
            let Some(better) = unless_spent(self.better(&best))?.flatten() else {
                break;
            };
            let last = std::mem::replace(&mut best, better);
            let is_fair = |parting: &Parting| parting.spectral <= ALIKE;
            fair = fair.or_else(|| last.parting.as_ref().is_some_and(is_fair).then_some(last));
        }
        // An attack that cannot be had is worth no work.
        let is_missed = |parting: &Parting| parting.attack > budget.asked();
        Ok(match fair {
            Some(fair) if best.parting.as_ref().is_some_and(is_missed) => fair,
            _ => best,
        })
    }

    fn better(&self, best: &Standing) -> Result<Option<Standing>, Halt> {
        let next = best.rung.map_or(0, |rung| rung + 1);
        for (rung, &way) in RUNGS.iter().enumerate().skip(next) {
            let stand = self.stand(best.oversampling, Ways::All(way), Some(rung), None)?;
            if let Some(stand) = stand.filter(|stand| stand.beats(best, GAINS.0, self.budget)) {
                return Ok(Some(stand));
            }
        }
        if 2 * best.oversampling > TIMES_MAX {
            return Ok(None);
        }
        let ways = best.island.ways();
        let last = (!best.take.is_lost).then_some(best.change);
        let stand = self.stand(2 * best.oversampling, Ways::As(&ways), best.rung, last)?;
        if let Some(stand) = stand.filter(|stand| stand.beats(best, GAINS.1, self.budget)) {
            return Ok(Some(stand));
        }
        if best
            .parting
            .as_ref()
            .is_none_or(|parting| parting.spectral <= ALIKE)
        {
            return Ok(None);
        }
        // The method itself may diverge: a simpler method at a higher rate may not.
        let stand = self.stand(2 * best.oversampling, Ways::Budget, None, None)?;
        Ok(stand.filter(|stand| stand.beats(best, GAINS.1, self.budget)))
    }
}

impl Standing {
    /// What is heard of its error, as a multiple of what a budget of pitch allows.
    fn excess(&self, budget: &Budget) -> f64 {
        self.audible.map_or(0.0, |audible| audible.excess(budget))
    }

    /// Whether it is worth its work: by waveform, or where both are chaotic by the attack or the spectrum.
    fn beats(&self, other: &Self, gain: f64, budget: &Budget) -> bool {
        let (Some(own), Some(others)) = (&self.parting, &other.parting) else {
            let (excess, others) = (self.excess(budget), other.excess(budget));
            let is_nearer = self.own < other.own - gain && excess <= others.max(1.0);
            return is_nearer || excess < others / AUDIBLE_GAIN;
        };
        let most = others.spectral.max(ALIKE);
        own.spectral.max(ALIKE) < most - GAIN
            || (own.attack < others.attack - gain && own.spectral <= most)
    }
}
