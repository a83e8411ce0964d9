//! Written points and takes → legs of a gesture.

use std::sync::Arc;

use super::placed::Placed;
use super::profile::{Curve, PathError, Point, Profile};
use super::quintic::Knot;
use super::script::{Ergons, Gesture, Leg, Recipe, Touch};
use crate::units::{floor_frame, frame};

/// An instant this close before a frame [frames] falls on it: what dividing beats by tempo leaves.
const SLACK: f64 = 1e-6;

/// The way into a written point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// Along a curve, held by ergons all the way.
    Path(Curve),
    /// One strike at the point before, then free.
    Throw,
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

/// Points of a narrative gesture, (n_points) each.
#[derive(Clone, Copy, Debug)]
pub struct Written<'a> {
    /// Instants [s].
    pub t: &'a [f64],
    /// Positions [m].
    pub x: &'a [f64],
    /// Ways into the points; the first is not read.
    pub way: &'a [Way],
    /// Places in the score, or empty.
    pub sources: &'a [u32],
}

/// Why points make no gesture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GestureError {
    /// A stretch of curves.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A gesture on a key that is not there.
    #[error("there is no key {0}")]
    NoKey(usize),
    /// Arrays of different lengths.
    #[error("a gesture has as many positions and curves as instants")]
    Shape,
    /// A throw with no frame between its ends.
    #[error(
        "point {index}: a throw needs time: from {from} s to {to} s there is not one audio sample"
    )]
    Short {
        /// The point thrown to, from 0.
        index: usize,
        /// When it is struck [s].
        from: f64,
        /// When it is to be there [s].
        to: f64,
    },
    /// Ergons that keep a key on its path cannot be launched before the path's forces are known.
    #[error(
        "tracked ergons are events: a particle flies before the force that it must give is known"
    )]
    TrackedParticle,
    /// A joining time, force limit or grain that is no positive number.
    #[error("{what} must be a positive number, not {value}")]
    Positive {
        /// Which.
        what: &'static str,
        /// What was given.
        value: f64,
    },
}

impl Gesture {
    /// A narrative gesture on a key, at `rate` [Hz].
    pub fn written(
        key: usize,
        points: &Written<'_>,
        manner: Manner,
        rate: f64,
    ) -> Result<Self, GestureError> {
        let n = points.t.len();
        if n == 0 {
            return Err(PathError::Empty.into());
        }
        if points.x.len() != n || points.way.len() != n || ![0, n].contains(&points.sources.len()) {
            return Err(GestureError::Shape);
        }
        let finite = |i: &usize| points.t[*i].is_finite() && points.x[*i].is_finite();
        if let Some(index) = (0..n).find(|i| !finite(i)) {
            let (t, x) = (points.t[index], points.x[index]);
            return Err(PathError::NotFinite { index, t, x }.into());
        }
        let legs = legs(points, rate)?;
        let source = |i: usize| points.sources.get(i).copied().unwrap_or(0);
        let sources = (0..n)
            .map(|i| (frame(points.t[i], rate), source(i)))
            .collect();
        let point = |i: usize| (points.t[i], points.x[i], points.way[i], source(i));
        let recipe = Recipe::Written {
            points: (0..n).map(point).collect(),
            manner,
        };
        Self::new(
            key,
            recipe,
            legs,
            points.t[0],
            [points.x[0], points.x[n - 1]],
            sources,
            manner,
            rate,
        )
    }

    /// A take on a key, cut at `until` [s].
    pub fn taken(
        key: usize,
        path: Placed,
        until: Option<f64>,
        source: u32,
        manner: Manner,
        rate: f64,
    ) -> Result<Self, GestureError> {
        let (start, stop) = (
            path.start(),
            until.map_or(path.stop(), |until| until.min(path.stop())),
        );
        let ends = [path.at(start).0, path.at(stop).0];
        let recipe = Recipe::Taken {
            path: path.clone(),
            until,
            source,
            manner,
        };
        let legs = vec![Leg::Path {
            path,
            last: floor(stop, rate),
        }];
        let sources = vec![(0, source)];
        Self::new(key, recipe, legs, start, ends, sources, manner, rate)
    }

    #[allow(clippy::too_many_arguments)] // private: the two constructors above are the doors
    fn new(
        key: usize,
        recipe: Recipe,
        legs: Vec<Leg>,
        start: f64,
        [x, exit]: [f64; 2],
        sources: Vec<(u64, u32)>,
        manner: Manner,
        rate: f64,
    ) -> Result<Self, GestureError> {
        let positive = |what, value: f64, least: f64| {
            if value.is_finite() && value >= least {
                Ok(value)
            } else {
                Err(GestureError::Positive { what, value })
            }
        };
        if (manner.touch, manner.ergons) == (Touch::Tracked, Ergons::Particle) {
            return Err(GestureError::TrackedParticle);
        }
        positive("join", manner.join, 0.0)?;
        if let Some(limit) = manner.limit {
            positive("force_limit", limit, f64::MIN_POSITIVE)?;
        }
        let grain = manner
            .grain
            .map(|grain| positive("grain", grain, f64::MIN_POSITIVE))
            .transpose()?;
        let entry = match legs.first() {
            Some(Leg::Path { path, .. }) => {
                let (x, v, a) = path.at(start);
                Knot { t: start, x, v, a }
            }
            _ => Knot {
                t: start,
                x,
                ..Knot::default()
            },
        };
        Ok(Self {
            recipe: Arc::new(recipe),
            key,
            legs,
            start,
            first: floor(start, rate),
            join_from: join_from(start, manner.join, rate),
            entry,
            touch: manner.touch,
            ergons: manner.ergons,
            grain,
            join: manner.join,
            exit,
            limit: manner.limit.unwrap_or(f64::INFINITY),
            layer: manner.layer,
            sources,
        })
    }
}

fn legs(points: &Written<'_>, rate: f64) -> Result<Vec<Leg>, GestureError> {
    let Written { t, x, way, .. } = *points;
    let mut legs = Vec::new();
    let mut i = 0;
    while i + 1 < t.len() {
        let end = if way[i + 1] == Way::Throw {
            let (from, to) = (frame(t[i], rate), frame(t[i + 1], rate));
            if to <= from {
                return Err(GestureError::Short {
                    index: i + 1,
                    from: t[i],
                    to: t[i + 1],
                });
            }
            legs.push(Leg::Throw {
                from,
                to,
                x: x[i + 1],
            });
            i + 1
        } else {
            let run = way[i + 1..]
                .iter()
                .take_while(|way| **way != Way::Throw)
                .count();
            legs.push(path(points, i, i + run, rate)?);
            i + run
        };
        i = end;
    }
    if legs.is_empty() {
        legs.push(path(points, 0, 0, rate)?);
    }
    Ok(legs)
}

/// The path through points `from..=to`.
fn path(points: &Written<'_>, from: usize, to: usize, rate: f64) -> Result<Leg, GestureError> {
    let point = |i: usize| Point {
        t: points.t[i],
        x: points.x[i],
        curve: match points.way[i] {
            Way::Path(curve) => curve,
            Way::Throw => Curve::Hold,
        },
    };
    let points: Vec<Point> = (from..=to).map(point).collect();
    let last = floor(points[points.len() - 1].t, rate);
    let path = Placed::new(Arc::new(Profile::through(&points)?), 0.0)?;
    Ok(Leg::Path { path, last })
}

/// The last frame at or before an instant.
fn floor(t: f64, rate: f64) -> u64 {
    floor_frame(t * rate + SLACK)
}

/// The frame at which a joining curve begins, to reach its gesture in time.
fn join_from(start: f64, join: f64, rate: f64) -> u64 {
    floor_frame(((start - join) * rate - SLACK).ceil())
}
