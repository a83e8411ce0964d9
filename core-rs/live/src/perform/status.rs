//! The state and the events that the physics thread reports.

use std::time::Duration;

use crate::audio::CHANNELS_MAX;
use crate::safety::TripCause;

/// Greatest number of hands whose state is reported.
pub(super) const HANDS_MAX: usize = 16;

/// The latest state of a performance.
#[derive(Clone, Copy, Debug)]
pub struct PerformanceStatus {
    /// Number of frames computed.
    pub frame: u64,
    /// Number of ticks.
    pub ticks: u64,
    /// Number of ticks that began more than half a tick late.
    pub late_ticks: u64,
    /// Greatest lateness of a tick.
    pub lateness_max: Duration,
    /// How often the clock was reset because it was too late.
    pub clock_resets: u64,
    /// Number of frames that were dropped because the ring was full.
    pub dropped_frames: u64,
    /// Number of frames of frozen parts that were not read in time.
    pub missed_frozen_frames: u64,
    /// Computing time as a part of the tick, averaged over the last second.
    pub load: f64,
    /// Greatest load of one tick.
    pub load_max: f64,
    /// Number of frames in the ring.
    pub ring_frames: usize,
    /// Peak of each channel, which decays with a time constant of 0.3 s.
    pub peaks: [f32; CHANNELS_MAX],
    /// State of each hand.
    pub hands: [HandStatus; HANDS_MAX],
    /// Number of parts that became non-finite and were muted.
    pub n_muted_parts: u32,
    /// Number of parts with frames computed in finer steps.
    pub n_finer_parts: u32,
    /// Number of contacts, laws and meshes that created energy.
    pub n_energy_gains: u32,
}

impl Default for PerformanceStatus {
    fn default() -> Self {
        Self {
            frame: 0,
            ticks: 0,
            late_ticks: 0,
            lateness_max: Duration::ZERO,
            clock_resets: 0,
            dropped_frames: 0,
            missed_frozen_frames: 0,
            load: 0.0,
            load_max: 0.0,
            ring_frames: 0,
            peaks: [0.0; CHANNELS_MAX],
            hands: [HandStatus::default(); HANDS_MAX],
            n_muted_parts: 0,
            n_finer_parts: 0,
            n_energy_gains: 0,
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
    pub sent_force: f64,
    /// Factor of the piece's force, 0 to 1.
    pub force_scale: f64,
    /// Whether a person moves the key; otherwise its stand-in does.
    pub is_real: bool,
    /// Whether a finger touches the key.
    pub is_touched: bool,
    /// Whether the motor is enabled.
    pub is_motor_enabled: bool,
    /// Whether the forces of the axis are held at zero after a trip.
    pub is_tripped: bool,
    /// Whether the board reports that the motor is too hot.
    pub is_hot: bool,
    /// How often the board reported that it let go of the motors.
    pub let_go: u64,
    /// How often forces ended because the host was stopped.
    pub stalls: u64,
}

/// An event of a performance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerformanceEvent {
    /// The frame of the event.
    pub frame: u64,
    /// The kind of event.
    pub kind: EventKind,
}

/// Kinds of events.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EventKind {
    /// A keyboard was lost; the stand-ins of its hands continue.
    KeyboardLost(usize),
    /// A keyboard has returned; its hands take over at the next bar.
    KeyboardReturned(usize),
    /// A person has taken over a hand from its stand-in.
    HandTakenOver(usize),
    /// The clock was reset after this lateness.
    ClockReset(Duration),
    /// The axis of a hand has tripped; the reason.
    AxisTripped(usize, TripCause),
    /// A part became non-finite and is muted.
    PartMuted,
    /// Links of a part stiffened so much that frames are computed in finer steps.
    PartRefined,
    /// Steps of a contact, a law or a mesh created energy.
    EnergyCreated,
    /// A change was made; its ticket.
    ChangeDone(u64),
    /// A change was not made, because its frame had passed, too many changes waited, it was withdrawn, or it does not
    /// fit the playing simulation; its ticket.
    ChangeMissed(u64),
    /// A strike, or a value of an input, acted at this frame; its ticket.
    ActionDone(u64),
    /// A strike, or a value of an input, did not act, because the simulation lacks the point or the input, or too many
    /// came in one tick; its ticket.
    ActionMissed(u64),
    /// The last frame was computed.
    PieceEnded,
}
