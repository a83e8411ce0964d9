//! The law of a contact, K·p^α + Z·v at a penetration p > 0 that grows by v.

use super::{But, Side};
use crate::maths::{pow, power_law, sqrt};

/// The elastic part K·p^α of a contact.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PowerLaw {
    /// K [N/m^α].
    pub(crate) k: f64,
    /// α.
    pub(crate) exponent: f64,
}

impl PowerLaw {
    /// The push at a penetration p >= 0 [N].
    #[inline(always)]
    pub(crate) fn force(self, p: f64) -> f64 {
        self.k * power_law(p, self.exponent)
    }

    /// The energy that it stores at a penetration p >= 0 [J].
    #[inline(always)]
    pub(crate) fn energy(self, p: f64) -> f64 {
        self.k * power_law(p, self.exponent + 1.0) / (self.exponent + 1.0)
    }

    /// The stiffness at a penetration p >= 0 [N/m].
    pub(crate) fn slope(self, p: f64) -> f64 {
        self.k * self.exponent * power_law(p, self.exponent - 1.0)
    }

    /// The penetration at which it stores an energy [m].
    pub(crate) fn depth(self, energy: f64) -> f64 {
        let energy_power = self.exponent + 1.0;
        pow(energy * energy_power / self.k, 1.0 / energy_power)
    }

    /// The slope of ψ = √(2·energy) at a penetration p >= 0 [√J/m].
    pub(crate) fn root_slope(self, p: f64) -> f64 {
        sqrt(0.5 * self.k * (self.exponent + 1.0)) * power_law(p, 0.5 * (self.exponent - 1.0))
    }
}

/// The law of a contact. Its rate v is that of the penetration, in the unit of time of `z`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ContactLaw {
    pub(crate) elastic: PowerLaw,
    /// Z.
    pub(crate) z: f64,
    /// Whether it never pulls.
    pub(crate) is_clamped: bool,
}

impl ContactLaw {
    /// The push at a penetration `p`, 0 while it is open [N].
    #[inline(always)]
    pub(crate) fn push(self, p: f64, v: f64) -> f64 {
        if p > 0.0 {
            self.limited_force(self.elastic.force(p) + self.z * v)
        } else {
            0.0
        }
    }

    /// The elastic part, continued to p < 0 as an odd function [N].
    pub(crate) fn odd_elastic(self, p: f64) -> f64 {
        if p >= 0.0 {
            self.elastic.force(p)
        } else {
            -self.elastic.force(-p)
        }
    }

    /// K·p^α + Z·v without a clamp, continued to p < 0 [N].
    pub(crate) fn unlimited_force(self, p: f64, v: f64) -> f64 {
        self.odd_elastic(p) + self.z * v
    }

    /// A push, or 0 in place of a pull of a clamped contact [N].
    #[inline(always)]
    pub(crate) fn limited_force(self, push: f64) -> f64 {
        if self.is_clamped { push.max(0.0) } else { push }
    }
}

impl But {
    /// Sign s of the side from which a contact is approached: the penetration is s·e.
    pub(crate) fn sign(&self) -> f64 {
        match self.side {
            Side::Below => -1.0,
            Side::Above => 1.0,
        }
    }

    /// Its elastic part with a stiffness `k`.
    #[inline(always)]
    pub(crate) fn elastic(&self, k: f64) -> PowerLaw {
        PowerLaw {
            k,
            exponent: self.exponent,
        }
    }

    /// Its law with a stiffness `k` and a damping `z`.
    #[inline(always)]
    pub(crate) fn law(&self, k: f64, z: f64) -> ContactLaw {
        ContactLaw {
            elastic: self.elastic(k),
            z,
            is_clamped: self.is_clamped,
        }
    }

    /// The force that pulls both ends together [N], at elongation `e` that grows by `step` [m].
    pub(crate) fn force(&self, k: f64, z: f64, e: f64, step: f64) -> f64 {
        let side_sign = self.sign();
        side_sign * self.law(k, z).push(side_sign * e, side_sign * step)
    }
}
