//! Making gestures from written points and from takes.

use std::sync::Arc;

use super::error::GestureError;
use super::placed::PlacedPath;
use super::profile::{Curve, PathError, Point, Profile};
use super::quintic::Knot;
use super::script::{ErgonKind, Gesture, GestureSegment, Manner, Touch};

/// How the key goes to a written point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Approach {
    /// Along a curve, driven by ergons all the way.
    Path(Curve),
    /// In free flight, after one strike at the previous point.
    Throw,
}

/// The points of a written gesture, (n_points) each.
#[derive(Clone, Copy, Debug)]
pub struct WrittenPoints<'a> {
    /// Instants [s].
    pub t: &'a [f64],
    /// Positions [m].
    pub x: &'a [f64],
    /// How the key goes to each point; that of the first point is ignored.
    pub approaches: &'a [Approach],
    /// Places in the score, or empty.
    pub sources: &'a [u32],
}

impl Gesture {
    /// A written gesture on a key.
    ///
    /// ```
    /// use ergon_engine::gesture::profile::Curve;
    /// use ergon_engine::gesture::script::{ErgonKind, Gesture, Manner, Touch};
    /// use ergon_engine::gesture::written::{Approach, WrittenPoints};
    ///
    /// let smooth = Approach::Path(Curve::Smooth);
    /// let points = WrittenPoints {
    ///     t: &[0.0, 0.06, 0.16],
    ///     x: &[0.0, 6e-3, 0.0],
    ///     approaches: &[smooth, smooth, Approach::Throw],
    ///     sources: &[],
    /// };
    /// let manner = Manner {
    ///     touch: Touch::Open, ergon_kind: ErgonKind::Event, grain: None, join_seconds: 0.02, force_max: None,
    /// is_layer: false, };
    /// Gesture::from_points(0, &points, manner)?;
    /// assert!(Gesture::from_points(0, &points, Manner { join_seconds: -1.0, ..manner }).is_err());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`GestureError`] names the point at fault.
    pub fn from_points(key: usize, points: &WrittenPoints<'_>, manner: Manner) -> Result<Self, GestureError> {
        let n_points = points.t.len();
        if n_points == 0 {
            return Err(PathError::Empty.into());
        }
        if points.x.len() != n_points
            || points.approaches.len() != n_points
            || ![0, n_points].contains(&points.sources.len())
        {
            return Err(GestureError::LengthMismatch);
        }
        let is_finite = |i: &usize| points.t[*i].is_finite() && points.x[*i].is_finite();
        if let Some(index) = (0..n_points).find(|i| !is_finite(i)) {
            let (t, x) = (points.t[index], points.x[index]);
            return Err(PathError::NotFinite { index, t, x }.into());
        }
        let point_source = |i: usize| points.sources.get(i).copied().unwrap_or(0);
        Self::new(
            key,
            segments(points)?,
            points.t[0],
            [points.x[0], points.x[n_points - 1]],
            (0..n_points).map(|i| (points.t[i], point_source(i))).collect(),
            manner,
        )
    }

    /// A gesture that plays a take on a key, cut at `cut_instant` [s].
    ///
    /// # Errors
    /// [`GestureError`] if `manner` has a number out of range, or tracks the key by particles.
    pub fn from_take(
        key: usize,
        path: PlacedPath,
        cut_instant: Option<f64>,
        source: u32,
        manner: Manner,
    ) -> Result<Self, GestureError> {
        let take_start = path.start_time();
        let stop = cut_instant.map_or(path.end_time(), |instant| instant.min(path.end_time()));
        let end_positions = [path.evaluate(take_start).0, path.evaluate(stop).0];
        let segments = vec![GestureSegment::Path { path, stop }];
        // A take has no written points that ergons have to meet: its single point is at frame 0, before the take.
        Self::new(key, segments, take_start, end_positions, vec![(0.0, source)], manner)
    }

    fn new(
        key: usize,
        segments: Vec<GestureSegment>,
        start: f64,
        [x, last_position]: [f64; 2],
        points: Vec<(f64, u32)>,
        manner: Manner,
    ) -> Result<Self, GestureError> {
        manner.check()?;
        let entry_knot = match segments.first() {
            Some(GestureSegment::Path { path, .. }) => {
                let (x, v, a) = path.evaluate(start);
                Knot { t: start, x, v, a }
            }
            _ => Knot {
                t: start,
                x,
                ..Knot::default()
            },
        };
        Ok(Self {
            key,
            segments,
            start,
            last_position,
            entry_knot,
            manner,
            points,
        })
    }
}

impl Manner {
    fn check(&self) -> Result<(), GestureError> {
        let check_bound = |name, value: f64, value_min: f64| {
            if value.is_finite() && value >= value_min {
                Ok(())
            } else {
                Err(GestureError::NotPositive { what: name, value })
            }
        };
        if (self.touch, self.ergon_kind) == (Touch::Tracked, ErgonKind::Particle) {
            return Err(GestureError::TrackedParticle);
        }
        check_bound("join", self.join_seconds, 0.0)?;
        if let Some(force_limit) = self.force_max {
            check_bound("force_limit", force_limit, f64::MIN_POSITIVE)?;
        }
        self.grain
            .map_or(Ok(()), |grain| check_bound("grain", grain, f64::MIN_POSITIVE))
    }

    /// Largest force of one ergon [N]; infinite if there is no limit.
    pub(crate) fn force_limit(&self) -> f64 {
        self.force_max.unwrap_or(f64::INFINITY)
    }
}

fn segments(points: &WrittenPoints<'_>) -> Result<Vec<GestureSegment>, GestureError> {
    let WrittenPoints { t, x, approaches, .. } = *points;
    let mut stretches = Vec::new();
    let mut point_index = 0;
    while point_index + 1 < t.len() {
        let is_throw = |approach: &Approach| *approach == Approach::Throw;
        if is_throw(&approaches[point_index + 1]) {
            stretches.push(GestureSegment::Throw {
                strike_instant: t[point_index],
                arrival_instant: t[point_index + 1],
                arrival_position: x[point_index + 1],
                point: point_index + 1,
            });
            point_index += 1;
        } else {
            let run_length = approaches[point_index + 1..]
                .iter()
                .take_while(|approach| !is_throw(approach))
                .count();
            stretches.push(path_segment(points, point_index, point_index + run_length)?);
            point_index += run_length;
        }
    }
    if stretches.is_empty() {
        stretches.push(path_segment(points, 0, 0)?);
    }
    Ok(stretches)
}

/// The path through points `first_index..=last_index`.
fn path_segment(
    points: &WrittenPoints<'_>,
    first_index: usize,
    last_index: usize,
) -> Result<GestureSegment, GestureError> {
    let path_point = |i: usize| Point {
        t: points.t[i],
        x: points.x[i],
        curve: match points.approaches[i] {
            Approach::Path(curve) => curve,
            Approach::Throw => Curve::Hold,
        },
    };
    let points: Vec<Point> = (first_index..=last_index).map(path_point).collect();
    let stop = points[points.len() - 1].t;
    let path = PlacedPath::new(Arc::new(Profile::through_points(&points)?), 0.0)?;
    Ok(GestureSegment::Path { path, stop })
}
