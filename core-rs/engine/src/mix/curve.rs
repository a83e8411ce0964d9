//! A gain that is written as a curve over the frames of a piece.

use std::ops::Range;

use crate::maths::{atan2, exp, lanes, log, sincos, sqrt};

/// Exponents that are raised together.
const EXPONENTS_PER_BATCH: usize = 64;

/// How a [`Curve`] leads to a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Segment {
    /// Linear.
    Line,
    /// With zero slope at both ends: 3u² − 2u³.
    Smooth,
}

/// A point of a [`Curve`], or of a [`Pan`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Frame of the piece; negative before its beginning.
    pub frame: i64,
    /// Of a curve a ratio of amplitudes, 0 or more; of a pan a place from -1 to 1.
    pub value: f64,
    /// How the curve leads to this point from the one before.
    pub segment: Segment,
}

/// The progress from one point to another at a frame between them, from 0 to 1.
fn progress_between(start_point: &Point, end_point: &Point, frame: i64) -> f64 {
    let u = (frame - start_point.frame) as f64 / (end_point.frame - start_point.frame) as f64;
    match end_point.segment {
        Segment::Line => u,
        Segment::Smooth => u * u * (3.0 - 2.0 * u),
    }
}

/// The two points between which all of these frames lie.
fn enclosing_points<'a>(points: &'a [Point], frames: &Range<u64>) -> Option<(&'a Point, &'a Point)> {
    let start_frame = i64::try_from(frames.start).ok()?;
    let stop_frame = i64::try_from(frames.end).ok()?;
    let next_index = points.partition_point(|point| point.frame <= start_frame);
    let start_point = points.get(next_index.checked_sub(1)?)?;
    let end_point = points.get(next_index).filter(|to| stop_frame <= to.frame)?;
    Some((start_point, end_point))
}

/// The value at a frame, interpolated between points whose frames rise. Before the first point and after the last one
/// it is the value of that point; else `interpolation` computes it from two values and the progress. `None` without
/// points.
fn interpolate_between_points(
    points: &[Point],
    frame: u64,
    interpolation: impl Fn(f64, f64, f64) -> f64,
) -> Option<f64> {
    let frame = i64::try_from(frame).unwrap_or(i64::MAX);
    let next_index = points.partition_point(|point| point.frame <= frame);
    let point_before = next_index.checked_sub(1).and_then(|index| points.get(index));
    match (point_before, points.get(next_index)) {
        (Some(from), Some(to)) => {
            let u = progress_between(from, to, frame);
            Some(if u == 0.0 {
                from.value
            } else {
                interpolation(from.value, to.value, u)
            })
        }
        (Some(only), None) | (None, Some(only)) => Some(only.value),
        (None, None) => None,
    }
}

/// Whether [`interpolate_between_points`] gives the same at all of these frames, because they lie before the first
/// point or after the last.
fn is_constant(points: &[Point], frames: &Range<u64>) -> bool {
    let (Some(first_point), Some(last_point)) = (points.first(), points.last()) else {
        return true;
    };
    let [start_frame, stop_frame] = [frames.start, frames.end].map(|frame| i64::try_from(frame).unwrap_or(i64::MAX));
    stop_frame <= first_point.frame || start_frame >= last_point.frame
}

fn sorted_by_frame(mut points: Vec<Point>) -> Vec<Point> {
    points.sort_by_key(|point| point.frame);
    points
}

/// Which of the two channels of a pan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PanChannel {
    /// Loudest at -1.
    First,
    /// Loudest at 1.
    Second,
}

/// The gain of one of two channels between which a sound moves, with constant power.
///
/// The place p from -1 to 1 is the angle θ with cos 2θ = -p, from 0 to π/2; the channels have the gains cos θ and
/// sin θ, whose squares are (1 - p)/2 and (1 + p)/2. Between two points the angle goes evenly.
#[derive(Clone, Debug, PartialEq)]
pub struct Pan {
    /// Points whose values are angles [rad].
    angles: Vec<Point>,
    channel: PanChannel,
}

impl Pan {
    /// A pan through places from -1 to 1.
    #[must_use]
    pub fn new(places: Vec<Point>, channel: PanChannel) -> Self {
        let angle_point = |point: Point| Point {
            value: atan2(sqrt((1.0 + point.value).max(0.0)), sqrt((1.0 - point.value).max(0.0))),
            ..point
        };
        Self {
            angles: sorted_by_frame(places).into_iter().map(angle_point).collect(),
            channel,
        }
    }

    /// The gain at a frame of the piece; that of the middle without points.
    fn gain_at(&self, frame: u64) -> f64 {
        let pan_angle = interpolate_between_points(&self.angles, frame, |from, to, u| from + (to - from) * u);
        let (sin, cos) = sincos(pan_angle.unwrap_or(std::f64::consts::FRAC_PI_4));
        match self.channel {
            PanChannel::First => cos,
            PanChannel::Second => sin,
        }
    }
}

/// A gain as a function of the frame alone, so that it is the same wherever playback starts.
///
/// Between two points, the level in dB is interpolated; if one of the gains is 0, the gain itself. Before the first
/// point and after the last one, the gain is constant. It may be that of one channel of a [`Pan`], too.
///
/// ```
/// use ergon_engine::mix::curve::{Curve, Point, Segment};
///
/// let start_point = Point { frame: 100, value: 0.01, segment: Segment::Line };
/// let end_point = Point { frame: 200, value: 1.0, segment: Segment::Line };
/// let curve = Curve::new(vec![start_point, end_point]);
/// assert!((curve.gain_at(150) - 0.1).abs() < 1e-15); // -20 dB, halfway start_point -40 dB
/// assert_eq!((curve.gain_at(0), curve.gain_at(1000)), (0.01, 1.0));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    gain_points: Vec<Point>,
    pan: Option<Pan>,
}

impl Curve {
    /// A curve through points. Points of one frame keep their order; the last of them is the gain from that frame on.
    #[must_use]
    pub fn new(points: Vec<Point>) -> Self {
        Self {
            gain_points: sorted_by_frame(points),
            pan: None,
        }
    }

    /// This curve in one channel of a pan.
    #[must_use]
    pub fn with_pan(self, pan: Pan) -> Self {
        Self { pan: Some(pan), ..self }
    }

    /// The gain at a frame of the piece; 1 without points.
    #[must_use]
    pub fn gain_at(&self, frame: u64) -> f64 {
        let curve_level = interpolate_between_points(&self.gain_points, frame, |from, to, u| {
            if from > 0.0 && to > 0.0 {
                from * exp(u * log(to / from))
            } else {
                from + (to - from) * u
            }
        });
        let pan_gain = self.pan.as_ref().map_or(1.0, |pan| pan.gain_at(frame));
        curve_level.unwrap_or(1.0) * pan_gain
    }

    /// Its gains from frame `first` on.
    pub(super) fn fill(&self, first: u64, gains: &mut [f64]) {
        let frame_range = first..first.saturating_add(gains.len() as u64);
        let mut points = std::iter::once(&self.gain_points).chain(self.pan.as_ref().map(|pan| &pan.angles));
        if points.all(|points| is_constant(points, &frame_range)) {
            gains.fill(self.gain_at(first));
        } else if !self.fill_segment(&frame_range, gains) {
            let gain_frames = gains.iter_mut().zip(frame_range);
            gain_frames.for_each(|(gain, frame)| *gain = self.gain_at(frame));
        }
    }

    /// The same for frames between two points whose gains are not 0, several at once. Returns false for others.
    fn fill_segment(&self, frames: &Range<u64>, gains: &mut [f64]) -> bool {
        let Some((from, to)) = enclosing_points(&self.gain_points, frames) else {
            return false;
        };
        if from.value <= 0.0 || to.value <= 0.0 || self.pan.is_some() {
            return false;
        }
        let log_ratio = log(to.value / from.value);
        let mut exponents = [0.0; EXPONENTS_PER_BATCH];
        let mut frame = frames.start as i64;
        for gains in gains.chunks_mut(EXPONENTS_PER_BATCH) {
            let exponents = &mut exponents[..gains.len()];
            for exponent in exponents.iter_mut() {
                *exponent = progress_between(from, to, frame) * log_ratio;
                frame += 1;
            }
            lanes::exp(exponents, gains);
            gains.iter_mut().for_each(|gain| *gain *= from.value);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(frame: i64, value: f64, segment: Segment) -> Point {
        Point { frame, value, segment }
    }

    #[test]
    fn curve_passes_its_points() {
        let curve = Curve::new(vec![
            point(300, 0.0, Segment::Smooth),
            point(100, 0.5, Segment::Line),
            point(200, 2.0, Segment::Smooth),
            point(200, 1.0, Segment::Line),
        ]);
        for (frame, gain) in [(0, 0.5), (100, 0.5), (200, 1.0), (300, 0.0), (900, 0.0)] {
            assert_eq!(curve.gain_at(frame), gain, "{frame}");
        }
        assert!(
            (curve.gain_at(150) - 1.0).abs() < 1e-15,
            "0 dB, halfway from -6 dB to 6 dB"
        );
        assert!((curve.gain_at(250) - 0.5).abs() < 1e-15, "by the ratio to nothing");
    }

    #[test]
    fn curve_from_points_before_the_beginning() {
        let curve = Curve::new(vec![point(-100, 1.0, Segment::Line), point(100, 0.0, Segment::Line)]);
        assert_eq!(
            (curve.gain_at(0), curve.gain_at(50), curve.gain_at(100)),
            (0.5, 0.25, 0.0)
        );
    }

    #[test]
    fn curve_spans_equal_gains_of_their_frames() {
        let level_points = vec![point(100, 0.5, Segment::Line), point(200, 2.0, Segment::Smooth)];
        let place_points = vec![point(150, -1.0, Segment::Line), point(260, 0.5, Segment::Smooth)];
        let plain_curve = Curve::new(level_points.clone());
        let panned_curve = Curve::new(level_points).with_pan(Pan::new(place_points, PanChannel::Second));
        for curve in [plain_curve, panned_curve, Curve::new(Vec::new())] {
            for length in [1, 7, 50, 64] {
                for first in (0..400).step_by(length) {
                    let mut gains = vec![0.0; length];
                    curve.fill(first, &mut gains);
                    let frame_gains: Vec<f64> = (first..).take(length).map(|n| curve.gain_at(n)).collect();
                    assert_eq!(gains, frame_gains, "{length} frames from {first}");
                }
            }
        }
    }

    #[test]
    fn curve_without_points_is_one() {
        assert_eq!(Curve::new(Vec::new()).gain_at(7), 1.0);
    }

    #[test]
    fn pan_between_two_places() {
        let place_points = [point(0, -1.0, Segment::Line), point(900, 1.0, Segment::Line)];
        let channel = |channel| Curve::new(Vec::new()).with_pan(Pan::new(place_points.to_vec(), channel));
        let (first_channel, second_channel) = (channel(PanChannel::First), channel(PanChannel::Second));
        for frame in [0, 1, 300, 450, 899, 900, 5000] {
            let pan_angle = (frame.min(900) as f64 / 10.0).to_radians();
            let channel_gains = (first_channel.gain_at(frame), second_channel.gain_at(frame));
            assert!(
                (channel_gains.0 - crate::maths::cos(pan_angle)).abs() < 1e-15,
                "{frame}"
            );
            assert!(
                (channel_gains.1 - crate::maths::sin(pan_angle)).abs() < 1e-15,
                "{frame}"
            );
        }
    }

    #[test]
    fn pan_with_levels() {
        let level_points = vec![point(0, 0.5, Segment::Line)];
        let middle_pan = Pan::new(vec![point(0, 0.0, Segment::Line)], PanChannel::First);
        let panned_gain = Curve::new(level_points).with_pan(middle_pan).gain_at(7);
        assert!((panned_gain - 0.5 * sqrt(0.5)).abs() < 1e-15);
    }
}
