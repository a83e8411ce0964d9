//! CEL: a mass tied to the ground by a spring and a damper, discretised exactly.
//!
//! m ẍ + z ẋ + k (x - rest) = 0 has a closed solution. The scheme x[n+1] = (2-κ-ζ) x[n] - (1-ζ) x[n-1] + F[n]/M with M
//! = m/T² gives exactly the samples of this solution if κ and ζ are computed from its poles. T is the step, θ the angle
//! and r the decay of one step.

mod response;
#[cfg(test)]
mod tests;

pub(crate) use response::{Response, recurrence};

use std::f64::consts::{LN_10, PI, TAU};

use crate::maths::{asin, cos, exp, expm1, log1p, sin, sqrt};
use crate::units::Rate;

/// Decay rate σ [1/s] for a decay of 60 dB in `t60` [s]; `None`: no decay.
pub fn decay(t60: Option<f64>) -> f64 {
    t60.map_or(0.0, |t60| 3.0 * LN_10 / t60)
}

/// A motion that decays by more than e^-BACKWARD_DECAY_MAX is not extrapolated backwards by its own formula.
const BACKWARD_DECAY_MAX: f64 = 25.0;
/// The difference of two products that are nearly equal loses digits: with poles at least this far apart [1/step], no
/// more than four of sixteen.
const FACTORS_SPREAD_MIN: f64 = 1e-4;
/// The sine of ωT divides where two samples give the motion between them. From here on the quotient keeps ten digits of
/// sixteen, and a frequency that is moved to it moves by no more than 2e-7 of the rate.
const SAMPLE_SINE_MIN: f64 = 1e-6;

/// A CEL's parameters in the discrete scheme: κ = K/M and ζ = Z/M.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellRatios {
    /// K/M
    pub kappa: f64,
    /// Z/M
    pub zeta: f64,
}

impl CellRatios {
    /// The ratios for which the poles are r e^{±iθ}, with r = e^-s.
    pub(crate) fn from_poles(s: f64, theta: f64) -> Self {
        let (radius_loss, half_sine) = (-expm1(-s), sin(0.5 * theta));
        Self {
            kappa: radius_loss * radius_loss + 4.0 * exp(-s) * (half_sine * half_sine),
            zeta: -expm1(-2.0 * s),
        }
    }

    /// Damped frequency [Hz] and T60 [s] (infinite without loss); `None` if the poles are not complex.
    pub fn pitch(self, rate: Rate) -> Option<(f64, f64)> {
        // 1-ζ is r²; if Z removes all velocity in one step, r is 0 and there is no oscillation.
        let pole_radius = sqrt(1.0 - self.zeta);
        let radius_loss = self.zeta / (1.0 + pole_radius);
        let half_sine_squared = (self.kappa - radius_loss * radius_loss) / (4.0 * pole_radius);
        if !(half_sine_squared > 0.0 && half_sine_squared < 1.0) {
            return None;
        }
        let frequency = 2.0 * asin(sqrt(half_sine_squared)) / TAU * rate.hertz();
        Some((frequency, 6.0 * LN_10 * rate.step() / -log1p(-self.zeta)))
    }
}

/// κ and ζ of a CEL with damped frequency `f` [Hz] and decay `t60` [s; none: no decay], exactly.
///
/// `f` must be below half the rate; above it, the poles would be those of its alias.
///
/// ```
/// use ergon_engine::{Rate, cell};
///
/// let rate = Rate::new(44_100.0)?;
/// let ratios = cell::tune(440.0, Some(2.0), rate);
/// let (f, t60) = ratios.pitch(rate).expect("it oscillates");
/// assert!((f - 440.0).abs() < 1e-9 && (t60 - 2.0).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn tune(f: f64, t60: Option<f64>, rate: Rate) -> CellRatios {
    let time_step = rate.step();
    CellRatios::from_poles(decay(t60) * time_step, TAU * f * time_step)
}

/// `omega` [rad/s], moved down if it is so near a multiple of half the rate that two samples of the motion do not
/// determine what it does between them.
pub(crate) fn resolvable_omega(omega: f64, rate: Rate) -> f64 {
    let half_turns = (omega * rate.step() / PI).round();
    let nearest_multiple = half_turns * PI;
    if half_turns == 0.0 || (omega * rate.step() - nearest_multiple).abs() >= SAMPLE_SINE_MIN {
        return omega;
    }
    (nearest_multiple - SAMPLE_SINE_MIN) * rate.hertz()
}

/// A continuous CEL.
///
/// ```
/// use ergon_engine::cell::Cell;
///
/// let cell = Cell::tuned(0.002, 440.0, Some(1.0)); // 2 g, 440 Hz, 1 s
/// let same = Cell::new(0.002, cell.stiffness(), cell.viscosity());
/// assert!((same.frequency() - 440.0).abs() < 1e-9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    mass: f64,
    /// σ = z/2m [1/s]
    sigma: f64,
    poles: Poles,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Poles {
    /// Poles -σ ± iω: ω [rad/s], 0 at critical damping.
    Oscillating { omega: f64 },
    /// Poles -slow and -fast [1/s]; 0 <= slow < fast.
    Overdamped { slow: f64, fast: f64 },
}

impl Cell {
    /// From mass `m` [kg] > 0, stiffness `k` [N/m] >= 0 and viscosity `z` [N·s/m] >= 0.
    pub fn new(m: f64, k: f64, z: f64) -> Self {
        let sigma = 0.5 * z / m;
        let squared = k / m;
        let overdamping = sigma * sigma - squared;
        let poles = if overdamping <= 0.0 {
            Poles::Oscillating {
                omega: sqrt(-overdamping),
            }
        } else {
            let fast = sigma + sqrt(overdamping);
            // Not σ - √…: that difference loses its digits if the spring is weak.
            Poles::Overdamped {
                slow: squared / fast,
                fast,
            }
        };
        Self { mass: m, sigma, poles }
    }

    /// From mass `m` [kg], damped frequency `f` [Hz] and decay `t60` [s; none: no decay].
    pub fn tuned(m: f64, f: f64, t60: Option<f64>) -> Self {
        Self {
            mass: m,
            sigma: decay(t60),
            poles: Poles::Oscillating { omega: TAU * f },
        }
    }

    /// Damped frequency [Hz]; 0 if damping is above critical.
    pub fn frequency(&self) -> f64 {
        match self.poles {
            Poles::Oscillating { omega } => omega / TAU,
            Poles::Overdamped { .. } => 0.0,
        }
    }

    /// Stiffness k [N/m].
    pub fn stiffness(&self) -> f64 {
        self.mass
            * match self.poles {
                Poles::Oscillating { omega } => omega * omega + self.sigma * self.sigma,
                Poles::Overdamped { slow, fast } => slow * fast,
            }
    }

    /// Viscosity z [N·s/m].
    pub fn viscosity(&self) -> f64 {
        2.0 * self.mass * self.sigma
    }

    /// This cell with a frequency whose samples at `rate` determine the motion between them: [`resolvable_omega`].
    pub(crate) fn resolvable_at(self, rate: Rate) -> Self {
        match self.poles {
            Poles::Oscillating { omega } => Self {
                poles: Poles::Oscillating {
                    omega: resolvable_omega(omega, rate),
                },
                ..self
            },
            Poles::Overdamped { .. } => self,
        }
    }

    /// κ and ζ whose poles at `rate` are exactly those of this cell, for any damping.
    ///
    /// Without stiffness κ is 0 and ζ = 1 - e^{-zT/m}; without viscosity ζ is 0.
    pub fn ratios(&self, rate: Rate) -> CellRatios {
        let time_step = rate.step();
        match self.poles {
            Poles::Oscillating { omega } => CellRatios::from_poles(self.sigma * time_step, omega * time_step),
            // κ is (1-λ₁)(1-λ₂), ζ is 1-λ₁λ₂.
            Poles::Overdamped { slow, fast } => CellRatios {
                kappa: expm1(-slow * time_step) * expm1(-fast * time_step),
                zeta: -expm1(-2.0 * self.sigma * time_step),
            },
        }
    }

    /// The cell of mass `m` [kg] that has these ratios at `rate`; `None` if no continuous motion has such samples.
    pub(crate) fn from_ratios(m: f64, CellRatios { kappa, zeta }: CellRatios, rate: Rate) -> Option<Self> {
        let (sample_rate, pole_radius) = (rate.hertz(), sqrt(1.0 - zeta));
        let radius_loss = zeta / (1.0 + pole_radius);
        let half_sine_squared = (kappa - radius_loss * radius_loss) / (4.0 * pole_radius);
        let sigma = -0.5 * log1p(-zeta) * sample_rate;
        let poles = if half_sine_squared >= 0.0 {
            let omega = 2.0 * asin(sqrt(half_sine_squared)) * sample_rate;
            Poles::Oscillating { omega }
        } else {
            // λ = r·e^±d; 1 − λ of both poles, without cancellation.
            let pole_spread = sqrt(-half_sine_squared * (1.0 - half_sine_squared));
            let slow = radius_loss + 2.0 * pole_radius * half_sine_squared - 2.0 * pole_radius * pole_spread;
            let fast = radius_loss + 2.0 * pole_radius * half_sine_squared + 2.0 * pole_radius * pole_spread;
            let [slow, fast] = [slow, fast].map(|gone| -log1p(-gone) * sample_rate);
            Poles::Overdamped { slow, fast }
        };
        let is_valid = match poles {
            Poles::Oscillating { omega } => sigma.is_finite() && omega.is_finite(),
            Poles::Overdamped { slow, fast } => slow.is_finite() && fast.is_finite() && slow < fast,
        };
        is_valid.then_some(Self { mass: m, sigma, poles })
    }

    /// x(0) - x(-T) [m] of the free motion with position `x` [m] and velocity `v` [m/s] at t = 0, and the rest position
    /// `rest` [m].
    ///
    /// If damping removes all velocity within one step (1-ζ rounds to 0), the past has no effect, and the result is
    /// T·v.
    pub fn last_step(&self, x: f64, v: f64, rest: f64, rate: Rate) -> f64 {
        /// e^-NEGLIGIBLE_DECAY is less than half the rounding unit.
        const NEGLIGIBLE_DECAY: f64 = 37.0;
        let (y, time_step) = (x - rest, rate.step());
        let s = self.sigma * time_step;
        if 2.0 * s > NEGLIGIBLE_DECAY {
            return time_step * v;
        }
        // y(-T) = e^s (y C - (v + σy) S), with the (hyperbolic) cosine C, and sine over ω S, of one step:
        // `cosine_term` is 1 - e^s C and `sine_term` is e^s S, both computed without cancellation.
        let (cosine_term, sine_term) = match self.poles {
            Poles::Oscillating { omega } => {
                let half_sine = sin(0.5 * omega * time_step);
                let sine_term = if omega > 0.0 {
                    sin(omega * time_step) / omega
                } else {
                    time_step
                };
                (2.0 * exp(s) * (half_sine * half_sine) - expm1(s), exp(s) * sine_term)
            }
            Poles::Overdamped { slow, fast } => {
                let pole_gap = fast - slow;
                let cosine_term = -0.5 * (expm1(fast * time_step) + expm1(slow * time_step));
                (
                    cosine_term,
                    exp(slow * time_step) * expm1(pole_gap * time_step) / pole_gap,
                )
            }
        };
        y * cosine_term + (v + self.sigma * y) * sine_term
    }

    /// Displacement per unit of initial velocity, `t` [s] >= 0 after it: m times the impulse response.
    pub(crate) fn response(&self, t: f64) -> f64 {
        match self.poles {
            Poles::Oscillating { omega } if omega > 0.0 => exp(-self.sigma * t) * sin(omega * t) / omega,
            Poles::Oscillating { .. } => exp(-self.sigma * t) * t,
            Poles::Overdamped { slow, fast } => {
                let pole_gap = fast - slow;
                -exp(-slow * t) * expm1(-pole_gap * t) / pole_gap
            }
        }
    }

    /// Displacement per unit of initial displacement, `t` [s] >= 0 after it is released without velocity.
    pub(crate) fn released(&self, t: f64) -> f64 {
        match self.poles {
            Poles::Oscillating { omega } => exp(-self.sigma * t) * cos(omega * t) + self.sigma * self.response(t),
            Poles::Overdamped { slow, fast } => {
                let pole_gap = fast - slow;
                exp(-slow * t) * (1.0 - slow * expm1(-pole_gap * t) / pole_gap)
            }
        }
    }

    /// Energy [J] of the free motion through two samples, the second a step after the first, relative to the rest
    /// position [m].
    pub(crate) fn energy(&self, [now, next]: [f64; 2], rate: Rate) -> f64 {
        let (released, response) = (self.released(rate.step()), self.response(rate.step()));
        let velocity = (next - released * now) / response;
        0.5 * self.mass * (velocity * velocity) + 0.5 * self.stiffness() * (now * now)
    }

    /// Displacement [m] per impulse [N·s], `t` [s] >= 0 after it.
    pub(crate) fn impulse_response(&self, t: f64) -> f64 {
        self.response(t) / self.mass
    }

    /// The same function extended to times `t` [s] before the impulse. If it decays by more than
    /// e^-BACKWARD_DECAY_MAX over `t`, it is extended as an odd function, since its own continuation would become
    /// too large.
    pub(crate) fn impulse_response_around(&self, t: f64) -> f64 {
        if t < 0.0 && self.pole_magnitude_max() * -t > BACKWARD_DECAY_MAX {
            -self.impulse_response(-t)
        } else {
            self.impulse_response(t)
        }
    }

    /// [`Self::impulse_response_around`] as two products, `impulse_response_around(to - from)` =
    /// later(to)·earlier(from): the factors `[later, earlier]` at a time `t` [s]. Times of a `step` [s] around 0 keep
    /// them all within e^±(BACKWARD_DECAY_MAX/2).
    pub(crate) fn impulse_response_factors(&self, t: f64) -> [[f64; 2]; 2] {
        match self.poles {
            Poles::Oscillating { omega } => {
                let (decay_factor, sine, cosine) = (exp(-self.sigma * t), sin(omega * t), cos(omega * t));
                let amplitude_factor = decay_factor / (self.mass * omega);
                [
                    [amplitude_factor * sine, -amplitude_factor * cosine],
                    [cosine / decay_factor, sine / decay_factor],
                ]
            }
            Poles::Overdamped { slow, fast } => {
                let amplitude_factor = 1.0 / (self.mass * (fast - slow));
                let [slow, fast] = [slow, fast].map(|pole| exp(-pole * t));
                [
                    [amplitude_factor * slow, -amplitude_factor * fast],
                    [1.0 / slow, 1.0 / fast],
                ]
            }
        }
    }

    /// Whether [`Self::impulse_response_factors`] keep the digits of the answer within a step [s].
    pub(crate) fn has_impulse_response_factors(&self, step: f64) -> bool {
        let pole_spread = match self.poles {
            Poles::Oscillating { omega } => omega,
            Poles::Overdamped { slow, fast } => fast - slow,
        };
        pole_spread * step >= FACTORS_SPREAD_MIN && self.pole_magnitude_max() * step <= BACKWARD_DECAY_MAX
    }

    /// Velocity [m/s] per impulse [N·s], right after it.
    pub(crate) fn velocity_jump(&self) -> f64 {
        1.0 / self.mass
    }

    /// The largest |λ| [1/s] of its components e^(λt).
    pub(crate) fn pole_magnitude_max(&self) -> f64 {
        match self.poles {
            Poles::Oscillating { omega } => sqrt(self.sigma * self.sigma + omega * omega),
            Poles::Overdamped { fast, .. } => fast,
        }
    }

    /// Weights of two successive samples, relative to the rest position, that give the free motion at
    /// `frame_fraction` of the step between them.
    pub(crate) fn interpolation(&self, frame_fraction: f64, rate: Rate) -> (f64, f64) {
        let time_step = rate.step();
        let full_step = self.response(time_step);
        let remaining_response = self.response((1.0 - frame_fraction) * time_step) / full_step;
        let elapsed_response = self.response(frame_fraction * time_step) / full_step;
        (
            remaining_response * exp(-2.0 * self.sigma * frame_fraction * time_step),
            elapsed_response,
        )
    }

    /// Forces [N] at samples n and n+1 that replace an impulse [N·s] at (n + α)T, 0 <= α < 1: from sample n+1 on the
    /// scheme gives exactly the samples of the continuous motion.
    ///
    /// ```
    /// use ergon_engine::{Rate, cell::Cell};
    ///
    /// let rate = Rate::new(44_100.0)?;
    /// let cell = Cell::tuned(0.002, 440.0, Some(1.0));
    /// let [now, next] = cell.split(1e-3, 0.25, rate); // a quarter of a sample after n
    /// assert!(now > next && next > 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn split(&self, impulse: f64, frame_fraction: f64, rate: Rate) -> [f64; 2] {
        self.split_at(frame_fraction, rate).forces(impulse)
    }

    /// [`Self::interpolation`] at a fraction of a step, and [`Self::split`] of an impulse of 1 N·s there;
    /// `step_response` is the response after a step.
    pub(crate) fn within_step(&self, frame_fraction: f64, rate: Rate, step_response: f64) -> ((f64, f64), [f64; 2]) {
        let impulse_split = self.split_at(frame_fraction, rate);
        let decay_factor = exp(-2.0 * self.sigma * frame_fraction * rate.step());
        let weights = (
            impulse_split.now / step_response * decay_factor,
            impulse_split.past / step_response,
        );
        (weights, impulse_split.forces(1.0))
    }

    /// The part of [`Self::split`] that depends on the instant only, for many impulses at this instant.
    pub(crate) fn split_at(&self, frame_fraction: f64, rate: Rate) -> ForceSplit {
        let time_step = rate.step();
        let (time_left, time_since_sample) = ((1.0 - frame_fraction) * time_step, frame_fraction * time_step);
        ForceSplit {
            square: time_step * time_step,
            now: self.response(time_left),
            decay: exp(-2.0 * self.sigma * time_left),
            past: self.response(time_since_sample),
        }
    }
}

/// Coefficients that split an impulse at one instant between two samples into forces at both.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ForceSplit {
    /// Square of the step [s²].
    square: f64,
    now: f64,
    decay: f64,
    past: f64,
}

impl ForceSplit {
    /// The forces [N] for an impulse [N·s].
    pub(crate) fn forces(&self, impulse: f64) -> [f64; 2] {
        let scaled_impulse = impulse / self.square;
        [scaled_impulse * self.now, scaled_impulse * self.decay * self.past]
    }
}
