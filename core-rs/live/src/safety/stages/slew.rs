//! How fast a force may change: the last stage.

/// The force that was sent last.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::safety) struct Slew {
    last: f64,
}

impl Slew {
    /// Go towards `wish` by `step` [N] at most, and stay within `room`, which holds zero.
    ///
    /// No tick changes a force by more than the step, but for one case: where the room has become too small for the
    /// force before, the force falls towards zero at once, and never through it. So every rise, and every change of
    /// sign, is within the step. A room without width is a force that has to end now: trip, stale position, panic.
    pub(in crate::safety) fn pass(
        &mut self,
        wish: f64,
        room: [f64; 2],
        step: f64,
        count: &mut u64,
    ) -> f64 {
        let [low, high] = room;
        let mut force = wish.clamp(low, high);
        if (force - self.last).abs() > step {
            *count += 1;
            force = (self.last + step.copysign(force - self.last)).clamp(low, high);
        }
        self.last = force;
        force
    }

    /// The force before was zero.
    pub(in crate::safety) fn forget(&mut self) {
        self.last = 0.0;
    }
}
