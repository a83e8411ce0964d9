//! Friction with memory by bristles that bend (Canudas de Wit, Olsson, Åström & Lischinsky 1995; Dahl 1968 if only σ0
//! and a level are given).

use crate::maths::{exp, expm1};

/// Lower bound of the level of friction [N]; it avoids a division by 0.
const LEVEL_MIN: f64 = 1e-12;
/// The maximum of 2·u·exp(−u), 2/e: the steepest decrease of the level over the logarithm of the speed, as a fraction
/// of Fs − Fc.
const STEEPEST_FALL: f64 = 0.735_758_882_342_884_7;

/// A friction of bristles bent by z: f = σ0·z + σ1·ż + σ2·v, ż = v − σ0·|v|·z/g(v), g(v) = Fc + (Fs −
/// Fc)·exp(−(v/vs)²).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bristle {
    /// σ0: stiffness of the bristles [N/m].
    pub stiffness: f64,
    /// σ1: damping of the bristles [N·s/m].
    pub damping: f64,
    /// σ2: viscosity between the two surfaces [N·s/m].
    pub viscosity: f64,
    /// Fc: friction in fast sliding [N].
    pub level: f64,
    /// Fs: friction in the slowest sliding [N].
    pub static_level: f64,
    /// vs: speed at which friction has fallen from Fs by 63 % of Fs − Fc [m/s].
    pub speed: f64,
}

impl Bristle {
    /// The same with another stiffness and another level; Fs keeps its ratio to Fc.
    pub(crate) fn with_stiffness_and_level(&self, stiffness: f64, level: f64) -> Self {
        Self {
            stiffness,
            level,
            static_level: self.static_level * (level / self.level),
            ..*self
        }
    }

    /// Friction of steady sliding at `v`, without viscosity [N].
    fn steady_friction(&self, v: f64) -> f64 {
        let u = v / self.speed;
        let steady_level = self.level + (self.static_level - self.level) * exp(-u * u);
        steady_level.max(LEVEL_MIN)
    }

    /// Fraction of the bend that sliding at `v` removes per second [1/s].
    pub(crate) fn relaxation_rate(&self, v: f64) -> f64 {
        self.stiffness * v.abs() / self.steady_friction(v)
    }

    /// The relaxation per metre of sliding at `v`, and its slope over the speed; at rest, where the relaxation has a
    /// kink, the slope is 0.
    pub(crate) fn relaxation_and_slope(&self, v: f64) -> (f64, f64) {
        let steady_level = self.steady_friction(v);
        let relaxation = self.stiffness * v.abs() / steady_level;
        let level_slope = -2.0 * (v / self.speed) * (steady_level - self.level) / self.speed;
        let speed_sign = if v == 0.0 { 0.0 } else { v.signum() };
        (
            relaxation,
            (self.stiffness * speed_sign - relaxation * level_slope) / steady_level,
        )
    }

    /// Force [N] of bristles bent by `z` [m] whose ends separate at `v` [m/s].
    pub(crate) fn force(&self, z: f64, v: f64) -> f64 {
        self.force_at_relaxation(z, v, self.relaxation_rate(v))
    }

    /// The same, with a known relaxation rate at `v`.
    pub(crate) fn force_at_relaxation(&self, z: f64, v: f64, relaxation: f64) -> f64 {
        let bristle_rate = v - relaxation * z;
        self.stiffness * z + self.damping * bristle_rate + self.viscosity * v
    }

    /// The exact bend after `h` seconds at constant `v`.
    pub(crate) fn slide(&self, z: f64, v: f64, h: f64) -> f64 {
        let relaxation_exponent = self.relaxation_rate(v) * h;
        let lost_share = -expm1(-relaxation_exponent);
        let mean_decay = if relaxation_exponent > 0.0 {
            lost_share / relaxation_exponent
        } else {
            1.0
        };
        z - z * lost_share + v * h * mean_decay
    }

    /// The bend halfway through `h` seconds at `v` [m], by the implicit midpoint rule.
    pub(crate) fn midpoint_deflection(&self, z: f64, v: f64, h: f64) -> f64 {
        (z + 0.5 * h * v) / (1.0 + 0.5 * h * self.relaxation_rate(v))
    }

    /// Energy of the bend [J].
    pub(crate) fn energy(&self, z: f64) -> f64 {
        0.5 * self.stiffness * z * z
    }

    /// Damping of bristles at rest [N·s/m].
    pub(crate) fn damping_at_rest(&self) -> f64 {
        self.damping + self.viscosity
    }

    /// Largest slope of the force over the speed [N·s/m]. It occurs when bristles that are bent one way are drawn the
    /// other way.
    pub(crate) fn steepest_damping(&self) -> f64 {
        let level_ratio = self.static_level / self.level.max(LEVEL_MIN);
        self.damping * (1.0 + level_ratio * (1.0 + STEEPEST_FALL * (level_ratio - 1.0).max(0.0))) + self.viscosity
    }

    /// Smallest σ2 at which the link is passive: σ1·(Fs − Fc)/Fc (Barabanov & Ortega 2000).
    ///
    /// ```
    /// use ergon_engine::network::Bristle;
    ///
    /// let dahl = Bristle {
    ///     stiffness: 1e5, damping: 0.0, viscosity: 0.0, level: 1.0, static_level: 1.0, speed: 1e-3,
    /// };
    /// assert_eq!(dahl.passive_viscosity(), 0.0);
    /// let lugre = Bristle { damping: 2.0, static_level: 1.5, ..dahl };
    /// assert_eq!(lugre.passive_viscosity(), 1.0);
    /// ```
    pub fn passive_viscosity(&self) -> f64 {
        self.damping * (self.static_level - self.level) / self.level
    }

    /// Whether it never gives energy.
    pub(crate) fn is_passive(&self) -> bool {
        self.viscosity >= self.passive_viscosity()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOW: Bristle = Bristle {
        stiffness: 1e5,
        damping: 0.5,
        viscosity: 0.3,
        level: 1.0,
        static_level: 1.5,
        speed: 0.02,
    };

    #[test]
    fn steady_slide_has_its_friction_level() {
        for v in [-1.0, -0.01, 1e-4, 0.3] {
            let z = BOW.slide(0.0, v, 10.0);
            let steady_level = BOW.steady_friction(v).copysign(v);
            assert!(
                (BOW.stiffness * z - steady_level).abs() < 1e-9 * steady_level.abs(),
                "{v}"
            );
            assert!((BOW.force(z, v) - steady_level - BOW.viscosity * v).abs() < 1e-9, "{v}");
        }
        assert_eq!(BOW.slide(1e-6, 0.0, 1.0), 1e-6); // at rest it stays bent
    }

    #[test]
    fn steepest_damping_bounds_all_slopes() {
        let steepest = BOW.steepest_damping();
        let static_bend = BOW.static_level / BOW.stiffness;
        for i in -4000..4000 {
            let (v, z) = (f64::from(i) * 2e-5, if i % 2 == 0 { static_bend } else { -static_bend });
            let force_slope = (BOW.force(z, v + 1e-9) - BOW.force(z, v - 1e-9)) / 2e-9;
            assert!(
                force_slope <= steepest * (1.0 + 1e-6),
                "{v}: {force_slope} above {steepest}"
            );
        }
    }

    #[test]
    fn wear_slope_equals_differences() {
        for v in [-0.5, -0.02, -1e-3, 1e-4, 0.01, 0.03] {
            let speed_step = 1e-7 * v;
            let checked_slope =
                (BOW.relaxation_rate(v + speed_step) - BOW.relaxation_rate(v - speed_step)) / (2.0 * speed_step);
            let (relaxation, wear_slope) = BOW.relaxation_and_slope(v);
            assert_eq!(relaxation, BOW.relaxation_rate(v));
            assert!(
                (wear_slope - checked_slope).abs() < 1e-6 * checked_slope.abs(),
                "{v}: {wear_slope} {checked_slope}"
            );
        }
        assert_eq!(BOW.relaxation_and_slope(0.0), (0.0, 0.0));
        // Bristles whose stiffness is led to 0 do not wear; the slowest motion has a finite slope.
        assert_eq!(
            BOW.with_stiffness_and_level(0.0, 1.0).relaxation_and_slope(0.3),
            (0.0, 0.0)
        );
        let (_, checked_slope) = BOW.relaxation_and_slope(1e-310);
        assert!((checked_slope - BOW.stiffness / BOW.static_level).abs() < 1e-9 * checked_slope);
    }

    /// Bristles that slow sliding bent to Fs spring back when sliding goes on at a speed at which only Fc holds.
    #[test]
    fn bristle_with_enough_viscosity_creates_no_energy() {
        let least_loss = |bristle: &Bristle| {
            let (v, h) = (0.2, 1e-8);
            let start_bend = bristle.static_level / bristle.stiffness;
            let (mut z, mut work_done, mut least_margin) = (start_bend, 0.0, 0.0_f64);
            for _ in 0..20_000 {
                work_done += bristle.force(bristle.midpoint_deflection(z, v, h), v) * v * h;
                z = bristle.slide(z, v, h);
                least_margin = least_margin.min(work_done - (bristle.energy(z) - bristle.energy(start_bend)));
            }
            least_margin
        };
        let damped_only = Bristle {
            damping: 50.0,
            viscosity: 0.0,
            ..BOW
        };
        let passive = Bristle {
            viscosity: damped_only.passive_viscosity(),
            ..damped_only
        };
        assert!(least_loss(&passive) > -1e-12);
        assert!(least_loss(&damped_only) < -1e-6);
    }
}
