//! A network that plays: what is constant, what changes, and what can be read of it. `step` moves it on.

mod build;
mod coast;
mod contact_peaks;
mod emulated_key;
mod energy_account;
pub(crate) mod energy_gain;
mod fault;
pub(crate) mod fine;
pub(crate) mod followed_energy;
mod glide;
pub(crate) mod inside;
mod ledger;
mod live_strikes;
pub(crate) mod mesh;
pub(crate) mod modal;
mod pace;
mod pair_energy;
mod pair_gain;
mod real_hands;
pub(crate) mod record;
mod rest;
pub(crate) mod slow;
mod sounds_in;
mod step;
mod stored;
mod takeover;
pub(crate) mod written_hand;

pub use build::Options;
pub(crate) use build::at_rest;
pub use emulated_key::EmulatedKey;
pub(crate) use energy_account::Gain;
pub use fault::{Fault, OnFault};
pub use ledger::Energy;
pub use record::Record;
pub(crate) use record::{FramedErgon, Stream};
pub(crate) use takeover::ItemTakeover;

use std::sync::Arc;

use crate::gesture::report::Report;
use crate::guard::{FinerFrames, Guard};
use crate::island::written_hand::voice::{Voice, VoiceScript};
use crate::kernel::Laws;
use crate::network::Network;
use crate::scheme::Scheme;
use crate::state::{Body, Target};
use crate::timeline::{Drive, Ergon, Gate, GateContinuation, Push};
use written_hand::SPARKS;
use written_hand::framed::FramedGesture;

use fault::Mutes;
use ledger::Ledger;
pub(crate) use sounds_in::FRAMES_MAX;

/// Everything that does not change while the simulation runs.
#[derive(Clone, Debug)]
pub(crate) struct Script {
    scheme: Scheme,
    pub(crate) gestures: Vec<FramedGesture>,
    pub(crate) voices: Vec<VoiceScript>,
    pushes: Vec<Push>,
    /// By rising frame.
    ergons: Vec<(u64, Ergon)>,
    pub(crate) gates: Vec<Gate>,
    drives: Vec<Drive>,
    glides: Vec<glide::Glide>,
    led: Vec<glide::Led>,
    pub(crate) hand_bindings: Vec<real_hands::HandBinding>,
    strike_points: Vec<live_strikes::StrikePoint>,
    sound_drives: Vec<sounds_in::SoundDrive>,
    on_fault: OnFault,
}

/// Everything that changes: cloning it is a snapshot.
#[derive(Clone, Debug)]
struct State {
    frame: u64,
    body: Body,
    voices: Vec<Voice>,
    reports: Vec<Report>,
    /// Next push and next ergon.
    pushed: usize,
    ergons: usize,
    /// How far each gate is open now, and (for the ledger) at the next frame.
    gates: Vec<f64>,
    gates_next: Vec<f64>,
    /// Of gates that another version stood at elsewhere: from where they come   (n_gates)
    gate_continuations: Vec<Option<GateContinuation>>,
    targets: Vec<Target>,
    /// How far layers take each key [m]   (n_keys)
    layers: Vec<f64>,
    laws: Laws,
    stream: Stream,
    touches: contact_peaks::ContactPeaks,
    /// What is heard between frames   (n_out)
    unheard: Vec<f64>,
    bodies: Vec<inside::RunningBody>,
    fine: Option<fine::Fine>,
    /// Impulses that act in the next step [N·s]   (n_strike_points)
    impulses: Vec<f64>,
    /// What was played into each of the inputs   (n_sound_drives)
    played: Vec<sounds_in::Played>,
    hand_states: Vec<real_hands::HandState>,
    ledger: Option<Ledger>,
    mutes: Mutes,
    /// Where links stiffen.
    guard: Option<Box<Guard>>,
    /// What links took and gave.
    gains: Option<Box<energy_gain::Gains>>,
    /// By how much every step is less than it would be: an extra viscosity.
    damped: f64,
    /// The scheme as it is now, where MATs in it glide.
    scheme: Option<Box<Scheme>>,
}

/// A network that plays.
#[derive(Clone, Debug)]
pub(crate) struct Island {
    network: Arc<Network>,
    script: Arc<Script>,
    state: State,
    /// Steps in a frame of its own, and frames of the scene in one.
    oversampling: u32,
    every: u32,
    rest: rest::Rest,
}

impl Island {
    /// Number of outputs.
    pub(crate) fn n_out(&self) -> usize {
        self.script.scheme.n_out()
    }

    /// Positions now [m], (n_mat).
    pub(crate) fn positions(&self) -> &[f64] {
        &self.state.body.x
    }

    /// Whether a crew can share its work.
    pub(crate) fn is_shared(&self) -> bool {
        let state = &self.state;
        state.laws.mesh_partition.is_some()
            || state.bodies.iter().any(inside::RunningBody::is_shared)
    }

    /// Steps x[n] − x[n−1] now [m], (n_mat).
    pub(crate) fn steps(&self) -> &[f64] {
        &self.state.body.d
    }

    /// Tell where each key's gesture wants it now [m], NaN where none runs; then of each of its layers how far it goes from there.
    pub(crate) fn asked(&self, mut tell: impl FnMut(usize, f64, bool)) {
        for (voice, own) in self.state.voices.iter().zip(&self.script.voices) {
            // A key's own voice stands before its layers.
            let asked = if own.layer {
                voice.deviation(own)
            } else {
                voice.asked
            };
            tell(own.key, asked, own.layer);
        }
    }

    /// Reports of all gestures, in the timeline's order.
    pub(crate) fn reports(&self) -> &[Report] {
        &self.state.reports
    }

    /// Whether a contact that is computed finely has been closed.
    pub(crate) fn has_touched(&self) -> bool {
        self.state
            .fine
            .as_ref()
            .is_some_and(|fine| fine.has_touched)
    }

    /// Work of contacts that are computed finely, so far.
    pub(crate) fn fine_work(&self) -> fine::FineWork {
        let fine = self.state.fine.as_ref();
        fine.map_or_else(fine::FineWork::default, fine::Fine::work)
    }

    /// Steps that the guard added to frames, so far.
    pub(crate) fn guard_steps(&self) -> u64 {
        let each = self.finer();
        each.map(|(_, frames, most)| frames * u64::from(most)).sum()
    }

    /// Let all of it fade by a factor more a step.
    pub(crate) fn damp(&mut self, by: f64) {
        // The poles of x⁺ = (2 − κ − ζ)x − (1 − ζ)x⁻ are as long as the root of what its last step counts.
        self.state.damped = by * by;
        self.wake();
        for body in &mut self.state.bodies {
            body.damp(by);
        }
    }

    /// Raise the squares of its bodies' modes to what their amplitudes are now.
    pub(crate) fn squares(&self, squares: &mut [Vec<f64>]) {
        for (body, squares) in self.state.bodies.iter().zip(squares) {
            if let Some(modal) = body.modal() {
                modal.squares(squares);
            }
        }
    }

    /// Ergons since the last call.
    pub(crate) fn take_ergons(&mut self) -> Vec<FramedErgon> {
        self.state.stream.take()
    }

    /// Note the strongest push of each contact, and what written hands strike, from here on.
    pub(crate) fn watch(&mut self) {
        self.state.touches = contact_peaks::ContactPeaks::of(&self.network);
        let voices = &mut self.state.voices;
        voices.iter_mut().for_each(|voice| voice.sparks.watch());
        self.wake();
    }

    /// Tell of contacts (link, frame of the scene, force [N]) that pushed since the last call.
    pub(crate) fn take_touches(&mut self, mut tell: impl FnMut(usize, u64, f64)) {
        let mut touches = std::mem::take(&mut self.state.touches);
        touches.take(|link, touch| tell(link, self.frame_at(touch.frame), touch.force));
        self.state.touches = touches;
    }

    /// Tell of what written hands struck since the last call.
    pub(crate) fn take_sparks(&mut self, mut tell: impl FnMut(Record)) {
        for voice in &mut self.state.voices {
            voice.sparks.take(&mut tell);
        }
    }

    /// How many sparks there are between two looks at most.
    pub(crate) fn sparks_max(&self) -> usize {
        SPARKS * self.state.voices.len()
    }

    /// Whether a link in space is broken.
    pub(crate) fn is_broken(&self, link: usize) -> bool {
        self.state.memory_of(link) == f64::INFINITY
    }

    /// Its bodies as they are.
    pub(crate) fn bodies(&self) -> &[inside::RunningBody] {
        &self.state.bodies
    }

    /// The ledger, if it is kept.
    pub(crate) fn energy(&self) -> Option<Energy> {
        let state = &self.state;
        state.ledger.as_ref().map(|ledger| {
            ledger.energy(
                state.scheme.as_deref().unwrap_or(&self.script.scheme),
                &state.body,
            )
        })
    }

    /// Parts put to silence, with the frame of the scene of each.
    pub(crate) fn muted(&self) -> Vec<(String, u64)> {
        self.state
            .mutes
            .list()
            .map(|(part, step)| {
                let name = self.network.parts()[part].name.clone();
                (name, self.frame_at(step))
            })
            .collect()
    }

    /// How many parts were put to silence.
    pub(crate) fn n_muted(&self) -> usize {
        self.state.mutes.list().count()
    }

    /// Parts whose links stiffened, with the frames of the scene that were computed finer for it, in how many steps.
    pub(crate) fn finer(&self) -> impl Iterator<Item = (&str, u64, u32)> {
        let parts = self.network.parts();
        let own = self.state.guard.iter().filter_map(|guard| {
            let finer_frames = guard.finer_frames()?;
            let part = self.script.scheme.part[finer_frames.mat] as usize;
            Some((&*parts[part].name, finer_frames))
        });
        let bodies = self
            .state
            .bodies
            .iter()
            .filter_map(inside::RunningBody::finer_frames);
        own.chain(bodies).map(|(part, finer_frames)| {
            let FinerFrames { frames, most, .. } = finer_frames.per_frame(self.oversampling);
            (part, frames, most)
        })
    }

    /// Room for every target there can be: a cloned vector has only what it holds.
    pub(crate) fn reserve(&mut self) {
        let most = self.script.drives.len() + self.script.voices.len();
        self.state.targets.reserve(most);
        for (voice, own) in self.state.voices.iter_mut().zip(&self.script.voices) {
            voice.reserve(own);
        }
        for body in &mut self.state.bodies {
            body.reserve();
        }
        if let Some(ledger) = &mut self.state.ledger {
            ledger.reserve(most);
        }
        if let Some(guard) = &mut self.state.guard {
            guard.reserve(most);
        }
        self.reserve_rest();
    }
}
