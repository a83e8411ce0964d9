//! Computes the ergon by which a key fulfils a request.

use super::super::ergons_for_view::Sparks;
use super::{Request, TrackedFrame, Voice, VoiceScene, VoiceScript};
use crate::gesture::report::GestureReport;
use crate::gesture::script::{ErgonKind, Touch};
use crate::island::record::{ErgonRecord, ErgonStream};
use crate::scheme::Scheme;
use crate::state::{ImposedTarget, ModuleState};
use crate::{kernel, maths};

/// An ergon, as it is added to report, stream and sparks.
struct ErgonEntry {
    frame: u64,
    mat: usize,
    source: u32,
    force: f64,
    /// Mass [kg] and velocity [m/s] of a particle; those of an event follow from the force.
    particle: Option<(f64, f64)>,
    /// Whether it is one of many that lead along a path.
    is_stream: bool,
}

impl Voice {
    /// Strike the key so that it fulfils the request; returns the force on the free key [N]. `last_requested_position`
    /// was requested for this frame; NaN if none was.
    pub(super) fn strike_as_requested(
        &mut self,
        script: &VoiceScript,
        scene: &mut VoiceScene<'_>,
        n: u64,
        request: &Request,
        last_requested_position: f64,
    ) -> f64 {
        let unlimited_force = self.unlimited_force(script, scene, n, request);
        let Some(running_gesture) = self.running_gesture.as_mut() else {
            return 0.0;
        };
        let gesture_index = running_gesture.gesture_index;
        let gesture = &scene.gestures[gesture_index];
        let manner = gesture.gesture.manner;
        let force_limit = manner.force_limit();
        let (requested_position, target_frame) = match *request {
            Request::Pass(x) => (x, n + 1),
            Request::Aim { arrival_frame: to, x } => (x, to),
        };
        let source = gesture.ergon_source(&mut running_gesture.point_cursor, target_frame);
        if target_frame == n + 1 {
            self.requested_position = requested_position;
        }
        let is_over_limit = unlimited_force.abs() > force_limit;
        scene.reports[gesture_index].n_missed_steps += u64::from(is_over_limit);
        if let (Request::Pass(x), Touch::Tracked) = (request, manner.touch) {
            // A tracked step that would need more than the limit leaves the key free.
            if is_over_limit {
                return 0.0;
            }
            scene.targets.push(ImposedTarget {
                mat: script.struck_mat,
                x: *x,
                previous: 0.0,
            });
            self.tracked_frame = Some(TrackedFrame {
                gesture_index,
                source,
                position: *x,
            });
            // The free copy follows the key.
            return script
                .free_key
                .force_to_reach(&self.free_motion, *x, &self.targets, &mut self.buffers);
        }
        let force = match *request {
            _ if !is_over_limit => unlimited_force,
            Request::Pass(x) => self.catch_up_force(script, [last_requested_position, x], force_limit),
            Request::Aim { .. } => maths::copysign(force_limit, unlimited_force),
        };
        if !force.is_finite() || force == 0.0 {
            return 0.0;
        }
        let mut ergon_entry = ErgonEntry {
            frame: n,
            mat: script.struck_mat,
            source,
            force,
            particle: None,
            is_stream: matches!(request, Request::Pass(_)),
        };
        if manner.ergon_kind == ErgonKind::Particle {
            let particles = &mut self.particles;
            ergon_entry.particle = particles.launch(scene.scheme, scene.modules, script.struck_mat, force);
        }
        let is_particle = ergon_entry.particle.is_some();
        ergon_entry.record(
            scene.scheme,
            scene.modules,
            &mut scene.reports[gesture_index],
            scene.ergon_stream,
            &mut self.sparks,
        );
        if !is_particle {
            scene.modules.push(script.struck_mat, force);
        }
        force
    }

    /// The force within the limit that brings the free key back onto a path that it fell behind [N].
    ///
    /// The distance e is closed no faster than half the limit can brake, √(2·½a·|e|): pushing with all force until the
    /// path is crossed would make the key swing far beyond it, again and again.
    fn catch_up_force(
        &self,
        script: &VoiceScript,
        [last_requested_position, requested_position]: [f64; 2],
        force_limit: f64,
    ) -> f64 {
        let (scheme, mat_index) = (&script.free_key.scheme, script.free_key.struck_mat);
        let last_position = if last_requested_position.is_nan() {
            requested_position
        } else {
            last_requested_position
        };
        let path_distance = last_position - self.free_motion.modules.x[mat_index];
        // a·T² = limit/M, in metres a step, squared.
        let closing_step = (force_limit * scheme.w[mat_index] * path_distance.abs())
            .sqrt()
            .min(path_distance.abs());
        let target_position = self.free_motion.modules.x[mat_index]
            + (requested_position - last_position)
            + maths::copysign(closing_step, path_distance);
        kernel::force_to_reach(scheme, &self.free_motion.modules, mat_index, target_position)
            .clamp(-force_limit, force_limit)
    }

    /// Read back the ergon that holds a tracked key, once all other forces of the frame are known.
    pub(crate) fn record_tracked_ergon(&mut self, script: &VoiceScript, scene: &mut VoiceScene<'_>, n: u64) {
        if let Some(tracked_frame) = self.tracked_frame.take() {
            let force = kernel::force_to_reach(scene.scheme, scene.modules, script.struck_mat, tracked_frame.position);
            let ergon_entry = ErgonEntry {
                frame: n,
                mat: script.struck_mat,
                source: tracked_frame.source,
                force,
                particle: None,
                is_stream: true,
            };
            let report = &mut scene.reports[tracked_frame.gesture_index];
            let sparks = &mut self.sparks;
            ergon_entry.record(scene.scheme, scene.modules, report, scene.ergon_stream, sparks);
        }
    }

    /// The force that fulfils the request, without a limit [N].
    fn unlimited_force(&mut self, script: &VoiceScript, scene: &VoiceScene<'_>, n: u64, request: &Request) -> f64 {
        let Some(running_gesture) = &self.running_gesture else {
            return 0.0;
        };
        let free_key = &script.free_key;
        match (
            *request,
            scene.gestures[running_gesture.gesture_index].gesture.manner.touch,
        ) {
            (Request::Pass(x), Touch::Open) => {
                free_key.force_to_reach(&self.free_motion, x, &self.targets, &mut self.buffers)
            }
            (Request::Pass(x), Touch::Tracked) => {
                kernel::force_to_reach(scene.scheme, scene.modules, script.struck_mat, x)
            }
            (Request::Aim { arrival_frame, x }, touch) => {
                if touch == Touch::Tracked {
                    // Aim from the position of the scene's key, with its loads.
                    for (key_mat, &scene_mat) in free_key.scene_mats.iter().enumerate() {
                        self.free_motion.modules.x[key_mat] = scene.modules.x[scene_mat];
                        self.free_motion.modules.d[key_mat] = scene.modules.d[scene_mat];
                    }
                    free_key.sum_forces(&mut self.free_motion, n, &mut self.buffers.scratch, &mut self.targets);
                }
                free_key.force_to_arrive(&self.free_motion, n, arrival_frame, x, &mut self.buffers)
            }
        }
    }
}

impl ErgonEntry {
    /// Add the ergon to the report, the stream and the sparks, before its force is added to the sum.
    fn record(
        &self,
        scheme: &Scheme,
        modules: &ModuleState,
        report: &mut GestureReport,
        stream: &mut ErgonStream,
        sparks: &mut Sparks,
    ) {
        let time_step = 1.0 / scheme.rate;
        let (mass, impulse) = (time_step * time_step / scheme.w[self.mat], self.force * time_step);
        report.n_ergons += 1;
        report.velocity_step_max = report.velocity_step_max.max(impulse.abs() / mass);
        report.force_max = report.force_max.max(self.force.abs());
        let record = |velocity| {
            let strike_time = self.frame as f64 * time_step;
            let mut record = ErgonRecord::event(strike_time, self.mat, self.source, mass, velocity, impulse);
            if let Some((mass, particle_speed)) = self.particle {
                (record.mass, record.speed) = (mass, particle_speed);
            }
            record
        };
        if stream.is_recording() {
            // The velocity without the ergon: its force is not in the sum yet.
            let velocity = kernel::centred_velocity(scheme, modules, self.mat);
            stream.add(self.frame, record(velocity));
        }
        if sparks.is_watched() {
            sparks.add(&record(0.0), self.is_stream);
        }
    }
}
