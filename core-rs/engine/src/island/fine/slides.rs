//! Dry friction between frames: each link slides one way or holds, until an event that is located.
//!
//! Between two events the force of each link is a polynomial through the Gauss points of a step, as for laws (`laws`).
//! A sliding link gives its level against its velocity. A holding link gives the force that keeps its velocity at zero.
//! A slide ends when its velocity passes zero, and a hold ends when it needs more than the level near rest. A step in
//! which one of them ends is repeated up to that instant. `forces` solves for the forces of a step, `script` holds what
//! is constant.

mod forces;
mod script;

use std::sync::Arc;

use super::basis::{Instant, dot};
use super::laws::{STAGES, StageMatrix, StageValues, lagrange_weights};
use super::{FineLinks, FineScript};
use crate::network::Dry;
use crate::scheme::Scheme;
use crate::state::ModuleState;
use script::{EvenSteps, SlideScript};

/// Most steps tried in a frame, before one step takes the rest of it.
const STEPS_MAX: usize = 256;
/// An event is located when its instant moves by less than this share of the step.
const EVENT_TOLERANCE: f64 = 1e-13;
/// Most steps to locate an event.
const LOCATE_STEPS_MAX: usize = 60;
/// A rest of a frame below this share of the frame is skipped.
const SKIPPED_SHARE: f64 = 1e-9;
/// A velocity counts as zero below this share of what friction can take from it in a frame: the basis gives the
/// velocity of a held mass to a small part of that.
const STILL_SHARE: f64 = 1e-4;
/// The same for a link that held at the end of the last frame: a hold has no velocity at the Gauss points of its last
/// step, but some after them. A string that held a mass had 1e-3; without this it slid and stopped again in every
/// frame.
const STILL_SHARE_HELD: f64 = 1e-2;
/// A hold ends if it needs more than its level by this share.
const EXCESS_SHARE: f64 = 1e-9;

/// Dry friction of an island.
#[derive(Clone, Debug)]
pub(super) struct Frictions {
    pub(super) script: Arc<SlideScript>,
    /// The links as they are in this step   (n_dry)
    friction_links: Vec<FrictionLink>,
    /// Responses of the velocities to the forces in this step, as in [`script::EvenSteps::velocity_responses`]
    /// (n_dry²)
    velocity_responses: Vec<StageMatrix>,
    /// Equations for the forces in this step   (3·n_dry, 3·n_dry + 1)
    equations: Vec<f64>,
}

/// One link in a step.
#[derive(Clone, Copy, Debug, Default)]
struct FrictionLink {
    /// The sign of its velocity; 0: it holds.
    direction: f64,
    /// Forces at the Gauss points [N].
    stage_forces: StageValues,
    /// Velocities at the Gauss points without friction in this step [m/frame].
    free_velocities: StageValues,
    /// Whether the instant of its event in this step is known.
    is_instant_known: bool,
    /// Whether it has held since the start of the frame, and the positions of its ends at that time [m].
    has_held: bool,
    start_positions: [f64; 2],
}

/// What all steps of a frame use.
#[derive(Clone, Copy)]
pub(super) struct SlideFrame<'a> {
    pub(super) script: &'a FineScript,
    pub(super) slide_script: &'a SlideScript,
    pub(super) gates: &'a [f64],
}

/// The friction of a link at an instant.
struct Friction {
    dry_law: Dry,
    /// Frames a second.
    frame_rate: f64,
    /// How far its gate is open.
    gate_opening: f64,
}

impl Friction {
    /// Level at a velocity [m/frame].
    fn level(&self, v: f64) -> f64 {
        self.gate_opening * self.dry_law.level_at(v * self.frame_rate)
    }

    /// Change of the level with the velocity [N·frame/m].
    fn slope(&self, v: f64) -> f64 {
        self.gate_opening * self.frame_rate * self.dry_law.slope_at(v * self.frame_rate)
    }
}

impl Frictions {
    pub(super) fn new(script: &FineScript) -> Self {
        let slide_script = SlideScript::new(script);
        let n_dry = slide_script.links.len();
        let n_forces = STAGES * n_dry;
        Self {
            friction_links: vec![FrictionLink::default(); n_dry],
            velocity_responses: vec![StageMatrix::default(); n_dry * n_dry],
            equations: vec![0.0; n_forces * (n_forces + 1)],
            script: Arc::new(slide_script),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.friction_links.is_empty()
    }
}

impl FineLinks {
    /// Compute the frictions of a frame.
    pub(super) fn compute_frictions(&mut self, frame: SlideFrame<'_>, modules: &mut ModuleState) {
        self.has_contact_closed = true;
        self.begin_frame(frame, modules);
        self.slide_to_end(frame);
        for (slide, &link) in self.frictions.friction_links.iter().zip(&frame.slide_script.links) {
            self.has_rested[link] = slide.direction == 0.0;
        }
    }

    /// Compute a frame event by event.
    fn slide_to_end(&mut self, frame: SlideFrame<'_>) {
        let (mut instant_now, mut steps_left) = (0.0, STEPS_MAX);
        while instant_now < 1.0 {
            if steps_left == 0 {
                self.finish_frame(frame, instant_now);
                return;
            }
            let [saved_paths, saved_sums] = &mut self.saved_paths_and_sums;
            saved_paths.copy_from_slice(&self.paths);
            saved_sums.copy_from_slice(&self.impulse_sums);
            let mut length_taken = self.even_steps(frame).length(instant_now);
            self.step_frictions(frame, (instant_now, length_taken), &mut steps_left);
            let slides = &mut self.frictions.friction_links;
            slides.iter_mut().for_each(|slide| slide.is_instant_known = false);
            let mut located_link = None;
            while let Some(ended_slide) = self.first_ended_link(frame, instant_now + length_taken) {
                length_taken = self.locate_end(frame, (instant_now, length_taken, ended_slide), &mut steps_left);
                self.frictions.friction_links[ended_slide].is_instant_known = true;
                located_link = Some(ended_slide);
            }
            instant_now += length_taken;
            if 1.0 - instant_now < SKIPPED_SHARE {
                return;
            }
            if let Some(ended_slide) = located_link {
                let slide = &mut self.frictions.friction_links[ended_slide];
                slide.has_held = false;
                slide.direction = match slide.direction {
                    0.0 => dot(&lagrange_weights(1.0), &slide.stage_forces).signum(),
                    _ => 0.0,
                };
                self.settle_holds(frame, instant_now);
            }
        }
    }

    /// Let masses rest exactly that a fixed point has held throughout the frame: rounding alone would leave a step.
    pub(in crate::island) fn stop_held_masses(&self, scheme: &Scheme, modules: &mut ModuleState) {
        let dry_links = self.frictions.script.links.iter();
        let slides = self.frictions.friction_links.iter().zip(dry_links);
        for (slide, &link) in slides.filter(|(slide, _)| slide.has_held) {
            let link_run = &self.script.links[link];
            let (first_joint, second_joint) = self.script.link_joints[link];
            let [x_a, x_b] = slide.start_positions;
            for (mass, joint, other_mat, x) in [
                (link_run.a, first_joint, link_run.b, x_a),
                (link_run.b, second_joint, link_run.a, x_b),
            ] {
                let is_fixed = scheme.w[other_mat] == 0.0 && modules.d[other_mat] == 0.0;
                if is_fixed && scheme.w[mass] > 0.0 && self.script.joints[joint].port.is_none() {
                    (modules.x[mass], modules.d[mass]) = (x, 0.0);
                }
            }
        }
    }

    /// Find the direction of every link at the start of a frame, and note the forces for outputs.
    fn begin_frame(&mut self, frame: SlideFrame<'_>, modules: &mut ModuleState) {
        let (script, start_instant) = (frame.script, Instant::new(frame.script.basis.n_polynomials(), 0.0));
        for (slide_index, &link) in frame.slide_script.links.iter().enumerate() {
            let [_, v] = self.elongation(script, link, &start_instant);
            let friction = self.friction(frame, (slide_index, 0.0));
            let (first_joint, second_joint) = script.link_joints[link];
            let velocity_lost =
                friction.level(0.0) * script.velocity_jump(first_joint, second_joint) * script.rate.step();
            let still_share = if self.has_rested[link] {
                STILL_SHARE_HELD
            } else {
                STILL_SHARE
            };
            let is_still = v.abs() <= still_share * velocity_lost;
            let direction = if is_still { 0.0 } else { v.signum() };
            let slide = &mut self.frictions.friction_links[slide_index];
            (slide.direction, slide.stage_forces) = (direction, [direction * friction.level(v); STAGES]);
        }
        self.settle_holds(frame, 0.0);
        let slides = self.frictions.friction_links.iter_mut();
        for (slide, &link) in slides.zip(&frame.slide_script.links) {
            let link_run = &script.links[link];
            (slide.has_held, slide.start_positions) =
                (slide.direction == 0.0, [modules.x[link_run.a], modules.x[link_run.b]]);
            modules.link_forces[link_run.first_link] = dot(&lagrange_weights(0.0), &slide.stage_forces);
        }
    }

    /// Of the links at rest at an instant, let those hold whose level suffices, and the others slide.
    fn settle_holds(&mut self, frame: SlideFrame<'_>, s: f64) {
        let is_holding = |slide: &FrictionLink| slide.direction == 0.0;
        while self.frictions.friction_links.iter().any(is_holding) {
            let step_length = self.even_steps(frame).length(s);
            self.solve_forces(frame, (s, step_length));
            let force_excess = |slide_index: usize| {
                let slide = &self.frictions.friction_links[slide_index];
                let friction_level = self.friction(frame, (slide_index, s)).level(0.0);
                let needed_force = dot(&lagrange_weights(0.0), &slide.stage_forces);
                let is_too_weak = is_holding(slide) && needed_force.abs() > friction_level * (1.0 + EXCESS_SHARE);
                is_too_weak.then_some((slide_index, needed_force.abs() - friction_level, needed_force.signum()))
            };
            let weak_holds = (0..frame.slide_script.links.len()).filter_map(force_excess);
            let Some((slide_index, _, direction)) =
                weak_holds.max_by(|hold, other_hold| hold.1.total_cmp(&other_hold.1))
            else {
                return;
            };
            self.frictions.friction_links[slide_index].direction = direction;
        }
    }

    /// The even steps of a frame in the present state: only a slide whose level falls needs short ones.
    fn even_steps<'a>(&self, frame: SlideFrame<'a>) -> &'a EvenSteps {
        let mut dry_slides = self.frictions.friction_links.iter().zip(&frame.slide_script.dry_laws);
        frame
            .slide_script
            .even_steps(dry_slides.any(|(slide, (dry, _))| slide.direction != 0.0 && dry.falls()))
    }

    /// The friction of a link at an instant of this frame.
    fn friction(&self, frame: SlideFrame<'_>, (slide_index, s): (usize, f64)) -> Friction {
        let dry_link = frame.slide_script.links[slide_index];
        let (dry_law, frame_rate) = frame.slide_script.dry_laws[slide_index];
        let [_, friction_level] = self.link_constants_at(dry_link, s);
        let link_gate = frame.script.links[dry_link].gate;
        Friction {
            dry_law: dry_law.with(friction_level),
            frame_rate,
            gate_opening: link_gate.map_or(1.0, |link_gate| frame.gates[link_gate]),
        }
    }

    /// A value that is positive while a link goes on as it does, at the end `s` of a step: of a slide its speed, of a
    /// hold the force that its level leaves.
    fn event_margin(&self, frame: SlideFrame<'_>, (slide_index, s): (usize, f64)) -> f64 {
        let slide = &self.frictions.friction_links[slide_index];
        if slide.direction == 0.0 {
            return self.hold_margin(frame, (slide_index, s), 1.0);
        }
        let instant = Instant::new(frame.script.basis.n_polynomials(), s);
        slide.direction * self.elongation(frame.script, frame.slide_script.links[slide_index], &instant)[1]
    }

    /// The same at the start `s` of a step that was taken.
    fn event_margin_at_start(&mut self, frame: SlideFrame<'_>, (slide_index, s): (usize, f64)) -> f64 {
        if self.frictions.friction_links[slide_index].direction == 0.0 {
            return self.hold_margin(frame, (slide_index, s), 0.0);
        }
        std::mem::swap(&mut self.paths, &mut self.saved_paths_and_sums[0]);
        let start_margin = self.event_margin(frame, (slide_index, s));
        std::mem::swap(&mut self.paths, &mut self.saved_paths_and_sums[0]);
        start_margin
    }

    /// The force that the level of a holding link leaves, at the start (0) or at the end (1) of a step [N].
    fn hold_margin(&self, frame: SlideFrame<'_>, (slide_index, s): (usize, f64), step_fraction: f64) -> f64 {
        let friction_level = self.friction(frame, (slide_index, s)).level(0.0);
        friction_level * (1.0 + EXCESS_SHARE)
            - dot(
                &lagrange_weights(step_fraction),
                &self.frictions.friction_links[slide_index].stage_forces,
            )
            .abs()
    }

    /// A link whose slide or hold has ended by the end `s` of a step, at an instant that is not located yet.
    fn first_ended_link(&self, frame: SlideFrame<'_>, s: f64) -> Option<usize> {
        let slides = &self.frictions.friction_links;
        let mut unlocated_links = (0..slides.len()).filter(|&slide_index| !slides[slide_index].is_instant_known);
        unlocated_links.find(|&slide_index| self.event_margin(frame, (slide_index, s)) < 0.0)
    }

    /// Repeat a step of `h` from `s` up to the instant at which a link's slide or hold ends; returns its length.
    fn locate_end(
        &mut self,
        frame: SlideFrame<'_>,
        (s, h, slide_index): (f64, f64, usize),
        steps_left: &mut usize,
    ) -> f64 {
        let mut high_end = (h, self.event_margin(frame, (slide_index, s + h)));
        let mut low_end = (0.0, self.event_margin_at_start(frame, (slide_index, s)));
        let mut length_taken = h;
        for _ in 0..LOCATE_STEPS_MAX {
            // A step that starts at an event has no margin there: then bisection, else a secant.
            let next_length = if low_end.1 > 0.0 {
                low_end.0 + (high_end.0 - low_end.0) * (low_end.1 / (low_end.1 - high_end.1))
            } else {
                0.5 * (low_end.0 + high_end.0)
            };
            let length_change = (next_length - length_taken).abs();
            length_taken = next_length;
            self.paths.copy_from_slice(&self.saved_paths_and_sums[0]);
            self.impulse_sums.copy_from_slice(&self.saved_paths_and_sums[1]);
            self.step_frictions(frame, (s, length_taken), steps_left);
            let margin_reached = self.event_margin(frame, (slide_index, s + length_taken));
            if length_change <= EVENT_TOLERANCE * h || margin_reached == 0.0 || *steps_left == 0 {
                break;
            }
            // Illinois rule: halve the value at the end that stays, so that the secant does not creep from one side.
            if margin_reached > 0.0 {
                (low_end, high_end.1) = ((length_taken, margin_reached), 0.5 * high_end.1);
            } else {
                (high_end, low_end.1) = ((length_taken, margin_reached), 0.5 * low_end.1);
            }
        }
        length_taken
    }
}

#[cfg(test)]
mod tests;
