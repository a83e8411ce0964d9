//! The work that the trials of one plan may take, counted by the table of costs and never by a clock.
//!
//! Two plans of one score draw the same work on any machine, so planning ends at the same trial everywhere.

use std::cell::Cell;

use crate::interrupt;
use crate::network::Error;
use crate::plan::constants::{ALLOWANCE_MAX, ALLOWANCE_MIN, RESERVE_SHARE, SECONDS_PER_MODULE};

/// Why a trial gives no result.
#[derive(Debug)]
pub(in crate::plan) enum TrialError {
    /// The island cannot be played.
    Engine(Error),
    /// The allowance is spent.
    AllowanceSpent,
}

impl From<Error> for TrialError {
    fn from(error: Error) -> Self {
        Self::Engine(error)
    }
}

/// The result of a trial; `None` where the allowance ended first.
pub(in crate::plan) fn none_if_spent<T>(result: Result<T, TrialError>) -> Result<Option<T>, Error> {
    match result {
        Ok(trial_value) => Ok(Some(trial_value)),
        Err(TrialError::AllowanceSpent) => Ok(None),
        Err(TrialError::Engine(error)) => Err(error),
    }
}

/// What a series of trials took: enough to account for it again without playing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::plan) struct SeriesWork {
    /// Work [s].
    pub(in crate::plan) spent_seconds: f64,
    /// What has to be left at the beginning of a series that gives the same results.
    pub(in crate::plan) condition: ReplayCondition,
    /// The series ended because the allowance was spent.
    pub(in crate::plan) ended_early: bool,
    /// How far the longest trial of the series played [frames of the scene].
    pub(in crate::plan) frames_played: u64,
}

/// When a series of trials would go the same way again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::plan) enum ReplayCondition {
    /// So much work is left when it begins, or more [s].
    EnoughLeft(f64),
    /// Just as much is left: a trial was refused or shortened.
    SameLeft(RemainingWork),
}

/// What is left of an allowance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::plan) enum RemainingWork {
    /// So much work [s].
    Seconds(f64),
    /// Nothing: a trial was refused.
    Spent,
}

impl RemainingWork {
    /// Whether it pays for a total of `seconds` of work.
    fn pays_for(self, seconds: f64) -> bool {
        match self {
            Self::Seconds(seconds_left) => seconds <= seconds_left,
            Self::Spent => false,
        }
    }

    /// As a number of a record. (A reserve that is overdrawn by exactly 1 s reads as spent: its trial is played again.)
    pub(in crate::plan) fn to_number(self) -> f64 {
        match self {
            Self::Seconds(seconds_left) => seconds_left,
            Self::Spent => -1.0,
        }
    }

    /// What such a number means.
    pub(in crate::plan) fn from_number(number: f64) -> Self {
        match number {
            -1.0 => Self::Spent,
            seconds_left => Self::Seconds(seconds_left),
        }
    }
}

/// The work that the trials of one plan may take [s], and what they have taken.
#[derive(Debug)]
pub(in crate::plan) struct Allowance {
    total_seconds: f64,
    /// Work drawn before the current series of trials.
    spent_before_seconds: Cell<f64>,
    /// Work drawn by the current series.
    series_spent_seconds: Cell<f64>,
    /// Most work that the current series asked for.
    series_needed_seconds: Cell<f64>,
    /// How far the longest trial of the series plays [frames].
    series_frames: Cell<u64>,
    /// Work taken from the reserve.
    reserve_spent_seconds: Cell<f64>,
    /// Trials that ended because the allowance was spent.
    n_refused_trials: Cell<usize>,
}

/// The work that the trials of a plan of `n_modules` may take [s], if they may take the part `share` of the usual.
pub(in crate::plan) fn allowance_of_plan(n_modules: usize, share: f64) -> f64 {
    share * (SECONDS_PER_MODULE * n_modules as f64).clamp(ALLOWANCE_MIN, ALLOWANCE_MAX)
}

impl Allowance {
    /// An allowance of `total` work [s].
    pub(in crate::plan) fn with_seconds(total: f64) -> Self {
        Self {
            total_seconds: total,
            spent_before_seconds: Cell::new(0.0),
            series_spent_seconds: Cell::new(0.0),
            series_needed_seconds: Cell::new(0.0),
            series_frames: Cell::new(0),
            reserve_spent_seconds: Cell::new(0.0),
            n_refused_trials: Cell::new(0),
        }
    }

    /// What was left when the current series began.
    fn left_for_series(&self) -> RemainingWork {
        match self.n_refused_trials.get() {
            0 => RemainingWork::Seconds(self.total_seconds - self.spent_before_seconds.get()),
            _ => RemainingWork::Spent,
        }
    }

    /// Begins a series of trials and returns how much work is left for it.
    pub(in crate::plan) fn begin_series(&self) -> RemainingWork {
        self.spent_before_seconds
            .set(self.spent_before_seconds.get() + self.series_spent_seconds.take());
        self.series_needed_seconds.set(0.0);
        self.series_frames.set(0);
        self.left_for_series()
    }

    /// What the current series has taken, if so much was left when it began.
    pub(in crate::plan) fn series_work(&self, left: RemainingWork) -> SeriesWork {
        let is_refused = self.n_refused_trials.get() > 0;
        let needed_seconds = self.series_needed_seconds.get();
        SeriesWork {
            spent_seconds: self.series_spent_seconds.get(),
            condition: if is_refused || !left.pays_for(needed_seconds) {
                ReplayCondition::SameLeft(left)
            } else {
                ReplayCondition::EnoughLeft(needed_seconds)
            },
            ended_early: is_refused,
            frames_played: self.series_frames.get(),
        }
    }

    /// Begins a series of trials; returns whether one that was played before would go the same way.
    pub(in crate::plan) fn can_replay(&self, taken: &SeriesWork) -> bool {
        let work_left = self.begin_series();
        match taken.condition {
            ReplayCondition::SameLeft(recorded_left) => recorded_left == work_left,
            ReplayCondition::EnoughLeft(needed_seconds) => work_left.pays_for(needed_seconds),
        }
    }

    /// Accounts for a series of trials that was played before, as if it were played now.
    pub(in crate::plan) fn replay(&self, taken: &SeriesWork) {
        self.begin_series();
        self.series_spent_seconds.set(taken.spent_seconds);
        let n_refused = self.n_refused_trials.get() + usize::from(taken.ended_early);
        self.n_refused_trials.set(n_refused);
    }

    /// Records that a trial plays up to frame `n_frames` of the scene.
    pub(in crate::plan) fn record_frames(&self, n_frames: usize) {
        self.series_frames.set(self.series_frames.get().max(n_frames as u64));
    }

    /// Takes `seconds` of work before it is done.
    ///
    /// # Errors
    ///
    /// [`TrialError::AllowanceSpent`] if less is left. The allowance then counts as spent, even if smaller trials would
    /// still fit.
    pub(in crate::plan) fn spend(&self, seconds: f64) -> Result<(), TrialError> {
        let work_drawn = self.series_spent_seconds.get() + seconds;
        if !self.left_for_series().pays_for(work_drawn) {
            self.n_refused_trials.set(self.n_refused_trials.get() + 1);
            return Err(TrialError::AllowanceSpent);
        }
        self.series_needed_seconds
            .set(self.series_needed_seconds.get().max(work_drawn));
        self.series_spent_seconds.set(work_drawn);
        interrupt::spend((seconds * 1e9) as usize); // a step is a nanosecond
        Ok(())
    }

    /// Takes work [s] that is done even if less is left; trials have that much less.
    pub(in crate::plan) fn spend_unchecked(&self, seconds: f64) {
        let work_drawn = self.series_spent_seconds.get() + seconds;
        self.series_needed_seconds
            .set(self.series_needed_seconds.get().max(work_drawn));
        let work_left = self.total_seconds - self.spent_before_seconds.get();
        self.series_spent_seconds.set(work_drawn.min(work_left).max(0.0));
    }

    /// Checks that `seconds` of work are left, and takes nothing.
    ///
    /// # Errors
    ///
    /// [`TrialError::AllowanceSpent`] if less is left. The allowance then counts as spent.
    pub(in crate::plan) fn check_affordable(&self, seconds: f64) -> Result<(), TrialError> {
        let work_drawn = self.series_spent_seconds.get() + seconds;
        if !self.left_for_series().pays_for(work_drawn) {
            return self.spend(f64::INFINITY);
        }
        self.series_needed_seconds
            .set(self.series_needed_seconds.get().max(work_drawn));
        self.spend(0.0)
    }

    /// The part of `seconds` of work that is left (0 to 1); nothing is taken.
    pub(in crate::plan) fn share_left(&self, seconds: f64) -> f64 {
        let work_drawn = self.series_spent_seconds.get();
        self.series_needed_seconds
            .set(self.series_needed_seconds.get().max(work_drawn + seconds));
        match self.left_for_series() {
            RemainingWork::Seconds(seconds_left) => ((seconds_left - work_drawn) / seconds).clamp(0.0, 1.0),
            RemainingWork::Spent => 0.0,
        }
    }

    /// A separate allowance of the part `share` (0 to 1) of what is left.
    pub(in crate::plan) fn split_off(&self, share: f64) -> Self {
        match self.left_for_series() {
            RemainingWork::Seconds(seconds_left) => {
                Self::with_seconds((share * (seconds_left - self.series_spent_seconds.get())).max(0.0))
            }
            RemainingWork::Spent => Self::with_seconds(0.0),
        }
    }

    /// Takes what was drawn from such a separate part. If the part ran out, that does not end other trials.
    pub(in crate::plan) fn spend_split(&self, part: &Self, share: f64) {
        let work_needed = match part.n_refused_trials() {
            0 => part.series_spent_seconds.get() / share,
            // With a larger part it would have taken more.
            _ => f64::INFINITY,
        };
        self.series_needed_seconds.set(
            self.series_needed_seconds
                .get()
                .max(self.series_spent_seconds.get() + work_needed),
        );
        self.spend_unchecked(part.series_spent_seconds.get());
    }

    /// What is left of the reserve, as a separate allowance: if it runs out, no other trial ends.
    pub(in crate::plan) fn reserve(&self) -> Self {
        Self::with_seconds(RESERVE_SHARE * self.total_seconds - self.reserve_spent_seconds.get())
    }

    /// Takes work [s] from the reserve.
    pub(in crate::plan) fn spend_reserve(&self, seconds: f64) {
        self.reserve_spent_seconds
            .set(self.reserve_spent_seconds.get() + seconds);
    }

    /// Trials that ended because the allowance was spent.
    pub(in crate::plan) fn n_refused_trials(&self) -> usize {
        self.n_refused_trials.get()
    }

    /// Work that the trials have taken [s].
    pub(in crate::plan) fn spent_seconds(&self) -> f64 {
        self.spent_before_seconds.get() + self.series_spent_seconds.get()
    }

    /// Most work that the trials may take [s].
    pub(in crate::plan) fn total_seconds(&self) -> f64 {
        self.total_seconds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn allowance_grows_with_score_length_to_a_bound() {
        let allowances = [0, 100, 1_000, 1_000_000].map(|n_modules| allowance_of_plan(n_modules, 1.0));
        for (seconds, expected) in allowances.into_iter().zip([1.0, 1.0, 2.5, 10.0]) {
            assert!((seconds - expected).abs() < 1e-12, "{seconds} of {expected}");
        }
        assert_eq!(allowance_of_plan(1_000, 0.5), 1.25);
    }

    #[test]
    fn allowance_is_spent_from_the_first_refused_trial() {
        let allowance = Allowance::with_seconds(1.0);
        assert!(allowance.spend(0.75).is_ok());
        assert!(matches!(allowance.spend(0.5), Err(TrialError::AllowanceSpent)));
        assert!(matches!(allowance.spend(0.01), Err(TrialError::AllowanceSpent)));
        assert_eq!((allowance.n_refused_trials(), allowance.spent_seconds()), (2, 0.75));
    }

    #[test]
    fn spend_of_required_work_leaves_less_for_trials() {
        let allowance = Allowance::with_seconds(1.0);
        allowance.spend_unchecked(0.75);
        assert!(matches!(allowance.spend(0.5), Err(TrialError::AllowanceSpent)));
        allowance.spend_unchecked(9.0);
        assert_eq!(allowance.spent_seconds(), 1.0);
    }

    #[test]
    fn replay_of_trials_with_enough_allowance() {
        let first_allowance = Allowance::with_seconds(1.0);
        let work_left = first_allowance.begin_series();
        first_allowance.spend(0.25).unwrap();
        first_allowance.check_affordable(0.5).unwrap();
        let taken = first_allowance.series_work(work_left);
        assert_eq!(
            (taken.spent_seconds, taken.condition),
            (0.25, ReplayCondition::EnoughLeft(0.75))
        );
        // First after trials that leave enough, then after trials that do not.
        for (other_work, is_same) in [(0.25, true), (0.375, false)] {
            let replay_allowance = Allowance::with_seconds(1.0);
            replay_allowance.spend(other_work).unwrap();
            assert_eq!(replay_allowance.can_replay(&taken), is_same);
            replay_allowance.replay(&taken);
            assert_eq!(replay_allowance.spent_seconds(), other_work + 0.25);
        }
    }

    #[test]
    fn replay_of_refused_trials_with_equal_allowance() {
        let first_allowance = Allowance::with_seconds(1.0);
        let work_left = first_allowance.begin_series();
        first_allowance.spend(0.75).unwrap();
        assert!(first_allowance.spend(0.5).is_err());
        let taken = first_allowance.series_work(work_left);
        assert!(taken.ended_early);
        assert_eq!(taken.condition, ReplayCondition::SameLeft(RemainingWork::Seconds(1.0)));
        let replay_allowance = Allowance::with_seconds(1.0);
        assert!(replay_allowance.can_replay(&taken));
        replay_allowance.replay(&taken);
        assert!(replay_allowance.n_refused_trials() > 0 && replay_allowance.spend(0.01).is_err());
        let later_allowance = Allowance::with_seconds(1.0);
        later_allowance.spend(0.01).unwrap();
        assert!(!later_allowance.can_replay(&taken));
        // If nothing is left, nothing is played: how much was left before does not matter.
        let work_left = replay_allowance.begin_series();
        assert!(replay_allowance.spend(0.01).is_err());
        let nothing_taken = replay_allowance.series_work(work_left);
        let half_allowance = Allowance::with_seconds(0.5);
        assert!(half_allowance.spend(2.0).is_err());
        assert!(half_allowance.can_replay(&nothing_taken));
    }
}
