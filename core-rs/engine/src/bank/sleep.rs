//! Groups of a bank whose oscillations have decayed: they are set to rest and no longer computed.

use super::{Bank, BankScript, Kick, Oscillator, Strikes};
use crate::cell::Response;
use crate::kernel::bank::{LANES, Lanes};
use crate::units::Rate;

/// Frames between two tests for decayed groups, counted from frame 0.
pub(super) const REST_TEST_FRAMES: u64 = 4_096;
/// Largest level of all groups at rest together, relative to the hardest blow [dB]: below the rounding of 24 bits.
const REST_LEVEL_DB: f64 = -160.0;
/// Threshold if further strikes are unknown [m]: about the width of an atomic nucleus.
pub(super) const REST_AMPLITUDE: f64 = 1e-15;

impl Bank {
    /// Set a decayed group to rest; without blows it cannot grow.
    pub(super) fn rest_if_decayed(&mut self, script: &BankScript, group: usize) {
        if self.is_at_rest[group] {
            return;
        }
        let (group_coefficients, group_motion) = (&script.coefficients[group], &mut self.motions[group]);
        let amplitude = |lane: usize| {
            let (a, b) = (group_coefficients.a.0[lane], group_coefficients.b.0[lane]);
            amplitude(
                a,
                b,
                group_motion.positions.0[lane],
                group_motion.previous_positions.0[lane],
            )
        };
        let total_amplitude: f64 = (0..LANES).map(amplitude).sum();
        if total_amplitude < script.rest_threshold {
            (group_motion.positions, group_motion.previous_positions) = (Lanes::ZERO, Lanes::ZERO);
            self.is_at_rest[group] = true;
        }
    }
}

/// Amplitude of an oscillator from two positions (b = r², a = 2r·cos θ) [m]; infinite for an overdamped one, which has
/// no such bound, unless it has a single pole (b = 0).
fn amplitude(a: f64, b: f64, position: f64, previous_position: f64) -> f64 {
    if position == 0.0 && previous_position == 0.0 {
        return 0.0;
    }
    if b == 0.0 {
        return position.abs();
    }
    let sine_squared = 1.0 - a * a / (4.0 * b);
    if sine_squared > 0.0 {
        ((position * position + b * previous_position * previous_position - a * position * previous_position)
            / sine_squared)
            .sqrt()
    } else {
        f64::INFINITY
    }
}

/// Largest sum of amplitudes that counts as rest, for all groups together: [`REST_LEVEL_DB`] below the hardest blow.
pub(super) fn rest_threshold(oscillators: &[Oscillator], strikes: &[Strikes], rate: Rate) -> f64 {
    // With one output, the lanes hold positions times their weights.
    let output_scale = |oscillator: &Oscillator| match oscillator.outputs[..] {
        [(_, weight)] => weight.abs(),
        _ => 1.0,
    };
    let oscillator_amplitudes = oscillators.iter().map(|oscillator| {
        let blow_sizes = oscillator.blows.iter().map(|blow| match blow.kick {
            Kick::Displacement(x) => x.abs(),
            Kick::Ergon { .. } => 0.0,
        });
        let start_amplitude = Some(amplitude(
            oscillator.a,
            oscillator.b,
            oscillator.position,
            oscillator.previous_position,
        ))
        .filter(|x| x.is_finite());
        blow_sizes.fold(start_amplitude.unwrap_or(0.0), f64::max) * output_scale(oscillator)
    });
    let shared_sizes = strikes.iter().flat_map(|strikes| {
        let impulses = strikes.blows.iter().map(|(_, _, impulse)| impulse.abs());
        let impulse = impulses.fold(0.0, f64::max);
        let unit_displacement = impulse * rate.hertz() * strikes.w;
        let struck_members = oscillators[strikes.members.clone()].iter();
        let member_shares = struck_members.zip(&strikes.member_shares).enumerate();
        member_shares.map(move |(i, (oscillator, member_share))| {
            let response = strikes.responses.get(i);
            let response_size = response.and_then(Response::peak_displacement);
            response_size.map_or(unit_displacement, |response_size| impulse * response_size)
                * member_share.abs()
                * output_scale(oscillator)
        })
    });
    oscillator_amplitudes.chain(shared_sizes).fold(0.0, f64::max) * crate::maths::amplitude_ratio(REST_LEVEL_DB)
}
