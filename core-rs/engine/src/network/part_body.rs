//! A part by itself as a linear body: springs and dampers between masses, with contacts open and laws replaced by their
//! slopes at rest.

use nalgebra::Complex;

use super::Network;
use super::elements::{ElementKind, Elements};
use crate::interrupt;
use crate::maths::{atan2, log1p, sin};
use crate::spectrum::springs::{End, Spring, Springs};
use crate::units::Rate;

/// The masses, springs and dampers of a part by itself.
pub(super) struct PartBody {
    /// Masses, by their index in the network   (n)
    pub(super) mats: Vec<usize>,
    /// √M   (n)
    pub(super) sqrt_masses: Vec<f64>,
    pub(super) springs: Springs,
    /// Dampers; in a discrete network each also contains the stiffness K, because the poles are then those of z − 1.
    pub(super) dampers: Vec<Spring>,
    /// Rate of the discrete network that defines the part; `None` if it is continuous.
    pub(super) ca_rate: Option<Rate>,
    /// Number of links whose law was taken at its slope at rest.
    pub(super) n_laws: usize,
    /// Number of contacts that were taken as open.
    pub(super) n_contacts: usize,
}

impl Network {
    pub(super) fn part_body(&self, part: usize) -> PartBody {
        PartBody::new(self.elements(&[part]))
    }
}

impl PartBody {
    /// The body of the masses and links of some parts.
    pub(super) fn new(elements: Elements) -> Self {
        let sqrt_masses: Vec<f64> = elements.masses.iter().map(|mass| mass.sqrt()).collect();
        let scaled_end = |slot: usize| -> End { (slot, 1.0 / sqrt_masses[slot]) };
        let (mut springs, mut dampers): (Vec<Spring>, Vec<Spring>) = (Vec::new(), Vec::new());
        for element in interrupt::polled_items(&elements.elements) {
            if matches!(element.kind, ElementKind::But | ElementKind::Dry | ElementKind::Space) {
                continue;
            }
            let [first_slot, second_slot] = element.ends;
            let (Some(body_slot), other_end) = (if first_slot.is_some() {
                (first_slot, second_slot)
            } else {
                (second_slot, first_slot)
            }) else {
                continue;
            };
            let other_end = other_end.map(scaled_end);
            springs.push((scaled_end(body_slot), other_end, element.k));
            // x[n+1] − 2x[n] + x[n−1] = −K x[n] − Z (x[n] − x[n−1]) is w² + (Z + K) w + K = 0 at w = z − 1.
            let added_damping = if elements.ca_rate.is_some() { element.k } else { 0.0 };
            dampers.push((scaled_end(body_slot), other_end, element.z + added_damping));
        }
        dampers.retain(|damper| damper.2 != 0.0);
        Self {
            n_laws: [ElementKind::Lnl, ElementKind::Bristle, ElementKind::Dry]
                .map(|kind| elements.count(kind))
                .iter()
                .sum(),
            n_contacts: elements.count(ElementKind::But),
            springs: Springs::new(elements.mats.len(), springs),
            mats: elements.mats,
            dampers,
            ca_rate: elements.ca_rate,
            sqrt_masses,
        }
    }

    /// The eigenvalue of an undamped mode of frequency `f` [Hz].
    pub(super) fn mode_eigenvalue(&self, f: f64) -> f64 {
        match self.ca_rate {
            None => (std::f64::consts::TAU * f) * (std::f64::consts::TAU * f),
            Some(rate) => {
                let half_sine = sin(std::f64::consts::PI * (f / rate.hertz()).min(0.5));
                4.0 * half_sine * half_sine
            }
        }
    }

    /// The pole s [1/s] in continuous time for a pole of the eigenvalue problem.
    pub(super) fn continuous_pole(&self, pole: Complex<f64>) -> Complex<f64> {
        let Some(rate) = self.ca_rate else {
            return pole;
        };
        let log_modulus = 0.5 * log1p(2.0 * pole.re + pole.norm_sqr());
        Complex::new(log_modulus, atan2(pole.im, 1.0 + pole.re)) * rate.hertz()
    }
}
