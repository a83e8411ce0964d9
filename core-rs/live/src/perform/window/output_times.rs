//! The instants at which frames are heard, from the timing that the sound card reports.

use std::collections::VecDeque;

use crate::audio::{PlaybackTiming, SoundClock};

/// Reports of a card's blocks come late, never early: the earliest start within this time is taken as the true one [s].
const REPORT_MEMORY_SECONDS: f64 = 1.0;
/// Difference beyond which a report begins a new line: a sound server was restarted, or the machine was suspended [s].
const JUMP_SECONDS: f64 = 0.02;

/// The instants at which frames of a performance are heard.
pub struct PlaybackTimes {
    sound_clock: SoundClock,
    time_line: FrameTimeLine,
}

impl PlaybackTimes {
    /// The times of an output whose first frame is `start_frame`, at `rate` frames per second.
    pub(in crate::perform) fn new(sound_clock: SoundClock, rate: f64, start_frame: u64) -> Self {
        let time_line = FrameTimeLine::new(rate, start_frame);
        Self { sound_clock, time_line }
    }

    /// The instant at which a frame is heard, by the clock that says `now` [s]; `dropped_frames` frames before it are
    /// never heard. `None` if the output has no clock.
    pub(super) fn playback_time(&mut self, frame: u64, dropped_frames: u64, now: f64) -> Option<f64> {
        self.time_line
            .add_report(self.sound_clock.playback_timing(), dropped_frames, now);
        self.time_line.playback_time(frame, dropped_frames)
    }
}

/// A linear relation between instants and frames.
struct FrameTimeLine {
    rate: f64,
    start_frame: u64,
    /// Pairs: the instant of a report, and the instant at which frame `start_frame` was heard according to it [s].
    start_reports: VecDeque<(f64, f64)>,
    /// A change of these values begins a new line: gaps, dropped frames, whether a card plays.
    playback_state: Option<(u64, u64, bool)>,
}

impl FrameTimeLine {
    fn new(rate: f64, start: u64) -> Self {
        Self {
            rate,
            start_frame: start,
            start_reports: VecDeque::new(),
            playback_state: None,
        }
    }

    fn add_report(&mut self, timing: Option<PlaybackTiming>, dropped_frames: u64, now: f64) {
        let Some(sounding) = timing else {
            return;
        };
        let start_time = now - sounding.first_frame_age + sounding.latency;
        let playback_state = Some((sounding.underruns, dropped_frames, sounding.is_alive));
        let has_jumped = |last: &(f64, f64)| (start_time - last.1).abs() > JUMP_SECONDS;
        if playback_state != self.playback_state || self.start_reports.back().is_some_and(has_jumped) {
            self.start_reports.clear();
        }
        self.playback_state = playback_state;
        self.start_reports.push_back((now, start_time));
        while self
            .start_reports
            .front()
            .is_some_and(|first| first.0 < now - REPORT_MEMORY_SECONDS)
        {
            self.start_reports.pop_front();
        }
    }

    fn playback_time(&self, frame: u64, dropped_frames: u64) -> Option<f64> {
        let start_times = self.start_reports.iter().map(|report| report.1);
        let start_time = start_times.min_by(f64::total_cmp)?;
        Some(start_time + (frame as f64 - self.start_frame as f64 - dropped_frames as f64) / self.rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: f64 = 44_100.0;
    const BLOCK: u64 = 256;

    /// The report of a card that began to play frame 0 at 3 s with 10 ms of latency; the report itself is `late` [s].
    fn sounding(now: f64, late: f64, gaps: u64) -> PlaybackTiming {
        PlaybackTiming {
            first_frame_age: now - 3.0 - late,
            latency: 0.01,
            underruns: gaps,
            is_alive: true,
        }
    }

    #[test]
    fn frame_time_by_the_earliest_report() {
        let mut time_line = FrameTimeLine::new(RATE, 4_410);
        assert_eq!(time_line.playback_time(0, 0), None);
        // Most reports of a block come up to a block late; some come at once.
        for look in 0..240_u64 {
            let report_time = 4.0 + look as f64 / 60.0;
            let report_delay = (look % 7) as f64 / 7.0 * BLOCK as f64 / RATE;
            time_line.add_report(Some(sounding(report_time, report_delay, 0)), 0, report_time);
        }
        let sound_time = time_line.playback_time(4_410 + 44_100, 0).expect("a clock");
        assert!((sound_time - 4.01).abs() < 1e-9, "{sound_time}");
        // Dropped frames are not heard: the frames after them come sooner.
        time_line.add_report(Some(sounding(9.0, 0.0, 0)), 441, 9.0);
        let sound_time = time_line.playback_time(4_410 + 44_100, 441).expect("a clock");
        assert!((sound_time - 4.0).abs() < 1e-9, "{sound_time}");
    }

    #[test]
    fn frame_time_after_a_gap() {
        let mut time_line = FrameTimeLine::new(RATE, 0);
        time_line.add_report(Some(sounding(4.0, 0.0, 0)), 0, 4.0);
        // 5 ms of silence were inserted: everything after them is heard later.
        time_line.add_report(Some(sounding(4.1, 0.005, 1)), 0, 4.1);
        let sound_time = time_line.playback_time(0, 0).expect("a clock");
        assert!((sound_time - 3.015).abs() < 1e-9, "{sound_time}");
        // Without a report the line stays.
        time_line.add_report(None, 0, 4.2);
        assert_eq!(time_line.playback_time(0, 0), Some(sound_time));
    }
}
