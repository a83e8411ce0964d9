//! What the physics thread does in a tick. Nothing here allocates, locks or fails.
//!
//! `exchange` exchanges forces and positions with the keys, `sound` computes and delivers the frames, `reports`
//! reports, `change` puts another version in place.

pub(super) mod change;
mod exchange;
mod reports;
mod sound;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use ergon_engine::mix::glide::GainGlide;
use rtrb::{Consumer, Producer};

use super::clock::TickClock;
use super::control::SharedFlags;
use super::frozen::FrozenOutputs;
use super::guidance::GuidanceState;
use super::hand::HandSource;
use super::scale::ForceScale;
use super::sound_input::SoundInput;
use super::status::{EventKind, PerformanceEvent, PerformanceStatus};
use super::window::UnreportedStrikes;
use super::{Command, DisplayWindow, Garbage, HandLimit, KeyboardSlot, LiveAction, LiveHand, PreparedPiece};
use crate::audio::{AudioTap, RingWriter, StreamState};
use crate::recording::{self, RowSink};
use crate::safety;
use change::{SCHEDULED_MAX, ScheduledChange};

/// A tick is late if it begins more than this part of its length after it was due.
const LATENESS_SHARE: f64 = 0.5;
/// Greatest number of strikes and values of inputs in one tick.
const ACTIONS_MAX: usize = 256;
/// If no keys pace the ticks: longest wait for room in the ring, because the card may be gone for good.
const RING_TIMEOUT: Duration = Duration::from_secs(5);

/// The physics thread's ends of everything that it shares with other threads.
pub(super) struct Connections {
    pub(super) flags: Arc<SharedFlags>,
    pub(super) commands: Consumer<Command>,
    pub(super) events: Producer<PerformanceEvent>,
    pub(super) status: triple_buffer::Input<PerformanceStatus>,
    pub(super) ring_writer: RingWriter,
    pub(super) row_sink: Option<RowSink>,
    pub(super) frozen: Option<FrozenOutputs>,
    pub(super) sound_input: Option<SoundInput>,
    pub(super) stream_state: Arc<StreamState>,
    pub(super) garbage: Producer<Garbage>,
}

/// The whole state of the physics thread.
pub(super) struct Player {
    pub(super) piece: PreparedPiece,
    pub(super) gain: GainGlide,
    pub(super) slots: Vec<KeyboardSlot>,
    pub(super) connections: Connections,
    /// Changes that are not due yet, by rising frame.
    #[allow(clippy::vec_box)]
    // each change returns in its own box: unboxing would free memory here
    pub(super) scheduled_changes: Vec<Box<ScheduledChange>>,
    /// Writes what is heard into a file.
    tap: Option<AudioTap>,
    /// The window that pages look through, and the next one, which waits until its simulation plays.
    window: Option<Box<DisplayWindow>>,
    next_window: Option<Box<DisplayWindow>>,
    /// Strikes to be reported in the next picture.
    new_strikes: UnreportedStrikes,
    /// Acts of this tick, with their tickets.
    actions: Vec<(u64, LiveAction)>,
    clock: TickClock,
    pub(super) hand_sources: Vec<HandSource>,
    pub(super) guidance_states: Vec<GuidanceState>,
    pub(super) force_scales: Vec<ForceScale>,
    /// Position of each hand's key in the previous tick [m], from which its speed is computed.
    previous_positions: Vec<f64>,
    /// Force of the piece on each hand [N].
    piece_forces: Vec<f64>,
    /// Slot and axis of each hand.
    pub(super) hand_axes: Vec<Option<(usize, usize)>>,
    /// For each slot, the tick from which a keyboard that came back plays again.
    return_ticks: Vec<Option<u64>>,
    hand_samples: Vec<recording::RecordedSample>,
    /// Outputs of a tick                        (tick_frames, n_out)
    pub(super) outputs: Vec<f64>,
    /// Channels of a tick                       (tick_frames, n_channels)
    mixed_frames: Vec<f64>,
    /// Heard channels of a tick, if there is a fold   (tick_frames, n_heard)
    folded_frames: Vec<f64>,
    output_samples: Vec<f32>,
    /// Frames of the limiter's delay that are still to be skipped at the beginning.
    frames_to_skip: usize,
    /// Frames that the fold and the limiter still hold after the last frame of the piece.
    tail_frames: usize,
    pub(super) tick: u64,
    pub(super) frame: u64,
    status: PerformanceStatus,
    is_panicking: bool,
    /// Whether a clock sets the pace: that of the card, or that of the keys.
    is_paced: bool,
    /// Whether the keys' positions in this tick have been received.
    has_positions: bool,
}

impl Player {
    pub(super) fn new(
        mut piece: PreparedPiece,
        slots: Vec<KeyboardSlot>,
        connections: Connections,
        clock: TickClock,
        paced: bool,
        hand_limits: &[HandLimit],
    ) -> Self {
        let hand_count = piece.hands.len();
        let tick_period = piece.tick_frames as f64 / piece.simulation.rate();
        let guidance_of = |hand: &LiveHand| GuidanceState::new(hand.guidance, tick_period);
        let guidance = piece.hands.iter().map(guidance_of).collect();
        let mut scales = vec![ForceScale::new(1.0, tick_period); hand_count];
        for hand_limit in hand_limits {
            scales[hand_limit.hand] = ForceScale::new(hand_limit.force_scale, tick_period);
        }
        let mut axis_of = vec![None; hand_count];
        for (slot_index, keyboard_slot) in slots.iter().enumerate() {
            for &(axis, hand) in &keyboard_slot.axes {
                axis_of[hand] = Some((slot_index, axis));
            }
        }
        piece.mixer.seek(piece.simulation.frame());
        let latency = piece.limiter.latency();
        let (tick_frames, n_outputs) = (piece.tick_frames, piece.simulation.n_out());
        let (n_channels, n_heard_channels) = (piece.mixer.n_channels(), piece.n_heard_channels());
        let status = PerformanceStatus {
            frame: piece.simulation.frame(),
            ..PerformanceStatus::default()
        };
        Self {
            gain: GainGlide::new(piece.simulation.rate(), piece.gain),
            hand_sources: vec![HandSource::default(); hand_count],
            guidance_states: guidance,
            force_scales: scales,
            previous_positions: vec![0.0; hand_count],
            piece_forces: vec![0.0; hand_count],
            hand_axes: axis_of,
            return_ticks: vec![None; slots.len()],
            hand_samples: vec![recording::RecordedSample::default(); hand_count],
            outputs: vec![0.0; tick_frames * n_outputs],
            mixed_frames: vec![0.0; tick_frames * n_channels],
            folded_frames: vec![0.0; piece.fold.as_ref().map_or(0, |_| tick_frames * n_heard_channels)],
            output_samples: vec![0.0; tick_frames * n_heard_channels],
            frames_to_skip: latency,
            tail_frames: piece.n_tail_frames(),
            tick: piece.simulation.frame() / tick_frames as u64,
            frame: piece.simulation.frame(),
            status,
            is_panicking: false,
            is_paced: paced,
            has_positions: false,
            scheduled_changes: Vec::with_capacity(SCHEDULED_MAX),
            actions: Vec::with_capacity(ACTIONS_MAX),
            new_strikes: UnreportedStrikes::new(),
            tap: None,
            window: None,
            next_window: None,
            piece,
            slots,
            connections,
            clock,
        }
    }

    /// Play to the end.
    pub(super) fn run(&mut self) {
        self.receive_first_positions();
        loop {
            let stop_requested = self.connections.flags.stop.load(Ordering::Acquire);
            if stop_requested || !self.tick() {
                break;
            }
        }
        for slot in &mut self.slots {
            slot.set_stopped(true);
        }
        self.send_event(EventKind::PieceEnded);
        self.connections.status.write(self.status);
        self.connections.ring_writer.close();
    }

    /// One tick; false once the piece is over.
    pub(super) fn tick(&mut self) -> bool {
        let frames_left = match self.piece.n_frames {
            Some(n_frames) => n_frames.saturating_sub(self.frame),
            None => u64::MAX,
        };
        if frames_left == 0 && self.tail_frames == 0 {
            return false;
        }
        let is_playing = self.connections.stream_state.played_frames() > 0;
        self.wait_for_input();
        let clock_tick = self
            .clock
            .tick(self.connections.ring_writer.filled_frames(), is_playing);
        let tick_began = Instant::now();
        self.count_lateness(clock_tick.lateness, clock_tick.was_reset);
        safety::check_signals();
        self.run_commands();
        self.make_changes();
        self.perform_actions();
        self.update_scales();
        self.guidance_states
            .iter_mut()
            .for_each(|guidance| guidance.tick(self.tick));
        let frame_count = (self.piece.tick_frames as u64).min(frames_left) as usize;
        if frame_count > 0 {
            self.exchange_forces();
            self.move_hands();
            self.compute_sound(frame_count);
            self.update_hands();
            self.record();
            self.publish_picture();
        } else {
            // The last frames of fold and limiter are heard; the hands are stopped.
            self.slots.iter_mut().for_each(|slot| slot.set_stopped(true));
            self.compute_sound(0);
        }
        self.update_load(tick_began.elapsed());
        self.connections.status.write(self.status);
        self.push_output(
            if frame_count == 0 {
                self.piece.tick_frames.min(self.tail_frames)
            } else {
                frame_count
            },
            frame_count == 0,
        );
        true
    }

    /// If there is an input and no key paces the ticks, wait until the ring falls to its level: a fuller ring would
    /// delay the input.
    fn wait_for_input(&self) {
        let Some(sound_input) = &self.connections.sound_input else {
            return;
        };
        let wait_start = Instant::now();
        while !self.clock.is_paced_by_keys()
            && sound_input.has_enough(self.connections.ring_writer.filled_frames())
            && wait_start.elapsed() < RING_TIMEOUT
            && !self.connections.flags.stop.load(Ordering::Acquire)
        {
            self.clock.wait_while_full();
        }
    }

    fn count_lateness(&mut self, lateness: Duration, was_reset: bool) {
        let status = &mut self.status;
        status.late_ticks += u64::from(lateness.as_secs_f64() > LATENESS_SHARE * self.clock.period());
        status.lateness_max = status.lateness_max.max(lateness);
        if was_reset {
            status.clock_resets += 1;
            self.send_event(EventKind::ClockReset(lateness));
        }
    }

    fn run_commands(&mut self) {
        while let Ok(command) = self.connections.commands.pop() {
            match command {
                Command::Gain(gain) => {
                    self.gain.set(gain);
                    self.record_note(format_args!("{{\"gain\":{gain}}}"));
                }
                Command::GroupGain(group, gain) => {
                    self.piece.mixer.set_gain(group, gain);
                    self.record_note(format_args!("{{\"part\":{group},\"gain\":{gain}}}"));
                }
                Command::Change(scheduled_change) => self.schedule(scheduled_change),
                Command::Revoke(frame) => self.revoke(frame),
                Command::Tap(tap) => self.tap = tap,
                Command::Window(window) => {
                    if let Some(replaced_window) = self.next_window.replace(window) {
                        self.discard(Garbage::Window(replaced_window));
                    }
                }
                Command::Action(ticket, _) if self.actions.len() == ACTIONS_MAX => {
                    self.send_event(EventKind::ActionMissed(ticket));
                }
                Command::Action(ticket, perform_acts) => self.actions.push((ticket, perform_acts)),
                Command::ReopenedKeyboard(slot, guarded_device) => {
                    self.slots[slot].set_reopened(guarded_device);
                    self.slots[slot].set_stopped(self.is_panicking);
                    self.return_ticks[slot] = Some(self.next_bar_tick());
                    self.send_event(EventKind::KeyboardReturned(slot));
                }
            }
        }
        let panicked = self.connections.flags.panic.load(Ordering::Acquire);
        if panicked != self.is_panicking {
            self.is_panicking = panicked;
            self.slots.iter_mut().for_each(|slot| slot.set_stopped(panicked));
            self.record_note(format_args!("{{\"panic\":{panicked}}}"));
        }
        if self.connections.flags.release.swap(false, Ordering::AcqRel) {
            self.slots.iter_mut().for_each(KeyboardSlot::release);
        }
    }

    /// Publish a picture for pages.
    fn publish_picture(&mut self) {
        let simulation = &mut self.piece.simulation;
        if (self.next_window.as_ref()).is_some_and(|pending_window| pending_window.shows_simulation(simulation)) {
            std::mem::swap(&mut self.window, &mut self.next_window);
            if let Some(replaced_window) = self.next_window.take() {
                self.discard(Garbage::Window(replaced_window));
            }
        }
        if let Some(window) = &mut self.window {
            let simulation = &mut self.piece.simulation;
            window.publish(simulation, &mut self.new_strikes, self.status.dropped_frames);
        }
    }

    /// Perform the acts of this tick: strike points of the simulation and set its inputs. A simulation that took over
    /// at this frame already receives them.
    fn perform_actions(&mut self) {
        for index in 0..self.actions.len() {
            let (ticket, act) = self.actions[index];
            let has_acted = match act {
                LiveAction::Strike(point, impulse) => self.strike(point, impulse),
                LiveAction::SetInput(input_number, value) => self.piece.simulation.set_input(input_number, value),
            };
            self.send_event(if has_acted {
                EventKind::ActionDone(ticket)
            } else {
                EventKind::ActionMissed(ticket)
            });
        }
        self.actions.clear();
    }

    fn strike(&mut self, point: u32, impulse: f64) -> bool {
        let is_struck = self.piece.simulation.strike(point, impulse);
        if is_struck && self.piece.is_displayed {
            (self.new_strikes).add(self.piece.simulation.frame(), point, impulse);
        }
        is_struck
    }
}
