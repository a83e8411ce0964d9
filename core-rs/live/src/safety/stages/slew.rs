//! The limit on how fast a force may change: the last stage.

/// The force that was sent last.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::safety) struct Slew {
    last_force: f64,
}

impl Slew {
    /// Go towards `requested` by at most `step` [N], and stay within `allowed`, which contains zero.
    ///
    /// No tick changes a force by more than the step, with one exception: if the previous force is outside the
    /// interval, the force falls towards zero at once, and never through it. So every rise, and every change of sign,
    /// is within the step. An interval without width ends the force now: trip, stale position, panic.
    pub(in crate::safety) fn limit_force(
        &mut self,
        requested: f64,
        allowed: [f64; 2],
        step: f64,
        count: &mut u64,
    ) -> f64 {
        let [lowest_force, highest_force] = allowed;
        let mut force = requested.clamp(lowest_force, highest_force);
        if (force - self.last_force).abs() > step {
            *count += 1;
            force = (self.last_force + step.copysign(force - self.last_force)).clamp(lowest_force, highest_force);
        }
        self.last_force = force;
        force
    }

    /// Note that the previous force was zero.
    pub(in crate::safety) fn reset(&mut self) {
        self.last_force = 0.0;
    }
}
