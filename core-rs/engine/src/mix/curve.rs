//! A gain that is written as a curve over the frames of a piece.

use crate::maths::pow;

/// The way into a point of a [`Curve`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// Linear.
    Line,
    /// With zero slope at both ends: 3u² − 2u³.
    Smooth,
}

/// A point of a [`Curve`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Frame of the piece; negative before its beginning.
    pub frame: i64,
    /// Ratio of amplitudes, 0 or more.
    pub gain: f64,
    /// How the curve goes to this point from the one before.
    pub way: Way,
}

/// A gain as a function of the frame alone, so that it is the same wherever playback starts.
///
/// Between two points, the level in dB is interpolated; if one of the gains is 0, the gain itself. Before the first
/// point and after the last one, the gain is constant.
///
/// ```
/// use ergon_engine::mix::curve::{Curve, Point, Way};
///
/// let from = Point { frame: 100, gain: 0.01, way: Way::Line };
/// let to = Point { frame: 200, gain: 1.0, way: Way::Line };
/// let curve = Curve::new(vec![from, to]);
/// assert!((curve.at(150) - 0.1).abs() < 1e-15); // -20 dB, halfway from -40 dB
/// assert_eq!((curve.at(0), curve.at(1000)), (0.01, 1.0));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Curve(Vec<Point>);

impl Curve {
    /// A curve through points. Points of one frame keep their order; the last of them is the gain from that frame on.
    #[must_use]
    pub fn new(mut points: Vec<Point>) -> Self {
        points.sort_by_key(|point| point.frame);
        Self(points)
    }

    /// The gain at a frame of the piece; 1 without points.
    #[must_use]
    pub fn at(&self, frame: u64) -> f64 {
        let frame = i64::try_from(frame).unwrap_or(i64::MAX);
        let next = self.0.partition_point(|point| point.frame <= frame);
        let before = next.checked_sub(1).and_then(|at| self.0.get(at));
        match (before, self.0.get(next)) {
            (Some(from), Some(to)) => {
                let u = (frame - from.frame) as f64 / (to.frame - from.frame) as f64;
                let u = match to.way {
                    Way::Line => u,
                    Way::Smooth => u * u * (3.0 - 2.0 * u),
                };
                if u == 0.0 {
                    from.gain
                } else if from.gain > 0.0 && to.gain > 0.0 {
                    from.gain * pow(to.gain / from.gain, u)
                } else {
                    from.gain + (to.gain - from.gain) * u
                }
            }
            (Some(only), None) | (None, Some(only)) => only.gain,
            (None, None) => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(frame: i64, gain: f64, way: Way) -> Point {
        Point { frame, gain, way }
    }

    #[test]
    fn goes_through_its_points() {
        let curve = Curve::new(vec![
            point(300, 0.0, Way::Smooth),
            point(100, 0.5, Way::Line),
            point(200, 2.0, Way::Smooth),
            point(200, 1.0, Way::Line),
        ]);
        for (frame, gain) in [(0, 0.5), (100, 0.5), (200, 1.0), (300, 0.0), (900, 0.0)] {
            assert_eq!(curve.at(frame), gain, "{frame}");
        }
        assert!(
            (curve.at(150) - 1.0).abs() < 1e-15,
            "0 dB, halfway from -6 dB to 6 dB"
        );
        assert!(
            (curve.at(250) - 0.5).abs() < 1e-15,
            "by the ratio to nothing"
        );
    }

    #[test]
    fn goes_on_from_points_before_the_beginning() {
        let curve = Curve::new(vec![
            point(-100, 1.0, Way::Line),
            point(100, 0.0, Way::Line),
        ]);
        assert_eq!((curve.at(0), curve.at(50), curve.at(100)), (0.5, 0.25, 0.0));
    }

    #[test]
    fn without_points_nothing_changes() {
        assert_eq!(Curve::new(Vec::new()).at(7), 1.0);
    }
}
