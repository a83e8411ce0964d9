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
    pub(super) turned: &'a Turned,
}

impl<const N: usize> Motion<N> {
    /// The derivatives of a step: first those that follow from the derivatives of the state, then the direct
    /// contribution of each parameter to its own column.
    pub(super) fn advance_columns(&mut self, step: &Step<'_>) {
        let (h, contact, turned) = (self.step, step.contact, step.turned);
        let (stiffness, presliding) = (
            self.spring_fraction * self.key.stiffness,
            self.key.presliding,
        );
        let per_force = self.h_over_m / self.denominator;
        let by_force = turned.by_gain * per_force;
        let by_v = turned.by_v - turned.by_gain * 2.0 * self.half_damping / self.denominator
            + turned.by_bound * step.per_level * step.friction.slope;
        let mut force = [0.0; N];
        for (column, force) in force.iter_mut().enumerate() {
            let (dx, dv) = (self.dx[column], self.dv[column]);
            let ds = contact.by_s * self.ds[column] + contact.by_v * dv;
            self.ds[column] = ds;
            *force = -stiffness * dx - presliding * ds;
        }
        for mode in &mut self.modes {
            for (column, force) in force.iter_mut().enumerate() {
                let (dx, dv) = (
                    mode.dx[column] - self.dx[column],
                    mode.dv[column] - self.dv[column],
                );
                let gain = (mode.omega_squared * dx + mode.damping_rate * dv) / mode.denominator;
                *force += mode.mass * gain;
                mode.dv[column] -= h * gain;
            }
        }
        for (dv, force) in self.dv.iter_mut().zip(&force) {
            *dv = by_v * *dv + by_force * force;
        }
        for column in 0..self.columns.len() {
            let direct = self.direct(self.columns[column], column, step);
            self.dv[column] += by_force * direct.force
                + turned.by_gain * direct.gain
                + turned.by_bound * direct.bound;
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
        let half = 0.5 * self.h_over_m / self.denominator; // relative derivative of 1 + Z h/2m by Z
        let none = Direct::default();
        let level = |by: f64| Direct {
            bound: step.per_level * by,
            level: by,
            ..none
        };
        let by_mode = |mode: &ModeMotion<N>, gain: f64| Direct {
            force: mode.mass * gain,
            mode_gain: gain,
            ..none
        };
        let direct = match parameter {
            Parameter::Start => none,
            Parameter::Mass => {
                let share = -1.0 / (key.mass * self.denominator);
                Direct {
                    gain: share * step.gain,
                    bound: share * step.bound,
                    ..none
                }
            }
            Parameter::Stiffness => Direct {
                force: -self.spring_fraction * self.x,
                ..none
            },
            Parameter::Damping => Direct {
                gain: -half * (2.0 * self.v + step.gain),
                bound: -half * step.bound,
                ..none
            },
            Parameter::Weight => Direct {
                force: -self.spring_fraction,
                ..none
            },
            Parameter::Delay => Direct {
                force: step.slope,
                ..none
            },
            Parameter::Force(tick) => Direct {
                force: self.share_of(tick, step.before),
                ..none
            },
            Parameter::Dry => level(1.0 - step.friction.share),
            Parameter::StaticDry => level(step.friction.share),
            Parameter::StaticSpeed if key.static_speed == 0.0 => none,
            Parameter::StaticSpeed => level(-step.friction.slope * self.v / key.static_speed),
            Parameter::Presliding => Direct {
                force: -step.contact.s,
                contact: step.contact.by_presliding,
                ..none
            },
            Parameter::ModeMass(index) => Direct {
                force: self.modes[index].gain,
                ..none
            },
            Parameter::ModeFrequency(index) => {
                let mode = &self.modes[index];
                let (twice_squared, damping_rate) = (2.0 * mode.omega_squared, mode.damping_rate);
                let gain = (twice_squared * (mode.x - self.x) + damping_rate * (mode.v - self.v)
                    - 0.5 * self.step * damping_rate * mode.gain)
                    / (mode.denominator * mode.omega / TAU);
                by_mode(mode, gain)
            }
            Parameter::ModeRatio(index) => {
                let mode = &self.modes[index];
                let over = 2.0 * (mode.v - self.v) - self.step * mode.gain;
                by_mode(mode, mode.omega * over / mode.denominator)
            }
        };
        if let Parameter::ModeFrequency(index) | Parameter::ModeRatio(index) = parameter {
            self.modes[index].dv[column] -= self.step * direct.mode_gain;
        }
        let ds = direct.contact + step.contact.by_level * direct.level;
        self.ds[column] += ds;
        Direct {
            force: direct.force - self.key.presliding * ds,
            ..direct
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
