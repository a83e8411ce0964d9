//! Single laws between points, by collocation: over a part of a frame the force of each is the polynomial that meets
//! its law at the three Gauss points, with the exact linear motion of all else between them. The method is implicit, of
//! order 6, and dissipates what the laws dissipate at any slope (Hairer, Nørsett & Wanner, II.7).

mod root;
mod state;
mod tables;

use super::basis::{Instant, dot};
use super::{FineLinks, FineScript};
use crate::maths::pow;
use crate::state::ModuleState;
use root::{find_root, inverse};
use state::InstantLaw;
pub(super) use state::LawState;
use tables::FrameDivision;
pub(super) use tables::LawScript;
pub(super) use tables::lagrange_weights;

/// Number of Gauss points of a part of a frame.
pub(super) const STAGES: usize = 3;
/// Gauss points of a part of a frame, 0 to 1.
pub(super) const GAUSS_POINTS: [f64; STAGES] = [0.112_701_665_379_258_31, 0.5, 0.887_298_334_620_741_7];
/// Their weights.
pub(super) const GAUSS_WEIGHTS: [f64; STAGES] = [5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0];
/// Most rounds until all forces agree.
const ROUNDS_MAX: usize = 60;
/// Most rounds over a whole frame if it may be divided into parts.
const FRAME_ROUNDS_MAX: usize = 8;
/// Change of a force, relative to the largest, at which forces agree.
const FORCE_TOLERANCE: f64 = 1e-9;

/// A frame that may be divided is taken as a whole if the polynomial of its forces, through the Gauss points, deviates
/// from the laws at both ends of the frame by less than this share of the largest force. A larger value divides fewer
/// frames, but unequal steps lose the cancellation of errors that equal steps have (a cubic spring: -72 dB at 1e-3,
/// -104 dB with whole frames alone).
const DEVIATION_MAX: f64 = 1e-6;
/// Above this number of parts `DEVIATION_MAX` shrinks with the cube of the number. Otherwise a finer trial would divide
/// no frame further, and find no error.
const PARTS_UNSCALED_MAX: usize = 32;
/// Newton's method has failed if forces still change by more than this share of the largest.
const DIVERGED_CHANGE: f64 = 1e-3;
/// Rounds over laws that are solved by bisection.
const BISECTION_ROUNDS: usize = 20;
/// Share of the largest force that is kept from frame to frame.
const LARGEST_FORCE_DECAY: f64 = 0.999;

pub(super) type StageValues = [f64; STAGES];
pub(super) type StageMatrix = [StageValues; STAGES];

impl FineLinks {
    /// Compute the laws of a frame in which no contact is near.
    pub(super) fn collocate(&mut self, script: &FineScript, laws: &LawScript, gates: &[f64]) {
        self.laws.iter_mut().for_each(|state| state.extrapolate_forces(laws));
        let finest_index = laws.divisions.len() - 1;
        let round_limit = if finest_index == 0 {
            ROUNDS_MAX
        } else {
            FRAME_ROUNDS_MAX
        };
        let last_change = self.solve_law_forces(script, laws, (gates, 0), (0, round_limit));
        if finest_index == 0 {
            if last_change > DIVERGED_CHANGE {
                self.solve_by_bisection(script, laws, (gates, 0, 0));
            }
            return self.apply_law_forces(script, laws, (0, 0));
        }
        let has_converged = last_change == 0.0;
        let deviation = if has_converged {
            self.end_deviation(script, laws, gates)
        } else {
            1.0
        };
        if deviation <= laws.deviation_max {
            return self.apply_law_forces(script, laws, (0, 0));
        }
        // The deviation falls with the cube of the number of parts.
        let parts_needed = pow(deviation / laws.deviation_max, 1.0 / 3.0);
        let finer_index = laws
            .divisions
            .partition_point(|division| (division.n_parts as f64) < parts_needed);
        let division_index = finer_index.clamp(1, finest_index);
        let division = &laws.divisions[division_index];
        for state in &mut self.laws {
            let stage_shares = [0, 1, 2].map(|stage: usize| lagrange_weights(division.gauss_times[stage]));
            state.previous_forces = None;
            state.stage_forces = if has_converged {
                stage_shares.map(|row| dot(&row, &state.stage_forces))
            } else {
                [state.start_force; STAGES]
            };
        }
        for part in 0..division.n_parts {
            if part > 0 {
                for state in &mut self.laws {
                    state.extrapolate_forces(laws);
                }
            }
            for state in &mut self.laws {
                state.compute_stage_motion(division, part);
            }
            if self.solve_law_forces(script, laws, (gates, division_index), (part, ROUNDS_MAX)) > DIVERGED_CHANGE {
                self.solve_by_bisection(script, laws, (gates, division_index, part));
            }
            self.apply_law_forces(script, laws, (division_index, part));
            self.add_to_later_paths(script, division, part);
        }
        // Forces of parts of different lengths are not extrapolated together.
        self.laws.iter_mut().for_each(|state| state.previous_forces = None);
    }

    /// Solve for the forces of all laws in a part of a frame; returns their last change, relative to the largest, or 0
    /// if they agree.
    fn solve_law_forces(
        &mut self,
        script: &FineScript,
        laws: &LawScript,
        (gates, division_index): (&[f64], usize),
        (part, rounds): (usize, usize),
    ) -> f64 {
        let mut last_change = 0.0;
        for _ in 0..rounds {
            let mut round_change = 0.0_f64;
            for law in 0..laws.links.len() {
                round_change = round_change.max(self.newton_step(script, laws, (gates, division_index, part), law));
            }
            // Estimate of the change still to come, from the ratio of the last two rounds: Newton's method squares the
            // change of one law, several laws approach each other step by step.
            let change_ratio = round_change / last_change;
            let remaining_ratio = if laws.links.len() == 1 {
                change_ratio * change_ratio
            } else {
                change_ratio
            };
            if round_change <= FORCE_TOLERANCE
                || (change_ratio < 0.5 && round_change * remaining_ratio <= FORCE_TOLERANCE)
            {
                return 0.0;
            }
            last_change = round_change;
        }
        last_change
    }

    /// Find one force for each law over a part of a frame, equal to the law halfway, for laws so steep that Newton's
    /// method does not converge. It is of order 2; the force does not exceed the law, and its slope is not needed.
    fn solve_by_bisection(
        &mut self,
        script: &FineScript,
        laws: &LawScript,
        (gates, division_index, part): (&[f64], usize, usize),
    ) {
        const MIDDLE: usize = 1;
        let (n_laws, division) = (laws.links.len(), &laws.divisions[division_index]);
        let middle_instant = division.gauss_times[STAGES * part + MIDDLE];
        for state in &mut self.laws {
            // The last forces of Newton's method may be arbitrary.
            (state.stage_forces, state.previous_forces) = ([state.start_force; STAGES], None);
        }
        for _ in 0..BISECTION_ROUNDS {
            self.work.couplings += (n_laws * (n_laws - 1)) as u64;
            let mut round_change = 0.0_f64;
            for law in 0..n_laws {
                let state = &self.laws[law];
                let (mut e, mut v) = (state.stage_elongations[MIDDLE], state.stage_rates[MIDDLE]);
                let mut self_response = [0.0; 2];
                let state_responses = self.laws.iter().zip(&division.force_responses[law * n_laws..]);
                for (other, (state, [e_stages, v_stages])) in state_responses.enumerate() {
                    let [e_response, v_response] =
                        [e_stages, v_stages].map(|response| response[MIDDLE].iter().sum::<f64>());
                    if other == law {
                        self_response = [e_response, v_response];
                    } else {
                        e += e_response * state.stage_forces[MIDDLE];
                        v += v_response * state.stage_forces[MIDDLE];
                    }
                }
                let law_now = self.law_at(script, laws, gates, (law, middle_instant));
                let part_length = 1.0 / division.n_parts as f64;
                let midpoint_motion = |f: f64| {
                    (
                        e + self_response[0] * f,
                        (v + self_response[1] * f) * law_now.rate_factor(),
                    )
                };
                let force_residual = |f: f64| {
                    let (e, v) = midpoint_motion(f);
                    f - law_now.midpoint_force(e, v, part_length)
                };
                let old_force = state.stage_forces[MIDDLE];
                let (force, evaluations) = find_root(&force_residual, old_force);
                self.work.evaluations += evaluations / STAGES as u64;
                round_change = round_change.max((force - old_force).abs() - FORCE_TOLERANCE * force.abs());
                if let Some(bristle_law) = law_now.bristle() {
                    let (_, v) = midpoint_motion(force);
                    let deflection =
                        bristle_law.midpoint_deflection(law_now.deflection, v, part_length / law_now.rate_factor());
                    self.laws[law].end_deflection = 2.0 * deflection - law_now.deflection;
                }
                self.laws[law].stage_forces = [force; STAGES];
            }
            if round_change <= 0.0 {
                break;
            }
        }
    }

    /// Push by the forces that were found for a part of a frame.
    fn apply_law_forces(&mut self, script: &FineScript, laws: &LawScript, (division_index, part): (usize, usize)) {
        let (n_instants, division) = (script.basis.n_polynomials(), &laws.divisions[division_index]);
        let part_seconds = script.rate.step() / division.n_parts as f64;
        for (state, &link) in self.laws.iter_mut().zip(&laws.links) {
            let (first_joint, second_joint) = script.link_joints[link];
            let first_stage = 3 * part;
            let stage_forces = GAUSS_WEIGHTS.iter().zip(&state.stage_forces);
            for (stage, (weight, force)) in stage_forces.enumerate() {
                let impulse = weight * part_seconds * force;
                let weight_row =
                    &division.interpolation[(first_stage + stage) * n_instants..(first_stage + stage + 1) * n_instants];
                for (instant, share) in weight_row.iter().enumerate() {
                    self.frame_impulses[first_joint * n_instants + instant] += impulse * share;
                    self.frame_impulses[second_joint * n_instants + instant] -= impulse * share;
                }
            }
            let part_peak = state
                .stage_forces
                .iter()
                .fold(0.0_f64, |greatest, force| greatest.max(force.abs()));
            state.start_deflection = state.end_deflection;
            state.largest_force =
                part_peak.max(if part == 0 { LARGEST_FORCE_DECAY } else { 1.0 } * state.largest_force);
        }
    }

    /// Add the effect of a part's forces to the paths of the laws in later parts.
    fn add_to_later_paths(&mut self, script: &FineScript, division: &FrameDivision, part: usize) {
        let (n_instants, n_laws) = (script.basis.n_polynomials(), self.laws.len());
        let part_seconds = script.rate.step() / division.n_parts as f64;
        self.work.products += (n_laws * n_laws * STAGES * n_instants) as u64;
        for to_law in 0..n_laws {
            let mut law_path = std::mem::take(&mut self.laws[to_law].relative_path);
            for (from_law, source_law) in self.laws.iter().enumerate() {
                let later_index = (to_law * n_laws + from_law) * division.n_parts + part;
                let later_rows =
                    &division.later_responses[3 * later_index * n_instants..3 * (later_index + 1) * n_instants];
                for (stage, row) in later_rows.chunks(n_instants).enumerate() {
                    let impulse = GAUSS_WEIGHTS[stage] * part_seconds * source_law.stage_forces[stage];
                    for (x, response) in law_path.iter_mut().zip(row) {
                        *x += impulse * response;
                    }
                }
            }
            self.laws[to_law].relative_path = law_path;
        }
    }

    /// Deviation of the forces of a whole frame from their laws at its two ends, relative to the largest.
    fn end_deviation(&mut self, script: &FineScript, laws: &LawScript, gates: &[f64]) -> f64 {
        let n_laws = laws.links.len();
        let mut deviation_max = 0.0_f64;
        for law_index in 0..n_laws {
            let state = &self.laws[law_index];
            let [path_end, mut v] = [0, 1].map(|order| dot(&laws.end_interpolation[order], &state.relative_path));
            let mut e = state.elongation_offset + path_end;
            for (other_law, [position_response, velocity_response]) in
                self.laws.iter().zip(&laws.end_responses[law_index * n_laws..])
            {
                e += dot(position_response, &other_law.stage_forces);
                v += dot(velocity_response, &other_law.stage_forces);
            }
            let law_at_end = InstantLaw {
                deflection: state.end_deflection,
                ..self.law_at(script, laws, gates, (law_index, 1.0))
            };
            let end_forces = [state.start_force, law_at_end.force(e, v * law_at_end.rate_factor())];
            let force_scale = (state.stage_forces.iter().chain(&end_forces))
                .fold(state.largest_force, |largest_yet, force| largest_yet.max(force.abs()));
            for (row, force) in laws.end_extrapolation.iter().zip(end_forces) {
                let end_deviation = (dot(row, &state.stage_forces) - force).abs();
                deviation_max = deviation_max.max(end_deviation / force_scale.max(f64::MIN_POSITIVE));
            }
        }
        self.work.evaluations += n_laws as u64;
        self.work.couplings += (n_laws * (n_laws - 1)) as u64;
        deviation_max
    }

    /// Newton's step for the forces of one law, with those of all others given; returns the change, relative to the
    /// largest.
    fn newton_step(
        &mut self,
        script: &FineScript,
        laws: &LawScript,
        (gates, division_index, part): (&[f64], usize, usize),
        law: usize,
    ) -> f64 {
        let n_laws = laws.links.len();
        let division = &laws.divisions[division_index];
        let (mut e, mut v) = (self.laws[law].stage_elongations, self.laws[law].stage_rates);
        for (other_law, [position_response, velocity_response]) in
            self.laws.iter().zip(&division.force_responses[law * n_laws..])
        {
            for stage in 0..STAGES {
                e[stage] += dot(&position_response[stage], &other_law.stage_forces);
                v[stage] += dot(&velocity_response[stage], &other_law.stage_forces);
            }
        }
        let stage_laws =
            [0, 1, 2].map(|stage| self.law_at(script, laws, gates, (law, division.gauss_times[3 * part + stage])));
        let part_length = 1.0 / division.n_parts as f64;
        self.work.evaluations += 1;
        self.work.couplings += n_laws as u64 - 1;
        let rate = stage_laws[0].rate_factor();
        let v = v.map(|v| v * rate);
        let state = &mut self.laws[law];
        let self_responses = &division.force_responses[law * n_laws + law];
        let (law_forces, residual_slopes) =
            state.forces_and_slopes(&stage_laws, (&e, &v), (part_length, self_responses));
        let residuals: StageValues = std::array::from_fn(|stage| law_forces[stage] - state.stage_forces[stage]);
        let newton_step = inverse(&residual_slopes).map(|row| dot(&row, &residuals));
        let (mut force_change, mut force_scale) = (0.0_f64, f64::MIN_POSITIVE);
        for stage in 0..STAGES {
            state.stage_forces[stage] += newton_step[stage];
            force_change = force_change.max(newton_step[stage].abs());
            force_scale = force_scale.max(law_forces[stage].abs());
        }
        force_change / force_scale
    }

    /// Compute elongation, rate and force of each law at the start of the frame, but not the force of an expression if
    /// the frame is collocated: `collocate` computes it together with those at the Gauss points.
    pub(super) fn start_laws(&mut self, script: &FineScript, laws: &LawScript, gates: &[f64], is_collocated: bool) {
        let n_instants = script.basis.n_polynomials();
        for (law_index, &link) in laws.links.iter().enumerate() {
            let ((a, b), rest_length) = (script.link_joints[link], script.links[link].rest);
            let [a, b] = [a, b].map(|end| &self.free_paths[end * n_instants..(end + 1) * n_instants]);
            let law_now = self.law_at(script, laws, gates, (law_index, 0.0));
            let state = &mut self.laws[law_index];
            state.elongation_offset = b[0] - a[0] - rest_length;
            for ((x, a), b) in state.relative_path.iter_mut().zip(a).zip(b) {
                *x = b - a - rest_length - state.elongation_offset;
            }
            let [e, v] = state.compute_stage_motion(&laws.divisions[0], 0);
            state.start_motion = [e, v * law_now.rate_factor()];
            if !(is_collocated && law_now.is_expression()) {
                state.start_force = law_now.force(state.start_motion[0], state.start_motion[1]);
            }
        }
    }

    /// Write the force of each law at the start of the frame into `modules.link_forces`.
    pub(super) fn write_start_forces(&self, script: &FineScript, laws: &LawScript, modules: &mut ModuleState) {
        for (state, &link) in self.laws.iter().zip(&laws.links) {
            modules.link_forces[script.links[link].first_link] = state.start_force;
        }
    }

    /// A law as it is at an instant of this frame.
    fn law_at<'a>(
        &self,
        script: &'a FineScript,
        laws: &LawScript,
        gates: &[f64],
        (law_index, s): (usize, f64),
    ) -> InstantLaw<'a> {
        let law_link = laws.links[law_index];
        let link_run = &script.links[law_link];
        let [k, z] = self.link_constants_at(law_link, s);
        InstantLaw {
            kind: &link_run.kind,
            gate_opening: link_run.gate.map_or(1.0, |gate| gates[gate]),
            k,
            z,
            deflection: self.laws[law_index].start_deflection,
        }
    }

    /// Move the bristles of laws on by `h` frames, at the rate of their ends at an instant of a frame of contacts.
    pub(super) fn slide_bristles(
        &mut self,
        script: &FineScript,
        (laws, gates): (&LawScript, &[f64]),
        (instant, h): (&Instant, f64),
    ) {
        for law_index in 0..laws.links.len() {
            let law_now = self.law_at(script, laws, gates, (law_index, instant.s));
            if let Some(bristle_law) = law_now.bristle() {
                let [_, elongation_rate] = self.elongation(script, laws.links[law_index], instant);
                self.laws[law_index].start_deflection = bristle_law.slide(
                    law_now.deflection,
                    elongation_rate * law_now.rate_factor(),
                    h / law_now.rate_factor(),
                );
            }
        }
    }

    /// Elongation of a link [m] and its rate [m/frame].
    pub(super) fn elongation(&self, script: &FineScript, link: usize, instant: &Instant) -> [f64; 2] {
        let n_instants = script.basis.n_polynomials();
        let (a, b) = script.link_joints[link];
        let [a, b] = [a, b].map(|end| &self.paths[end * n_instants..(end + 1) * n_instants]);
        let e = dot(b, &instant.values) - dot(a, &instant.values) - script.links[link].rest;
        [e, dot(b, &instant.slopes) - dot(a, &instant.slopes)]
    }

    /// A kick of a law that lasts `duration` frames, in a frame of contacts.
    pub(super) fn kick_law(
        &mut self,
        script: &FineScript,
        (laws, gates): (&LawScript, &[f64]),
        law: usize,
        (instant, duration): (&Instant, f64),
    ) {
        let law_link = laws.links[law];
        const KICK_ROUNDS: usize = 4;
        let [e, v] = self.elongation(script, law_link, instant);
        let (first_joint, second_joint) = script.link_joints[law_link];
        let pair_jump = script.velocity_jump(first_joint, second_joint);
        let (law_now, time_step) = (self.law_at(script, laws, gates, (law, instant.s)), script.rate.step());
        let mut impulse = 0.0;
        for _ in 0..KICK_ROUNDS {
            // The rate halfway through the kick.
            let v = v - 0.5 * pair_jump * impulse;
            impulse = duration * time_step * law_now.force(e, v * law_now.rate_factor());
        }
        self.work.evaluations += 1;
        self.push_joint(script, first_joint, impulse, instant);
        self.push_joint(script, second_joint, -impulse, instant);
    }
}
