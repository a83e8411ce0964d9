//! A gesture at a rate: the frames at which positions are due and ergons strike.

use std::sync::Arc;

use crate::gesture::placed::PlacedPath;
use crate::gesture::script::{Gesture, GestureSegment};
use crate::units::{floor_frame, score_frame};

/// An instant this close before a frame [frames] falls on it: dividing beats by a tempo leaves such a rounding error.
const FRAME_SLACK: f64 = 1e-6;
/// Added to the instant of a knot [frames], so that one half-way between two frames is rounded up whatever its last
/// bit.
const KNOT_SLACK: f64 = 1e-6;

/// A stretch of a gesture. Legs cover the targets (frames at which a position is due) one after
/// the other: a leg's first target is the one after the last of the leg before it.
#[derive(Clone, Debug)]
pub(crate) enum FramedSegment {
    /// Follow a path; the targets end with `last_frame`. After a throw one strike leads onto it, by frame
    /// `entry_frame`.
    Path {
        path: PlacedPath,
        entry_frame: u64,
        last_frame: u64,
    },
    /// One strike at frame `strike_frame`, then free until the key passes `x` at frame `landing_frame`.
    Throw {
        strike_frame: u64,
        landing_frame: u64,
        x: f64,
    },
}

impl FramedSegment {
    pub(crate) fn last_frame(&self) -> u64 {
        match self {
            Self::Path { last_frame, .. } => *last_frame,
            Self::Throw { landing_frame, .. } => *landing_frame,
        }
    }
}

/// A gesture at the rate of its island.
#[derive(Clone, Debug)]
pub(crate) struct FramedGesture {
    pub(crate) gesture: Arc<Gesture>,
    pub(crate) segments: Vec<FramedSegment>,
    /// Last frame at or before the start: the gesture takes over there, for the targets after it.
    pub(crate) first_frame: u64,
    /// Frame at which a joining curve begins, to reach the gesture in time.
    pub(crate) join_frame: u64,
    /// Frames of the written points, rising.
    point_frames: Vec<u64>,
    /// Frames of this rate in a frame of the score.
    oversampling: u32,
}

impl FramedGesture {
    /// At a rate [Hz] that is `oversampling` times one that [`Gesture::check_rate`] allows.
    ///
    /// Throws and grains strike and land where frames of the score begin: at the same instants at every oversampling.
    pub(crate) fn new(gesture: &Arc<Gesture>, rate: f64, oversampling: u32) -> Self {
        let (start_time, join_time) = (gesture.start, gesture.manner.join_seconds);
        let frame_at = |t: f64| score_frame(t, rate, oversampling);
        let last_frame_at = |t: f64| match gesture.manner.grain {
            None => last_frame(t, rate),
            Some(_) => last_score_frame(t, rate, oversampling),
        };
        let mut first_frame = last_frame_at(start_time);
        let mut segments: Vec<FramedSegment> = Vec::with_capacity(gesture.segments.len());
        for segment in &gesture.segments {
            let framed_segment = match *segment {
                GestureSegment::Path { ref path, stop } => FramedSegment::Path {
                    path: path.clone(),
                    entry_frame: match segments.last() {
                        Some(FramedSegment::Throw { landing_frame, .. }) if oversampling > 1 => {
                            landing_frame + u64::from(oversampling)
                        }
                        _ => 0,
                    },
                    last_frame: last_frame_at(stop),
                },
                GestureSegment::Throw {
                    strike_instant: from,
                    arrival_instant: arrival_time,
                    arrival_position: x,
                    ..
                } => {
                    let (strike_frame, landing_frame) = (frame_at(from), frame_at(arrival_time));
                    // Rounded to a frame of the score, the strike may come before the end of the path: the path then
                    // ends at the strike.
                    match segments.last_mut() {
                        Some(FramedSegment::Path { last_frame, .. }) => *last_frame = strike_frame.min(*last_frame),
                        Some(FramedSegment::Throw { .. }) => {}
                        None => first_frame = strike_frame.min(first_frame),
                    }
                    FramedSegment::Throw {
                        strike_frame,
                        landing_frame,
                        x,
                    }
                }
            };
            segments.push(framed_segment);
        }
        Self {
            segments,
            first_frame,
            join_frame: floor_frame(((start_time - join_time) * rate - FRAME_SLACK).ceil()),
            point_frames: gesture.points.iter().map(|point| frame_at(point.0)).collect(),
            oversampling,
            gesture: gesture.clone(),
        }
    }

    /// The last frame at which a position is due.
    pub(crate) fn last_frame(&self) -> u64 {
        self.segments.last().map_or(self.first_frame, FramedSegment::last_frame)
    }

    /// Frames in a frame of the score.
    pub(crate) fn frames_per_score_frame(&self) -> u64 {
        u64::from(self.oversampling)
    }

    /// The frame after `n` at which the next grain is due: a multiple of the grain since the start,
    /// or a written point before it.
    pub(crate) fn next_knot_frame(&self, n: u64, grain: f64, rate: f64) -> u64 {
        // Grains shorter than a frame of the score are due at every such frame; there may be too many to count.
        let score_step = u64::from(self.oversampling);
        let score_rate = rate / f64::from(self.oversampling);
        if grain * score_rate <= 1.0 {
            return (n / score_step + 1) * score_step;
        }
        let knot_frame = |knot_index: f64| {
            let knot_time = self.gesture.start + knot_index * grain + KNOT_SLACK / score_rate;
            score_frame(knot_time, rate, self.oversampling)
        };
        let mut knot_index = ((n as f64 / rate - self.gesture.start) / grain).floor().max(0.0);
        while knot_frame(knot_index) <= n {
            knot_index += 1.0;
        }
        let knot_frame = knot_frame(knot_index);
        let next_point = self.point_frames.partition_point(|&point| point <= n);
        self.point_frames
            .get(next_point)
            .map_or(knot_frame, |&point| knot_frame.min(point))
    }

    /// Source of an ergon whose target is frame `target_frame`; `point_cursor` only moves forward.
    pub(crate) fn ergon_source(&self, point_cursor: &mut usize, target_frame: u64) -> u32 {
        while *point_cursor + 1 < self.point_frames.len() && self.point_frames[*point_cursor] < target_frame {
            *point_cursor += 1;
        }
        let score_point = self.gesture.points.get(*point_cursor);
        score_point.map_or(0, |&(_, source)| source)
    }
}

/// The last frame at or before an instant [s].
fn last_frame(t: f64, rate: f64) -> u64 {
    floor_frame(t * rate + FRAME_SLACK)
}

/// The last beginning of a frame of the score at or before an instant [s].
fn last_score_frame(t: f64, rate: f64, oversampling: u32) -> u64 {
    last_frame(t, rate / f64::from(oversampling)) * u64::from(oversampling)
}
