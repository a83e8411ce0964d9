//! The motion of a real force-feedback key: a CEL with weight, dry friction, modes of its mechanics, and the delay of
//! its forces, and the derivatives of its path with respect to every parameter.
//!
//! M ẍ = F(t - delay) - K x - Z ẋ - weight - dry friction + pull of the modes. A force is held for a tick. A tick is
//! computed in equal steps h, with velocities between positions: spring, weight and modes by leapfrog, the damper by
//! the trapezoidal rule, all of second order. Two small errors are of first order. A mode's damper takes the key's
//! velocity half a step early. A resting key that a jump of the force sets off within a step feels friction for the
//! whole step (a velocity of F h/2M at most).
//!
//! Dry friction has the level F while the key slides, against the velocity, and holds a resting key against forces up
//! to F. If the velocity passes zero within a step, friction turns at that instant, not at the end of the step: of the
//! step's velocity gain A and friction p, the part after the turn counts (A + p)/(A - p) of the velocity beyond zero.
//! The path is thus differentiable with respect to its parameters, which their estimation needs.

mod friction;
mod motion;
mod parameter;

use thiserror::Error;

use crate::interrupt;
pub use motion::Motion;
use parameter::Parameter;

/// Longest delay of a force [s].
const DELAY_MAX: f64 = 1.0;
/// Ticks between two polls of an interruption.
const POLL_EVERY: usize = 1024;
/// Steps of work that a tick counts.
const TICK_STEPS: usize = 64;
/// Number of derivatives with respect to forces that are computed together.
const FORCE_COLUMNS: usize = 16;
/// Derivatives below this fraction of their maximum are taken to have died away.
const DIED_AWAY_SHARE: f64 = 1e-7;

/// A part of a key that oscillates on it: a mass on a spring and a damper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Mass [kg].
    pub mass: f64,
    /// Frequency of the mass on its spring, on a key that stands still [Hz].
    pub frequency: f64,
    /// Damping ratio; 1 is critical damping.
    pub ratio: f64,
}

/// The parameters of a key.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyModel {
    /// Mass, without that of the modes [kg].
    pub mass: f64,
    /// Spring to the ground [N/m].
    pub stiffness: f64,
    /// Damper to the ground [N·s/m].
    pub damping: f64,
    /// Constant force towards negative positions [N]. The key rests around -weight/stiffness.
    pub weight: f64,
    /// Level of dry friction while the key slides [N].
    pub dry: f64,
    /// Position at the beginning, where the key stands still [m].
    pub start: f64,
    /// Time from the beginning of a tick until its force acts [s].
    pub delay: f64,
    /// Stiffness of the contact before it slides [N/m]; zero: the contact is rigid.
    pub presliding: f64,
    /// Level of dry friction near velocity zero [N], used if `static_speed` is above zero.
    pub static_dry: f64,
    /// Velocity at which the excess of the level over `dry` has fallen to 1/e [m/s] (Stribeck); zero: the level is
    /// always `dry`.
    pub static_speed: f64,
    /// The parts that swing on the key.
    pub modes: Vec<Mode>,
}

/// Number of parameters of a key without its modes, which come first in a row of parameters.
pub const KEY_PARAMETERS: usize = 10;
/// Number of parameters of a mode.
pub const MODE_PARAMETERS: usize = 3;

/// Why a key cannot be computed.
#[derive(Clone, Copy, Debug, Eq, Error, PartialEq)]
pub enum KeyError {
    /// Too few or too many numbers.
    #[error("a key has 10 parameters, and 3 for each mode")]
    Count,
    /// Inf or nan.
    #[error("every parameter of a key must be a finite number")]
    NotFinite,
    /// A mass, or a frequency of a mode, that is not above zero.
    #[error("the mass of a key, and the mass and frequency of each mode, must be above zero")]
    Mass,
    /// A coefficient that would supply energy.
    #[error("damping, dry friction and presliding stiffness of a key must not be negative")]
    Negative,
    /// A delay below zero, or too long.
    #[error("the delay of a key must be from 0 to 1 s")]
    Delay,
    /// A rate that is not a positive number.
    #[error("the rate must be a positive number of ticks a second")]
    Rate,
    /// No step, or too many.
    #[error("a tick must have 1 to 10,000 steps")]
    Steps,
    /// A resonance that is too fast for the step.
    #[error(
        "a resonance of this key is too fast: it must be below 0.16 of the steps a second, which are usually 44,100"
    )]
    Fast,
}

impl KeyModel {
    /// A key from numbers in this order: mass, stiffness, damping, weight, dry, start, delay, presliding, static_dry,
    /// static_speed, then mass, frequency and ratio of each mode.
    ///
    /// # Errors
    /// [`KeyError`] if the numbers do not describe a key.
    pub fn from_row(row: &[f64]) -> Result<Self, KeyError> {
        if row.len() < KEY_PARAMETERS || !(row.len() - KEY_PARAMETERS).is_multiple_of(MODE_PARAMETERS) {
            return Err(KeyError::Count);
        }
        let mode_from_row = |row: &[f64]| Mode {
            mass: row[0],
            frequency: row[1],
            ratio: row[2],
        };
        let key_model = Self {
            mass: row[0],
            stiffness: row[1],
            damping: row[2],
            weight: row[3],
            dry: row[4],
            start: row[5],
            delay: row[6],
            presliding: row[7],
            static_dry: row[8],
            static_speed: row[9],
            modes: row[KEY_PARAMETERS..]
                .chunks_exact(MODE_PARAMETERS)
                .map(mode_from_row)
                .collect(),
        };
        if !row.iter().all(|number| number.is_finite()) {
            return Err(KeyError::NotFinite);
        }
        key_model.check()
    }

    fn check(self) -> Result<Self, KeyError> {
        let is_valid_mode = |mode: &Mode| mode.mass > 0.0 && mode.frequency > 0.0;
        if self.mass <= 0.0 || !self.modes.iter().all(is_valid_mode) {
            return Err(KeyError::Mass);
        }
        let non_negatives = [
            self.damping,
            self.dry,
            self.presliding,
            self.static_dry,
            self.static_speed,
        ];
        let mode_ratios = self.modes.iter().map(|mode| mode.ratio);
        if non_negatives.into_iter().chain(mode_ratios).any(|number| number < 0.0) {
            return Err(KeyError::Negative);
        }
        if !(0.0..=DELAY_MAX).contains(&self.delay) {
            return Err(KeyError::Delay);
        }
        Ok(self)
    }

    /// Positions [m] at the beginning of every tick under `forces` [N], of which the first acts on a key at rest.
    ///
    /// ```
    /// use ergon_engine::key_model::KeyModel;
    ///
    /// // 400 g on 60 N/m, 1.2 N·s/m and 50 mN of dry friction, pushed by 0.6 N
    /// let key = KeyModel::from_row(&[0.4, 60.0, 1.2, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0])?;
    /// let path = key.path(&[0.6; 4000], 1000.0, None)?;
    /// let end = path[3999];
    /// assert!((end - 0.01).abs() <= 0.05 / 60.0, "it rests where friction holds it: {end}");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`KeyError`] for a rate or steps by which the key cannot be computed.
    pub fn path(&self, forces: &[f64], rate: f64, steps: Option<usize>) -> Result<Vec<f64>, KeyError> {
        let mut key_motion = Motion::<0>::with_columns(self, rate, steps, &[])?;
        let mut positions = Vec::with_capacity(forces.len());
        for (n, &force) in forces.iter().enumerate() {
            if n % POLL_EVERY == 0 {
                interrupt::spend(TICK_STEPS * POLL_EVERY);
            }
            positions.push(key_motion.position());
            key_motion.tick(force, 0.0);
        }
        Ok(positions)
    }

    /// The path, and its derivatives (ticks, columns) with respect to the parameters of these indices, row by row.
    ///
    /// If a parameter is zero and thereby switches a part off (presliding, static_speed), its derivatives are zero.
    ///
    /// # Errors
    /// As [`KeyModel::path`]; [`KeyError::Count`] for a column that does not exist, or more than 32 columns.
    pub fn path_and_jacobian(
        &self,
        forces: &[f64],
        rate: f64,
        steps: Option<usize>,
        columns: &[usize],
    ) -> Result<(Vec<f64>, Vec<f64>), KeyError> {
        match columns.len() {
            0..=4 => self.differentiated::<4>(forces, rate, steps, columns),
            5..=8 => self.differentiated::<8>(forces, rate, steps, columns),
            9..=12 => self.differentiated::<12>(forces, rate, steps, columns),
            13..=16 => self.differentiated::<16>(forces, rate, steps, columns),
            17..=32 => self.differentiated::<32>(forces, rate, steps, columns),
            _ => Err(KeyError::Count),
        }
    }

    /// Derivatives of the path (ticks, columns) with respect to the forces of these ticks, row by row.
    ///
    /// # Errors
    /// As [`KeyModel::path`]; [`KeyError::Count`] for ticks that do not exist or do not rise.
    pub fn force_derivatives(
        &self,
        forces: &[f64],
        rate: f64,
        steps: Option<usize>,
        columns: &[usize],
    ) -> Result<Vec<f64>, KeyError> {
        if columns.iter().any(|&tick| tick >= forces.len()) || !columns.is_sorted() {
            return Err(KeyError::Count);
        }
        let mut derivatives = vec![0.0; forces.len() * columns.len()];
        let mut key_motion = Motion::<0>::with_columns(self, rate, steps, &[])?;
        let mut next_tick = 0;
        for (number, group) in columns.chunks(FORCE_COLUMNS).enumerate() {
            while next_tick < group[0] {
                key_motion.tick(forces[next_tick], 0.0);
                next_tick += 1;
            }
            let last_tick = group[group.len() - 1];
            let parameters: Vec<_> = group.iter().map(|&tick| Parameter::Force(tick)).collect();
            let mut wide_motion = key_motion.widened::<FORCE_COLUMNS>(parameters);
            let mut greatest = 0.0_f64;
            for (n, &force) in forces.iter().enumerate().skip(next_tick) {
                if n % POLL_EVERY == 0 {
                    interrupt::spend(TICK_STEPS * POLL_EVERY);
                }
                let derivative_row = &wide_motion.dx[..group.len()];
                let row_max = derivative_row.iter().fold(0.0_f64, |row_max, dx| row_max.max(dx.abs()));
                greatest = greatest.max(row_max);
                if n > last_tick && greatest > 0.0 && row_max < DIED_AWAY_SHARE * greatest {
                    break;
                }
                let row_start = n * columns.len() + number * FORCE_COLUMNS;
                derivatives[row_start..row_start + group.len()].copy_from_slice(derivative_row);
                wide_motion.tick(force, 0.0);
            }
        }
        Ok(derivatives)
    }

    fn differentiated<const N: usize>(
        &self,
        forces: &[f64],
        rate: f64,
        steps: Option<usize>,
        columns: &[usize],
    ) -> Result<(Vec<f64>, Vec<f64>), KeyError> {
        let mut key_motion = Motion::<N>::with_columns(self, rate, steps, columns)?;
        let mut positions = Vec::with_capacity(forces.len());
        let mut jacobian = Vec::with_capacity(forces.len() * columns.len());
        for (n, &force) in forces.iter().enumerate() {
            if n % POLL_EVERY == 0 {
                interrupt::spend(TICK_STEPS * POLL_EVERY);
            }
            positions.push(key_motion.position());
            jacobian.extend_from_slice(&key_motion.dx[..columns.len()]);
            key_motion.tick(force, 0.0);
        }
        Ok((positions, jacobian))
    }
}

#[cfg(test)]
mod tests;
