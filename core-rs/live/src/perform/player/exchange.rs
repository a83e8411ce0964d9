//! The keys in a tick: forces are sent, positions are received, and each hand moves to its next position.

use std::sync::atomic::Ordering;

use super::Player;
use crate::perform::keys::Slot;
use crate::perform::status::EventKind;

impl Player {
    /// Receive the positions of all hands before the first force is sent.
    pub(in crate::perform) fn begin(&mut self) {
        self.has_positions = true;
        self.receive_positions();
        for slot in self.slots.iter().filter(|slot| slot.is_there()) {
            for &(axis, hand) in &slot.axes {
                let x = slot.sample.position[axis];
                let source = &mut self.sources[hand];
                if self.tick == 0 {
                    (source.real, source.x) = (true, x);
                } else {
                    // In the middle of a piece the key starts at the position of its stand-in.
                    source.x = self.stage.hands[hand].standin_position(self.tick);
                    source.change(true, x);
                }
                self.previous[hand] = source.x;
            }
        }
    }

    /// Send the forces of the previous tick and receive positions; in the first tick `begin` received them.
    pub(super) fn exchange_forces(&mut self) {
        if std::mem::take(&mut self.has_positions) {
            return;
        }
        let period = self.clock.period();
        let rate = 1.0 / period;
        for hand in 0..self.sources.len() {
            let Some((slot, axis)) = self.axis_of[hand] else {
                continue;
            };
            let (stage_hand, source) = (&self.stage.hands[hand], &self.sources[hand]);
            let force = if source.real {
                let v = (source.x - self.previous[hand]) * rate;
                let lockstep = !self.slots[slot].is_on_the_clock();
                let part = stage_hand.written_motion(self.tick, period, lockstep);
                let scale = self.scales[hand].now();
                let guidance = self.guidance[hand].force(part, source.x, v, scale);
                (self.piece_forces[hand] + guidance) * source.progress()
            } else {
                0.0
            };
            self.slots[slot].set_force(axis, force);
        }
        for slot in 0..self.slots.len() {
            let there = self.slots[slot].send();
            self.note_presence(slot, there);
        }
        self.receive_positions();
    }

    /// Receive the positions of all keyboards, with one deadline for all.
    fn receive_positions(&mut self) {
        let Some(deadline) = self.slots.first().map(Slot::deadline) else {
            return;
        };
        for slot in 0..self.slots.len() {
            let there = self.slots[slot].receive(deadline);
            self.note_presence(slot, there);
        }
    }

    /// If a keyboard was lost, let the stand-ins of its hands play.
    fn note_presence(&mut self, slot: usize, there: bool) {
        if there {
            return;
        }
        // While a performance ends, devices are not waited for: a missing reply then does not mean that the device is
        // lost.
        if !self.connections.flags.stop.load(Ordering::Acquire) {
            self.send_event(EventKind::Gone(slot));
        }
        self.returns_at[slot] = None;
        for index in 0..self.slots[slot].axes.len() {
            let (_, hand) = self.slots[slot].axes[index];
            let x = self.stage.hands[hand].standin_position(self.tick);
            self.sources[hand].change(false, x);
        }
    }

    /// Move every hand to its position in this tick.
    pub(super) fn move_hands(&mut self) {
        for slot in 0..self.slots.len() {
            if self.returns_at[slot].is_none_or(|tick| self.tick < tick)
                || !self.slots[slot].is_there()
            {
                continue;
            }
            self.returns_at[slot] = None;
            for index in 0..self.slots[slot].axes.len() {
                let (axis, hand) = self.slots[slot].axes[index];
                let x = self.slots[slot].sample.position[axis];
                self.sources[hand].change(true, x);
                self.send_event(EventKind::TookOver(hand));
            }
        }
        for (hand, stage_hand) in self.stage.hands.iter().enumerate() {
            let source = &mut self.sources[hand];
            self.previous[hand] = source.x;
            let x = match self.axis_of[hand] {
                Some((slot, axis)) if source.real => self.slots[slot].sample.position[axis],
                _ => stage_hand.standin_position(self.tick),
            };
            let x = source.follow(x);
            self.stage.simulation.hold(hand, x * stage_hand.reach, None);
        }
    }

    /// The first tick of the next bar, or of a bar that begins now; the present tick if no bar follows.
    pub(super) fn next_bar(&self) -> u64 {
        let bars = &self.stage.bars;
        let next = bars.partition_point(|&bar| bar < self.frame);
        let frame = bars.get(next).copied().unwrap_or(self.frame);
        frame.div_ceil(self.stage.tick_frames as u64)
    }
}
