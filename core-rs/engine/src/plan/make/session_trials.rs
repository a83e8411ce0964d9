//! Islands of a session. What will strike them is not known, so no mode is left out; how finely contacts are computed
//! is decided by a trial of their hardest strikes.

use super::PlanBuilder;
use crate::assembly::assemble::{Assembled, AssemblyOptions, Stepping};
use crate::assembly::budget::Budget;
use crate::assembly::split::LocalTimeline;
use crate::content::island::IslandContent;
use crate::network::{Error, Subset};
use crate::plan::row::MeasuredError;
use crate::plan::trial::allowance::{Allowance, allowance_of_plan};
use crate::plan::trial::candidates::CostRule;
use crate::plan::trial::pilot;
use crate::plan::trial::pilot_result::ChosenIsland;

/// What the trial of an island decided, for the next plan of the session; `None` if no way was within the budget.
#[derive(Clone, Debug)]
pub(in crate::plan) struct SessionTrial {
    content_hash: String,
    stepping: Option<Stepping>,
}

/// Most trials that a plan hands on: those of all instruments that a session has tried, and a bound.
const TRIALS_MAX: usize = 1_024;

impl PlanBuilder<'_> {
    /// The trials of this plan, then those of earlier ones that it did not need: a line may wait while others are
    /// planned.
    pub(super) fn take_session_trials(&self) -> Vec<SessionTrial> {
        let mut trials = self.session_trials.take();
        for earlier_trial in self.earlier_trials {
            if trials.len() < TRIALS_MAX
                && !trials
                    .iter()
                    .any(|trial| trial.content_hash == earlier_trial.content_hash)
            {
                trials.push(earlier_trial.clone());
            }
        }
        trials
    }

    /// Gives an island of a session an allowance of its own, so that it is decided the same beside any other island.
    pub(super) fn begin_session_allowance(&mut self, n_modules: usize) {
        self.allowance = Allowance::with_seconds(allowance_of_plan(n_modules, self.allowance_share));
    }

    /// Decides an island of a session.
    pub(super) fn choose_for_session(
        &self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        assemble: &impl Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>,
    ) -> Result<ChosenIsland, Error> {
        let tried_island = self
            .session_stepping(subset, island_timeline)
            .and_then(|stepping| Some(assemble(stepping.options()).ok()?.with_stepping(&stepping)));
        let island = match tried_island {
            Some(island) => island,
            None => pilot::lowest_stable(assemble)?,
        };
        Ok(ChosenIsland::unmeasured(island))
    }

    /// What a trial of the hardest strikes decides, or decided for an earlier plan. Once the trials of a plan have
    /// taken all that they may, the next plan goes on with them.
    fn session_stepping(&self, subset: &Subset, island_timeline: &LocalTimeline) -> Option<Stepping> {
        let trial_timeline = LocalTimeline {
            timeline: island_timeline.timeline.closed_for_trial()?,
            keys: Vec::new(),
            gestures: Vec::new(),
        };
        let content_label = format_args!("session {:?}", self.budget);
        let content_hash = IslandContent::new(&subset.network, &trial_timeline.timeline, content_label).hash_until(0);
        let earlier_trial = self
            .earlier_trials
            .iter()
            .find(|trial| trial.content_hash == content_hash);
        let trial = match earlier_trial {
            Some(earlier_trial) => earlier_trial.clone(),
            None if self.session_trial_seconds.get() >= self.trial_seconds_max => return None,
            None => SessionTrial {
                stepping: self.stepping_from_trial(subset, &trial_timeline),
                content_hash,
            },
        };
        let stepping = trial.stepping.clone();
        self.session_trials.borrow_mut().push(trial);
        stepping
    }

    /// The cheapest way that is within the budget when the strikes of a closed timeline are played.
    fn stepping_from_trial(&self, subset: &Subset, trial_timeline: &LocalTimeline) -> Option<Stepping> {
        let assemble = |options: AssemblyOptions<'_>| self.assemble_island(subset, trial_timeline, options, None);
        let spent_before = self.allowance.spent_seconds();
        let pilot_result = self.find_pilot_result((subset, trial_timeline), self.budget, CostRule::Busiest, &assemble);
        let trial_seconds = self.allowance.spent_seconds() - spent_before;
        self.session_trial_seconds
            .set(self.session_trial_seconds.get() + trial_seconds);
        let chosen = pilot_result.ok()?.chosen;
        // Of a chaotic motion the trial knows spectra alone, and those of softer strikes may be others: a way that the
        // hardest strike of the bundled tamtam allows makes a soft one 12 dB too loud.
        let is_by_ear = matches!(self.budget, Budget::Cents { .. });
        let is_error_acceptable =
            |error: MeasuredError| (error.audible.is_some() || !is_by_ear) && error.is_regular_within(self.budget);
        let is_accepted = !chosen.has_diverged && chosen.measured_error.is_some_and(is_error_acceptable);
        is_accepted.then(|| chosen.island.stepping())
    }
}
