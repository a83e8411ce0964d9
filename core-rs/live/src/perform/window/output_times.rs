//! The instants at which frames are heard, from the timing that the sound card reports.

use std::collections::VecDeque;

use crate::audio::{SoundClock, Sounding};

/// Reports of a card's blocks come late, never early: the earliest start within this time is taken as the true one [s].
const MEMORY: f64 = 1.0;
/// Difference beyond which a report begins a new line: a sound server was restarted, or the machine was suspended [s].
const JUMP: f64 = 0.02;

/// The instants at which frames of a performance are heard.
pub struct HeardTimes {
    sound_clock: SoundClock,
    line: FrameTimeLine,
}

impl HeardTimes {
    /// The times of an output whose first frame is `start`, at `rate` frames per second.
    pub(in crate::perform) fn new(sound_clock: SoundClock, rate: f64, start: u64) -> Self {
        let line = FrameTimeLine::new(rate, start);
        Self { sound_clock, line }
    }

    /// The instant at which a frame is heard, by the clock that says `now` [s]; `dropped` frames before it are never
    /// heard. `None` if the output has no clock.
    pub(super) fn sounding_at(&mut self, frame: u64, dropped: u64, now: f64) -> Option<f64> {
        self.line.add_report(self.sound_clock.sounding(), dropped, now);
        self.line.sounding_at(frame, dropped)
    }
}

/// A linear relation between instants and frames.
struct FrameTimeLine {
    rate: f64,
    start: u64,
    /// Pairs: the instant of a report, and the instant at which frame `start` was heard according to it [s].
    seen: VecDeque<(f64, f64)>,
    /// A change of these values begins a new line: gaps, dropped frames, whether a card plays.
    state: Option<(u64, u64, bool)>,
}

impl FrameTimeLine {
    fn new(rate: f64, start: u64) -> Self {
        Self {
            rate,
            start,
            seen: VecDeque::new(),
            state: None,
        }
    }

    fn add_report(&mut self, sounding: Option<Sounding>, dropped: u64, now: f64) {
        let Some(sounding) = sounding else {
            return;
        };
        let zero_time = now - sounding.since + sounding.latency;
        let sound_state = Some((sounding.gaps, dropped, sounding.is_alive));
        let has_jumped = |last: &(f64, f64)| (zero_time - last.1).abs() > JUMP;
        if sound_state != self.state || self.seen.back().is_some_and(has_jumped) {
            self.seen.clear();
        }
        self.state = sound_state;
        self.seen.push_back((now, zero_time));
        while self.seen.front().is_some_and(|first| first.0 < now - MEMORY) {
            self.seen.pop_front();
        }
    }

    fn sounding_at(&self, frame: u64, dropped: u64) -> Option<f64> {
        let zero_times = self.seen.iter().map(|seen| seen.1);
        let zero_time = zero_times.min_by(f64::total_cmp)?;
        Some(zero_time + (frame as f64 - self.start as f64 - dropped as f64) / self.rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: f64 = 44_100.0;
    const BLOCK: u64 = 256;

    /// The report of a card that began to play frame 0 at 3 s with 10 ms of latency; the report itself is `late` [s].
    fn sounding(now: f64, late: f64, gaps: u64) -> Sounding {
        Sounding {
            since: now - 3.0 - late,
            latency: 0.01,
            gaps,
            is_alive: true,
        }
    }

    #[test]
    fn frame_time_by_the_earliest_report() {
        let mut time_line = FrameTimeLine::new(RATE, 4_410);
        assert_eq!(time_line.sounding_at(0, 0), None);
        // Most reports of a block come up to a block late; some come at once.
        for look in 0..240_u64 {
            let report_time = 4.0 + look as f64 / 60.0;
            let report_delay = (look % 7) as f64 / 7.0 * BLOCK as f64 / RATE;
            time_line.add_report(Some(sounding(report_time, report_delay, 0)), 0, report_time);
        }
        let sound_time = time_line.sounding_at(4_410 + 44_100, 0).expect("a clock");
        assert!((sound_time - 4.01).abs() < 1e-9, "{sound_time}");
        // Dropped frames are not heard: the frames after them come sooner.
        time_line.add_report(Some(sounding(9.0, 0.0, 0)), 441, 9.0);
        let sound_time = time_line.sounding_at(4_410 + 44_100, 441).expect("a clock");
        assert!((sound_time - 4.0).abs() < 1e-9, "{sound_time}");
    }

    #[test]
    fn frame_time_after_a_gap() {
        let mut time_line = FrameTimeLine::new(RATE, 0);
        time_line.add_report(Some(sounding(4.0, 0.0, 0)), 0, 4.0);
        // 5 ms of silence were inserted: everything after them is heard later.
        time_line.add_report(Some(sounding(4.1, 0.005, 1)), 0, 4.1);
        let sound_time = time_line.sounding_at(0, 0).expect("a clock");
        assert!((sound_time - 3.015).abs() < 1e-9, "{sound_time}");
        // Without a report the line stays.
        time_line.add_report(None, 0, 4.2);
        assert_eq!(time_line.sounding_at(0, 0), Some(sound_time));
    }
}
