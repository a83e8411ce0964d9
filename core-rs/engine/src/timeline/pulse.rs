//! How the impulse of a strike is spread over the time that it lasts.

use std::f64::consts::TAU;

use super::{Strike, Timeline};
use crate::maths::cos;
use crate::network::Network;
use crate::units::{floor_frame, frame, score_frame};

/// The default duration of a strike [s].
///
/// Above 3/0.19 ms = 15.8 kHz the spectrum of the force stays 58 dB below its level at 0 Hz; it is 3 dB lower at
/// 4 kHz. A mass that is struck starts moving without a step.
pub(super) const DEFAULT_STRIKE_SECONDS: f64 = 0.19e-3;

/// A longer strike is refused [s].
pub(super) const STRIKE_SECONDS_MAX: f64 = 0.05;

/// Parts of a strike in a second. The same at all rates, so that another rate is the same instrument.
pub(super) const PARTS_PER_SECOND: f64 = 44_100.0;

/// A shorter pulse has no shape.
const PARTS_MIN: f64 = 3.0;

/// The number of parts of a strike that lasts `duration` [s]; a strike of one part acts at one instant.
pub(super) fn n_parts(duration: f64) -> u32 {
    let part_count = (duration * PARTS_PER_SECOND).round();
    if part_count < PARTS_MIN { 1 } else { part_count as u32 }
}

/// Parts after the first instant and shares of the impulse: Blackman's window (Harris, Proc. IEEE 66, 1978), whose
/// `n_parts` samples add up to 0.42 · `n_parts`.
fn impulse_shares(n_parts: u32) -> impl Iterator<Item = (u32, f64)> {
    let window_sum = 0.42 * f64::from(n_parts);
    let part_share = move |part: u32| {
        let window_angle = TAU * f64::from(part) / f64::from(n_parts);
        (0.42 - 0.5 * cos(window_angle) + 0.08 * cos(2.0 * window_angle)) / window_sum
    };
    let single_part = (n_parts == 1).then_some((0, 1.0));
    single_part
        .into_iter()
        .chain((1..n_parts).map(move |part| (part, part_share(part))))
}

/// A part of a strike: an impulse at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StrikePart {
    pub(crate) frame: u64,
    /// Fraction of a frame after it, 0 to 1.
    pub(crate) frame_fraction: f64,
    /// [N·s]
    pub(crate) impulse: f64,
}

/// On which frames strikes act.
#[derive(Clone, Copy, Debug)]
pub(crate) enum StrikeTiming {
    /// Anywhere between frames.
    Exact,
    /// On the nearest frames of the score.
    OfScore,
    /// On the nearest frames.
    Nearest,
}

impl Timeline {
    /// The parts of a strike, by rising frame. They are 1/44,100 s apart whatever the rate of this timeline, so that
    /// the force is the same at any rate.
    pub(crate) fn strike_parts(&self, strike: &Strike, instants: StrikeTiming) -> impl Iterator<Item = StrikePart> {
        let (strike_instant, impulse, frame_rate) = (strike.instant, strike.impulse, self.rate.hertz());
        let spacing = frame_rate / PARTS_PER_SECOND;
        let first_frame = match instants {
            StrikeTiming::Exact => 0,
            StrikeTiming::OfScore => score_frame(strike_instant, frame_rate, self.oversampling),
            StrikeTiming::Nearest => frame(strike_instant, frame_rate),
        };
        impulse_shares(strike.n_parts).map(move |(parts_after, share)| {
            let frame_offset = f64::from(parts_after) * spacing;
            let (frame, frame_fraction) = if matches!(instants, StrikeTiming::Exact) {
                let exact_frame = strike_instant * frame_rate + frame_offset;
                let frame_floor = floor_frame(exact_frame);
                (frame_floor, (exact_frame - frame_floor as f64).clamp(0.0, 1.0))
            } else {
                (first_frame.saturating_add(frame_offset.round() as u64), 0.0)
            };
            StrikePart {
                frame,
                frame_fraction,
                impulse: share * impulse,
            }
        })
    }

    /// Instants [s] and impulses [N·s] of which a strike consists.
    pub(super) fn impulses_of(&self, strike: &Strike) -> impl Iterator<Item = (f64, f64)> {
        let (strike_instant, impulse) = (strike.instant, strike.impulse);
        let part_spacing = 1.0 / PARTS_PER_SECOND;
        impulse_shares(strike.n_parts)
            .map(move |(parts_after, share)| (strike_instant + f64::from(parts_after) * part_spacing, share * impulse))
    }

    /// Whether strikes on each part of a network act on whole frames: under `ca` and on keys   (n_parts)
    pub(super) fn parts_on_frames(&self, network: &Network) -> Vec<bool> {
        let network_parts = network.parts().iter();
        let mut acts_on_frames: Vec<bool> = network_parts.map(|part| part.ca_rate.is_some()).collect();
        for key in &self.keys {
            acts_on_frames[network.mats().part[key.struck_mat] as usize] = true;
        }
        acts_on_frames
    }

    /// The share of a strike's impulse in each step, if it begins on frame 0.
    pub(crate) fn impulse_share_by_step(&self, n_parts: u32) -> Vec<f64> {
        let strike = Strike {
            instant: 0.0,
            mat: 0,
            source: 0,
            n_parts,
            impulse: 1.0,
        };
        let mut step_shares = Vec::new();
        for part in self.strike_parts(&strike, StrikeTiming::Exact) {
            let step_index = part.frame as usize;
            step_shares.resize(step_shares.len().max(step_index + 2), 0.0);
            step_shares[step_index] += (1.0 - part.frame_fraction) * part.impulse;
            step_shares[step_index + 1] += part.frame_fraction * part.impulse;
        }
        while step_shares.last() == Some(&0.0) {
            step_shares.pop();
        }
        step_shares
    }
}
