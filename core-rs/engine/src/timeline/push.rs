//! Forces at frames, from strikes at instants.

use super::Timeline;
use crate::cell::Cell;
use crate::network::{MatKind, Network};
use crate::units::floor_frame;

/// A force on a MAT at one frame: part of a strike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Push {
    pub(crate) frame: u64,
    /// Instant of the strike [s], which may lie between frames.
    pub(crate) at: f64,
    pub(crate) mat: u32,
    pub(crate) source: u32,
    /// Force [N].
    pub(crate) force: f64,
    /// Impulse of the whole strike [N·s] at its first push; 0 at its second.
    pub(crate) impulse: f64,
}

/// The forces of all strikes, by rising frame.
///
/// On a key and under `ca` a strike acts in a single step. A CEL that `is_alone` receives it between samples, so that
/// every later sample is exact. Any other MAT receives it by the linear split, which keeps the impulse and its first
/// moment.
pub(crate) fn pushes(
    network: &Network,
    timeline: &Timeline,
    is_alone: impl Fn(usize) -> bool,
) -> Vec<Push> {
    let (rate, mats) = (timeline.rate, network.mats());
    let mut is_whole: Vec<bool> = network
        .parts()
        .iter()
        .map(|part| part.ca_rate.is_some())
        .collect();
    for key in &timeline.keys {
        is_whole[mats.part[key.struck] as usize] = true;
    }
    let mut pushes = Vec::with_capacity(timeline.strikes.len());
    for strike in &timeline.strikes {
        let (mat, instant, impulse) = (strike.mat as usize, strike.at, strike.impulse);
        let mut push = |frame: u64, force: f64, impulse: f64| {
            if force != 0.0 {
                pushes.push(Push {
                    frame,
                    at: instant,
                    mat: strike.mat,
                    source: strike.source,
                    force,
                    impulse,
                });
            }
        };
        if is_whole[mats.part[mat] as usize] {
            push(timeline.frame(instant), impulse * rate.hertz(), impulse);
            continue;
        }
        let n = floor_frame(instant * rate.hertz());
        let alpha = (instant * rate.hertz() - n as f64).clamp(0.0, 1.0);
        let [p0, p1] = if mats.kind[mat] == MatKind::Cel && is_alone(mat) {
            Cell::new(mats.m[mat], mats.k[mat], mats.z[mat]).split(impulse, alpha, rate)
        } else {
            [
                (1.0 - alpha) * impulse * rate.hertz(),
                alpha * impulse * rate.hertz(),
            ]
        };
        push(n, p0, impulse);
        push(n + 1, p1, 0.0);
    }
    pushes.sort_by_key(|push| push.frame);
    pushes
}
