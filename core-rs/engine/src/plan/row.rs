//! What a plan tells of itself: a row for everything that is computed together, and for all that is not.

use super::BankPlan;
use super::body::Body;
use super::cost::Costs;
use super::islands::Island;
use super::mesh::LADDER;
use super::ported::Found;
use crate::integrate::{Way, certify};
use crate::island::inside::Inside;
use crate::island::slow::Slow;
use crate::network::{Contact, LinkKind, Network, Subset};
use crate::scheme::{Certificate, Word};
use crate::timeline::Timeline;
use crate::units::Rate;

/// Why something is not computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// No output listens to it, or to anything it can move.
    Unheard,
    /// Nothing ever moves it.
    Still,
}

/// How modules are computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum What {
    /// Module by module, by the CA scheme.
    Stepped,
    /// Each isolated CEL by its own poles.
    Oscillators,
    /// As modes: how many there are, how many are computed, and how loud the others would be [dB].
    Modes {
        /// All of the body's.
        of: usize,
        /// Those computed.
        kept: usize,
        /// The others together, relative to all.
        left_out: Option<f64>,
    },
    /// As a mesh, by a method of its own: its name, and steps a frame.
    Mesh(&'static str, u32),
    /// By its exact flow, once every so many frames.
    Slow(u32),
    /// Not at all.
    LeftOut(Reason),
}

/// An error that a pilot measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Of the waveform [dB].
    pub db: f64,
    /// Over how long from the start [s].
    pub over: f64,
    /// Where no two ways of computing give the same waveform for longer: how far third octaves are apart after
    /// all, in the mean [dB].
    pub spectral: Option<f64>,
}

/// A row of a plan.
#[derive(Clone, Debug)]
pub struct Row {
    /// The parts whose modules these are.
    pub parts: Vec<String>,
    /// MATs that move.
    pub mats: usize,
    /// LIAs.
    pub links: usize,
    /// How they are computed.
    pub what: What,
    /// Seconds of work for a second of sound, by the table of costs.
    pub cost: f64,
    /// Whether it can diverge; `None` where nothing is computed.
    pub word: Option<Word>,
    /// How often a frame it is stepped.
    pub times: u32,
    /// How often a step its contacts are computed while they may be closed.
    pub steps: usize,
    /// The error that a pilot measured; `None`: exact, but for what is left out.
    pub error: Option<Measured>,
    /// Why it is not computed in a better way.
    pub because: Option<String>,
    /// Largest eigenvalue of what slow parts and all that they touch do from kick to kick; `None`: none is slow.
    pub radius: Option<f64>,
    /// Parts that have a rate of their own and go at every frame all the same, and why.
    pub stays: Option<String>,
    /// It is slow for the planner's own reasons: so its island costs less.
    pub is_offered: bool,
}

/// Slow parts are called preserved where so many frames lie between their kicks at most, and their error is no more
/// than [dB].
pub(super) const PRESERVED: [(u32, f64); 2] = [(10, -75.0), (20, -70.0)];

impl Row {
    /// Whether a slow part sounds as at every frame, as far as a pilot heard.
    pub fn is_preserved(&self) -> bool {
        let (What::Slow(every), Some(error)) = (self.what, self.error) else {
            return false;
        };
        let every = every / self.times.max(1);
        PRESERVED
            .iter()
            .any(|&(most, db)| every <= most && error.db <= db)
    }

    pub(super) fn left_out(network: &Network, island: &Island, reason: Reason) -> Self {
        let mats = network.mats();
        let part = mats.part[island.mats[0] as usize] as usize;
        let is_free = |mat: &&u32| mats.kind[**mat as usize].moves();
        Self {
            parts: vec![network.parts()[part].name.clone()],
            mats: island.mats.iter().filter(is_free).count(),
            links: island.links.len(),
            what: What::LeftOut(reason),
            cost: 0.0,
            word: None,
            times: 1,
            steps: 1,
            error: None,
            because: None,
            radius: None,
            stays: None,
            is_offered: false,
        }
    }

    pub(super) fn stepped(
        network: &Network,
        timeline: &Timeline,
        certificate: Certificate,
    ) -> Self {
        Self {
            parts: parts(network),
            mats: free(network),
            links: network.n_lia(),
            what: What::Stepped,
            cost: seconds(stepped_cost(network, timeline), timeline),
            word: Some(certificate.word),
            times: 1,
            steps: 1,
            error: None,
            because: None,
            radius: None,
            stays: None,
            is_offered: false,
        }
    }

    /// A body inside an island: followed frame by frame.
    pub(super) fn ported(found: &Found, timeline: &Timeline) -> Self {
        Self {
            parts: found.parts.clone(),
            mats: found.mats,
            links: found.links,
            what: match &found.inside {
                Inside::Modal(modal) => What::Modes {
                    of: found.of,
                    kept: modal.modes.len(),
                    left_out: found.left_out,
                },
                Inside::Mesh(mesh) => What::Mesh(mesh.way.facts().name, mesh.substeps),
                Inside::Slow(slow) => What::Slow(slow.flow.every),
            },
            cost: seconds(body_cost(&found.inside), timeline),
            word: Some(word(&found.inside)),
            times: 1,
            steps: 1,
            error: None,
            because: None,
            radius: None,
            stays: None,
            is_offered: false,
        }
    }

    pub(super) fn modal(subset: &Subset, body: &Body, timeline: &Timeline) -> Self {
        let network = &subset.network;
        Self {
            parts: parts(network),
            mats: free(network),
            links: network.n_lia(),
            what: What::Modes {
                of: body.modes,
                kept: body.kept.modes.len(),
                left_out: body.kept.left_out,
            },
            cost: seconds(bank_cost(&body.bank), timeline),
            word: Some(Word::Proved),
            times: 1,
            steps: 1,
            error: None,
            because: None,
            radius: None,
            stays: None,
            is_offered: false,
        }
    }
}

/// A row for each part that has isolated CELs.
pub(super) fn cells(network: &Network, banks: &[BankPlan], timeline: &Timeline) -> Vec<Row> {
    let mut counts = vec![0_usize; network.parts().len()];
    for (mat, _) in banks.iter().flat_map(|bank| &bank.mats) {
        counts[network.mats().part[*mat as usize] as usize] += 1;
    }
    let parts = network.parts().iter().zip(counts);
    parts
        .filter(|(_, count)| *count > 0)
        .map(|(part, count)| Row {
            parts: vec![part.name.clone()],
            mats: count,
            links: 0,
            what: What::Oscillators,
            cost: seconds(Costs::of("oscillator") * count as f64, timeline),
            word: Some(Word::Proved),
            times: 1,
            steps: 1,
            error: None,
            because: None,
            radius: None,
            stays: None,
            is_offered: false,
        })
        .collect()
}

/// What is stepped costs a frame [ns].
pub(super) fn stepped_cost(network: &Network, timeline: &Timeline) -> f64 {
    let mut ns = Costs::of("frame") + free(network) as f64 * Costs::of("mat");
    for run in network.runs() {
        let each = match &run.kind {
            LinkKind::Ref if run.len > 1 => Costs::of("link"),
            LinkKind::Lnl(law) if law.hardens().is_none() => Costs::of("expression"),
            LinkKind::Lnl(_) if run.len > 1 => Costs::of("law"),
            LinkKind::But(but) if but.contact == Contact::Exact => Costs::of("contact"),
            _ => Costs::of("single"),
        };
        ns += each * run.len as f64;
    }
    if timeline.gestures.is_empty() {
        return ns;
    }
    ns + Costs::of("hand") * timeline.keys.len() as f64
}

/// What a body inside an island costs a frame [ns].
pub(super) fn body_cost(inside: &Inside) -> f64 {
    match inside {
        Inside::Modal(modal) => {
            let rows = modal.ports.len() + modal.heard.len();
            modal.modes.len() as f64 * (Costs::of("mode") + rows as f64 * Costs::of("port"))
        }
        Inside::Mesh(mesh) => {
            let rung =
                |&&(way, steps, _): &&(Way, u32, f64)| (way, steps) == (mesh.way, mesh.substeps);
            let times = LADDER.iter().find(rung).map_or(1.0, |&(_, _, times)| times);
            times * stepped_cost(&mesh.network, &Timeline::new(mesh.rate))
        }
        Inside::Slow(slow) => slow_cost(slow),
    }
}

/// What a slow body costs less a frame than stepped module by module [ns].
pub(super) fn saved(slow: &Slow, rate: Rate) -> f64 {
    let stepped = stepped_cost(&slow.network, &Timeline::new(rate)) - Costs::of("frame");
    let ports = slow.ports.len() as f64 * Costs::of("mat");
    stepped - ports - slow_cost(slow)
}

fn slow_cost(slow: &Slow) -> f64 {
    let n = slow.free.len() as f64;
    let kick = n * (2.0 * n * Costs::of("port") + Costs::of("mat"));
    let each = Costs::of("slow") + slow.ports.len() as f64 * Costs::of("mat");
    kick / f64::from(slow.flow.every) + each
}

/// What is sure of a body: modes cannot diverge, but what pushes them may.
fn word(inside: &Inside) -> Word {
    match inside {
        // Of a slow body the whole island's certificate tells.
        Inside::Modal(_) | Inside::Slow(_) => Word::Guarded,
        Inside::Mesh(mesh) => {
            let found = certify(&mesh.network, mesh.rate, mesh.way, mesh.substeps);
            found.map_or(Word::Tried, |found| found.word)
        }
    }
}

/// What a bank costs a frame [ns].
pub(super) fn bank_cost(bank: &BankPlan) -> f64 {
    let all = bank.oscillators.iter();
    let taps: usize = all.map(|own| own.heard.len().max(1) - 1).sum();
    let each = bank.oscillators.len() as f64 * Costs::of("oscillator");
    each + taps as f64 * Costs::of("oscillator_tap")
}

pub(super) fn seconds(ns: f64, timeline: &Timeline) -> f64 {
    ns * 1e-9 * timeline.rate.hertz()
}

fn free(network: &Network) -> usize {
    let kinds = network.mats().kind.iter();
    kinds.filter(|&&kind| kind.moves()).count()
}

/// The parts of a network's MATs, in order.
fn parts(network: &Network) -> Vec<String> {
    let all: Vec<u32> = (0..network.n_mat() as u32).collect();
    parts_of(network, &all)
}

/// The parts of some MATs that move, in order.
pub(super) fn parts_of(network: &Network, of: &[u32]) -> Vec<String> {
    let mats = network.mats();
    let mut has = vec![false; network.parts().len()];
    for &mat in of {
        has[mats.part[mat as usize] as usize] |= mats.kind[mat as usize].moves();
    }
    let parts = network.parts().iter().zip(has);
    parts
        .filter(|(_, has)| *has)
        .map(|(part, _)| part.name.clone())
        .collect()
}
