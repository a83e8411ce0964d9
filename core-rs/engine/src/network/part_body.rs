//! A part by itself as springs and dampers between masses, contacts open and laws at their slope at rest.

use nalgebra::Complex;

use super::{LinkKind, MatKind, Network};
use crate::maths::{atan2, log1p, sin};
use crate::spectrum::springs::{End, Spring, Springs};
use crate::units::Rate;

/// The masses, springs and dampers of a part by itself.
pub(super) struct Body {
    /// Masses, by their index in the network   (n)
    pub(super) mats: Vec<usize>,
    /// √M   (n)
    pub(super) root: Vec<f64>,
    pub(super) springs: Springs,
    /// Dampers; of a discrete network with its springs once more, for its poles then are those of z − 1.
    pub(super) dampers: Vec<Spring>,
    /// The rate of the network whose numbers are the truth.
    ca_rate: Option<Rate>,
    /// Links whose law was taken at its slope at rest.
    pub(super) n_laws: usize,
    /// Contacts that were taken as open.
    pub(super) n_contacts: usize,
}

impl Network {
    pub(super) fn part_body(&self, part: usize) -> Body {
        let subset = self.part_alone(part, &[]);
        let alone = &subset.network;
        let own = alone.mats();
        let moving: Vec<usize> = (0..alone.n_mat())
            .filter(|&i| own.kind[i].moves())
            .collect();
        let root: Vec<f64> = moving.iter().map(|&i| own.m[i].sqrt()).collect();
        let end = |mat: usize| -> Option<End> {
            let slot = moving.binary_search(&mat).ok()?;
            Some((slot, 1.0 / root[slot]))
        };
        let (mut springs, mut dampers): (Vec<Spring>, Vec<Spring>) = (Vec::new(), Vec::new());
        for (slot, &i) in moving.iter().enumerate() {
            if own.kind[i] == MatKind::Cel {
                springs.push(((slot, 1.0 / root[slot]), None, own.k[i]));
                dampers.push(((slot, 1.0 / root[slot]), None, own.z[i]));
            }
        }
        let (mut n_laws, mut n_contacts) = (0, 0);
        for run in alone.runs() {
            let (k, z) = match &run.kind {
                LinkKind::Ref => (run.k, run.z),
                LinkKind::Bristle(bristle) => {
                    n_laws += run.len;
                    (run.k, bristle.damping_at_rest())
                }
                LinkKind::Lnl(law) => {
                    n_laws += run.len;
                    (law.slope(0.0), law.damping_slope(0.0))
                }
                LinkKind::Dry(_) => {
                    n_laws += run.len;
                    continue;
                }
                LinkKind::But(_) => {
                    n_contacts += run.len;
                    continue;
                }
            };
            for (a, b) in (0..run.len).map(|i| (end(run.a + i), end(run.b + i))) {
                let (Some(one), other) = (if a.is_some() { (a, b) } else { (b, a) }) else {
                    continue;
                };
                springs.push((one, other, k));
                dampers.push((one, other, z));
            }
        }
        let ca_rate = self.parts[part].ca_rate;
        if ca_rate.is_some() {
            // x[n+1] − 2x[n] + x[n−1] = −K x[n] − Z (x[n] − x[n−1]) is w² + (Z + K) w + K = 0 at w = z − 1.
            for (damper, spring) in dampers.iter_mut().zip(&springs) {
                damper.2 += spring.2;
            }
        }
        dampers.retain(|damper| damper.2 != 0.0);
        Body {
            mats: moving.iter().map(|&i| subset.mats[i] as usize).collect(),
            springs: Springs::new(moving.len(), springs),
            dampers,
            root,
            ca_rate,
            n_laws,
            n_contacts,
        }
    }
}

impl Body {
    /// The eigenvalue of an undamped mode of frequency `f` [Hz].
    pub(super) fn lambda(&self, f: f64) -> f64 {
        match self.ca_rate {
            None => (std::f64::consts::TAU * f) * (std::f64::consts::TAU * f),
            Some(rate) => {
                let half = sin(std::f64::consts::PI * (f / rate.hertz()).min(0.5));
                4.0 * half * half
            }
        }
    }

    /// The pole s [1/s] of a pole of the eigenvalue problem.
    pub(super) fn continuous(&self, pole: Complex<f64>) -> Complex<f64> {
        let Some(rate) = self.ca_rate else {
            return pole;
        };
        let decay = 0.5 * log1p(2.0 * pole.re + pole.norm_sqr());
        Complex::new(decay, atan2(pole.im, 1.0 + pole.re)) * rate.hertz()
    }
}
