//! A hand while it plays: the person's, or what stands in for it, and the way from one to the other.

use super::guidance::{Guidance, smooth};

/// A change of hands moves the key by no more than this in a tick [m].
const STEP: f64 = 5e-5;
/// It lasts so many ticks at least, and at most.
const TICKS: (f64, f64) = (20.0, 4_000.0);
/// The steepest of the way from 0 to 1, where all of it is 1.
const STEEPEST: f64 = 1.875;

/// A hand of the piece.
#[derive(Clone, Debug, Default)]
pub struct Hand {
    /// Where it is at each tick while nobody is there, in the key's own metres; after the last it stays.
    pub standin: Vec<f64>,
    /// The tick of the first of them.
    pub since: u64,
    /// The scene sees this many times its travel, and it feels this many times the scene's force.
    pub reach: f64,
    /// A force that leads it.
    pub guidance: Option<Guidance>,
    /// The scene's force against it [N/m] in each tick after it was 1 m away for one (n_ticks,); empty: nobody looked.
    pub response: Vec<f64>,
}

/// Who moves a key, and the rest of the way from whoever did before.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Mover {
    /// A person does.
    pub(super) real: bool,
    /// Where the key is.
    pub(super) x: f64,
    /// What is left to go [m] of a change of hands that takes `ticks`, of which `done`.
    offset: f64,
    ticks: f64,
    done: f64,
}

impl Hand {
    /// Where it stands in at a tick.
    pub(super) fn stands_at(&self, tick: u64) -> f64 {
        let at = usize::try_from(tick.saturating_sub(self.since)).unwrap_or(usize::MAX);
        let last = self.standin.len().saturating_sub(1);
        self.standin.get(at.min(last)).copied().unwrap_or(0.0)
    }
}

impl Mover {
    /// Another moves the key from now on, who is at `x`; it goes there without a jump.
    pub(super) fn change(&mut self, real: bool, x: f64) {
        self.real = real;
        self.offset = self.x - x;
        self.ticks = (STEEPEST * self.offset.abs() / STEP).clamp(TICKS.0, TICKS.1);
        self.done = 0.0;
    }

    /// Where the key is in this tick, if whoever moves it is at `x`.
    pub(super) fn follow(&mut self, x: f64) -> f64 {
        self.x = if self.done < self.ticks {
            self.done += 1.0;
            x + self.offset * (1.0 - self.share())
        } else {
            x
        };
        self.x
    }

    /// How far the change of hands is, 0 to 1: so much of the force a person feels.
    pub(super) fn share(&self) -> f64 {
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
            let mut mover = Mover::default();
            mover.follow(0.0);
            mover.change(true, apart);
            let mut last = 0.0;
            let mut n = 0;
            while mover.share() < 1.0 {
                let x = mover.follow(apart);
                assert!((x - last).abs() < 1e-4, "{} mm", 1e3 * (x - last));
                last = x;
                n += 1;
            }
            assert_eq!(last, apart);
            assert!((20..=4_000).contains(&n), "{n} ticks");
        }
    }
}
