//! One law: its forces and slopes at the Gauss points, and the state that it keeps from frame to frame.

use super::tables::{FrameDivision, LawScript, MotionWeights};
use super::{GAUSS_WEIGHTS, STAGES, StageMatrix, StageValues, inverse};
use crate::island::fine::FineScript;
use crate::island::fine::basis::dot;
use crate::law::{PLACES, Places, TangentScratch};
use crate::network::Bristle;
use crate::scheme::LinkRunKind;

/// Forces are extrapolated from two parts if that guess deviates from the one of a single part by shares of the largest
/// force between these: after a strike it would be far off, in a steady slide it amplifies rounding errors.
const EXTRAPOLATION_RANGE: std::ops::Range<f64> = 1e-8..0.1;

/// Integrals up to each Gauss point, as weights of the rates at the Gauss points, in parts (Gauss's method of order 6).
const INTEGRAL_WEIGHTS: StageMatrix = [
    [5.0 / 36.0, -0.035_976_667_524_938_9, 0.009_789_444_015_308_324],
    [0.300_263_194_980_864_6, 2.0 / 9.0, -0.022_485_417_203_086_813],
    [0.267_988_333_762_469_43, 0.480_421_111_969_383_3, 5.0 / 36.0],
];

/// The state of a running law.
#[derive(Clone, Debug, Default)]
pub(in crate::island::fine) struct LawState {
    /// Forces at the Gauss points of a part [N].
    pub(super) stage_forces: [f64; STAGES],
    /// Forces of the part before, if it was as long [N].
    pub(super) previous_forces: Option<StageValues>,
    /// Elongations at the Gauss points without the forces of that part [m].
    pub(super) stage_elongations: [f64; STAGES],
    /// Rates of these elongations [m/frame].
    pub(super) stage_rates: [f64; STAGES],
    /// Deflection of its bristles at the start of a part [m].
    pub(super) start_deflection: f64,
    /// Deflection of its bristles at the end of a part [m].
    pub(super) end_deflection: f64,
    /// Deflection of its bristles before a step that may be repeated [m].
    pub(super) saved_deflection: f64,
    /// Elongation and its rate at the start of the frame [m, m/s].
    pub(super) start_motion: [f64; 2],
    /// Force at the start of the frame [N].
    pub(super) start_force: f64,
    /// The largest force of the last frames [N].
    pub(super) largest_force: f64,
    /// Elongation at the first instant of the frame, from which `relative_path` is counted: so the rate of a link at
    /// rest is exactly 0 [m].
    pub(super) elongation_offset: f64,
    /// Elongation at the instants of the frame, less `elongation_offset`, if the forces of the parts to come are zero
    /// [m]   (n)
    pub(super) relative_path: Vec<f64>,
    pub(super) scratch: TangentScratch,
}

crate::archive::option!(StageValues, optional);
crate::archive::state!(LawState {
    stage_forces,
    previous_forces,
    stage_elongations,
    stage_rates,
    start_deflection,
    start_force,
    largest_force,
});

/// A law at one instant.
#[derive(Clone, Copy)]
pub(super) struct InstantLaw<'a> {
    pub(super) kind: &'a LinkRunKind,
    /// How far its gate is open.
    pub(super) gate_opening: f64,
    /// K and Z of a law for which they are led: [N/m, N·frame/m].
    pub(super) k: f64,
    pub(super) z: f64,
    /// Deflection of its bristles [m].
    pub(super) deflection: f64,
}

impl InstantLaw<'_> {
    /// Factor from a rate of elongation [m/frame] to the rate that the law takes.
    pub(super) fn rate_factor(&self) -> f64 {
        match self.kind {
            LinkRunKind::Lnl { velocity_factor, .. } | LinkRunKind::Bristle { velocity_factor, .. } => *velocity_factor,
            _ => 1.0,
        }
    }

    /// Whether it is an LNL, whose force at the start of a frame is computed together with those at the Gauss points.
    pub(super) fn is_expression(&self) -> bool {
        matches!(self.kind, LinkRunKind::Lnl { .. })
    }

    /// Its force at an elongation and a rate [N].
    pub(super) fn force(&self, e: f64, v: f64) -> f64 {
        let full_force = match self.kind {
            LinkRunKind::Lnl { law, .. } => law.force(e, v),
            LinkRunKind::Bristle { law: bristle_law, .. } => bristle_law
                .with_stiffness_and_level(self.k, self.z)
                .force(self.deflection, v),
            LinkRunKind::Hardening(q) => self.k * e + q * e * e * e + self.z * v,
            _ => 0.0,
        };
        self.gate_opening * full_force
    }

    /// Its bristles as they are at this instant; `None` for other laws.
    pub(super) fn bristle(&self) -> Option<Bristle> {
        match self.kind {
            LinkRunKind::Bristle { law: bristle_law, .. } => Some(bristle_law.with_stiffness_and_level(self.k, self.z)),
            _ => None,
        }
    }

    /// Its force halfway through `h` frames of constant elongation and rate.
    pub(super) fn midpoint_force(&self, e: f64, v: f64, h: f64) -> f64 {
        match self.bristle() {
            Some(bristle_law) => {
                let deflection = bristle_law.midpoint_deflection(self.deflection, v, h / self.rate_factor());
                Self { deflection, ..*self }.force(e, v)
            }
            None => self.force(e, v),
        }
    }
}

impl LawScript {
    pub(in crate::island::fine) fn build_states(&self, script: &FineScript) -> Vec<LawState> {
        let state = |&link: &usize| {
            let mut state = LawState {
                relative_path: vec![0.0; script.basis.n_polynomials()],
                ..LawState::default()
            };
            if let LinkRunKind::Lnl { law, .. } = &script.links[link].kind {
                state.scratch = law.tangent_scratch();
            }
            state
        };
        self.links.iter().map(state).collect()
    }
}

impl LawState {
    /// Take over the state of the same law in another version.
    pub(in crate::island::fine) fn continue_from(&mut self, old: &Self) {
        (self.stage_forces, self.stage_elongations, self.stage_rates) =
            (old.stage_forces, old.stage_elongations, old.stage_rates);
        (self.start_force, self.largest_force, self.start_deflection) =
            (old.start_force, old.largest_force, old.start_deflection);
        self.previous_forces = old.previous_forces;
    }

    /// Deflection of its bristles at the start of a frame [m].
    pub(in crate::island::fine) fn bristle_at_start(&self) -> f64 {
        self.start_deflection
    }

    pub(in crate::island::fine) fn set_bristle_deflection(&mut self, deflection: f64) {
        self.start_deflection = deflection;
    }

    /// Do not extrapolate from parts that were longer than those to come.
    pub(in crate::island::fine) fn forget_previous_forces(&mut self) {
        self.previous_forces = None;
    }

    /// Save what a step changes, if it may be repeated.
    pub(in crate::island::fine) fn save(&mut self) {
        self.saved_deflection = self.start_deflection;
    }

    /// Undo the last step.
    pub(in crate::island::fine) fn restore(&mut self) {
        self.start_deflection = self.saved_deflection;
    }

    /// Compute elongations and rates at the Gauss points of a part from the path; returns those at the start of the
    /// frame.
    pub(super) fn compute_stage_motion(&mut self, division: &FrameDivision, part: usize) -> [f64; 2] {
        let n_instants = self.relative_path.len();
        let mut stage_motion: MotionWeights = [0.0; 2 * STAGES + 2];
        for (x, weights) in self
            .relative_path
            .iter()
            .zip(&division.motion_weights[part * n_instants..])
        {
            for (stage_value, weight) in stage_motion.iter_mut().zip(weights) {
                *stage_value += x * weight;
            }
        }
        let [x1, x2, x3, v1, v2, v3, start_elongation, start_rate] = stage_motion;
        (self.stage_elongations, self.stage_rates) = ([x1, x2, x3].map(|x| self.elongation_offset + x), [v1, v2, v3]);
        [self.elongation_offset + start_elongation, start_rate]
    }

    /// Extrapolate the forces of the last parts to the next.
    pub(super) fn extrapolate_forces(&mut self, laws: &LawScript) {
        let last_part_guess = laws.extrapolation.map(|row| dot(&row, &self.stage_forces));
        let two_part_guess = self.previous_forces.map_or(last_part_guess, |previous_forces| {
            let previous_terms = laws.extrapolation_from_previous.map(|row| dot(&row, &previous_forces));
            let last_terms = laws.extrapolation_from_last.map(|row| dot(&row, &self.stage_forces));
            std::array::from_fn(|stage| previous_terms[stage] + last_terms[stage])
        });
        let guess_spread = (two_part_guess.iter().zip(&last_part_guess))
            .fold(0.0_f64, |largest_yet, (two_part_force, last_part_force)| {
                largest_yet.max((two_part_force - last_part_force).abs())
            });
        let uses_two_parts = EXTRAPOLATION_RANGE.contains(&(guess_spread / self.largest_force));
        self.previous_forces = Some(self.stage_forces);
        self.stage_forces = if uses_two_parts {
            two_part_guess
        } else {
            last_part_guess
        };
    }

    /// Forces of the law at three instants of a part of `h` frames [N], and the derivative of what they leave unmet by
    /// the forces that are assumed, to which elongation and rate respond by `x_response` and `v_response`.
    pub(super) fn forces_and_slopes(
        &mut self,
        stage_laws: &[InstantLaw<'_>; STAGES],
        (e, v): (&StageValues, &StageValues),
        (h, [x_response, v_response]): (f64, &[StageMatrix; 2]),
    ) -> (StageValues, StageMatrix) {
        let rate = stage_laws[0].rate_factor();
        if let Some(bristle_forces) = BristleForces::new(stage_laws, v, h) {
            self.end_deflection = bristle_forces.end_deflection;
            // A rate at one instant bends the bristles at all later instants.
            let residual_slope = |stage: usize, column: usize| {
                let slope_product =
                    |source_stage: usize| bristle_forces.slopes[stage][source_stage] * v_response[source_stage][column];
                identity_entry(stage, column) - rate * (0..STAGES).map(slope_product).sum::<f64>()
            };
            return (bristle_forces.forces, build_matrix(residual_slope));
        }
        let (force, k, z) = self.tangents(stage_laws, e, v);
        let residual_slope = |stage: usize, column: usize| {
            let (x_response, v_response) = (x_response[stage][column], v_response[stage][column]);
            identity_entry(stage, column) - k[stage] * x_response - z[stage] * rate * v_response
        };
        (force, build_matrix(residual_slope))
    }

    /// Forces of a law without bristles, and its slopes in the elongation and in its rate [N/m, N·s/m].
    fn tangents(
        &mut self,
        stage_laws: &[InstantLaw<'_>; STAGES],
        e: &StageValues,
        v: &StageValues,
    ) -> (StageValues, StageValues, StageValues) {
        match stage_laws[0].kind {
            LinkRunKind::Lnl { law, .. } => {
                // The law at the start of the frame takes the last place.
                let with_start = |stage_values: &StageValues, start: f64| -> Places {
                    std::array::from_fn(|place| stage_values.get(place).copied().unwrap_or(start))
                };
                let (d, v) = (with_start(e, self.start_motion[0]), with_start(v, self.start_motion[1]));
                let tangents = law.tangents(&d, &v, &mut self.scratch);
                let gate_opening = stage_laws[0].gate_opening;
                self.start_force = gate_opening * tangents.force[PLACES - 1];
                let [force, k, z] = [tangents.force, tangents.by_d, tangents.by_v]
                    .map(|values| [0, 1, 2].map(|stage: usize| gate_opening * values[stage]));
                (force, k, z)
            }
            LinkRunKind::Hardening(q) => {
                let k = |stage: usize| {
                    let stage_law = &stage_laws[stage];
                    stage_law.gate_opening * (stage_law.k + 3.0 * q * e[stage] * e[stage])
                };
                let force = [0, 1, 2].map(|stage| stage_laws[stage].force(e[stage], v[stage]));
                let z = stage_laws
                    .each_ref()
                    .map(|stage_law| stage_law.gate_opening * stage_law.z);
                (force, [0, 1, 2].map(k), z)
            }
            _ => Default::default(),
        }
    }
}

/// Bristles over a part of a frame.
struct BristleForces {
    forces: StageValues,
    /// Bend at the end of the part [m].
    end_deflection: f64,
    /// Derivatives of the forces by the rates of the ends at each instant [N·s/m].
    slopes: StageMatrix,
}

impl BristleForces {
    /// Bristles at three instants of a part of `h` frames, from the rates of their ends there [m/s]; `None` for other
    /// laws.
    fn new(stage_laws: &[InstantLaw<'_>; STAGES], v: &StageValues, h: f64) -> Option<Self> {
        let bristles = [
            stage_laws[0].bristle()?,
            stage_laws[1].bristle()?,
            stage_laws[2].bristle()?,
        ];
        let (start_deflection, h) = (stage_laws[0].deflection, h / stage_laws[0].rate_factor());
        let relaxation_pairs = [0, 1, 2].map(|stage: usize| bristles[stage].relaxation_and_slope(v[stage]));
        let relaxation_rates = relaxation_pairs.map(|(relaxation_rate, _)| relaxation_rate);
        let decay_matrix = build_matrix(|stage, column| {
            identity_entry(stage, column) + h * INTEGRAL_WEIGHTS[stage][column] * relaxation_rates[column]
        });
        let decay_matrix = inverse(&decay_matrix);
        let free_deflections = INTEGRAL_WEIGHTS.map(|row| start_deflection + h * dot(&row, v));
        let stage_deflections = decay_matrix.map(|row| dot(&row, &free_deflections));
        let deflection_rates: StageValues =
            std::array::from_fn(|stage| v[stage] - relaxation_rates[stage] * stage_deflections[stage]);
        // Slope of the rate of each bend over the rate of its ends.
        let rate_slopes: StageValues =
            std::array::from_fn(|stage| 1.0 - relaxation_pairs[stage].1 * stage_deflections[stage]);
        let stage_force = |stage: usize| {
            stage_laws[stage].gate_opening
                * bristles[stage].force_at_relaxation(stage_deflections[stage], v[stage], relaxation_rates[stage])
        };
        let stage_slope = |stage: usize, source_stage: usize| {
            let deflection = (0..STAGES)
                .map(|inner_stage| decay_matrix[stage][inner_stage] * h * INTEGRAL_WEIGHTS[inner_stage][source_stage]);
            let deflection = deflection.sum::<f64>() * rate_slopes[source_stage];
            let bristles = &bristles[stage];
            let force_per_deflection = bristles.stiffness - bristles.damping * relaxation_rates[stage];
            let force_per_rate = bristles.damping * rate_slopes[source_stage] + bristles.viscosity;
            stage_laws[stage].gate_opening
                * (force_per_deflection * deflection + identity_entry(stage, source_stage) * force_per_rate)
        };
        Some(Self {
            forces: std::array::from_fn(stage_force),
            end_deflection: start_deflection + h * dot(&GAUSS_WEIGHTS, &deflection_rates),
            slopes: build_matrix(stage_slope),
        })
    }
}

fn identity_entry(row: usize, column: usize) -> f64 {
    f64::from(u8::from(row == column))
}

fn build_matrix(entry_at: impl Fn(usize, usize) -> f64) -> StageMatrix {
    std::array::from_fn(|row| std::array::from_fn(|column| entry_at(row, column)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::island::fine::laws::GAUSS_POINTS;

    #[test]
    fn means_of_parabolas_are_exact() {
        for (row, c) in INTEGRAL_WEIGHTS.iter().zip(GAUSS_POINTS) {
            assert!((dot(row, &[1.0; STAGES]) - c).abs() < 1e-15);
            assert!((dot(row, &GAUSS_POINTS) - c * c / 2.0).abs() < 1e-15);
            assert!((dot(row, &GAUSS_POINTS.map(|at| at * at)) - c * c * c / 3.0).abs() < 1e-15);
        }
    }
}
