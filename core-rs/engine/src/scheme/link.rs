//! One link of a run, kind by kind: its force, its energy, its slope, and the methods that can compute it.
//!
//! A new kind of link is defined here; `kernel::runs` computes whole runs of it.

use super::{ForceEnds, Kind, Run, Spring};
use crate::law::Hardening;
use crate::network::Contact;

impl Run {
    /// Force of one link at elongation `e` [m] that grows by `step` [m] a frame [N]; 0 where the force depends on more
    /// than that.
    pub(crate) fn force(&self, e: f64, step: f64) -> f64 {
        match &self.kind {
            Kind::Ref => self.k * e + self.z * step,
            Kind::Hardening(q) => self.k * e + q * (e * e * e) + self.z * step,
            Kind::Lnl { law, rate, .. } => law.force(e, step * rate),
            Kind::But(but) => but.force(self.k, self.z, e, step),
            Kind::Space(space) => space.law.force([self.k, self.z], e, step),
            Kind::Followed { .. } | Kind::Bristle { .. } | Kind::Dry { .. } | Kind::Pairwise { .. } => 0.0,
        }
    }

    /// The elastic part of a link's force [N], also where a clamp holds it back.
    pub(crate) fn elastic_force(&self, e: f64) -> f64 {
        match &self.kind {
            Kind::Ref => self.k * e,
            Kind::Hardening(q) => self.k * e + q * (e * e * e),
            Kind::But(but) => {
                let (contact_sign, law) = (but.sign(), but.elastic(self.k));
                let penetration = contact_sign * e;
                contact_sign * if penetration > 0.0 { law.force(penetration) } else { 0.0 }
            }
            Kind::Lnl { law, .. } => law.spring(e),
            Kind::Space(space) => space.law.elastic(self.k, e),
            Kind::Followed { .. } | Kind::Bristle { .. } | Kind::Dry { .. } | Kind::Pairwise { .. } => 0.0,
        }
    }

    /// The force that a law's damping adds when the link stretches by `step` [m] a frame [N].
    pub(crate) fn damping_force(&self, e: f64, step: f64) -> f64 {
        match &self.kind {
            Kind::Lnl { law, rate, .. } => law.force(e, step * rate) - law.spring(e),
            Kind::Hardening(_) => self.z * step,
            Kind::Space(space) => space.law.force([self.k, self.z], e, step) - space.law.elastic(self.k, e),
            Kind::Ref
            | Kind::But(_)
            | Kind::Followed { .. }
            | Kind::Bristle { .. }
            | Kind::Dry { .. }
            | Kind::Pairwise { .. } => 0.0,
        }
    }

    /// Potential energy of one link at elongation `e` [m], in joules, without that of a shared tension; 0 where the
    /// force is no function of the elongation alone.
    pub(crate) fn potential_energy(&self, e: f64) -> f64 {
        match &self.kind {
            Kind::Ref => 0.5 * self.k * e * e,
            Kind::Hardening(q) => 0.5 * self.k * e * e + 0.25 * q * (e * e * e * e),
            Kind::But(but) => {
                let penetration = but.sign() * e;
                if penetration > 0.0 {
                    but.elastic(self.k).energy(penetration)
                } else {
                    0.0
                }
            }
            Kind::Lnl { law, .. } => law.potential(e),
            Kind::Space(space) => space.law.potential(self.k, e),
            Kind::Pairwise { pairs, .. } => pairs.link.law.potential(self.k, e), // of one pair
            Kind::Followed { .. } | Kind::Bristle { .. } | Kind::Dry { .. } => 0.0,
        }
    }

    /// Slope of the elastic force of a link over its elongation [N/m].
    pub(crate) fn slope(&self, e: f64) -> f64 {
        match &self.kind {
            Kind::Ref => self.k,
            Kind::Hardening(q) => self.k + 3.0 * q * e * e,
            Kind::But(but) => {
                let penetration = but.sign() * e;
                if penetration > 0.0 {
                    but.elastic(self.k).slope(penetration)
                } else {
                    0.0
                }
            }
            Kind::Lnl { law, .. } => law.slope(e),
            Kind::Followed { .. }
            | Kind::Bristle { .. }
            | Kind::Dry { .. }
            | Kind::Space(_)
            | Kind::Pairwise { .. } => 0.0,
        }
    }

    /// K and Z of one link near rest, a contact being closed; `None` if it has no linear form.
    pub(crate) fn linear_form(&self) -> Option<[f64; 2]> {
        match &self.kind {
            Kind::Ref | Kind::Hardening(_) => Some([self.k, self.z]),
            Kind::But(but) if but.exponent == 1.0 => Some([self.k, self.z]),
            Kind::But(_) => Some([0.0, self.z]),
            Kind::Bristle { law, rate } => Some([self.k, law.damping_at_rest() * rate]),
            Kind::Lnl { law, rate, .. } => Some([law.slope(0.0), law.damping_slope(0.0) * rate]),
            Kind::Followed {
                law: followed_law,
                rate,
                ..
            } => {
                let law = followed_law.law();
                Some([law.slope(0.0), law.damping_slope(0.0) * rate])
            }
            Kind::Dry { .. } | Kind::Space(_) | Kind::Pairwise { .. } => None,
        }
    }

    /// The stiffness that all links of the run share [N/m], computed from their elongations; 0 if each link has its
    /// own.
    pub(crate) fn shared_stiffness(&self, e: impl Fn(usize) -> f64) -> f64 {
        match &self.kind {
            Kind::Lnl { law, .. } if law.is_shared() => law.tension((0..self.len).map(|i| e(i) * e(i)).sum()),
            _ => 0.0,
        }
    }

    /// Whether the run can be computed in substeps of a frame: a single link that is a law, or a plain or exact contact
    /// (both have the same equation).
    pub(crate) fn can_substep(&self) -> bool {
        let is_fine_kind = match &self.kind {
            Kind::Ref | Kind::Followed { .. } | Kind::Dry { .. } | Kind::Space(_) | Kind::Pairwise { .. } => false,
            Kind::But(but) => but.contact != Contact::Magic,
            Kind::Lnl { .. } | Kind::Bristle { .. } | Kind::Hardening(_) => true,
        };
        is_fine_kind && self.len == 1
    }

    /// The run as hardening springs; `None` for contacts and other laws.
    pub(crate) fn spring(&self) -> Option<Spring> {
        let (k, q, z) = match &self.kind {
            Kind::Ref => (self.k, 0.0, self.z),
            Kind::Hardening(q) => (self.k, *q, self.z),
            Kind::But(_)
            | Kind::Followed { .. }
            | Kind::Bristle { .. }
            | Kind::Dry { .. }
            | Kind::Space(_)
            | Kind::Pairwise { .. } => return None,
            Kind::Lnl { law, rate, .. } => {
                let Hardening { k, q, z } = law.hardening_spring()?;
                (k, q, z.unwrap_or(0.0) * rate)
            }
        };
        Some(Spring {
            a: self.a,
            b: self.b,
            len: self.len,
            k,
            q,
            z,
            rest: self.rest,
            force_ends: ForceEnds::Both(self.a, self.b),
        })
    }
}

/// The part of the energy of a shared `tension` that one link at elongation `e` [m] stores [J].
pub(crate) fn tension_energy(tension: f64, e: f64) -> f64 {
    0.25 * tension * e * e
}
