//! What the physics thread does in a tick. Nothing here allocates, locks or fails.

pub(super) mod change;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use ergon_engine::mix::glide::Glide;
use rtrb::{Consumer, Producer};

use super::clock::Clock;
use super::control::SharedFlags;
use super::frozen::Frozen;
use super::guidance::GuidanceState;
use super::hand::Mover;
use super::scale::Scale;
use super::status::{Event, EventKind, HANDS_MAX, Status};
use super::{Command, Hand, HandLimit, Slot, Stage};
use crate::audio::{Feed, Shared, Tap};
use crate::recording::{self, RowSink, flag};
use crate::safety;
use change::{SCHEDULED_MAX, ScheduledChange};

/// The load is averaged over this time [s].
const AVERAGE: f64 = 1.0;
/// Peaks fall by half within about this time [s].
const PEAKS: f64 = 0.3;
/// A tick is late when it begins so much of its length after it was due.
const LATE: f64 = 0.5;
/// Strikes in one tick.
const STRIKES_MAX: usize = 256;
/// Without keys on a clock, ticks wait at most so long for room in the ring: the card may be gone for good.
const PATIENCE: Duration = Duration::from_secs(5);

/// Ends of everything that is shared with other threads.
pub(super) struct Connections {
    pub(super) flags: Arc<SharedFlags>,
    pub(super) commands: Consumer<Command>,
    pub(super) events: Producer<Event>,
    pub(super) status: triple_buffer::Input<Status>,
    pub(super) feed: Feed,
    pub(super) record: Option<RowSink>,
    pub(super) frozen: Option<Frozen>,
    pub(super) shared: Arc<Shared>,
    pub(super) garbage: Producer<Box<ScheduledChange>>,
}

/// All that plays.
pub(super) struct Player {
    pub(super) stage: Stage,
    pub(super) gain: Glide,
    pub(super) slots: Vec<Slot>,
    pub(super) links: Connections,
    /// Changes that are not due yet, by rising frame.
    #[allow(clippy::vec_box)]
    // each goes back in the box that it came in: to open it would free that
    pub(super) waiting: Vec<Box<ScheduledChange>>,
    /// Writes what is heard into a file.
    tap: Option<Tap>,
    /// Strikes of this tick: ticket, point, impulse [N·s].
    strikes: Vec<(u64, u32, f64)>,
    clock: Clock,
    pub(super) movers: Vec<Mover>,
    pub(super) guidance: Vec<GuidanceState>,
    pub(super) scales: Vec<Scale>,
    /// Where each hand's key was in the tick before: its speed is taken from that.
    before: Vec<f64>,
    felt: Vec<f64>,
    /// Which slot and axis each hand has.
    pub(super) of: Vec<Option<(usize, usize)>>,
    /// The tick from which a keyboard that came back plays again.
    waits: Vec<Option<u64>>,
    rows: Vec<recording::Sample>,
    pub(super) heard: Vec<f64>,
    mixed: Vec<f64>,
    single: Vec<f32>,
    /// Frames of the limiter's delay that are still to be left out.
    ahead: usize,
    /// Frames that follow the last of the piece: what the limiter still holds.
    tail: usize,
    pub(super) tick: u64,
    pub(super) frame: u64,
    status: Status,
    panicked: bool,
    /// By a clock: the card's, or the keys'.
    paced: bool,
    /// Where the keys are in this tick is known already.
    looked: bool,
}

impl Player {
    pub(super) fn new(
        mut stage: Stage,
        slots: Vec<Slot>,
        links: Connections,
        clock: Clock,
        paced: bool,
        hand_limits: &[HandLimit],
    ) -> Self {
        let n = stage.hands.len();
        let period = stage.every as f64 / stage.simulation.rate();
        let guidance = |hand: &Hand| GuidanceState::new(hand.guidance, period);
        let guidance = stage.hands.iter().map(guidance).collect();
        let mut scales = vec![Scale::new(1.0, period); n];
        for one in hand_limits {
            scales[one.hand] = Scale::new(one.scale, period);
        }
        let mut of = vec![None; n];
        for (slot, own) in slots.iter().enumerate() {
            for &(axis, hand) in &own.axes {
                of[hand] = Some((slot, axis));
            }
        }
        stage.mixer.seek(stage.simulation.frame());
        let latency = stage.limiter.latency();
        let (every, n_out) = (stage.every, stage.simulation.n_out());
        let channels = stage.mixer.n_channels();
        let status = Status {
            frame: stage.simulation.frame(),
            ..Status::default()
        };
        Self {
            gain: Glide::new(stage.simulation.rate(), stage.gain),
            movers: vec![Mover::default(); n],
            guidance,
            scales,
            before: vec![0.0; n],
            felt: vec![0.0; n],
            of,
            waits: vec![None; slots.len()],
            rows: vec![recording::Sample::default(); n],
            heard: vec![0.0; every * n_out],
            mixed: vec![0.0; every * channels],
            single: vec![0.0; every * channels],
            ahead: latency,
            tail: latency,
            tick: stage.simulation.frame() / every as u64,
            frame: stage.simulation.frame(),
            status,
            panicked: false,
            paced,
            looked: false,
            waiting: Vec::with_capacity(SCHEDULED_MAX),
            strikes: Vec::with_capacity(STRIKES_MAX),
            tap: None,
            stage,
            slots,
            links,
            clock,
        }
    }

    /// Play to the end.
    pub(super) fn run(&mut self) {
        self.begin();
        loop {
            let is_over = self.links.flags.stop.load(Ordering::Acquire);
            if is_over || !self.tick() {
                break;
            }
        }
        for slot in &mut self.slots {
            slot.stop(true);
        }
        self.tell(EventKind::Ended);
        self.links.status.write(self.status);
        self.links.feed.close();
    }

    /// Hands where they are, before the first force.
    pub(super) fn begin(&mut self) {
        self.looked = true;
        self.positions();
        for slot in self.slots.iter().filter(|slot| slot.is_there()) {
            for &(axis, hand) in &slot.axes {
                let x = slot.sample.position[axis];
                let mover = &mut self.movers[hand];
                if self.tick == 0 {
                    (mover.real, mover.x) = (true, x);
                } else {
                    // In the middle of a piece the key is where its part has taken it.
                    mover.x = self.stage.hands[hand].stands_at(self.tick);
                    mover.change(true, x);
                }
                self.before[hand] = mover.x;
            }
        }
    }

    /// One tick; false once the piece is over.
    pub(super) fn tick(&mut self) -> bool {
        let left = match self.stage.n_frames {
            Some(n_frames) => n_frames.saturating_sub(self.frame),
            None => u64::MAX,
        };
        if left == 0 && self.tail == 0 {
            return false;
        }
        let playing = self.links.shared.played() > 0;
        let beat = self.clock.tick(self.links.feed.filled(), playing);
        let began = Instant::now();
        self.count(beat.late, beat.lost);
        safety::look_for_signals();
        self.commands();
        self.changes();
        self.strike();
        self.scale();
        self.guidance
            .iter_mut()
            .for_each(|guidance| guidance.tick(self.tick));
        let n = (self.stage.every as u64).min(left) as usize;
        if n > 0 {
            self.keys();
            self.hands();
            self.step(n);
            self.watch();
            self.record();
        } else {
            // What the limiter still holds is heard; nobody's hand moves anything any more.
            self.slots.iter_mut().for_each(|slot| slot.stop(true));
            self.step(0);
        }
        self.load(began.elapsed());
        self.links.status.write(self.status);
        self.feed(
            if n == 0 {
                self.stage.every.min(self.tail)
            } else {
                n
            },
            n == 0,
        );
        true
    }

    fn count(&mut self, late: Duration, lost: bool) {
        let status = &mut self.status;
        status.late += u64::from(late.as_secs_f64() > LATE * self.clock.period());
        status.latest = status.latest.max(late);
        if lost {
            status.lost += 1;
            self.tell(EventKind::Lost(late));
        }
    }

    fn commands(&mut self) {
        while let Ok(command) = self.links.commands.pop() {
            match command {
                Command::Gain(gain) => {
                    self.gain.set(gain);
                    self.note(format_args!("{{\"gain\":{gain}}}"));
                }
                Command::Part(part, gain) => {
                    self.stage.mixer.set_gain(part, gain);
                    self.note(format_args!("{{\"part\":{part},\"gain\":{gain}}}"));
                }
                Command::Change(due) => self.wait_for(due),
                Command::Tap(tap) => self.tap = tap,
                Command::Strike(ticket, ..) if self.strikes.len() == STRIKES_MAX => {
                    self.tell(EventKind::Missed(ticket));
                }
                Command::Strike(ticket, point, impulse) => {
                    self.strikes.push((ticket, point, impulse));
                }
                Command::Keys(slot, guarded) => {
                    self.slots[slot].comes_back(guarded);
                    self.slots[slot].stop(self.panicked);
                    self.waits[slot] = Some(self.next_bar());
                    self.tell(EventKind::Back(slot));
                }
            }
        }
        let panicked = self.links.flags.panic.load(Ordering::Acquire);
        if panicked != self.panicked {
            self.panicked = panicked;
            self.slots.iter_mut().for_each(|slot| slot.stop(panicked));
            self.note(format_args!("{{\"panic\":{panicked}}}"));
        }
        if self.links.flags.release.swap(false, Ordering::AcqRel) {
            self.slots.iter_mut().for_each(Slot::release);
        }
    }

    /// Strike what plays from this frame on: the simulation that took over at it, if one did.
    fn strike(&mut self) {
        for at in 0..self.strikes.len() {
            let (ticket, point, impulse) = self.strikes[at];
            let is_struck = self.stage.simulation.strike(point, impulse);
            self.tell(if is_struck {
                EventKind::Struck(ticket)
            } else {
                EventKind::Missed(ticket)
            });
        }
        self.strikes.clear();
    }

    /// The first tick of the next bar; where there is none, the next tick.
    fn next_bar(&self) -> u64 {
        let bars = &self.stage.bars;
        let next = bars.partition_point(|&bar| bar < self.frame);
        let frame = bars.get(next).copied().unwrap_or(self.frame);
        frame.div_ceil(self.stage.every as u64)
    }

    /// Forces of the tick before go out, positions come in: in the first tick they did.
    fn keys(&mut self) {
        if std::mem::take(&mut self.looked) {
            return;
        }
        let rate = 1.0 / self.clock.period();
        for hand in 0..self.movers.len() {
            let Some((slot, axis)) = self.of[hand] else {
                continue;
            };
            let (own, mover) = (&self.stage.hands[hand], &self.movers[hand]);
            let force = if mover.real {
                let v = (mover.x - self.before[hand]) * rate;
                let guidance = self.guidance[hand].force(own.stands_at(self.tick), mover.x, v);
                (self.felt[hand] + guidance) * mover.share()
            } else {
                0.0
            };
            self.slots[slot].force(axis, force);
        }
        for slot in 0..self.slots.len() {
            let there = self.slots[slot].send();
            self.met(slot, there);
        }
        self.positions();
    }

    /// Positions of all keyboards, which were asked together.
    fn positions(&mut self) {
        let Some(deadline) = self.slots.first().map(Slot::deadline) else {
            return;
        };
        for slot in 0..self.slots.len() {
            let there = self.slots[slot].look(deadline);
            self.met(slot, there);
        }
    }

    /// A keyboard was asked; one that is not there any more has its hands stood in for.
    fn met(&mut self, slot: usize, there: bool) {
        if there {
            return;
        }
        self.tell(EventKind::Gone(slot));
        self.waits[slot] = None;
        for at in 0..self.slots[slot].axes.len() {
            let (_, hand) = self.slots[slot].axes[at];
            let x = self.stage.hands[hand].stands_at(self.tick);
            self.movers[hand].change(false, x);
        }
    }

    /// Where every hand is in this tick.
    fn hands(&mut self) {
        for slot in 0..self.slots.len() {
            if self.waits[slot].is_none_or(|tick| self.tick < tick) || !self.slots[slot].is_there()
            {
                continue;
            }
            self.waits[slot] = None;
            for at in 0..self.slots[slot].axes.len() {
                let (axis, hand) = self.slots[slot].axes[at];
                let x = self.slots[slot].sample.position[axis];
                self.movers[hand].change(true, x);
                self.tell(EventKind::TookOver(hand));
            }
        }
        for (hand, own) in self.stage.hands.iter().enumerate() {
            let mover = &mut self.movers[hand];
            self.before[hand] = mover.x;
            let x = match self.of[hand] {
                Some((slot, axis)) if mover.real => self.slots[slot].sample.position[axis],
                _ => own.stands_at(self.tick),
            };
            let x = mover.follow(x);
            self.stage.simulation.hold(hand, x * own.reach, None);
        }
    }

    /// The frames of the tick, mixed and limited.
    fn step(&mut self, n: usize) {
        let stage = &mut self.stage;
        let channels = stage.mixer.n_channels();
        let n_out = stage.simulation.n_out();
        if n > 0 {
            let heard = &mut self.heard[..n * n_out];
            let mixed = &mut self.mixed[..n * channels];
            // Faults are muted, part by part: nothing is returned.
            let _ = if n_out == 0 {
                stage.simulation.skip(n as u64)
            } else {
                stage.simulation.process(heard)
            };
            if let Some(frozen) = &mut self.links.frozen {
                // Where no clock presses, the disk is waited for.
                let asked = Instant::now();
                let is_there = |frozen: &Frozen| frozen.is_ready(self.frame, n);
                let is_over = || self.links.flags.stop.load(Ordering::Acquire);
                while !self.paced && !is_there(frozen) && asked.elapsed() < PATIENCE && !is_over() {
                    self.clock.nap();
                }
                self.status.missed += frozen.join(heard, n_out, self.frame);
            }
            stage.mixer.process(heard, mixed);
            self.gain.apply(self.frame, mixed, channels);
            stage.limiter.process(mixed);
        } else {
            let n = stage.every.min(self.tail);
            let mixed = &mut self.mixed[..n * channels];
            mixed.fill(0.0);
            stage.limiter.process(mixed);
        }
        for (hand, own) in stage.hands.iter().enumerate() {
            self.felt[hand] = stage.simulation.felt(hand) * own.reach;
        }
        self.tick += 1;
        self.frame += n as u64;
    }

    /// Frames to the card, without those of the limiter's delay.
    fn feed(&mut self, n: usize, is_tail: bool) {
        let channels = self.stage.mixer.n_channels();
        let skip = self.ahead.min(n);
        let behind = (self.stage.limiter.latency() - self.ahead) as u64;
        self.ahead -= skip;
        if is_tail {
            self.tail -= n;
        }
        for (single, x) in self.single.iter_mut().zip(&self.mixed[..n * channels]) {
            *single = *x as f32;
        }
        let falls = (1.0 - self.clock.period() / PEAKS).max(0.0) as f32;
        self.status.peaks.iter_mut().for_each(|peak| *peak *= falls);
        if self.panicked {
            // Nothing of it is heard.
            self.status.peaks.fill(0.0);
        }
        let heard = if self.panicked { 0 } else { n };
        for frame in self.single[..heard * channels].chunks_exact(channels) {
            for (peak, x) in self.status.peaks.iter_mut().zip(frame) {
                *peak = peak.max(x.abs());
            }
        }
        let mut rest = &self.single[skip * channels..n * channels];
        if let Some(tap) = &mut self.tap {
            let at = self.frame.saturating_sub(n as u64 + behind);
            tap.push(at, rest, self.panicked);
        }
        let asked = Instant::now();
        loop {
            let taken = self.links.feed.push(rest);
            rest = &rest[taken * channels..];
            let is_over = self.links.flags.stop.load(Ordering::Acquire);
            if rest.is_empty() || is_over {
                break;
            }
            // Who has a hand on a key is not kept waiting by a card.
            if self.clock.is_by_keys() || asked.elapsed() > PATIENCE {
                self.status.dropped += (rest.len() / channels) as u64;
                break;
            }
            self.clock.nap();
        }
    }

    fn record(&mut self) {
        let Some(sink) = &mut self.links.record else {
            return;
        };
        for (hand, row) in self.rows.iter_mut().enumerate() {
            let status = self.status.hands.get(hand).copied().unwrap_or_default();
            let sample = self.of[hand].map(|(slot, axis)| (&self.slots[slot].sample, axis));
            let flags = [
                (flag::FRESH, sample.is_some_and(|(sample, _)| sample.fresh)),
                (flag::TOUCH, status.touch),
                (flag::FORCE_ENABLED, status.enabled),
                (flag::STAND_IN, !status.real),
                (flag::TRIPPED, status.tripped),
            ];
            *row = recording::Sample {
                position: self.movers[hand].x,
                force: self.felt[hand],
                sent: status.sent as f32,
                flags: flags
                    .iter()
                    .filter(|(_, is)| *is)
                    .map(|(flag, _)| flag)
                    .sum(),
                clock: sample.and_then(|(sample, _)| sample.t_dev_us).unwrap_or(0),
            };
        }
        // Where no clock presses, the disk is waited for.
        let asked = Instant::now();
        let is_over = || self.links.flags.stop.load(Ordering::Acquire);
        while !self.paced && !sink.has_room() && asked.elapsed() < PATIENCE && !is_over() {
            self.clock.nap();
        }
        if !self.rows.is_empty() {
            sink.row(self.tick - 1, &self.rows);
        }
    }

    fn load(&mut self, took: Duration) {
        let period = self.clock.period();
        let load = took.as_secs_f64() / period;
        let status = &mut self.status;
        status.load += (load - status.load) * (period / AVERAGE).min(1.0);
        status.busiest = status.busiest.max(load);
        (status.frame, status.ticks) = (self.frame, status.ticks + 1);
        let muted = self.stage.simulation.n_muted() as u32;
        let is_new = muted > status.muted;
        status.muted = muted;
        status.filled = self.links.feed.filled();
        if is_new {
            self.tell(EventKind::Muted);
        }
        let finer = self.stage.simulation.n_finer() as u32;
        let is_new = finer > self.status.finer;
        self.status.finer = finer;
        if is_new {
            self.tell(EventKind::Finer);
        }
    }

    /// What is to be told of every hand.
    fn watch(&mut self) {
        for (hand, mover) in self.movers.iter().enumerate().take(HANDS_MAX) {
            let own = &mut self.status.hands[hand];
            (own.position, own.force, own.real) = (mover.x, self.felt[hand], mover.real);
            let Some((slot, axis)) = self.of[hand] else {
                continue;
            };
            let slot = &self.slots[slot];
            own.sent = slot.sent[axis];
            own.scale = self.scales[hand].now();
            own.touch = mover.real && slot.sample.touch[axis];
            own.enabled = mover.real && slot.sample.force_enabled[axis];
            own.hot = mover.real && slot.sample.hot;
            [own.let_go, own.stalls] = slot.interruptions();
            let trip = slot.tripped(axis);
            if let Some(why) = trip.filter(|_| !own.tripped) {
                let event = Event {
                    frame: self.frame,
                    kind: EventKind::Tripped(hand, why),
                };
                let _ = self.links.events.push(event);
            }
            own.tripped = trip.is_some();
        }
    }

    /// Something happened; where nobody listens it is lost.
    pub(super) fn tell(&mut self, kind: EventKind) {
        let frame = self.frame;
        let _ = self.links.events.push(Event { frame, kind });
    }

    /// Something was consumed besides positions.
    pub(super) fn note(&mut self, line: std::fmt::Arguments<'_>) {
        if let Some(sink) = &mut self.links.record {
            sink.event(self.tick, line);
        }
    }
}
