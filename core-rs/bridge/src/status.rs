//! The state and the events of a performance, as Python sees them.

use ergon_live::perform::{self, EventKind};
use ergon_live::safety::Trip;
use pyo3::prelude::*;

use crate::named::PerformanceEvent;

pub(crate) fn tripped(why: Trip) -> &'static str {
    match why {
        Trip::NotFinite => "tripped: not finite",
        Trip::Speed => "tripped: speed",
        Trip::WrongWay => "tripped: wrong way",
        Trip::AtStop => "tripped: at stop",
        Trip::Frozen => "tripped: frozen",
        Trip::Unanswered => "tripped: unanswered",
        Trip::Late => "tripped: late",
        Trip::OutsideTravel => "tripped: outside travel",
        Trip::Jump => "tripped: jump",
    }
}

pub(crate) fn named_event(event: perform::Event) -> PerformanceEvent {
    let (what, number) = match event.kind {
        EventKind::Gone(board) => ("gone", board as f64),
        EventKind::Back(board) => ("back", board as f64),
        EventKind::TookOver(hand) => ("took over", hand as f64),
        EventKind::Lost(late) => ("lost", late.as_secs_f64()),
        EventKind::Tripped(hand, why) => (tripped(why), hand as f64),
        EventKind::Muted => ("muted", 0.0),
        EventKind::Finer => ("finer", 0.0),
        EventKind::Gained => ("gained", 0.0),
        EventKind::Changed(ticket) => ("changed", ticket as f64),
        EventKind::Late(ticket) => ("late", ticket as f64),
        EventKind::Acted(ticket) => ("acted", ticket as f64),
        EventKind::Missed(ticket) => ("missed", ticket as f64),
        EventKind::Ended => ("ended", 0.0),
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
        let output_state = performance.output().shared();
        let output_info = performance.output().info();
        let (_, latency) = output_state.timing();
        let input_state = performance.input().input.as_ref().map(ergon_live::audio::Input::shared);
        Self {
            frame: play_status.frame,
            ticks: play_status.ticks,
            late: play_status.late_ticks,
            latest: play_status.max_lateness.as_secs_f64(),
            lost: play_status.clock_resets,
            dropped: play_status.dropped,
            missed: play_status.missed,
            load: play_status.load,
            busiest: play_status.busiest,
            filled: play_status.filled,
            underruns: output_state.underruns(),
            input_gaps: input_state.map_or(0, |shared| shared.underruns()),
            xruns: output_state.xruns(),
            played: output_state.played(),
            alive: output_state.is_alive(),
            done: performance.is_done(),
            panicked: output_state.panicked(),
            sounding: output_state.sounding().map(|since| since.as_secs_f64()),
            latency: f64::from(latency) / f64::from(output_info.rate.max(1)),
            paced: output_info.paced,
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
            sent: hand.sent,
            scale: hand.scale,
            real: hand.real,
            touch: hand.touch,
            enabled: hand.enabled,
            tripped: hand.tripped,
            hot: hand.hot,
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
            scale: limit.scale,
            stiffness: limit.stiffness,
            limit: limit.stable_stiffness,
        }
    }
}
