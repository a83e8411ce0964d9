//! Network + Timeline + Budget → Plan: what is computed and how, and why the rest is not computed.
//!
//! Islands do not interact, so each is computed on its own, by the cheapest method that is exact enough for it. A plan
//! is a function of its arguments alone, never of a timing.

mod constants;
mod hash;
mod make;
mod row;
mod trial;

pub use crate::assembly::audible::ModeKind;
pub use crate::assembly::budget::{Budget, Method};
pub use crate::assembly::choice::{Choice, ChoiceNumbers};
pub use crate::assembly::constants::{INAUDIBLE_ERROR_DB, PITCH_HERTZ_MAX};
pub use constants::SPECTRUM_NOISE_DB;
pub use row::{Computation, LeftOutReason, MeasuredError, PlanRow};
pub use trial::record::{TrialRecord, TrialStore};

use std::ops::Range;
use std::sync::Arc;

use crate::assembly::unit::{ComputationUnit, IslandPlan, NetworkIndices};
use crate::island::ContactOrder;
use crate::network::{Error, Network};
use crate::scheme::{RefusalDetail, Scheme};
use crate::timeline::Timeline;

/// Fewest banks of one part in a group.
const GROUP_BANKS_MIN: usize = 2;
/// Most groups for the banks of one part: each group holds frames of all outputs.
const PART_GROUPS_MAX: usize = 16;

/// How islands are planned that are not worth the trials of an exact plan.
#[derive(Clone, Copy)]
pub struct Draft<'a> {
    /// The error that they may have.
    pub budget: &'a Budget,
    /// The part of the allowance of work that their trials may take (0 to 1).
    pub allowance_share: f64,
}

/// What is known before a plan is made.
#[derive(Clone, Copy)]
pub struct PlanContext<'a> {
    /// A plan of another version: what it computed about bodies is reused.
    pub earlier_plan: Option<&'a Plan>,
    /// Results of trials of earlier plans; new ones are kept there too.
    pub trial_store: Option<&'a dyn TrialStore>,
    /// The part of the allowance of work that trials may take (0 to 1).
    pub allowance_share: f64,
    /// Islands go by what an earlier plan within the budget decided; the others are drafted.
    pub draft: Option<Draft<'a>>,
    /// Parts that are displayed: those that no output hears are computed too, without changing any sample of what is
    /// heard.
    pub displayed_parts: &'a [String],
    /// What is only seen may be computed once in this many frames.
    pub displayed_frame_interval: u32,
}

impl Default for PlanContext<'_> {
    fn default() -> Self {
        Self {
            earlier_plan: None,
            trial_store: None,
            allowance_share: 1.0,
            draft: None,
            displayed_parts: &[],
            displayed_frame_interval: 1,
        }
    }
}

/// What is computed and how, and why the rest is not computed.
///
/// ```
/// # use std::sync::Arc;
/// # use ergon_engine::network::{Term, Tie};
/// # use ergon_engine::{Network, Rate, Timeline};
/// # let mut network = Network::new();
/// # let bell = network.cel("bell", 0.002, Tie::Tuned { f: 440.0, t60: Some(1.0) }, 0.0, 0.0, 0.0)?;
/// # network.listen("bell", vec![Term::Position { first: bell, len: 1, weight: 1.0 }])?;
/// # let mut timeline = Timeline::new(Rate::new(44_100.0)?);
/// # timeline.strike(&network, bell, 0.0, 1e-3, None, 0)?;
/// # let network = Arc::new(network);
/// use ergon_engine::{Budget, Plan};
///
/// let plan = Plan::new(network, &timeline, &Budget::Error(-60.0), None)?;
/// assert_eq!(plan.rows().len(), 1); // one bell, which runs exactly
/// assert_eq!(plan.hash().len(), 64);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Plan {
    pub(crate) network: Arc<Network>,
    pub(crate) timeline_rate: crate::units::Rate,
    pub(crate) n_keys: usize,
    pub(crate) n_gestures: usize,
    /// How samples of inputs are processed before they act   (n_sounds_in)
    pub(crate) sounds_in: Vec<crate::timeline::SoundInSettings>,
    /// Units that are heard, then those that are only seen.
    pub(crate) units: Vec<ComputationUnit>,
    pub(crate) n_heard_units: usize,
    /// MATs that never move, rising.
    pub(crate) motionless_mats: Vec<u32>,
    /// The constant part of each output: from modules that never move, and from the rest positions of others   (n_out)
    pub(crate) output_offsets: Vec<f64>,
    rows: Vec<PlanRow>,
    /// Rows of what is only seen.
    displayed_rows: Vec<PlanRow>,
    choices: Vec<Choice>,
    /// Parts that ask for a rate of their own but are computed at every frame, and why.
    refused_rates: Vec<(String, String)>,
    /// What trials decided for islands of a session, for the next plan.
    session_trials: Vec<make::SessionTrial>,
    /// What was computed about its bodies, for the next plan.
    solved_modes: crate::assembly::solved_modes::SolvedModes,
    /// Work that its trials took, and their allowance [s].
    trial_seconds: f64,
    trial_seconds_max: f64,
}

impl Plan {
    /// Everything stepped as written, by the CA scheme.
    ///
    /// `is_unchecked`: no check for stability is made.
    pub fn plain(network: Arc<Network>, timeline: &Timeline, is_unchecked: bool) -> Result<Self, Error> {
        let mut plain_plan = Self::empty(network.clone(), timeline);
        let island_plan = plain_plan.stepped_island_plan(timeline, 1);
        if !is_unchecked {
            let mut scheme = Scheme::new(&network, timeline.rate)?;
            if timeline.is_unguarded {
                scheme.drop_softening_laws();
            }
            let certificate = scheme.certify(&network)?;
            plain_plan.rows.push(PlanRow::stepped(&island_plan, certificate));
        }
        plain_plan
            .units
            .push(ComputationUnit::IslandPlan(Box::new(island_plan)));
        plain_plan.n_heard_units = plain_plan.units.len();
        Ok(plain_plan)
    }

    /// Everything stepped as written, with contacts computed between frames: for networks whose contacts are too stiff
    /// for [`Plan::plain`].
    ///
    /// # Errors
    ///
    /// Those of a network that is unstable without its contacts.
    pub fn with_fine_contacts(network: Arc<Network>, timeline: &Timeline) -> Result<Self, Error> {
        let (budget, steps_max) = (Budget::default(), crate::assembly::constants::SUBSTEPS_MAX);
        let (contact_substeps, _, certificate) =
            crate::assembly::assemble::certified_hub(&network, timeline, &budget, steps_max, RefusalDetail::Full)?;
        let mut fine_plan = Self::empty(network, timeline);
        let island_plan = fine_plan.stepped_island_plan(timeline, contact_substeps);
        fine_plan.rows.push(PlanRow::stepped(&island_plan, certificate));
        fine_plan.units.push(ComputationUnit::IslandPlan(Box::new(island_plan)));
        fine_plan.n_heard_units = fine_plan.units.len();
        Ok(fine_plan)
    }

    /// All of the network as one island, module by module.
    fn stepped_island_plan(&self, timeline: &Timeline, contact_substeps: usize) -> IslandPlan {
        IslandPlan {
            network: self.network.clone(),
            timeline: timeline.clone(),
            bodies: Vec::new(),
            contact_substeps,
            contact_order: ContactOrder::Fourth,
            counted_cost: None,
            oversampling: 1,
            frame_interval: 1,
            stops_when_silent: false,
            network_indices: NetworkIndices::default(),
        }
    }

    /// Whether a simulation of this plan records every ergon of a timeline: none strikes inside a body or a bank, or
    /// something that the plan leaves out.
    pub fn records_every_ergon(&self, timeline: &Timeline) -> bool {
        let event_counts =
            |timeline: &Timeline| [timeline.gestures.len(), timeline.strikes.len(), timeline.ergons.len()];
        let mut recorded_counts = [0; 3];
        for unit in &self.units {
            if let ComputationUnit::IslandPlan(island_plan) = unit {
                let event_counts = event_counts(&island_plan.timeline);
                recorded_counts
                    .iter_mut()
                    .zip(event_counts)
                    .for_each(|(recorded_count, event_counts)| *recorded_count += event_counts);
            }
        }
        recorded_counts == event_counts(timeline)
    }

    /// Plans what is both heard and moved, each island by the cheapest method within the budget, or as decided before
    /// by `pins`.
    ///
    /// # Errors
    ///
    /// Those of a network that no method can compute, and of `pins` of another plan.
    pub fn new(
        network: Arc<Network>,
        timeline: &Timeline,
        budget: &Budget,
        pins: Option<Vec<Choice>>,
    ) -> Result<Self, Error> {
        make::make_plan(network, timeline, budget, pins, PlanContext::default())
    }

    /// Makes the same plan as [`Plan::new`], sooner if the `context` has results of earlier plans.
    ///
    /// # Errors
    ///
    /// Those of [`Plan::new`].
    pub fn in_context(
        network: Arc<Network>,
        timeline: &Timeline,
        budget: &Budget,
        pins: Option<Vec<Choice>>,
        context: PlanContext<'_>,
    ) -> Result<Self, Error> {
        make::make_plan(network, timeline, budget, pins, context)
    }

    /// Groups of units: first those that are heard, in at most `n_groups` groups of about equal cost, with further
    /// groups for the banks of large parts; then those that are only seen. What is only seen does not change the groups
    /// of what is heard, as sums are rounded group by group.
    pub(crate) fn groups(&self, n_groups: usize) -> Vec<Range<usize>> {
        let mut unit_groups = self.groups_of_range(0..self.n_heard_units, n_groups);
        unit_groups.extend(self.groups_of_range(self.n_heard_units..self.units.len(), n_groups));
        unit_groups
    }

    fn groups_of_range(&self, units: Range<usize>, n_groups: usize) -> Vec<Range<usize>> {
        let unit_costs: Vec<f64> = self.units[units.clone()].iter().map(ComputationUnit::cost).collect();
        let mean_cost = unit_costs.iter().sum::<f64>() / n_groups as f64;
        let (mut unit_groups, mut first_unit, mut group_cost) = (Vec::new(), units.start, 0.0);
        for (unit, cost) in units.clone().zip(&unit_costs) {
            group_cost += cost;
            let is_group_full = self
                .ends_group(unit, &units)
                .unwrap_or(group_cost >= mean_cost && unit_groups.len() + 1 < n_groups);
            if is_group_full {
                unit_groups.push(first_unit..unit + 1);
                (first_unit, group_cost) = (unit + 1, 0.0);
            }
        }
        if first_unit < units.end {
            unit_groups.push(first_unit..units.end);
        }
        unit_groups
    }

    /// Whether a group ends after the bank at index `unit`, if the next unit is a bank of the same part; `None`
    /// otherwise. The answer depends on that part alone, since every output sums its banks.
    fn ends_group(&self, unit: usize, units: &Range<usize>) -> Option<bool> {
        let bank_part = |unit: usize| match &self.units[unit] {
            ComputationUnit::Bank(bank) => bank.part,
            ComputationUnit::IslandPlan(_) => None,
        };
        let part_here = bank_part(unit)?;
        let is_same_part = |other: &usize| bank_part(*other) == Some(part_here);
        let banks_before = (units.start..unit).rev().take_while(is_same_part).count();
        let banks_after = (unit + 1..units.end).take_while(is_same_part).count();
        let banks_per_group = (banks_before + 1 + banks_after)
            .div_ceil(PART_GROUPS_MAX)
            .max(GROUP_BANKS_MIN);
        (banks_after > 0).then(|| (banks_before + 1).is_multiple_of(banks_per_group))
    }

    fn empty(network: Arc<Network>, timeline: &Timeline) -> Self {
        Self {
            timeline_rate: timeline.rate,
            n_keys: timeline.keys.len(),
            n_gestures: timeline.gestures.len(),
            sounds_in: timeline.sound_settings().collect(),
            output_offsets: vec![0.0; network.outputs().len()],
            rows: Vec::new(),
            displayed_rows: Vec::new(),
            n_heard_units: 0,
            motionless_mats: Vec::new(),
            choices: Vec::new(),
            refused_rates: Vec::new(),
            session_trials: Vec::new(),
            solved_modes: Default::default(),
            trial_seconds: 0.0,
            trial_seconds_max: 0.0,
            network,
            units: Vec::new(),
        }
    }

    /// How each part is computed.
    pub fn rows(&self) -> &[PlanRow] {
        &self.rows
    }

    /// How what is only seen is computed; [`Plan::rows`] and [`Plan::hash`] do not include it.
    pub fn displayed_rows(&self) -> &[PlanRow] {
        &self.displayed_rows
    }

    /// Parts that ask for a rate of their own but are computed at every frame, and why.
    pub fn refused_rates(&self) -> &[(String, String)] {
        &self.refused_rates
    }

    /// Work that its trials took, and their allowance, by the table of costs [s].
    pub fn trial_seconds(&self) -> (f64, f64) {
        (self.trial_seconds, self.trial_seconds_max)
    }

    /// What was decided for each island: enough to decide the same again.
    ///
    /// ```
    /// # use std::sync::Arc;
    /// # use ergon_engine::network::{Term, Tie};
    /// # use ergon_engine::{Network, Rate, Timeline};
    /// # let mut network = Network::new();
    /// # let bell = network.cel("bell", 0.002, Tie::Tuned { f: 440.0, t60: Some(1.0) }, 0.0, 0.0, 0.0)?;
    /// # network.listen("bell", vec![Term::Position { first: bell, len: 1, weight: 1.0 }])?;
    /// # let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// # timeline.strike(&network, bell, 0.0, 1e-3, None, 0)?;
    /// # let network = Arc::new(network);
    /// use ergon_engine::{Budget, Plan};
    ///
    /// let budget = Budget::Error(-60.0);
    /// let plan = Plan::new(network.clone(), &timeline, &budget, None)?;
    /// let again = Plan::new(network, &timeline, &budget, Some(plan.choices().to_vec()))?;
    /// assert_eq!(plan.hash(), again.hash());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn choices(&self) -> &[Choice] {
        &self.choices
    }

    /// A hash of what was decided: two plans of one score with the same hash give the same sound.
    pub fn hash(&self) -> String {
        hash::hash(&self.choices, &self.rows)
    }
}
