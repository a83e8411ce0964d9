//! Parts that diverge: named and stopped, or muted while all others play on.

use super::delayed_ports::PortBinding;
use super::glide::{RetainedRuns, follow_retained};
use super::{EnergyGain, Island, bodies};
use crate::archive::{Archive, Damaged, State, state_of};
use crate::kernel;
use crate::network::Term;
use crate::scheme::{LinkRun, Scheme, Spring};
use crate::timeline::Drive;

/// A muted part's outputs fade from where they were over this time [s].
const FADE_SECONDS: f64 = 0.005;

/// What to do with a part that diverges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnFault {
    /// End the run with a `Fault` (a render).
    Stop,
    /// Mute the part, name it, go on (a performance).
    Mute,
}

/// A part diverged, or created energy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}", self.sentence())]
pub struct Fault {
    /// The module that diverged first, by its name in the score.
    pub module: String,
    /// Message about the energy that the module created; `None`: its motion diverged.
    pub energy_message: Option<String>,
    /// The part of the module.
    pub part: String,
    /// Frame of the fault.
    pub frame: u64,
    /// Time of the fault [s].
    pub seconds: f64,
}

impl Fault {
    fn sentence(&self) -> String {
        let Self { module, seconds, .. } = self;
        self.energy_message.clone().unwrap_or_else(|| {
            format!("the motion of {module} diverged at {seconds:.3} s; reduce K, weaken the strikes or raise the rate")
        })
    }

    /// The fault with its frame in the scene, in place of the step of its island.
    pub(crate) fn in_scene(self, island: &Island) -> Self {
        Self {
            frame: island.scene_frame_at(self.frame),
            ..self
        }
    }
}

/// Which parts are muted, and since when.
#[derive(Clone, Debug)]
pub(super) struct MutedParts {
    /// Frame at which each part was muted   (n_parts)
    mute_frames: Vec<Option<u64>>,
    /// Last finite sample of each output   (n_out)
    last_samples: Vec<f64>,
    /// Outputs that listen to a muted part, and since when  (n_out)
    fade_starts: Vec<Option<u64>>,
}

/// Only parts that are muted are written: how many parts a score has changes nothing in an island.
impl State for MutedParts {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        let mut muted_parts: Vec<(usize, u64)> = self.iter().collect();
        archive.list(&mut muted_parts)?;
        self.mute_frames.fill(None);
        for (part, frame) in muted_parts {
            *self.mute_frames.get_mut(part).ok_or(Damaged)? = Some(frame);
        }
        state_of!(self, archive, last_samples, fade_starts)
    }
}

impl MutedParts {
    pub(super) fn new(scheme: &Scheme) -> Self {
        Self {
            mute_frames: vec![None; scheme.n_parts],
            last_samples: vec![0.0; scheme.n_out()],
            fade_starts: vec![None; scheme.n_out()],
        }
    }

    /// Take over the last samples, from which outputs fade when a part is muted.
    pub(super) fn continue_from(&mut self, old: &Self) {
        if self.last_samples.len() == old.last_samples.len() {
            self.last_samples.copy_from_slice(&old.last_samples);
        }
    }

    pub(super) fn is_muted(&self, part: usize) -> bool {
        self.mute_frames[part].is_some()
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (usize, u64)> + '_ {
        self.mute_frames
            .iter()
            .enumerate()
            .filter_map(|(part, mute_frame)| mute_frame.map(|frame| (part, frame)))
    }

    /// Fade the outputs of muted parts from their last finite sample; keep the samples of the others. A force may be
    /// non-finite one frame before a position shows it: that frame repeats the sample before.
    pub(super) fn fade(&mut self, n: u64, scheme: &Scheme, out: &mut [f64]) {
        let fade_steps = FADE_SECONDS * scheme.rate;
        for ((sample, last_sample), fade_start) in out.iter_mut().zip(&mut self.last_samples).zip(&self.fade_starts) {
            match fade_start {
                Some(fade_start) => *sample = *last_sample * (1.0 - (n - fade_start) as f64 / fade_steps).max(0.0),
                None if sample.is_finite() => *last_sample = *sample,
                None => *sample = *last_sample,
            }
        }
    }
}

impl Island {
    /// Handles a step that left a position beyond all bounds: stops with the name of the module, or mutes its part.
    #[cold]
    pub(super) fn handle_fault(&mut self) -> Result<(), Fault> {
        let fault_step = self.state.frame;
        while let Some((module_name, part)) = self
            .state
            .motion
            .bodies
            .iter()
            .find_map(bodies::RunningBody::diverged_mat)
        {
            if self.script.on_fault == OnFault::Stop {
                return Err(self.fault_in_part(module_name, part, None));
            }
            self.mute(part, fault_step);
        }
        while let Some(diverged_mat) = self.diverged_mat() {
            let part = self.script.scheme.part[diverged_mat] as usize;
            if self.script.on_fault == OnFault::Stop {
                return Err(self.fault_in_part(self.network.mat_name(diverged_mat), part, None));
            }
            self.mute(part, fault_step);
        }
        Ok(())
    }

    /// A MAT whose position is beyond all bounds, one that moves if there is one.
    fn diverged_mat(&self) -> Option<usize> {
        let (positions, inverse_masses) = (&self.state.motion.modules.x, &self.script.scheme.w);
        let diverged = (0..positions.len()).filter(|&mat| !kernel::is_bounded(positions[mat]));
        diverged.min_by_key(|&mat| inverse_masses[mat] == 0.0)
    }

    pub(super) fn fault_in_part(&self, module: String, part: usize, gain: Option<EnergyGain>) -> Fault {
        let seconds = self.state.frame as f64 / self.script.scheme.rate;
        Fault {
            energy_message: gain.map(|gain| gain.sentence(&module, seconds)),
            module,
            part: self.network.parts()[part].name.clone(),
            frame: self.state.frame,
            seconds,
        }
    }

    /// Take a part out of the scene: its MATs stay at their rest positions, and its links are removed.
    pub(super) fn mute(&mut self, part: usize, mute_frame: u64) {
        let state = &mut self.state;
        state.monitors.muted_parts.mute_frames[part] = Some(mute_frame);
        // A part is muted at most once in a run, so a copy of the scheme is acceptable.
        let script = std::sync::Arc::make_mut(&mut self.script);
        let scheme = &mut script.scheme;
        scheme.equal_ranges = Vec::new();
        let is_muted: Vec<bool> = scheme.part.iter().map(|&mat_part| mat_part as usize == part).collect();
        for (mat, _) in is_muted.iter().enumerate().filter(|(_, is_muted)| **is_muted) {
            // A rest position beyond all bounds would cause the next fault at once.
            let rest_position = Some(scheme.rest[mat]).filter(|&x| kernel::is_bounded(x));
            state.motion.modules.x[mat] = rest_position.unwrap_or(0.0);
            state.motion.modules.d[mat] = 0.0;
            (scheme.w[mat], scheme.kappa[mat], scheme.zeta[mat]) = (0.0, 0.0, 0.0);
        }
        let touches_part = |first_a: usize, first_b: usize, len: usize| {
            [first_a, first_b]
                .iter()
                .any(|&mat| is_muted[mat..mat + len].contains(&true))
        };
        let mut is_link_cut = vec![false; scheme.n_lia];
        let run_touches_part = |run: &LinkRun| {
            if let Some(pairs) = run.pairwise() {
                return pairs.point_ranges().any(|range| is_muted[range].contains(&true));
            }
            (0..run.n_axes()).any(|axis| {
                let (first_a, first_b) = run.pair(0, axis);
                touches_part(first_a, first_b, run.len)
            })
        };
        for run in scheme.link_runs().filter(|run| run_touches_part(run)) {
            state.motion.modules.link_forces[run.links()].fill(0.0);
            is_link_cut[run.links()].fill(true);
        }
        let keeps_run = |run: &LinkRun| !run_touches_part(run);
        let keeps_spring = |spring: &Spring| !touches_part(spring.a, spring.b, spring.len);
        follow_retained(
            &mut script.led_links,
            &RetainedRuns::new(scheme, keeps_run, keeps_spring),
        );
        scheme.runs.retain(keeps_run);
        scheme.fused_springs.retain(keeps_spring);
        scheme.exact_runs.retain(keeps_run);
        state.motion.scratch.set_springs(&scheme.fused_springs, scheme.n_mat());
        if let Some(guard) = &mut state.monitors.guard {
            guard.unwatch(|mat| is_muted[mat]);
        }
        if let Some(gains) = &mut state.monitors.energy_gains {
            gains.remove_links_of(&is_muted);
        }
        state.monitors.energy_rise = None;
        if state.parameters.changing_scheme.is_some() {
            state.parameters.changing_scheme = Some(scheme.with_changing_coefficients());
        }
        if let Some(fine_links) = &mut state.motion.fine_links {
            let mut retained_count = 0;
            let new_body_indices: Vec<Option<usize>> = (state.motion.bodies.iter())
                .map(|body| {
                    let stays = !body.touches_part(&is_muted, part);
                    retained_count += usize::from(stays);
                    stays.then(|| retained_count - 1)
                })
                .collect();
            for link in fine_links.remove_parts(&is_muted, &new_body_indices) {
                state.motion.modules.link_forces[link] = 0.0;
                is_link_cut[link] = true;
            }
        }
        let is_on_part = |body: &&bodies::RunningBody| body.touches_part(&is_muted, part);
        for body in state.motion.bodies.iter().filter(is_on_part) {
            for output in body.outputs() {
                state.monitors.muted_parts.fade_starts[output as usize].get_or_insert(mute_frame);
            }
        }
        state.motion.bodies.retain(|body| !body.touches_part(&is_muted, part));
        let ends_on_part = |port: &PortBinding| is_muted[port.port_mat] || is_muted[port.key_mat];
        for port in script.port_bindings.iter().filter(|port| ends_on_part(port)) {
            state.motion.modules.d[port.port_mat] = 0.0;
        }
        let mut flags = script.port_bindings.iter().map(|port| !ends_on_part(port));
        state.sources.delayed_forces.retain(|_| flags.next().unwrap_or(true));
        drop(flags);
        script.port_bindings.retain(|port| !ends_on_part(port));
        let ends_on_part = |drive: &Drive| is_muted[drive.mat] || drive.port().is_some_and(|port| is_muted[port.key]);
        script.drives.retain(|drive| !ends_on_part(drive));
        let mut flags = script.sound_drives.iter().map(|drive| !is_muted[drive.mat]);
        let input_signals = &mut state.sources.input_signals;
        input_signals.retain(|_| flags.next().unwrap_or(true));
        drop(flags);
        script.sound_drives.retain(|drive| !is_muted[drive.mat]);
        let mut flags = script.voices.iter().map(|voice| !is_muted[voice.struck_mat]);
        state.sources.voices.retain(|_| flags.next().unwrap_or(true));
        drop(flags);
        script.voices.retain(|voice| !is_muted[voice.struck_mat]);
        let fade_starts = &mut state.monitors.muted_parts.fade_starts;
        start_fades(scheme, (&is_muted, &is_link_cut), fade_starts, mute_frame);
    }
}

/// Let outputs that hear the marked MATs or links fade from a frame on.
fn start_fades(
    scheme: &Scheme,
    (is_muted, is_link_cut): (&[bool], &[bool]),
    fade_starts: &mut [Option<u64>],
    mute_frame: u64,
) {
    for (output, fade_start) in scheme.outputs.iter().zip(fade_starts) {
        let hears_part = output.terms.iter().any(|term| match *term {
            Term::Position { first, len, .. } | Term::Ground { first, len, .. } => {
                is_muted[first..first + len].contains(&true)
            }
            Term::Force { first, len, .. } | Term::Length { first, len, .. } => {
                is_link_cut[first..first + len].contains(&true)
            }
        });
        if hears_part {
            fade_start.get_or_insert(mute_frame);
        }
    }
}
