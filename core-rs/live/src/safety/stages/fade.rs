//! The fade of a force from zero.

/// A factor that rises from 0 to 1.
#[derive(Clone, Copy, Debug)]
pub(in crate::safety) struct Fade(f64);

impl Fade {
    /// No force passes.
    pub(in crate::safety) const ZERO: Self = Self(0.0);
    /// The whole force passes.
    pub(in crate::safety) const FULL: Self = Self(1.0);

    /// Advance by a tick of `period`; the whole rise takes `fade_time` [s].
    pub(in crate::safety) fn advance(&mut self, period: f64, fade_time: f64) {
        self.0 = if fade_time > 0.0 {
            (self.0 + period / fade_time).min(1.0)
        } else {
            1.0
        };
    }

    /// Whether all of the force passes.
    pub(in crate::safety) fn is_full(self) -> bool {
        self.0 >= 1.0
    }

    /// The part of the force that passes.
    pub(in crate::safety) fn apply(self, force: f64, count: &mut u64) -> f64 {
        scale_force(force, self.0, count)
    }
}

/// Scale a force. A factor below 1 counts as an action of the stage; a factor of 1 must not even round.
pub(in crate::safety) fn scale_force(force: f64, factor: f64, count: &mut u64) -> f64 {
    if factor >= 1.0 {
        return force;
    }
    *count += 1;
    force * factor
}
