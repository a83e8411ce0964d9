//! One link of a run, kind by kind: its force, its energy, its slope, and the methods that can compute it.
//!
//! A new kind of link is defined here; `kernel::runs` computes whole runs of it.

use super::{ForceEnds, LinkRun, LinkRunKind, Spring};
use crate::law::Hardening;
use crate::network::Contact;

impl LinkRun {
    /// Force of one link at elongation `e` [m] that grows by `step` [m] a frame [N]; 0 where the force depends on more
    /// than that.
    pub(crate) fn force(&self, e: f64, step: f64) -> f64 {
        match &self.kind {
            LinkRunKind::Ref => self.k * e + self.z * step,
            LinkRunKind::Hardening(q) => self.k * e + q * (e * e * e) + self.z * step,
            LinkRunKind::Lnl {
                law, velocity_factor, ..
            } => law.force(e, step * velocity_factor),
            LinkRunKind::But(but) => but.force(self.k, self.z, e, step),
            LinkRunKind::Space(space) => space.law.force([self.k, self.z], e, step),
            LinkRunKind::Followed { .. }
            | LinkRunKind::Bristle { .. }
            | LinkRunKind::Dry { .. }
            | LinkRunKind::Pairwise { .. } => 0.0,
        }
    }

    /// The elastic part of a link's force [N], also where a clamp holds it back.
    pub(crate) fn elastic_force(&self, e: f64) -> f64 {
        match &self.kind {
            LinkRunKind::Ref => self.k * e,
            LinkRunKind::Hardening(q) => self.k * e + q * (e * e * e),
            LinkRunKind::But(but) => {
                let (contact_sign, law) = (but.sign(), but.elastic(self.k));
                let penetration = contact_sign * e;
                contact_sign * if penetration > 0.0 { law.force(penetration) } else { 0.0 }
            }
            LinkRunKind::Lnl { law, .. } => law.spring(e),
            LinkRunKind::Space(space) => space.law.elastic(self.k, e),
            LinkRunKind::Followed { .. }
            | LinkRunKind::Bristle { .. }
            | LinkRunKind::Dry { .. }
            | LinkRunKind::Pairwise { .. } => 0.0,
        }
    }

    /// The force that a law's damping adds when the link stretches by `step` [m] a frame [N].
    pub(crate) fn damping_force(&self, e: f64, step: f64) -> f64 {
        match &self.kind {
            LinkRunKind::Lnl {
                law, velocity_factor, ..
            } => law.force(e, step * velocity_factor) - law.spring(e),
            LinkRunKind::Hardening(_) => self.z * step,
            LinkRunKind::Space(space) => space.law.force([self.k, self.z], e, step) - space.law.elastic(self.k, e),
            LinkRunKind::Ref
            | LinkRunKind::But(_)
            | LinkRunKind::Followed { .. }
            | LinkRunKind::Bristle { .. }
            | LinkRunKind::Dry { .. }
            | LinkRunKind::Pairwise { .. } => 0.0,
        }
    }

    /// Potential energy of one link at elongation `e` [m], in joules, without that of a shared tension; 0 where the
    /// force is no function of the elongation alone.
    pub(crate) fn potential_energy(&self, e: f64) -> f64 {
        match &self.kind {
            LinkRunKind::Ref => 0.5 * self.k * e * e,
            LinkRunKind::Hardening(q) => 0.5 * self.k * e * e + 0.25 * q * (e * e * e * e),
            LinkRunKind::But(but) => {
                let penetration = but.sign() * e;
                if penetration > 0.0 {
                    but.elastic(self.k).energy(penetration)
                } else {
                    0.0
                }
            }
            LinkRunKind::Lnl { law, .. } => law.potential(e),
            LinkRunKind::Space(space) => space.law.potential(self.k, e),
            LinkRunKind::Pairwise { pairs, .. } => pairs.link.law.potential(self.k, e), // of one pair
            LinkRunKind::Followed { .. } | LinkRunKind::Bristle { .. } | LinkRunKind::Dry { .. } => 0.0,
        }
    }

    /// Slope of the elastic force of a link over its elongation [N/m].
    pub(crate) fn slope(&self, e: f64) -> f64 {
        match &self.kind {
            LinkRunKind::Ref => self.k,
            LinkRunKind::Hardening(q) => self.k + 3.0 * q * e * e,
            LinkRunKind::But(but) => {
                let penetration = but.sign() * e;
                if penetration > 0.0 {
                    but.elastic(self.k).slope(penetration)
                } else {
                    0.0
                }
            }
            LinkRunKind::Lnl { law, .. } => law.slope(e),
            LinkRunKind::Followed { .. }
            | LinkRunKind::Bristle { .. }
            | LinkRunKind::Dry { .. }
            | LinkRunKind::Space(_)
            | LinkRunKind::Pairwise { .. } => 0.0,
        }
    }

    /// K and Z of one link near rest, a contact being closed; `None` if it has no linear form.
    pub(crate) fn linear_form(&self) -> Option<[f64; 2]> {
        match &self.kind {
            LinkRunKind::Ref | LinkRunKind::Hardening(_) => Some([self.k, self.z]),
            LinkRunKind::But(but) if but.exponent == 1.0 => Some([self.k, self.z]),
            LinkRunKind::But(_) => Some([0.0, self.z]),
            LinkRunKind::Bristle { law, velocity_factor } => Some([self.k, law.damping_at_rest() * velocity_factor]),
            LinkRunKind::Lnl {
                law, velocity_factor, ..
            } => Some([law.slope(0.0), law.damping_slope(0.0) * velocity_factor]),
            LinkRunKind::Followed {
                law: followed_law,
                velocity_factor,
                ..
            } => {
                let law = followed_law.law();
                Some([law.slope(0.0), law.damping_slope(0.0) * velocity_factor])
            }
            LinkRunKind::Dry { .. } | LinkRunKind::Space(_) | LinkRunKind::Pairwise { .. } => None,
        }
    }

    /// The stiffness that all links of the run share [N/m], computed from their elongations; 0 if each link has its
    /// own.
    pub(crate) fn shared_stiffness(&self, e: impl Fn(usize) -> f64) -> f64 {
        match &self.kind {
            LinkRunKind::Lnl { law, .. } if law.is_shared() => law.tension((0..self.len).map(|i| e(i) * e(i)).sum()),
            _ => 0.0,
        }
    }

    /// Whether the run can be computed in substeps of a frame: a single link that is a law, or a plain or exact contact
    /// (both have the same equation).
    pub(crate) fn can_substep(&self) -> bool {
        let is_fine_kind = match &self.kind {
            LinkRunKind::Ref
            | LinkRunKind::Followed { .. }
            | LinkRunKind::Dry { .. }
            | LinkRunKind::Space(_)
            | LinkRunKind::Pairwise { .. } => false,
            LinkRunKind::But(but) => but.contact != Contact::Magic,
            LinkRunKind::Lnl { .. } | LinkRunKind::Bristle { .. } | LinkRunKind::Hardening(_) => true,
        };
        is_fine_kind && self.len == 1
    }

    /// The run as hardening springs; `None` for contacts and other laws.
    pub(crate) fn spring(&self) -> Option<Spring> {
        let (k, q, z) = match &self.kind {
            LinkRunKind::Ref => (self.k, 0.0, self.z),
            LinkRunKind::Hardening(q) => (self.k, *q, self.z),
            LinkRunKind::But(_)
            | LinkRunKind::Followed { .. }
            | LinkRunKind::Bristle { .. }
            | LinkRunKind::Dry { .. }
            | LinkRunKind::Space(_)
            | LinkRunKind::Pairwise { .. } => return None,
            LinkRunKind::Lnl {
                law, velocity_factor, ..
            } => {
                let Hardening { k, q, z } = law.hardening_spring()?;
                (k, q, z.unwrap_or(0.0) * velocity_factor)
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

/// The part of the energy of a shared stiffness that one link at elongation `e` [m] stores [J].
pub(crate) fn tension_energy(shared_stiffness: f64, e: f64) -> f64 {
    0.25 * shared_stiffness * e * e
}
