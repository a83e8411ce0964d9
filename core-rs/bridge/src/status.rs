//! The state and the events of a performance, as Python sees them.

use ergon_live::perform::{self, EventKind};
use ergon_live::safety::TripCause;
use pyo3::prelude::*;

use crate::named::PerformanceEvent;

pub(crate) fn trip_text(cause: TripCause) -> &'static str {
    match cause {
        TripCause::NotFinite => "tripped: not finite",
        TripCause::Speed => "tripped: speed",
        TripCause::WrongWay => "tripped: wrong way",
        TripCause::AtStop => "tripped: at stop",
        TripCause::Frozen => "tripped: frozen",
        TripCause::Unanswered => "tripped: unanswered",
        TripCause::Late => "tripped: late",
        TripCause::OutsideTravel => "tripped: outside travel",
        TripCause::Jump => "tripped: jump",
    }
}

pub(crate) fn named_event(event: perform::PerformanceEvent) -> PerformanceEvent {
    let (what, number) = match event.kind {
        EventKind::KeyboardLost(board) => ("gone", board as f64),
        EventKind::KeyboardReturned(board) => ("back", board as f64),
        EventKind::HandTakenOver(hand) => ("took over", hand as f64),
        EventKind::ClockReset(reset_time) => ("lost", reset_time.as_secs_f64()),
        EventKind::AxisTripped(hand, why) => (trip_text(why), hand as f64),
        EventKind::PartMuted => ("muted", 0.0),
        EventKind::PartRefined => ("finer", 0.0),
        EventKind::EnergyCreated => ("gained", 0.0),
        EventKind::ChangeDone(ticket) => ("changed", ticket as f64),
        EventKind::ChangeMissed(ticket) => ("late", ticket as f64),
        EventKind::ActionDone(ticket) => ("acted", ticket as f64),
        EventKind::ActionMissed(ticket) => ("missed", ticket as f64),
        EventKind::PieceEnded => ("ended", 0.0),
    };
    PerformanceEvent {
        frame: event.frame,
        what,
        number,
    }
}

/// The state of a performance.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct Status {
    frame: u64,
    ticks: u64,
    late: u64,
    latest: f64,
    lost: u64,
    dropped: u64,
    missed: u64,
    load: f64,
    busiest: f64,
    filled: usize,
    underruns: u64,
    input_gaps: u64,
    xruns: u64,
    played: u64,
    alive: bool,
    done: bool,
    panicked: bool,
    sounding: Option<f64>,
    latency: f64,
    paced: bool,
    peaks: Vec<f32>,
    hands: Vec<HandStatus>,
}

impl Status {
    pub(crate) fn new(performance: &mut perform::Performance) -> Self {
        let play_status = performance.status();
        let output_state = performance.output().stream_state();
        let output_info = performance.output().info();
        let (_, latency) = output_state.timing();
        let input_state = performance
            .input()
            .input
            .as_ref()
            .map(ergon_live::audio::Input::stream_state);
        Self {
            frame: play_status.frame,
            ticks: play_status.ticks,
            late: play_status.late_ticks,
            latest: play_status.lateness_max.as_secs_f64(),
            lost: play_status.clock_resets,
            dropped: play_status.dropped_frames,
            missed: play_status.missed_frozen_frames,
            load: play_status.load,
            busiest: play_status.load_max,
            filled: play_status.ring_frames,
            underruns: output_state.underruns(),
            input_gaps: input_state.map_or(0, |shared| shared.underruns()),
            xruns: output_state.xruns(),
            played: output_state.played_frames(),
            alive: output_state.is_alive(),
            done: performance.is_done(),
            panicked: output_state.is_panicking(),
            sounding: output_state.first_frame_age().map(|since| since.as_secs_f64()),
            latency: f64::from(latency) / f64::from(output_info.rate.max(1)),
            paced: output_info.is_paced,
            peaks: play_status.peaks[..performance.n_channels()].to_vec(),
            hands: play_status.hands.iter().map(HandStatus::new).collect(),
        }
    }
}

/// The state of a hand.
#[pyclass(frozen, get_all, from_py_object, module = "ergon._core")]
#[derive(Clone)]
pub(crate) struct HandStatus {
    position: f64,
    force: f64,
    sent: f64,
    scale: f64,
    real: bool,
    touch: bool,
    enabled: bool,
    tripped: bool,
    hot: bool,
    let_go: u64,
    stalls: u64,
}

impl HandStatus {
    fn new(hand: &perform::HandStatus) -> Self {
        Self {
            position: hand.position,
            force: hand.force,
            sent: hand.sent_force,
            scale: hand.force_scale,
            real: hand.is_real,
            touch: hand.is_touched,
            enabled: hand.is_motor_enabled,
            tripped: hand.is_tripped,
            hot: hand.is_hot,
            let_go: hand.let_go,
            stalls: hand.stalls,
        }
    }
}

/// How much of the piece's force a real hand may get, so that device and piece stay stable.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct HandLimit {
    hand: usize,
    scale: f64,
    stiffness: f64,
    limit: f64,
}

impl HandLimit {
    pub(crate) fn new(limit: &perform::HandLimit) -> Self {
        Self {
            hand: limit.hand,
            scale: limit.force_scale,
            stiffness: limit.stiffness,
            limit: limit.stable_stiffness,
        }
    }
}
