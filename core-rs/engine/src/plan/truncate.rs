//! Which modes this score needs: each by the sound that its own strikes give it, and no more of them than
//! the budget lets fall below.

use super::budget::Budget;
use super::modes::Modes;
use crate::maths::{log10, pow};
use crate::units::Rate;

/// A mode without damping sounds for this long, for the sake of its energy [s].
const ENDLESS: f64 = 10.0;

/// The modes that stay.
pub(super) struct Kept {
    /// Rising.
    pub(super) modes: Vec<usize>,
    /// How loud the others would have been together, relative to all [dB]; `None`: silent, or none.
    pub(super) left_out: Option<f64>,
}

/// Keep the loudest modes, so that for every output those that fall stay below the budget together.
///
/// `blows` are impulses [N·s]. Energies as if strikes added up by power: A² / 4σ, A the amplitude that an output hears. Measured
/// within 1.1 dB of the error down to −127 dB.
pub(super) fn keep(
    modes: &Modes,
    heard: &[Vec<f64>],
    felt: &[Vec<f64>],
    blows: &[Vec<f64>],
    budget: &Budget,
    rate: Rate,
) -> Kept {
    let n = modes.len();
    let own: Vec<f64> = (0..n)
        .map(|mode| energy(modes, felt, blows, mode, rate))
        .collect();
    let energy = |output: usize, mode: usize| own[mode] * heard[output][mode] * heard[output][mode];
    let totals: Vec<f64> = (0..heard.len())
        .map(|output| (0..n).map(|mode| energy(output, mode)).sum())
        .collect();
    // A mode's loudness where it is loudest.
    let loudness = |mode: usize| {
        let at = |output: usize| match totals[output] {
            0.0 => 0.0,
            total => energy(output, mode) / total,
        };
        (0..heard.len()).map(at).fold(0.0, f64::max)
    };
    let mut by_loudness: Vec<(f64, usize)> = (0..n).map(|mode| (loudness(mode), mode)).collect();
    by_loudness.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let allowed = budget.left_out().map_or(0.0, |db| pow(10.0, db / 10.0));
    let (mut stays, mut fallen) = (Vec::new(), 0.0);
    for (loudness, mode) in by_loudness {
        let is_unheard = modes.pitch(mode, rate).0 > budget.highest();
        if loudness == 0.0 || is_unheard || fallen + loudness <= allowed {
            // Above hearing a mode may be loud: it is not counted as an error.
            fallen += if is_unheard { 0.0 } else { loudness };
        } else {
            stays.push(mode);
        }
    }
    stays.sort_unstable();
    Kept {
        modes: stays,
        left_out: (fallen > 0.0).then(|| 10.0 * log10(fallen)),
    }
}

/// Energy of one mode's own motion.
fn energy(modes: &Modes, felt: &[Vec<f64>], blows: &[Vec<f64>], mode: usize, rate: Rate) -> f64 {
    let (f, sigma) = modes.pitch(mode, rate);
    let omega = (std::f64::consts::TAU * f)
        .max(sigma)
        .max(f64::MIN_POSITIVE);
    let (x, v) = (modes.x0[mode] - modes.rest[mode], modes.v0[mode]);
    let mut square = x * x + v * v / (omega * omega);
    for (shape, blows) in felt.iter().zip(blows) {
        // A unit impulse gives a mass of 1 the velocity 1; an algorithmic one T^-2 times as much.
        let unit = if modes.is_discrete {
            rate.step() * rate.step()
        } else {
            1.0
        };
        let size = shape[mode] / (omega * unit);
        square += blows.iter().map(|p| p * p * size * size).sum::<f64>();
    }
    square / (4.0 * sigma).max(1.0 / ENDLESS)
}
