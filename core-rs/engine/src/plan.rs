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
pub use constants::SPECTRUM_NOISE;
pub use row::{Computed, Measured, Reason, Row};
pub use trial::record::{TrialRecord, TrialStore};

use std::ops::Range;
use std::sync::Arc;

use crate::assembly::unit::{IslandPlan, NetworkIndices, Unit};
use crate::island::ContactOrder;
use crate::network::{Error, Network};
use crate::scheme::{Refusal, Scheme};
use crate::timeline::Timeline;

/// Fewest banks of one part in a group.
const PIECE: usize = 2;
/// Most groups for the banks of one part: each group holds frames of all outputs.
const PIECES_MAX: usize = 16;

/// How islands are planned that are not worth the trials of an exact plan.
#[derive(Clone, Copy)]
pub struct Draft<'a> {
    /// The error that they may have.
    pub budget: &'a Budget,
    /// The part of the allowance of work that their trials may take (0 to 1).
    pub share: f64,
}

/// What is known before a plan is made.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// A plan of another version: what it computed about bodies is reused.
    pub like: Option<&'a Plan>,
    /// Results of trials of earlier plans; new ones are kept there too.
    pub store: Option<&'a dyn TrialStore>,
    /// The part of the allowance of work that trials may take (0 to 1).
    pub share: f64,
    /// Islands go by what an earlier plan within the budget decided; the others are drafted.
    pub draft: Option<Draft<'a>>,
    /// Parts that are displayed: those that no output hears are computed too, without changing any sample of what is
    /// heard.
    pub seen: &'a [String],
    /// What is only seen may be computed once in this many frames.
    pub seen_every: u32,
}

impl Default for Known<'_> {
    fn default() -> Self {
        Self {
            like: None,
            store: None,
            share: 1.0,
            draft: None,
            seen: &[],
            seen_every: 1,
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
    pub(crate) units: Vec<Unit>,
    pub(crate) n_heard: usize,
    /// MATs that never move, rising.
    pub(crate) unmoved: Vec<u32>,
    /// The constant part of each output: from modules that never move, and from the rest positions of others   (n_out)
    pub(crate) still: Vec<f64>,
    rows: Vec<Row>,
    /// Rows of what is only seen.
    seen: Vec<Row>,
    choices: Vec<Choice>,
    /// Parts that ask for a rate of their own but are computed at every frame, and why.
    stay: Vec<(String, String)>,
    /// What was computed about its bodies, for the next plan.
    solved: Vec<Arc<crate::assembly::solved_modes::SolvedBody>>,
    /// Work that its trials took, and their allowance [s].
    trials_cost: f64,
    trials_most: f64,
}

impl Plan {
    /// Everything stepped as written, by the CA scheme.
    ///
    /// `unchecked`: no check for stability is made.
    pub fn plain(network: Arc<Network>, timeline: &Timeline, unchecked: bool) -> Result<Self, Error> {
        let mut plain_plan = Self::empty(network.clone(), timeline);
        let island_plan = plain_plan.stepped(timeline, 1);
        if !unchecked {
            let mut scheme = Scheme::new(&network, timeline.rate)?;
            if timeline.is_unguarded {
                scheme.let_laws_give_way();
            }
            let certificate = scheme.certify(&network)?;
            plain_plan.rows.push(Row::stepped(&island_plan, certificate));
        }
        plain_plan.units.push(Unit::IslandPlan(Box::new(island_plan)));
        plain_plan.n_heard = plain_plan.units.len();
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
            crate::assembly::assemble::hub(&network, timeline, &budget, steps_max, Refusal::Explained)?;
        let mut fine_plan = Self::empty(network, timeline);
        let island_plan = fine_plan.stepped(timeline, contact_substeps);
        fine_plan.rows.push(Row::stepped(&island_plan, certificate));
        fine_plan.units.push(Unit::IslandPlan(Box::new(island_plan)));
        fine_plan.n_heard = fine_plan.units.len();
        Ok(fine_plan)
    }

    /// All of the network as one island, module by module.
    fn stepped(&self, timeline: &Timeline, contact_substeps: usize) -> IslandPlan {
        IslandPlan {
            network: self.network.clone(),
            timeline: timeline.clone(),
            bodies: Vec::new(),
            contact_substeps,
            contact_order: ContactOrder::Fourth,
            counted_cost: None,
            oversampling: 1,
            every: 1,
            sleeps: false,
            to_whole: NetworkIndices::default(),
        }
    }

    /// Whether a simulation of this plan records every ergon of a timeline: none strikes inside a body or a bank, or
    /// something that the plan leaves out.
    pub fn records(&self, timeline: &Timeline) -> bool {
        let counted_events =
            |timeline: &Timeline| [timeline.gestures.len(), timeline.strikes.len(), timeline.ergons.len()];
        let mut recorded = [0; 3];
        for unit in &self.units {
            if let Unit::IslandPlan(island_plan) = unit {
                let event_counts = counted_events(&island_plan.timeline);
                recorded
                    .iter_mut()
                    .zip(event_counts)
                    .for_each(|(all, event_counts)| *all += event_counts);
            }
        }
        recorded == counted_events(timeline)
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
        make::make(network, timeline, budget, pins, Known::default())
    }

    /// Makes the same plan as [`Plan::new`], sooner if something is `known`.
    ///
    /// # Errors
    ///
    /// Those of [`Plan::new`].
    pub fn with(
        network: Arc<Network>,
        timeline: &Timeline,
        budget: &Budget,
        pins: Option<Vec<Choice>>,
        known: Known<'_>,
    ) -> Result<Self, Error> {
        make::make(network, timeline, budget, pins, known)
    }

    /// Groups of units: first those that are heard, in at most `n_groups` groups of about equal cost, with further
    /// groups for the banks of large parts; then those that are only seen. What is only seen does not change the groups
    /// of what is heard, as sums are rounded group by group.
    pub(crate) fn groups(&self, n_groups: usize) -> Vec<Range<usize>> {
        let mut unit_groups = self.grouped(0..self.n_heard, n_groups);
        unit_groups.extend(self.grouped(self.n_heard..self.units.len(), n_groups));
        unit_groups
    }

    fn grouped(&self, units: Range<usize>, n_groups: usize) -> Vec<Range<usize>> {
        let unit_costs: Vec<f64> = self.units[units.clone()].iter().map(Unit::cost).collect();
        let fair_cost = unit_costs.iter().sum::<f64>() / n_groups as f64;
        let (mut unit_groups, mut first_unit, mut group_cost) = (Vec::new(), units.start, 0.0);
        for (unit, cost) in units.clone().zip(&unit_costs) {
            group_cost += cost;
            let group_is_full = self
                .ends_piece(unit, &units)
                .unwrap_or(group_cost >= fair_cost && unit_groups.len() + 1 < n_groups);
            if group_is_full {
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
    fn ends_piece(&self, unit: usize, units: &Range<usize>) -> Option<bool> {
        let bank_part = |unit: usize| match &self.units[unit] {
            Unit::Bank(bank) => bank.part,
            Unit::IslandPlan(_) => None,
        };
        let part_here = bank_part(unit)?;
        let is_same_part = |other: &usize| bank_part(*other) == Some(part_here);
        let banks_before = (units.start..unit).rev().take_while(is_same_part).count();
        let banks_after = (unit + 1..units.end).take_while(is_same_part).count();
        let piece_length = (banks_before + 1 + banks_after).div_ceil(PIECES_MAX).max(PIECE);
        (banks_after > 0).then(|| (banks_before + 1).is_multiple_of(piece_length))
    }

    fn empty(network: Arc<Network>, timeline: &Timeline) -> Self {
        Self {
            timeline_rate: timeline.rate,
            n_keys: timeline.keys.len(),
            n_gestures: timeline.gestures.len(),
            sounds_in: timeline.sound_settings().collect(),
            still: vec![0.0; network.outputs().len()],
            rows: Vec::new(),
            seen: Vec::new(),
            n_heard: 0,
            unmoved: Vec::new(),
            choices: Vec::new(),
            stay: Vec::new(),
            solved: Vec::new(),
            trials_cost: 0.0,
            trials_most: 0.0,
            network,
            units: Vec::new(),
        }
    }

    /// How each part is computed.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// How what is only seen is computed; [`Plan::rows`] and [`Plan::hash`] do not include it.
    pub fn seen(&self) -> &[Row] {
        &self.seen
    }

    /// Parts that ask for a rate of their own but are computed at every frame, and why.
    pub fn stay(&self) -> &[(String, String)] {
        &self.stay
    }

    /// Work that its trials took, and their allowance, by the table of costs [s].
    pub fn trials(&self) -> (f64, f64) {
        (self.trials_cost, self.trials_most)
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
