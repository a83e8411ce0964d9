//! The result of a trial: an island and its error, kept as a record that a later plan can read.

use crate::island::inside::BodyPlan;
use crate::network::Error;
use crate::plan::budget::Budget;
use crate::plan::choice::Choice;
use crate::plan::passes::assemble::{Assembled, Shape};
use crate::plan::passes::linear::NoModes;
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::passes::ported::PortedBody;
use crate::plan::passes::truncate::KeptModes;
use crate::plan::report::row::Measured;
use crate::plan::trial::allowance::{Allowance, unless_spent};
use crate::plan::trial::horizon;
use crate::plan::trial::record::{TrialRecord, TrialStore};
use crate::plan::trial::search::TIMES_MAX;

/// Most contact substeps a step that a record may hold.
const SUBSTEPS_MAX: usize = 2 * TIMES_MAX as usize * Budget::STEPS_MAX;

/// An island that meets its budget as far as possible, and its remaining error.
pub(in crate::plan) struct Piloted {
    pub(in crate::plan) island: Assembled,
    pub(in crate::plan) error: Option<Measured>,
}

impl Piloted {
    /// An assembled island whose error is not known.
    pub(in crate::plan) fn untried(island: Assembled) -> Self {
        Self {
            island,
            error: None,
        }
    }
}

/// The island with what an earlier plan decided; `None` if that does not fit it.
pub(in crate::plan) fn pinned(island: Assembled, pin: &Choice) -> Option<Piloted> {
    if pin.kept.len() != island.bodies.len() {
        return None;
    }
    let pairs = pin.kept.iter().zip(&island.island_plan.bodies);
    let kept = pairs.map(|(kept, body)| match body {
        BodyPlan::Modal(modal) => KeptModes::pinned(kept, modal.modes.len()),
        BodyPlan::Mesh(_) => Some(KeptModes::none()),
        BodyPlan::Slow(slow) => (kept[..] == [slow.macrostep]).then(KeptModes::none),
    });
    let kept = kept.collect::<Option<Vec<_>>>()?;
    let substeps = pin.contact_substeps.clamp(1, Budget::STEPS_MAX);
    Some(Piloted::untried(island.only(substeps, kept)))
}

/// The island that a pilot chose, whose error may grow after the pilot's end.
pub(in crate::plan) struct Tried {
    pub(in crate::plan) piloted: Piloted,
    /// What to play on to see how long the error holds; `None` if it need not be checked.
    pub(in crate::plan) beyond: Option<Beyond>,
}

/// The island with all its modes and the same at half its step, to be played and compared.
pub(in crate::plan) struct Beyond {
    pub(in crate::plan) own: Assembled,
    pub(in crate::plan) finer: Assembled,
    /// Contact substeps a step of each.
    pub(in crate::plan) contact_substeps: [usize; 2],
}

impl Tried {
    /// Checks how long the error holds, and returns the island with that error.
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
        piloted.error = piloted.error.map(|error| error.doubted(budget.asked()));
        Ok(piloted)
    }

    /// The record that [`Tried::recalled`] reads.
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

    /// What an earlier pilot found; `None` if the record does not fit. `assemble` also takes a choice to repeat.
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
