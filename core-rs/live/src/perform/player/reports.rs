//! What the physics thread reports of a tick: status, events, and the recording of the hands.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use super::{Player, RING_TIMEOUT};
use crate::perform::status::{Event, EventKind, HANDS_MAX};
use crate::recording::{self, flag};

/// The load is averaged over this time [s].
const LOAD_AVERAGING: f64 = 1.0;

impl Player {
    /// Record a row of all hands, if there is a recording.
    pub(super) fn record(&mut self) {
        let Some(row_sink) = &mut self.connections.record else {
            return;
        };
        for (hand, row) in self.hand_samples.iter_mut().enumerate() {
            let hand_status = self.status.hands.get(hand).copied().unwrap_or_default();
            let sample = self.axis_of[hand].map(|(slot, axis)| (&self.slots[slot].sample, axis));
            let row_flags = [
                (flag::FRESH, sample.is_some_and(|(sample, _)| sample.fresh)),
                (flag::TOUCH, hand_status.touch),
                (flag::FORCE_ENABLED, hand_status.enabled),
                (flag::STAND_IN, !hand_status.real),
                (flag::TRIPPED, hand_status.tripped),
            ];
            *row = recording::Sample {
                position: self.sources[hand].x,
                force: self.piece_forces[hand],
                sent: hand_status.sent as f32,
                flags: row_flags
                    .iter()
                    .filter(|(_, is_set)| *is_set)
                    .map(|(flag, _)| flag)
                    .sum(),
                clock: sample.and_then(|(sample, _)| sample.t_dev_us).unwrap_or(0),
            };
        }
        // If no clock sets the pace, wait for the disk.
        let wait_start = Instant::now();
        let stop_requested = || self.connections.flags.stop.load(Ordering::Acquire);
        while !self.has_pace && !row_sink.has_room() && wait_start.elapsed() < RING_TIMEOUT && !stop_requested() {
            self.clock.wait_while_full();
        }
        if !self.hand_samples.is_empty() {
            row_sink.row(self.tick - 1, &self.hand_samples);
        }
    }

    /// Note the load of the tick, which `took` this long, and report parts that were newly muted or computed finer, or
    /// created energy.
    pub(super) fn note_load(&mut self, took: Duration) {
        let tick_period = self.clock.period();
        let tick_load = took.as_secs_f64() / tick_period;
        let status = &mut self.status;
        status.load += (tick_load - status.load) * (tick_period / LOAD_AVERAGING).min(1.0);
        status.busiest = status.busiest.max(tick_load);
        (status.frame, status.ticks) = (self.frame, status.ticks + 1);
        let muted_count = self.stage.simulation.n_muted() as u32;
        let is_increased = muted_count > status.muted;
        status.muted = muted_count;
        status.filled = self.connections.feed.filled();
        if is_increased {
            self.send_event(EventKind::Muted);
        }
        let finer_count = self.stage.simulation.n_finer() as u32;
        let is_increased = finer_count > self.status.finer;
        self.status.finer = finer_count;
        if is_increased {
            self.send_event(EventKind::Finer);
        }
        let gained_count = self.stage.simulation.n_energy_gains() as u32;
        let is_increased = gained_count > self.status.n_gains;
        self.status.n_gains = gained_count;
        if is_increased {
            self.send_event(EventKind::Gained);
        }
    }

    /// Note the state of every hand, and report axes that tripped.
    pub(super) fn update_hands(&mut self) {
        for (hand, source) in self.sources.iter().enumerate().take(HANDS_MAX) {
            let hand_status = &mut self.status.hands[hand];
            (hand_status.position, hand_status.force, hand_status.real) =
                (source.x, self.piece_forces[hand], source.is_real);
            let Some((slot, axis_index)) = self.axis_of[hand] else {
                continue;
            };
            let slot = &self.slots[slot];
            hand_status.sent = slot.sent_forces[axis_index];
            hand_status.scale = self.scales[hand].now();
            hand_status.touch = source.is_real && slot.sample.touch[axis_index];
            hand_status.enabled = source.is_real && slot.sample.force_enabled[axis_index];
            hand_status.hot = source.is_real && slot.sample.hot;
            [hand_status.let_go, hand_status.stalls] = slot.interruptions();
            let axis_trip = slot.tripped(axis_index);
            if let Some(trip_cause) = axis_trip.filter(|_| !hand_status.tripped) {
                let trip_event = Event {
                    frame: self.frame,
                    kind: EventKind::Tripped(hand, trip_cause),
                };
                let _ = self.connections.events.push(trip_event);
            }
            hand_status.tripped = axis_trip.is_some();
        }
    }

    /// Send an event; it is lost if the queue is full.
    pub(in crate::perform) fn send_event(&mut self, kind: EventKind) {
        let frame = self.frame;
        let _ = self.connections.events.push(Event { frame, kind });
    }

    /// Record an event, such as a command, as a line of JSON.
    pub(in crate::perform) fn note(&mut self, line: std::fmt::Arguments<'_>) {
        if let Some(row_sink) = &mut self.connections.record {
            row_sink.event(self.tick, line);
        }
    }
}
