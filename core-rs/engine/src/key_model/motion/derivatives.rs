//! The derivatives of a step.

use std::f64::consts::TAU;

use super::super::friction::{Contact, Friction};
use super::super::parameter::Parameter;
use super::{ModeMotion, Motion};
use crate::dry::Turned;

/// The quantities of a step that its derivatives need.
pub(super) struct Step<'a> {
    pub(super) slope: f64,
    pub(super) before: f64,
    pub(super) gain: f64,
    pub(super) bound: f64,
    pub(super) per_level: f64,
    pub(super) friction: Friction,
    pub(super) contact: &'a Contact,
    pub(super) friction_step: &'a Turned,
}

impl<const N: usize> Motion<N> {
    /// The derivatives of a step: first those that follow from the derivatives of the state, then the direct
    /// contribution of each parameter to its own column.
    pub(super) fn advance_columns(&mut self, step: &Step<'_>) {
        let (h, contact, friction_step) = (self.step, step.contact, step.friction_step);
        let (stiffness, presliding) = (self.spring_fraction * self.key.stiffness, self.key.presliding);
        let per_force = self.h_over_m / self.denominator;
        let by_force = friction_step.by_gain * per_force;
        let by_velocity = friction_step.by_v - friction_step.by_gain * 2.0 * self.half_damping / self.denominator
            + friction_step.by_bound * step.per_level * step.friction.slope;
        let mut column_force = [0.0; N];
        for (column, column_force) in column_force.iter_mut().enumerate() {
            let (dx, dv) = (self.dx[column], self.dv[column]);
            let ds = contact.by_s * self.ds[column] + contact.by_v * dv;
            self.ds[column] = ds;
            *column_force = -stiffness * dx - presliding * ds;
        }
        for mode in &mut self.modes {
            for (column, column_force) in column_force.iter_mut().enumerate() {
                let (dx, dv) = (mode.dx[column] - self.dx[column], mode.dv[column] - self.dv[column]);
                let column_gain = (mode.omega_squared * dx + mode.damping_rate * dv) / mode.denominator;
                *column_force += mode.mass * column_gain;
                mode.dv[column] -= h * column_gain;
            }
        }
        for (dv, column_force) in self.dv.iter_mut().zip(&column_force) {
            *dv = by_velocity * *dv + by_force * column_force;
        }
        for column in 0..self.columns.len() {
            let direct_terms = self.direct(self.columns[column], column, step);
            self.dv[column] += by_force * direct_terms.force
                + friction_step.by_gain * direct_terms.gain
                + friction_step.by_bound * direct_terms.bound;
        }
        for column in 0..N {
            self.dx[column] += h * self.dv[column];
        }
        for mode in &mut self.modes {
            for column in 0..N {
                mode.dx[column] += h * mode.dv[column];
            }
        }
    }

    /// The direct contribution of a parameter to the derivatives in its own column.
    fn direct(&mut self, parameter: Parameter, column: usize, step: &Step<'_>) -> Direct {
        let key = &self.key;
        let damping_slope = 0.5 * self.h_over_m / self.denominator; // relative derivative of 1 + Z h/2m by Z
        let no_effect = Direct::default();
        let level_terms = |by: f64| Direct {
            bound: step.per_level * by,
            level: by,
            ..no_effect
        };
        let mode_terms = |mode: &ModeMotion<N>, gain_slope: f64| Direct {
            force: mode.mass * gain_slope,
            mode_gain: gain_slope,
            ..no_effect
        };
        let direct_terms = match parameter {
            Parameter::Start => no_effect,
            Parameter::Mass => {
                let mass_factor = -1.0 / (key.mass * self.denominator);
                Direct {
                    gain: mass_factor * step.gain,
                    bound: mass_factor * step.bound,
                    ..no_effect
                }
            }
            Parameter::Stiffness => Direct {
                force: -self.spring_fraction * self.x,
                ..no_effect
            },
            Parameter::Damping => Direct {
                gain: -damping_slope * (2.0 * self.v + step.gain),
                bound: -damping_slope * step.bound,
                ..no_effect
            },
            Parameter::Weight => Direct {
                force: -self.spring_fraction,
                ..no_effect
            },
            Parameter::Delay => Direct {
                force: step.slope,
                ..no_effect
            },
            Parameter::Force(tick) => Direct {
                force: self.share_of(tick, step.before),
                ..no_effect
            },
            Parameter::Dry => level_terms(1.0 - step.friction.share),
            Parameter::StaticDry => level_terms(step.friction.share),
            Parameter::StaticSpeed if key.static_speed == 0.0 => no_effect,
            Parameter::StaticSpeed => level_terms(-step.friction.slope * self.v / key.static_speed),
            Parameter::Presliding => Direct {
                force: -step.contact.s,
                contact: step.contact.by_presliding,
                ..no_effect
            },
            Parameter::ModeMass(mode_index) => Direct {
                force: self.modes[mode_index].gain,
                ..no_effect
            },
            Parameter::ModeFrequency(mode_index) => {
                let mode = &self.modes[mode_index];
                let (twice_squared, damping_rate) = (2.0 * mode.omega_squared, mode.damping_rate);
                let gain_slope = (twice_squared * (mode.x - self.x) + damping_rate * (mode.v - self.v)
                    - 0.5 * self.step * damping_rate * mode.gain)
                    / (mode.denominator * mode.omega / TAU);
                mode_terms(mode, gain_slope)
            }
            Parameter::ModeRatio(mode_index) => {
                let mode = &self.modes[mode_index];
                let velocity_sum = 2.0 * (mode.v - self.v) - self.step * mode.gain;
                mode_terms(mode, mode.omega * velocity_sum / mode.denominator)
            }
        };
        if let Parameter::ModeFrequency(mode_index) | Parameter::ModeRatio(mode_index) = parameter {
            self.modes[mode_index].dv[column] -= self.step * direct_terms.mode_gain;
        }
        let ds = direct_terms.contact + step.contact.by_level * direct_terms.level;
        self.ds[column] += ds;
        Direct {
            force: direct_terms.force - self.key.presliding * ds,
            ..direct_terms
        }
    }
}

/// Direct derivatives of a step by a parameter: of force, gain, friction's bound and level, the contact, and a mode's
/// gain.
#[derive(Clone, Copy, Default)]
struct Direct {
    force: f64,
    gain: f64,
    bound: f64,
    level: f64,
    contact: f64,
    mode_gain: f64,
}
