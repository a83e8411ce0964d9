//! Starts a bank at a later frame, and transfers the motion of another bank.

use super::{Bank, Oscillator};
use crate::kernel::bank::Lanes;

impl Bank {
    /// Start at frame `n`; earlier strikes are skipped.
    pub(crate) fn seek(&mut self, n: u64) {
        self.frame = n;
        for (next_events, events) in self.next_events.iter_mut().zip(&self.script.events) {
            *next_events = events.partition_point(|event| event.frame < n);
        }
    }

    /// Take over the motion of a bank of the same oscillators; the strikes may differ.
    pub(crate) fn continue_from(&mut self, old: &mut Self) {
        std::mem::swap(&mut self.motions, &mut old.motions);
        std::mem::swap(&mut self.is_at_rest, &mut old.is_at_rest);
    }

    /// Set the positions of an oscillator now and one frame before [m].
    pub(crate) fn set_motion(&mut self, oscillator: usize, (now, before): (f64, f64)) {
        let (group_index, lane_index) = self.group_and_lane_of(oscillator);
        let lane_scale = self.script.scales[group_index].0[lane_index];
        self.set_lane(group_index, lane_index, (lane_scale * now, lane_scale * before));
    }

    /// Copy the motion of an oscillator of another bank; exact to the last bit if both have the same scale.
    pub(crate) fn copy_motion(&mut self, oscillator: usize, old: &Self, old_oscillator: usize) {
        let ((group_index, lane_index), (old_group, old_lane)) = (
            self.group_and_lane_of(oscillator),
            old.group_and_lane_of(old_oscillator),
        );
        if self.script.scales[group_index].0[lane_index] == old.script.scales[old_group].0[old_lane] {
            let old_motion = &old.motions[old_group];
            self.set_lane(
                group_index,
                lane_index,
                (
                    old_motion.positions.0[old_lane],
                    old_motion.previous_positions.0[old_lane],
                ),
            );
        } else {
            self.set_motion(oscillator, old.motion(old_oscillator));
        }
    }

    fn set_lane(&mut self, group: usize, lane: usize, (now, before): (f64, f64)) {
        let group_motion = &mut self.motions[group];
        (group_motion.positions.0[lane], group_motion.previous_positions.0[lane]) = (now, before);
        self.is_at_rest[group] =
            group_motion.positions == Lanes::ZERO && group_motion.previous_positions == Lanes::ZERO;
    }

    fn group_and_lane_of(&self, oscillator: usize) -> (usize, usize) {
        let (group_index, lane_index) = self.script.groups_and_lanes[oscillator];
        (group_index as usize, lane_index as usize)
    }
}

/// Whether two banks hold the same oscillators in the same order; the strikes may differ.
pub(crate) fn are_same(oscillators: &[Oscillator], other: &[Oscillator]) -> bool {
    let is_same_pair = |(a, b): (&Oscillator, &Oscillator)| (a.a, a.b, &a.outputs) == (b.a, b.b, &b.outputs);
    oscillators.len() == other.len() && oscillators.iter().zip(other).all(is_same_pair)
}
