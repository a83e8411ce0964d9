//! Dry friction of a key in a step, and its contact before it slides.

use super::KeyModel;
use crate::maths::exp;

/// Dry friction in a step, and its derivatives.
pub(super) struct Friction {
    /// Level [N], its derivative with respect to the velocity, and the share of `static_dry` in it.
    pub(super) level: f64,
    pub(super) slope: f64,
    pub(super) static_share: f64,
}

impl Friction {
    /// Dry friction of a key at a velocity [m/s].
    pub(super) fn new(key: &KeyModel, v: f64) -> Self {
        if key.static_speed == 0.0 {
            return Self {
                level: key.dry,
                slope: 0.0,
                static_share: 0.0,
            };
        }
        let speed_ratio = v / key.static_speed;
        let static_share = exp(-speed_ratio * speed_ratio);
        let static_excess = (key.static_dry - key.dry) * static_share;
        Self {
            level: key.dry + static_excess,
            slope: -2.0 * static_excess * speed_ratio / key.static_speed,
            static_share,
        }
    }
}

/// The contact before it slides: s' = v - σ|v| s/F, solved implicitly in s, so that σ|s| never exceeds the level F.
pub(super) struct Contact {
    pub(super) s: f64,
    pub(super) by_s: f64,
    pub(super) by_v: f64,
    pub(super) by_level: f64,
    pub(super) by_presliding: f64,
}

impl Contact {
    pub(super) fn new(key: &KeyModel, friction: &Friction, s: f64, v: f64, h: f64) -> Self {
        let no_contact = Self {
            s: 0.0,
            by_s: 0.0,
            by_v: 0.0,
            by_level: 0.0,
            by_presliding: 0.0,
        };
        if key.presliding == 0.0 || friction.level <= 0.0 {
            return no_contact;
        }
        let h_v_over_level = h * v.abs() / friction.level;
        let denominator = 1.0 + key.presliding * h_v_over_level;
        let state_after = (s + h * v) / denominator;
        let by_level = state_after * key.presliding * h_v_over_level / (friction.level * denominator);
        let by_speed = if v == 0.0 {
            0.0
        } else {
            v.signum() * h * key.presliding / friction.level
        };
        Self {
            s: state_after,
            by_s: 1.0 / denominator,
            by_v: (h - state_after * by_speed) / denominator + by_level * friction.slope,
            by_level,
            by_presliding: -state_after * h_v_over_level / denominator,
        }
    }
}
