//! A gesture placed in the piece: what is asked of a key, sample by sample.

use std::sync::Arc;

use super::placed::Placed;
use super::quintic::Knot;
use super::written::{GestureError, Manner, Way, Written};
use crate::timeline::frame;

/// Half-way between two frames a knot is rounded up, whatever the last bit of its instant [frames].
const KNOT_SLACK: f64 = 1e-6;

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

/// A stretch of a gesture. Legs cover the targets (frames at which a position is due) one after
/// the other: a leg's first target is the one after the last of the leg before it.
#[derive(Clone, Debug)]
pub(crate) enum Leg {
    /// Follow a path; the targets end with `last`.
    Path { path: Placed, last: u64 },
    /// One strike at frame `from`, then free until the key passes `x` at frame `to`.
    Throw { from: u64, to: u64, x: f64 },
}

impl Leg {
    pub(crate) fn last(&self) -> u64 {
        match self {
            Self::Path { last, .. } => *last,
            Self::Throw { to, .. } => *to,
        }
    }
}

/// What a gesture was made from, to be made again at another rate.
#[derive(Clone, Debug)]
pub(crate) enum Recipe {
    Written {
        /// Instant [s], position [m], way into it, place in the score: together, for there may be many.
        points: Box<[(f64, f64, Way, u32)]>,
        manner: Manner,
    },
    Taken {
        path: Placed,
        until: Option<f64>,
        source: u32,
        manner: Manner,
    },
}

/// A narrative gesture or a take, placed.
#[derive(Clone, Debug)]
pub struct Gesture {
    pub(crate) recipe: Arc<Recipe>,
    pub(crate) key: usize,
    pub(crate) legs: Vec<Leg>,
    /// First written instant [s].
    pub(crate) start: f64,
    /// Last frame at or before the start: the gesture takes over there, for the targets after it.
    pub(crate) first: u64,
    /// Frame at which a joining curve begins.
    pub(crate) join_from: u64,
    /// Position of the last written point [m].
    pub(crate) exit: f64,
    /// Where the first written point is, and how the path leaves it.
    pub(crate) entry: Knot,
    pub(crate) touch: Touch,
    pub(crate) ergons: Ergons,
    /// Time between ergons along a path [s]; `None`: one a frame.
    pub(crate) grain: Option<f64>,
    /// Length of the joining curve [s].
    pub(crate) join: f64,
    /// Largest force of one ergon [N].
    pub(crate) limit: f64,
    pub(crate) layer: bool,
    /// Written points: their frames, rising, and the places in the score of the ergons up to them.
    pub(crate) sources: Vec<(u64, u32)>,
}

impl Gesture {
    /// The same at another rate [Hz].
    pub(crate) fn at_rate(&self, rate: f64) -> Result<Self, GestureError> {
        match &*self.recipe {
            Recipe::Written { points, manner } => {
                let t: Vec<f64> = points.iter().map(|point| point.0).collect();
                let x: Vec<f64> = points.iter().map(|point| point.1).collect();
                let way: Vec<Way> = points.iter().map(|point| point.2).collect();
                let sources: Vec<u32> = points.iter().map(|point| point.3).collect();
                let points = Written {
                    t: &t,
                    x: &x,
                    way: &way,
                    sources: &sources,
                };
                Self::written(self.key, &points, *manner, rate)
            }
            Recipe::Taken {
                path,
                until,
                source,
                manner,
            } => Self::taken(self.key, path.clone(), *until, *source, *manner, rate),
        }
    }

    /// Whether it asks the same of its key as another, wherever in a score they stand.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        match (&*self.recipe, &*other.recipe) {
            (
                Recipe::Written { points, manner },
                Recipe::Written {
                    points: others,
                    manner: their,
                },
            ) => {
                let what = |&(t, x, way, _): &(f64, f64, Way, u32)| (t, x, way);
                manner == their && points.iter().map(what).eq(others.iter().map(what))
            }
            (
                Recipe::Taken {
                    path,
                    until,
                    manner,
                    ..
                },
                Recipe::Taken {
                    path: other,
                    until: then,
                    manner: their,
                    ..
                },
            ) => (path, until, manner) == (other, then, their),
            _ => false,
        }
    }

    /// The same on another key.
    pub(crate) fn on(self, key: usize) -> Self {
        Self { key, ..self }
    }

    /// Where the gesture wants the key as it begins, t [s].
    pub(crate) fn entry_at(&self, t: f64) -> f64 {
        match self.legs.first() {
            Some(Leg::Path { path, .. }) => path.at(t.max(self.start)).0,
            _ => self.entry.x,
        }
    }

    /// Lowest and highest position of the written points and of the paths between them [m].
    pub(crate) fn range(&self) -> (f64, f64) {
        let ends = (self.entry.x.min(self.exit), self.entry.x.max(self.exit));
        self.legs.iter().fold(ends, |(low, high), leg| {
            let (from, to) = match leg {
                Leg::Path { path, .. } => path.range(path.start(), path.stop()),
                Leg::Throw { x, .. } => (*x, *x),
            };
            (low.min(from), high.max(to))
        })
    }

    /// The last frame at which a position is due.
    pub(crate) fn last(&self) -> u64 {
        self.legs.last().map_or(self.first, Leg::last)
    }

    /// The frame after `n` at which the next grain is due: a multiple of the grain since the start,
    /// or a written point before it.
    pub(crate) fn knot_after(&self, n: u64, grain: f64, rate: f64) -> u64 {
        // Of grains shorter than a frame one is due at every frame; there may be too many to count.
        if grain * rate <= 1.0 {
            return n + 1;
        }
        let knot = |k: f64| frame(self.start + k * grain + KNOT_SLACK / rate, rate);
        let mut k = ((n as f64 / rate - self.start) / grain).floor().max(0.0);
        while knot(k) <= n {
            k += 1.0;
        }
        let knot = knot(k);
        let next = self.sources.partition_point(|&(point, _)| point <= n);
        self.sources
            .get(next)
            .map_or(knot, |&(point, _)| knot.min(point))
    }

    /// Source of an ergon whose target is frame `target`; `cursor` only moves forward.
    pub(crate) fn source(&self, cursor: &mut usize, target: u64) -> u32 {
        while *cursor + 1 < self.sources.len() && self.sources[*cursor].0 < target {
            *cursor += 1;
        }
        self.sources.get(*cursor).map_or(0, |&(_, source)| source)
    }
}

/// What became of a gesture.
#[derive(Clone, Copy, Debug)]
pub struct Report {
    /// Ergons that struck.
    pub n_ergons: u64,
    /// First and last instants it ran [s]; NaN when it never did.
    pub start: f64,
    /// See `start`.
    pub stop: f64,
    /// Largest |done − asked| on the loaded key [m].
    pub worst: f64,
    /// When that was [s].
    pub worst_at: f64,
    /// The MAT of another part that pushed most, where it was worst.
    pub pushed_by: Option<usize>,
    /// Sum of (done − asked)² and number of frames compared.
    pub square: f64,
    /// See `square`.
    pub compared: u64,
    /// Lowest and highest position of the free key, up to the next gesture [m].
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// Largest velocity step of one ergon [m/s].
    pub strongest: f64,
    /// Largest force of one ergon [N].
    pub force_max: f64,
    /// Steps that needed more than the force limit.
    pub missed: u64,
    /// It cut another gesture and joined after its start.
    pub first_point_missed: bool,
}

impl Default for Report {
    fn default() -> Self {
        Self {
            n_ergons: 0,
            start: f64::NAN,
            stop: f64::NAN,
            worst: 0.0,
            worst_at: f64::NAN,
            pushed_by: None,
            square: 0.0,
            compared: 0,
            low: f64::INFINITY,
            high: f64::NEG_INFINITY,
            strongest: 0.0,
            force_max: 0.0,
            missed: 0,
            first_point_missed: false,
        }
    }
}

impl Report {
    /// Root of the mean square of done − asked [m].
    pub fn rms(&self) -> f64 {
        if self.compared == 0 {
            0.0
        } else {
            (self.square / self.compared as f64).sqrt()
        }
    }
}
