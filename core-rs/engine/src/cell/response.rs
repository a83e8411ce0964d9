//! The response of one coordinate of a linear body to an impulse, given as displacements at two samples. From then on
//! the recurrence x[n+1] = a·x[n] − b·x[n−1] runs through the samples of the continuous motion.

use std::f64::consts::TAU;

use super::{BACKWARD_DECAY_MAX, Cell, CellRatios};
use crate::maths::{cos, exp, sin, sqrt};
use crate::units::Rate;

/// Above this decay per step, a and b are computed from the poles: by κ and ζ, b would be rounded.
const STRONG_DECAY: f64 = 0.5;

/// The motion of a coordinate after an impulse of 1 N·s at t = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Response {
    /// That of a mass of 1 kg on a spring and a damper.
    Cell(Cell),
    /// The real part of gain·e^st, s = −decay + iω.
    Pair { decay: f64, omega: f64, gain: [f64; 2] },
    /// gain·e^(−decay·t).
    Real { decay: f64, gain: f64 },
    /// gain·t: a motion without a restoring force.
    Free { gain: f64 },
}

impl Response {
    /// The forces [N] on a mass of 1 kg at samples n and n+1 that replace an impulse [N·s] at (n + α)T, 0 <= α < 1.
    pub(crate) fn split(&self, impulse: f64, frame_fraction: f64, rate: Rate) -> [f64; 2] {
        let time_step = rate.step();
        let scaled_impulse = impulse / (time_step * time_step);
        let (time_left, time_since_sample) = ((1.0 - frame_fraction) * time_step, frame_fraction * time_step);
        match *self {
            Self::Cell(cell) => cell.split(impulse, frame_fraction, rate),
            Self::Pair {
                decay,
                omega,
                gain: [re, im],
            } => {
                let oscillation_left = re * cos(omega * time_left) - im * sin(omega * time_left);
                let oscillation_since_sample =
                    re * cos(omega * time_since_sample) + im * sin(omega * time_since_sample);
                // The second force is −b times the response extended back to sample n.
                [
                    scaled_impulse * exp(-decay * time_left) * oscillation_left,
                    -scaled_impulse * exp(-decay * (time_left + time_step)) * oscillation_since_sample,
                ]
            }
            Self::Real { decay, gain } => [scaled_impulse * gain * exp(-decay * time_left), 0.0],
            Self::Free { gain } => [
                scaled_impulse * gain * time_left,
                scaled_impulse * gain * time_since_sample,
            ],
        }
    }
}

impl Response {
    /// Displacement per impulse [m/N·s], `t` [s] >= 0 after it.
    pub(crate) fn displacement(&self, t: f64) -> f64 {
        match *self {
            Self::Cell(cell) => cell.response(t),
            Self::Pair {
                decay,
                omega,
                gain: [re, im],
            } => exp(-decay * t) * (re * cos(omega * t) - im * sin(omega * t)),
            Self::Real { decay, gain } => gain * exp(-decay * t),
            Self::Free { gain } => gain * t,
        }
    }

    /// The same function extended to times `t` [s] before the impulse. If it decays by more than
    /// e^-BACKWARD_DECAY_MAX over `t`, it is extended as if it decayed both ways, since its own continuation
    /// would become too large.
    pub(crate) fn two_sided(&self, t: f64) -> f64 {
        let decay_factor = |decay: f64| {
            let is_steep = -decay * t > BACKWARD_DECAY_MAX;
            exp(-decay * if is_steep { -t } else { t })
        };
        match *self {
            Self::Cell(cell) => cell.impulse_response_around(t),
            Self::Pair {
                decay,
                omega,
                gain: [re, im],
            } => decay_factor(decay) * (re * cos(omega * t) - im * sin(omega * t)),
            Self::Real { decay, gain } => gain * decay_factor(decay),
            Self::Free { gain } => gain * t,
        }
    }

    /// Velocity [m/s] per impulse [N·s], right after it.
    pub(crate) fn velocity_jump(&self) -> f64 {
        match *self {
            Self::Cell(cell) => cell.velocity_jump(),
            Self::Pair {
                decay,
                omega,
                gain: [re, im],
            } => -decay * re - omega * im,
            Self::Real { decay, gain } => -decay * gain,
            Self::Free { gain } => gain,
        }
    }

    /// The largest |λ| [1/s] of its components e^(λt).
    pub(crate) fn pole_magnitude_max(&self) -> f64 {
        match *self {
            Self::Cell(cell) => cell.pole_magnitude_max(),
            Self::Pair { decay, omega, .. } => sqrt(decay * decay + omega * omega),
            Self::Real { decay, .. } => decay,
            Self::Free { .. } => 0.0,
        }
    }

    /// The angle by which it turns in a frame [rad]; 0 if it does not oscillate.
    pub(crate) fn pole_angle(&self, rate: Rate) -> f64 {
        match *self {
            Self::Cell(cell) => TAU * cell.frequency() * rate.step(),
            Self::Pair { omega, .. } => omega * rate.step(),
            Self::Real { .. } | Self::Free { .. } => 0.0,
        }
    }

    /// Its largest displacement per impulse [m/N·s]; `None` for a cell, 0 for a motion without a bound.
    pub(crate) fn peak_displacement(&self) -> Option<f64> {
        match *self {
            Self::Cell(_) => None,
            Self::Pair { gain: [re, im], .. } => Some(sqrt(re * re + im * im)),
            Self::Real { gain, .. } => Some(gain.abs()),
            // It grows without bound.
            Self::Free { .. } => Some(0.0),
        }
    }

    /// Weights of two successive samples that give the free motion at `frame_fraction` of the step between them.
    pub(crate) fn interpolation(&self, frame_fraction: f64, rate: Rate) -> (f64, f64) {
        let time_step = rate.step();
        match *self {
            Self::Cell(cell) => cell.interpolation(frame_fraction, rate),
            Self::Pair { decay, omega, .. } => {
                let step_sine = sin(omega * time_step);
                let (time_left, time_since_sample) = ((1.0 - frame_fraction) * time_step, frame_fraction * time_step);
                (
                    exp(-decay * time_since_sample) * sin(omega * time_left) / step_sine,
                    exp(decay * time_left) * sin(omega * time_since_sample) / step_sine,
                )
            }
            Self::Real { decay, .. } => (exp(-decay * frame_fraction * time_step), 0.0),
            Self::Free { .. } => (1.0 - frame_fraction, frame_fraction),
        }
    }
}

/// a and b of the recurrence whose poles are −decay ± iω.
pub(crate) fn recurrence(decay: f64, omega: f64, rate: Rate) -> (f64, f64) {
    let (step_decay, pole_angle) = (decay * rate.step(), omega * rate.step());
    if step_decay > STRONG_DECAY {
        return (2.0 * exp(-step_decay) * cos(pole_angle), exp(-2.0 * step_decay));
    }
    let CellRatios { kappa, zeta } = CellRatios::from_poles(step_decay, pole_angle);
    (2.0 - kappa - zeta, 1.0 - zeta)
}
