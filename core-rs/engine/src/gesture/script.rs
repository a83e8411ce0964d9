//! A gesture placed in the piece: what is asked of a key, in seconds and metres.

use super::error::GestureError;
use super::placed::Placed;
use super::quintic::Knot;
use crate::units::frame;

/// How the written hand holds the key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Touch {
    /// The ergons are computed for the free key; the instrument pushes back.
    Open,
    /// The ergons are whatever keeps the key on the path.
    Tracked,
}

/// What an ergon is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ergons {
    /// An exact impulse; its flight is not stepped.
    Event,
    /// A real MAS that meets the key through a BUT.
    Particle,
}

/// How a gesture is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manner {
    /// How the hand holds the key.
    pub touch: Touch,
    /// What an ergon is.
    pub ergons: Ergons,
    /// Time between ergons along a path [s]; `None`: one a frame.
    pub grain: Option<f64>,
    /// Length of the joining curve [s].
    pub join: f64,
    /// Largest force of one ergon [N].
    pub limit: Option<f64>,
    /// Adds to what the key does already.
    pub layer: bool,
}

/// A stretch of a gesture. Stretches follow one another.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Stretch {
    /// Follow a path up to `stop` [s].
    Path { path: Placed, stop: f64 },
    /// One strike at `from` [s], then free until the key passes `x` [m] at `to` [s]; the written point that it goes to.
    Throw {
        from: f64,
        to: f64,
        x: f64,
        point: usize,
    },
}

/// A narrative gesture or a take, placed in time. It is the same at every rate.
#[derive(Clone, Debug)]
pub struct Gesture {
    pub(crate) key: usize,
    pub(crate) stretches: Vec<Stretch>,
    /// First written instant [s].
    pub(crate) start: f64,
    /// Position of the last written point [m].
    pub(crate) exit: f64,
    /// Where the first written point is, and how the path leaves it.
    pub(crate) entry: Knot,
    pub(crate) manner: Manner,
    /// Written points: their instants [s], rising, and their places in the score.
    pub(crate) points: Vec<(f64, u32)>,
}

impl Gesture {
    /// Whether a throw has a frame between its ends at a rate [Hz].
    ///
    /// # Errors
    /// [`GestureError::Short`] for the first throw that has none.
    pub(crate) fn check_rate(&self, rate: f64) -> Result<(), GestureError> {
        for stretch in &self.stretches {
            match *stretch {
                Stretch::Throw {
                    from, to, point, ..
                } if frame(to, rate) <= frame(from, rate) => {
                    return Err(GestureError::Short {
                        index: point,
                        from,
                        to,
                    });
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Whether it asks the same of its key as another, wherever in a score they stand.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let instants = |gesture: &Self| -> Vec<u64> {
            let points = gesture.points.iter();
            points.map(|(t, _)| t.to_bits()).collect()
        };
        self.manner == other.manner
            && self.stretches == other.stretches
            && instants(self) == instants(other)
    }

    /// The same on another key.
    pub(crate) fn on(self, key: usize) -> Self {
        Self { key, ..self }
    }

    /// Where the gesture wants the key as it begins, t [s].
    pub(crate) fn entry_at(&self, t: f64) -> f64 {
        match self.stretches.first() {
            Some(Stretch::Path { path, .. }) => path.at(t.max(self.start)).0,
            _ => self.entry.x,
        }
    }

    /// Lowest and highest position of the written points and of the paths between them [m].
    pub(crate) fn range(&self) -> (f64, f64) {
        let ends = (self.entry.x.min(self.exit), self.entry.x.max(self.exit));
        self.stretches.iter().fold(ends, |(low, high), stretch| {
            let (from, to) = match stretch {
                Stretch::Path { path, .. } => path.range(path.start(), path.stop()),
                Stretch::Throw { x, .. } => (*x, *x),
            };
            (low.min(from), high.max(to))
        })
    }
}
