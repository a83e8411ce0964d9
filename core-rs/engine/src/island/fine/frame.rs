//! One frame: which contacts may close, the free paths of their points, and the impulses that links give.

use super::basis::Instant;
use super::script::FineScript;
use super::slides::SlideFrame;
use super::{FineLinks, penetration_bound};
use crate::island::bodies::RunningBody;
use crate::kernel;
use crate::scheme::Scheme;
use crate::state::{ImposedTarget, ModuleState};

impl FineLinks {
    /// Compute one frame of all laws and of every contact that may be closed, once all other forces are summed.
    pub(in crate::island) fn step(
        &mut self,
        scheme: &Scheme,
        gates: &[f64],
        targets: &[ImposedTarget],
        bodies: &mut [RunningBody],
        modules: &mut ModuleState,
    ) {
        let next_position = |mat: usize, modules: &ModuleState| match targets.iter().find(|target| target.mat == mat) {
            Some(target) => target.x,
            None => kernel::predict_position(scheme, modules, mat),
        };
        let mut has_closable_contact = false;
        for (link_index, run) in self.script.links.iter().enumerate() {
            let distance_now = modules.x[run.b] - modules.x[run.a];
            let distance_next = next_position(run.b, modules) - next_position(run.a, modules);
            let may_close = penetration_bound(run, distance_now - run.rest, distance_next - run.rest) > 0.0;
            self.may_close[link_index] = may_close;
            has_closable_contact |= may_close;
            modules.link_forces[run.first_link] = 0.0;
        }
        if !has_closable_contact && self.frictions.is_empty() {
            self.has_rested.fill(false);
        }
        if !has_closable_contact && self.laws.is_empty() && self.frictions.is_empty() {
            return;
        }
        self.retune();
        if has_closable_contact {
            self.mark_reached_contacts();
        }
        let (script, law_script) = (self.script.clone(), self.law_script.clone());
        self.work.products += script.free_path_products;
        self.frame_impulses.fill(0.0);
        self.begin_crowded_motions();
        self.compute_free_paths(&script, scheme, bodies, modules, &next_position);
        let is_marched = has_closable_contact || !self.frictions.is_empty() || self.has_glided.contains(&true);
        self.start_laws(&script, &law_script, gates, !is_marched);
        if is_marched {
            self.impulse_sums.fill(0.0);
            let n_instants = script.basis.n_polynomials();
            for (free_path, path) in self
                .free_paths
                .chunks(n_instants)
                .zip(self.paths.chunks_mut(n_instants))
            {
                script.basis.fit(free_path, path);
            }
            if self.frictions.is_empty() {
                self.march(&script, &law_script, gates, modules);
            } else {
                let slide_script = self.frictions.script.clone();
                let slide_frame = SlideFrame {
                    script: &script,
                    slide_script: &slide_script,
                    gates,
                };
                self.compute_frictions(slide_frame, modules);
            }
            // Impulses at the instants of the frame that have the same effect on any smooth function as those between
            // them.
            for (sums, frame_impulses) in self
                .impulse_sums
                .chunks(n_instants)
                .zip(self.frame_impulses.chunks_mut(n_instants))
            {
                for (impulse_sum, row) in sums.iter().zip(script.basis.fit.chunks(n_instants)) {
                    for (impulse, weight) in frame_impulses.iter_mut().zip(row) {
                        *impulse += impulse_sum * weight;
                    }
                }
            }
        } else {
            self.collocate(&script, &law_script, gates);
        }
        self.write_start_forces(&script, &law_script, modules);
        self.stepped_points
            .record_impulses(&script, &self.frame_impulses, scheme);
        self.apply_impulses(&script, bodies, modules);
    }

    /// Mark more contacts as ones that may close: each that pushes may push points off their free paths, and with them
    /// other contacts.
    fn mark_reached_contacts(&mut self) {
        let script = &*self.script;
        let is_moved_by = |pushing_link: usize, moved_link: usize| {
            let n_joints = script.joints.len();
            let joint_pair = |(a, b): (usize, usize)| [a, b];
            let is_coupled = |source_joint: usize, target_joint: usize| {
                let crowded_body = |joint: usize| script.crowded_rows[joint].map(|(body, _)| body);
                let on_same_body =
                    crowded_body(source_joint).is_some() && crowded_body(source_joint) == crowded_body(target_joint);
                on_same_body || !script.path_responses[source_joint * n_joints + target_joint].is_empty()
            };
            let (mover_joints, moved_joints) = (
                joint_pair(script.link_joints[pushing_link]),
                joint_pair(script.link_joints[moved_link]),
            );
            mover_joints
                .iter()
                .any(|&from| moved_joints.iter().any(|&to| is_coupled(from, to)))
        };
        loop {
            let is_reached = |link: &usize| {
                let mut closing_links = (0..script.links.len()).filter(|&other| self.may_close[other]);
                !self.may_close[*link] && closing_links.any(|closing_link| is_moved_by(closing_link, *link))
            };
            match (0..script.links.len()).find(is_reached) {
                Some(link) => self.may_close[link] = true,
                None => return,
            }
        }
    }

    /// Compute the paths of all joints in this frame if no contact pushes them.
    fn compute_free_paths(
        &mut self,
        script: &FineScript,
        scheme: &Scheme,
        bodies: &mut [RunningBody],
        modules: &ModuleState,
        next_position: &dyn Fn(usize, &ModuleState) -> f64,
    ) {
        let (n_instants, n_joints) = (script.basis.n_polynomials(), script.joints.len());
        for (joint_index, joint) in script.joints.iter().enumerate() {
            let free_path = &mut self.free_paths[joint_index * n_instants..(joint_index + 1) * n_instants];
            // Lasting forces act throughout the frame, but are applied as impulses at its start. Both lead to the same
            // end; the path between is corrected here.
            let mut curvature = 0.5 * self.steady_forces[joint_index] * scheme.w[joint.mat];
            match joint.port {
                Some((body_index, port)) => {
                    if let Some(modal_body) = bodies[body_index].modal_mut() {
                        modal_body.port_positions(port, free_path);
                    }
                }
                None => {
                    // From where it rests, its path is exact to the last bit if it does not move.
                    let rest_position = joint.rest_position.unwrap_or(modules.x[joint.mat]);
                    let free_step = next_position(joint.mat, modules) - modules.x[joint.mat];
                    let (x, next_x) = (
                        modules.x[joint.mat] - rest_position,
                        next_position(joint.mat, modules) - rest_position,
                    );
                    for (position, (weight_now, weight_next)) in free_path.iter_mut().zip(&joint.frame_weights) {
                        *position = rest_position + (x * weight_now + next_x * weight_next);
                    }
                    if joint.cell.is_some() {
                        // The forces inside a mesh also bend the path of its port throughout the frame.
                        curvature += 0.5 * modules.free_port_motion.get(joint.mat).copied().unwrap_or(0.0);
                        self.stepped_points
                            .record_free_motion(joint_index, free_step, curvature);
                    } else {
                        curvature = 0.0;
                    }
                }
            }
            if curvature != 0.0 {
                for (position, s) in free_path.iter_mut().zip(&script.basis.instants) {
                    *position -= curvature * s * (1.0 - s);
                }
            }
        }
        // Other forces on a port act from the start of the frame.
        for (joint_index, joint) in script.joints.iter().enumerate() {
            let joint_force = modules.force[joint.mat];
            if joint.port.is_none() || joint_force == 0.0 {
                continue;
            }
            let impulse = joint_force * script.rate.step();
            if self.push_crowded_joint(script, joint_index, impulse) {
                continue;
            }
            for (moved_joint, free_path) in self.free_paths.chunks_mut(n_instants).enumerate() {
                for (x, response) in free_path
                    .iter_mut()
                    .zip(&script.displacement_responses[joint_index * n_joints + moved_joint])
                {
                    *x += impulse * response;
                }
            }
        }
    }

    /// Push a joint [N·s].
    pub(super) fn push_joint(&mut self, script: &FineScript, joint: usize, impulse: f64, instant: &Instant) {
        let n_instants = script.basis.n_polynomials();
        let impulses = &mut self.impulse_sums[joint * n_instants..(joint + 1) * n_instants];
        for (impulse_sum, value) in impulses.iter_mut().zip(&instant.values) {
            *impulse_sum += impulse * value;
        }
        if !self.push_crowded_joint(script, joint, impulse) {
            script.add_impulse(joint, impulse, instant, &mut self.paths);
            self.work.products += script.impulse_products[joint];
        }
    }

    /// Apply the impulses of a frame to bodies and MATs.
    fn apply_impulses(&mut self, script: &FineScript, bodies: &mut [RunningBody], modules: &mut ModuleState) {
        let n_instants = script.basis.n_polynomials();
        for (joint_index, joint) in script.joints.iter().enumerate() {
            let joint_impulses = &self.frame_impulses[joint_index * n_instants..(joint_index + 1) * n_instants];
            if joint_impulses.iter().all(|impulse| *impulse == 0.0) {
                continue;
            }
            match (joint.port, &joint.cell) {
                (Some((body_index, port)), _) => {
                    if let Some(modal_body) = bodies[body_index].modal_mut() {
                        modal_body.apply_impulses(port, joint_impulses, modules);
                    }
                }
                (None, Some(_)) => {
                    for (impulse, [force_now, force_next]) in joint_impulses.iter().zip(&joint.impulse_split) {
                        modules.push(joint.mat, impulse * force_now);
                        self.carried_forces[joint_index] += impulse * force_next;
                    }
                }
                // The motion of such a MAT is imposed; a hand that holds it feels the force.
                (None, None) => {
                    modules.push(joint.mat, joint_impulses.iter().sum::<f64>() * script.rate.hertz());
                }
            }
        }
    }
}
