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

use super::clock::Clock;
use super::control::SharedFlags;
use super::frozen::Frozen;
use super::guidance::GuidanceState;
use super::hand::HandSource;
use super::scale::Scale;
use super::sound_input::SoundInput;
use super::status::{Event, EventKind, Status};
use super::window::Strikes;
use super::{Act, Command, Garbage, Hand, HandLimit, Slot, Stage, Window};
use crate::audio::{Feed, Shared, Tap};
use crate::recording::{self, RowSink};
use crate::safety;
use change::{SCHEDULED_MAX, ScheduledChange};

/// A tick is late if it begins more than this part of its length after it was due.
const LATE_SHARE: f64 = 0.5;
/// Greatest number of strikes and values of inputs in one tick.
const ACTS_MAX: usize = 256;
/// If no keys pace the ticks: longest wait for room in the ring, because the card may be gone for good.
const RING_TIMEOUT: Duration = Duration::from_secs(5);

/// The physics thread's ends of everything that it shares with other threads.
pub(super) struct Connections {
    pub(super) flags: Arc<SharedFlags>,
    pub(super) commands: Consumer<Command>,
    pub(super) events: Producer<Event>,
    pub(super) status: triple_buffer::Input<Status>,
    pub(super) feed: Feed,
    pub(super) record: Option<RowSink>,
    pub(super) frozen: Option<Frozen>,
    pub(super) sound_input: Option<SoundInput>,
    pub(super) shared: Arc<Shared>,
    pub(super) garbage: Producer<Garbage>,
}

/// The whole state of the physics thread.
pub(super) struct Player {
    pub(super) stage: Stage,
    pub(super) gain: GainGlide,
    pub(super) slots: Vec<Slot>,
    pub(super) connections: Connections,
    /// Changes that are not due yet, by rising frame.
    #[allow(clippy::vec_box)]
    // each change returns in its own box: unboxing would free memory here
    pub(super) scheduled_changes: Vec<Box<ScheduledChange>>,
    /// Writes what is heard into a file.
    tap: Option<Tap>,
    /// The window that pages look through, and the next one, which waits until its simulation plays.
    window: Option<Box<Window>>,
    next_window: Option<Box<Window>>,
    /// Strikes to be reported in the next picture.
    new_strikes: Strikes,
    /// Acts of this tick, with their tickets.
    acts: Vec<(u64, Act)>,
    clock: Clock,
    pub(super) sources: Vec<HandSource>,
    pub(super) guidance: Vec<GuidanceState>,
    pub(super) scales: Vec<Scale>,
    /// Position of each hand's key in the previous tick [m], from which its speed is computed.
    previous_positions: Vec<f64>,
    /// Force of the piece on each hand [N].
    piece_forces: Vec<f64>,
    /// Slot and axis of each hand.
    pub(super) axis_of: Vec<Option<(usize, usize)>>,
    /// For each slot, the tick from which a keyboard that came back plays again.
    returns_at: Vec<Option<u64>>,
    hand_samples: Vec<recording::Sample>,
    /// Outputs of a tick                        (tick_frames, n_out)
    pub(super) outputs: Vec<f64>,
    /// Channels of a tick                       (tick_frames, n_channels)
    mixed: Vec<f64>,
    /// Heard channels of a tick, if there is a fold   (tick_frames, n_heard)
    folded: Vec<f64>,
    output_f32: Vec<f32>,
    /// Frames of the limiter's delay that are still to be skipped at the beginning.
    frames_to_skip: usize,
    /// Frames that the fold and the limiter still hold after the last frame of the piece.
    tail_frames: usize,
    pub(super) tick: u64,
    pub(super) frame: u64,
    status: Status,
    panicked: bool,
    /// Whether a clock sets the pace: that of the card, or that of the keys.
    has_pace: bool,
    /// Whether the keys' positions in this tick have been received.
    has_positions: bool,
}

impl Player {
    pub(super) fn new(
        mut stage: Stage,
        slots: Vec<Slot>,
        connections: Connections,
        clock: Clock,
        paced: bool,
        hand_limits: &[HandLimit],
    ) -> Self {
        let hand_count = stage.hands.len();
        let tick_period = stage.tick_frames as f64 / stage.simulation.rate();
        let guidance_of = |hand: &Hand| GuidanceState::new(hand.guidance, tick_period);
        let guidance = stage.hands.iter().map(guidance_of).collect();
        let mut scales = vec![Scale::new(1.0, tick_period); hand_count];
        for hand_limit in hand_limits {
            scales[hand_limit.hand] = Scale::new(hand_limit.scale, tick_period);
        }
        let mut axis_of = vec![None; hand_count];
        for (slot_index, keyboard_slot) in slots.iter().enumerate() {
            for &(axis, hand) in &keyboard_slot.axes {
                axis_of[hand] = Some((slot_index, axis));
            }
        }
        stage.mixer.seek(stage.simulation.frame());
        let latency = stage.limiter.latency();
        let (tick_frames, n_outputs) = (stage.tick_frames, stage.simulation.n_out());
        let (n_channels, n_heard_channels) = (stage.mixer.n_channels(), stage.n_heard());
        let status = Status {
            frame: stage.simulation.frame(),
            ..Status::default()
        };
        Self {
            gain: GainGlide::new(stage.simulation.rate(), stage.gain),
            sources: vec![HandSource::default(); hand_count],
            guidance,
            scales,
            previous_positions: vec![0.0; hand_count],
            piece_forces: vec![0.0; hand_count],
            axis_of,
            returns_at: vec![None; slots.len()],
            hand_samples: vec![recording::Sample::default(); hand_count],
            outputs: vec![0.0; tick_frames * n_outputs],
            mixed: vec![0.0; tick_frames * n_channels],
            folded: vec![0.0; stage.fold.as_ref().map_or(0, |_| tick_frames * n_heard_channels)],
            output_f32: vec![0.0; tick_frames * n_heard_channels],
            frames_to_skip: latency,
            tail_frames: stage.n_tail(),
            tick: stage.simulation.frame() / tick_frames as u64,
            frame: stage.simulation.frame(),
            status,
            panicked: false,
            has_pace: paced,
            has_positions: false,
            scheduled_changes: Vec::with_capacity(SCHEDULED_MAX),
            acts: Vec::with_capacity(ACTS_MAX),
            new_strikes: Strikes::new(),
            tap: None,
            window: None,
            next_window: None,
            stage,
            slots,
            connections,
            clock,
        }
    }

    /// Play to the end.
    pub(super) fn run(&mut self) {
        self.begin();
        loop {
            let stop_requested = self.connections.flags.stop.load(Ordering::Acquire);
            if stop_requested || !self.tick() {
                break;
            }
        }
        for slot in &mut self.slots {
            slot.stop(true);
        }
        self.send_event(EventKind::Ended);
        self.connections.status.write(self.status);
        self.connections.feed.close();
    }

    /// One tick; false once the piece is over.
    pub(super) fn tick(&mut self) -> bool {
        let frames_left = match self.stage.n_frames {
            Some(n_frames) => n_frames.saturating_sub(self.frame),
            None => u64::MAX,
        };
        if frames_left == 0 && self.tail_frames == 0 {
            return false;
        }
        let is_playing = self.connections.shared.played() > 0;
        self.wait_for_input();
        let clock_tick = self.clock.tick(self.connections.feed.filled(), is_playing);
        let tick_began = Instant::now();
        self.count_lateness(clock_tick.lateness, clock_tick.was_reset);
        safety::check_signals();
        self.run_commands();
        self.make_changes();
        self.act();
        self.update_scales();
        self.guidance.iter_mut().for_each(|guidance| guidance.tick(self.tick));
        let frame_count = (self.stage.tick_frames as u64).min(frames_left) as usize;
        if frame_count > 0 {
            self.exchange_forces();
            self.move_hands();
            self.step(frame_count);
            self.update_hands();
            self.record();
            self.publish_picture();
        } else {
            // The last frames of fold and limiter are heard; the hands are stopped.
            self.slots.iter_mut().for_each(|slot| slot.stop(true));
            self.step(0);
        }
        self.note_load(tick_began.elapsed());
        self.connections.status.write(self.status);
        self.feed(
            if frame_count == 0 {
                self.stage.tick_frames.min(self.tail_frames)
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
            && sound_input.is_enough(self.connections.feed.filled())
            && wait_start.elapsed() < RING_TIMEOUT
            && !self.connections.flags.stop.load(Ordering::Acquire)
        {
            self.clock.wait_while_full();
        }
    }

    fn count_lateness(&mut self, lateness: Duration, was_reset: bool) {
        let status = &mut self.status;
        status.late_ticks += u64::from(lateness.as_secs_f64() > LATE_SHARE * self.clock.period());
        status.max_lateness = status.max_lateness.max(lateness);
        if was_reset {
            status.clock_resets += 1;
            self.send_event(EventKind::Lost(lateness));
        }
    }

    fn run_commands(&mut self) {
        while let Ok(command) = self.connections.commands.pop() {
            match command {
                Command::Gain(gain) => {
                    self.gain.set(gain);
                    self.note(format_args!("{{\"gain\":{gain}}}"));
                }
                Command::Part(part, gain) => {
                    self.stage.mixer.set_gain(part, gain);
                    self.note(format_args!("{{\"part\":{part},\"gain\":{gain}}}"));
                }
                Command::Change(scheduled_change) => self.schedule(scheduled_change),
                Command::Revoke(frame) => self.revoke(frame),
                Command::Tap(tap) => self.tap = tap,
                Command::Window(window) => {
                    if let Some(replaced_window) = self.next_window.replace(window) {
                        self.throw_away(Garbage::Window(replaced_window));
                    }
                }
                Command::Act(ticket, _) if self.acts.len() == ACTS_MAX => {
                    self.send_event(EventKind::Missed(ticket));
                }
                Command::Act(ticket, perform_acts) => self.acts.push((ticket, perform_acts)),
                Command::Keys(slot, guarded) => {
                    self.slots[slot].reopened(guarded);
                    self.slots[slot].stop(self.panicked);
                    self.returns_at[slot] = Some(self.next_bar());
                    self.send_event(EventKind::Back(slot));
                }
            }
        }
        let panicked = self.connections.flags.panic.load(Ordering::Acquire);
        if panicked != self.panicked {
            self.panicked = panicked;
            self.slots.iter_mut().for_each(|slot| slot.stop(panicked));
            self.note(format_args!("{{\"panic\":{panicked}}}"));
        }
        if self.connections.flags.release.swap(false, Ordering::AcqRel) {
            self.slots.iter_mut().for_each(Slot::release);
        }
    }

    /// Publish a picture for pages.
    fn publish_picture(&mut self) {
        let simulation = &mut self.stage.simulation;
        if (self.next_window.as_ref()).is_some_and(|pending_window| pending_window.is_of(simulation)) {
            std::mem::swap(&mut self.window, &mut self.next_window);
            if let Some(replaced_window) = self.next_window.take() {
                self.throw_away(Garbage::Window(replaced_window));
            }
        }
        if let Some(window) = &mut self.window {
            let simulation = &mut self.stage.simulation;
            window.publish(simulation, &mut self.new_strikes, self.status.dropped);
        }
    }

    /// Perform the acts of this tick: strike points of the simulation and set its inputs. A simulation that took over
    /// at this frame already receives them.
    fn act(&mut self) {
        for index in 0..self.acts.len() {
            let (ticket, act) = self.acts[index];
            let has_acted = match act {
                Act::Strike(point, impulse) => self.strike(point, impulse),
                Act::SetInput(input_number, value) => self.stage.simulation.set_input(input_number, value),
            };
            self.send_event(if has_acted {
                EventKind::Acted(ticket)
            } else {
                EventKind::Missed(ticket)
            });
        }
        self.acts.clear();
    }

    fn strike(&mut self, point: u32, impulse: f64) -> bool {
        let is_struck = self.stage.simulation.strike(point, impulse);
        if is_struck && self.stage.is_seen {
            (self.new_strikes).add(self.stage.simulation.frame(), point, impulse);
        }
        is_struck
    }
}
