//! Groups of a bank whose oscillations have decayed: they are set to rest and no longer computed.

use super::{Bank, Kick, Oscillator, Script, Strikes};
use crate::cell::Response;
use crate::kernel::bank::{LANES, Lanes};
use crate::units::Rate;

/// Frames between two tests for decayed groups, counted from frame 0.
pub(super) const REST_TEST_EVERY: u64 = 4_096;
/// Largest level of all groups at rest together, relative to the hardest blow [dB]: below the rounding of 24 bits.
const REST_LEVEL: f64 = -160.0;
/// Threshold if further strikes are unknown [m]: about the width of an atomic nucleus.
pub(super) const UNHEARABLE: f64 = 1e-15;

impl Bank {
    /// Set a decayed group to rest; without blows it cannot grow.
    pub(super) fn rest_if_decayed(&mut self, script: &Script, group: usize) {
        if self.still[group] {
            return;
        }
        let (rates, motion) = (&script.rates[group], &mut self.motions[group]);
        let amplitude = |lane: usize| {
            let (a, b) = (rates.a.0[lane], rates.b.0[lane]);
            amplitude(a, b, motion.now.0[lane], motion.before.0[lane])
        };
        let moves: f64 = (0..LANES).map(amplitude).sum();
        if moves < script.rest_threshold {
            (motion.now, motion.before) = (Lanes::ZERO, Lanes::ZERO);
            self.still[group] = true;
        }
    }
}

/// Amplitude of an oscillator from two positions (b = r², a = 2r·cos θ) [m]; infinite for an overdamped one, which has
/// no such bound, unless it has a single pole (b = 0).
fn amplitude(a: f64, b: f64, now: f64, before: f64) -> f64 {
    if now == 0.0 && before == 0.0 {
        return 0.0;
    }
    if b == 0.0 {
        return now.abs();
    }
    let sine = 1.0 - a * a / (4.0 * b);
    if sine > 0.0 {
        ((now * now + b * before * before - a * now * before) / sine).sqrt()
    } else {
        f64::INFINITY
    }
}

/// Largest sum of amplitudes that counts as rest, for all groups together: [`REST_LEVEL`] below the hardest blow.
pub(super) fn rest_threshold(oscillators: &[Oscillator], strikes: &[Strikes], rate: Rate) -> f64 {
    // With one output, the lanes hold positions times their weights.
    let scale = |oscillator: &Oscillator| match oscillator.outputs[..] {
        [(_, weight)] => weight.abs(),
        _ => 1.0,
    };
    let oscillator = oscillators.iter().map(|oscillator| {
        let blows = oscillator.blows.iter().map(|blow| match blow.kick {
            Kick::By(x) => x.abs(),
            Kick::Ergon { .. } => 0.0,
        });
        let start = Some(amplitude(
            oscillator.a,
            oscillator.b,
            oscillator.now,
            oscillator.before,
        ))
        .filter(|x| x.is_finite());
        blows.fold(start.unwrap_or(0.0), f64::max) * scale(oscillator)
    });
    let shared = strikes.iter().flat_map(|strikes| {
        let impulses = strikes.blows.iter().map(|(_, _, impulse)| impulse.abs());
        let impulse = impulses.fold(0.0, f64::max);
        let unit = impulse * rate.hertz() * strikes.w;
        let among = oscillators[strikes.among.clone()].iter();
        let shares = among.zip(&strikes.share).enumerate();
        shares.map(move |(i, (oscillator, share))| {
            let response = strikes.responses.get(i);
            let size = response.and_then(Response::size);
            size.map_or(unit, |size| impulse * size) * share.abs() * scale(oscillator)
        })
    });
    oscillator.chain(shared).fold(0.0, f64::max) * crate::maths::decibels(REST_LEVEL)
}
