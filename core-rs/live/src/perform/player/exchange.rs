//! The keys in a tick: forces are sent, positions are received, and each hand moves to its next position.

use std::sync::atomic::Ordering;

use super::Player;
use crate::perform::keys::KeyboardSlot;
use crate::perform::status::EventKind;

impl Player {
    /// Receive the positions of all hands before the first force is sent.
    pub(in crate::perform) fn receive_first_positions(&mut self) {
        self.has_positions = true;
        self.receive_positions();
        for slot in self.slots.iter().filter(|slot| slot.is_open()) {
            for &(axis, hand) in &slot.axes {
                let key_position = slot.sample.position[axis];
                let hand_source = &mut self.hand_sources[hand];
                if self.tick == 0 {
                    (hand_source.is_real, hand_source.x) = (true, key_position);
                } else {
                    // In the middle of a piece the key starts at the position of its stand-in.
                    hand_source.x = self.piece.hands[hand].standin_position(self.tick);
                    hand_source.change_source(true, key_position);
                }
                self.previous_positions[hand] = hand_source.x;
            }
        }
    }

    /// Send the forces of the previous tick and receive positions; in the first tick `receive_first_positions` received
    /// them.
    pub(super) fn exchange_forces(&mut self) {
        if std::mem::take(&mut self.has_positions) {
            return;
        }
        let tick_period = self.clock.period();
        let tick_rate = 1.0 / tick_period;
        for hand in 0..self.hand_sources.len() {
            let Some((slot_index, axis_index)) = self.hand_axes[hand] else {
                continue;
            };
            let (live_hand, hand_source) = (&self.piece.hands[hand], &self.hand_sources[hand]);
            let key_force = if hand_source.is_real {
                let hand_velocity = (hand_source.x - self.previous_positions[hand]) * tick_rate;
                let in_lockstep = !self.slots[slot_index].has_clock();
                let written_motion = live_hand.written_motion(self.tick, tick_period, in_lockstep);
                let force_scale = self.force_scales[hand].current();
                let guidance_force =
                    self.guidance_states[hand].force(written_motion, hand_source.x, hand_velocity, force_scale);
                (self.piece_forces[hand] + guidance_force) * hand_source.progress()
            } else {
                0.0
            };
            self.slots[slot_index].set_force(axis_index, key_force);
        }
        for slot_index in 0..self.slots.len() {
            let is_present = self.slots[slot_index].send();
            self.update_presence(slot_index, is_present);
        }
        self.receive_positions();
    }

    /// Receive the positions of all keyboards, with one deadline for all.
    fn receive_positions(&mut self) {
        let Some(deadline) = self.slots.first().map(KeyboardSlot::deadline) else {
            return;
        };
        for slot in 0..self.slots.len() {
            let is_present = self.slots[slot].receive(deadline);
            self.update_presence(slot, is_present);
        }
    }

    /// If a keyboard was lost, let the stand-ins of its hands play.
    fn update_presence(&mut self, slot: usize, is_present: bool) {
        if is_present {
            return;
        }
        // While a performance ends, devices are not waited for: a missing reply then does not mean that the device is
        // lost.
        if !self.connections.flags.stop.load(Ordering::Acquire) {
            self.send_event(EventKind::KeyboardLost(slot));
        }
        self.return_ticks[slot] = None;
        for index in 0..self.slots[slot].axes.len() {
            let (_, hand_index) = self.slots[slot].axes[index];
            let standin_position = self.piece.hands[hand_index].standin_position(self.tick);
            self.hand_sources[hand_index].change_source(false, standin_position);
        }
    }

    /// Move every hand to its position in this tick.
    pub(super) fn move_hands(&mut self) {
        for slot in 0..self.slots.len() {
            if self.return_ticks[slot].is_none_or(|tick| self.tick < tick) || !self.slots[slot].is_open() {
                continue;
            }
            self.return_ticks[slot] = None;
            for index in 0..self.slots[slot].axes.len() {
                let (axis_index, hand_index) = self.slots[slot].axes[index];
                let hand_position = self.slots[slot].sample.position[axis_index];
                self.hand_sources[hand_index].change_source(true, hand_position);
                self.send_event(EventKind::HandTakenOver(hand_index));
            }
        }
        for (hand_index, live_hand) in self.piece.hands.iter().enumerate() {
            let hand_source = &mut self.hand_sources[hand_index];
            self.previous_positions[hand_index] = hand_source.x;
            let hand_position = match self.hand_axes[hand_index] {
                Some((slot, axis_index)) if hand_source.is_real => self.slots[slot].sample.position[axis_index],
                _ => live_hand.standin_position(self.tick),
            };
            let hand_position = hand_source.follow(hand_position);
            self.piece
                .simulation
                .set_hand_position(hand_index, hand_position * live_hand.travel_ratio, None);
        }
    }

    /// The first tick of the next bar, or of a bar that begins now; the present tick if no bar follows.
    pub(super) fn next_bar_tick(&self) -> u64 {
        let bars = &self.piece.bars;
        let bar_index = bars.partition_point(|&bar| bar < self.frame);
        let start_frame = bars.get(bar_index).copied().unwrap_or(self.frame);
        start_frame.div_ceil(self.piece.tick_frames as u64)
    }
}
