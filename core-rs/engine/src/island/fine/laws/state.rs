//! One law: its forces and slopes at the Gauss points, and the state that it keeps from frame to frame.

use super::{STAGES, Square, Stages, WEIGHTS, inverse};
use crate::island::fine::basis::dot;
use crate::law::{FEW, Scratch};
use crate::network::Bristle;
use crate::scheme::Kind;

/// Steps of the finite differences for a law's slopes: relative to the argument, and at least [m, m/s].
const NEAR: (f64, f64) = (1e-6, 1e-9);

/// Integrals up to each Gauss point, as weights of the rates at the Gauss points, in parts (Gauss's method of order 6).
const MEANS: Square = [
    [
        5.0 / 36.0,
        -0.035_976_667_524_938_9,
        0.009_789_444_015_308_324,
    ],
    [
        0.300_263_194_980_864_6,
        2.0 / 9.0,
        -0.022_485_417_203_086_813,
    ],
    [
        0.267_988_333_762_469_43,
        0.480_421_111_969_383_3,
        5.0 / 36.0,
    ],
];

/// The state of a running law.
#[derive(Clone, Debug, Default)]
pub(in crate::island::fine) struct LawState {
    /// Forces at the Gauss points of a part [N]; elongations and their rates there without the forces of that part.
    pub(super) force: [f64; STAGES],
    pub(super) elongation: [f64; STAGES],
    pub(super) rate: [f64; STAGES],
    /// Bend of its bristles at the start of a part, at its end, and before a step that may be repeated [m].
    pub(super) bend: f64,
    pub(super) bend_at_end: f64,
    pub(super) saved_bend: f64,
    /// Elongation and its rate at the start of the frame [m, m/s], and the force there [N].
    pub(super) start: [f64; 2],
    pub(super) begin: f64,
    /// The largest force of the last frames [N].
    pub(super) largest: f64,
    /// Elongation at the instants of the frame if the forces of the parts to come are zero [m]   (n)
    pub(super) path: Vec<f64>,
    /// Inverse of the derivative of the residual by the forces, and the division for which it was computed.
    pub(super) inverse: Square,
    pub(super) known: Option<usize>,
    pub(super) scratch: Scratch,
    pub(super) room: Vec<f64>,
}

crate::archive::state!(LawState {
    force,
    elongation,
    rate,
    bend,
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
    /// K and Z of a law for which they are led: [N/m, N·frame/m].
    pub(super) k: f64,
    pub(super) z: f64,
    /// Bend of its bristles [m].
    pub(super) bend: f64,
}

impl LawNow<'_> {
    /// Factor from a rate of elongation [m/frame] to the rate that the law takes.
    pub(super) fn rate(&self) -> f64 {
        match self.kind {
            Kind::Lnl { rate, .. } | Kind::Bristle { rate, .. } => *rate,
            _ => 1.0,
        }
    }

    /// Whether it is an LNL, whose force at the start of a frame is computed together with those at the Gauss points.
    pub(super) fn is_expression(&self) -> bool {
        matches!(self.kind, Kind::Lnl { .. })
    }

    /// Its force at an elongation and a rate [N].
    pub(super) fn at(&self, e: f64, v: f64) -> f64 {
        let force = match self.kind {
            Kind::Lnl { law, .. } => law.force(e, v),
            Kind::Bristle { by, .. } => by.with(self.k, self.z).force(self.bend, v),
            Kind::Hardening(q) => self.k * e + q * e * e * e + self.z * v,
            _ => 0.0,
        };
        self.open * force
    }

    /// Its bristles as they are at this instant; `None` for other laws.
    pub(super) fn bristle(&self) -> Option<Bristle> {
        match self.kind {
            Kind::Bristle { by, .. } => Some(by.with(self.k, self.z)),
            _ => None,
        }
    }

    /// Its force halfway through `h` frames of constant elongation and rate.
    pub(super) fn halfway(&self, e: f64, v: f64, h: f64) -> f64 {
        match self.bristle() {
            Some(by) => {
                let bend = by.halfway(self.bend, v, h / self.rate());
                Self { bend, ..*self }.at(e, v)
            }
            None => self.at(e, v),
        }
    }
}

impl LawState {
    /// Take over the state of the same law in another version.
    pub(in crate::island::fine) fn continue_from(&mut self, old: &Self) {
        (self.force, self.elongation, self.rate) = (old.force, old.elongation, old.rate);
        (self.begin, self.largest, self.bend) = (old.begin, old.largest, old.bend);
        (self.inverse, self.known) = (old.inverse, old.known);
    }

    /// Bend of its bristles at the start of a frame [m].
    pub(in crate::island::fine) fn bend_at_start(&self) -> f64 {
        self.bend
    }

    pub(in crate::island::fine) fn set_bend(&mut self, bend: f64) {
        self.bend = bend;
    }

    /// Save what a step changes, if it may be repeated.
    pub(in crate::island::fine) fn save(&mut self) {
        self.saved_bend = self.bend;
    }

    /// Undo the last step.
    pub(in crate::island::fine) fn restore(&mut self) {
        self.bend = self.saved_bend;
    }

    /// Forces of the law at three instants of a part of `h` frames, at their elongations and rates [N].
    pub(super) fn forces(
        &mut self,
        now: &[LawNow<'_>; STAGES],
        (e, v): (&Stages, &Stages),
        h: f64,
    ) -> Stages {
        if let Some((forces, end)) = bent(now, v, h) {
            self.bend_at_end = end;
            return forces;
        }
        match now[0].kind {
            Kind::Lnl { law, .. } => {
                // The law at the start of the frame takes the fourth lane.
                let [e, v] = [(e, self.start[0]), (v, self.start[1])]
                    .map(|([first, second, third], start)| [*first, *second, *third, start]);
                let mut forces = [0.0; FEW];
                if law.is_native() {
                    law.eval_in(&e, &v, &mut forces, &mut self.scratch, &mut self.room);
                } else {
                    forces = law.forces(&e, &v);
                }
                let [first, second, third, begin] = forces.map(|force| now[0].open * force);
                self.begin = begin;
                [first, second, third]
            }
            _ => std::array::from_fn(|stage| now[stage].at(e[stage], v[stage])),
        }
    }

    /// Derivative of the residual by the forces, from the response of elongation and rate to them.
    pub(super) fn left(
        &mut self,
        now: &[LawNow<'_>; STAGES],
        (e, v): (&Stages, &Stages),
        (force, h): (&Stages, f64),
        [by_x, by_v]: &[Square; 2],
    ) -> Square {
        let rate = now[0].rate();
        let mut left = [[0.0; STAGES]; STAGES];
        if now[0].bristle().is_some() {
            // A rate at one instant bends the bristles at all later instants.
            let slopes = bent_slopes(now, v, (force, h));
            for stage in 0..STAGES {
                for column in 0..STAGES {
                    let of = |from: usize| slopes[stage][from] * by_v[from][column];
                    let one = if column == stage { 1.0 } else { 0.0 };
                    left[stage][column] = one - rate * (0..STAGES).map(of).sum::<f64>();
                }
            }
            return left;
        }
        let (k, z) = self.slopes(now, (e, v), force);
        for stage in 0..STAGES {
            for column in 0..STAGES {
                let one = if column == stage { 1.0 } else { 0.0 };
                left[stage][column] =
                    one - k[stage] * by_x[stage][column] - z[stage] * rate * by_v[stage][column];
            }
        }
        left
    }

    /// Slopes of the law at three instants, in the elongation and in its rate [N/m, N·s/m].
    fn slopes(
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
            let ahead = self.forces(now, (&places[0], &places[1]), 0.0);
            found[which] = std::array::from_fn(|stage| (ahead[stage] - force[stage]) / by[stage]);
        }
        (found[0], found[1])
    }
}

/// Forces [N] of bristles at three instants of a part of `h` frames, from the rates of their ends there [m/s], and
/// their bend at the end of the part [m]; `None` for other laws.
fn bent(now: &[LawNow<'_>; STAGES], v: &Stages, h: f64) -> Option<(Stages, f64)> {
    let by = [now[0].bristle()?, now[1].bristle()?, now[2].bristle()?];
    let (start, h) = (now[0].bend, h / now[0].rate());
    let wear: Stages = std::array::from_fn(|stage| by[stage].wear(v[stage]));
    let mut left = [[0.0; STAGES]; STAGES];
    for stage in 0..STAGES {
        for column in 0..STAGES {
            let one = if column == stage { 1.0 } else { 0.0 };
            left[stage][column] = one + h * MEANS[stage][column] * wear[column];
        }
    }
    let moved = MEANS.map(|row| start + h * dot(&row, v));
    let bends = inverse(&left).map(|row| dot(&row, &moved));
    let forces = std::array::from_fn(|stage| {
        let own = LawNow {
            bend: bends[stage],
            ..now[stage]
        };
        own.at(0.0, v[stage])
    });
    let rates: Stages = std::array::from_fn(|stage| v[stage] - wear[stage] * bends[stage]);
    Some((forces, start + h * dot(&WEIGHTS, &rates)))
}

/// Derivatives of the forces of bristles at three instants by the rates of their ends at each [N·s/m].
fn bent_slopes(now: &[LawNow<'_>; STAGES], v: &Stages, (force, h): (&Stages, f64)) -> Square {
    let mut slopes = [[0.0; STAGES]; STAGES];
    for from in 0..STAGES {
        let by = NEAR.0 * v[from].abs() + NEAR.1;
        let mut near = *v;
        near[from] += by;
        if let Some((ahead, _)) = bent(now, &near, h) {
            for stage in 0..STAGES {
                slopes[stage][from] = (ahead[stage] - force[stage]) / by;
            }
        }
    }
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::island::fine::laws::POINTS;

    #[test]
    fn means_are_exact_for_parabolas() {
        for (row, c) in MEANS.iter().zip(POINTS) {
            assert!((dot(row, &[1.0; STAGES]) - c).abs() < 1e-15);
            assert!((dot(row, &POINTS) - c * c / 2.0).abs() < 1e-15);
            assert!((dot(row, &POINTS.map(|at| at * at)) - c * c * c / 3.0).abs() < 1e-15);
        }
    }
}
