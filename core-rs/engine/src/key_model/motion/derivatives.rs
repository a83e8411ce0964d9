//! The derivatives of a step.

use std::f64::consts::TAU;

use super::super::friction::{Contact, Friction};
use super::super::parameter::Parameter;
use super::{ModeMotion, Motion};
use crate::dry::Turned;

/// The quantities of a step that its derivatives need.
pub(super) struct StepTerms<'a> {
    pub(super) force_slope: f64,
    pub(super) previous_force_share: f64,
    pub(super) velocity_increment: f64,
    pub(super) bound: f64,
    pub(super) velocity_per_level: f64,
    pub(super) friction: Friction,
    pub(super) contact: &'a Contact,
    pub(super) friction_step: &'a Turned,
}

impl<const N: usize> Motion<N> {
    /// The derivatives of a step: first those that follow from the derivatives of the state, then the direct
    /// contribution of each parameter to its own column.
    pub(super) fn advance_columns(&mut self, step: &StepTerms<'_>) {
        let (h, contact, friction_step) = (self.step_seconds, step.contact, step.friction_step);
        let (stiffness, presliding) = (self.spring_fraction * self.key.stiffness, self.key.presliding);
        let per_force = self.h_over_m / self.denominator;
        let by_force = friction_step.by_increment * per_force;
        let by_velocity = friction_step.by_v - friction_step.by_increment * 2.0 * self.half_damping / self.denominator
            + friction_step.by_bound * step.velocity_per_level * step.friction.slope;
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
                let column_deceleration = (mode.omega_squared * dx + mode.damping_rate * dv) / mode.denominator;
                *column_force += mode.mass * column_deceleration;
                mode.dv[column] -= h * column_deceleration;
            }
        }
        for (dv, column_force) in self.dv.iter_mut().zip(&column_force) {
            *dv = by_velocity * *dv + by_force * column_force;
        }
        for column in 0..self.columns.len() {
            let direct_terms = self.direct_terms(self.columns[column], column, step);
            self.dv[column] += by_force * direct_terms.force
                + friction_step.by_increment * direct_terms.velocity_increment
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
    fn direct_terms(&mut self, parameter: Parameter, column: usize, step: &StepTerms<'_>) -> DirectTerms {
        let key = &self.key;
        let damping_slope = 0.5 * self.h_over_m / self.denominator; // relative derivative of 1 + Z h/2m by Z
        let no_effect = DirectTerms::default();
        let level_terms = |by: f64| DirectTerms {
            bound: step.velocity_per_level * by,
            level: by,
            ..no_effect
        };
        let mode_terms = |mode: &ModeMotion<N>, deceleration_slope: f64| DirectTerms {
            force: mode.mass * deceleration_slope,
            mode_deceleration: deceleration_slope,
            ..no_effect
        };
        let direct_terms = match parameter {
            Parameter::Start => no_effect,
            Parameter::Mass => {
                let mass_factor = -1.0 / (key.mass * self.denominator);
                DirectTerms {
                    velocity_increment: mass_factor * step.velocity_increment,
                    bound: mass_factor * step.bound,
                    ..no_effect
                }
            }
            Parameter::Stiffness => DirectTerms {
                force: -self.spring_fraction * self.x,
                ..no_effect
            },
            Parameter::Damping => DirectTerms {
                velocity_increment: -damping_slope * (2.0 * self.v + step.velocity_increment),
                bound: -damping_slope * step.bound,
                ..no_effect
            },
            Parameter::Weight => DirectTerms {
                force: -self.spring_fraction,
                ..no_effect
            },
            Parameter::Delay => DirectTerms {
                force: step.force_slope,
                ..no_effect
            },
            Parameter::Force(tick) => DirectTerms {
                force: self.force_share(tick, step.previous_force_share),
                ..no_effect
            },
            Parameter::Dry => level_terms(1.0 - step.friction.static_share),
            Parameter::StaticDry => level_terms(step.friction.static_share),
            Parameter::StaticSpeed if key.static_speed == 0.0 => no_effect,
            Parameter::StaticSpeed => level_terms(-step.friction.slope * self.v / key.static_speed),
            Parameter::Presliding => DirectTerms {
                force: -step.contact.s,
                contact: step.contact.by_presliding,
                ..no_effect
            },
            Parameter::ModeMass(mode_index) => DirectTerms {
                force: self.modes[mode_index].deceleration,
                ..no_effect
            },
            Parameter::ModeFrequency(mode_index) => {
                let mode = &self.modes[mode_index];
                let (twice_squared, damping_rate) = (2.0 * mode.omega_squared, mode.damping_rate);
                let deceleration_slope = (twice_squared * (mode.x - self.x) + damping_rate * (mode.v - self.v)
                    - 0.5 * self.step_seconds * damping_rate * mode.deceleration)
                    / (mode.denominator * mode.omega / TAU);
                mode_terms(mode, deceleration_slope)
            }
            Parameter::ModeRatio(mode_index) => {
                let mode = &self.modes[mode_index];
                let velocity_sum = 2.0 * (mode.v - self.v) - self.step_seconds * mode.deceleration;
                mode_terms(mode, mode.omega * velocity_sum / mode.denominator)
            }
        };
        if let Parameter::ModeFrequency(mode_index) | Parameter::ModeRatio(mode_index) = parameter {
            self.modes[mode_index].dv[column] -= self.step_seconds * direct_terms.mode_deceleration;
        }
        let ds = direct_terms.contact + step.contact.by_level * direct_terms.level;
        self.ds[column] += ds;
        DirectTerms {
            force: direct_terms.force - self.key.presliding * ds,
            ..direct_terms
        }
    }
}

/// Direct derivatives of a step by a parameter: of force, velocity increment, friction's bound and level, the contact,
/// and a mode's deceleration.
#[derive(Clone, Copy, Default)]
struct DirectTerms {
    force: f64,
    velocity_increment: f64,
    bound: f64,
    level: f64,
    contact: f64,
    mode_deceleration: f64,
}
