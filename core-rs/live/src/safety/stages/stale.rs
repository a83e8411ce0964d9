//! Ages: of the position that a force was computed from, and of the force itself.
//!
//! A force is stale in three cases. No position came for too long. The host itself was stopped, so that its force is as
//! old as the stop; the time between two of its own calls shows this. Or the board had received nothing for too long
//! and let go, as its reply reports. The force is then zero, and fades in from zero.

use std::time::Duration;

use super::super::counts::StageCounts;
use super::fade::Fade;

/// The ages of positions and of the host's calls.
#[derive(Clone, Copy, Debug)]
pub(in crate::safety) struct DataAges {
    /// Age above which they are stale.
    age_max: Duration,
    /// When the newest position came, and when the host made its last call.
    last_position: Option<Duration>,
    last_call: Option<Duration>,
    fade: Fade,
    /// Whether the next force must be zero whatever else holds: the slew limit then starts at zero, not at the force
    /// before the stall.
    must_send_zero: bool,
}

impl DataAges {
    pub(in crate::safety) fn new(age_max: f64) -> Self {
        Self {
            age_max: Duration::try_from_secs_f64(age_max).unwrap_or(Duration::MAX),
            last_position: None,
            last_call: None,
            fade: Fade::FULL,
            must_send_zero: false,
        }
    }

    /// Whether the host was stopped since its last call.
    pub(in crate::safety) fn was_stopped(&self, now: Duration) -> bool {
        self.is_stale(self.last_call, now)
    }

    fn is_stale(&self, last_time: Option<Duration>, now: Duration) -> bool {
        last_time.is_some_and(|since| now.saturating_sub(since) > self.age_max)
    }

    /// Whether forces fade in after a stale one.
    pub(in crate::safety) fn is_fading(&self) -> bool {
        !self.fade.is_full()
    }

    /// Let later forces fade in from zero.
    pub(in crate::safety) fn restart(&mut self) {
        self.fade = Fade::ZERO;
    }

    /// Note a call of the host, with or without a new position.
    fn note_call(&mut self, now: Duration, counts: &mut StageCounts) {
        if self.was_stopped(now) {
            counts.stalls += 1;
            self.restart();
            self.must_send_zero = true;
        }
        self.last_call = Some(now);
    }

    /// Advance before a force is sent; the fade takes `fade` [s] in ticks of `period`. Returns whether the force is
    /// stale.
    pub(in crate::safety) fn update(
        &mut self,
        now: Duration,
        [period, fade]: [f64; 2],
        counts: &mut StageCounts,
    ) -> bool {
        self.note_call(now, counts);
        let must_send_zero = std::mem::take(&mut self.must_send_zero);
        let is_stale = must_send_zero || self.last_position.is_none() || self.is_stale(self.last_position, now);
        if is_stale {
            self.restart();
        } else {
            self.fade.advance(period, fade);
        }
        is_stale
    }

    /// Note a position, from a board that may have `let_go` before; returns the time since the previous position [s].
    pub(in crate::safety) fn note_position(
        &mut self,
        now: Duration,
        let_go: bool,
        counts: &mut StageCounts,
    ) -> Option<f64> {
        self.note_call(now, counts);
        if let_go {
            counts.let_go += 1;
            self.restart();
            self.must_send_zero = true;
        }
        let previous_time = self.last_position.replace(now);
        previous_time.map(|previous_time| now.saturating_sub(previous_time).as_secs_f64())
    }

    pub(in crate::safety) fn apply_fade(&self, force: f64, count: &mut u64) -> f64 {
        self.fade.apply(force, count)
    }
}
