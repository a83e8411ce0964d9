//! The one thread that owns all physics while it is played: keys on one side of it, the sound card on the other.
//!
//! In every tick it exchanges forces and positions with the keys, steps the network for the frames of the tick, and
//! pushes their sound into the ring. Keys have the first say in when a tick begins, the sound card has the last:
//! their clock is steered by how full the ring is. Without keys on a clock of their own the ring alone says when.

mod bearer;
mod change;
mod clock;
mod frozen;
mod hand;
mod keys;
mod lead;
mod player;
mod scale;
mod status;

pub use bearer::{Bearer, Borne, LEAST};
pub use change::Change;
pub use frozen::Stem;
pub use hand::Hand;
pub use keys::{Keyboard, Known, Slot};
pub use lead::{Guide, Share, Step};
pub use scale::Bound;
use status::HANDS_MAX;
pub use status::{Event, HandStatus, Status, What};

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use ergon_engine::mix::limiter::Limiter;
use ergon_engine::mix::mixer::Mixer;
use ergon_engine::simulation::Simulation;
use rtrb::{Consumer, Producer, RingBuffer};

use crate::audio::{self, AudioError, Output};
use crate::device::DeviceError;
use crate::realtime::{self, Granted};
use crate::recording::{Header, Recorder, RecorderHandle, RecordingError};
use crate::safety::{self, Guarded};
use crate::stop;
use player::Player;

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
pub struct How {
    /// Where the sound goes.
    pub audio: audio::Spec,
    /// Frames ahead of the card, if not two of its blocks.
    pub ahead: Option<usize>,
    /// A recording of the hands, and what stands at its beginning.
    pub record: Option<(PathBuf, Header)>,
}

/// Why nothing can be played.
#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    /// The sound.
    #[error(transparent)]
    Audio(#[from] AudioError),
    /// A key.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The recording.
    #[error("the recording cannot be written: {0}")]
    Recording(#[from] RecordingError),
    /// A prepared part.
    #[error("{}: {error}", path.display())]
    Frozen {
        /// Its file.
        path: PathBuf,
        /// Why it cannot be read.
        error: std::io::Error,
    },
    /// The system refused a thread.
    #[error("no thread for the physics: {0}")]
    Thread(#[source] std::io::Error),
    /// The physics thread panicked: forces are zero, nothing sounds.
    #[error("the physics failed; this is a mistake in ergon")]
    Failed,
    /// More hands than are told of.
    #[error("{0} real hands: there can be {HANDS_MAX}")]
    Hands(usize),
    /// A scene that a key would swing up against.
    #[error(
        "hand {hand}: the scene is {stiffness:.0} N/m stiff there, and the device bears {limit:.0} N/m"
    )]
    Stiff {
        /// Which hand.
        hand: usize,
        /// What it would meet [N/m].
        stiffness: f64,
        /// What its device bears [N/m].
        limit: f64,
    },
}

/// Why a change cannot be asked for.
#[derive(Debug, thiserror::Error)]
pub enum ChangeError {
    /// Not the first frame of a tick.
    #[error("frame {0} begins no tick: ticks have {1} frames")]
    Frame(u64, usize),
    /// A simulation of another frame.
    #[error("the simulation begins at frame {0}, not at {1}")]
    Begins(u64, u64),
    /// Prepared parts fill outputs by their places.
    #[error("with prepared parts the outputs stay as many as they are")]
    Frozen,
    /// Another number of channels.
    #[error("the sound card was opened with {0} channels")]
    Channels(usize),
    /// Too much at once.
    #[error("too many changes at once")]
    Busy,
}

/// Something that is asked of the physics thread.
pub(crate) enum Command {
    /// Another gain.
    Gain(f64),
    /// Another gain of a group of routes.
    Part(usize, f64),
    /// A keyboard that came back.
    Keys(usize, Box<Guarded>),
    /// Another version.
    Change(Box<change::Due>),
}

/// What both sides may touch at any time.
#[derive(Debug, Default)]
pub(crate) struct Desk {
    /// Nothing more is to be played.
    stop: AtomicBool,
    /// Forces are zero, sound is silent.
    panic: AtomicBool,
    /// Axes that tripped may push again.
    again: AtomicBool,
    /// The last frame is out.
    done: AtomicBool,
    /// What the physics thread runs as: priority + 1, memory locked in the lowest bit.
    granted: AtomicU64,
}

/// A piece that is being played. Dropped, it stops.
pub struct Performance {
    desk: Arc<Desk>,
    thread: Option<JoinHandle<Player>>,
    seekers: Vec<keys::Seeker>,
    commands: Arc<std::sync::Mutex<Producer<Command>>>,
    status: triple_buffer::Output<Status>,
    events: Consumer<Event>,
    output: Output,
    recorder: Option<RecorderHandle>,
    reader: Option<frozen::Reader>,
    borne: Vec<Borne>,
    bearers: Vec<Bearer>,
    garbage: Consumer<Box<change::Due>>,
    tickets: u64,
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
    pub fn start(stage: Stage, boards: Vec<Keyboard>, how: How) -> Result<Self, PlayError> {
        let (mut this, mut player) = Self::prepare(stage, boards, how)?;
        // Without a hand too: what sounds ends by a signal as soon.
        safety::watch_ends();
        let own = this.desk.clone();
        let thread = std::thread::Builder::new()
            .name("ergon physics".into())
            .spawn(move || {
                let _done = Done(own.clone());
                safety::leave_signals();
                own.grant(realtime::ask(realtime::PHYSICS));
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
        how: How,
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
        let bearers: Vec<Bearer> = boards
            .iter()
            .flat_map(|board| Bearer::all(board, &stage.hands))
            .collect();
        let borne = |bearer: &Bearer| bearer.borne(&stage.hands[bearer.hand].response);
        let borne: Vec<Borne> = bearers.iter().map(borne).collect();
        if let Some(stiff) = borne.iter().find(|borne| borne.scale < LEAST) {
            return Err(PlayError::Stiff {
                hand: stiff.hand,
                stiffness: stiff.stiffness,
                limit: stiff.limit,
            });
        }
        let block = how.audio.block.unwrap_or(0) as usize;
        let ahead = how.ahead.unwrap_or(AHEAD).max(2 * stage.every.max(block));
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
        let output = audio::open(&how.audio, rate as u32, channels, drain)?;
        let info = output.info();
        if info.paced && info.block as usize > 2 * ahead {
            let why = format!(
                "it takes {} frames at a time: ask for --ahead {}",
                info.block,
                2 * info.block
            );
            return Err(AudioError::Broken(why).into());
        }
        // Last of all: what cannot begin leaves no file.
        let (sink, recorder) = match &how.record {
            Some((path, header)) => {
                let (sink, handle) = Recorder::start(path, header)?;
                (Some(sink), Some(handle))
            }
            None => (None, None),
        };
        let (to_commands, from_commands) = RingBuffer::new(COMMANDS);
        let (to_events, events) = RingBuffer::new(EVENTS);
        let (to_garbage, garbage) = RingBuffer::new(2 * change::WAITING);
        let (to_status, status) = triple_buffer::triple_buffer(&Status::default());
        let desk = Arc::new(Desk::default());
        let commands = Arc::new(std::sync::Mutex::new(to_commands));
        let mut seekers = Vec::new();
        let slots: Vec<Slot> = boards
            .into_iter()
            .enumerate()
            .map(|(index, board)| {
                let (slot, seeker) = board.split(index, commands.clone());
                seekers.push(seeker);
                slot
            })
            .collect();
        let links = player::Links {
            desk: desk.clone(),
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
        let player = Player::new(stage, slots, links, clock, info.paced || by_keys, &borne);
        let this = Self {
            desk,
            thread: None,
            seekers,
            commands,
            status,
            events,
            output,
            recorder,
            reader,
            borne,
            bearers,
            garbage,
            tickets: 0,
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

    /// How much of the scene's force each real hand gets.
    pub fn borne(&self) -> &[Borne] {
        &self.borne
    }

    /// The key under a hand, to find out beforehand what it bears; `None`: the hand is not real.
    pub fn bearer(&self, hand: usize) -> Option<Bearer> {
        self.bearers.iter().find(|own| own.hand == hand).copied()
    }

    /// The output that it plays on.
    pub fn output(&self) -> &Output {
        &self.output
    }

    /// What the system granted the physics thread; `None` until it runs.
    pub fn granted(&self) -> Option<Granted> {
        self.desk.granted()
    }

    /// What stops it from any thread.
    pub fn brake(&self) -> Brake {
        Brake {
            desk: self.desk.clone(),
            sound: self.output.shared().clone(),
        }
    }

    /// See [`Brake::panic`].
    pub fn panic(&self) {
        self.brake().panic();
    }

    /// See [`Brake::release`].
    pub fn release(&self) {
        self.brake().release();
    }

    /// Go to another gain over 20 ms, from the next tick on; false where too much is asked at once.
    pub fn gain(&self, gain: f64) -> bool {
        self.command(Command::Gain(gain))
    }

    /// Another gain of one of the mixer's groups of routes, as [`Performance::gain`].
    pub fn part_gain(&self, group: usize, gain: f64) -> bool {
        self.command(Command::Part(group, gain))
    }

    /// Change something at a frame that begins a tick; returns a ticket, which [`What::Changed`] or [`What::Late`] tells.
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
        let due = change::Due {
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

    /// See [`Brake::stop`].
    pub fn stop(&self) {
        self.brake().stop();
    }

    /// Whether the last frame has been computed.
    pub fn is_done(&self) -> bool {
        self.desk.done.load(Ordering::Acquire)
    }

    /// Why the recording cannot be written at present, such as a full disk; its rows wait meanwhile, for some seconds.
    pub fn recording_trouble(&self) -> Option<String> {
        self.recorder.as_ref()?.status().trouble
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
        self.seekers.clear();
        self.reader = None;
        let _ = self.output.wait(patience);
        let closed = self.output.close();
        let recorded = self.recorder.take().map(RecorderHandle::stop);
        played?;
        closed?;
        recorded.transpose()?;
        Ok(())
    }
}

/// What stops a performance from any thread, at once: it takes no lock and waits for nothing.
#[derive(Clone)]
pub struct Brake {
    desk: Arc<Desk>,
    sound: Arc<audio::Shared>,
}

impl Brake {
    /// Silence within 5 ms and zero force at the next tick; nothing comes back until [`Brake::release`].
    pub fn panic(&self) {
        self.desk.panic.store(true, Ordering::Release);
        self.sound.panic();
    }

    /// Sound and force again, after a panic, after [`stop::Stop::Forces`] and after a key tripped.
    pub fn release(&self) {
        stop::release();
        self.desk.panic.store(false, Ordering::Release);
        self.desk.again.store(true, Ordering::Release);
        self.sound.release();
    }

    /// Play nothing more: forces are zero, and what sounds ends in 5 ms.
    pub fn stop(&self) {
        self.desk.stop.store(true, Ordering::Release);
        self.sound.panic();
    }
}

/// Says that the physics is over, however it ended.
struct Done(Arc<Desk>);

impl Drop for Done {
    fn drop(&mut self) {
        self.0.done.store(true, Ordering::Release);
    }
}

impl Drop for Performance {
    fn drop(&mut self) {
        self.stop();
        let _ = self.end(Duration::from_millis(200));
    }
}

impl Desk {
    fn grant(&self, granted: Granted) {
        let priority = granted.fifo.map_or(0, |fifo| fifo as u64 + 1);
        let value = 4 | priority << 8 | u64::from(granted.locked);
        self.granted.store(value, Ordering::Release);
    }

    fn granted(&self) -> Option<Granted> {
        let value = self.granted.load(Ordering::Acquire);
        (value != 0).then(|| Granted {
            fifo: (value >> 8).checked_sub(1).map(|fifo| fifo as i32),
            locked: value & 1 == 1,
        })
    }
}

#[cfg(test)]
mod tests;
