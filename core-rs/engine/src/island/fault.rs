//! Parts that diverge: named and stopped, or muted while all others play on.

use super::delayed_ports::PortBinding;
use super::{Gain, Island, inside};
use crate::archive::{Archive, Damaged, State, state_of};
use crate::kernel;
use crate::network::Term;
use crate::scheme::{Scheme, Spring};
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
            frame: island.frame_at(self.frame),
            ..self
        }
    }
}

/// Which parts are muted, and since when.
#[derive(Clone, Debug)]
pub(super) struct Mutes {
    /// Frame at which each part was muted   (n_parts)
    since: Vec<Option<u64>>,
    /// Last finite sample of each output   (n_out)
    last: Vec<f64>,
    /// Outputs that listen to a muted part, and since when  (n_out)
    outputs: Vec<Option<u64>>,
}

/// Only parts that are muted are written: how many parts a score has changes nothing in an island.
impl State for Mutes {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        let mut muted_parts: Vec<(usize, u64)> = self.list().collect();
        archive.list(&mut muted_parts)?;
        self.since.fill(None);
        for (part, frame) in muted_parts {
            *self.since.get_mut(part).ok_or(Damaged)? = Some(frame);
        }
        state_of!(self, archive, last, outputs)
    }
}

impl Mutes {
    pub(super) fn new(scheme: &Scheme) -> Self {
        Self {
            since: vec![None; scheme.n_parts],
            last: vec![0.0; scheme.n_out()],
            outputs: vec![None; scheme.n_out()],
        }
    }

    /// Take over the last samples, from which outputs fade when a part is muted.
    pub(super) fn continue_from(&mut self, old: &Self) {
        if self.last.len() == old.last.len() {
            self.last.copy_from_slice(&old.last);
        }
    }

    pub(super) fn is_mute(&self, part: usize) -> bool {
        self.since[part].is_some()
    }

    pub(super) fn list(&self) -> impl Iterator<Item = (usize, u64)> + '_ {
        self.since
            .iter()
            .enumerate()
            .filter_map(|(part, since)| since.map(|frame| (part, frame)))
    }

    /// Fade the outputs of muted parts from their last finite sample; keep the samples of the others. A force may be
    /// non-finite one frame before a position shows it: that frame repeats the sample before.
    pub(super) fn fade(&mut self, n: u64, scheme: &Scheme, out: &mut [f64]) {
        let fade_steps = FADE_SECONDS * scheme.rate;
        for ((sample, last), since) in out.iter_mut().zip(&mut self.last).zip(&self.outputs) {
            match since {
                Some(since) => *sample = *last * (1.0 - (n - since) as f64 / fade_steps).max(0.0),
                None if sample.is_finite() => *last = *sample,
                None => *sample = *last,
            }
        }
    }
}

impl Island {
    /// Handles a step that left a position beyond all bounds: stops with the name of the module, or mutes its part.
    #[cold]
    pub(super) fn fault(&mut self) -> Result<(), Fault> {
        let fault_step = self.state.frame;
        while let Some((module_name, part)) = self.state.matter.bodies.iter().find_map(inside::RunningBody::diverged) {
            if self.script.on_fault == OnFault::Stop {
                return Err(self.fault_of(module_name, part, None));
            }
            self.mute(part, fault_step);
        }
        while let Some(faulty_mat) = self.diverged_mat() {
            let part = self.script.scheme.part[faulty_mat] as usize;
            if self.script.on_fault == OnFault::Stop {
                return Err(self.fault_of(self.network.mat_name(faulty_mat), part, None));
            }
            self.mute(part, fault_step);
        }
        Ok(())
    }

    /// A MAT whose position is beyond all bounds, one that moves if there is one.
    fn diverged_mat(&self) -> Option<usize> {
        let (positions, inverse_masses) = (&self.state.matter.body.x, &self.script.scheme.w);
        let diverged = (0..positions.len()).filter(|&mat| !kernel::is_bounded(positions[mat]));
        diverged.min_by_key(|&mat| inverse_masses[mat] == 0.0)
    }

    pub(super) fn fault_of(&self, module: String, part: usize, gain: Option<Gain>) -> Fault {
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
    pub(super) fn mute(&mut self, part: usize, n: u64) {
        let state = &mut self.state;
        state.watch.mutes.since[part] = Some(n);
        // A part is muted at most once in a run, so a copy of the scheme is acceptable.
        let script = std::sync::Arc::make_mut(&mut self.script);
        let scheme = &mut script.scheme;
        scheme.equal_ranges = Vec::new();
        let is_muted: Vec<bool> = scheme.part.iter().map(|&mat_part| mat_part as usize == part).collect();
        for (mat, _) in is_muted.iter().enumerate().filter(|(_, is_muted)| **is_muted) {
            // A rest position beyond all bounds would cause the next fault at once.
            let rest_position = Some(scheme.rest[mat]).filter(|&x| kernel::is_bounded(x));
            state.matter.body.x[mat] = rest_position.unwrap_or(0.0);
            state.matter.body.d[mat] = 0.0;
            (scheme.w[mat], scheme.kappa[mat], scheme.zeta[mat]) = (0.0, 0.0, 0.0);
        }
        let touches_part = |first_a: usize, first_b: usize, len: usize| {
            [first_a, first_b]
                .iter()
                .any(|&first| is_muted[first..first + len].contains(&true))
        };
        let mut is_link_cut = vec![false; scheme.n_lia];
        let run_touches_part = |run: &crate::scheme::Run| {
            if let Some(pairs) = run.pairwise() {
                return pairs
                    .point_ranges()
                    .any(|index_span| is_muted[index_span].contains(&true));
            }
            (0..run.n_axes()).any(|axis| {
                let (first_a, first_b) = run.pair(0, axis);
                touches_part(first_a, first_b, run.len)
            })
        };
        let all_runs = scheme.runs.iter().chain(&scheme.exact);
        for run in all_runs.filter(|run| run_touches_part(run)) {
            let index_span = run.first..run.first + run.len;
            state.matter.body.link[index_span.clone()].fill(0.0);
            is_link_cut[index_span].fill(true);
        }
        scheme.runs.retain(|run| !run_touches_part(run));
        let meets_part = |spring: &Spring| touches_part(spring.a, spring.b, spring.len);
        scheme.fused.retain(|spring| !meets_part(spring));
        scheme.exact.retain(|run| !run_touches_part(run));
        state.matter.laws.set_springs(&scheme.fused, scheme.n_mat());
        if let Some(guard) = &mut state.watch.guard {
            guard.unwatch(|mat| is_muted[mat]);
        }
        if let Some(gains) = &mut state.watch.gains {
            gains.release(&is_muted);
        }
        state.watch.energy_rise = None;
        if state.values.scheme.is_some() {
            state.values.scheme = Some(scheme.with_changing_coefficients());
        }
        if let Some(fine_state) = &mut state.matter.fine {
            let mut bodies_staying = 0;
            let body_places: Vec<Option<usize>> = (state.matter.bodies.iter())
                .map(|body| {
                    let stays = !body.is_among(&is_muted, part);
                    bodies_staying += usize::from(stays);
                    stays.then(|| bodies_staying - 1)
                })
                .collect();
            for link in fine_state.release(&is_muted, &body_places) {
                state.matter.body.link[link] = 0.0;
                is_link_cut[link] = true;
            }
        }
        for body in state.matter.bodies.iter().filter(|body| body.is_among(&is_muted, part)) {
            for output in body.outputs() {
                state.watch.mutes.outputs[output as usize].get_or_insert(n);
            }
        }
        state.matter.bodies.retain(|body| !body.is_among(&is_muted, part));
        let ends_on_part = |port: &PortBinding| is_muted[port.port] || is_muted[port.key];
        for port in script.port_bindings.iter().filter(|port| ends_on_part(port)) {
            state.matter.body.d[port.port] = 0.0;
        }
        let mut stays = script.port_bindings.iter().map(|port| !ends_on_part(port));
        state.hands.port_states.retain(|_| stays.next().unwrap_or(true));
        drop(stays);
        script.port_bindings.retain(|port| !ends_on_part(port));
        let ends_on_part = |drive: &Drive| {
            let port = drive.port();
            is_muted[drive.mat] || port.is_some_and(|port| is_muted[port.key])
        };
        script.drives.retain(|drive| !ends_on_part(drive));
        let mut stays = script.sound_drives.iter().map(|drive| !is_muted[drive.mat]);
        state.hands.played.retain(|_| stays.next().unwrap_or(true));
        drop(stays);
        script.sound_drives.retain(|drive| !is_muted[drive.mat]);
        let mut stays = script.voices.iter().map(|voice| !is_muted[voice.struck]);
        state.hands.voices.retain(|_| stays.next().unwrap_or(true));
        drop(stays);
        script.voices.retain(|voice| !is_muted[voice.struck]);
        for (output, since) in scheme.outputs.iter().zip(&mut state.watch.mutes.outputs) {
            let listens = output.terms.iter().any(|term| match *term {
                Term::Position { first, len, .. } | Term::Ground { first, len, .. } => {
                    is_muted[first..first + len].contains(&true)
                }
                Term::Force { first, len, .. } | Term::Length { first, len, .. } => {
                    is_link_cut[first..first + len].contains(&true)
                }
            });
            if listens {
                since.get_or_insert(n);
            }
        }
    }
}
