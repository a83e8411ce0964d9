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
mod hearing;
mod keys;
mod performance;
mod player;
mod prepare;
mod scale;
mod status;
mod window;

pub use control::Control;
pub use error::{ChangeError, PlayError};
pub use frozen::Stem;
pub use guidance::{Guidance, GuidanceShare, GuidanceStep};
pub use hand::Hand;
pub use hand_limit::{HandKey, HandLimit, MeasuredKey, SCALE_MIN};
pub use hearing::{Heard, InputConfig};
pub use keys::{DeviceConfig, Keyboard, Slot};
pub use performance::Performance;
pub use player::change::Change;
pub use scale::{Bound, FALL_TIME};
pub use status::{Event, EventKind, HandStatus, Status};
pub use window::{Ear, Scene, Showing, Window, window};

use std::path::PathBuf;

use ergon_engine::mix::fold::Fold;
use ergon_engine::mix::limiter::Limiter;
use ergon_engine::mix::mixer::Mixer;
use ergon_engine::mix::silence_detector::SilenceDetector;
use ergon_engine::simulation::Simulation;

use crate::audio;
use crate::recording::Header;
use crate::safety::Guarded;
use player::change::ScheduledChange;

/// What is to be played.
pub struct Stage {
    /// What moves, at its first frame to be heard.
    pub simulation: Simulation,
    /// Outputs to channels.
    pub mixer: Mixer,
    /// After the mixer, before the limiter.
    pub gain: f64,
    /// From the mixer's channels to those that are heard, where these are others.
    pub fold: Option<Fold>,
    /// The last thing before the loudspeakers, with as many channels as are heard.
    pub limiter: Limiter,
    /// Frames to play; `None`: until it is stopped.
    pub n_frames: Option<u64>,
    /// The end of the sound, where it ends before these frames.
    pub fades: Option<SilenceDetector>,
    /// Frames of a tick.
    pub tick_frames: usize,
    /// Real hands, in the order of the simulation's.
    pub hands: Vec<Hand>,
    /// Frames at which a bar begins, rising: where a hand that comes back takes over.
    pub bars: Vec<u64>,
    /// Outputs that were computed before: the simulation leaves them at 0.
    pub frozen: Vec<Stem>,
    /// Whether windows may be opened on it: contacts are watched then.
    pub is_seen: bool,
}

impl Stage {
    /// Channels that are heard.
    pub(crate) fn n_heard(&self) -> usize {
        match &self.fold {
            Some(fold) => fold.n_out(),
            None => self.mixer.n_channels(),
        }
    }

    /// Frames that sound on after the last of the piece: what the fold and the limiter still hold.
    pub(crate) fn n_after(&self) -> usize {
        self.limiter.latency() + self.fold.as_ref().map_or(0, Fold::tail)
    }
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
    /// Where the inputs of the piece are heard, if it has any.
    pub input: InputConfig,
}

/// Something that is asked of the physics thread.
pub(crate) enum Command {
    /// Another gain.
    Gain(f64),
    /// Another gain of a group of routes.
    Part(usize, f64),
    /// What is heard goes into a file too, or no longer.
    Tap(Option<audio::Tap>),
    /// What acts at the first frame of the next tick, and its ticket.
    Act(u64, Act),
    /// A keyboard that came back.
    Keys(usize, Box<Guarded>),
    /// A window, as soon as the simulation plays that it is of.
    Window(Box<Window>),
    /// Another version.
    Change(Box<ScheduledChange>),
}

/// What acts on what plays at the first frame of a tick.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Act {
    /// A strike: the point, the impulse [N·s].
    Strike(u32, f64),
    /// A value of an input: its number, the value, full scale 1.
    Tell(u64, f64),
}

/// What the physics thread needs no more, to be freed elsewhere.
pub(crate) enum Garbage {
    /// A change, with what it replaced.
    Change(#[allow(dead_code)] Box<ScheduledChange>),
    /// A window.
    Window(#[allow(dead_code)] Box<Window>),
}

#[cfg(test)]
mod tests;
