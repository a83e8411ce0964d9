//! A free oscillation: its frequency and damping from a recurrence, its state from two frames, and its state at a later
//! time.

use crate::maths;

/// e^−σt (a cos ωt + b sin ωt) [m], or e^−σt (a + bt) if ω is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oscillation {
    /// ω [rad/s]
    pub omega: f64,
    /// σ [1/s]
    pub sigma: f64,
}

impl Oscillation {
    /// The oscillation of x[n+1] = a·x[n] − b·x[n−1].
    pub(super) fn from_recurrence(a: f64, b: f64, rate: f64) -> Self {
        if b <= 0.0 {
            let log_ratio = if a > 0.0 && a < 1.0 { maths::log(a) } else { 0.0 };
            return Self {
                omega: 0.0,
                sigma: -log_ratio * rate,
            };
        }
        let sigma = -0.5 * maths::log(b) * rate;
        let cosine = 0.5 * a / b.sqrt();
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let omega = if cosine.abs() < 1.0 {
            maths::atan2(sine, cosine) * rate
        } else {
            0.0
        };
        Self { omega, sigma }
    }

    /// The coefficients a and b of its motion from now on; `displacement` [m] is that at present, `displacement_before`
    /// that of `step_seconds` [s] earlier.
    pub fn coefficients(&self, displacement: f64, displacement_before: f64, step_seconds: f64) -> (f64, f64) {
        let step_angle = self.omega * step_seconds;
        let undamped_displacement_before = displacement_before * maths::exp(-self.sigma * step_seconds);
        if self.omega == 0.0 {
            return (
                displacement,
                (displacement - undamped_displacement_before) / step_seconds,
            );
        }
        (
            displacement,
            (displacement * maths::cos(step_angle) - undamped_displacement_before) / maths::sin(step_angle),
        )
    }

    /// The coefficients a and b `t` [s] later; `t` may be negative.
    pub fn coefficients_after(&self, (a, b): (f64, f64), t: f64) -> (f64, f64) {
        let decay_factor = maths::exp(-self.sigma * t);
        if self.omega == 0.0 {
            return (decay_factor * (a + b * t), decay_factor * b);
        }
        let (sine, cosine) = maths::sincos(self.omega * t);
        (
            decay_factor * (a * cosine + b * sine),
            decay_factor * (b * cosine - a * sine),
        )
    }
}
