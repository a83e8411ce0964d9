//! The one thread that owns all physics while it is played: keys on one side of it, the sound card on the other.
//!
//! In every tick it exchanges forces and positions with the keys, steps the network for the frames of the tick, and
//! pushes their sound into the ring. Keys have the first say in when a tick begins, the sound card has the last:
//! their clock is steered by how full the ring is. Without keys on a clock of their own the ring alone says when.

mod clock;
mod control;
mod error;
mod frozen;
mod guidance;
mod hand;
mod hand_limit;
mod keys;
mod player;
mod scale;
mod status;

pub use control::Control;
pub use error::{ChangeError, PlayError};
pub use frozen::Stem;
pub use guidance::{Guidance, GuidanceShare, GuidanceStep};
pub use hand::Hand;
pub use hand_limit::{HandKey, HandLimit, SCALE_MIN};
pub use keys::{DeviceConfig, Keyboard, Slot};
pub use player::change::Change;
pub use scale::{Bound, FALL_TIME};
use status::HANDS_MAX;
pub use status::{Event, EventKind, HandStatus, Status};

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::Duration;

use ergon_engine::mix::limiter::Limiter;
use ergon_engine::mix::mixer::Mixer;
use ergon_engine::simulation::Simulation;
use rtrb::{Consumer, Producer, RingBuffer};

use crate::audio::{self, AudioError, Output};
use crate::realtime::{self, Granted};
use crate::recording::{Header, Recorder, RecorderHandle};
use crate::safety::{self, Guarded};
use control::{MarkDone, SharedFlags};
use player::Player;
use player::change::{SCHEDULED_MAX, ScheduledChange};

/// Frames that the ring holds ahead of the card: two of its blocks, and enough for a machine that is no
/// real-time machine.
const AHEAD: usize = 1_024;
/// Things that may happen before anybody asks what did.
const EVENTS: usize = 4_096;
const COMMANDS: usize = 256;

/// What is to be played.
pub struct Stage {
    /// What moves, at its first frame to be heard.
    pub simulation: Simulation,
    /// Outputs to channels.
    pub mixer: Mixer,
    /// After the mixer, before the limiter.
    pub gain: f64,
    /// The last thing before the loudspeakers.
    pub limiter: Limiter,
    /// Frames to play; `None`: until it is stopped.
    pub n_frames: Option<u64>,
    /// Frames of a tick.
    pub every: usize,
    /// Real hands, in the order of the simulation's.
    pub hands: Vec<Hand>,
    /// Frames at which a bar begins, rising: where a hand that comes back takes over.
    pub bars: Vec<u64>,
    /// Outputs that were computed before: the simulation leaves them at 0.
    pub frozen: Vec<Stem>,
}

/// How it is to be played.
#[derive(Debug)]
pub struct PlaybackConfig {
    /// Where the sound goes.
    pub audio: audio::Spec,
    /// Frames ahead of the card, if not two of its blocks.
    pub ahead: Option<usize>,
    /// A recording of the hands, and what stands at its beginning.
    pub record: Option<(PathBuf, Header)>,
}

/// Something that is asked of the physics thread.
pub(crate) enum Command {
    /// Another gain.
    Gain(f64),
    /// Another gain of a group of routes.
    Part(usize, f64),
    /// What is heard goes into a file too, or no longer.
    Tap(Option<audio::Tap>),
    /// A strike: its ticket, the point, the impulse [N·s].
    Strike(u64, u32, f64),
    /// A keyboard that came back.
    Keys(usize, Box<Guarded>),
    /// Another version.
    Change(Box<ScheduledChange>),
}

/// A piece that is being played. Dropped, it stops.
pub struct Performance {
    flags: Arc<SharedFlags>,
    thread: Option<JoinHandle<Player>>,
    reconnectors: Vec<keys::Reconnector>,
    commands: Arc<std::sync::Mutex<Producer<Command>>>,
    status: triple_buffer::Output<Status>,
    events: Consumer<Event>,
    output: Output,
    recorder: Option<RecorderHandle>,
    reader: Option<frozen::Reader>,
    hand_limits: Vec<HandLimit>,
    hand_keys: Vec<HandKey>,
    garbage: Consumer<Box<ScheduledChange>>,
    tickets: u64,
    tap: Option<audio::TapHandle>,
    /// Frames of a tick, channels, and outputs where prepared parts fill some of them.
    every: usize,
    channels: usize,
    frozen: Option<usize>,
}

impl Performance {
    /// Begin.
    ///
    /// # Errors
    /// [`PlayError`] says what is missing; nothing sounds then, and no force was sent.
    pub fn start(
        stage: Stage,
        boards: Vec<Keyboard>,
        config: PlaybackConfig,
    ) -> Result<Self, PlayError> {
        let (mut this, mut player) = Self::prepare(stage, boards, config)?;
        // Without a hand too: what sounds ends by a signal as soon.
        safety::watch_ends();
        let flags = this.flags.clone();
        let thread = std::thread::Builder::new()
            .name("ergon physics".into())
            .spawn(move || {
                let _mark = MarkDone(flags.clone());
                safety::leave_signals();
                flags.set_granted(realtime::ask(realtime::PHYSICS));
                player.run();
                // Given back to be freed where time does not count.
                player
            })
            .map_err(PlayError::Thread)?;
        this.thread = Some(thread);
        Ok(this)
    }

    /// All but the thread that plays.
    fn prepare(
        mut stage: Stage,
        boards: Vec<Keyboard>,
        config: PlaybackConfig,
    ) -> Result<(Self, Player), PlayError> {
        let rate = stage.simulation.rate();
        let channels = stage.mixer.n_channels();
        if !(1..=audio::CHANNELS_MAX).contains(&channels) {
            let why = format!("an output has 1 to {}", audio::CHANNELS_MAX);
            return Err(AudioError::Channels { channels, why }.into());
        }
        if stage.hands.len() > HANDS_MAX {
            return Err(PlayError::Hands(stage.hands.len()));
        }
        let hand_keys: Vec<HandKey> = boards
            .iter()
            .flat_map(|board| HandKey::all(board, &stage.hands))
            .collect();
        let limit = |key: &HandKey| key.limit(&stage.hands[key.hand].response);
        let hand_limits: Vec<HandLimit> = hand_keys.iter().map(limit).collect();
        if let Some(stiff) = hand_limits.iter().find(|limit| limit.scale < SCALE_MIN) {
            return Err(PlayError::Stiff {
                hand: stiff.hand,
                stiffness: stiff.stiffness,
                limit: stiff.limit,
            });
        }
        let block = config.audio.block.unwrap_or(0) as usize;
        let ahead = config
            .ahead
            .unwrap_or(AHEAD)
            .max(2 * stage.every.max(block));
        let (feed, drain) = audio::ring(channels, 4 * ahead);
        feed.set_prefill(ahead);
        let stems = std::mem::take(&mut stage.frozen);
        let (frozen, reader) = if stems.is_empty() {
            (None, None)
        } else {
            let (frozen, reader) = frozen::open(stems, stage.simulation.frame())
                .map_err(|(path, error)| PlayError::Frozen { path, error })?;
            (Some(frozen), Some(reader))
        };
        let output = audio::open(&config.audio, rate as u32, channels, drain)?;
        let info = output.info();
        if info.paced && info.block as usize > 2 * ahead {
            let why = format!(
                "the output takes {} frames at a time: --ahead must be at least {}",
                info.block,
                2 * info.block
            );
            return Err(AudioError::Broken(why).into());
        }
        // Last of all: what cannot begin leaves no file.
        let (sink, recorder) = match &config.record {
            Some((path, header)) => {
                let (sink, handle) = Recorder::start(path, header)?;
                (Some(sink), Some(handle))
            }
            None => (None, None),
        };
        let (to_commands, from_commands) = RingBuffer::new(COMMANDS);
        let (to_events, events) = RingBuffer::new(EVENTS);
        let (to_garbage, garbage) = RingBuffer::new(2 * SCHEDULED_MAX);
        let (to_status, status) = triple_buffer::triple_buffer(&Status::default());
        let flags = Arc::new(SharedFlags::default());
        let commands = Arc::new(std::sync::Mutex::new(to_commands));
        let mut reconnectors = Vec::new();
        let slots: Vec<Slot> = boards
            .into_iter()
            .enumerate()
            .map(|(index, board)| {
                let (slot, reconnector) = board.split(index, commands.clone());
                reconnectors.push(reconnector);
                slot
            })
            .collect();
        let links = player::Connections {
            flags: flags.clone(),
            commands: from_commands,
            events: to_events,
            status: to_status,
            feed,
            record: sink,
            frozen,
            shared: output.shared().clone(),
            garbage: to_garbage,
        };
        let by_keys = slots.iter().any(Slot::is_on_the_clock);
        let clock = clock::Clock::new(
            stage.every as f64 / rate,
            ahead.max(2 * info.block as usize),
            by_keys,
            info.paced,
        );
        let every = stage.every;
        let frozen = reader.is_some().then(|| stage.simulation.n_out());
        let player = Player::new(
            stage,
            slots,
            links,
            clock,
            info.paced || by_keys,
            &hand_limits,
        );
        let this = Self {
            flags,
            thread: None,
            reconnectors,
            commands,
            status,
            events,
            output,
            recorder,
            reader,
            hand_limits,
            hand_keys,
            garbage,
            tickets: 0,
            tap: None,
            every,
            channels,
            frozen,
        };
        Ok((this, player))
    }

    /// How it goes now.
    pub fn status(&mut self) -> Status {
        *self.status.read()
    }

    /// The next thing that happened.
    pub fn event(&mut self) -> Option<Event> {
        self.events.pop().ok()
    }

    /// How much of the scene's force each real hand may get.
    pub fn hand_limits(&self) -> &[HandLimit] {
        &self.hand_limits
    }

    /// The key under a hand, to compute limits of another scene; `None`: the hand is not real.
    pub fn hand_key(&self, hand: usize) -> Option<HandKey> {
        self.hand_keys.iter().find(|own| own.hand == hand).copied()
    }

    /// The output that it plays on.
    pub fn output(&self) -> &Output {
        &self.output
    }

    /// What the system granted the physics thread; `None` until it runs.
    pub fn granted(&self) -> Option<Granted> {
        self.flags.granted()
    }

    /// What stops it from any thread.
    pub fn control(&self) -> Control {
        Control::new(self.flags.clone(), self.output.shared().clone())
    }

    /// See [`Control::panic`].
    pub fn panic(&self) {
        self.control().panic();
    }

    /// See [`Control::release`].
    pub fn release(&self) {
        self.control().release();
    }

    /// Go to another gain over 20 ms, from the next tick on; false where too much is asked at once.
    pub fn gain(&self, gain: f64) -> bool {
        self.command(Command::Gain(gain))
    }

    /// Another gain of one of the mixer's groups of routes, as [`Performance::gain`].
    pub fn part_gain(&self, group: usize, gain: f64) -> bool {
        self.command(Command::Part(group, gain))
    }

    /// Write what is computed for the loudspeakers to a new file, from the next tick on.
    ///
    /// # Errors
    /// [`AudioError`] where one is being written, or the file cannot be made.
    pub fn record_audio(&mut self, path: &Path) -> Result<(), AudioError> {
        if self.tap.as_ref().is_some_and(|tap| !tap.status().ended) {
            return Err(AudioError::Broken(
                "a file is being recorded already".into(),
            ));
        }
        let rate = self.output.info().rate;
        let (tap, handle) = audio::tap(path, rate, self.channels)?;
        if !self.command(Command::Tap(Some(tap))) {
            return Err(AudioError::Broken("too much is asked at once".into()));
        }
        self.tap = Some(handle);
        Ok(())
    }

    /// End the file of [`Performance::record_audio`]; false where too much is asked at once.
    pub fn end_audio(&self) -> bool {
        self.command(Command::Tap(None))
    }

    /// How the file of [`Performance::record_audio`] goes; `None`: there was none.
    pub fn audio_recorded(&self) -> Option<audio::TapStatus> {
        self.tap.as_ref().map(audio::TapHandle::status)
    }

    /// Strike a point of the simulation that plays, at the first frame of the next tick; a ticket, which
    /// [`EventKind::Struck`] or [`EventKind::Missed`] tells. `None` where too much is asked at once.
    pub fn strike(&mut self, point: u32, impulse: f64) -> Option<u64> {
        self.tickets += 1;
        let ticket = self.tickets;
        self.command(Command::Strike(ticket, point, impulse))
            .then_some(ticket)
    }

    /// Change something at a frame that begins a tick; returns a ticket, which [`EventKind::Changed`] or [`EventKind::Late`] tells.
    ///
    /// # Errors
    /// [`ChangeError`]: nothing was asked for then.
    pub fn change(&mut self, at: u64, change: Change) -> Result<u64, ChangeError> {
        // What was replaced before is freed here.
        while self.garbage.pop().is_ok() {}
        if !at.is_multiple_of(self.every as u64) {
            return Err(ChangeError::Frame(at, self.every));
        }
        let n_out = change
            .simulation
            .as_ref()
            .map(|(own, _)| (own.n_out(), own.frame()));
        if let Some((n_out, frame)) = n_out {
            if frame != at {
                return Err(ChangeError::Begins(frame, at));
            }
            if self.frozen.is_some_and(|frozen| frozen != n_out) {
                return Err(ChangeError::Frozen);
            }
        }
        if change
            .mixer
            .as_ref()
            .is_some_and(|mixer| mixer.n_channels() != self.channels)
        {
            return Err(ChangeError::Channels(self.channels));
        }
        let heard = vec![0.0; n_out.map_or(0, |(n_out, _)| n_out * self.every)];
        self.tickets += 1;
        let ticket = self.tickets;
        let due = ScheduledChange {
            at,
            ticket,
            change,
            heard,
        };
        if self.command(Command::Change(Box::new(due))) {
            Ok(ticket)
        } else {
            Err(ChangeError::Busy)
        }
    }

    fn command(&self, command: Command) -> bool {
        let mut commands = self
            .commands
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        commands.push(command).is_ok()
    }

    /// See [`Control::stop`].
    pub fn stop(&self) {
        self.control().stop();
    }

    /// Whether the last frame has been computed.
    pub fn is_done(&self) -> bool {
        self.flags.done.load(Ordering::Acquire)
    }

    /// Why the recording cannot be written at present, such as a full disk; its rows wait meanwhile, for some seconds. Or
    /// how much of it was lost, for the disk did not answer for longer.
    pub fn recording_trouble(&self) -> Option<String> {
        let status = self.recorder.as_ref()?.status();
        let lost = || (status.dropped > 0).then(|| format!("{} rows lost", status.dropped));
        status.trouble.clone().or_else(lost)
    }

    /// Wait until everything was heard, and put everything away; the events that are left.
    ///
    /// # Errors
    /// What went wrong with a file that was written.
    pub fn close(mut self, patience: Duration) -> Result<Vec<Event>, PlayError> {
        self.end(patience)?;
        Ok(std::iter::from_fn(|| self.event()).collect())
    }

    fn end(&mut self, patience: Duration) -> Result<(), PlayError> {
        // Keys first: their last zeros go out when the physics thread gives them back.
        let played = self.thread.take().map_or(Ok(()), |thread| {
            thread.join().map(drop).map_err(|_| PlayError::Failed)
        });
        self.reconnectors.clear();
        self.reader = None;
        let _ = self.output.wait(patience);
        let closed = self.output.close();
        self.tap = None;
        let recorded = self.recorder.take().map(RecorderHandle::stop);
        played?;
        closed?;
        recorded.transpose()?;
        Ok(())
    }
}

impl Drop for Performance {
    fn drop(&mut self) {
        self.stop();
        let _ = self.end(Duration::from_millis(200));
    }
}

#[cfg(test)]
mod tests;
