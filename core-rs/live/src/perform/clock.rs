//! The clock of the ticks: with keys it is steered so that the ring keeps its level, without keys the ring paces it.

use std::time::{Duration, Instant};

use crate::realtime::sleep_until;

/// Largest relative change of the length of a tick; neither hand nor ear notices it.
const STRETCH_MAX: f64 = 5e-3;
/// Gains for the relative error of the ring's level; the loop settles within seconds.
const PROPORTIONAL_GAIN: f64 = 4e-3;
const INTEGRAL_GAIN: f64 = 4e-4;
/// Lateness in ticks from which on the clock is reset: missed ticks are not caught up.
const RESET_TICKS: u32 = 10;
/// Time between two checks for room in the ring, as a part of a tick.
const POLL_SHARE: f64 = 0.25;

/// The clock of the ticks.
#[derive(Debug)]
pub(super) struct TickClock {
    /// Length of a tick [s].
    period: f64,
    /// Wanted level of the ring [frames].
    fill_target: f64,
    /// Whether keys pace the ticks; otherwise the ring does.
    is_paced_by_keys: bool,
    /// Whether the output has a clock: a card has one, a file has none.
    is_steered: bool,
    next_due: Option<Instant>,
    error_integral: f64,
}

/// How a tick began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct TickStart {
    /// Lateness of the tick.
    pub(super) lateness: Duration,
    /// Whether the clock was reset.
    pub(super) was_reset: bool,
}

impl TickClock {
    pub(super) fn new(period: f64, fill_target: usize, is_paced_by_keys: bool, is_steered: bool) -> Self {
        Self {
            period,
            fill_target: fill_target.max(1) as f64,
            is_paced_by_keys,
            is_steered,
            next_due: None,
            error_integral: 0.0,
        }
    }

    /// Whether keys pace the ticks.
    pub(super) fn is_paced_by_keys(&self) -> bool {
        self.is_paced_by_keys
    }

    /// Length of a tick [s].
    pub(super) fn period(&self) -> f64 {
        self.period
    }

    /// Wait for the next tick; `filled_frames`: frames in the ring; `is_playing`: whether the card is taking them.
    pub(super) fn tick(&mut self, filled_frames: usize, is_playing: bool) -> TickStart {
        if !self.is_paced_by_keys {
            return TickStart::default();
        }
        let stretched_period = self.period * (1.0 + self.steer(filled_frames, is_playing));
        let due_instant = match self.next_due {
            Some(due_instant) => due_instant + Duration::from_secs_f64(stretched_period),
            None => Instant::now(),
        };
        let lateness = sleep_until(due_instant);
        let was_reset = lateness.as_secs_f64() > f64::from(RESET_TICKS) * self.period;
        self.next_due = Some(if was_reset { Instant::now() } else { due_instant });
        TickStart { lateness, was_reset }
    }

    /// Relative change of the next tick's length: longer if the ring is above its wanted level.
    fn steer(&mut self, filled_frames: usize, is_playing: bool) -> f64 {
        if !self.is_steered {
            return 0.0;
        }
        if !is_playing {
            // Until the card takes frames the ring only fills: ticks are as short as allowed.
            return -STRETCH_MAX;
        }
        let fill_error = ((filled_frames as f64 - self.fill_target) / self.fill_target).clamp(-1.0, 1.0);
        let integral_max = STRETCH_MAX / INTEGRAL_GAIN;
        self.error_integral = (self.error_integral + fill_error * self.period).clamp(-integral_max, integral_max);
        (PROPORTIONAL_GAIN * fill_error + INTEGRAL_GAIN * self.error_integral).clamp(-STRETCH_MAX, STRETCH_MAX)
    }

    /// Sleep a little while the ring is full.
    pub(super) fn wait_while_full(&self) {
        std::thread::sleep(Duration::from_secs_f64(POLL_SHARE * self.period));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The clock follows a card whose clock is wrong by up to three parts in a thousand.
    #[test]
    fn clock_steers_the_ring_to_its_target() {
        for drift in [-2e-3, 0.0, 1e-3, 3e-3] {
            let (tick_frames, tick_period, fill_target) = (44.0, 1e-3, 1_024);
            let mut clock = TickClock::new(tick_period, fill_target, true, true);
            let mut ring_fill = 1_024.0;
            let mut widest_error: f64 = 0.0;
            for tick in 0..120_000 {
                let stretched_period = tick_period * (1.0 + clock.steer(ring_fill as usize, true));
                ring_fill += tick_frames - tick_frames / tick_period * (1.0 + drift) * stretched_period;
                if tick > 60_000 {
                    widest_error = widest_error.max((ring_fill - 1_024.0).abs());
                }
            }
            assert!(widest_error < 60.0, "drift {drift}: {widest_error} frames off");
        }
    }

    #[test]
    fn clock_reports_late_ticks_and_resets_after_losses() {
        // Ticks this long hide any stall of a busy machine.
        const PERIOD: f64 = 0.5;
        let mut clock = TickClock::new(PERIOD, 64, true, true);
        let pass_ticks = |clock: &mut TickClock, ticks: f64| {
            let time_passed = Duration::from_secs_f64(ticks * PERIOD);
            clock.next_due = clock.next_due.and_then(|due| due.checked_sub(time_passed));
            assert!(clock.next_due.is_some());
        };
        assert!(!clock.tick(0, false).was_reset);
        pass_ticks(&mut clock, 2.0);
        let tick_start = clock.tick(64, true);
        assert!(tick_start.lateness.as_secs_f64() > 0.9 * PERIOD, "{tick_start:?}");
        assert!(!tick_start.was_reset, "{tick_start:?}");
        pass_ticks(&mut clock, 2.0 + 2.0 * f64::from(RESET_TICKS));
        assert!(clock.tick(64, true).was_reset);
        assert!(clock.tick(64, true).lateness.as_secs_f64() < 0.9 * PERIOD);
    }
}
