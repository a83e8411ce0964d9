//! A pilot: the beginning of an island's music, played to see what it needs.
//!
//! It lasts until a while after the first contact, or after the first event where nothing touches. From it follow how
//! finely contacts are computed (the same stretch at S and 2S: what differs is the error), which modes of a body
//! this score excites, and how often a frame the whole island is stepped (again by what differs).

use std::cell::OnceCell;

use crate::island::inside::BodyPlan;
use crate::network::Error;
use crate::plan::IslandPlan;
use crate::plan::budget::Budget;
use crate::plan::choice::Choice;
use crate::plan::passes::assemble::{Assembled, Shape};
use crate::plan::passes::linear::NoModes;
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::passes::ported::PortedBody;
use crate::plan::passes::truncate::KeptModes;
use crate::plan::report::row::Measured;
use crate::plan::trial::allowance::{Allowance, TrialError, unless_spent};
use crate::plan::trial::audible::Audible;
use crate::plan::trial::chaos::{Pair, Parting, Stretches};
use crate::plan::trial::cheapest::{self, left_of};
use crate::plan::trial::horizon;
use crate::plan::trial::pilot_run::{PilotRun, length, play};
use crate::plan::trial::prune_modes::fewer;
use crate::plan::trial::record::{TrialRecord, TrialStore};
use crate::plan::trial::search::{Candidate, Search, TIMES_MAX};
use crate::plan::trial::waveform_error::{
    DOUBLING, ORDERS, Spans, beside, difference, errors, with_kinks,
};

/// Orders of the error of contacts, none the lower where they close or open, and of laws: many have a kink.
const CONTACT: f64 = 4.0;
const LAW: f64 = 2.0;
/// Contacts are not computed more finely where so many doublings one after the other gain less than this [dB]: what
/// differs is then no error of theirs. (A steep law may begin to gain later.)
const IDLE: usize = 2;
const GAIN: f64 = 3.0;

/// Contacts are computed at most so often a step.
const SUBSTEPS_MAX: usize = 2 * TIMES_MAX as usize * Budget::STEPS_MAX;

/// An island that meets its budget as far as possible, and its remaining error.
pub(in crate::plan) struct Piloted {
    pub(in crate::plan) island: Assembled,
    pub(in crate::plan) error: Option<Measured>,
}

/// What a plan decided before; `None` where it does not fit.
pub(in crate::plan) fn pinned(island: Assembled, pin: &Choice) -> Option<Piloted> {
    if pin.kept.len() != island.bodies.len() {
        return None;
    }
    let pairs = pin.kept.iter().zip(&island.island_plan.bodies);
    let kept = pairs.map(|(kept, body)| match body {
        BodyPlan::Modal(modal) => KeptModes::pinned(kept, modal.modes.len()),
        BodyPlan::Mesh(_) | BodyPlan::Slow(_) => Some(KeptModes::none()),
    });
    let kept = kept.collect::<Option<Vec<_>>>()?;
    Some(Piloted {
        island: island.only(pin.contact_substeps.clamp(1, Budget::STEPS_MAX), kept),
        error: None,
    })
}

/// An island as its pilot left it, whose error may not hold for long.
pub(in crate::plan) struct Tried {
    pub(in crate::plan) piloted: Piloted,
    /// How to play on, to see how long it holds.
    pub(in crate::plan) beyond: Option<Beyond>,
}

/// An island with all its modes and the same at half its step, to be played beside each other.
pub(in crate::plan) struct Beyond {
    pub(in crate::plan) own: Assembled,
    pub(in crate::plan) finer: Assembled,
    /// Contact substeps a step, of each.
    pub(in crate::plan) contact_substeps: [usize; 2],
}

impl Tried {
    /// With the error that holds, and over how long.
    pub(in crate::plan) fn held(
        self,
        budget: &Budget,
        known: (&Allowance, Option<&dyn TrialStore>),
    ) -> Result<Piloted, Error> {
        let Self {
            mut piloted,
            beyond,
        } = self;
        if let (Some(measured), Some(beyond)) = (piloted.error, beyond) {
            let [own, finer] = beyond.contact_substeps;
            let played = [
                (&beyond.own.island_plan, own),
                (&beyond.finer.island_plan, finer),
            ];
            piloted.error = unless_spent(horizon::held(measured, budget.asked(), played, known))?;
        }
        Ok(piloted)
    }

    /// As a record that [`Tried::recalled`] reads.
    pub(in crate::plan) fn record(&self) -> TrialRecord {
        let Assembled {
            island_plan,
            bodies,
            because,
            shape,
            ..
        } = &self.piloted.island;
        let beyond = self.beyond.as_ref();
        let [own, finer] = beyond.map_or([0, 0], |beyond| beyond.contact_substeps);
        let how = [
            island_plan.oversampling,
            island_plan.contact_substeps as u32,
            *shape as u32,
            own as u32,
            finer as u32,
        ];
        let mut numbers = TrialRecord::numbers_of(self.piloted.error);
        numbers.extend(bodies.iter().map(|body| body.left_out));
        let kept = bodies.iter().map(PortedBody::numbers);
        TrialRecord {
            numbers,
            counts: std::iter::once(how.to_vec()).chain(kept).collect(),
            reason: because.as_ref().map(|why| why.why().to_owned()),
        }
    }

    /// As an earlier pilot left it; `None` where the record does not fit. `assemble` takes what was decided, too.
    pub(in crate::plan) fn recalled(
        record: &TrialRecord,
        assemble: &impl Fn((u32, MethodChoice<'_>), Option<&Choice>) -> Result<Assembled, Error>,
    ) -> Option<Self> {
        let (error, left_out) = record.error()?;
        let (how, kept) = record.counts.split_first()?;
        let &[oversampling, contact_substeps, shape, own, finer] = &how[..] else {
            return None;
        };
        let is_much = own.max(finer) as usize > SUBSTEPS_MAX;
        if !(1..=2 * TIMES_MAX).contains(&oversampling) || is_much {
            return None;
        }
        let shape = *Shape::ALL.get(shape as usize)?;
        let choice = Choice {
            oversampling,
            contact_substeps: contact_substeps as usize,
            kept: kept.to_vec(),
            ..Choice::default()
        };
        let island = assemble((oversampling, MethodChoice::ByBudget), Some(&choice)).ok()?;
        let Piloted { mut island, .. } = pinned(island, &choice)?;
        island.shape = shape;
        if left_out.len() != island.bodies.len() {
            return None;
        }
        for (body, left_out) in island.bodies.iter_mut().zip(left_out) {
            body.left_out = *left_out;
        }
        island.because = match &record.reason {
            Some(why) => Some(NoModes::of(why)?),
            None => None,
        };
        let beyond = if own > 0 {
            let methods = island.mesh_methods();
            let at = |times| assemble((times, island.again(&methods)), None).ok();
            Some(Beyond {
                own: at(oversampling)?,
                finer: at(2 * oversampling)?,
                contact_substeps: [own, finer].map(|substeps| substeps as usize),
            })
        } else {
            None
        };
        Some(Self {
            piloted: Piloted { island, error },
            beyond,
        })
    }
}

impl From<Piloted> for Tried {
    fn from(piloted: Piloted) -> Self {
        Self {
            piloted,
            beyond: None,
        }
    }
}

/// The cheapest island within the budget; `assemble` puts it together at some times the rate.
pub(in crate::plan) fn pilot(
    assemble: &impl Fn((u32, MethodChoice<'_>)) -> Result<Assembled, Error>,
    budget: &Budget,
    allowance: &Allowance,
) -> Result<Tried, Error> {
    if let Budget::Method(_) = budget {
        let island = assemble((1, MethodChoice::ByBudget))?;
        return Ok(Piloted {
            island,
            error: None,
        }
        .into());
    }
    let island = first(assemble)?;
    let timeline = &island.island_plan.timeline;
    if timeline.is_open || timeline.hands().next().is_some() {
        // Nobody knows beforehand what a hand or a session will do: nothing is left out.
        return Ok(Piloted {
            island,
            error: None,
        }
        .into());
    }
    let n_frames = unless_spent(length(&island.island_plan, allowance))?.unwrap_or(0);
    if n_frames == 0 {
        return Ok(Piloted {
            island,
            error: None,
        }
        .into());
    }
    let spans = Spans::of(&island.island_plan, n_frames);
    let stretches = OnceCell::new();
    let found = contacts(&island, budget, n_frames, (&spans, &stretches), allowance);
    let Some(found) = unless_spent(found)? else {
        return Ok(Piloted {
            island,
            error: None,
        }
        .into());
    };
    let search = Search {
        assemble,
        chaos: found.parting.as_ref().filter(|_| found.is_idle),
        stretches: &stretches,
        spans: &spans,
        allowance,
        // What is computed once a step stays so at any rate.
        once: match found.contact_substeps {
            1 => 1,
            some => some * island.island_plan.oversampling as usize,
        },
        n_frames,
        budget,
    };
    let of_contacts =
        unless_spent(found.audible(&island.island_plan, budget, (n_frames, &spans), allowance))?;
    let told = |own: Option<f64>, parting: Option<&Parting>, audible: Option<Audible>| {
        let seconds = |frames: usize| frames as f64 / spans.rate;
        if let (Some(parting), Some(stretches)) = (parting, stretches.get()) {
            let (db, until) = parting.until(budget.asked(), stretches);
            return Some(Measured {
                db,
                over: seconds(until),
                spectral: Some(parting.spectral),
                audible: None,
            });
        }
        own.map(|own| Measured {
            db: beside(own, found.error.unwrap_or(f64::NEG_INFINITY)),
            over: seconds(n_frames),
            spectral: None,
            audible: audible.map(|own| own.with(of_contacts.flatten().unwrap_or_default())),
        })
    };
    let start = match search.finer(&island) {
        Some(finer) => {
            let held =
                search.compare_with_finer(island.clone(), found.run.clone(), &finer, None, None);
            unless_spent(held)?
        }
        None => None,
    };
    let Some(start) = start else {
        if found.run.is_lost
            && let Some((island, run)) = safe(assemble, n_frames, allowance)?
        {
            let steps = island.island_plan.contact_substeps;
            let island = match run {
                Some(run) => fewer(
                    &island,
                    (steps, &run),
                    (n_frames, budget, budget.left_out()),
                    allowance,
                )?,
                None => island,
            };
            return Ok(Piloted {
                island,
                error: None,
            }
            .into());
        }
        let error = told(found.error, found.parting.as_ref(), None);
        let island = fewer(
            &island,
            (found.contact_substeps, &found.run),
            (n_frames, budget, budget.left_out()),
            allowance,
        )?;
        return Ok(Piloted { island, error }.into());
    };
    let mut best = search.improve(start, budget)?;
    if best.run.is_lost
        && let Some((island, run)) = safe(assemble, n_frames, allowance)?
    {
        let Some(run) = run else {
            return Ok(Piloted {
                island,
                error: None,
            }
            .into());
        };
        best = Candidate {
            contact_substeps: island.island_plan.contact_substeps,
            island,
            run,
            error: f64::NAN,
            parting: None,
            audible: None,
            ..best
        };
    }
    // What is lost, or by what cannot be lost, was held against nothing.
    let own = Some(best.error).filter(|own| own.is_finite());
    let parting = match best.parting.clone() {
        Some(parting) => Some(parting.with(found.parting.as_ref())),
        None => found.parting.clone(),
    };
    let mut error = told(own, parting.as_ref(), best.audible);
    let mut island = fewer(
        &best.island,
        (best.contact_substeps, &best.run),
        (n_frames, budget, budget.left_out()),
        allowance,
    )?;
    let is_kept = error.is_some_and(|error| error.spectral.is_none() && error.db <= budget.asked());
    if matches!(budget, Budget::Error(_)) && is_kept {
        let part = allowance.part(cheapest::SHARE);
        let search = Search {
            allowance: &part,
            ..search
        };
        let cheaper = search.cheapest((&best, island.island_plan.cost()), found.error)?;
        allowance.spend_part(&part, cheapest::SHARE);
        if let Some(cheaper) = cheaper {
            best = cheaper;
            // What contacts add is in it.
            error = error.map(|error| Measured {
                db: best.error,
                ..error
            });
            let left = left_of(budget.asked(), best.error);
            let most = budget.left_out().map(|most| most.min(left));
            island = fewer(
                &best.island,
                (best.contact_substeps, &best.run),
                (n_frames, budget, most),
                allowance,
            )?;
        }
    }
    let is_open_ended = error.is_some_and(|error| error.spectral.is_none())
        && horizon::may_grow(&best.island.island_plan);
    let finer = is_open_ended.then(|| search.finer(&best.island)).flatten();
    Ok(Tried {
        piloted: Piloted { island, error },
        beyond: finer.map(|finer| Beyond {
            contact_substeps: [&best.island, &finer].map(|island| search.contact_substeps(island)),
            own: best.island,
            finer,
        }),
    })
}

/// An island whose meshes cannot diverge, and how it plays, where the allowance lets it; `None` where it is lost too.
fn safe(
    assemble: &impl Fn((u32, MethodChoice<'_>)) -> Result<Assembled, Error>,
    n_frames: usize,
    allowance: &Allowance,
) -> Result<Option<(Assembled, Option<PilotRun>)>, Error> {
    let Ok(island) = assemble((1, MethodChoice::Unconditional)) else {
        return Ok(None);
    };
    let steps = island.island_plan.contact_substeps;
    let run = unless_spent(play(&island.island_plan, steps, n_frames, allowance))?;
    let is_lost = run.as_ref().is_some_and(|run| run.is_lost);
    Ok((!is_lost).then_some((island, run)))
}

/// An island at the lowest rate at which it is stable.
fn first(
    assemble: &impl Fn((u32, MethodChoice<'_>)) -> Result<Assembled, Error>,
) -> Result<Assembled, Error> {
    match assemble((1, MethodChoice::ByBudget)) {
        // Where it diverges at this rate it may not at a higher one.
        Err(error @ Error::Unstable { .. }) => {
            let higher = [2, 4, 8, 2 * TIMES_MAX].into_iter();
            let mut stable = higher
                .filter_map(|oversampling| assemble((oversampling, MethodChoice::ByBudget)).ok());
            stable.next().ok_or(error)
        }
        other => other,
    }
}

/// How finely contacts are computed: as finely as it takes for twice as often to make no difference.
struct Contacts {
    contact_substeps: usize,
    error: Option<f64>,
    run: PilotRun,
    /// Where it is chaotic: then the error is that of the time until runs part.
    parting: Option<Parting>,
    /// Computing them more finely gains nothing.
    is_idle: bool,
}

impl Contacts {
    /// What is heard of the error of contacts, where it stays above what they are to be right to.
    fn audible(
        &self,
        island_plan: &IslandPlan,
        budget: &Budget,
        (n_frames, spans): (usize, &Spans),
        allowance: &Allowance,
    ) -> Result<Option<Audible>, TrialError> {
        let is_missed = self.error.is_some_and(|error| error > budget.contact());
        if !is_missed || self.parting.is_some() || !matches!(budget, Budget::Cents { .. }) {
            return Ok(None);
        }
        let finer = play(island_plan, 2 * self.contact_substeps, n_frames, allowance)?;
        Ok(Audible::of_budget(budget, (&self.run, &finer.sound), spans))
    }

    /// Nothing is known but that a part of the island goes beyond all bounds.
    fn lost(contact_substeps: usize, run: PilotRun) -> Self {
        Self {
            contact_substeps,
            error: None,
            run,
            parting: None,
            is_idle: false,
        }
    }
}

fn contacts(
    island: &Assembled,
    budget: &Budget,
    n_frames: usize,
    (spans, stretches): (&Spans, &OnceCell<Stretches>),
    allowance: &Allowance,
) -> Result<Contacts, TrialError> {
    let island_plan = &island.island_plan;
    // Of what no waveform is promised laws are right as they are.
    let may_collocate = island.may_collocate && matches!(budget, Budget::Error(_));
    if island_plan.contact_substeps == 1 && !may_collocate {
        return Ok(Contacts {
            contact_substeps: 1,
            error: None,
            run: play(island_plan, 1, n_frames, allowance)?,
            parting: None,
            is_idle: false,
        });
    }
    let aim = budget.contact();
    let order = if island.may_collocate { LAW } else { CONTACT };
    let mut contact_substeps = island_plan.contact_substeps;
    let mut run = play(island_plan, contact_substeps, n_frames, allowance)?;
    let (mut last, mut before) = (None, None);
    let (mut parting, mut until) = (None, n_frames);
    // What is known of the run: its error, and where it parts from others.
    let mut known: Option<(f64, Option<Parting>)> = None;
    // The last run from which doubling gained something, and how often it has gained nothing since.
    let mut settled: Option<Contacts> = None;
    // A run that may agree with the finer one by luck.
    let mut unsure: Option<Contacts> = None;
    let mut idle = 0;
    loop {
        let finer = play(island_plan, 2 * contact_substeps, n_frames, allowance);
        let finer = match (finer, known.take()) {
            (Ok(finer), _) => finer,
            (Err(TrialError::AllowanceSpent), Some((error, parting))) => {
                return Ok(Contacts {
                    contact_substeps,
                    error: Some(error),
                    run,
                    parting,
                    is_idle: false,
                });
            }
            (Err(TrialError::AllowanceSpent), None) if run.is_lost => {
                return Ok(Contacts::lost(contact_substeps, run));
            }
            (Err(halt), _) => return Err(halt),
        };
        let pair = (!run.is_lost).then(|| Pair {
            run: &run,
            finer: &finer,
            spans,
            stretches: stretches.get_or_init(|| Stretches::of(&run.sound, spans)),
        });
        if let Some(pair) = pair {
            let was_chaotic = parting.is_some();
            if was_chaotic && pair.together().is_none() {
                // What diverged was computed too roughly.
                parting = None;
            } else if !was_chaotic {
                parting = pair.parting(island_plan, contact_substeps, allowance)?;
            }
            if was_chaotic != parting.is_some() {
                // Of what is chaotic only the time until runs part tells.
                let together = parting.as_ref().and_then(|_| pair.together());
                (until, last, before) = (together.unwrap_or(n_frames), None, None);
            }
        }
        let told = |is_finer| {
            parting
                .as_ref()
                .zip(pair)
                .map(|(own, pair)| own.again(&pair, is_finer))
        };
        let change = difference(&run.sound, &finer.sound, &spans.within(until));
        let last_change = last;
        let (own, left) = errors(change, last, order);
        // Once a step is another method: it tells nothing of how fast the error falls.
        let is_between = contact_substeps > 1;
        let has_kinks = island.may_collocate && is_between;
        let stated = with_kinks(own, before);
        let stated_left = with_kinks(left, has_kinks.then_some(own));
        before = has_kinks.then_some(own);
        if let Some(found) = unsure.take()
            && own + DOUBLING <= aim
        {
            return Ok(Contacts {
                error: found.error.map(|error| error.max(own + DOUBLING)),
                ..found
            });
        }
        // Where something sticks, or a law has a kink, two runs may agree by luck: three do not.
        let is_sure = last.is_some() || !(island.sticks() || island.may_collocate);
        let is_idle = !island.may_collocate && last.is_some_and(|last| change > last - GAIN);
        idle = if is_idle { idle + 1 } else { 0 };
        last = is_between.then_some(change);
        if own <= aim && stated <= budget.asked() && is_sure {
            let parting = told(false);
            return Ok(Contacts {
                contact_substeps,
                error: Some(stated),
                run,
                parting,
                is_idle: false,
            });
        }
        contact_substeps *= 2;
        // What a kink leaves is known of a run that a finer one was held against.
        let is_enough = left <= aim && is_sure && !island.may_collocate;
        if is_enough || 2 * contact_substeps > Budget::STEPS_MAX {
            return Ok(Contacts {
                contact_substeps,
                error: Some(stated_left),
                parting: told(true),
                run: finer,
                is_idle: false,
            });
        }
        if idle == IDLE
            && let Some(settled) = settled
        {
            let chaos = pair.map(|pair| pair.chaos(island_plan, contact_substeps / 2, allowance));
            return Ok(Contacts {
                parting: chaos.transpose()?.flatten().or(settled.parting),
                is_idle: true,
                ..settled
            });
        }
        // If it stays at that, no finer run has shown that contacts are as good as smooth.
        let (_, unproved) = errors(change, last_change, order.min(ORDERS.1));
        known = Some((stated_left.max(unproved), told(true)));
        let found = Contacts {
            contact_substeps: contact_substeps / 2,
            error: Some(stated),
            parting: told(false),
            run,
            is_idle: false,
        };
        if own <= aim && !is_sure {
            unsure = Some(found);
        } else if idle == 0 {
            settled = Some(found);
        }
        run = finer;
    }
}
