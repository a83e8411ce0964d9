//! An island: its constant script, its changing state, and what can be read of it. `step` advances it.

mod archived_state;
pub(crate) mod bodies;
mod build;
mod coast;
mod contact_peaks;
mod delayed_ports;
mod emulated_key;
mod energy_account;
pub(crate) mod energy_gain;
mod energy_rise;
mod eventless_steps;
mod fault;
mod fine;
pub(crate) mod followed_energy;
mod glide;
mod imposed_work;
mod ledger;
mod live_strikes;
pub(crate) mod mesh;
pub(crate) mod modal;
mod origin;
mod pair_energy;
mod pair_gain;
mod phases;
mod real_hands;
pub(crate) mod record;
mod rest;
mod scene_frames;
mod sleep;
pub(crate) mod slow;
mod sounds_in;
mod step;
mod strikes;
mod takeover;
mod voices;
pub(crate) mod written_hand;

pub use build::SimulationOptions;
pub(crate) use build::{FINE_SUBSTEPS_MIN, StepNumbers, outputs_at_rest};
pub use emulated_key::{EmulatedKey, KeyMotor};
pub(crate) use energy_account::EnergyGain;
pub use fault::{Fault, OnFault};
pub(crate) use fine::ContactOrder;
pub use ledger::Energy;
pub use record::ErgonRecord;
pub(crate) use record::{ErgonStream, FramedErgon};
pub(crate) use takeover::ItemTakeover;

use std::sync::Arc;

use crate::gesture::report::GestureReport;
use crate::guard::{FinerFrames, Guard};
use crate::island::written_hand::voice::{Voice, VoiceScript};
use crate::kernel::KernelScratch;
use crate::network::Network;
use crate::scheme::Scheme;
use crate::state::{ExactWork, ImposedTarget, ModuleState};
use crate::timeline::{Drive, Ergon, Gate, GateContinuation, StrikeForce};
use written_hand::SPARKS;
use written_hand::framed::FramedGesture;

use fault::MutedParts;
use ledger::Ledger;
pub(crate) use sounds_in::INPUT_FRAMES_MAX;

/// Everything that does not change while the simulation runs.
#[derive(Clone, Debug)]
pub(crate) struct Script {
    scheme: Scheme,
    pub(crate) gestures: Vec<FramedGesture>,
    pub(crate) voices: Vec<VoiceScript>,
    strike_forces: Vec<StrikeForce>,
    /// By rising frame.
    ergons: Vec<(u64, Ergon)>,
    pub(crate) gates: Vec<Gate>,
    drives: Vec<Drive>,
    glides: Vec<glide::GlidingMat>,
    led_links: Vec<glide::LedLinks>,
    pub(crate) hand_bindings: Vec<real_hands::HandBinding>,
    pub(crate) port_bindings: Vec<delayed_ports::PortBinding>,
    strike_points: Vec<live_strikes::StrikePoint>,
    sound_drives: Vec<sounds_in::SoundDrive>,
    on_fault: OnFault,
}

/// Everything that changes; a clone of it is a snapshot. Each field is a group: parameters that a step sets, the
/// motion that it advances, sources of excitation, and monitors.
#[derive(Clone, Debug)]
struct State {
    frame: u64,
    parameters: Parameters,
    motion: MotionState,
    sources: ExcitationSources,
    monitors: Monitors,
}

/// Parameters that the timeline sets in each frame, and gates.
#[derive(Clone, Debug)]
struct Parameters {
    /// How far each gate is open now, and (for the ledger) at the next frame   (n_gates each)
    gate_openings: Vec<f64>,
    next_gate_openings: Vec<f64>,
    /// For gates that had another factor in the previous version: where they continue from   (n_gates)
    gate_continuations: Vec<Option<GateContinuation>>,
    /// Factor on every x[n] − x[n−1] at each step; below 1 it acts as additional viscosity.
    velocity_factor: f64,
    /// The scheme with the values of this frame, if glides, leads or laws that follow MATs change it.
    changing_scheme: Option<Box<Scheme>>,
    /// The point after this frame of each lead: a hint, which follows from the frame   (`n_led_links`)
    next_lead_points: Vec<usize>,
}

/// What moves: positions, bodies inside the island, contacts between frames.
#[derive(Clone, Debug)]
struct MotionState {
    modules: ModuleState,
    bodies: Vec<bodies::RunningBody>,
    fine_links: Option<fine::FineLinks>,
    scratch: KernelScratch,
    targets: Vec<ImposedTarget>,
}

/// What plays: written hands, real hands, ergons, sounds that come in.
#[derive(Clone, Debug)]
struct ExcitationSources {
    voices: Vec<Voice>,
    reports: Vec<GestureReport>,
    /// Indices of the next push and of the next ergon.
    next_strike: usize,
    next_ergon: usize,
    /// Sum of the deviations that layers add to each key [m]   (n_keys)
    layer_deviations: Vec<f64>,
    ergon_stream: ErgonStream,
    hand_states: Vec<real_hands::HandState>,
    /// Forces that act on keys after a delay   (n_ports)
    delayed_forces: Vec<delayed_ports::DelayedForces>,
    /// Impulses of live strikes that act in later steps   (n_strike_points)
    pending_strikes: Vec<live_strikes::PendingStrikes>,
    /// What each input received: samples, or a value to which it glides   (n_sound_drives)
    input_signals: Vec<sounds_in::InputSignal>,
}

/// Monitors: peaks of contacts, muted parts, stability, energy.
#[derive(Clone, Debug)]
struct Monitors {
    contact_peaks: contact_peaks::ContactPeaks,
    muted_parts: MutedParts,
    /// Present if links can stiffen beyond the limit of the scheme.
    guard: Option<Box<Guard>>,
    /// Accounts of links that can create energy.
    energy_gains: Option<Box<energy_gain::EnergyGains>>,
    /// The energy of the whole island.
    energy_rise: Option<Box<energy_rise::EnergyRise>>,
    ledger: Option<Ledger>,
}

impl Parameters {
    /// Open the gates as they are at frame `n`.
    fn set_gates(&mut self, gates: &[Gate], n: u64) {
        write_gate_openings(&mut self.gate_openings, gates, &self.gate_continuations, n);
    }

    /// The same for the ledger, at frame `n`, the next one.
    fn set_next_gates(&mut self, gates: &[Gate], n: u64) {
        write_gate_openings(&mut self.next_gate_openings, gates, &self.gate_continuations, n);
    }
}

/// How far each gate is open at frame `n`   (n_gates)
fn write_gate_openings(openings: &mut [f64], gates: &[Gate], continuations: &[Option<GateContinuation>], n: u64) {
    let gate_pairs = gates.iter().zip(continuations);
    for (opening, (gate, continuation)) in openings.iter_mut().zip(gate_pairs) {
        *opening = GateContinuation::opening(continuation.as_ref(), gate, n);
    }
}

impl MotionState {
    /// Give the ports of all bodies their positions and steps.
    fn set_ports(&mut self) {
        for running_body in &self.bodies {
            running_body.set_ports(&mut self.modules);
        }
    }
}

/// A network that plays.
#[derive(Clone, Debug)]
pub(crate) struct Island {
    network: Arc<Network>,
    script: Arc<Script>,
    state: State,
    /// Steps in one frame of the island, and frames of the scene in one frame of the island.
    oversampling: u32,
    frame_interval: u32,
    rest_search: rest::RestSearch,
    /// Present if it sleeps when it is quiet.
    sleep_monitor: Option<sleep::SleepMonitor>,
}

impl Island {
    /// Number of outputs.
    pub(crate) fn n_out(&self) -> usize {
        self.script.scheme.n_out()
    }

    /// Positions now [m], (n_mat).
    pub(crate) fn positions(&self) -> &[f64] {
        &self.state.motion.modules.x
    }

    /// Whether a team of threads can share its work.
    pub(crate) fn can_share_work(&self) -> bool {
        let state = &self.state;
        state.motion.scratch.mesh_partition.is_some()
            || state.motion.bodies.iter().any(bodies::RunningBody::can_share_work)
    }

    /// Steps x[n] − x[n−1] now [m], (n_mat).
    pub(crate) fn backward_steps(&self) -> &[f64] {
        &self.state.motion.modules.d
    }

    /// Reports the position that the gesture of each key requests [m], NaN if none runs, then the deviation of each of
    /// the key's layers [m]. Arguments: key, value, whether it is a layer.
    pub(crate) fn report_gesture_positions(&self, mut report_position: impl FnMut(usize, f64, bool)) {
        for (voice, voice_script) in self.state.sources.voices.iter().zip(&self.script.voices) {
            // The voice of a key comes before its layers.
            let reported_displacement = if voice_script.is_layer {
                voice.deviation(voice_script)
            } else {
                voice.requested_position
            };
            report_position(voice_script.key_index, reported_displacement, voice_script.is_layer);
        }
    }

    /// Reports of all gestures, in the timeline's order.
    pub(crate) fn reports(&self) -> &[GestureReport] {
        &self.state.sources.reports
    }

    /// Whether a contact that is computed finely has been closed.
    pub(crate) fn has_closed_fine_contact(&self) -> bool {
        self.state
            .motion
            .fine_links
            .as_ref()
            .is_some_and(|fine_links| fine_links.has_contact_closed)
    }

    /// Work of contacts that are computed finely, so far.
    pub(crate) fn fine_work(&self) -> fine::FineWork {
        let fine_links = self.state.motion.fine_links.as_ref();
        fine_links.map_or_else(fine::FineWork::default, fine::FineLinks::work)
    }

    /// Work of exact contacts and frictions, so far.
    pub(crate) fn exact_work(&self) -> ExactWork {
        self.state.motion.modules.exact_work
    }

    /// How often the forces of all links were computed for finer frames, so far.
    pub(crate) fn finer_evaluations(&self) -> u64 {
        let guard_frames = self
            .state
            .monitors
            .guard
            .iter()
            .filter_map(|guard| guard.finer_frames());
        let bodies = self.state.motion.bodies.iter();
        let body_frames = bodies.filter_map(|body| Some(body.finer_frames()?.1));
        guard_frames.chain(body_frames).map(|finer| finer.evaluations).sum()
    }

    /// Makes all motion decay by an additional factor `decay_factor` in each step.
    pub(crate) fn damp(&mut self, decay_factor: f64) {
        // The poles of x⁺ = (2 − κ − ζ)x − (1 − ζ)x⁻ have magnitude √(1 − ζ), so a factor `decay_factor²` on the last
        // step scales them by `decay_factor`.
        let step_factor = decay_factor * decay_factor;
        // A new version of an island is damped as the old one was, which wakes nothing.
        if self.state.parameters.velocity_factor != step_factor {
            self.wake();
        }
        self.state.parameters.velocity_factor = step_factor;
        for body in &mut self.state.motion.bodies {
            body.damp(decay_factor);
        }
    }

    /// Raises the squares of the modes of each body to at least the square of their present amplitude.
    pub(crate) fn raise_mode_squares(&self, squares: &mut [Vec<f64>]) {
        for (body, squares) in self.state.motion.bodies.iter().zip(squares) {
            if let Some(modal_body) = body.modal() {
                modal_body.raise_mode_squares(squares);
            }
        }
    }

    /// Ergons since the last call.
    pub(crate) fn take_ergons(&mut self) -> Vec<FramedErgon> {
        self.state.sources.ergon_stream.take_all()
    }

    /// From here on, note the strongest push of each contact and the ergons of written hands.
    pub(crate) fn start_watching(&mut self) {
        self.state.monitors.contact_peaks = contact_peaks::ContactPeaks::new(&self.network);
        let voices = &mut self.state.sources.voices;
        voices.iter_mut().for_each(|voice| voice.sparks.start_watching());
        self.wake_from_rest();
    }

    /// Reports each contact that pushed since the last call: link, frame of the scene, force [N].
    pub(crate) fn take_contact_peaks(&mut self, mut report_peak: impl FnMut(usize, u64, f64)) {
        let mut contact_peaks = std::mem::take(&mut self.state.monitors.contact_peaks);
        contact_peaks.take_peaks(|link, peak| report_peak(link, self.scene_frame_at(peak.frame), peak.force));
        self.state.monitors.contact_peaks = contact_peaks;
    }

    /// Reports the ergons of written hands since the last call.
    pub(crate) fn take_sparks(&mut self, mut report_spark: impl FnMut(ErgonRecord)) {
        for voice in &mut self.state.sources.voices {
            voice.sparks.take_sparks(&mut report_spark);
        }
    }

    /// Largest number of ergons that [`Self::take_sparks`] reports in one call.
    pub(crate) fn sparks_max(&self) -> usize {
        SPARKS * self.state.sources.voices.len()
    }

    /// Whether a link in space is broken.
    pub(crate) fn is_broken(&self, link: usize) -> bool {
        self.state.memory_of(link) == f64::INFINITY
    }

    /// The bodies of the island.
    pub(crate) fn bodies(&self) -> &[bodies::RunningBody] {
        &self.state.motion.bodies
    }

    /// The ledger, if it is kept.
    pub(crate) fn energy(&self) -> Option<Energy> {
        let state = &self.state;
        state.monitors.ledger.as_ref().map(|ledger| {
            ledger.energy(
                state
                    .parameters
                    .changing_scheme
                    .as_deref()
                    .unwrap_or(&self.script.scheme),
                &state.motion.modules,
            )
        })
    }

    /// Muted parts, with the frame of the scene at which each was muted.
    pub(crate) fn muted_parts(&self) -> Vec<(String, u64)> {
        self.state
            .monitors
            .muted_parts
            .iter()
            .map(|(part, step)| {
                let part_name = self.network.parts()[part].name.clone();
                (part_name, self.scene_frame_at(step))
            })
            .collect()
    }

    /// Number of muted parts.
    pub(crate) fn n_muted_parts(&self) -> usize {
        self.state.monitors.muted_parts.iter().count()
    }

    /// Parts whose links stiffened: name, number of frames computed finer, and most steps in one of them.
    pub(crate) fn finer_parts(&self) -> impl Iterator<Item = (&str, u64, u32)> {
        let network_parts = self.network.parts();
        let guard_frames = self.state.monitors.guard.iter().filter_map(|guard| {
            let finer_frames = guard.finer_frames()?;
            let part_name = self.script.scheme.part[finer_frames.stiffest_mat] as usize;
            Some((&*network_parts[part_name].name, finer_frames))
        });
        let bodies = self
            .state
            .motion
            .bodies
            .iter()
            .filter_map(bodies::RunningBody::finer_frames);
        guard_frames.chain(bodies).map(|(part_name, finer_frames)| {
            let FinerFrames { frames, steps_max, .. } = finer_frames.per_frame(self.oversampling);
            (part_name, frames, steps_max)
        })
    }

    /// Reserves room for every target that can occur, because a cloned vector has no spare capacity.
    pub(crate) fn reserve(&mut self) {
        let n_targets = self.script.drives.len() + self.script.voices.len();
        self.state.motion.targets.reserve(n_targets);
        for (voice, voice_script) in self.state.sources.voices.iter_mut().zip(&self.script.voices) {
            voice.reserve(voice_script);
        }
        for body in &mut self.state.motion.bodies {
            body.reserve();
        }
        if let Some(ledger) = &mut self.state.monitors.ledger {
            ledger.reserve(n_targets);
        }
        if let Some(guard) = &mut self.state.monitors.guard {
            guard.reserve(n_targets);
        }
        if let Some(gains) = &mut self.state.monitors.energy_gains {
            gains.reserve(n_targets);
        }
        self.reserve_rest();
    }
}
