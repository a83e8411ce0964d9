//! The result of a trial: an island and its error, kept as a record that a later plan can read.

use crate::assembly::assemble::{Assembled, AssemblyOptions, CutShape};
use crate::assembly::budget::Budget;
use crate::assembly::choice::{BodyChoice, SteppedChoice};
use crate::assembly::constants::SUBSTEPS_MAX;
use crate::assembly::mesh::MethodChoice;
use crate::assembly::truncate::KeptModes;
use crate::body_modes::linear::NoModes;
use crate::island::ContactOrder;
use crate::island::bodies::BodyPlan;
use crate::network::Error;
use crate::plan::constants::OVERSAMPLING_MAX;
use crate::plan::row::MeasuredError;
use crate::plan::trial::allowance::{Allowance, none_if_spent};
use crate::plan::trial::horizon::{self, PlannedRun};
use crate::plan::trial::record::{TrialRecord, TrialStore};

/// Most contact substeps a step that a record may hold.
const RECORDED_SUBSTEPS_MAX: usize = 2 * OVERSAMPLING_MAX as usize * SUBSTEPS_MAX;

/// An error that only a plan without any loss has [dB]: less is rounding.
const NOTHING_LEFT_OUT_DB: f64 = -300.0;

/// An island that meets its budget as far as possible, and its remaining error.
pub(in crate::plan) struct ChosenIsland {
    pub(in crate::plan) island: Assembled,
    pub(in crate::plan) measured_error: Option<MeasuredError>,
    /// Its motion diverged in its trial.
    pub(in crate::plan) has_diverged: bool,
}

impl ChosenIsland {
    /// An assembled island whose error is not known.
    pub(in crate::plan) fn unmeasured(island: Assembled) -> Self {
        Self {
            island,
            measured_error: None,
            has_diverged: false,
        }
    }

    /// A stricter budget, within which the error may stay within `budget` to its end: the error that the pilot measured
    /// `first_error` was within it, and has grown beyond it. A discrete network that is the reference is exact with all
    /// its modes.
    pub(in crate::plan) fn stricter_budget(
        &self,
        first_error: Option<MeasuredError>,
        budget: &Budget,
    ) -> Option<Budget> {
        let (error_now, first_error) = self.measured_error.zip(first_error)?;
        match *budget {
            Budget::Error(error_asked) if self.island.is_discrete_reference() => {
                let has_left_budget = error_now.third_octave_db.is_some() || error_now.waveform_db > error_asked;
                has_left_budget.then_some(Budget::Error(NOTHING_LEFT_OUT_DB))
            }
            Budget::Error(error_asked) => {
                let error_growth = error_now.waveform_db - first_error.waveform_db;
                let has_left_budget = error_now.third_octave_db.is_none()
                    && error_now.waveform_db > error_asked
                    && first_error.waveform_db <= error_asked;
                has_left_budget.then_some(Budget::Error(error_asked - error_growth))
            }
            Budget::Cents {
                cents,
                frequency_hz_max: frequency_max,
            } => {
                let error_growth = error_now.budget_excess(budget) / first_error.budget_excess(budget);
                let has_left_budget = error_now.budget_excess(budget) > 1.0 && first_error.budget_excess(budget) <= 1.0;
                has_left_budget.then_some(Budget::Cents {
                    cents: cents / error_growth,
                    frequency_hz_max: frequency_max,
                })
            }
            Budget::Method(_) => None,
        }
    }
}

/// The island with what an earlier plan decided; `None` if that does not fit it.
pub(in crate::plan) fn with_earlier_choice(island: Assembled, pin: &SteppedChoice) -> Option<ChosenIsland> {
    if pin.bodies.len() != island.bodies.len() {
        return None;
    }
    let body_pairs = pin.bodies.iter().zip(&island.island_plan.bodies);
    let modes_kept = body_pairs.map(|pair| match pair {
        (BodyChoice::Modes(modes), BodyPlan::Modal(modal)) => KeptModes::pinned(modes, modal.modes.len()),
        (BodyChoice::Mesh(_), BodyPlan::Mesh(_)) => Some(KeptModes::empty()),
        (BodyChoice::Slow { macrostep }, BodyPlan::Slow(slow)) => (*macrostep == slow.macrostep).then(KeptModes::empty),
        _ => None,
    });
    let modes_kept = modes_kept.collect::<Option<Vec<_>>>()?;
    let substeps = pin.contact_substeps.clamp(1, SUBSTEPS_MAX);
    let mut island = island.with_modes(substeps, modes_kept);
    (island.island_plan.counted_cost, island.island_plan.contact_order) = (pin.counted_cost, pin.contact_order);
    Some(ChosenIsland::unmeasured(island))
}

/// The island that a pilot chose, whose error may grow after the pilot's end.
pub(in crate::plan) struct PilotResult {
    pub(in crate::plan) chosen: ChosenIsland,
    /// What to play on to see how long the error holds; `None` if it need not be checked.
    pub(in crate::plan) long_comparison: Option<LongComparison>,
}

/// The island at half its step, unless its own is the reference, and with all its modes: with it the chosen one is
/// compared.
pub(in crate::plan) struct LongComparison {
    pub(in crate::plan) finer_island: Assembled,
    /// Contact substeps a step, of both islands.
    pub(in crate::plan) contact_substeps: usize,
}

impl PilotResult {
    /// Checks how long the error holds, and returns the island with that error.
    pub(in crate::plan) fn extend_error(
        self,
        budget: &Budget,
        trial_context: (&Allowance, Option<&dyn TrialStore>),
    ) -> Result<ChosenIsland, Error> {
        let Self {
            mut chosen,
            long_comparison,
        } = self;
        if let (Some(measured), Some(long_comparison)) = (chosen.measured_error, long_comparison) {
            let played_pair =
                [&chosen.island.island_plan, &long_comparison.finer_island.island_plan].map(|island_plan| PlannedRun {
                    island_plan,
                    contact_substeps: long_comparison.contact_substeps,
                });
            chosen.measured_error = none_if_spent(horizon::extend_error(measured, budget, played_pair, trial_context))?;
        }
        chosen.measured_error = chosen
            .measured_error
            .map(|error| error.with_estimate_margin(budget.waveform_error_db()));
        Ok(chosen)
    }

    /// The record that [`PilotResult::from_record`] reads.
    pub(in crate::plan) fn record(&self) -> TrialRecord {
        let Assembled {
            island_plan,
            bodies,
            modes_refusal: no_modes,
            cut_shape: shape,
            is_single_step: is_plain,
            ..
        } = &self.chosen.island;
        let long_comparison = self.long_comparison.as_ref();
        let long_run_substeps = long_comparison.map_or(0, |long_comparison| long_comparison.contact_substeps);
        let mut head_counts = vec![
            island_plan.oversampling,
            island_plan.contact_substeps as u32,
            *shape as u32,
            u32::from(*is_plain),
            long_run_substeps as u32,
            u32::from(self.chosen.has_diverged),
            island_plan.contact_order.number(),
        ];
        head_counts.extend(island_plan.counted_cost);
        let mut numbers = TrialRecord::error_numbers(self.chosen.measured_error);
        numbers.extend(bodies.iter().map(|body| body.left_out_db));
        let body_numbers = bodies.iter().map(|body| body.choice().numbers());
        TrialRecord {
            numbers,
            counts: std::iter::once(head_counts).chain(body_numbers).collect(),
            reason: no_modes.as_ref().map(|no_modes| no_modes.as_str().to_owned()),
        }
    }

    /// What an earlier pilot found; `None` if the record does not fit. `assemble` also takes a choice to repeat.
    pub(in crate::plan) fn from_record(
        record: &TrialRecord,
        assemble: &impl Fn(AssemblyOptions<'_>, Option<&SteppedChoice>) -> Result<Assembled, Error>,
    ) -> Option<Self> {
        let (error, left_out) = record.error()?;
        let (head_counts, body_counts) = record.counts.split_first()?;
        let &[
            oversampling,
            contact_substeps,
            shape,
            is_plain,
            long_run_substeps,
            diverges,
            contact_order,
            ref counted_cost @ ..,
        ] = &head_counts[..]
        else {
            return None;
        };
        let counted_cost = match *counted_cost {
            [] => None,
            [ns] => Some(ns),
            _ => return None,
        };
        let flag_of = |number| match number {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        };
        let (is_plain, diverges) = (flag_of(is_plain)?, flag_of(diverges)?);
        let long_run_substeps = long_run_substeps as usize;
        if !(1..=2 * OVERSAMPLING_MAX).contains(&oversampling) || long_run_substeps > RECORDED_SUBSTEPS_MAX {
            return None;
        }
        let shape = *CutShape::ALL.get(shape as usize)?;
        let stepped_choice = SteppedChoice {
            oversampling,
            contact_substeps: contact_substeps as usize,
            contact_order: ContactOrder::from_number(contact_order)?,
            counted_cost,
            bodies: BodyChoice::all_from_numbers(body_counts)?,
        };
        let options = AssemblyOptions {
            oversampling,
            body_methods: MethodChoice::ByBudget,
            is_single_step: is_plain,
        };
        let island = assemble(options, Some(&stepped_choice)).ok()?;
        let ChosenIsland { mut island, .. } = with_earlier_choice(island, &stepped_choice)?;
        island.cut_shape = shape;
        if left_out.len() != island.bodies.len() {
            return None;
        }
        for (body, left_out) in island.bodies.iter_mut().zip(left_out) {
            body.left_out_db = *left_out;
        }
        island.modes_refusal = match &record.reason {
            Some(reason) => Some(NoModes::from_text(reason)?),
            None => None,
        };
        let long_comparison = if long_run_substeps > 0 {
            let methods = island.mesh_methods();
            Some(LongComparison {
                finer_island: assemble(island.options_for_half_step(&methods), None).ok()?,
                contact_substeps: long_run_substeps,
            })
        } else {
            None
        };
        Some(Self {
            chosen: ChosenIsland {
                island,
                measured_error: error,
                has_diverged: diverges,
            },
            long_comparison,
        })
    }
}

impl From<ChosenIsland> for PilotResult {
    fn from(chosen: ChosenIsland) -> Self {
        Self {
            chosen,
            long_comparison: None,
        }
    }
}
