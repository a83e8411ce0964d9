//! Forces at frames, from strikes at instants.

use super::{StrikeTiming, Timeline};
use crate::cell::Cell;
use crate::network::{MatKind, Network};

/// A force on a MAT at one frame: part of a strike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StrikeForce {
    pub(crate) frame: u64,
    /// Instant of the strike [s], which may lie between frames.
    pub(crate) instant: f64,
    pub(crate) mat: u32,
    pub(crate) source: u32,
    /// Force [N].
    pub(crate) force: f64,
    /// Impulse of the whole strike [N·s] at its first push; 0 at its others.
    pub(crate) impulse: f64,
}

/// The forces of all strikes, by rising frame.
///
/// On a key and under `ca` the parts of a strike act on whole frames. A CEL that `is_alone` receives them between
/// samples, so that every later sample is exact. Any other MAT receives them by the linear split, which keeps impulse
/// and first moment.
pub(crate) fn strike_forces(
    network: &Network,
    timeline: &Timeline,
    is_alone: impl Fn(usize) -> bool,
) -> Vec<StrikeForce> {
    let (frame_rate, network_mats) = (timeline.rate, network.mats());
    let acts_on_frames = timeline.parts_on_frames(network);
    let mut pushes: Vec<StrikeForce> = Vec::with_capacity(timeline.strikes.len());
    for strike in &timeline.strikes {
        let struck_mat = strike.mat as usize;
        let acts_on_frames = acts_on_frames[network_mats.part[struck_mat] as usize];
        let lone_cell = (network_mats.kind[struck_mat] == MatKind::Cel && is_alone(struck_mat)).then(|| {
            Cell::new(
                network_mats.m[struck_mat],
                network_mats.k[struck_mat],
                network_mats.z[struck_mat],
            )
        });
        let first_push = pushes.len();
        let mut push = |frame: u64, force: f64| match pushes[first_push..].last_mut() {
            _ if force == 0.0 => {}
            Some(last_push) if last_push.frame == frame => last_push.force += force,
            last_push => {
                let impulse = if last_push.is_none() { strike.impulse } else { 0.0 };
                pushes.push(StrikeForce {
                    frame,
                    instant: strike.instant,
                    mat: strike.mat,
                    source: strike.source,
                    force,
                    impulse,
                });
            }
        };
        let instants = if acts_on_frames {
            StrikeTiming::OfScore
        } else {
            StrikeTiming::Exact
        };
        for part in timeline.strike_parts(strike, instants) {
            let [force_now, force_next] = match lone_cell {
                Some(lone_cell) if !acts_on_frames => lone_cell.split(part.impulse, part.frame_fraction, frame_rate),
                _ => [1.0 - part.frame_fraction, part.frame_fraction]
                    .map(|share| share * part.impulse * frame_rate.hertz()),
            };
            push(part.frame, force_now);
            push(part.frame + 1, force_next);
        }
    }
    pushes.sort_by_key(|push| push.frame);
    pushes
}
