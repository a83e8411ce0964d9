//! The law of a contact, K·p^α + Z·v at a penetration p > 0 that grows by v.

use super::{But, Side};
use crate::maths::{pow, power_law};

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
    pub(crate) fn elastic(&self, k: f64) -> PowerLaw {
        PowerLaw {
            k,
            exponent: self.exponent,
        }
    }

    /// Size of the push at a penetration p [m] with p − p⁻ = `step`: K·p^α + Z·step while p > 0.
    pub(crate) fn push(&self, k: f64, z: f64, p: f64, step: f64) -> f64 {
        if p > 0.0 {
            let push_force = self.elastic(k).force(p) + z * step;
            if self.is_clamped {
                push_force.max(0.0)
            } else {
                push_force
            }
        } else {
            0.0
        }
    }

    /// The force that pulls both ends together [N], at elongation `e` that grows by `step` [m].
    pub(crate) fn force(&self, k: f64, z: f64, e: f64, step: f64) -> f64 {
        let side_sign = self.sign();
        side_sign * self.push(k, z, side_sign * e, side_sign * step)
    }
}
