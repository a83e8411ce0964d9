//! The physics thread: the one thread that owns the whole simulation while it plays, between the keys and the sound
//! card.
//!
//! In every tick it exchanges forces and positions with the keys, steps the network for the frames of the tick, and
//! pushes their sound into the ring. If a keyboard has a clock of its own (is not in lockstep), ticks follow this
//! thread's clock, whose period is steered so that the ring keeps its level. Otherwise the level of the ring alone
//! paces the ticks.

mod clock;
mod control;
mod error;
mod frozen;
mod guidance;
mod hand;
mod hand_limit;
mod keys;
mod performance;
mod player;
mod prepare;
mod scale;
mod sound_input;
mod status;
mod window;

pub use control::Control;
pub use error::{ChangeError, PlayError};
pub use frozen::Stem;
pub use guidance::{Guidance, GuidanceShare, GuidanceStep};
pub use hand::LiveHand;
pub use hand_limit::{FORCE_SCALE_MIN, HandKey, HandLimit, MeasuredKey};
pub use keys::{DeviceConfig, Keyboard, KeyboardSlot};
pub use performance::Performance;
pub use player::change::Change;
pub use scale::{FALL_SECONDS, ScaleBound};
pub use sound_input::{InputConfig, InputStatus};
pub use status::{EventKind, HandStatus, PerformanceEvent, PerformanceStatus};
pub use window::{DisplayWindow, PlaybackTimes, WindowReader, WindowServer, window_pair};

use std::path::PathBuf;

use ergon_engine::mix::fold::Fold;
use ergon_engine::mix::limiter::Limiter;
use ergon_engine::mix::mixer::Mixer;
use ergon_engine::mix::silence_detector::SilenceDetector;
use ergon_engine::simulation::Simulation;

use crate::audio;
use crate::recording::Header;
use crate::safety::GuardedDevice;
use player::change::ScheduledChange;

/// A piece that is ready to be played.
pub struct PreparedPiece {
    /// The simulation, at the first frame to be heard.
    pub simulation: Simulation,
    /// Mixes outputs to channels.
    pub mixer: Mixer,
    /// Gain after the mixer, before the limiter.
    pub gain: f64,
    /// Folds the mixer's channels to those that are heard, if these differ.
    pub fold: Option<Fold>,
    /// The last stage before the loudspeakers, with as many channels as are heard.
    pub limiter: Limiter,
    /// Frames to play; `None`: until it is stopped.
    pub n_frames: Option<u64>,
    /// Detects the end of the sound, which may come before `n_frames`.
    pub silence_detector: Option<SilenceDetector>,
    /// Frames of a tick.
    pub tick_frames: usize,
    /// Live hands, in the order of the simulation's hands.
    pub hands: Vec<LiveHand>,
    /// Frames at which bars begin, rising: a hand that comes back takes over at one of them.
    pub bars: Vec<u64>,
    /// Outputs that were computed before; the simulation leaves them at 0.
    pub frozen_stems: Vec<Stem>,
    /// Whether windows may be opened on the performance: if so, contacts are watched.
    pub is_displayed: bool,
}

impl PreparedPiece {
    /// Channels that are heard.
    pub(crate) fn n_heard_channels(&self) -> usize {
        match &self.fold {
            Some(fold) => fold.n_out(),
            None => self.mixer.n_channels(),
        }
    }

    /// Number of frames that sound after the last frame of the piece: the fold and the limiter still hold them.
    pub(crate) fn n_tail_frames(&self) -> usize {
        self.limiter.latency() + self.fold.as_ref().map_or(0, Fold::tail_frames)
    }
}

/// How a stage is to be played.
#[derive(Debug)]
pub struct PlaybackConfig {
    /// Where the sound goes.
    pub audio: audio::AudioSpec,
    /// Frames to keep ahead of the card, at least two blocks or ticks; `None`: 1,024.
    pub frames_ahead: Option<usize>,
    /// A recording of the hands: its path and its header.
    pub recording: Option<(PathBuf, Header)>,
    /// Where the inputs of the piece come from, if it has any.
    pub input: InputConfig,
}

/// A request to the physics thread.
pub(crate) enum Command {
    /// Go to another gain.
    Gain(f64),
    /// Go to another gain of a group of routes.
    GroupGain(usize, f64),
    /// Start or end writing what is heard to a file.
    Tap(Option<audio::AudioTap>),
    /// A ticket, and an act at the first frame of the next tick.
    Action(u64, LiveAction),
    /// A keyboard that was opened again, with the index of its slot.
    ReopenedKeyboard(usize, Box<GuardedDevice>),
    /// A window, used as soon as its simulation plays.
    Window(Box<DisplayWindow>),
    /// A change at a later frame.
    Change(Box<ScheduledChange>),
    /// Withdraw the changes of the simulation that are due at this frame or later.
    Revoke(u64),
}

/// An act on the simulation at the first frame of a tick.
#[derive(Clone, Copy, Debug)]
pub(crate) enum LiveAction {
    /// A strike: the point, the impulse [N·s].
    Strike(u32, f64),
    /// A value of an input: its number, the value, full scale 1.
    SetInput(u64, f64),
}

/// Boxes that the physics thread no longer needs; another thread frees them.
pub(crate) enum Garbage {
    /// A change, with what it replaced.
    Change(#[allow(dead_code)] Box<ScheduledChange>),
    /// A window.
    Window(#[allow(dead_code)] Box<DisplayWindow>),
}

#[cfg(test)]
mod tests;
