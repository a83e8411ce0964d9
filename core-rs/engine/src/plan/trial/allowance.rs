//! The work that the trials of one plan may take, counted by the table of costs and never by a clock.
//!
//! Two plans of one score draw the same work on any machine, so planning ends at the same trial everywhere.

use std::cell::Cell;

use crate::network::Error;

/// What a plan of at most so many modules may draw, and one of so many [s]; in between in proportion, above by
/// the module, up to `MOST`.
const SMALL: (usize, f64) = (100, 1.0);
const LARGE: (usize, f64) = (1_000, 2.5);
const MOST: f64 = 10.0;
/// So large a part more lies aside, to see how long errors hold.
const ASIDE: f64 = 0.25;

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
pub(in crate::plan) fn unless_spent<T>(result: Result<T, TrialError>) -> Result<Option<T>, Error> {
    match result {
        Ok(found) => Ok(Some(found)),
        Err(TrialError::AllowanceSpent) => Ok(None),
        Err(TrialError::Engine(error)) => Err(error),
    }
}

/// The work that the trials of one plan may take [s], and what they have taken.
#[derive(Debug)]
pub(in crate::plan) struct Allowance {
    total: f64,
    drawn: Cell<f64>,
    /// Work taken from what lies aside, beyond the total.
    drawn_aside: Cell<f64>,
    /// Trials that ended because the allowance was spent.
    n_refused: Cell<usize>,
}

impl Allowance {
    /// For a plan of so many modules that may take `share` of what there is for them.
    pub(in crate::plan) fn new(n_modules: usize, share: f64) -> Self {
        let ((few, least), (many, most)) = (SMALL, LARGE);
        let seconds = if n_modules <= many {
            let part = n_modules.saturating_sub(few) as f64 / (many - few) as f64;
            least + (most - least) * part
        } else {
            (most * n_modules as f64 / many as f64).min(MOST)
        };
        Self {
            total: share * seconds,
            drawn: Cell::new(0.0),
            drawn_aside: Cell::new(0.0),
            n_refused: Cell::new(0),
        }
    }

    /// Take so much work [s] before it is done.
    ///
    /// # Errors
    ///
    /// [`TrialError::AllowanceSpent`] where less is left: then all of it is spent, whatever smaller trials would still fit.
    pub(in crate::plan) fn draw(&self, seconds: f64) -> Result<(), TrialError> {
        let drawn = self.drawn.get() + seconds;
        if self.n_refused.get() > 0 || drawn > self.total {
            self.n_refused.set(self.n_refused.get() + 1);
            return Err(TrialError::AllowanceSpent);
        }
        self.drawn.set(drawn);
        Ok(())
    }

    /// Take work [s] that is done whatever is left: what remains for trials is less by it.
    pub(in crate::plan) fn spend(&self, seconds: f64) {
        self.drawn.set((self.drawn.get() + seconds).min(self.total));
    }

    /// Look whether so much work [s] is left, and take none of it.
    ///
    /// # Errors
    ///
    /// [`TrialError::AllowanceSpent`] where less is left.
    pub(in crate::plan) fn affords(&self, seconds: f64) -> Result<(), TrialError> {
        if self.drawn.get() + seconds > self.total {
            return self.draw(f64::INFINITY);
        }
        self.draw(0.0)
    }

    /// What is left of a part of it that lies aside, to be drawn from by itself: no trial ends because of it.
    pub(in crate::plan) fn aside(&self) -> Self {
        Self {
            total: ASIDE * self.total - self.drawn_aside.get(),
            drawn: Cell::new(0.0),
            drawn_aside: Cell::new(0.0),
            n_refused: Cell::new(0),
        }
    }

    /// Take work [s] from what lies aside.
    pub(in crate::plan) fn spend_aside(&self, seconds: f64) {
        self.drawn_aside.set(self.drawn_aside.get() + seconds);
    }

    /// Trials that ended because the allowance was spent.
    pub(in crate::plan) fn n_refused(&self) -> usize {
        self.n_refused.get()
    }

    /// Work that the trials have taken, and the most that they may [s].
    pub(in crate::plan) fn spent(&self) -> (f64, f64) {
        (self.drawn.get(), self.total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grows_with_the_score_up_to_a_bound() {
        let seconds = |n| Allowance::new(n, 1.0).spent().1;
        let all = [1, 100, 550, 1_000, 2_000, 1_000_000].map(seconds);
        for (seconds, most) in all.into_iter().zip([1.0, 1.0, 1.75, 2.5, 5.0, 10.0]) {
            assert!((seconds - most).abs() < 1e-12, "{seconds} of {most}");
        }
        assert_eq!(Allowance::new(1, 0.5).spent(), (0.0, 0.5));
    }

    #[test]
    fn is_spent_from_the_first_trial_that_does_not_fit() {
        let allowance = Allowance::new(1, 1.0);
        assert!(allowance.draw(0.75).is_ok());
        assert!(matches!(
            allowance.draw(0.5),
            Err(TrialError::AllowanceSpent)
        ));
        assert!(matches!(
            allowance.draw(0.01),
            Err(TrialError::AllowanceSpent)
        ));
        assert_eq!((allowance.n_refused(), allowance.spent()), (2, (0.75, 1.0)));
    }

    #[test]
    fn what_has_to_be_done_leaves_less_for_trials() {
        let allowance = Allowance::new(1, 1.0);
        allowance.spend(0.75);
        assert!(matches!(
            allowance.draw(0.5),
            Err(TrialError::AllowanceSpent)
        ));
        allowance.spend(9.0);
        assert_eq!(allowance.spent(), (1.0, 1.0));
    }
}
