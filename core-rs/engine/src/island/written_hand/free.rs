//! The free key: a copy of the key alone, for which a gesture is written.

pub(crate) mod frame_powers;

use std::sync::Arc;

use crate::interrupt;
use crate::island::slow::{self, Slow};
use crate::kernel;
use crate::kernel::KernelScratch;
use crate::kernel::thread_team::ThreadTeam;
use crate::scheme::{LinkRunKind, Scheme};
use crate::state::{ImposedTarget, ModuleState};
use crate::timeline::Drive;
use frame_powers::FramePowers;

/// Most rounds: enough for a non-linear key, because the secant method multiplies the number of correct digits by 1.6 a
/// round.
const ROUNDS_MAX: usize = 40;

/// Frames between two polls for an interrupt in a trial run: some 50 µs.
const POLL_FRAMES: u64 = 4096;
/// Work of a step of the free key, in units of `interrupt::spend`.
const WORK_PER_STEP: usize = 64;

/// A key that a strike moves by less than this share of what it would move a free mass comes back to where it was
/// (after a multiple of half its period), or never gets there: the rest is rounding.
const EFFECT_MIN: f64 = 1e-9;

/// A key's part on its own. Constant while it runs; what changes is its [`FreeMotion`].
#[derive(Clone, Debug)]
pub(crate) struct FreeKey {
    pub(crate) scheme: Arc<Scheme>,
    /// Index of the struck MAT in the free key.
    pub(crate) struck_mat: usize,
    /// Index in the scene of each of the free key's MATs.
    pub(crate) scene_mats: Vec<usize>,
    /// Forces and imposed points inside the key (its weight, say), with indices of the free key.
    pub(crate) drives: Vec<Drive>,
    /// Its slow bodies, as in the scene's key.
    pub(crate) slow_bodies: Vec<Slow>,
}

/// The motion of a free key.
#[derive(Clone, Debug)]
pub(crate) struct FreeMotion {
    pub(crate) modules: ModuleState,
    slow_bodies: Vec<slow::RunningSlow>,
}

crate::archive::state!(FreeMotion { modules, slow_bodies });

impl FreeKey {
    /// Whether the motion of another free key fits this one; `name_of` and `other_name_of` give the names
    /// of MATs in the two scenes.
    pub(crate) fn is_compatible_with(
        &self,
        other: &Self,
        name_of: impl Fn(usize) -> String,
        other_name_of: impl Fn(usize) -> String,
    ) -> bool {
        let is_same_body = |(a, b): (&Slow, &Slow)| a.is_same(b);
        self.scheme.n_lia == other.scheme.n_lia
            && self.slow_bodies.len() == other.slow_bodies.len()
            && self.slow_bodies.iter().zip(&other.slow_bodies).all(is_same_body)
            && self.scene_mats.len() == other.scene_mats.len()
            && self
                .scene_mats
                .iter()
                .zip(&other.scene_mats)
                .all(|(&a, &b)| name_of(a) == other_name_of(b))
    }
}

/// The force near `guess` [N] at which `offset_at` is 0 [m], which rises with the force by at most `compliance_max`
/// [m/N].
fn find_force(guess: f64, compliance_max: f64, offset_at: &mut dyn FnMut(f64) -> f64) -> f64 {
    let (mut bracket_force, mut bracket_offset) = (guess, offset_at(guess));
    if bracket_offset.abs() <= kernel::SLIDE_DISTANCE_MIN {
        return bracket_force;
    }
    let mut search_step = 2.0 * bracket_offset / compliance_max;
    let (mut newest_force, mut newest_offset) = (bracket_force, bracket_offset);
    for _ in 0..ROUNDS_MAX {
        newest_force = guess - search_step;
        newest_offset = offset_at(newest_force);
        if newest_offset * bracket_offset <= 0.0 {
            break;
        }
        (bracket_force, bracket_offset) = (newest_force, newest_offset);
        search_step *= 2.0;
    }
    for round in 0..2 * ROUNDS_MAX {
        if newest_offset.abs() <= kernel::SLIDE_DISTANCE_MIN || newest_offset * bracket_offset > 0.0 {
            break;
        }
        let middle_force = 0.5 * (bracket_force + newest_force);
        let secant_force =
            newest_force - newest_offset * ((newest_force - bracket_force) / (newest_offset - bracket_offset));
        let next_force = if round % 3 == 2 { middle_force } else { secant_force };
        let next_offset = offset_at(next_force);
        if next_offset * newest_offset < 0.0 {
            (bracket_force, bracket_offset) = (newest_force, newest_offset);
        }
        (newest_force, newest_offset) = (next_force, next_offset);
    }
    newest_force
}

impl FreeMotion {
    /// Copy another's motion without allocating.
    fn copy_motion(&mut self, other: &Self) {
        self.modules.copy_motion(&other.modules);
        for (slow_body, other) in self.slow_bodies.iter_mut().zip(&other.slow_bodies) {
            slow_body.copy_motion(other);
        }
    }

    /// Begin at frame `n`.
    pub(crate) fn seek(&mut self, n: u64) {
        self.slow_bodies.iter_mut().for_each(|slow| slow.seek(n));
    }

    /// For a key at rest: advance by `frames`, which may be negative.
    pub(crate) fn shift_frames(&mut self, frames: i64) {
        self.slow_bodies.iter_mut().for_each(|slow| slow.shift_frames(frames));
    }

    /// Most frames between two kicks of a slow part.
    pub(crate) fn kick_interval(&self) -> u32 {
        let kick_intervals = self.slow_bodies.iter().map(slow::RunningSlow::kick_interval);
        kick_intervals.max().unwrap_or(1)
    }

    /// Set slow bodies from the MATs, after these were set.
    pub(crate) fn set_slow_bodies(&mut self) {
        for slow in &mut self.slow_bodies {
            slow.set_motion_of_ports(&self.modules);
            slow.set_ports(&mut self.modules);
        }
    }

    /// The velocity that a MAT lacks when a path ends for it [m a frame].
    fn release_velocity(&self, mat: usize) -> f64 {
        self.slow_bodies.iter().map(|slow| slow.release_velocity(mat)).sum()
    }

    /// Give a MAT that is led along a path the velocity that it lacks, if its springs pull next; returns it [m a
    /// frame].
    pub(crate) fn apply_pull_release(&mut self, mat: usize) -> f64 {
        let mut velocity_sum = 0.0;
        for slow in &mut self.slow_bodies {
            let velocity_change = slow.pull_release_velocity(mat);
            slow.add_velocity(mat, velocity_change);
            velocity_sum += velocity_change;
        }
        velocity_sum
    }

    /// Corrections of a MAT's velocity [m a frame] and of its change a frame, if both are estimated from successive
    /// frames.
    pub(crate) fn estimate_corrections(&self, mat: usize, is_led: bool) -> [f64; 2] {
        let corrections = self
            .slow_bodies
            .iter()
            .map(|slow| slow.estimate_corrections(mat, is_led));
        corrections.fold([0.0; 2], |[v, a], [dv, da]| [v + dv, a + da])
    }
}

/// Buffers of one voice.
#[derive(Clone, Debug)]
pub(crate) struct VoiceBuffers {
    pub(crate) trial_motion: FreeMotion,
    pub(crate) scratch: KernelScratch,
    pub(crate) targets: Vec<ImposedTarget>,
    /// Whether nothing but the flow of slow bodies moves the key between gestures.
    pub(crate) has_only_flow: bool,
    /// Present if one frame of the key is an affine map.
    pub(crate) frame_powers: Option<FramePowers>,
}

impl FreeKey {
    /// Its motion at frame 0, from that of its MATs.
    pub(crate) fn start_motion(&self, mut modules: ModuleState) -> FreeMotion {
        let running_slow = |slow: &Slow| slow::RunningSlow::new(slow, &modules);
        let slow_bodies: Vec<slow::RunningSlow> = self.slow_bodies.iter().map(running_slow).collect();
        if !slow_bodies.is_empty() {
            modules.free_port_motion = vec![0.0; modules.x.len()];
            slow_bodies.iter().for_each(|slow| slow.set_ports(&mut modules));
        }
        FreeMotion { modules, slow_bodies }
    }

    /// The motion of a key at 0, at rest.
    pub(crate) fn motion_at_rest(&self) -> FreeMotion {
        let zero_vector = vec![0.0; self.scheme.n_mat()];
        self.start_motion(ModuleState::new(&self.scheme, zero_vector.clone(), zero_vector))
    }

    /// The free key of a layer: its positions are displacements from the motion of the voice below, with contacts open.
    pub(crate) fn layer_key(&self) -> Self {
        let mut scheme = (*self.scheme).clone();
        scheme.rest.fill(0.0);
        scheme.runs.retain(|run| !matches!(run.kind, LinkRunKind::But(_)));
        scheme.exact_runs.clear();
        scheme.runs.iter_mut().for_each(|run| run.rest = 0.0);
        Self {
            scheme: Arc::new(scheme),
            drives: Vec::new(),
            slow_bodies: self.slow_bodies.iter().map(Slow::layer_body).collect(),
            ..self.clone()
        }
    }

    /// Whether `steps` are more than a quarter of the key's own period. Beyond it, knots are met, but the motion
    /// between them swings far outside. A struck key at rest is back after half a period.
    pub(crate) fn is_past_quarter(&self, steps: u64) -> bool {
        let deviation_key = self.layer_key();
        let mut free_motion = deviation_key.motion_at_rest();
        let (mut scratch, mut targets) = (KernelScratch::new(&deviation_key.scheme), Vec::new());
        // A push that moves the key by a micrometre in one step: small, so that laws keep their slope.
        let test_push = 1e-6 / self.scheme.w[self.struck_mat];
        (0..2 * steps).any(|n| {
            if n.is_multiple_of(POLL_FRAMES) {
                interrupt::spend(WORK_PER_STEP * POLL_FRAMES as usize);
            }
            deviation_key.sum_forces(&mut free_motion, n, &mut scratch, &mut targets);
            let test_push = if n == 0 { test_push } else { 0.0 };
            deviation_key.strike_and_move(&mut free_motion, n, test_push, &mut targets);
            free_motion.modules.x[deviation_key.struck_mat] < 0.0
        })
    }

    /// Sum the forces at frame `n`, without that of the ergon.
    pub(crate) fn sum_forces(
        &self,
        motion: &mut FreeMotion,
        n: u64,
        scratch: &mut KernelScratch,
        targets: &mut Vec<ImposedTarget>,
    ) {
        let modules = &mut motion.modules;
        kernel::compute_link_forces(&self.scheme, &[], modules, scratch, &mut ThreadTeam::alone());
        targets.clear();
        for drive in &self.drives {
            drive.apply(n, self.scheme.rate, modules, targets);
        }
    }

    /// The ergon's force that brings the struck MAT to x at the next frame [N], once the other forces
    /// are summed; `targets` are the key's own imposed points.
    pub(crate) fn force_to_reach(
        &self,
        motion: &FreeMotion,
        x: f64,
        targets: &[ImposedTarget],
        buffers: &mut VoiceBuffers,
    ) -> f64 {
        let (scheme, struck_mat, modules) = (&*self.scheme, self.struck_mat, &motion.modules);
        if scheme.exact_runs.is_empty() {
            return kernel::force_to_reach(scheme, modules, struck_mat, x);
        }
        // The force of exact contacts depends on where the ergon takes the MAT, so they are solved for that position.
        let trial_modules = &mut buffers.trial_motion.modules;
        trial_modules.copy_motion(modules);
        trial_modules.force.copy_from_slice(&modules.force);
        buffers.targets.clear();
        buffers.targets.extend_from_slice(targets);
        buffers.targets.push(ImposedTarget {
            mat: struck_mat,
            x,
            previous: 0.0,
        });
        kernel::solve_exact_contacts(scheme, &[], &buffers.targets, trial_modules);
        let force = kernel::force_to_reach(scheme, trial_modules, struck_mat, x);
        if !scheme.has_dry_friction() {
            return force;
        }
        // If friction changes direction within the frame, how much of it acts each way depends on the ergon.
        let mut force_offset = |force: f64| {
            let trial_modules = &mut buffers.trial_motion.modules;
            trial_modules.copy_motion(modules);
            trial_modules.force.copy_from_slice(&modules.force);
            trial_modules.force[struck_mat] += force;
            kernel::solve_exact_contacts(scheme, &[], targets, trial_modules);
            kernel::predict_position(scheme, trial_modules, struck_mat) - x
        };
        find_force(force, scheme.w[struck_mat], &mut force_offset)
    }

    /// The force on the struck MAT that lets it continue freely where a path ends [N].
    pub(crate) fn release_force(&self, motion: &FreeMotion) -> f64 {
        motion.release_velocity(self.struck_mat) / self.scheme.w[self.struck_mat]
    }

    /// Whether nothing but the flow of slow bodies moves it between gestures; `motion` is that of its first frame.
    pub(crate) fn has_only_flow(&self, motion: &FreeMotion) -> bool {
        let scheme = &*self.scheme;
        let has_no_links = scheme.runs.is_empty() && scheme.fused_springs.is_empty() && scheme.exact_runs.is_empty();
        let is_held = |mat: usize| {
            let coefficients = [
                scheme.w[mat],
                scheme.kappa[mat],
                scheme.zeta[mat],
                motion.modules.d[mat],
            ];
            coefficients.iter().all(|value| *value == 0.0)
        };
        let is_port = |mat: usize| motion.slow_bodies.iter().any(|slow| slow.has_port(mat));
        has_no_links
            && self.drives.is_empty()
            && scheme.weight.iter().all(|&weight| weight == 0.0)
            && motion.slow_bodies.iter().all(slow::RunningSlow::is_linear)
            && (0..scheme.n_mat()).all(|mat| is_port(mat) || is_held(mat))
    }

    /// Move by the flow of slow bodies alone, with the same result as [`Self::strike_and_move`] without a force.
    pub(crate) fn step_flow(motion: &mut FreeMotion) {
        let FreeMotion { modules, slow_bodies } = motion;
        for slow in slow_bodies {
            slow.step_flow();
            slow.set_ports(modules);
        }
    }

    /// Add a force on the struck MAT and move from frame n to n + 1.
    pub(crate) fn strike_and_move(&self, motion: &mut FreeMotion, n: u64, force: f64, targets: &mut [ImposedTarget]) {
        let FreeMotion { modules, slow_bodies } = motion;
        modules.force[self.struck_mat] += force;
        kernel::solve_exact_contacts(&self.scheme, &[], targets, modules);
        slow_bodies.iter_mut().for_each(|slow| slow.step(n, &modules.force));
        kernel::advance_mats(&self.scheme, targets, modules, None, &mut ThreadTeam::alone());
        kernel::slide_bristles(&self.scheme, modules);
        kernel::stop_resting_masses(&self.scheme, modules);
        slow_bodies.iter().for_each(|slow| slow.set_ports(modules));
    }

    /// Position of the struck MAT at frame `target_frame`, from `motion` at frame `n`, with one strike at frame `n`
    /// [m].
    fn position_after_strike(
        &self,
        motion: &FreeMotion,
        n: u64,
        target_frame: u64,
        force: f64,
        buffers: &mut VoiceBuffers,
    ) -> f64 {
        let VoiceBuffers {
            trial_motion,
            scratch,
            targets,
            frame_powers,
            ..
        } = buffers;
        trial_motion.copy_motion(motion);
        let stop_frame = match frame_powers {
            Some(_) if target_frame - n >= frame_powers::FRAMES_MIN => n + 1,
            _ => target_frame,
        };
        for frame in n..stop_frame {
            if (frame - n).is_multiple_of(POLL_FRAMES) {
                interrupt::spend(WORK_PER_STEP * POLL_FRAMES as usize);
            }
            self.sum_forces(trial_motion, frame, scratch, targets);
            self.strike_and_move(trial_motion, frame, if frame == n { force } else { 0.0 }, targets);
        }
        if let Some(frame_powers) = frame_powers.as_mut().filter(|_| stop_frame < target_frame) {
            frame_powers.advance(self, trial_motion, target_frame - stop_frame, scratch, targets);
        }
        trial_motion.modules.x[self.struck_mat]
    }

    /// The force at frame `n` that makes the struck MAT pass `x` at frame `target_frame`; 0 if no force can (after a
    /// multiple of half the key's period).
    pub(crate) fn force_to_arrive(
        &self,
        motion: &FreeMotion,
        n: u64,
        target_frame: u64,
        x: f64,
        buffers: &mut VoiceBuffers,
    ) -> f64 {
        let (mut f0, mut y0) = (0.0, self.position_after_strike(motion, n, target_frame, 0.0, buffers));
        // A first guess as for a free mass: F·T²/m·steps = distance.
        let frame_count = (target_frame - n) as f64;
        let first_guess = (x - y0) / (frame_count * self.scheme.w[self.struck_mat]);
        if first_guess == 0.0 {
            return 0.0;
        }
        let (mut f1, mut y1) = (
            first_guess,
            self.position_after_strike(motion, n, target_frame, first_guess, buffers),
        );
        if (y1 - y0).abs() <= EFFECT_MIN * (x - y0).abs() {
            return 0.0;
        }
        for _ in 0..ROUNDS_MAX {
            if y1 == y0 {
                return if y1 == x { f1 } else { 0.0 };
            }
            let f = f0 + (x - y0) * ((f1 - f0) / (y1 - y0));
            if self.scheme.is_linear {
                return f;
            }
            (f0, y0) = (f1, y1);
            (f1, y1) = (f, self.position_after_strike(motion, n, target_frame, f, buffers));
            if (y1 - x).abs() <= 1e-12 + 4.0 * f64::EPSILON * x.abs() {
                break;
            }
        }
        f1
    }
}
