//! Forces of dry friction in a step.

use super::script::Integrals;
use super::{Fine, Frame};
use crate::island::fine::basis::{Instant, dot};
use crate::island::fine::laws::{POINTS, STAGES, WEIGHTS};

/// Most Newton steps for the forces of a step; largest correction, as a share of the level, at which they end.
const NEWTON_STEPS: usize = 20;
const AGREE: f64 = 1e-11;
/// Rounds over all links in the step that finishes a frame.
const ROUNDS: usize = 60;
/// Work of a step, and of a Newton step, for each link: as much as this many kicks of a contact.
const STEP_WORK: u64 = 8;
const NEWTON_WORK: u64 = 8;

impl Fine {
    /// Take a step of `h` from `s`.
    pub(super) fn step_frictions(
        &mut self,
        frame: Frame<'_>,
        (s, h): (f64, f64),
        left: &mut usize,
    ) {
        *left = left.saturating_sub(1);
        self.work.instants += STEP_WORK * frame.slides.links.len() as u64;
        self.solve_forces(frame, (s, h));
        self.push_ends(frame, (s, h));
    }

    /// Solve for the forces of all links in a step of `h` from `s`.
    pub(super) fn solve_forces(&mut self, frame: Frame<'_>, (s, h): (f64, f64)) {
        if self.set_known_forces(frame, s) {
            return;
        }
        let (script, n_dry) = (frame.script, frame.slides.links.len());
        let pace = self.pace(frame);
        let frictions = &mut self.frictions;
        if pace.is_even(h) {
            frictions.moves.copy_from_slice(&pace.moves);
        } else {
            let integrals = Integrals::new(script, h);
            for (moves, response) in frictions.moves.iter_mut().zip(&frame.slides.responses) {
                *moves = integrals.velocity_response(response);
            }
            self.work.products += (n_dry * n_dry * STAGES * STAGES * script.basis.n()) as u64;
        }
        let points = POINTS.map(|c| Instant::new(script.basis.n(), s + c * h));
        for slide_index in 0..n_dry {
            let link = frame.slides.links[slide_index];
            self.frictions.slides[slide_index].free =
                (points.each_ref()).map(|at| self.elongation(script, link, at)[1]);
        }
        for _ in 0..NEWTON_STEPS {
            let is_linear = self.set_up_equations(frame, s);
            let change = self.correct_forces(frame, s);
            if is_linear || change.is_none_or(|change| change <= AGREE) {
                break;
            }
        }
        for slide_index in 0..n_dry {
            let friction = self.friction(frame, (slide_index, s));
            let slide = &mut self.frictions.slides[slide_index];
            if slide.direction != 0.0 {
                // Friction takes energy and never gives any.
                let force_max = friction.level(0.0).max(friction.open * friction.by.level);
                let bounded = |force: f64| (slide.direction * force).clamp(0.0, force_max);
                slide.force = slide.force.map(|force| slide.direction * bounded(force));
            }
        }
    }

    /// Set the forces of a step if every link slides at a level that does not depend on its velocity; returns whether
    /// that is so.
    fn set_known_forces(&mut self, frame: Frame<'_>, s: f64) -> bool {
        for slide_index in 0..frame.slides.links.len() {
            let friction = self.friction(frame, (slide_index, s));
            let slide = &mut self.frictions.slides[slide_index];
            if slide.direction == 0.0 || friction.by.falls() {
                return false;
            }
            slide.force = [slide.direction * friction.level(0.0); STAGES];
        }
        true
    }

    /// Set up Newton's equations for corrections of all forces, one equation for each link and Gauss point: a holding link
    /// has no velocity, a sliding link gives its level. Returns whether the equations are linear.
    fn set_up_equations(&mut self, frame: Frame<'_>, s: f64) -> bool {
        let n_dry = frame.slides.links.len();
        let width = STAGES * n_dry + 1;
        let mut system = std::mem::take(&mut self.frictions.system);
        let mut is_linear = true;
        for slide_index in 0..n_dry {
            let friction = self.friction(frame, (slide_index, s));
            let slide = &self.frictions.slides[slide_index];
            let moves = &self.frictions.moves[slide_index * n_dry..(slide_index + 1) * n_dry];
            let (direction, is_held) = (slide.direction, slide.direction == 0.0);
            is_linear &= is_held || !friction.by.falls();
            for stage in 0..STAGES {
                let pairs = moves.iter().zip(&self.frictions.slides);
                let by = pairs.map(|(by, other)| dot(&by[stage], &other.force));
                let v = slide.free[stage] + by.sum::<f64>();
                let row_index = STAGES * slide_index + stage;
                let row = &mut system[row_index * width..(row_index + 1) * width];
                let velocity_factor = if is_held {
                    1.0
                } else {
                    -direction * friction.slope(v)
                };
                let responses = moves.iter().flat_map(|by| by[stage]);
                for (entry, response) in row.iter_mut().zip(responses) {
                    *entry = velocity_factor * response;
                }
                if is_held {
                    row[width - 1] = -v;
                } else {
                    row[row_index] += 1.0;
                    row[width - 1] = direction * friction.level(v) - slide.force[stage];
                }
            }
        }
        self.frictions.system = system;
        is_linear
    }

    /// Correct all forces by the solution of the equations; returns the largest correction as a share of its level, `None`
    /// if there is no solution.
    fn correct_forces(&mut self, frame: Frame<'_>, s: f64) -> Option<f64> {
        let n = STAGES * frame.slides.links.len();
        self.work.instants += NEWTON_WORK * frame.slides.links.len() as u64;
        self.work.products += (n * n * n / 3) as u64;
        eliminate(&mut self.frictions.system, n)?;
        let mut change = 0.0_f64;
        for slide in 0..frame.slides.links.len() {
            let level = self.friction(frame, (slide, s)).level(0.0);
            for stage in 0..STAGES {
                let by = self.frictions.system[(STAGES * slide + stage) * (n + 1) + n];
                self.frictions.slides[slide].force[stage] += by;
                change = change.max(by.abs() / level.max(f64::MIN_POSITIVE));
            }
        }
        Some(change)
    }

    /// Take the rest of a frame in one step, whatever ends in it. Each link gives one force, at most its level, that stops
    /// it by the end of the frame if it can, so friction takes energy at any step (J. J. Moreau, 1988).
    pub(super) fn finish_frame(&mut self, frame: Frame<'_>, s: f64) {
        let (script, n_dry, h) = (frame.script, frame.slides.links.len(), 1.0 - s);
        let n = script.basis.n();
        let since = POINTS.map(|c| Instant::new(n, (1.0 - c) * h));
        // The equations of a step are not needed any more: their room holds what the force of one link makes of the
        // velocity of each at the end of the frame.
        let mut compliances = std::mem::take(&mut self.frictions.system);
        for (compliance, response) in compliances.iter_mut().zip(&frame.slides.responses) {
            let parts = WEIGHTS.iter().zip(&since);
            let parts = parts.map(|(weight, since)| weight * dot(response, &since.value));
            *compliance = h * script.rate.step() * parts.sum::<f64>();
        }
        let end = Instant::new(n, 1.0);
        for slide_index in 0..n_dry {
            let [_, v] = self.elongation(script, frame.slides.links[slide_index], &end);
            let slide = &mut self.frictions.slides[slide_index];
            (slide.free, slide.force, slide.holds) = ([v; STAGES], [0.0; STAGES], false);
        }
        for _ in 0..ROUNDS {
            for slide_index in 0..n_dry {
                let slides = &self.frictions.slides;
                let row = &compliances[slide_index * n_dry..(slide_index + 1) * n_dry];
                let pushes = row
                    .iter()
                    .zip(slides)
                    .map(|(by, other)| by * other.force[0]);
                let v = slides[slide_index].free[0] + pushes.sum::<f64>();
                let level = self.friction(frame, (slide_index, s)).level(v);
                let stopping = slides[slide_index].force[0] - v / row[slide_index];
                if stopping.is_finite() {
                    self.frictions.slides[slide_index].force =
                        [stopping.clamp(-level, level); STAGES];
                }
            }
            self.work.instants += n_dry as u64;
        }
        self.frictions.system = compliances;
        self.push_ends(frame, (s, h));
    }

    /// Push the ends of all links by their forces in a step of `h` from `s`.
    fn push_ends(&mut self, frame: Frame<'_>, (s, h): (f64, f64)) {
        for stage in 0..STAGES {
            let instant = Instant::new(frame.script.basis.n(), s + POINTS[stage] * h);
            let weight = WEIGHTS[stage] * h * frame.script.rate.step();
            for (slide, &link) in frame.slides.links.iter().enumerate() {
                let (a, b) = frame.script.ends[link];
                let impulse = weight * self.frictions.slides[slide].force[stage];
                self.shove(frame.script, a, impulse, &instant);
                self.shove(frame.script, b, -impulse, &instant);
            }
        }
    }
}

/// Solve n linear equations in place (n, n + 1): the last column holds the right side, and then the solution. `None` if
/// there is no single solution.
fn eliminate(system: &mut [f64], n: usize) -> Option<()> {
    let width = n + 1;
    for column in 0..n {
        let size = |row: &usize| system[row * width + column].abs();
        let pivot = (column..n).max_by(|one, other| size(one).total_cmp(&size(other)))?;
        if !(size(&pivot) > 0.0 && size(&pivot).is_finite()) {
            return None;
        }
        if pivot != column {
            let (above, below) = system.split_at_mut(pivot * width);
            above[column * width..(column + 1) * width].swap_with_slice(&mut below[..width]);
        }
        let (above, below) = system.split_at_mut((column + 1) * width);
        let row = &above[column * width..];
        for other in below.chunks_exact_mut(width) {
            let by = other[column] / row[column];
            if by != 0.0 {
                for (entry, own) in other[column..].iter_mut().zip(&row[column..]) {
                    *entry -= by * own;
                }
            }
        }
    }
    for column in (0..n).rev() {
        let others =
            (column + 1..n).map(|other| system[column * width + other] * system[other * width + n]);
        let known = others.sum::<f64>();
        let row = &mut system[column * width..(column + 1) * width];
        row[n] = (row[n] - known) / row[column];
    }
    let mut solution = system.iter().skip(n).step_by(width);
    solution.all(|x| x.is_finite()).then_some(())
}
