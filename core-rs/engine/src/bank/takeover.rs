//! Starts a bank at a later frame, and transfers the motion of another bank.

use super::{Bank, Oscillator};
use crate::kernel::bank::Lanes;

impl Bank {
    /// Start at frame `n`; earlier strikes are skipped.
    pub(crate) fn seek(&mut self, n: u64) {
        self.frame = n;
        for (next, events) in self.next.iter_mut().zip(&self.script.events) {
            *next = events.partition_point(|event| event.frame < n);
        }
    }

    /// Take over the motion of a bank of the same oscillators; the strikes may differ.
    pub(crate) fn continue_from(&mut self, old: &mut Self) {
        std::mem::swap(&mut self.motions, &mut old.motions);
        std::mem::swap(&mut self.still, &mut old.still);
    }

    /// Set the positions of an oscillator now and one frame before [m].
    pub(crate) fn set_motion(&mut self, oscillator: usize, (now, before): (f64, f64)) {
        let (group, lane) = self.place(oscillator);
        let scale = self.script.scales[group].0[lane];
        self.store(group, lane, (scale * now, scale * before));
    }

    /// Copy the motion of an oscillator of another bank; exact to the last bit if both have the same scale.
    pub(crate) fn copy_motion(&mut self, oscillator: usize, old: &Self, there: usize) {
        let ((group, lane), (from, old_lane)) = (self.place(oscillator), old.place(there));
        if self.script.scales[group].0[lane] == old.script.scales[from].0[old_lane] {
            let motion = &old.motions[from];
            self.store(
                group,
                lane,
                (motion.now.0[old_lane], motion.before.0[old_lane]),
            );
        } else {
            self.set_motion(oscillator, old.motion(there));
        }
    }

    fn store(&mut self, group: usize, lane: usize, (now, before): (f64, f64)) {
        let motion = &mut self.motions[group];
        (motion.now.0[lane], motion.before.0[lane]) = (now, before);
        self.still[group] = motion.now == Lanes::ZERO && motion.before == Lanes::ZERO;
    }

    fn place(&self, oscillator: usize) -> (usize, usize) {
        let (group, lane) = self.script.places[oscillator];
        (group as usize, lane as usize)
    }
}

/// Whether two banks hold the same oscillators in the same order; the strikes may differ.
pub(crate) fn are_same(oscillators: &[Oscillator], other: &[Oscillator]) -> bool {
    let same =
        |(a, b): (&Oscillator, &Oscillator)| (a.a, a.b, &a.outputs) == (b.a, b.b, &b.outputs);
    oscillators.len() == other.len() && oscillators.iter().zip(other).all(same)
}
