//! The motion of a real force-feedback key: a CEL with weight, dry friction, modes of its mechanics, and the delay of its
//! forces; with the derivatives of the path with respect to every parameter.
//!
//! M ẍ = F(t - delay) - K x - Z ẋ - weight - dry friction + pull of the modes. A force is held for a tick. A tick is
//! computed in equal steps h, velocities between positions: spring, weight and modes by leapfrog, the damper by the
//! trapezoidal rule, all of second order. Of first order, and small, are two things: a mode's damper takes the key's
//! velocity half a step early, and a resting key that a jump of the force sets off within a step feels friction for the whole
//! step (a velocity of F h/2M at most).
//!
//! Dry friction has the level F while the key slides, against the velocity, and holds a resting key against forces up to
//! F. Where the velocity passes zero within a step, friction turns at that instant, not at the end of the step: of the
//! step's velocity gain A and friction p, the part after the turn counts (A + p)/(A - p) of what lies beyond zero.
//! So the path is differentiable with respect to its parameters, as an estimate of these needs it.

use std::f64::consts::TAU;

use thiserror::Error;

use crate::interrupt;
use crate::maths::{exp, floor};

/// Steps a second where no caller chose how many a tick has.
const FRAME_RATE: f64 = 44_100.0;
/// Steps of a tick at least, where no caller chose.
const STEPS_MIN: usize = 4;
const STEPS_MAX: usize = 10_000;
/// Longest delay of a force [s].
const DELAY_MAX: f64 = 1.0;
/// An explicit oscillator is stable up to ω h = 2; half of it keeps frequencies near what was asked for.
const ANGLE_MAX: f64 = 1.0;
/// Ticks between two looks at whether the computation is to end.
const POLL: usize = 1024;

/// A part of a key that swings on it: a mass on a spring and a damper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Mass [kg].
    pub mass: f64,
    /// Frequency of the mass on its spring, on a key that stands still [Hz].
    pub frequency: f64,
    /// Damping ratio: 1 where it no longer oscillates.
    pub ratio: f64,
}

/// What a key is made of.
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
    /// Time from the beginning of a tick to that of its force [s].
    pub delay: f64,
    /// Stiffness of the contact before it slides [N/m]; zero: it holds rigidly.
    pub presliding: f64,
    /// Level of dry friction near velocity zero [N], where `static_speed` is above zero.
    pub static_dry: f64,
    /// Velocity by which the level has fallen from `static_dry` towards `dry` by 1/e [m/s] (Stribeck); zero: it does not.
    pub static_speed: f64,
    /// What swings on the key.
    pub modes: Vec<Mode>,
}

/// Numbers of a key that are none of its modes, in the order of a row of parameters.
pub const OWN: usize = 10;
/// Numbers of a mode.
pub const OF_MODE: usize = 3;

/// Why a key cannot be computed.
#[derive(Clone, Copy, Debug, Eq, Error, PartialEq)]
pub enum KeyError {
    /// Too few or too many numbers.
    #[error("a key has 10 parameters, and 3 for each mode")]
    Count,
    /// Inf or nan.
    #[error("every parameter of a key must be a finite number")]
    NotFinite,
    /// A mass that nothing moves.
    #[error("the mass of a key, and the mass and frequency of each mode, must be above zero")]
    Mass,
    /// What makes energy.
    #[error("damping, dry friction and presliding stiffness of a key must not be negative")]
    Negative,
    /// Before the force was sent, or long after.
    #[error("the delay of a key must be from 0 to 1 s")]
    Delay,
    /// A rate that is none.
    #[error("the rate must be a positive number of ticks a second")]
    Rate,
    /// No step, or too many.
    #[error("a tick must have 1 to 10,000 steps")]
    Steps,
    /// Too fast for the step.
    #[error(
        "a resonance of this key is too fast: it must be below 0.16 of the steps a second, which are usually 44,100"
    )]
    Fast,
}

impl KeyModel {
    /// A key of numbers in this order: mass, stiffness, damping, weight, dry, start, delay, presliding, static_dry,
    /// static_speed, then mass, frequency and ratio of each mode.
    ///
    /// # Errors
    /// [`KeyError`] where there is no such key.
    pub fn of_row(row: &[f64]) -> Result<Self, KeyError> {
        if row.len() < OWN || !(row.len() - OWN).is_multiple_of(OF_MODE) {
            return Err(KeyError::Count);
        }
        let mode = |row: &[f64]| Mode {
            mass: row[0],
            frequency: row[1],
            ratio: row[2],
        };
        let key = Self {
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
            modes: row[OWN..].chunks_exact(OF_MODE).map(mode).collect(),
        };
        if !row.iter().all(|number| number.is_finite()) {
            return Err(KeyError::NotFinite);
        }
        key.check()
    }

    fn check(self) -> Result<Self, KeyError> {
        let is_mode = |mode: &Mode| mode.mass > 0.0 && mode.frequency > 0.0;
        if self.mass <= 0.0 || !self.modes.iter().all(is_mode) {
            return Err(KeyError::Mass);
        }
        let least = [
            self.damping,
            self.dry,
            self.presliding,
            self.static_dry,
            self.static_speed,
        ];
        let ratios = self.modes.iter().map(|mode| mode.ratio);
        if least.into_iter().chain(ratios).any(|number| number < 0.0) {
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
    /// let key = KeyModel::of_row(&[0.4, 60.0, 1.2, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0])?;
    /// let path = key.path(&[0.6; 4000], 1000.0, None)?;
    /// let end = path[3999];
    /// assert!((end - 0.01).abs() <= 0.05 / 60.0, "it rests where friction holds it: {end}");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`KeyError`] for a rate or steps by which the key cannot be computed.
    pub fn path(
        &self,
        forces: &[f64],
        rate: f64,
        steps: Option<usize>,
    ) -> Result<Vec<f64>, KeyError> {
        let mut motion = Motion::<0>::with_columns(self, rate, steps, &[])?;
        let mut path = Vec::with_capacity(forces.len());
        for (n, &force) in forces.iter().enumerate() {
            if n % POLL == 0 {
                interrupt::poll();
            }
            path.push(motion.position());
            motion.tick(force, 0.0);
        }
        Ok(path)
    }

    /// The path, and its derivatives (ticks, columns) with respect to the parameters of these indices, row by row.
    ///
    /// A parameter that is zero where that leaves a part out (presliding, static_speed) has derivatives of zero.
    ///
    /// # Errors
    /// As [`KeyModel::path`]; [`KeyError::Count`] for a column that there is not, and for more than 32.
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

    fn differentiated<const N: usize>(
        &self,
        forces: &[f64],
        rate: f64,
        steps: Option<usize>,
        columns: &[usize],
    ) -> Result<(Vec<f64>, Vec<f64>), KeyError> {
        let mut motion = Motion::<N>::with_columns(self, rate, steps, columns)?;
        let mut path = Vec::with_capacity(forces.len());
        let mut jacobian = Vec::with_capacity(forces.len() * columns.len());
        for (n, &force) in forces.iter().enumerate() {
            if n % POLL == 0 {
                interrupt::poll();
            }
            path.push(motion.position());
            jacobian.extend_from_slice(&motion.dx[..columns.len()]);
            motion.tick(force, 0.0);
        }
        Ok((path, jacobian))
    }
}

/// What a column of derivatives is with respect to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Parameter {
    Mass,
    Stiffness,
    Damping,
    Weight,
    Dry,
    Start,
    Delay,
    Presliding,
    StaticDry,
    StaticSpeed,
    ModeMass(usize),
    ModeFrequency(usize),
    ModeRatio(usize),
}

impl Parameter {
    fn of(index: usize, n_modes: usize) -> Option<Self> {
        const FIRST: [Parameter; OWN] = [
            Parameter::Mass,
            Parameter::Stiffness,
            Parameter::Damping,
            Parameter::Weight,
            Parameter::Dry,
            Parameter::Start,
            Parameter::Delay,
            Parameter::Presliding,
            Parameter::StaticDry,
            Parameter::StaticSpeed,
        ];
        if let Some(&own) = FIRST.get(index) {
            return Some(own);
        }
        let mode = (index - OWN) / OF_MODE;
        let each = [Self::ModeMass, Self::ModeFrequency, Self::ModeRatio];
        (mode < n_modes).then(|| each[(index - OWN) % OF_MODE](mode))
    }
}

/// A mode in motion, and the derivatives of its motion.
#[derive(Clone, Debug)]
struct Swing<const N: usize> {
    mass: f64,
    /// ω² and 2ζω over what the trapezoidal rule adds, and ω itself.
    stiff: f64,
    damp: f64,
    omega: f64,
    under: f64,
    x: f64,
    v: f64,
    /// Its acceleration on the key's in this step, the other way round.
    gain: f64,
    dx: [f64; N],
    dv: [f64; N],
}

/// A key in motion, one tick after the other; `N` columns of derivatives are computed beside it.
#[derive(Clone, Debug)]
pub struct Motion<const N: usize = 0> {
    key: KeyModel,
    /// Which column is with respect to what.
    columns: Vec<Parameter>,
    steps: usize,
    step: f64,
    /// h/m, Z h/2m, and 1 + that.
    push: f64,
    drag: f64,
    under: f64,
    /// The last forces, the newest last; those before the first are zero.
    sent: Vec<f64>,
    /// Steps of a tick in which the force before still acts.
    late: f64,
    x: f64,
    v: f64,
    /// The part of the next step in which spring and weight act: the velocity begins half a step before the position.
    part: f64,
    /// How far the contact has given way before it slides.
    s: f64,
    dx: [f64; N],
    dv: [f64; N],
    ds: [f64; N],
    modes: Vec<Swing<N>>,
}

impl Motion<0> {
    /// A key at rest at its start.
    ///
    /// # Errors
    /// [`KeyError`] for a rate or steps by which the key cannot be computed.
    pub fn new(key: &KeyModel, rate: f64, steps: Option<usize>) -> Result<Self, KeyError> {
        Self::with_columns(key, rate, steps, &[])
    }
}

/// What dry friction does in a step, and how that depends on what moves.
struct Friction {
    /// Level, its derivative with respect to the velocity, and what `static_dry` has in it.
    level: f64,
    slope: f64,
    share: f64,
}

/// The velocity after a step, and its derivatives with respect to the velocity before, the gain and friction's bound.
struct Turned {
    v: f64,
    by_v: f64,
    by_gain: f64,
    by_bound: f64,
}

impl Turned {
    const HELD: Self = Self {
        v: 0.0,
        by_v: 0.0,
        by_gain: 0.0,
        by_bound: 0.0,
    };

    /// Velocity v that gains `gain` and that dry friction takes at most `bound` from.
    fn of(v: f64, gain: f64, bound: f64) -> Self {
        let sign = if v != 0.0 {
            v.signum()
        } else if gain.abs() > bound || bound == 0.0 {
            gain.signum()
        } else {
            return Self::HELD;
        };
        let to = v + gain - sign * bound;
        if sign * to >= 0.0 || bound == 0.0 {
            return Self {
                v: to,
                by_v: 1.0,
                by_gain: 1.0,
                by_bound: -sign,
            };
        }
        let (before, after) = (gain - sign * bound, gain + sign * bound);
        if sign * after >= 0.0 {
            return Self::HELD; // it comes to rest, and friction holds it
        }
        let ratio = after / before;
        let spread = to / (before * before);
        Self {
            v: to * ratio,
            by_v: ratio,
            by_gain: ratio + spread * (before - after),
            by_bound: sign * (spread * (before + after) - ratio),
        }
    }
}

impl<const N: usize> Motion<N> {
    fn with_columns(
        key: &KeyModel,
        rate: f64,
        steps: Option<usize>,
        columns: &[usize],
    ) -> Result<Self, KeyError> {
        if !(rate.is_finite() && rate > 0.0) {
            return Err(KeyError::Rate);
        }
        let usual = floor(FRAME_RATE / rate + 0.5) as usize;
        let steps = steps.unwrap_or(usual.max(STEPS_MIN));
        if steps == 0 || steps > STEPS_MAX {
            return Err(KeyError::Steps);
        }
        let columns: Option<Vec<_>> = columns
            .iter()
            .map(|&index| Parameter::of(index, key.modes.len()))
            .collect();
        let columns = columns.ok_or(KeyError::Count)?;
        let step = 1.0 / (rate * steps as f64);
        let (push, drag) = (step / key.mass, 0.5 * key.damping * step / key.mass);
        let stiffest = key.stiffness.abs().max(key.presliding) * step * push;
        let fastest = key.modes.iter().map(|mode| TAU * mode.frequency * step);
        if stiffest > ANGLE_MAX * ANGLE_MAX || fastest.fold(0.0, f64::max) > ANGLE_MAX {
            return Err(KeyError::Fast);
        }
        // The velocity is half a step behind the position, so a force would act half a step early.
        let shift = (key.delay + 0.5 * step) * rate;
        let whole = floor(shift);
        let mut dx = [0.0; N];
        if let Some(column) = columns.iter().position(|&to| to == Parameter::Start) {
            dx[column] = 1.0;
        }
        let swing = |mode: &Mode| {
            let omega = TAU * mode.frequency;
            let damp = 2.0 * mode.ratio * omega;
            Swing {
                mass: mode.mass,
                stiff: omega * omega,
                damp,
                omega,
                under: 1.0 + 0.5 * damp * step,
                x: key.start,
                v: 0.0,
                gain: 0.0,
                dx,
                dv: [0.0; N],
            }
        };
        Ok(Self {
            columns,
            steps,
            step,
            push,
            drag,
            under: 1.0 + drag,
            sent: vec![0.0; whole as usize + 2],
            late: (shift - whole) * steps as f64,
            x: key.start,
            v: 0.0,
            part: 0.5,
            s: 0.0,
            dx,
            dv: [0.0; N],
            ds: [0.0; N],
            modes: key.modes.iter().map(swing).collect(),
            key: key.clone(),
        })
    }

    /// Where the key is [m].
    pub fn position(&self) -> f64 {
        self.x
    }

    /// Put the key somewhere, at rest: an end of its travel has stopped it.
    pub fn stop_at(&mut self, x: f64) {
        (self.x, self.v) = (x, 0.0);
    }

    /// One tick with a force that acts after the delay, and one that acts at once [N].
    pub fn tick(&mut self, force: f64, direct: f64) {
        self.sent.remove(0);
        self.sent.push(force);
        let (before, now) = (self.sent[0], self.sent[1]);
        for step in 0..self.steps {
            let rest = self.late - step as f64; // of the force before, in steps
            if rest >= 1.0 {
                self.step(before + direct, 0.0);
            } else if rest < 0.0 {
                self.step(now + direct, 0.0);
            } else {
                let slope = (before - now) / self.step;
                self.step(rest * before + (1.0 - rest) * now + direct, slope);
            }
        }
    }

    fn friction(&self) -> Friction {
        let key = &self.key;
        if key.static_speed == 0.0 {
            return Friction {
                level: key.dry,
                slope: 0.0,
                share: 0.0,
            };
        }
        let ratio = self.v / key.static_speed;
        let share = exp(-ratio * ratio);
        let over = (key.static_dry - key.dry) * share;
        Friction {
            level: key.dry + over,
            slope: -2.0 * over * ratio / key.static_speed,
            share,
        }
    }

    /// One step with this force, of which `slope` is the derivative with respect to the delay.
    fn step(&mut self, force: f64, slope: f64) {
        let (h, x, v) = (self.step, self.x, self.v);
        let mut pull = 0.0;
        for mode in &mut self.modes {
            mode.gain = (mode.stiff * (mode.x - x) + mode.damp * (mode.v - v)) / mode.under;
            pull += mode.mass * mode.gain;
        }
        let friction = self.friction();
        let contact = Contact::of(&self.key, &friction, self.s, v, h);
        let key = &self.key;
        let held = key.stiffness * x + key.weight;
        let total = force - self.part * held + pull - key.presliding * contact.s;
        let gain = (self.push * total - 2.0 * self.drag * v) / self.under;
        let per_level = if key.presliding > 0.0 {
            0.0
        } else {
            self.push / self.under
        };
        let bound = friction.level * per_level;
        let turned = Turned::of(v, gain, bound);
        if N > 0 {
            let of = Step {
                slope,
                gain,
                bound,
                per_level,
                friction,
                contact: &contact,
                turned: &turned,
            };
            self.move_columns(&of);
        }
        self.part = 1.0;
        self.s = contact.s;
        self.v = turned.v;
        self.x += h * self.v;
        for mode in &mut self.modes {
            mode.v -= h * mode.gain;
            mode.x += h * mode.v;
        }
    }
}

/// The contact before it slides: s' = v - σ|v| s/F, implicit in s, so that σ|s| never exceeds the level F.
struct Contact {
    s: f64,
    by_s: f64,
    by_v: f64,
    by_level: f64,
    by_presliding: f64,
}

impl Contact {
    fn of(key: &KeyModel, friction: &Friction, s: f64, v: f64, h: f64) -> Self {
        let none = Self {
            s: 0.0,
            by_s: 0.0,
            by_v: 0.0,
            by_level: 0.0,
            by_presliding: 0.0,
        };
        if key.presliding == 0.0 || friction.level <= 0.0 {
            return none;
        }
        let wear = h * v.abs() / friction.level;
        let under = 1.0 + key.presliding * wear;
        let to = (s + h * v) / under;
        let by_level = to * key.presliding * wear / (friction.level * under);
        let by_speed = if v == 0.0 {
            0.0
        } else {
            v.signum() * h * key.presliding / friction.level
        };
        Self {
            s: to,
            by_s: 1.0 / under,
            by_v: (h - to * by_speed) / under + by_level * friction.slope,
            by_level,
            by_presliding: -to * wear / under,
        }
    }
}

/// What the derivatives of a step need of it.
struct Step<'a> {
    slope: f64,
    gain: f64,
    bound: f64,
    per_level: f64,
    friction: Friction,
    contact: &'a Contact,
    turned: &'a Turned,
}

impl<const N: usize> Motion<N> {
    /// The derivatives of a step: what those of the state become, then what each parameter adds in its own column.
    fn move_columns(&mut self, of: &Step<'_>) {
        let (h, contact, turned) = (self.step, of.contact, of.turned);
        let (stiffness, presliding) = (self.part * self.key.stiffness, self.key.presliding);
        let per_force = self.push / self.under;
        let by_force = turned.by_gain * per_force;
        let by_v = turned.by_v - turned.by_gain * 2.0 * self.drag / self.under
            + turned.by_bound * of.per_level * of.friction.slope;
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
                let gain = (mode.stiff * dx + mode.damp * dv) / mode.under;
                *force += mode.mass * gain;
                mode.dv[column] -= h * gain;
            }
        }
        for (dv, force) in self.dv.iter_mut().zip(&force) {
            *dv = by_v * *dv + by_force * force;
        }
        for column in 0..self.columns.len() {
            let added = self.added(self.columns[column], column, of);
            self.dv[column] += by_force * added.force
                + turned.by_gain * added.gain
                + turned.by_bound * added.bound;
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

    /// What a parameter adds to the derivatives in its own column, by itself.
    fn added(&mut self, parameter: Parameter, column: usize, of: &Step<'_>) -> Added {
        let key = &self.key;
        let half = 0.5 * self.push / self.under; // of 1 + Z h/2m by Z, relative
        let none = Added::default();
        let level = |by: f64| Added {
            bound: of.per_level * by,
            level: by,
            ..none
        };
        let by_mode = |mode: &Swing<N>, gain: f64| Added {
            force: mode.mass * gain,
            swing: gain,
            ..none
        };
        let added = match parameter {
            Parameter::Start => none,
            Parameter::Mass => {
                let share = -1.0 / (key.mass * self.under);
                Added {
                    gain: share * of.gain,
                    bound: share * of.bound,
                    ..none
                }
            }
            Parameter::Stiffness => Added {
                force: -self.part * self.x,
                ..none
            },
            Parameter::Damping => Added {
                gain: -half * (2.0 * self.v + of.gain),
                bound: -half * of.bound,
                ..none
            },
            Parameter::Weight => Added {
                force: -self.part,
                ..none
            },
            Parameter::Delay => Added {
                force: of.slope,
                ..none
            },
            Parameter::Dry => level(1.0 - of.friction.share),
            Parameter::StaticDry => level(of.friction.share),
            Parameter::StaticSpeed if key.static_speed == 0.0 => none,
            Parameter::StaticSpeed => level(-of.friction.slope * self.v / key.static_speed),
            Parameter::Presliding => Added {
                force: -of.contact.s,
                contact: of.contact.by_presliding,
                ..none
            },
            Parameter::ModeMass(index) => Added {
                force: self.modes[index].gain,
                ..none
            },
            Parameter::ModeFrequency(index) => {
                let mode = &self.modes[index];
                let (stiff, damp) = (2.0 * mode.stiff, mode.damp);
                let gain = (stiff * (mode.x - self.x) + damp * (mode.v - self.v)
                    - 0.5 * self.step * damp * mode.gain)
                    / (mode.under * mode.omega / TAU);
                by_mode(mode, gain)
            }
            Parameter::ModeRatio(index) => {
                let mode = &self.modes[index];
                let over = 2.0 * (mode.v - self.v) - self.step * mode.gain;
                by_mode(mode, mode.omega * over / mode.under)
            }
        };
        if let Parameter::ModeFrequency(index) | Parameter::ModeRatio(index) = parameter {
            self.modes[index].dv[column] -= self.step * added.swing;
        }
        let ds = added.contact + of.contact.by_level * added.level;
        self.ds[column] += ds;
        Added {
            force: added.force - self.key.presliding * ds,
            ..added
        }
    }
}

/// What a parameter changes in a step: force, gain, friction's bound and level, the contact, a mode's gain.
#[derive(Clone, Copy, Default)]
struct Added {
    force: f64,
    gain: f64,
    bound: f64,
    level: f64,
    contact: f64,
    swing: f64,
}

#[cfg(test)]
mod tests;
