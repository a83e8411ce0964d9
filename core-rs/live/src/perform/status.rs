//! The state and the events that the physics thread reports.

use std::time::Duration;

use crate::audio::CHANNELS_MAX;
use crate::safety::Trip;

/// Greatest number of hands whose state is reported.
pub(super) const HANDS_MAX: usize = 16;

/// The latest state of a performance.
#[derive(Clone, Copy, Debug)]
pub struct Status {
    /// Number of frames computed.
    pub frame: u64,
    /// Number of ticks.
    pub ticks: u64,
    /// Number of ticks that began more than half a tick late.
    pub late_ticks: u64,
    /// Greatest lateness of a tick.
    pub max_lateness: Duration,
    /// How often the clock was reset because it was too late.
    pub clock_resets: u64,
    /// Number of frames that were dropped because the ring was full.
    pub dropped: u64,
    /// Number of frames of frozen parts that were not read in time.
    pub missed: u64,
    /// Computing time as a part of the tick, averaged over the last second.
    pub load: f64,
    /// Greatest load of one tick.
    pub busiest: f64,
    /// Number of frames in the ring.
    pub filled: usize,
    /// Peak of each channel, which decays with a time constant of 0.3 s.
    pub peaks: [f32; CHANNELS_MAX],
    /// State of each hand.
    pub hands: [HandStatus; HANDS_MAX],
    /// Number of parts that became non-finite and were muted.
    pub muted: u32,
    /// Number of parts with frames computed in finer steps.
    pub finer: u32,
    /// Number of contacts, laws and meshes that created energy.
    pub n_gains: u32,
}

impl Default for Status {
    fn default() -> Self {
        Self {
            frame: 0,
            ticks: 0,
            late_ticks: 0,
            max_lateness: Duration::ZERO,
            clock_resets: 0,
            dropped: 0,
            missed: 0,
            load: 0.0,
            busiest: 0.0,
            filled: 0,
            peaks: [0.0; CHANNELS_MAX],
            hands: [HandStatus::default(); HANDS_MAX],
            muted: 0,
            finer: 0,
            n_gains: 0,
        }
    }
}

/// The latest state of a hand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HandStatus {
    /// Position of the key [m].
    pub position: f64,
    /// Force of the piece on the key [N].
    pub force: f64,
    /// Force sent to the motor, after the safety stages [N].
    pub sent: f64,
    /// Factor of the piece's force, 0 to 1.
    pub scale: f64,
    /// Whether a person moves the key; otherwise its stand-in does.
    pub real: bool,
    /// Whether a finger touches the key.
    pub touch: bool,
    /// Whether the motor is enabled.
    pub enabled: bool,
    /// Whether the forces of the axis are held at zero after a trip.
    pub tripped: bool,
    /// Whether the board reports that the motor is too hot.
    pub hot: bool,
    /// How often the board reported that it let go of the motors.
    pub let_go: u64,
    /// How often forces ended because the host was stopped.
    pub stalls: u64,
}

/// An event of a performance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// The frame of the event.
    pub frame: u64,
    /// The kind of event.
    pub kind: EventKind,
}

/// Kinds of events.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EventKind {
    /// A keyboard was lost; the stand-ins of its hands continue.
    Gone(usize),
    /// A keyboard has returned; its hands take over at the next bar.
    Back(usize),
    /// A person has taken over a hand from its stand-in.
    TookOver(usize),
    /// The clock was reset after this lateness.
    Lost(Duration),
    /// The axis of a hand has tripped; the reason.
    Tripped(usize, Trip),
    /// A part became non-finite and is muted.
    Muted,
    /// Links of a part stiffened so much that frames are computed in finer steps.
    Finer,
    /// Steps of a contact, a law or a mesh created energy.
    Gained,
    /// A change was made; its ticket.
    Changed(u64),
    /// A change was not made, because its frame had passed, too many changes waited, it was withdrawn, or it does not
    /// fit the playing simulation; its ticket.
    Late(u64),
    /// A strike, or a value of an input, acted at this frame; its ticket.
    Acted(u64),
    /// A strike, or a value of an input, did not act, because the simulation lacks the point or the input, or too many
    /// came in one tick; its ticket.
    Missed(u64),
    /// The last frame was computed.
    Ended,
}
