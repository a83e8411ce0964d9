//! A scene with all its contacts closed: as stiff as a hand can meet it.

use super::{LinkKind, Network, Run};

/// Contacts and laws that harden are looked at this deep [m]: a hand seldom presses farther.
const DEEP: f64 = 1e-3;
/// Places between at which a law's slope is looked at.
const PLACES: i32 = 16;

impl Network {
    /// The network at rest with every contact closed and every law a spring as stiff as it gets within a millimetre.
    /// It is linear: what it does to a small push it does to any.
    pub fn pressed(&self) -> Self {
        let mut pressed = self.clone();
        for run in &mut pressed.runs {
            let (k, z) = stiffest(run);
            (run.kind, run.k, run.z, run.rest) = (LinkKind::Ref, k, z, 0.0);
        }
        let mats = &mut pressed.mats;
        for values in [&mut mats.rest, &mut mats.x0, &mut mats.v0] {
            values.fill(0.0);
        }
        pressed
    }
}

fn stiffest(run: &Run) -> (f64, f64) {
    match &run.kind {
        LinkKind::Ref => (run.k, run.z),
        LinkKind::But(but) => {
            let slope = but.exponent * crate::maths::pow(DEEP, but.exponent - 1.0);
            (run.k * slope, run.z)
        }
        LinkKind::Lnl(law) => {
            let places = (-PLACES..=PLACES).map(|i| DEEP * f64::from(i) / f64::from(PLACES));
            let slopes = places
                .clone()
                .map(|d| law.slope(d))
                .filter(|k| k.is_finite());
            let drags = places
                .map(|d| law.damping_slope(d))
                .filter(|z| z.is_finite());
            // A law that gives way, or gives energy, is no spring at all.
            (slopes.fold(0.0, f64::max), drags.fold(0.0, f64::max))
        }
    }
}
