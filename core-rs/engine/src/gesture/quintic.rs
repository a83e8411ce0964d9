//! One piece of a path: the quintic with given position, velocity and acceleration at both ends.

/// Position, velocity and acceleration of a path at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Knot {
    /// Instant [s].
    pub t: f64,
    /// Position [m].
    pub x: f64,
    /// Velocity [m/s].
    pub v: f64,
    /// Acceleration [m/s²].
    pub a: f64,
}

/// The polynomial of degree 5 that meets two knots in position, velocity and acceleration.
///
/// It is the path of least jerk between them (Flash & Hogan 1985), and every piece of a
/// [`spline`](super::spline).
///
/// ```
/// use ergon_engine::gesture::quintic::{Knot, Quintic};
///
/// let at_rest = |t, x| Knot { t, x, ..Knot::default() };
/// let piece = Quintic::between_knots(at_rest(0.0, 0.0), at_rest(1.0, 4e-3));
/// assert!((piece.evaluate(0.5).0 - 2e-3).abs() < 1e-12); // symmetric
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Quintic {
    start: f64,
    duration: f64,
    /// Coefficients in s = (t - start)/length; dimensionless time treats 1 ms and 10 s alike.
    coefficients: [f64; 6],
}

crate::archive::state!(Quintic {
    start,
    duration,
    coefficients
});

impl Quintic {
    /// The piece from one knot to a later one. If there is no time between them, it rests at `end_knot`.
    pub fn between_knots(start_knot: Knot, end_knot: Knot) -> Self {
        let duration = end_knot.t - start_knot.t;
        if duration <= 0.0 {
            return Self {
                start: end_knot.t,
                duration: 1.0,
                coefficients: [end_knot.x, 0.0, 0.0, 0.0, 0.0, 0.0],
            };
        }
        let (v0, v1, a0, a1) = (
            start_knot.v * duration,
            end_knot.v * duration,
            start_knot.a * duration * duration,
            end_knot.a * duration * duration,
        );
        // What the last three coefficients add to the motion that the left end determines.
        let x = (end_knot.x - start_knot.x) - v0 - 0.5 * a0;
        let v = v1 - v0 - a0;
        let a = a1 - a0;
        Self {
            start: start_knot.t,
            duration,
            coefficients: [
                start_knot.x,
                v0,
                0.5 * a0,
                10.0 * x - 4.0 * v + 0.5 * a,
                -15.0 * x + 7.0 * v - a,
                6.0 * x - 3.0 * v + 0.5 * a,
            ],
        }
    }

    /// Position [m], velocity [m/s] and acceleration [m/s²] at `t` [s].
    pub fn evaluate(&self, t: f64) -> (f64, f64, f64) {
        let s = (t - self.start) / self.duration;
        let [c0, c1, c2, c3, c4, c5] = self.coefficients;
        let x = ((((c5 * s + c4) * s + c3) * s + c2) * s + c1) * s + c0;
        let v = (((5.0 * c5 * s + 4.0 * c4) * s + 3.0 * c3) * s + 2.0 * c2) * s + c1;
        let a = ((20.0 * c5 * s + 12.0 * c4) * s + 6.0 * c3) * s + 2.0 * c2;
        (x, v / self.duration, a / (self.duration * self.duration))
    }

    /// Lowest and highest position [m] from instant `from_time` to instant `to_time` [s].
    pub fn range(&self, from_time: f64, to_time: f64) -> (f64, f64) {
        let unit_time = |t: f64| (t - self.start) / self.duration;
        let slope_terms: [f64; 5] = std::array::from_fn(|k| self.coefficients[k + 1] * (k + 1) as f64);
        let (from_time, to_time) = (unit_time(from_time), unit_time(to_time));
        sign_changes(&slope_terms, from_time, to_time)
            .into_iter()
            .chain([from_time, to_time])
            .map(|unit_time| polynomial_value(&self.coefficients, unit_time))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                (low.min(x), high.max(x))
            })
    }
}

fn polynomial_value(c: &[f64], s: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, c| sum * s + c)
}

/// The rising roots in [low, high] at which a polynomial changes sign. It is monotone between two extrema, so the roots
/// of its slope bracket its own roots.
fn sign_changes(c: &[f64], low: f64, high: f64) -> Vec<f64> {
    if c.len() < 2 {
        return Vec::new();
    }
    let slope_terms: Vec<f64> = (1..c.len()).map(|k| c[k] * k as f64).collect();
    let mut root_bounds = vec![low];
    root_bounds.extend(sign_changes(&slope_terms, low, high));
    root_bounds.push(high);
    root_bounds
        .windows(2)
        .filter_map(|bracket| bisect(c, bracket[0], bracket[1]))
        .collect()
}

fn bisect(c: &[f64], mut low: f64, mut high: f64) -> Option<f64> {
    let is_rising = polynomial_value(c, high) > 0.0;
    if (polynomial_value(c, low) > 0.0) == is_rising {
        return None;
    }
    // 60 halvings of an interval near 1 leave less than the last bit.
    for _ in 0..60 {
        let midpoint = 0.5 * (low + high);
        if (polynomial_value(c, midpoint) > 0.0) == is_rising {
            high = midpoint;
        } else {
            low = midpoint;
        }
    }
    Some(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// (t-1)(t-2)(t-3)(t-4)(t-5)/10 and its derivatives, written out.
    fn wave(t: f64) -> Knot {
        let coefficients = [-120.0, 274.0, -225.0, 85.0, -15.0, 1.0].map(|coefficients: f64| coefficients / 10.0);
        let slope_terms: Vec<f64> = (1..6).map(|k| coefficients[k] * k as f64).collect();
        let second_derivative: Vec<f64> = (1..5).map(|k| slope_terms[k] * k as f64).collect();
        Knot {
            t,
            x: polynomial_value(&coefficients, t),
            v: polynomial_value(&slope_terms, t),
            a: polynomial_value(&second_derivative, t),
        }
    }

    #[test]
    fn joining_quintics_meets_a_quintic() {
        let joined_piece = Quintic::between_knots(wave(0.7), wave(5.2));
        for i in 0..=50 {
            let t = 0.7 + 4.5 * f64::from(i) / 50.0;
            let (x, v, a) = joined_piece.evaluate(t);
            let Knot {
                x: x0, v: v0, a: a0, ..
            } = wave(t);
            assert!((x - x0).abs() < 1e-11 && (v - v0).abs() < 1e-11 && (a - a0).abs() < 1e-10);
        }
    }

    #[test]
    fn range_of_quintic_includes_inner_extrema() {
        let wave_piece = Quintic::between_knots(wave(0.9), wave(5.1));
        let (range_low, range_high) = wave_piece.range(1.0, 5.0);
        // With u = t − 3 it is (u⁵ - 5u³ + 4u)/10, whose slope vanishes at u² = (15 ± √145)/10; the outer pair has the
        // larger extrema.
        let u = ((15.0 + 145.0f64.sqrt()) / 10.0).sqrt();
        let outer_extremum = u * (4.0 + u * u * (u * u - 5.0)) / 10.0;
        assert!(
            (range_low - outer_extremum).abs() < 1e-13 && (range_high + outer_extremum).abs() < 1e-13,
            "{range_low} {range_high}"
        );
        let (range_low, range_high) = wave_piece.range(2.9, 3.1);
        assert!(
            range_low < range_high && range_high < 0.05,
            "only that stretch: {range_low} {range_high}"
        );
    }

    #[test]
    fn joining_quintic_without_duration_rests() {
        let end_knot = Knot {
            t: 1.0,
            x: 3.0,
            v: 2.0,
            a: 1.0,
        };
        let resting_piece = Quintic::between_knots(
            Knot {
                t: 1.0,
                ..Knot::default()
            },
            end_knot,
        );
        assert_eq!(resting_piece.evaluate(1.0), (3.0, 0.0, 0.0));
    }
}
