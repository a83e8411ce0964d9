//! One law: its forces and slopes at the Gauss points, and what it keeps from frame to frame.

use super::{STAGES, Square, Stages};
use crate::law::Scratch;
use crate::scheme::Kind;

/// Steps of the differences that tell a law's slopes, relative to what is looked at and at least [m, m/s].
const NEAR: (f64, f64) = (1e-6, 1e-9);

/// A law that plays.
#[derive(Clone, Debug, Default)]
pub(in crate::island::fine) struct LawState {
    /// At the Gauss points of the last part [N], and what is known of this one's.
    pub(super) force: [f64; STAGES],
    pub(super) elongation: [f64; STAGES],
    pub(super) rate: [f64; STAGES],
    /// At the start of the frame [N].
    pub(super) begin: f64,
    /// The largest of the last frames [N].
    pub(super) largest: f64,
    /// Elongation at the instants of the frame if the forces of the parts to come are zero [m]   (n)
    pub(super) path: Vec<f64>,
    /// The inverse of what a change of the forces leaves unmet, and for which division it was found.
    pub(super) inverse: Square,
    pub(super) known: Option<usize>,
    pub(super) scratch: Scratch,
    pub(super) room: Vec<f64>,
}

crate::archive::state!(LawState {
    force,
    elongation,
    rate,
    begin,
    largest,
    inverse,
    known,
});

/// A law at one instant.
#[derive(Clone, Copy)]
pub(super) struct LawNow<'a> {
    pub(super) kind: &'a Kind,
    /// How far its gate is open.
    pub(super) open: f64,
    /// Of a law whose K and Z are led: [N/m, N·frame/m].
    pub(super) k: f64,
    pub(super) z: f64,
}

impl LawNow<'_> {
    /// A rate of elongation [m/frame] times this is what the law takes.
    pub(super) fn rate(&self) -> f64 {
        match self.kind {
            Kind::Lnl { rate, .. } => *rate,
            _ => 1.0,
        }
    }

    /// Its force at an elongation and a rate [N].
    pub(super) fn at(&self, e: f64, v: f64) -> f64 {
        let force = match self.kind {
            Kind::Lnl { law, .. } => law.force(e, v),
            Kind::Hardening(q) => self.k * e + q * e * e * e + self.z * v,
            _ => 0.0,
        };
        self.open * force
    }
}

impl LawState {
    /// Go on as the same law of another version stands.
    pub(in crate::island::fine) fn continue_from(&mut self, old: &Self) {
        (self.force, self.elongation, self.rate) = (old.force, old.elongation, old.rate);
        (self.begin, self.largest) = (old.begin, old.largest);
        (self.inverse, self.known) = (old.inverse, old.known);
    }

    /// Forces of the law at three instants, at their elongations and rates [N].
    pub(super) fn forces(&mut self, now: &[LawNow<'_>; STAGES], e: &Stages, v: &Stages) -> Stages {
        match now[0].kind {
            Kind::Lnl { law, .. } if law.is_native() => {
                let mut forces = [0.0; STAGES];
                law.eval_in(e, v, &mut forces, &mut self.scratch, &mut self.room);
                forces.map(|force| now[0].open * force)
            }
            _ => std::array::from_fn(|stage| now[stage].at(e[stage], v[stage])),
        }
    }

    /// Slopes of the law at three instants, in the elongation and in its rate [N/m, N·s/m].
    pub(super) fn slopes(
        &mut self,
        now: &[LawNow<'_>; STAGES],
        (e, v): (&Stages, &Stages),
        force: &Stages,
    ) -> (Stages, Stages) {
        if let Kind::Hardening(q) = now[0].kind {
            let k = |stage: usize| {
                let own = &now[stage];
                own.open * (own.k + 3.0 * q * e[stage] * e[stage])
            };
            return ([0, 1, 2].map(k), now.each_ref().map(|own| own.open * own.z));
        }
        let (has_spring, has_drag) = match now[0].kind {
            Kind::Lnl { law, .. } => (!law.is_damping_alone(), law.is_damped()),
            _ => (true, true),
        };
        let mut found = [[0.0; STAGES]; 2];
        for (which, is_there) in [has_spring, has_drag].into_iter().enumerate() {
            if !is_there {
                continue;
            }
            let mut places = [*e, *v];
            let by = places[which].map(|at| NEAR.0 * at.abs() + NEAR.1);
            for stage in 0..STAGES {
                places[which][stage] += by[stage];
            }
            let ahead = self.forces(now, &places[0], &places[1]);
            found[which] = std::array::from_fn(|stage| (ahead[stage] - force[stage]) / by[stage]);
        }
        (found[0], found[1])
    }
}
