//! A path in time, made of quintic pieces, and the curves between its written points.

use thiserror::Error;

use super::quintic::{Knot, Quintic};
use super::spline::{self, Ends};

/// The curve that leads to a written point.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Curve {
    /// The path of least jerk through the whole run of successive `smooth` points, at rest at both ends of the run.
    Smooth,
    /// A straight line.
    Line,
    /// No motion.
    Hold,
}

/// A written point: pass `x` [m] at `t` [s].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Instant [s].
    pub t: f64,
    /// Position [m].
    pub x: f64,
    /// The curve from the previous point; that of the first point is ignored.
    pub curve: Curve,
}

/// Why points do not define a path.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PathError {
    /// No point at all.
    #[error("a path needs at least one point")]
    Empty,
    /// A coordinate is NaN or infinite.
    #[error("point {index} of the path is not finite: x = {x} m at t = {t} s")]
    NotFinite {
        /// Which point, from 0.
        index: usize,
        /// Its instant [s].
        t: f64,
        /// Its position [m].
        x: f64,
    },
    /// Two points in the wrong order, or at one instant.
    #[error("time must rise along a path: point {index} is at {t} s, the one before it at {previous_t} s")]
    NotRising {
        /// Which point, from 0.
        index: usize,
        /// Its instant [s].
        t: f64,
        /// The instant before it [s].
        previous_t: f64,
    },
    /// `hold` to another position.
    #[error(
        "`hold` stays: point {index} is at {x} m, the one before it at {previous_x} m; \
         use `line` or `smooth` to move"
    )]
    HoldMoves {
        /// Which point, from 0.
        index: usize,
        /// Its position [m].
        x: f64,
        /// The position before it [m].
        previous_x: f64,
    },
    /// A stretch that is not a positive number, or a scale or instant that is not finite.
    #[error(
        "a path is placed at a finite instant, with a finite scale and a stretch above zero; \
         here at {instant} s, scale {scale}, stretch {stretch}"
    )]
    Placement {
        /// Instant [s].
        instant: f64,
        /// Factor on positions.
        scale: f64,
        /// Factor on times.
        stretch: f64,
    },
}

/// A piecewise quintic path, at rest before its first knot and after its last.
///
/// Two successive knots may have the same instant, at which the velocity jumps; at that instant the later knot counts.
///
/// ```
/// use ergon_engine::gesture::profile::{Curve, Point, Profile};
///
/// let point = |t, x| Point { t, x, curve: Curve::Smooth };
/// let path = Profile::through_points(&[point(0.0, 0.0), point(0.1, 6e-3), point(0.3, 0.0)])?;
/// let (x, v, _) = path.evaluate(0.1);
/// assert!((x - 6e-3).abs() < 1e-12);
/// assert!(path.range(0.0, 0.3).1 >= 6e-3 && v.is_finite());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    t: Vec<f64>,
    x: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
}

/// Largest number of knots that a cursor steps over before a binary search replaces it.
const WALKED_KNOTS_MAX: usize = 8;

impl Profile {
    /// The path through written points, (n_points,), whose instants [s] rise strictly.
    ///
    /// # Errors
    /// If there are no points, a number is not finite, instants do not rise strictly, or a curve does not fit its
    /// points.
    pub fn through_points(points: &[Point]) -> Result<Self, PathError> {
        check_points(points)?;
        let mut profile = Self {
            t: Vec::new(),
            x: Vec::new(),
            v: Vec::new(),
            a: Vec::new(),
        };
        let first_point = points[0];
        profile.push_knot(Knot {
            t: first_point.t,
            x: first_point.x,
            ..Knot::default()
        });
        let mut run_start = 0;
        while run_start + 1 < points.len() {
            let run_curve = points[run_start + 1].curve;
            let run_length = match run_curve {
                Curve::Smooth => points[run_start + 1..]
                    .iter()
                    .take_while(|p| p.curve == run_curve)
                    .count(),
                Curve::Line | Curve::Hold => 1,
            };
            profile.push_run(&points[run_start..=run_start + run_length], run_curve);
            run_start += run_length;
        }
        Ok(profile)
    }

    /// The spline of least jerk through `t` [s] and `x` [m], both (n_knots,): not empty, finite, `t` rising strictly
    /// (the caller must check this).
    pub fn spline(t: Vec<f64>, x: Vec<f64>, ends: Ends) -> Self {
        let (v, a) = spline::slopes(&t, &x, ends);
        Self { t, x, v, a }
    }

    /// Append a run of points of one curve; its first point has been appended before.
    fn push_run(&mut self, points: &[Point], curve: Curve) {
        let t: Vec<f64> = points.iter().map(|p| p.t).collect();
        let x: Vec<f64> = points.iter().map(|p| p.x).collect();
        let (v, a) = match curve {
            Curve::Smooth => spline::slopes(&t, &x, Ends::CLAMPED_AT_REST),
            Curve::Line => (vec![(x[1] - x[0]) / (t[1] - t[0]); 2], vec![0.0; 2]),
            Curve::Hold => (vec![0.0; 2], vec![0.0; 2]),
        };
        for i in 0..t.len() {
            self.push_knot(Knot {
                t: t[i],
                x: x[i],
                v: v[i],
                a: a[i],
            });
        }
    }

    /// Append a knot, unless it equals the last one.
    fn push_knot(&mut self, knot: Knot) {
        if self.t.is_empty() || self.knot(self.t.len() - 1) != knot {
            self.t.push(knot.t);
            self.x.push(knot.x);
            self.v.push(knot.v);
            self.a.push(knot.a);
        }
    }

    /// The path between two of its instants, which become its first and last knot.
    pub fn trimmed(&self, start_time: f64, end_time: f64) -> Self {
        let end_knot = |t: f64| {
            let (x, v, a) = self.evaluate(t);
            Knot { t, x, v, a }
        };
        let inner_range = self.t.partition_point(|&t| t <= start_time)..self.t.partition_point(|&t| t < end_time);
        let cut_column = |values: &[f64], first_end: f64, last_end: f64| {
            let mut column_knots = Vec::with_capacity(inner_range.len() + 2);
            column_knots.push(first_end);
            column_knots.extend_from_slice(&values[inner_range.clone()]);
            column_knots.push(last_end);
            column_knots
        };
        let (first_end, last_end) = (end_knot(start_time), end_knot(end_time));
        Self {
            t: cut_column(&self.t, first_end.t, last_end.t),
            x: cut_column(&self.x, first_end.x, last_end.x),
            v: cut_column(&self.v, first_end.v, last_end.v),
            a: cut_column(&self.a, first_end.a, last_end.a),
        }
    }

    /// The same path with every instant earlier by `shift_seconds` [s].
    pub fn shifted_earlier(mut self, shift_seconds: f64) -> Self {
        self.t.iter_mut().for_each(|t| *t -= shift_seconds);
        self
    }

    /// First instant [s].
    pub fn start_time(&self) -> f64 {
        self.t[0]
    }

    /// Last instant [s].
    pub fn end_time(&self) -> f64 {
        self.t[self.t.len() - 1]
    }

    /// Knot `i`, from 0.
    pub fn knot(&self, i: usize) -> Knot {
        Knot {
            t: self.t[i],
            x: self.x[i],
            v: self.v[i],
            a: self.a[i],
        }
    }

    /// Position [m], velocity [m/s] and acceleration [m/s²] at `t` [s].
    pub fn evaluate(&self, t: f64) -> (f64, f64, f64) {
        self.evaluate_on_piece(self.knot_at_or_before(t), t)
    }

    /// [`Profile::evaluate`] with a cursor, which begins at 0: O(1) while `t` changes in small steps.
    pub fn evaluate_from(&self, cursor: &mut usize, t: f64) -> (f64, f64, f64) {
        let mut piece_index = (*cursor).min(self.t.len() - 1);
        for _ in 0..WALKED_KNOTS_MAX {
            if self.t[piece_index] > t && piece_index > 0 {
                piece_index -= 1;
            } else if self.t.get(piece_index + 1).is_some_and(|&next| next <= t) {
                piece_index += 1;
            } else {
                *cursor = piece_index;
                return self.evaluate_on_piece(piece_index, t);
            }
        }
        *cursor = self.knot_at_or_before(t);
        self.evaluate_on_piece(*cursor, t)
    }

    /// Lowest and highest position [m] that the path reaches from `start_time` to `end_time` [s].
    pub fn range(&self, start_time: f64, end_time: f64) -> (f64, f64) {
        let (start_time, end_time) = (start_time.min(end_time), start_time.max(end_time));
        let (first_piece, last_piece) = (self.knot_at_or_before(start_time), self.knot_at_or_before(end_time));
        // Start with the knots: most pieces cannot exceed them, and then need no roots.
        let end_positions = [self.evaluate(start_time).0, self.evaluate(end_time).0];
        let mut known_range = extremes(end_positions.iter().chain(&self.x[first_piece + 1..=last_piece]));
        for i in first_piece..(last_piece + 1).min(self.t.len() - 1) {
            let (piece_low, piece_high) = self.piece_bounds(i);
            let (piece_start, piece_stop) = (start_time.max(self.t[i]), end_time.min(self.t[i + 1]));
            if piece_start < piece_stop && (piece_low < known_range.0 || piece_high > known_range.1) {
                let (piece_low, piece_high) = self.quintic_piece(i).range(piece_start, piece_stop);
                known_range = (known_range.0.min(piece_low), known_range.1.max(piece_high));
            }
        }
        known_range
    }

    /// The last knot at or before `t`, or the first.
    fn knot_at_or_before(&self, t: f64) -> usize {
        self.t.partition_point(|&knot| knot <= t).saturating_sub(1)
    }

    fn quintic_piece(&self, i: usize) -> Quintic {
        Quintic::between_knots(self.knot(i), self.knot(i + 1))
    }

    /// The path at `t`, which lies between knot `i` and the next one, before the first knot, or not before the last.
    fn evaluate_on_piece(&self, i: usize, t: f64) -> (f64, f64, f64) {
        if t < self.t[0] {
            (self.x[0], 0.0, 0.0)
        } else if i + 1 < self.t.len() {
            self.quintic_piece(i).evaluate(t)
        } else if t == self.t[i] {
            (self.x[i], self.v[i], self.a[i])
        } else {
            (self.x[i], 0.0, 0.0)
        }
    }

    /// Bounds of piece `i`: the smallest and the largest ordinate of its Bézier polygon.
    fn piece_bounds(&self, i: usize) -> (f64, f64) {
        let (left_knot, right_knot) = (self.knot(i), self.knot(i + 1));
        let h = (right_knot.t - left_knot.t) / 5.0;
        // The third ordinate from either end is x ± 2V/5 + A/20, with V = T·v, A = T²·a and T = 5h.
        let acceleration_weight = 25.0 / 20.0 * h * h;
        extremes(&[
            left_knot.x,
            left_knot.x + h * left_knot.v,
            left_knot.x + 2.0 * h * left_knot.v + acceleration_weight * left_knot.a,
            right_knot.x - 2.0 * h * right_knot.v + acceleration_weight * right_knot.a,
            right_knot.x - h * right_knot.v,
            right_knot.x,
        ])
    }
}

fn extremes<'a>(values: impl IntoIterator<Item = &'a f64>) -> (f64, f64) {
    let empty_range = (f64::INFINITY, f64::NEG_INFINITY);
    values
        .into_iter()
        .fold(empty_range, |(low, high), &x| (low.min(x), high.max(x)))
}

fn check_points(points: &[Point]) -> Result<(), PathError> {
    if points.is_empty() {
        return Err(PathError::Empty);
    }
    if let Some(index) = points.iter().position(|p| !(p.t.is_finite() && p.x.is_finite())) {
        return Err(PathError::NotFinite {
            index,
            t: points[index].t,
            x: points[index].x,
        });
    }
    for (i, pair) in points.windows(2).enumerate() {
        let [previous_point, current_point] = [pair[0], pair[1]];
        if current_point.t <= previous_point.t {
            return Err(PathError::NotRising {
                index: i + 1,
                t: current_point.t,
                previous_t: previous_point.t,
            });
        }
        if current_point.curve == Curve::Hold && current_point.x != previous_point.x {
            return Err(PathError::HoldMoves {
                index: i + 1,
                x: current_point.x,
                previous_x: previous_point.x,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
