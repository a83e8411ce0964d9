//! A real hand on a key: it sends a position at each tick and receives the mean force of the tick.
//!
//! The scheme is the same for a played key, a substitute and a recording: positions arrive at frames 0, R, 2R …, and
//! the forces of the links are averaged over the R frames between.

use std::sync::Arc;

use super::{Drive, DriveKind, DriveSource, StrikeError, Timeline};
use crate::network::Network;

/// Largest number of frames of a tick: 21 ms at 192 kHz.
pub(super) const TICK_FRAMES_MAX: u32 = 4_096;

/// Interpolation of a hand between two ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HandInterpolation {
    /// The position changes at the tick and holds: least delay.
    Hold,
    /// Linear over the tick, so that nothing rings at the rate of the ticks.
    #[default]
    Line,
}

/// A hand on a MAT.
#[derive(Clone, Debug)]
pub struct Hand {
    /// Index among the hands of the scene.
    pub(crate) index: usize,
    /// Frames from tick to tick.
    pub(crate) tick_frames: u32,
    /// Interpolation between ticks.
    pub(crate) interpolation: HandInterpolation,
    /// Position at each tick if no device sends another [m], (n_ticks); the last one holds.
    pub(crate) positions: Arc<[f64]>,
}

impl Hand {
    /// Position at frame `n` if no device sends another [m].
    pub(crate) fn position(&self, n: u64) -> f64 {
        let tick_index = usize::try_from(n / u64::from(self.tick_frames)).unwrap_or(usize::MAX);
        let last_index = self.positions.len().saturating_sub(1);
        self.positions.get(tick_index.min(last_index)).copied().unwrap_or(0.0)
    }

    /// The hand at `oversampling` times the rate.
    pub(super) fn with_higher_rate(&self, oversampling: u32) -> Self {
        Self {
            tick_frames: self.tick_frames * oversampling,
            ..self.clone()
        }
    }
}

impl Timeline {
    /// Let a real hand move a MAT, in ticks of `tick_frames` frames; returns its index.
    ///
    /// `positions` [m]: position at each tick, (n_ticks), as recorded or as a substitute for a hand; empty: the initial
    /// position of the MAT.
    ///
    /// ```
    /// use ergon_engine::timeline::HandInterpolation;
    /// use ergon_engine::{Network, Rate, Timeline};
    ///
    /// let mut network = Network::new();
    /// let key = network.mas("key", 0.4, 0.0, 0.0)?;
    /// let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// let hand = timeline.add_hand(&network, key, 44, HandInterpolation::Line, &[0.0, 1e-3, 2e-3])?;
    /// assert_eq!(hand, 0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`StrikeError`] if the MAT cannot be imposed, the tick is not of 1 to 4096 frames or differs from that of other
    /// hands, or a position is not finite.
    pub fn add_hand(
        &mut self,
        network: &Network,
        mat: usize,
        tick_frames: u32,
        interpolation: HandInterpolation,
        positions: &[f64],
    ) -> Result<usize, StrikeError> {
        super::check_movable(network, mat)?;
        if !(1..=TICK_FRAMES_MAX).contains(&tick_frames) {
            return Err(StrikeError::Tick(tick_frames));
        }
        if let Some(&wrong_position) = positions.iter().find(|x| !x.is_finite()) {
            return Err(StrikeError::Value("a hand's position", "", wrong_position));
        }
        let other_frames = self.hands().next().map(|hand| hand.tick_frames);
        if let Some(other_frames) = other_frames.filter(|&other_frames| other_frames != tick_frames) {
            return Err(StrikeError::TickDiffers(other_frames, tick_frames));
        }
        let index = self.hands().count();
        let positions = match positions {
            [] => [network.mats().x0[mat]].into(),
            positions => positions.into(),
        };
        let hand = Hand {
            index,
            tick_frames,
            interpolation,
            positions,
        };
        self.drive(mat, DriveKind::Position, DriveSource::Hand(hand), false)?;
        Ok(index)
    }

    /// The hands of the timeline, in order of declaration.
    pub(crate) fn hands(&self) -> impl Iterator<Item = &Hand> {
        self.drives.iter().filter_map(Drive::hand)
    }
}
