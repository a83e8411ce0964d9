//! What the physics thread reports of a tick: status, events, and the recording of the hands.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use super::{Player, RING_TIMEOUT};
use crate::perform::status::{EventKind, HANDS_MAX, PerformanceEvent};
use crate::recording::{self, flag};

/// The load is averaged over this time [s].
const LOAD_AVERAGING: f64 = 1.0;

impl Player {
    /// Record a row of all hands, if there is a recording.
    pub(super) fn record(&mut self) {
        let Some(row_sink) = &mut self.connections.row_sink else {
            return;
        };
        for (hand, row) in self.hand_samples.iter_mut().enumerate() {
            let hand_status = self.status.hands.get(hand).copied().unwrap_or_default();
            let axis_sample = self.hand_axes[hand].map(|(slot, axis)| (&self.slots[slot].sample, axis));
            let row_flags = [
                (flag::FRESH, axis_sample.is_some_and(|(sample, _)| sample.is_fresh)),
                (flag::TOUCH, hand_status.is_touched),
                (flag::FORCE_ENABLED, hand_status.is_motor_enabled),
                (flag::STAND_IN, !hand_status.is_real),
                (flag::TRIPPED, hand_status.is_tripped),
            ];
            *row = recording::RecordedSample {
                position: self.hand_sources[hand].x,
                force: self.piece_forces[hand],
                sent_force: hand_status.sent_force as f32,
                flags: row_flags
                    .iter()
                    .filter(|(_, is_set)| *is_set)
                    .map(|(flag, _)| flag)
                    .sum(),
                clock: axis_sample.and_then(|(sample, _)| sample.t_dev_us).unwrap_or(0),
            };
        }
        // If no clock sets the pace, wait for the disk.
        let wait_start = Instant::now();
        let is_stop_requested = || self.connections.flags.stop.load(Ordering::Acquire);
        while !self.is_paced && !row_sink.has_room() && wait_start.elapsed() < RING_TIMEOUT && !is_stop_requested() {
            self.clock.wait_while_full();
        }
        if !self.hand_samples.is_empty() {
            row_sink.push_row(self.tick - 1, &self.hand_samples);
        }
    }

    /// Update the load by the tick, which took `tick_duration`, and report parts that were newly muted or computed
    /// finer, or created energy.
    pub(super) fn update_load(&mut self, tick_duration: Duration) {
        let tick_period = self.clock.period();
        let tick_load = tick_duration.as_secs_f64() / tick_period;
        let status = &mut self.status;
        status.load += (tick_load - status.load) * (tick_period / LOAD_AVERAGING).min(1.0);
        status.load_max = status.load_max.max(tick_load);
        (status.frame, status.ticks) = (self.frame, status.ticks + 1);
        let muted_count = self.piece.simulation.n_muted() as u32;
        let has_more_muted = muted_count > status.n_muted_parts;
        status.n_muted_parts = muted_count;
        status.ring_frames = self.connections.ring_writer.filled_frames();
        if has_more_muted {
            self.send_event(EventKind::PartMuted);
        }
        let finer_count = self.piece.simulation.n_finer() as u32;
        let has_more_finer = finer_count > self.status.n_finer_parts;
        self.status.n_finer_parts = finer_count;
        if has_more_finer {
            self.send_event(EventKind::PartRefined);
        }
        let gained_count = self.piece.simulation.n_energy_gains() as u32;
        let has_more_gains = gained_count > self.status.n_energy_gains;
        self.status.n_energy_gains = gained_count;
        if has_more_gains {
            self.send_event(EventKind::EnergyCreated);
        }
    }

    /// Note the state of every hand, and report axes that tripped.
    pub(super) fn update_hands(&mut self) {
        for (hand, source) in self.hand_sources.iter().enumerate().take(HANDS_MAX) {
            let hand_status = &mut self.status.hands[hand];
            (hand_status.position, hand_status.force, hand_status.is_real) =
                (source.x, self.piece_forces[hand], source.is_real);
            let Some((slot_index, axis_index)) = self.hand_axes[hand] else {
                continue;
            };
            let keyboard_slot = &self.slots[slot_index];
            hand_status.sent_force = keyboard_slot.sent_forces[axis_index];
            hand_status.force_scale = self.force_scales[hand].current();
            hand_status.is_touched = source.is_real && keyboard_slot.sample.is_touched[axis_index];
            hand_status.is_motor_enabled = source.is_real && keyboard_slot.sample.is_force_enabled[axis_index];
            hand_status.is_hot = source.is_real && keyboard_slot.sample.is_hot;
            [hand_status.let_go, hand_status.stalls] = keyboard_slot.interruptions();
            let axis_trip = keyboard_slot.trip_cause(axis_index);
            if let Some(trip_cause) = axis_trip.filter(|_| !hand_status.is_tripped) {
                let trip_event = PerformanceEvent {
                    frame: self.frame,
                    kind: EventKind::AxisTripped(hand, trip_cause),
                };
                let _ = self.connections.events.push(trip_event);
            }
            hand_status.is_tripped = axis_trip.is_some();
        }
    }

    /// Send an event; it is lost if the queue is full.
    pub(in crate::perform) fn send_event(&mut self, kind: EventKind) {
        let frame = self.frame;
        let _ = self.connections.events.push(PerformanceEvent { frame, kind });
    }

    /// Record an event, such as a command, as a line of JSON.
    pub(in crate::perform) fn record_note(&mut self, line: std::fmt::Arguments<'_>) {
        if let Some(row_sink) = &mut self.connections.row_sink {
            row_sink.push_event(self.tick, line);
        }
    }
}
