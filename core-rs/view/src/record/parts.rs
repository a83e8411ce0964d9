//! What is looked at as a reader has it: runs of points, what swings freely, and when it is struck.

use std::collections::HashMap;
use std::ops::Range;

use ergon_engine::network::Network;
use ergon_engine::simulation::{How, Look, Oscillation, Record};

use crate::payload::NONE;

/// A run of points of one kind: a part, or some of it that is computed alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Its part in the network.
    pub part: usize,
    /// Its points.
    pub points: Range<usize>,
    /// `free`, `sampled`, `modal` or `none`.
    pub kind: &'static str,
    /// Why it is not computed.
    pub why: Option<&'static str>,
    /// The body of [`Look::bodies`] that it is.
    pub body: Option<usize>,
}

/// The parts of what is looked at, in the order of the points.
pub fn runs(look: &Look) -> Vec<Run> {
    let mut all: Vec<Run> = Vec::new();
    for (at, point) in look.points.iter().enumerate() {
        let (kind, why, body) = match point.how {
            How::Free(_) => ("free", None, None),
            How::Sampled => ("sampled", None, None),
            How::Modal(body) => ("modal", None, Some(body)),
            How::NotComputed { is_moved: true } => ("none", Some("unheard"), None),
            How::NotComputed { is_moved: false } => ("none", Some("unmoved"), None),
        };
        match all.last_mut() {
            Some(run)
                if (run.part, run.kind, run.why, run.body) == (point.part, kind, why, body) =>
            {
                run.points.end = at + 1;
            }
            _ => all.push(Run {
                part: point.part,
                points: at..at + 1,
                kind,
                why,
                body,
            }),
        }
    }
    all
}

/// A point or mode that swings freely.
pub(super) struct Track {
    pub(super) number: usize,
    pub(super) own: Oscillation,
    /// Whose blows are its.
    pub(super) struck: usize,
    pub(super) run: usize,
}

/// What swings freely, run by run.
pub(super) fn tracks(look: &Look, runs: &[Run]) -> Vec<Track> {
    let mut all = Vec::new();
    for (run, own) in runs.iter().enumerate() {
        for number in own.points.clone() {
            if let How::Free(own) = look.points[number].how {
                all.push(Track {
                    number,
                    own,
                    struck: number,
                    run,
                });
            }
        }
        if let Some(body) = own.body {
            let modes = look.bodies[body].modes.iter();
            for (number, own) in (look.points.len() + look.bodies[body].first..).zip(modes) {
                let struck = look.points.len() + body;
                all.push(Track {
                    number,
                    own: *own,
                    struck,
                    run,
                });
            }
        }
    }
    all
}

/// Instants at which points and bodies are struck. Where the discrete network is the truth a strike acts on a sample.
pub(super) fn blows(
    look: &Look,
    network: &Network,
    points: &HashMap<usize, usize>,
    ergons: &[Record],
    rate: f64,
) -> Vec<Vec<f64>> {
    let n = look.points.len();
    let mut all = vec![Vec::new(); n + look.bodies.len()];
    for ergon in ergons {
        let Some(&at) = points.get(&(ergon.mat as usize)) else {
            continue;
        };
        let point = &look.points[at];
        let is_discrete = network.parts()[point.part].ca_rate.is_some();
        let frame = ergon_engine::maths::floor(ergon.time * rate + 0.5);
        let instant = if is_discrete {
            frame / rate
        } else {
            ergon.time
        };
        match point.how {
            How::Free(_) => all[at].push(instant),
            How::Modal(body) => all[n + body].push(instant),
            How::Sampled | How::NotComputed { .. } => {}
        }
    }
    debug_assert!(NONE as usize > n);
    all
}
