//! An undamped mode that damping does not couple with others: its poles are the roots of s² + c·s + ω².

use super::{ComplexModes, Coordinates, Pole};
use crate::body_modes::constants::{COUPLING_ERROR_MAX, COUPLING_NONE, CRITICAL_TOLERANCE};
use crate::body_modes::linear::NoModes;

/// Adds the modes that belong to undamped mode `mode` with damping `c` [1/s].
pub(super) fn add(modes: &mut ComplexModes, coordinates: &Coordinates, mode: usize, c: f64) -> Result<(), NoModes> {
    if c < -COUPLING_ERROR_MAX {
        return Err(NoModes::Diverges);
    }
    let c = c.max(0.0);
    let lambda = coordinates.lambda[mode];
    let position = |output: usize| coordinates.positions[output][mode];
    let velocity = |output: usize| coordinates.velocities[output][mode];
    let impulse_at = |point: usize| coordinates.struck[point][mode];
    let (x, v) = (coordinates.x0[mode] - coordinates.rest[mode], coordinates.v0[mode]);
    if lambda == 0.0 && c <= COUPLING_NONE {
        modes.add(
            (Pole::Free, [x, v]),
            |output| [position(output), velocity(output)],
            |point| [0.0, impulse_at(point)],
        );
        return Ok(());
    }
    let decay = 0.5 * c;
    let omega_squared = lambda - decay * decay;
    let omega_min = CRITICAL_TOLERANCE * decay;
    if omega_squared > -omega_min * omega_min {
        // x = Re z with ż = s·z, so v = Re s·z.
        let omega = omega_squared.max(omega_min * omega_min).sqrt();
        modes.add(
            (Pole::Pair { decay, omega }, [x, -(v + decay * x) / omega]),
            |output| {
                let (x, v) = (position(output), velocity(output));
                [x - decay * v, omega * v]
            },
            |point| [0.0, -impulse_at(point) / omega],
        );
        return Ok(());
    }
    let fast_decay = decay + (-omega_squared).sqrt();
    // Avoids the difference of two nearly equal numbers.
    let slow_decay = lambda / fast_decay;
    let decay_gap = fast_decay - slow_decay;
    for (pole_decay, other_decay, sign) in [(slow_decay, fast_decay, 1.0), (fast_decay, slow_decay, -1.0)] {
        modes.add(
            (
                Pole::Real { decay: pole_decay },
                [sign * (v + other_decay * x) / decay_gap, 0.0],
            ),
            |output| [position(output) - pole_decay * velocity(output), 0.0],
            |point| [sign * impulse_at(point) / decay_gap, 0.0],
        );
    }
    Ok(())
}
