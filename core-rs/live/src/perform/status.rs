//! What the physics thread tells: the latest state of everything, and what happened.

use std::time::Duration;

use crate::audio::CHANNELS_MAX;
use crate::safety::Trip;

/// Hands whose state is told.
pub(super) const HANDS_MAX: usize = 16;

/// The latest state.
#[derive(Clone, Copy, Debug)]
pub struct Status {
    /// Frames computed.
    pub frame: u64,
    /// Ticks done.
    pub ticks: u64,
    /// Ticks that began more than half a tick late, and the latest of all.
    pub late: u64,
    /// The latest of all ticks.
    pub latest: Duration,
    /// Times that the clock was set anew, for it was too late.
    pub lost: u64,
    /// Frames that found no room in the ring.
    pub dropped: u64,
    /// Frames of prepared parts that were not read in time.
    pub missed: u64,
    /// Part of a tick's time that its work took, over the last second; and the greatest of all ticks.
    pub load: f64,
    /// The greatest load of one tick.
    pub busiest: f64,
    /// Frames in the ring.
    pub filled: usize,
    /// Peak of each channel, falling by half within 0.3 s.
    pub peaks: [f32; CHANNELS_MAX],
    /// Each hand.
    pub hands: [HandStatus; HANDS_MAX],
    /// Parts that went beyond all bounds and were muted.
    pub muted: u32,
    /// Parts of which frames were computed finer.
    pub finer: u32,
}

impl Default for Status {
    fn default() -> Self {
        Self {
            frame: 0,
            ticks: 0,
            late: 0,
            latest: Duration::ZERO,
            lost: 0,
            dropped: 0,
            missed: 0,
            load: 0.0,
            busiest: 0.0,
            filled: 0,
            peaks: [0.0; CHANNELS_MAX],
            hands: [HandStatus::default(); HANDS_MAX],
            muted: 0,
            finer: 0,
        }
    }
}

/// The latest state of a hand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HandStatus {
    /// Where it is, in the key's own metres.
    pub position: f64,
    /// What it feels [N].
    pub force: f64,
    /// What went to the motor, once it was safe [N].
    pub sent: f64,
    /// The part of the scene's force that it may get, 0 to 1.
    pub scale: f64,
    /// A person's, not what stands in for it.
    pub real: bool,
    /// A finger is on it.
    pub touch: bool,
    /// The motor lets forces through.
    pub enabled: bool,
    /// Its forces are held at zero, for it tripped.
    pub tripped: bool,
    /// Its board says that the motor is too hot.
    pub hot: bool,
    /// How often its board said that it had let go.
    pub let_go: u64,
    /// How often the host was stopped, so that its force ended.
    pub stalls: u64,
}

/// Something that happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// At this frame.
    pub frame: u64,
    /// What it was.
    pub kind: EventKind,
}

/// What may happen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EventKind {
    /// A keyboard no longer answers: what stands in for its hands plays on.
    Gone(usize),
    /// A keyboard is there again; its hands take over at the next bar.
    Back(usize),
    /// A hand plays instead of what stood in for it.
    TookOver(usize),
    /// The clock was set anew after so much time.
    Lost(Duration),
    /// A hand's forces tripped, and why.
    Tripped(usize, Trip),
    /// A part of the network went beyond all bounds and is silent.
    Muted,
    /// Links of a part have stiffened so far that frames of it are computed finer.
    Finer,
    /// A change was done; its ticket.
    Changed(u64),
    /// A change came too late for its frame, or was to take over from what does not play, and was not done; its ticket.
    Late(u64),
    /// A point was struck at this frame; the ticket.
    Struck(u64),
    /// A point was not struck, for what plays lacks it, or too many were struck in one tick; the ticket.
    Missed(u64),
    /// The last frame is out.
    Ended,
}
