//! Dry friction within a step: its level, and reversals of a velocity. `kernel/exact/friction` computes its forces.

use crate::maths::exp;

/// Smallest level by which others are divided, so that ratios stay finite [N].
const LEVEL_MIN: f64 = 1e-300;
/// Largest share of the range of a falling level by which it may change in a step.
const CHANGE_MAX: f64 = 0.25;

/// Dry friction: a force F against the velocity while the two ends slide, and of up to F against whatever would make
/// them slide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dry {
    /// F: level at fast sliding [N].
    pub level: f64,
    /// Level near rest [N].
    pub static_level: f64,
    /// Speed at which the level has fallen from `static_level` by 63 % of the way to `level` [m/s] (Stribeck).
    pub speed: f64,
}

impl Dry {
    /// The same with another level; the level near rest keeps its ratio to it.
    pub(crate) fn with(&self, level: f64) -> Self {
        Self {
            level,
            static_level: self.static_level * (level / self.level.max(LEVEL_MIN)),
            ..*self
        }
    }

    /// Whether the level depends on the speed.
    pub(crate) fn falls(&self) -> bool {
        self.static_level != self.level
    }

    /// How the level changes with the velocity [N·s/m].
    pub(crate) fn slope_at(&self, v: f64) -> f64 {
        if !self.falls() {
            return 0.0;
        }
        let speed_ratio = v / self.speed;
        -2.0 * speed_ratio / self.speed * (self.static_level - self.level) * exp(-speed_ratio * speed_ratio)
    }

    /// Number of steps of a frame in which a level that falls with the velocity changes little, if a force of 1 N over
    /// the frame changes the velocity by `response` [m/s]: it lets a slide grow exponentially. The level falls most
    /// steeply at `speed`/√2.
    pub(crate) fn steps(&self, response: f64) -> f64 {
        if !self.falls() {
            return 1.0;
        }
        let level_range = (self.static_level - self.level).abs();
        let steepest = (2.0 * exp(-1.0)).sqrt() * level_range / self.speed;
        (steepest * response / CHANGE_MAX).max(1.0)
    }

    /// The level at a velocity [m/s].
    pub(crate) fn level_at(&self, v: f64) -> f64 {
        if !self.falls() {
            return self.level;
        }
        let speed_ratio = v / self.speed;
        self.level + (self.static_level - self.level) * exp(-speed_ratio * speed_ratio)
    }
}

/// The velocity after a step, and its derivatives with respect to the velocity before, the increment, and the bound of
/// friction.
pub(crate) struct Turned {
    pub(crate) v: f64,
    pub(crate) by_v: f64,
    pub(crate) by_increment: f64,
    pub(crate) by_bound: f64,
}

impl Turned {
    const HELD: Self = Self {
        v: 0.0,
        by_v: 0.0,
        by_increment: 0.0,
        by_bound: 0.0,
    };

    /// The velocity after a step in which other forces change `v` by `increment`, and friction changes it by at most
    /// `bound`.
    pub(crate) fn after_step(v: f64, increment: f64, bound: f64) -> Self {
        let slide_sign = if v != 0.0 {
            v.signum()
        } else if increment.abs() > bound || bound == 0.0 {
            increment.signum()
        } else {
            return Self::HELD;
        };
        let slid_velocity = v + increment - slide_sign * bound;
        if slide_sign * slid_velocity >= 0.0 || bound == 0.0 {
            return Self {
                v: slid_velocity,
                by_v: 1.0,
                by_increment: 1.0,
                by_bound: -slide_sign,
            };
        }
        let (increment_before, increment_after) = (increment - slide_sign * bound, increment + slide_sign * bound);
        if slide_sign * increment_after >= 0.0 {
            return Self::HELD; // it comes to rest, and friction holds it
        }
        let gain_ratio = increment_after / increment_before;
        let spread = slid_velocity / (increment_before * increment_before);
        Self {
            v: slid_velocity * gain_ratio,
            by_v: gain_ratio,
            by_increment: gain_ratio + spread * (increment_before - increment_after),
            by_bound: slide_sign * (spread * (increment_before + increment_after) - gain_ratio),
        }
    }
}
