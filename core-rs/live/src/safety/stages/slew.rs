//! The limit on how fast a force may change: the last stage.

/// The force that was sent last.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::safety) struct Slew {
    last: f64,
}

impl Slew {
    /// Go towards `wish` by at most `step` [N], and stay within `room`, which contains zero.
    ///
    /// No tick changes a force by more than the step, with one exception: if the previous force is outside the room,
    /// the force falls towards zero at once, and never through it. So every rise, and every change of sign, is within
    /// the step. A room without width ends the force now: trip, stale position, panic.
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

    /// Note that the previous force was zero.
    pub(in crate::safety) fn forget(&mut self) {
        self.last = 0.0;
    }
}
