//! A real hand on a key: where it is comes in by ticks, and the mean force of a tick goes back to it.
//!
//! One scheme for a key that is played, for what stands in for it and for what was recorded of it: positions come in at
//! frames 0, R, 2R …, and what the links pull with is averaged over the R frames between.

use std::sync::Arc;

use super::{Drive, DriveKind, Source, StrikeError, Timeline};
use crate::network::Network;

/// Most frames of a tick: at 192 kHz still faster than a hand.
const TICK_MAX: u32 = 4_096;

/// How a hand goes from where it was at one tick to where it is at the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HandWay {
    /// At once, and stays: it answers soonest.
    Hold,
    /// Evenly over the tick: nothing rings at the rate of the ticks.
    #[default]
    Line,
}

/// A hand on a MAT.
#[derive(Clone, Debug)]
pub struct Hand {
    /// Which of the scene's hands it is.
    pub(crate) index: usize,
    /// Frames of a tick.
    pub(crate) every: u32,
    /// How it goes from one tick to the next.
    pub(crate) way: HandWay,
    /// Where it is at each tick, if nobody says otherwise [m]; after the last it stays there.
    pub(crate) positions: Arc<[f64]>,
}

impl Hand {
    /// Where it is at frame `n`, if nobody says otherwise [m].
    pub(crate) fn at(&self, n: u64) -> f64 {
        let tick = usize::try_from(n / u64::from(self.every)).unwrap_or(usize::MAX);
        let last = self.positions.len().saturating_sub(1);
        self.positions.get(tick.min(last)).copied().unwrap_or(0.0)
    }

    /// The same at `times` the rate.
    pub(super) fn faster(&self, times: u32) -> Self {
        Self {
            every: self.every * times,
            ..self.clone()
        }
    }
}

impl Timeline {
    /// Let a real hand move a MAT, in ticks of `every` frames; returns its index.
    ///
    /// `positions` [m]: where it is at each tick (n_ticks), what stands in for it or was recorded of it; none: where the
    /// MAT begins.
    pub fn hand(
        &mut self,
        network: &Network,
        mat: usize,
        every: u32,
        way: HandWay,
        positions: &[f64],
    ) -> Result<usize, StrikeError> {
        super::movable(network, mat)?;
        if !(1..=TICK_MAX).contains(&every) {
            let why = " of frames from 1 to 4096";
            return Err(StrikeError::Value("a tick", why, f64::from(every)));
        }
        if let Some(&wrong) = positions.iter().find(|x| !x.is_finite()) {
            return Err(StrikeError::Value("a hand's position", "", wrong));
        }
        if self.hands().any(|hand| hand.every != every) {
            let why = " of frames that all hands share";
            return Err(StrikeError::Value("a tick", why, f64::from(every)));
        }
        let index = self.hands().count();
        let positions = match positions {
            [] => [network.mats().x0[mat]].into(),
            positions => positions.into(),
        };
        let hand = Hand {
            index,
            every,
            way,
            positions,
        };
        self.drive(mat, DriveKind::Position, Source::Hand(hand), false)?;
        Ok(index)
    }

    /// Its hands, in order.
    pub(crate) fn hands(&self) -> impl Iterator<Item = &Hand> {
        self.drives.iter().filter_map(Drive::hand)
    }
}
