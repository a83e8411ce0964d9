//! A frame in several steps of CA.
//!
//! In each of S steps, x advances by d/S and d by a/S; d stays in metres a frame, as forces expect it. The velocity d
//! belongs to the middle of a step: 1/(2S) of a frame before the end of a frame in S steps, and 1/2 before the end of
//! an ordinary frame. When the number of steps changes, d is moved between the two instants by the acceleration of
//! links and ties. Outside forces act at the beginning of the frame, as in a frame of one step.

use super::{CALM_FRAMES, CALM_SHARE, Guard, STEPS_MAX};
use crate::kernel::{advance_by_fraction, is_bounded};

/// A network that the guard can step.
pub(crate) trait SubsteppedSystem {
    /// Compute the forces of all links at the present positions and steps, into `force`.
    fn compute_link_forces(&mut self);
    /// The state that a step advances.
    fn mat_motion(&mut self) -> MatMotion<'_>;
}

/// State and parameters of the MATs, (n_mat) each.
pub(crate) struct MatMotion<'a> {
    /// 1/M, κ, ζ and the position of the ground.
    pub(crate) ties: [&'a [f64]; 4],
    pub(crate) force: &'a mut [f64],
    pub(crate) x: &'a mut [f64],
    pub(crate) d: &'a mut [f64],
}

impl Guard {
    /// Set the MATs whose path is imposed in the next finer frame: the ports and `targets`; `path` gives positions at
    /// the beginning and the end of the frame [m].
    pub(crate) fn set_imposed_paths(
        &mut self,
        targets: impl Iterator<Item = usize>,
        path: impl Fn(usize) -> (f64, f64),
    ) {
        let imposed_mats = self.ports.iter().copied().chain(targets);
        self.imposed_paths.clear();
        self.imposed_paths.extend(imposed_mats.map(|mat| {
            let (path_start, path_end) = path(mat);
            (mat, path_start, path_end)
        }));
    }

    /// Compute a frame in smaller steps; `system` holds the state at its beginning and the sum of all forces that act
    /// in it. Returns false if a position is no longer finite or plausible.
    pub(crate) fn compute_finer(&mut self, system: &mut impl SubsteppedSystem) -> bool {
        self.begin_frame(system);
        let mut step_count = if self.frame_steps > 1 { self.frame_steps } else { 2 };
        while !self.try_steps(system, step_count) && step_count < STEPS_MAX {
            step_count *= 2;
            let MatMotion { x, d, .. } = system.mat_motion();
            x.copy_from_slice(&self.start_positions);
            d.copy_from_slice(&self.start_steps);
        }
        self.end_frame(system, step_count)
    }

    fn compute_link_forces(&mut self, system: &mut impl SubsteppedSystem) {
        system.compute_link_forces();
        self.finer_frames.evaluations += 1;
    }

    /// Store the beginning of the frame, and separate outside forces from those of links.
    fn begin_frame(&mut self, system: &mut impl SubsteppedSystem) {
        let MatMotion { force, x, d, .. } = system.mat_motion();
        self.start_positions.copy_from_slice(x);
        self.start_steps.copy_from_slice(d);
        self.outside_forces.copy_from_slice(force);
        self.compute_link_forces(system);
        let MatMotion { ties, force, x, d } = system.mat_motion();
        let [w, kappa, zeta, rest] = ties;
        for (outside_force, force) in self.outside_forces.iter_mut().zip(&*force) {
            *outside_force -= force;
        }
        for (i, step) in self.link_steps.iter_mut().enumerate() {
            *step = force[i] * w[i] - kappa[i] * (x[i] - rest[i]) - zeta[i] * d[i];
        }
    }

    /// Compute the frame in `steps` steps; false if they are too few and more are possible.
    fn try_steps(&mut self, system: &mut impl SubsteppedSystem, steps: u32) -> bool {
        let step_fraction = 1.0 / f64::from(steps);
        let time_shift = 0.5 / f64::from(self.previous_frame_steps) - 0.5 * step_fraction;
        let MatMotion { d, ties, .. } = system.mat_motion();
        let [kappa, zeta] = &mut self.substep_ties;
        if let Some(tie_factors) = &self.tie_factors {
            tie_factors.write_ties(steps, [ties[1], ties[2]], [kappa, zeta]);
        }
        for (i, d) in d.iter_mut().enumerate() {
            let step_excess = if self.previous_frame_steps > 1 {
                self.last_step_excess[i]
            } else {
                0.0
            };
            *d += step_excess + time_shift * self.link_steps[i];
        }
        for &(mat, path_start, path_end) in &self.imposed_paths {
            d[mat] = path_end - path_start;
        }
        for step in 1..=steps {
            self.compute_link_forces(system);
            let MatMotion { ties, force, x, d } = system.mat_motion();
            if step == 1 {
                for (i, force) in force.iter_mut().enumerate() {
                    *force += f64::from(steps) * self.outside_forces[i];
                    self.force_travel[i] = 0.5 * d[i];
                }
            }
            let step_ties = match self.tie_factors {
                Some(_) => [ties[0], &self.substep_ties[0], &self.substep_ties[1], ties[3]],
                None => ties,
            };
            advance_by_fraction(step_fraction, step_ties, force, x, d);
            if step == 1 {
                let travel_pairs = self.force_travel.iter_mut().zip(&*d);
                travel_pairs.for_each(|(travel, d)| *travel += 0.5 * d);
            }
            let frame_share = f64::from(step) * step_fraction;
            for &(mat, path_start, path_end) in &self.imposed_paths {
                (x[mat], d[mat]) = (
                    path_start + (path_end - path_start) * frame_share,
                    path_end - path_start,
                );
            }
            let (lambda_rise, _) = self.lambda_rise(x, ties[0]);
            if steps < STEPS_MAX && self.steps_needed(lambda_rise) > steps {
                return false;
            }
        }
        true
    }

    /// End the frame: `d` becomes the mean of its steps, and `last_step_excess` the last step minus that mean.
    fn end_frame(&mut self, system: &mut impl SubsteppedSystem, steps: u32) -> bool {
        let MatMotion { ties, x, d, .. } = system.mat_motion();
        for i in 0..x.len() {
            let mean_step = x[i] - self.start_positions[i];
            self.last_step_excess[i] = d[i] - mean_step;
            d[i] = mean_step;
        }
        let (lambda_rise, _) = self.lambda_rise_exact(x, ties[0]);
        // The number of steps is halved only if a quarter of it would be enough.
        let is_calm = match steps {
            2 => lambda_rise <= CALM_SHARE * (self.lambda_limit - self.rest_lambda),
            _ => 4 * self.steps_needed(lambda_rise) <= steps,
        };
        self.calm_frames = if is_calm { self.calm_frames + 1 } else { 0 };
        (self.previous_frame_steps, self.frame_steps) = (steps, steps);
        if self.calm_frames == CALM_FRAMES {
            (self.calm_frames, self.frame_steps) = (0, steps / 2);
            self.previous_frame_steps = if self.frame_steps == 1 { 1 } else { steps };
        }
        self.finer_frames.frames += 1;
        self.finer_frames.steps_max = self.finer_frames.steps_max.max(steps);
        x.iter().all(|&x| is_bounded(x))
    }
}
