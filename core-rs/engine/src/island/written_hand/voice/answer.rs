//! Computes the ergon that makes a key do what is asked.

use super::super::ergons_for_view::Sparks;
use super::{Ask, Scene, TrackedFrame, Voice, VoiceScript};
use crate::gesture::report::GestureReport;
use crate::gesture::script::{ErgonKind, Touch};
use crate::island::record::{Record, Stream};
use crate::scheme::Scheme;
use crate::state::{Body, Target};
use crate::{kernel, maths};

/// An ergon, as it is added to report, stream and sparks.
struct Blow {
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
    /// Strike the key so that it does what is asked; returns the force on the free key [N]. `asked_here` is the
    /// position asked for at this very frame, NaN if none.
    pub(super) fn answer(
        &mut self,
        script: &VoiceScript,
        scene: &mut Scene<'_>,
        n: u64,
        request: &Ask,
        asked_here: f64,
    ) -> f64 {
        let wanted_force = self.unlimited_force(script, scene, n, request);
        let Some(running) = self.running.as_mut() else {
            return 0.0;
        };
        let gesture_index = running.gesture;
        let gesture = &scene.gestures[gesture_index];
        let manner = gesture.gesture.manner;
        let force_limit = manner.force_limit();
        let (asked_position, target_frame) = match *request {
            Ask::Pass(x) => (x, n + 1),
            Ask::Aim { to, x } => (x, to),
        };
        let source = gesture.source(&mut running.source, target_frame);
        if target_frame == n + 1 {
            self.asked = asked_position;
        }
        let is_over_limit = wanted_force.abs() > force_limit;
        scene.reports[gesture_index].n_missed_steps += u64::from(is_over_limit);
        if let (Ask::Pass(x), Touch::Tracked) = (request, manner.touch) {
            // A tracked step that would need more than the limit leaves the key free.
            if is_over_limit {
                return 0.0;
            }
            scene.targets.push(Target {
                mat: script.struck,
                x: *x,
                previous: 0.0,
            });
            self.tracked = Some(TrackedFrame {
                gesture: gesture_index,
                source,
                x: *x,
            });
            // The free copy follows the key.
            return script
                .free
                .force_to_reach(&self.free, *x, &self.targets, &mut self.buffers);
        }
        let force = match *request {
            _ if !is_over_limit => wanted_force,
            Ask::Pass(x) => self.catch_up(script, [asked_here, x], force_limit),
            Ask::Aim { .. } => maths::copysign(force_limit, wanted_force),
        };
        if !force.is_finite() || force == 0.0 {
            return 0.0;
        }
        let mut blow = Blow {
            frame: n,
            mat: script.struck,
            source,
            force,
            particle: None,
            is_stream: matches!(request, Ask::Pass(_)),
        };
        if manner.ergon_kind == ErgonKind::Particle {
            let flight = &mut self.flight;
            blow.particle = flight.launch(scene.scheme, scene.body, script.struck, force);
        }
        let is_particle = blow.particle.is_some();
        blow.record(
            scene.scheme,
            scene.body,
            &mut scene.reports[gesture_index],
            scene.stream,
            &mut self.sparks,
        );
        if !is_particle {
            scene.body.push(script.struck, force);
        }
        force
    }

    /// The force within the limit that brings the free key back onto a path that it fell behind [N].
    ///
    /// The distance e is closed no faster than half the limit can brake, √(2·½a·|e|): pushing with all force until the
    /// path is crossed would make the key swing far beyond it, again and again.
    fn catch_up(&self, script: &VoiceScript, [asked_here, asked_next]: [f64; 2], force_limit: f64) -> f64 {
        let (scheme, mat_index) = (&script.free.scheme, script.free.struck);
        let asked_here = if asked_here.is_nan() { asked_next } else { asked_here };
        let path_distance = asked_here - self.free.body.x[mat_index];
        // a·T² = limit/M, in metres a step, squared.
        let closing_step = (force_limit * scheme.w[mat_index] * path_distance.abs())
            .sqrt()
            .min(path_distance.abs());
        let aim_position =
            self.free.body.x[mat_index] + (asked_next - asked_here) + maths::copysign(closing_step, path_distance);
        kernel::force_to_reach(scheme, &self.free.body, mat_index, aim_position).clamp(-force_limit, force_limit)
    }

    /// Read back the ergon that holds a tracked key, once all other forces of the frame are known.
    pub(crate) fn settle(&mut self, script: &VoiceScript, scene: &mut Scene<'_>, n: u64) {
        if let Some(tracked) = self.tracked.take() {
            let force = kernel::force_to_reach(scene.scheme, scene.body, script.struck, tracked.x);
            let blow = Blow {
                frame: n,
                mat: script.struck,
                source: tracked.source,
                force,
                particle: None,
                is_stream: true,
            };
            let report = &mut scene.reports[tracked.gesture];
            let sparks = &mut self.sparks;
            blow.record(scene.scheme, scene.body, report, scene.stream, sparks);
        }
    }

    /// The force that does what is asked, without a limit [N].
    fn unlimited_force(&mut self, script: &VoiceScript, scene: &Scene<'_>, n: u64, request: &Ask) -> f64 {
        let Some(running) = &self.running else {
            return 0.0;
        };
        let free_key = &script.free;
        match (*request, scene.gestures[running.gesture].gesture.manner.touch) {
            (Ask::Pass(x), Touch::Open) => free_key.force_to_reach(&self.free, x, &self.targets, &mut self.buffers),
            (Ask::Pass(x), Touch::Tracked) => kernel::force_to_reach(scene.scheme, scene.body, script.struck, x),
            (Ask::Aim { to, x }, touch) => {
                if touch == Touch::Tracked {
                    // Aim from the position of the scene's key, with its loads.
                    for (local, &member) in free_key.members.iter().enumerate() {
                        self.free.body.x[local] = scene.body.x[member];
                        self.free.body.d[local] = scene.body.d[member];
                    }
                    free_key.forces(&mut self.free, n, &mut self.buffers.laws, &mut self.targets);
                }
                free_key.force_to_arrive(&self.free, n, to, x, &mut self.buffers)
            }
        }
    }
}

impl Blow {
    /// Add the ergon to the report, the stream and the sparks, before its force is added to the sum.
    fn record(
        &self,
        scheme: &Scheme,
        body: &Body,
        report: &mut GestureReport,
        stream: &mut Stream,
        sparks: &mut Sparks,
    ) {
        let time_step = 1.0 / scheme.rate;
        let (mass, impulse) = (time_step * time_step / scheme.w[self.mat], self.force * time_step);
        report.n_ergons += 1;
        report.velocity_step_max = report.velocity_step_max.max(impulse.abs() / mass);
        report.force_max = report.force_max.max(self.force.abs());
        let record = |velocity| {
            let strike_time = self.frame as f64 * time_step;
            let mut record = Record::event(strike_time, self.mat, self.source, mass, velocity, impulse);
            if let Some((mass, particle_speed)) = self.particle {
                (record.mass, record.speed) = (mass, particle_speed);
            }
            record
        };
        if stream.is_kept() {
            // The velocity without the ergon: its force is not in the sum yet.
            let velocity = kernel::centred_velocity(scheme, body, self.mat);
            stream.push(self.frame, record(velocity));
        }
        if sparks.are_watched() {
            sparks.add(&record(0.0), self.is_stream);
        }
    }
}
