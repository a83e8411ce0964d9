//! When a tick begins: by the keys' clock, steered so that the ring stays as full as it is to be.

use std::time::{Duration, Instant};

use crate::realtime::sleep_until;

/// How far the tick may be stretched: below what a hand or an ear notices of a clock.
const MOST: f64 = 5e-3;
/// Proportional and integral gain, for a relative error of the fill: settled within seconds.
const GAINS: (f64, f64) = (4e-3, 4e-4);
/// So many ticks late the clock is set anew: what was missed is not played faster afterwards.
const LOST: u32 = 10;
/// A thread that waits for room in the ring looks again after this part of a tick.
const LOOK: f64 = 0.25;

/// The clock of the ticks.
#[derive(Debug)]
pub(super) struct Clock {
    /// Of a tick [s].
    period: f64,
    /// Frames that the ring is to hold.
    target: f64,
    /// By the keys; else the ring alone says when.
    keys: bool,
    /// The card has a clock of its own, which the ring's fill tells; a file takes what comes.
    steered: bool,
    due: Option<Instant>,
    integral: f64,
}

/// How a tick began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Beat {
    /// After it was due.
    pub(super) late: Duration,
    /// So late that the clock was set anew.
    pub(super) lost: bool,
}

impl Clock {
    pub(super) fn new(period: f64, target: usize, keys: bool, steered: bool) -> Self {
        Self {
            period,
            target: target.max(1) as f64,
            keys,
            steered,
            due: None,
            integral: 0.0,
        }
    }

    /// Whether keys say when.
    pub(super) fn is_by_keys(&self) -> bool {
        self.keys
    }

    /// Of a tick [s].
    pub(super) fn period(&self) -> f64 {
        self.period
    }

    /// Wait for the next tick; `filled`: frames in the ring, whose card is taking them if `playing`.
    pub(super) fn tick(&mut self, filled: usize, playing: bool) -> Beat {
        if !self.keys {
            return Beat::default();
        }
        let stretched = self.period * (1.0 + self.steer(filled, playing));
        let due = match self.due {
            Some(due) => due + Duration::from_secs_f64(stretched),
            None => Instant::now(),
        };
        let late = sleep_until(due);
        let lost = late.as_secs_f64() > f64::from(LOST) * self.period;
        self.due = Some(if lost { Instant::now() } else { due });
        Beat { late, lost }
    }

    /// Relative stretch of the next tick: a ring that is too full lets the keys go slower.
    fn steer(&mut self, filled: usize, playing: bool) -> f64 {
        if !self.steered {
            return 0.0;
        }
        if !playing {
            // Until the card takes anything the ring just fills.
            return -MOST;
        }
        let error = ((filled as f64 - self.target) / self.target).clamp(-1.0, 1.0);
        let most = MOST / GAINS.1;
        self.integral = (self.integral + error * self.period).clamp(-most, most);
        (GAINS.0 * error + GAINS.1 * self.integral).clamp(-MOST, MOST)
    }

    /// Sleep a little, for the ring is full.
    pub(super) fn nap(&self) {
        std::thread::sleep(Duration::from_secs_f64(LOOK * self.period));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A card whose clock is off by a part in a thousand takes frames out of the ring; the clock follows it.
    #[test]
    fn the_ring_settles_at_its_target_whatever_the_card_does() {
        for drift in [-2e-3, 0.0, 1e-3, 3e-3] {
            let (frames, period, target) = (44.0, 1e-3, 1_024);
            let mut clock = Clock::new(period, target, true, true);
            let mut filled = 1_024.0;
            let mut widest: f64 = 0.0;
            for tick in 0..120_000 {
                let stretched = period * (1.0 + clock.steer(filled as usize, true));
                filled += frames - frames / period * (1.0 + drift) * stretched;
                if tick > 60_000 {
                    widest = widest.max((filled - 1_024.0).abs());
                }
            }
            assert!(widest < 60.0, "drift {drift}: {widest} frames off");
        }
    }

    #[test]
    fn a_late_tick_is_told_and_a_lost_one_sets_the_clock_anew() {
        // Ticks so long that no stall of a busy machine counts; what passed is said, not slept.
        const PERIOD: f64 = 0.5;
        let mut clock = Clock::new(PERIOD, 64, true, true);
        let passed = |clock: &mut Clock, ticks: f64| {
            let ago = Duration::from_secs_f64(ticks * PERIOD);
            clock.due = clock.due.and_then(|due| due.checked_sub(ago));
            assert!(clock.due.is_some());
        };
        assert!(!clock.tick(0, false).lost);
        passed(&mut clock, 2.0);
        let beat = clock.tick(64, true);
        assert!(beat.late.as_secs_f64() > 0.9 * PERIOD, "{beat:?}");
        assert!(!beat.lost, "{beat:?}");
        passed(&mut clock, 2.0 + 2.0 * f64::from(LOST));
        assert!(clock.tick(64, true).lost);
        assert!(clock.tick(64, true).late.as_secs_f64() < 0.9 * PERIOD);
    }
}
