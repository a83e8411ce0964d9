//! A hand while it plays, moved by a person or by its stand-in, and the transition between them.

use super::guidance::{Guidance, smooth};
use super::hand_limit::MeasuredKey;

/// Largest motion of the key in one tick of a transition [m].
const MAX_STEP: f64 = 5e-5;
/// Least and greatest number of ticks of a transition.
const TICKS_RANGE: (f64, f64) = (20.0, 4_000.0);
/// Greatest slope of `smooth`, the transition from 0 to 1 over a length of 1.
const MAX_SLOPE: f64 = 1.875;

/// A hand of the piece.
#[derive(Clone, Debug, Default)]
pub struct Hand {
    /// Position at each tick while no person plays [m of the key]; the last one holds.
    pub standin: Vec<f64>,
    /// Tick of the first of these positions.
    pub since: u64,
    /// Factor from the travel of the key to that in the piece, and from the force of the piece to that on the key.
    pub reach: f64,
    /// The guidance of the hand.
    pub guidance: Option<Guidance>,
    /// Force of the piece against the key [N/m] in each tick after the key was displaced by 1 m for one tick,
    /// (n_ticks,); empty: not computed.
    pub response: Vec<f64>,
    /// The measured key, if there is a calibration.
    pub measured: Option<MeasuredKey>,
}

/// Who moves a key, and the state of the transition from the source before.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct HandSource {
    /// Whether a person moves the key; otherwise its stand-in does.
    pub(super) real: bool,
    /// Position of the key [m].
    pub(super) x: f64,
    /// Distance between both sources at the beginning of a transition [m]; the ticks that the transition takes, and
    /// those done.
    offset: f64,
    ticks: f64,
    done: f64,
}

impl Hand {
    /// Position of the stand-in at a tick [m].
    pub(super) fn standin_position(&self, tick: u64) -> f64 {
        let index = usize::try_from(tick.saturating_sub(self.since)).unwrap_or(usize::MAX);
        let last = self.standin.len().saturating_sub(1);
        self.standin.get(index.min(last)).copied().unwrap_or(0.0)
    }
}

impl HandSource {
    /// Begin a transition to another source of the key, who is at `x`.
    pub(super) fn change(&mut self, real: bool, x: f64) {
        self.real = real;
        self.offset = self.x - x;
        self.ticks = (MAX_SLOPE * self.offset.abs() / MAX_STEP).clamp(TICKS_RANGE.0, TICKS_RANGE.1);
        self.done = 0.0;
    }

    /// Position of the key in this tick, if its source is at `x`.
    pub(super) fn follow(&mut self, x: f64) -> f64 {
        self.x = if self.done < self.ticks {
            self.done += 1.0;
            x + self.offset * (1.0 - self.progress())
        } else {
            x
        };
        self.x
    }

    /// Progress of the transition, 0 to 1; a person feels this share of the force.
    pub(super) fn progress(&self) -> f64 {
        if self.done < self.ticks {
            smooth(self.done / self.ticks)
        } else {
            1.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_of_hands_never_jumps() {
        for apart in [1e-5, 3e-3, -12e-3, 60e-3] {
            let mut source = HandSource::default();
            source.follow(0.0);
            source.change(true, apart);
            let mut last = 0.0;
            let mut n = 0;
            while source.progress() < 1.0 {
                let x = source.follow(apart);
                assert!((x - last).abs() < 1e-4, "{} mm", 1e3 * (x - last));
                last = x;
                n += 1;
            }
            assert_eq!(last, apart);
            assert!((20..=4_000).contains(&n), "{n} ticks");
        }
    }
}
