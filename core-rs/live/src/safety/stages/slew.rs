//! The limit on how fast a force may change: the last stage.

/// The force that was sent last.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::safety) struct Slew {
    last: f64,
}

impl Slew {
    /// Go towards `asked` by at most `step` [N], and stay within `allowed`, which contains zero.
    ///
    /// No tick changes a force by more than the step, with one exception: if the previous force is outside the
    /// interval, the force falls towards zero at once, and never through it. So every rise, and every change of sign,
    /// is within the step. An interval without width ends the force now: trip, stale position, panic.
    pub(in crate::safety) fn pass(&mut self, asked: f64, allowed: [f64; 2], step: f64, count: &mut u64) -> f64 {
        let [lowest_force, highest_force] = allowed;
        let mut force = asked.clamp(lowest_force, highest_force);
        if (force - self.last).abs() > step {
            *count += 1;
            force = (self.last + step.copysign(force - self.last)).clamp(lowest_force, highest_force);
        }
        self.last = force;
        force
    }

    /// Note that the previous force was zero.
    pub(in crate::safety) fn forget(&mut self) {
        self.last = 0.0;
    }
}
