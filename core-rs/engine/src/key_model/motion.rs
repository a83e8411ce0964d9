//! A key in motion, step by step.

mod derivatives;

use std::f64::consts::TAU;

use super::friction::{Contact, Friction};
use super::parameter::Parameter;
use super::{KeyError, KeyModel, Mode};
use crate::dry::Turned;
use crate::maths::floor;
use derivatives::StepTerms;

/// Steps a second if the caller does not choose the steps of a tick.
const FRAME_RATE: f64 = 44_100.0;
/// Fewest steps of a tick if the caller does not choose them.
const STEPS_MIN: usize = 4;
/// Most steps of a tick.
const STEPS_MAX: usize = 10_000;
/// An explicit oscillator is stable up to ω h = 2; half of this keeps frequencies near their nominal values.
const ANGLE_MAX: f64 = 1.0;

/// A mode in motion, and the derivatives of its motion.
#[derive(Clone, Debug)]
struct ModeMotion<const N: usize> {
    mass: f64,
    /// ω², 2ζω, ω, and the denominator of the trapezoidal rule.
    omega_squared: f64,
    damping_rate: f64,
    omega: f64,
    denominator: f64,
    x: f64,
    v: f64,
    /// In this step.
    deceleration: f64,
    dx: [f64; N],
    dv: [f64; N],
}

/// A key in motion, tick by tick; `N` columns of derivatives are computed with it.
#[derive(Clone, Debug)]
pub struct Motion<const N: usize = 0> {
    key: KeyModel,
    /// The parameter of each column.
    columns: Vec<Parameter>,
    steps: usize,
    step_seconds: f64,
    /// h/m, Z h/2m, and 1 + Z h/2m.
    h_over_m: f64,
    half_damping: f64,
    denominator: f64,
    /// The last forces, the newest last (those before the first tick are zero), and the number of ticks so far.
    sent_forces: Vec<f64>,
    ticks: usize,
    /// Steps of a tick in which the previous force still acts.
    previous_force_steps: f64,
    x: f64,
    v: f64,
    /// Fraction of the next step in which spring and weight act. It is a half in the first step, because the velocity
    /// begins half a step before the position.
    spring_fraction: f64,
    /// Deflection of the contact before it slides.
    s: f64,
    pub(super) dx: [f64; N],
    dv: [f64; N],
    ds: [f64; N],
    modes: Vec<ModeMotion<N>>,
}

impl Motion<0> {
    /// A key at rest at its start position.
    ///
    /// # Errors
    /// [`KeyError`] for a rate or steps by which the key cannot be computed.
    pub fn new(key: &KeyModel, rate: f64, steps: Option<usize>) -> Result<Self, KeyError> {
        Self::with_columns(key, rate, steps, &[])
    }
}

impl<const N: usize> Motion<N> {
    pub(super) fn with_columns(
        key: &KeyModel,
        rate: f64,
        steps: Option<usize>,
        columns: &[usize],
    ) -> Result<Self, KeyError> {
        if !(rate.is_finite() && rate > 0.0) {
            return Err(KeyError::Rate);
        }
        let usual_steps = floor(FRAME_RATE / rate + 0.5) as usize;
        let steps = steps.unwrap_or(usual_steps.max(STEPS_MIN));
        if steps == 0 || steps > STEPS_MAX {
            return Err(KeyError::Steps);
        }
        let columns: Option<Vec<_>> = columns
            .iter()
            .map(|&index| Parameter::from_index(index, key.modes.len()))
            .collect();
        let columns = columns.ok_or(KeyError::Count)?;
        let step_seconds = 1.0 / (rate * steps as f64);
        let (h_over_m, half_damping) = (step_seconds / key.mass, 0.5 * key.damping * step_seconds / key.mass);
        let stiffest = key.stiffness.abs().max(key.presliding) * step_seconds * h_over_m;
        let fastest = key.modes.iter().map(|mode| TAU * mode.frequency * step_seconds);
        if stiffest > ANGLE_MAX * ANGLE_MAX || fastest.fold(0.0, f64::max) > ANGLE_MAX {
            return Err(KeyError::Fast);
        }
        // The velocity is half a step behind the position, so without this shift a force would act half a step early.
        let shift_ticks = (key.delay + 0.5 * step_seconds) * rate;
        let full_ticks = floor(shift_ticks);
        let mut dx = [0.0; N];
        if let Some(start_column) = columns.iter().position(|&parameter| parameter == Parameter::Start) {
            dx[start_column] = 1.0;
        }
        let mode_motion = |mode: &Mode| {
            let omega = TAU * mode.frequency;
            let damping_rate = 2.0 * mode.ratio * omega;
            ModeMotion {
                mass: mode.mass,
                omega_squared: omega * omega,
                damping_rate,
                omega,
                denominator: 1.0 + 0.5 * damping_rate * step_seconds,
                x: key.start,
                v: 0.0,
                deceleration: 0.0,
                dx,
                dv: [0.0; N],
            }
        };
        Ok(Self {
            columns,
            steps,
            step_seconds,
            h_over_m,
            half_damping,
            denominator: 1.0 + half_damping,
            sent_forces: vec![0.0; full_ticks as usize + 2],
            ticks: 0,
            previous_force_steps: (shift_ticks - full_ticks) * steps as f64,
            x: key.start,
            v: 0.0,
            spring_fraction: 0.5,
            s: 0.0,
            dx,
            dv: [0.0; N],
            ds: [0.0; N],
            modes: key.modes.iter().map(mode_motion).collect(),
            key: key.clone(),
        })
    }

    /// Position of the key [m].
    pub fn position(&self) -> f64 {
        self.x
    }

    /// Put the key at `x`, at rest, as an end of its travel stops it.
    pub fn stop_at(&mut self, x: f64) {
        (self.x, self.v) = (x, 0.0);
    }

    /// Advance by one tick, with a force that acts after the delay and one that acts at once [N].
    pub fn tick(&mut self, force: f64, immediate_force: f64) {
        self.sent_forces.remove(0);
        self.sent_forces.push(force);
        self.ticks += 1;
        let (previous_force, newest_force) = (self.sent_forces[0], self.sent_forces[1]);
        for step_index in 0..self.steps {
            // Steps in which the previous force still acts.
            let steps_left = self.previous_force_steps - step_index as f64;
            if steps_left >= 1.0 {
                self.advance_step(previous_force + immediate_force, 0.0, 1.0);
            } else if steps_left < 0.0 {
                self.advance_step(newest_force + immediate_force, 0.0, 0.0);
            } else {
                let force_slope = (previous_force - newest_force) / self.step_seconds;
                self.advance_step(
                    steps_left * previous_force + (1.0 - steps_left) * newest_force + immediate_force,
                    force_slope,
                    steps_left,
                );
            }
        }
    }

    /// The same motion with other columns, whose derivatives begin at zero.
    pub(super) fn widened<const M: usize>(&self, columns: Vec<Parameter>) -> Motion<M> {
        let no_derivatives = [0.0; M];
        let mode_motion = |mode: &ModeMotion<N>| ModeMotion {
            mass: mode.mass,
            omega_squared: mode.omega_squared,
            damping_rate: mode.damping_rate,
            omega: mode.omega,
            denominator: mode.denominator,
            x: mode.x,
            v: mode.v,
            deceleration: mode.deceleration,
            dx: no_derivatives,
            dv: no_derivatives,
        };
        Motion {
            key: self.key.clone(),
            columns,
            steps: self.steps,
            step_seconds: self.step_seconds,
            h_over_m: self.h_over_m,
            half_damping: self.half_damping,
            denominator: self.denominator,
            sent_forces: self.sent_forces.clone(),
            ticks: self.ticks,
            previous_force_steps: self.previous_force_steps,
            x: self.x,
            v: self.v,
            spring_fraction: self.spring_fraction,
            s: self.s,
            dx: no_derivatives,
            dv: no_derivatives,
            ds: no_derivatives,
            modes: self.modes.iter().map(mode_motion).collect(),
        }
    }

    /// Share of the force of `tick` in the force of a step, in which the earlier of two forces has the share
    /// `previous_force_share`.
    fn force_share(&self, tick: usize, previous_force_share: f64) -> f64 {
        let ticks_ago = self.ticks.wrapping_sub(tick + 1); // 0: the newest
        let oldest_age = self.sent_forces.len() - 1;
        if ticks_ago == oldest_age {
            previous_force_share
        } else if ticks_ago == oldest_age - 1 {
            1.0 - previous_force_share
        } else {
            0.0
        }
    }

    /// One step with `force`; `force_slope` is its derivative with respect to the delay, and `previous_force_share` the
    /// share of the earlier of the two forces of this tick.
    fn advance_step(&mut self, force: f64, force_slope: f64, previous_force_share: f64) {
        let (h, x, v) = (self.step_seconds, self.x, self.v);
        let mut mode_pull = 0.0;
        for mode in &mut self.modes {
            mode.deceleration =
                (mode.omega_squared * (mode.x - x) + mode.damping_rate * (mode.v - v)) / mode.denominator;
            mode_pull += mode.mass * mode.deceleration;
        }
        let friction = Friction::new(&self.key, v);
        let contact = Contact::new(&self.key, &friction, self.s, v, h);
        let key = &self.key;
        let spring_and_weight = key.stiffness * x + key.weight;
        let total_force = force - self.spring_fraction * spring_and_weight + mode_pull - key.presliding * contact.s;
        let velocity_increment = (self.h_over_m * total_force - 2.0 * self.half_damping * v) / self.denominator;
        let velocity_per_level = if key.presliding > 0.0 {
            0.0
        } else {
            self.h_over_m / self.denominator
        };
        let bound = friction.level * velocity_per_level;
        let friction_step = Turned::after_step(v, velocity_increment, bound);
        if N > 0 {
            let step_terms = StepTerms {
                force_slope,
                previous_force_share,
                velocity_increment,
                bound,
                velocity_per_level,
                friction,
                contact: &contact,
                friction_step: &friction_step,
            };
            self.advance_columns(&step_terms);
        }
        self.spring_fraction = 1.0;
        self.s = contact.s;
        self.v = friction_step.v;
        self.x += h * self.v;
        for mode in &mut self.modes {
            mode.v -= h * mode.deceleration;
            mode.x += h * mode.v;
        }
    }
}
