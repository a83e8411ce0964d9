//! How a reader divides what is seen: runs of points, free oscillations, and the instants at which they are struck.

use std::collections::HashMap;
use std::ops::Range;

use ergon_engine::network::Network;
use ergon_engine::simulation::{ErgonRecord, MotionLook, Oscillation, PointMotion};

use crate::payload::NO_INDEX;

/// Consecutive points of one part that are computed in the same way.
#[derive(Clone, Debug, PartialEq)]
pub struct PointRun {
    /// Its part in the network.
    pub part: usize,
    /// Its points.
    pub points: Range<usize>,
    /// `free`, `sampled`, `modal` or `none`.
    pub kind: &'static str,
    /// Why it is not computed: `unheard` or `unmoved`.
    pub skip_reason: Option<&'static str>,
    /// Index in [`MotionLook::bodies`] if its kind is `modal`.
    pub body: Option<usize>,
}

/// The runs of all points, in order.
pub fn point_runs(look: &MotionLook) -> Vec<PointRun> {
    let mut all_runs: Vec<PointRun> = Vec::new();
    for (index, point) in look.points.iter().enumerate() {
        let (kind, skip_reason, body) = match point.motion {
            PointMotion::Free(_) => ("free", None, None),
            PointMotion::Sampled => ("sampled", None, None),
            PointMotion::Modal(body) => ("modal", None, Some(body)),
            PointMotion::NotComputed { is_moved: true } => ("none", Some("unheard"), None),
            PointMotion::NotComputed { is_moved: false } => ("none", Some("unmoved"), None),
        };
        match all_runs.last_mut() {
            Some(run) if (run.part, run.kind, run.skip_reason, run.body) == (point.part, kind, skip_reason, body) => {
                run.points.end = index + 1;
            }
            _ => all_runs.push(PointRun {
                part: point.part,
                points: index..index + 1,
                kind,
                skip_reason,
                body,
            }),
        }
    }
    all_runs
}

/// A point or mode that oscillates freely.
pub(super) struct OscillatingTrack {
    pub(super) track_number: usize,
    pub(super) oscillation: Oscillation,
    /// Index in the strike lists: its point, or its body.
    pub(super) strike_list_index: usize,
    pub(super) run_index: usize,
}

/// All free points and modes, run by run.
pub(super) fn oscillating_tracks(look: &MotionLook, runs: &[PointRun]) -> Vec<OscillatingTrack> {
    let mut all_tracks = Vec::new();
    for (run, run_tracks) in runs.iter().enumerate() {
        for number in run_tracks.points.clone() {
            if let PointMotion::Free(run_tracks) = look.points[number].motion {
                all_tracks.push(OscillatingTrack {
                    track_number: number,
                    oscillation: run_tracks,
                    strike_list_index: number,
                    run_index: run,
                });
            }
        }
        if let Some(body_index) = run_tracks.body {
            let body_modes = look.bodies[body_index].modes.iter();
            for (number, run_tracks) in (look.points.len() + look.bodies[body_index].first_mode..).zip(body_modes) {
                let strike_list_index = look.points.len() + body_index;
                all_tracks.push(OscillatingTrack {
                    track_number: number,
                    oscillation: *run_tracks,
                    strike_list_index,
                    run_index: run,
                });
            }
        }
    }
    all_tracks
}

/// Instants at which points and bodies are struck. In a discrete part, a strike acts at a frame.
pub(super) fn strike_times(
    look: &MotionLook,
    network: &Network,
    point_by_mat: &HashMap<usize, usize>,
    ergons: &[ErgonRecord],
    rate: f64,
) -> Vec<Vec<f64>> {
    let point_count = look.points.len();
    let mut all_times = vec![Vec::new(); point_count + look.bodies.len()];
    for ergon in ergons {
        let Some(&point_index) = point_by_mat.get(&(ergon.mat as usize)) else {
            continue;
        };
        let struck_point = &look.points[point_index];
        let is_discrete = network.parts()[struck_point.part].ca_rate.is_some();
        let strike_frame = ergon_engine::maths::floor(ergon.time * rate + 0.5);
        let instant = if is_discrete { strike_frame / rate } else { ergon.time };
        match struck_point.motion {
            PointMotion::Free(_) => all_times[point_index].push(instant),
            PointMotion::Modal(body) => all_times[point_count + body].push(instant),
            PointMotion::Sampled | PointMotion::NotComputed { .. } => {}
        }
    }
    debug_assert!(NO_INDEX as usize > point_count);
    all_times
}
