//! Forces of dry friction in a step.

use super::script::ResponseIntegrals;
use super::{FineLinks, SlideFrame};
use crate::island::fine::basis::{Instant, dot};
use crate::island::fine::laws::{GAUSS_POINTS, GAUSS_WEIGHTS, STAGES};

/// Most Newton steps for the forces of a step.
const NEWTON_STEPS: usize = 20;
/// Largest correction, as a share of the level, at which Newton steps end.
const CORRECTION_TOLERANCE: f64 = 1e-11;
/// Rounds over all links in the step that finishes a frame.
const FINISH_ROUNDS: usize = 60;
/// Work of a step for each link, in kicks of a contact.
const STEP_WORK: u64 = 8;
/// Work of a Newton step for each link, in kicks of a contact.
const NEWTON_WORK: u64 = 8;

impl FineLinks {
    /// Take a step of `h` from `s`.
    pub(super) fn step_frictions(&mut self, frame: SlideFrame<'_>, (s, h): (f64, f64), steps_left: &mut usize) {
        *steps_left = steps_left.saturating_sub(1);
        self.work.evaluations += STEP_WORK * frame.slide_script.links.len() as u64;
        self.solve_forces(frame, (s, h));
        self.push_ends(frame, (s, h));
    }

    /// Solve for the forces of all links in a step of `h` from `s`.
    pub(super) fn solve_forces(&mut self, frame: SlideFrame<'_>, (s, h): (f64, f64)) {
        if self.set_constant_forces(frame, s) {
            return;
        }
        let (script, n_dry) = (frame.script, frame.slide_script.links.len());
        let even_steps = self.even_steps(frame);
        let frictions = &mut self.frictions;
        if even_steps.is_even(h) {
            frictions
                .velocity_responses
                .copy_from_slice(&even_steps.velocity_responses);
        } else {
            let integrals = ResponseIntegrals::new(script, h);
            for (velocity_response, response) in frictions
                .velocity_responses
                .iter_mut()
                .zip(&frame.slide_script.responses)
            {
                *velocity_response = integrals.velocity_response(response);
            }
            self.work.products += (n_dry * n_dry * STAGES * STAGES * script.basis.n_polynomials()) as u64;
        }
        let gauss_instants = GAUSS_POINTS.map(|c| Instant::new(script.basis.n_polynomials(), s + c * h));
        for slide_index in 0..n_dry {
            let dry_link = frame.slide_script.links[slide_index];
            self.frictions.friction_links[slide_index].free_velocities =
                (gauss_instants.each_ref()).map(|instant| self.elongation(script, dry_link, instant)[1]);
        }
        for _ in 0..NEWTON_STEPS {
            let is_linear = self.set_up_equations(frame, s);
            let correction = self.correct_forces(frame, s);
            if is_linear || correction.is_none_or(|correction| correction <= CORRECTION_TOLERANCE) {
                break;
            }
        }
        for slide_index in 0..n_dry {
            let friction = self.friction(frame, (slide_index, s));
            let slide = &mut self.frictions.friction_links[slide_index];
            if slide.direction != 0.0 {
                // Friction takes energy and never gives any.
                let force_max = friction.level(0.0).max(friction.gate_opening * friction.dry_law.level);
                let bounded_magnitude = |force: f64| (slide.direction * force).clamp(0.0, force_max);
                slide.stage_forces = slide
                    .stage_forces
                    .map(|force| slide.direction * bounded_magnitude(force));
            }
        }
    }

    /// Set the forces of a step if every link slides at a level that does not depend on its velocity; returns whether
    /// that is so.
    fn set_constant_forces(&mut self, frame: SlideFrame<'_>, s: f64) -> bool {
        for slide_index in 0..frame.slide_script.links.len() {
            let friction = self.friction(frame, (slide_index, s));
            let slide = &mut self.frictions.friction_links[slide_index];
            if slide.direction == 0.0 || friction.dry_law.falls() {
                return false;
            }
            slide.stage_forces = [slide.direction * friction.level(0.0); STAGES];
        }
        true
    }

    /// Set up Newton's equations for corrections of all forces, one equation for each link and Gauss point: a holding
    /// link has no velocity, a sliding link gives its level. Returns whether the equations are linear.
    fn set_up_equations(&mut self, frame: SlideFrame<'_>, s: f64) -> bool {
        let n_dry = frame.slide_script.links.len();
        let row_width = STAGES * n_dry + 1;
        let mut equations = std::mem::take(&mut self.frictions.equations);
        let mut is_linear = true;
        for slide_index in 0..n_dry {
            let friction = self.friction(frame, (slide_index, s));
            let slide = &self.frictions.friction_links[slide_index];
            let link_responses = &self.frictions.velocity_responses[slide_index * n_dry..(slide_index + 1) * n_dry];
            let (direction, is_holding) = (slide.direction, slide.direction == 0.0);
            is_linear &= is_holding || !friction.dry_law.falls();
            for stage in 0..STAGES {
                let response_pairs = link_responses.iter().zip(&self.frictions.friction_links);
                let velocity_changes =
                    response_pairs.map(|(response, other)| dot(&response[stage], &other.stage_forces));
                let v = slide.free_velocities[stage] + velocity_changes.sum::<f64>();
                let row_index = STAGES * slide_index + stage;
                let equation_row = &mut equations[row_index * row_width..(row_index + 1) * row_width];
                let velocity_factor = if is_holding {
                    1.0
                } else {
                    -direction * friction.slope(v)
                };
                let responses = link_responses.iter().flat_map(|slide_response| slide_response[stage]);
                for (entry, response) in equation_row.iter_mut().zip(responses) {
                    *entry = velocity_factor * response;
                }
                if is_holding {
                    equation_row[row_width - 1] = -v;
                } else {
                    equation_row[row_index] += 1.0;
                    equation_row[row_width - 1] = direction * friction.level(v) - slide.stage_forces[stage];
                }
            }
        }
        self.frictions.equations = equations;
        is_linear
    }

    /// Correct all forces by the solution of the equations; returns the largest correction as a share of its level,
    /// `None` if there is no solution.
    fn correct_forces(&mut self, frame: SlideFrame<'_>, s: f64) -> Option<f64> {
        let n_forces = STAGES * frame.slide_script.links.len();
        self.work.evaluations += NEWTON_WORK * frame.slide_script.links.len() as u64;
        self.work.products += (n_forces * n_forces * n_forces / 3) as u64;
        eliminate(&mut self.frictions.equations, n_forces)?;
        let mut correction_max = 0.0_f64;
        for slide_index in 0..frame.slide_script.links.len() {
            let friction_level = self.friction(frame, (slide_index, s)).level(0.0);
            for stage in 0..STAGES {
                let correction = self.frictions.equations[(STAGES * slide_index + stage) * (n_forces + 1) + n_forces];
                self.frictions.friction_links[slide_index].stage_forces[stage] += correction;
                correction_max = correction_max.max(correction.abs() / friction_level.max(f64::MIN_POSITIVE));
            }
        }
        Some(correction_max)
    }

    /// Take the rest of a frame in one step, whatever ends in it. Each link gives one force, at most its level, that
    /// stops it by the end of the frame if it can, so friction takes energy at any step (J. J. Moreau, 1988).
    pub(super) fn finish_frame(&mut self, frame: SlideFrame<'_>, s: f64) {
        let (script, n_dry, frame_left) = (frame.script, frame.slide_script.links.len(), 1.0 - s);
        let n_instants = script.basis.n_polynomials();
        let times_to_end = GAUSS_POINTS.map(|c| Instant::new(n_instants, (1.0 - c) * frame_left));
        // The equations of a step are not needed any more: their room holds what the force of one link makes of the
        // velocity of each at the end of the frame.
        let mut compliances = std::mem::take(&mut self.frictions.equations);
        for (compliance, response) in compliances.iter_mut().zip(&frame.slide_script.responses) {
            let stage_terms = GAUSS_WEIGHTS.iter().zip(&times_to_end);
            let stage_terms = stage_terms.map(|(weight, time_to_end)| weight * dot(response, &time_to_end.values));
            *compliance = frame_left * script.rate.step() * stage_terms.sum::<f64>();
        }
        let end_instant = Instant::new(n_instants, 1.0);
        for slide_index in 0..n_dry {
            let [_, v] = self.elongation(script, frame.slide_script.links[slide_index], &end_instant);
            let slide = &mut self.frictions.friction_links[slide_index];
            (slide.free_velocities, slide.stage_forces, slide.has_held) = ([v; STAGES], [0.0; STAGES], false);
        }
        for _ in 0..FINISH_ROUNDS {
            for slide_index in 0..n_dry {
                let slides = &self.frictions.friction_links;
                let compliance_row = &compliances[slide_index * n_dry..(slide_index + 1) * n_dry];
                let push_velocities = compliance_row
                    .iter()
                    .zip(slides)
                    .map(|(compliance, other)| compliance * other.stage_forces[0]);
                let v = slides[slide_index].free_velocities[0] + push_velocities.sum::<f64>();
                let friction_level = self.friction(frame, (slide_index, s)).level(v);
                let stopping_force = slides[slide_index].stage_forces[0] - v / compliance_row[slide_index];
                if stopping_force.is_finite() {
                    self.frictions.friction_links[slide_index].stage_forces =
                        [stopping_force.clamp(-friction_level, friction_level); STAGES];
                }
            }
            self.work.evaluations += n_dry as u64;
        }
        self.frictions.equations = compliances;
        self.push_ends(frame, (s, frame_left));
    }

    /// Push the ends of all links by their forces in a step of `h` from `s`.
    fn push_ends(&mut self, frame: SlideFrame<'_>, (s, h): (f64, f64)) {
        for stage in 0..STAGES {
            let instant = Instant::new(frame.script.basis.n_polynomials(), s + GAUSS_POINTS[stage] * h);
            let stage_weight = GAUSS_WEIGHTS[stage] * h * frame.script.rate.step();
            for (slide_index, &link) in frame.slide_script.links.iter().enumerate() {
                let (first_joint, second_joint) = frame.script.link_joints[link];
                let impulse = stage_weight * self.frictions.friction_links[slide_index].stage_forces[stage];
                self.push_joint(frame.script, first_joint, impulse, &instant);
                self.push_joint(frame.script, second_joint, -impulse, &instant);
            }
        }
    }
}

/// Solve n linear equations in place (n, n + 1): the last column holds the right side, and then the solution. `None` if
/// there is no single solution.
fn eliminate(system: &mut [f64], n: usize) -> Option<()> {
    let row_width = n + 1;
    for column in 0..n {
        let entry_size = |row_index: &usize| system[row_index * row_width + column].abs();
        let pivot_row = (column..n).max_by(|row, other_row| entry_size(row).total_cmp(&entry_size(other_row)))?;
        if !(entry_size(&pivot_row) > 0.0 && entry_size(&pivot_row).is_finite()) {
            return None;
        }
        if pivot_row != column {
            let (rows_above, rows_below) = system.split_at_mut(pivot_row * row_width);
            rows_above[column * row_width..(column + 1) * row_width].swap_with_slice(&mut rows_below[..row_width]);
        }
        let (rows_above, rows_below) = system.split_at_mut((column + 1) * row_width);
        let diagonal_row = &rows_above[column * row_width..];
        for lower_row in rows_below.chunks_exact_mut(row_width) {
            let row_factor = lower_row[column] / diagonal_row[column];
            if row_factor != 0.0 {
                for (entry, pivot_entry) in lower_row[column..].iter_mut().zip(&diagonal_row[column..]) {
                    *entry -= row_factor * pivot_entry;
                }
            }
        }
    }
    for column in (0..n).rev() {
        let later_terms = (column + 1..n)
            .map(|later_column| system[column * row_width + later_column] * system[later_column * row_width + n]);
        let known_sum = later_terms.sum::<f64>();
        let diagonal_row = &mut system[column * row_width..(column + 1) * row_width];
        diagonal_row[n] = (diagonal_row[n] - known_sum) / diagonal_row[column];
    }
    let mut solution = system.iter().skip(n).step_by(row_width);
    solution.all(|x| x.is_finite()).then_some(())
}
