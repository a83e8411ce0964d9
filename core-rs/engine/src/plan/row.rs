//! The report of a plan: a row for everything that is computed together, and for everything that is not computed.

use crate::assembly::audible::{Body, ModeKind};
use crate::assembly::budget::Budget;
use crate::assembly::cost;
use crate::assembly::cost_table::Costs;
use crate::assembly::islands::IslandMembers;
use crate::assembly::ported::PortedBody;
use crate::assembly::unit::{BankPlan, IslandPlan};
use crate::hearing::Audible;
use crate::integrate::certify;
use crate::island::ContactOrder;
use crate::island::inside::BodyPlan;
use crate::network::{Network, Subset};
use crate::plan::constants::{ESTIMATE_MARGIN_DB, PRESERVED_LIMITS};
use crate::scheme::{Certificate, StabilityGuarantee};
use crate::timeline::Timeline;

/// Why something is not computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// No output listens to it, or to anything it can move.
    Unheard,
    /// Nothing ever moves it.
    Still,
}

/// The method by which modules are computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Computed {
    /// Module by module, by the CA scheme.
    Stepped,
    /// Each isolated CEL by its own poles.
    Oscillators,
    /// As modes: how many there are, how many are computed, and how loud the others would be [dB].
    Modes {
        /// Normal or complex.
        kind: ModeKind,
        /// All modes of the body.
        total: usize,
        /// The modes that are computed.
        computed: usize,
        /// How loud the others would be together, relative to all [dB].
        left_out: Option<f64>,
    },
    /// As a mesh, by a method of its own: its name, and steps a frame.
    Mesh(&'static str, u32),
    /// Its own springs pull once every so many frames.
    Slow {
        /// Frames from one pull to the next.
        macrostep: u32,
        /// By the exact flow of its masses; else by the CA scheme at that rate.
        is_exact: bool,
    },
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
    /// If runs part for good: mean difference of their third octaves over all that was compared [dB].
    pub spectral: Option<f64>,
    /// The audible error, if the budget is one of pitch.
    pub audible: Option<Audible>,
}

impl Measured {
    /// The audible error as a multiple of what a budget allows; 0 if it is not known.
    pub(in crate::plan) fn excess(&self, budget: &Budget) -> f64 {
        self.audible.map_or(0.0, |audible| budget.excess(&audible))
    }

    /// Adds the doubt of an estimate, but not beyond what is `asked` for: the budget has margins of its own.
    pub(in crate::plan) fn doubted(self, asked: f64) -> Self {
        Self {
            db: self.db.max((self.db + ESTIMATE_MARGIN_DB).min(asked)),
            ..self
        }
    }
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
    pub what: Computed,
    /// Seconds of work for a second of sound, by the table of costs.
    pub cost: f64,
    /// Whether it can diverge; `None` where nothing is computed.
    pub word: Option<StabilityGuarantee>,
    /// Steps taken in `every` frames.
    pub oversampling: u32,
    /// 1, except for what is only seen.
    pub every: u32,
    /// Contact substeps a step while contacts may be closed.
    pub contact_substeps: usize,
    /// The order of contacts between frames: 2 or 4.
    pub contact_order: u32,
    /// The error that a pilot measured; `None`: not measured, or exact but for what is left out.
    pub error: Option<Measured>,
    /// Why it is not computed by a better method.
    pub because: Option<String>,
    /// Largest magnitude of an eigenvalue of the map of slow parts and all that they touch, for one kick; `None` if no
    /// part is slow.
    pub radius: Option<f64>,
    /// Parts that ask for a rate of their own but are computed at every frame, and why.
    pub stays: Option<String>,
    /// It is slow by the choice of the plan, because its island then costs less.
    pub is_offered: bool,
    /// Its discrete network is the reference: nothing but what is left out is an error.
    pub is_reference: bool,
    /// The allowance of trials was spent before all of them were played.
    pub is_cut_short: bool,
    /// It is planned for a low cost, because no earlier plan has run its trials.
    pub is_drafted: bool,
    /// Its motion diverged in its trial.
    pub diverges: bool,
    /// When it is played harder than while `error` was measured [s].
    pub harder_at: Option<f64>,
    /// From when on its error was not checked, though it may grow [s].
    pub unchecked_from: Option<f64>,
}

impl Row {
    /// Whether a slow part sounds as it would at every frame, as far as a pilot measured.
    pub fn is_preserved(&self) -> bool {
        let (Computed::Slow { macrostep, .. }, Some(pilot_error)) = (self.what, self.error) else {
            return false;
        };
        let island_macrostep = macrostep / self.oversampling.max(1);
        PRESERVED_LIMITS
            .iter()
            .any(|&(every_max, db)| island_macrostep <= every_max && pilot_error.db <= db)
    }

    /// A row of parts, with their moving MATs and their LIAs; nothing else is filled in.
    fn new(parts: Vec<String>, [mats, links]: [usize; 2], what: Computed) -> Self {
        Self {
            parts,
            mats,
            links,
            what,
            cost: 0.0,
            word: None,
            oversampling: 1,
            every: 1,
            contact_substeps: 1,
            contact_order: ContactOrder::default().number(),
            error: None,
            because: None,
            radius: None,
            stays: None,
            is_offered: false,
            is_reference: false,
            is_cut_short: false,
            is_drafted: false,
            diverges: false,
            harder_at: None,
            unchecked_from: None,
        }
    }

    /// Fills in the cost of a second of sound, from nanoseconds a frame, and whether it can diverge.
    fn costing(self, ns: f64, timeline: &Timeline, word: StabilityGuarantee) -> Self {
        Self {
            cost: cost::seconds(ns, timeline),
            word: Some(word),
            ..self
        }
    }

    pub(in crate::plan) fn left_out(network: &Network, island: &IslandMembers, reason: Reason) -> Self {
        let mats = network.mats();
        let first_part = mats.part[island.mats[0] as usize] as usize;
        let mat_moves = |mat: &&u32| mats.kind[**mat as usize].moves();
        let module_counts = [island.mats.iter().filter(mat_moves).count(), island.links.len()];
        let part_names = vec![network.parts()[first_part].name.clone()];
        Self::new(part_names, module_counts, Computed::LeftOut(reason))
    }

    pub(in crate::plan) fn stepped(island_plan: &IslandPlan, certificate: Certificate) -> Self {
        let frame_cost = island_plan.hub_cost();
        let timeline = &island_plan.timeline;
        let steps = island_plan.step_numbers(island_plan.contact_substeps);
        Self {
            contact_substeps: steps.contact_substeps,
            contact_order: steps.contact_order.number(),
            ..Self::for_network(&island_plan.network, Computed::Stepped).costing(frame_cost, timeline, certificate.word)
        }
    }

    /// The row of a body inside an island.
    pub(in crate::plan) fn ported(ported: &PortedBody, timeline: &Timeline) -> Self {
        let computed_as = match &ported.inside {
            BodyPlan::Modal(modal) => match &modal.answers {
                Some(answers) => Computed::Modes {
                    kind: ModeKind::Complex,
                    total: answers.n_modes,
                    computed: answers.n_modes,
                    left_out: None,
                },
                None => Computed::Modes {
                    kind: ModeKind::Normal,
                    total: ported.n_modes,
                    computed: modal.modes.len(),
                    left_out: ported.left_out,
                },
            },
            BodyPlan::Mesh(mesh) => Computed::Mesh(mesh.method.facts().name, mesh.substeps),
            BodyPlan::Slow(slow) => Computed::Slow {
                macrostep: slow.macrostep,
                is_exact: slow.is_linear(),
            },
        };
        let frame_cost = cost::body_cost(&ported.inside);
        Self::new(ported.parts.clone(), [ported.mats, ported.links], computed_as).costing(
            frame_cost,
            timeline,
            guarantee(&ported.inside),
        )
    }

    pub(in crate::plan) fn modal(subset: &Subset, body: &Body, timeline: &Timeline) -> Self {
        let computed_as = Computed::Modes {
            kind: body.kind,
            total: body.modes,
            computed: body.computed.modes.len(),
            left_out: body.computed.left_out,
        };
        let frame_cost = cost::bank_cost(&body.bank);
        Self::for_network(&subset.network, computed_as).costing(frame_cost, timeline, StabilityGuarantee::Proved)
    }

    /// The row of a whole network.
    fn for_network(network: &Network, what: Computed) -> Self {
        let module_counts = [network.n_moving(), network.n_lia()];
        Self::new(network.moving_parts(), module_counts, what)
    }
}

/// A row for each part that has isolated CELs.
pub(in crate::plan) fn cells(network: &Network, banks: &[BankPlan], timeline: &Timeline) -> Vec<Row> {
    let mut cell_counts = vec![0_usize; network.parts().len()];
    for (mat, _) in banks.iter().flat_map(|bank| &bank.mats) {
        cell_counts[network.mats().part[*mat as usize] as usize] += 1;
    }
    let counted_parts = network.parts().iter().zip(cell_counts);
    counted_parts
        .filter(|(_, count)| *count > 0)
        .map(|(part, count)| {
            let frame_cost = Costs::nanoseconds("oscillator") * count as f64;
            Row::new(vec![part.name.clone()], [count, 0], Computed::Oscillators).costing(
                frame_cost,
                timeline,
                StabilityGuarantee::Proved,
            )
        })
        .collect()
}

/// The certificate of a body alone: modes cannot diverge, but what pushes them may.
fn guarantee(inside: &BodyPlan) -> StabilityGuarantee {
    match inside {
        // For a slow body, the certificate of the whole island decides.
        BodyPlan::Modal(_) | BodyPlan::Slow(_) => StabilityGuarantee::Guarded,
        BodyPlan::Mesh(mesh) => {
            let certificate = certify(&mesh.network, mesh.rate, mesh.method, mesh.substeps);
            certificate.map_or(StabilityGuarantee::Tried, |certificate| certificate.word)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubted_error_stays_within_the_limit() {
        let stated_error = |db: f64| {
            let measured = Measured {
                db,
                over: 0.3,
                spectral: None,
                audible: None,
            };
            measured.doubted(-60.0).db
        };
        assert_eq!(stated_error(-80.0), -76.5);
        assert_eq!(stated_error(-62.0), -60.0);
        assert_eq!(stated_error(-50.0), -50.0);
    }
}
