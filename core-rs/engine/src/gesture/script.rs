//! A gesture placed in the piece: the path asked of a key, in seconds and metres.

use super::error::GestureError;
use super::placed::PlacedPath;
use super::quintic::Knot;
use crate::units::frame;

/// How the written hand holds the key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Touch {
    /// Ergons are computed for the free key, so forces of the instrument move the key off its path.
    Open,
    /// Ergons have the size that keeps the key on its path.
    Tracked,
}

/// How an ergon is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErgonKind {
    /// As an exact impulse, without a flying mass.
    Event,
    /// As a MAS that flies and hits the key through a BUT.
    Particle,
}

/// How a gesture is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manner {
    /// How the hand holds the key.
    pub touch: Touch,
    /// How an ergon is computed.
    pub ergon_kind: ErgonKind,
    /// Time between ergons along a path [s]; `None`: one per frame.
    pub grain: Option<f64>,
    /// Length of the joining curve [s].
    pub join_seconds: f64,
    /// Largest force of one ergon [N]; `None`: no limit.
    pub force_max: Option<f64>,
    /// Whether the gesture is added to the motion that the key already has.
    pub is_layer: bool,
}

impl Manner {
    /// The defaults of a score: exact impulses at every frame, and 20 ms to join.
    pub const OPEN: Self = Self {
        touch: Touch::Open,
        ergon_kind: ErgonKind::Event,
        grain: None,
        join_seconds: 0.02,
        force_max: None,
        is_layer: false,
    };
}

/// A part of a gesture in which the key is moved in one way. Stretches follow one another in time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum GestureSegment {
    /// Follow a path up to `stop` [s].
    Path { path: PlacedPath, stop: f64 },
    /// One strike at `strike_instant` [s]; the key then flies freely and passes `arrival_position` [m] at
    /// `arrival_instant` [s], the written point `point`.
    Throw {
        strike_instant: f64,
        arrival_instant: f64,
        arrival_position: f64,
        point: usize,
    },
}

/// A written gesture or a take, placed in time. It does not depend on the rate.
#[derive(Clone, Debug)]
pub struct Gesture {
    pub(crate) key: usize,
    pub(crate) segments: Vec<GestureSegment>,
    /// First written instant [s].
    pub(crate) start: f64,
    /// Position of the last written point [m].
    pub(crate) last_position: f64,
    /// Position, velocity and acceleration of the path at its first written point.
    pub(crate) entry_knot: Knot,
    pub(crate) manner: Manner,
    /// (instant [s], place in the score) of each written point, rising.
    pub(crate) points: Vec<(f64, u32)>,
}

impl Gesture {
    /// Check that every throw has a frame between its ends at a rate [Hz].
    ///
    /// # Errors
    /// [`GestureError::ThrowTooShort`] for the first throw that has none.
    pub(crate) fn check_rate(&self, rate: f64) -> Result<(), GestureError> {
        for stretch in &self.segments {
            match *stretch {
                GestureSegment::Throw {
                    strike_instant,
                    arrival_instant,
                    point,
                    ..
                } if frame(arrival_instant, rate) <= frame(strike_instant, rate) => {
                    return Err(GestureError::ThrowTooShort {
                        index: point,
                        from: strike_instant,
                        to: arrival_instant,
                    });
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Whether another gesture asks for the same path in the same manner, wherever it is in the score.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let instants = |gesture: &Self| -> Vec<u64> {
            let gesture_points = gesture.points.iter();
            gesture_points.map(|(t, _)| t.to_bits()).collect()
        };
        self.manner == other.manner && self.segments == other.segments && instants(self) == instants(other)
    }

    /// The gesture on another key.
    pub(crate) fn with_key(self, key: usize) -> Self {
        Self { key, ..self }
    }

    /// The position [m] that the gesture asks for if it begins at `t` [s].
    pub(crate) fn entry_at(&self, t: f64) -> f64 {
        match self.segments.first() {
            Some(GestureSegment::Path { path, .. }) => path.evaluate(t.max(self.start)).0,
            _ => self.entry_knot.x,
        }
    }

    /// Lowest and highest position of the written points and of the paths between them [m].
    pub(crate) fn range(&self) -> (f64, f64) {
        let written_range = (
            self.entry_knot.x.min(self.last_position),
            self.entry_knot.x.max(self.last_position),
        );
        self.segments.iter().fold(written_range, |(low, high), stretch| {
            let (stretch_low, stretch_high) = match stretch {
                GestureSegment::Path { path, .. } => path.range(path.start_time(), path.end_time()),
                GestureSegment::Throw {
                    arrival_position: x, ..
                } => (*x, *x),
            };
            (low.min(stretch_low), high.max(stretch_high))
        })
    }
}
