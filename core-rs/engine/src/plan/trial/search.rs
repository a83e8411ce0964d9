//! The search for an island that is exact enough: first other methods for its meshes, then more steps a frame for the
//! whole island. The `pilot` has chosen the contact substeps before.

use std::cell::OnceCell;
use std::rc::Rc;

use crate::integrate::MeshMethod;
use crate::maths::decibels;
use crate::network::Error;
use crate::plan::budget::Budget;
use crate::plan::passes::assemble::{Assembled, How};
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::trial::allowance::{Allowance, TrialError, unless_spent};
use crate::plan::trial::audible::Audible;
use crate::plan::trial::chaos::{Pair, Parting, Stretches};
use crate::plan::trial::pilot_run::{PilotRun, is_affordable, is_still};
use crate::plan::trial::runs::Runs;
use crate::plan::trial::waveform_error::{
    DOUBLING, EarlyComparison, ORDERS, PARTED, Spans, amplitude_difference, amplitude_sum,
    at_most_first_order, difference, estimate_errors,
};

/// Most steps a frame that the search tries.
pub(in crate::plan) const TIMES_MAX: u32 = 8;
/// Methods of meshes to try if the budget's first choice is not exact enough, in rising order of cost.
const MESH_METHODS: [(MeshMethod, u32); 5] = [
    (MeshMethod::Ca2p, 1),
    (MeshMethod::Ca2p, 2),
    (MeshMethod::Bm4, 1),
    (MeshMethod::Bm4, 2),
    (MeshMethod::Bm4, 4),
];
/// The search for an island that is exact enough: meshes by better methods, all of it more often.
pub(in crate::plan) struct Search<'a, F> {
    pub(in crate::plan) assemble: &'a F,
    pub(in crate::plan) spans: &'a Spans,
    /// The stretches of the first run that was not lost.
    pub(in crate::plan) stretches: &'a OnceCell<Stretches>,
    /// A chaotic parting that was found before the search.
    pub(in crate::plan) chaos: Option<&'a Parting>,
    /// Contact substeps a frame, at any oversampling.
    pub(in crate::plan) substeps_per_frame: usize,
    pub(in crate::plan) n_frames: usize,
    pub(in crate::plan) runs: &'a Runs,
    pub(in crate::plan) budget: &'a Budget,
    pub(in crate::plan) allowance: &'a Allowance,
}

/// An island by one choice of methods and steps, with its measured error.
#[derive(Clone)]
pub(in crate::plan) struct Candidate {
    pub(in crate::plan) island: Assembled,
    /// Index into `MESH_METHODS` of the method of its meshes; `None`: the method that the budget gave.
    pub(in crate::plan) method_index: Option<usize>,
    pub(in crate::plan) oversampling: u32,
    pub(in crate::plan) contact_substeps: usize,
    pub(in crate::plan) run: Rc<PilotRun>,
    /// Its error, estimated from the change at half the step [dB]; infinite if the run is lost.
    pub(in crate::plan) error: f64,
    /// The change at half the step [dB].
    pub(in crate::plan) change: f64,
    /// The run at half the step, and its error [dB].
    pub(in crate::plan) finer: (Rc<PilotRun>, f64),
    /// How the two runs part; `None` if the motion is not chaotic.
    pub(in crate::plan) parting: Option<Parting>,
    /// The audible error; `None` unless the budget is one of pitch and the motion is not chaotic.
    pub(in crate::plan) audible: Option<Audible>,
}

/// A way that was tried: with its error, or rejected.
pub(in crate::plan) type Tried = Result<Candidate, Rejected>;

/// What is known of a way that was rejected.
#[derive(Clone, Copy)]
pub(in crate::plan) struct Rejected {
    /// The least that its run differs from that of a better way, or from its own at half the step [dB]; NaN if it was
    /// not played.
    change: f64,
}

impl Rejected {
    const UNPLAYED: Self = Self { change: f64::NAN };

    /// Whether two ways differ equally from others. Differences of runs that have parted say nothing.
    fn is_same(self, other: Self) -> bool {
        self.change < PARTED && (self.change - other.change).abs() < SAME
    }
}

/// Least gain that makes a step of the search worth its cost [dB]: for another method, and for a higher rate.
const METHOD_GAIN: f64 = 6.0;
const RATE_GAIN: f64 = 3.0;
/// Two differences from other runs that differ by less than this are the same [dB].
const SAME: f64 = 1.0;
/// A step is also worth its cost if it divides the audible error by at least this.
const AUDIBLE_GAIN: f64 = 1.5;
/// Laws whose audible error at one computation a step exceeds the budget by this factor are computed between frames:
/// that costs about as much as two doublings of the rate, which divide an error of order 1 by this factor.
const FAR_OFF: f64 = 4.0;
/// Differences of third octaves between runs that have parted [dB]. Two runs that differ by rounding alone are up to 2
/// dB apart over 0.3 s (the bundled tamtam, struck softly to hard), so differences below `SPECTRUM_NOISE` are as good
/// as none; above it a step has to gain `SPECTRUM_GAIN`.
pub const SPECTRUM_NOISE: f64 = 2.0;
const SPECTRUM_GAIN: f64 = 1.0;

/// How to assemble an island, the runs already played, the budget, and the allowance of work.
pub(in crate::plan) type Trial<'a, F> = (&'a F, &'a Runs, &'a Budget, &'a Allowance);

impl<'a, F: Fn(How<'_>) -> Result<Assembled, Error>> Search<'a, F> {
    /// Starts from an island with its contact substeps, and a chaotic parting that is already known.
    pub(in crate::plan) fn new(
        (assemble, runs, budget, allowance): Trial<'a, F>,
        (spans, stretches): (&'a Spans, &'a OnceCell<Stretches>),
        (island, contact_substeps): (&Assembled, usize),
        chaos: Option<&'a Parting>,
    ) -> Self {
        Self {
            assemble,
            chaos,
            stretches,
            spans,
            allowance,
            // Contacts that are computed once a step stay so at any oversampling.
            substeps_per_frame: match contact_substeps {
                1 => 1,
                some => some * island.island_plan.oversampling as usize,
            },
            n_frames: runs.excerpt().n_frames,
            runs,
            budget,
        }
    }

    /// Returns the island as it was played, with its measured error; `None` if playing half the step is not worth its
    /// work.
    pub(in crate::plan) fn start(
        &self,
        island: &Assembled,
        run: &Rc<PilotRun>,
    ) -> Result<Option<Candidate>, Error> {
        let Some(finer) = self.finer(island) else {
            return Ok(None);
        };
        let any = (None, None, f64::INFINITY);
        let candidate = self.compare_with_finer(island.clone(), run.clone(), &finer, any);
        Ok(unless_spent(candidate)?.and_then(Result::ok))
    }

    /// Assembles an island and measures its error. It is rejected if its waveform error is not below that of `best` by
    /// more than `gain` [dB], if it would take too long, or if it is unstable.
    fn measure(
        &self,
        how: How<'_>,
        method_index: Option<usize>,
        last: Option<f64>,
        (best, gain): (&Candidate, f64),
    ) -> Result<Tried, TrialError> {
        let Ok(island) = (self.assemble)(how) else {
            return Ok(Err(Rejected::UNPLAYED));
        };
        let Some(finer) = self.finer(&island) else {
            return Ok(Err(Rejected::UNPLAYED));
        };
        // Chaotic motion and audible errors are not judged by the waveform alone.
        let is_by_waveform = matches!(self.budget, Budget::Error(_)) && best.parting.is_none();
        let most = if is_by_waveform && !best.run.is_lost {
            best.error - gain
        } else {
            f64::INFINITY
        };
        let (reference, reference_error) = best.finest();
        let mut comparison = EarlyComparison::against(&reference.sound, self.spans);
        let played = (&island.island_plan, self.contact_substeps(&island));
        let run = self
            .runs
            .play_while(played, self.allowance, |frames, sound| {
                let apart = comparison.update(frames, sound);
                apart.is_none_or(|apart| amplitude_difference(apart, reference_error) <= most)
            })?;
        let Some(run) = run else {
            return Ok(Err(Rejected {
                change: comparison.lower_bound,
            }));
        };
        self.compare_with_finer(island, run, &finer, (method_index, last, most))
    }

    /// Assembles the island at half its step by the same methods: by other methods the result might be the same island
    /// again. `None` if it would take too long to play, or is not stable.
    pub(in crate::plan) fn finer(&self, island: &Assembled) -> Option<Assembled> {
        let methods = island.mesh_methods();
        let how = island.again(2 * island.island_plan.oversampling, &methods);
        let finer = (self.assemble)(how).ok()?;
        is_affordable(&finer.island_plan, self.n_frames + self.n_frames / 2).then_some(finer)
    }

    /// Measures the error of a played island by playing it at half its step; it is rejected if the error is above `most`
    /// [dB].
    pub(in crate::plan) fn compare_with_finer(
        &self,
        island: Assembled,
        run: Rc<PilotRun>,
        finer: &Assembled,
        (method_index, last, most): (Option<usize>, Option<f64>, f64),
    ) -> Result<Tried, TrialError> {
        let oversampling = island.island_plan.oversampling;
        let mut comparison = EarlyComparison::against(&run.sound, self.spans);
        let played = (&finer.island_plan, self.contact_substeps(finer));
        let fine = self
            .runs
            .play_while(played, self.allowance, |frames, sound| {
                let change = comparison.update(frames, sound);
                change.is_none_or(|change| estimate_errors(change, last, ORDERS.1).0 <= most)
            })?;
        let Some(fine) = fine else {
            return Ok(Err(Rejected {
                change: comparison.lower_bound,
            }));
        };
        let change = difference(&run.sound, &fine.sound, self.spans);
        let (mut error, mut left) = estimate_errors(change, last, ORDERS.1);
        if island.may_collocate || island.sticks() {
            error = at_most_first_order(error, last.map(|last| last + DOUBLING));
            left = at_most_first_order(left, Some(error));
        }
        if error > most {
            return Ok(Err(Rejected { change }));
        }
        let contact_substeps = self.contact_substeps(&island);
        // Two runs say little of friction, and of laws that are computed once a step; nor do three if the change hardly
        // falls from one to the next.
        let is_unsure = last.is_none_or(|last| change > last - RATE_GAIN);
        let has_plain_laws = island.may_collocate && contact_substeps == 1;
        let by_two_runs = error;
        let mut heard = (fine.clone(), change);
        if is_unsure
            && (island.sticks() || has_plain_laws)
            && let Some(finest) = self.finer(finer)
        {
            let played = (&finest.island_plan, self.contact_substeps(&finest));
            let finest = self.runs.play(played, self.allowance)?;
            let next = difference(&fine.sound, &finest.sound, self.spans);
            let (of_finer, _) = estimate_errors(next, Some(change), ORDERS.1);
            error = error.max(match island.sticks() {
                true => of_finer + DOUBLING,
                false => amplitude_sum([change, of_finer]),
            });
            left = at_most_first_order(left, Some(error));
            if island.sticks() {
                let apart = difference(&run.sound, &finest.sound, self.spans);
                heard = (finest, apart);
            }
        }
        let first = || Stretches::of(&run.sound, self.spans);
        let parting = if run.is_lost {
            None
        } else {
            let pair = Pair {
                run: &run,
                finer: &fine,
                spans: self.spans,
                stretches: self.stretches.get_or_init(first),
            };
            pair.parting(&island.island_plan, contact_substeps, self.allowance)?
                .or_else(|| self.chaos.map(|known| known.compare_other(&pair, false)))
        };
        let (heard, apart) = heard;
        let audible = Audible::of_budget(self.budget, (&run, &heard.sound), self.spans)
            .filter(|_| parting.is_none())
            .map(|audible| {
                // Steps of friction are all heard; of a law's error most is the phase of a chatter.
                let error = if island.sticks() { error } else { by_two_runs };
                audible.times(decibels(error - apart))
            });
        Ok(Ok(Candidate {
            parting,
            audible,
            error: if run.is_lost { f64::INFINITY } else { error },
            island,
            method_index,
            oversampling,
            contact_substeps,
            run,
            change,
            finer: (fine, left),
        }))
    }

    /// Contact substeps a step.
    pub(in crate::plan) fn contact_substeps(&self, island: &Assembled) -> usize {
        if island.is_plain {
            return island.island_plan.contact_substeps;
        }
        let oversampling = island.island_plan.oversampling;
        let least = self.substeps_per_frame.min(Budget::STEPS_MIN);
        (self.substeps_per_frame / oversampling as usize).max(least)
    }

    /// Improves the island until the budget is met, nothing helps any more, or the allowance is spent.
    pub(in crate::plan) fn improve(&self, start: Candidate) -> Result<Candidate, Error> {
        let best = self.climb(start)?;
        match unless_spent(self.refutation(&best))?.flatten() {
            Some(other) => self.climb(other),
            None => Ok(best),
        }
    }

    /// If the search ended above the budget, the island with meshes of order 4, where these show that the measured error
    /// is false: two runs whose steps are all too long may agree by chance.
    fn refutation(&self, best: &Candidate) -> Result<Option<Candidate>, TrialError> {
        let is_by_waveform = matches!(self.budget, Budget::Error(_)) && best.parting.is_none();
        let of_order_4 = MESH_METHODS
            .iter()
            .position(|(kind, _)| *kind == MeshMethod::Bm4);
        if !is_by_waveform || !best.misses(self.budget) || best.method_index >= of_order_4 {
            return Ok(None);
        }
        let methods = MethodChoice::All((MeshMethod::Bm4, 1));
        let how = How::fine(best.oversampling, methods);
        let tried = self.measure(how, of_order_4, None, (best, f64::NEG_INFINITY))?;
        Ok(tried.ok().filter(|other| {
            let apart = difference(&best.run.sound, &other.run.sound, self.spans);
            apart > amplitude_sum([best.error, other.error])
        }))
    }

    /// Takes better islands until the budget is met, nothing helps any more, or the allowance is spent.
    fn climb(&self, mut best: Candidate) -> Result<Candidate, Error> {
        let mut fair = None;
        while best.misses(self.budget) {
            let Some(better) = unless_spent(self.better(&best))?.flatten() else {
                break;
            };
            let last = std::mem::replace(&mut best, better);
            let is_fair = |parting: &Parting| parting.spectral <= SPECTRUM_NOISE;
            fair = fair.or_else(|| last.parting.as_ref().is_some_and(is_fair).then_some(last));
        }
        // If the attack is missed in any case, the cheaper island with a good spectrum is taken.
        let is_missed = |parting: &Parting| parting.attack > self.budget.asked();
        Ok(match fair {
            Some(fair) if best.parting.as_ref().is_some_and(is_missed) => fair,
            _ => best,
        })
    }

    pub(in crate::plan) fn better(
        &self,
        best: &Candidate,
    ) -> Result<Option<Candidate>, TrialError> {
        // If the links at a body's ports are of order 1 only, its modes gain no accuracy. A led body keeps its method:
        // by CA its amplitude would change differently, and the pilot may end before that is heard.
        let is_led = !best.island.island_plan.timeline.leads.is_empty();
        if best.island.has_modes() && best.oversampling == 1 && !is_led {
            let gain = (best, METHOD_GAIN);
            let stepped = self.measure(How::fine(1, MethodChoice::Stepped), None, None, gain)?;
            let is_better = |candidate: &Candidate| candidate.beats(best, METHOD_GAIN, self.budget);
            if let Some(candidate) = stepped.ok().filter(is_better) {
                return Ok(Some(candidate));
            }
        }
        let next = best.method_index.map_or(0, |method_index| method_index + 1);
        let mut rejected = Rejected::UNPLAYED;
        for (method_index, &method) in MESH_METHODS.iter().enumerate().skip(next) {
            let how = How::fine(best.oversampling, MethodChoice::All(method));
            let own = match self.measure(how, Some(method_index), None, (best, METHOD_GAIN))? {
                Ok(own) if own.beats(best, METHOD_GAIN, self.budget) => return Ok(Some(own)),
                Ok(own) => Rejected { change: own.change },
                Err(own) => own,
            };
            // If meshes at half the step gain nothing, the error comes from elsewhere.
            let (kind, steps) = method;
            let is_halved = |other: Option<usize>| {
                other.is_some_and(|other| MESH_METHODS[other] == (kind, steps / 2))
            };
            let gains_nothing = is_halved(method_index.checked_sub(1)) && own.is_same(rejected);
            if is_halved(best.method_index) || gains_nothing {
                break;
            }
            rejected = own;
        }
        if 2 * best.oversampling > TIMES_MAX {
            return Ok(None);
        }
        let methods = best.island.mesh_methods();
        let last = (!best.run.is_lost).then_some(best.change);
        let twice = 2 * best.oversampling;
        let (again, gain) = (best.island.again(twice, &methods), (best, RATE_GAIN));
        let candidate = self.measure(again, best.method_index, last, gain)?;
        let is_better = |candidate: &Candidate| candidate.beats(best, RATE_GAIN, self.budget);
        if let Some(candidate) = candidate.ok().filter(is_better) {
            return Ok(Some(candidate));
        }
        if best
            .parting
            .as_ref()
            .is_none_or(|parting| parting.spectral <= SPECTRUM_NOISE)
        {
            return Ok(None);
        }
        // The method itself may diverge: a simpler method at a higher rate may not.
        let simple = How::fine(twice, MethodChoice::ByBudget);
        let candidate = self.measure(simple, None, None, gain)?;
        Ok(candidate.ok().filter(is_better))
    }
}

impl Candidate {
    /// Whether its error is above the budget.
    pub(in crate::plan) fn misses(&self, budget: &Budget) -> bool {
        match (budget, &self.parting) {
            // The rest of the budget is for contacts and left-out modes.
            (Budget::Error(_), None) => self.error > budget.contact(),
            // No waveform can be kept: the attack is judged by its waveform, the whole by its spectrum.
            (Budget::Error(_), Some(parting)) => {
                let most = budget.contact();
                (parting.attack > most && parting.is_attainable(most))
                    || parting.spectral > SPECTRUM_NOISE
            }
            (_, Some(parting)) => parting.spectral > SPECTRUM_NOISE,
            (_, None) => self.run.is_lost || self.excess(budget) > 1.0,
        }
    }

    /// Whether the motion is chaotic and its spectrum differs by more than rounding explains, or the audible error is far
    /// above the budget.
    pub(in crate::plan) fn is_far_off(&self, budget: &Budget) -> bool {
        match &self.parting {
            Some(parting) => parting.spectral > SPECTRUM_NOISE,
            None => self.excess(budget) > FAR_OFF,
        }
    }

    /// Whether dry friction holds all that is heard: by CA a strike that friction can stop within a step moves nothing, at
    /// any rate.
    pub(in crate::plan) fn is_held(&self) -> bool {
        let n_out = self.island.island_plan.network.outputs().len();
        self.island.sticks() && is_still(&self.run.sound, n_out)
    }

    /// The most exact known run, and its error.
    pub(in crate::plan) fn finest(&self) -> (&Rc<PilotRun>, f64) {
        let (finer, error) = &self.finer;
        if *error < self.error {
            (finer, *error)
        } else {
            (&self.run, self.error)
        }
    }

    /// The audible error, as a multiple of what a budget of pitch allows.
    fn excess(&self, budget: &Budget) -> f64 {
        self.audible.map_or(0.0, |audible| audible.excess(budget))
    }

    /// Whether this candidate is enough better than `other` to be worth its work: by waveform or audible error or, if
    /// both are chaotic, by the attack or the spectrum.
    fn beats(&self, other: &Self, gain: f64, budget: &Budget) -> bool {
        let (Some(own), Some(others)) = (&self.parting, &other.parting) else {
            let (excess, others) = (self.excess(budget), other.excess(budget));
            let is_nearer = self.error < other.error - gain && excess <= others.max(1.0);
            return is_nearer || excess < others / AUDIBLE_GAIN;
        };
        let most = others.spectral.max(SPECTRUM_NOISE);
        own.spectral.max(SPECTRUM_NOISE) < most - SPECTRUM_GAIN
            || (own.attack < others.attack - gain && own.spectral <= most)
    }
}
