//! A trip: an axis is held at zero for a while.

use super::fade::Fade;

/// The state of a trip of one axis.
#[derive(Clone, Copy, Debug)]
pub(in crate::safety) struct Trip {
    /// Time for which it is still held [s].
    left: f64,
    fade: Fade,
}

impl Trip {
    pub(in crate::safety) const NONE: Self = Self {
        left: 0.0,
        fade: Fade::WHOLE,
    };

    /// Hold the axis at zero for `hold` [s] from now on; count it if the axis was not held before.
    pub(in crate::safety) fn start(&mut self, hold: f64, count: &mut u64) {
        *count += u64::from(!self.is_held());
        self.left = hold;
    }

    pub(in crate::safety) fn is_held(&self) -> bool {
        self.left > 0.0
    }

    /// Advance by a tick of `period`: the axis is held, or fades in afterwards over `fade` [s]. Returns whether it is
    /// held in this tick.
    pub(in crate::safety) fn tick(&mut self, period: f64, fade: f64) -> bool {
        let is_held = self.is_held();
        if is_held {
            self.left -= period;
            self.fade = Fade::ZERO;
        } else {
            self.fade.rise(period, fade);
        }
        is_held
    }

    pub(in crate::safety) fn pass(&self, force: f64, count: &mut u64) -> f64 {
        self.fade.pass(force, count)
    }
}
