//! A trip: an axis is held at zero for a while.

use super::fade::Fade;
use crate::safety::TripCause as Reason;

/// The state of a trip of one axis.
#[derive(Clone, Copy, Debug)]
pub(in crate::safety) struct TripState {
    /// Time for which it is still held [s].
    seconds_left: f64,
    cause: Option<Reason>,
    /// Whether it is held until `release`.
    is_latched: bool,
    fade: Fade,
}

impl TripState {
    pub(in crate::safety) const NONE: Self = Self {
        seconds_left: 0.0,
        cause: None,
        is_latched: false,
        fade: Fade::FULL,
    };

    /// Hold the axis at zero for `hold_time` [s] from now on; count it if the axis was not held before.
    pub(in crate::safety) fn start(&mut self, cause: Reason, hold_time: f64, count: &mut u64) {
        if !self.is_held() {
            *count += 1;
            self.cause = Some(cause);
        }
        self.seconds_left = hold_time;
    }

    /// Hold the axis at zero until `release`.
    pub(in crate::safety) fn latch(&mut self) {
        self.is_latched = true;
    }

    /// End every hold; the force fades in.
    pub(in crate::safety) fn release(&mut self) {
        if self.is_held() {
            (self.seconds_left, self.is_latched, self.fade) = (0.0, false, Fade::ZERO);
        }
    }

    pub(in crate::safety) fn is_held(&self) -> bool {
        self.is_latched || self.seconds_left > 0.0
    }

    /// Why the axis is held by this stage, if it is.
    pub(in crate::safety) fn held_cause(&self) -> Option<Reason> {
        self.cause.filter(|_| self.is_held())
    }

    /// Advance by a tick of `period`: the axis is held, or fades in afterwards over `fade_time` [s]. Returns whether it
    /// is held in this tick.
    pub(in crate::safety) fn tick(&mut self, period: f64, fade_time: f64) -> bool {
        let is_held = self.is_held();
        if is_held {
            self.seconds_left -= period;
            self.fade = Fade::ZERO;
        } else {
            self.fade.advance(period, fade_time);
        }
        is_held
    }

    pub(in crate::safety) fn apply(&self, force: f64, count: &mut u64) -> f64 {
        self.fade.apply(force, count)
    }
}
