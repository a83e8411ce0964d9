//! The report of a plan: a row for everything that is computed together, and for everything that is not computed.

use crate::assembly::audible::{BankBody, ModeKind};
use crate::assembly::budget::Budget;
use crate::assembly::cost;
use crate::assembly::cost_table::Costs;
use crate::assembly::islands::IslandMembers;
use crate::assembly::ported::PortedBody;
use crate::assembly::unit::{BankPlan, IslandPlan};
use crate::hearing::Audible;
use crate::integrate::certify;
use crate::island::ContactOrder;
use crate::island::bodies::BodyPlan;
use crate::network::{Network, Subset};
use crate::plan::constants::{ESTIMATE_MARGIN_DB, PRESERVED_LIMITS};
use crate::scheme::{Certificate, StabilityGuarantee};
use crate::timeline::Timeline;

/// Why something is not computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeftOutReason {
    /// No output listens to it, or to anything it can move.
    Unheard,
    /// Nothing ever moves it.
    Motionless,
}

/// The method by which modules are computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Computation {
    /// Module by module, by the CA scheme.
    Stepped,
    /// Each isolated CEL by its own poles.
    Oscillators,
    /// As modes: how many there are, how many are computed, and how loud the others would be [dB].
    Modes {
        /// Normal or complex.
        kind: ModeKind,
        /// All modes of the body.
        n_modes: usize,
        /// The modes that are computed.
        n_computed: usize,
        /// How loud the others would be together, relative to all [dB].
        left_out_db: Option<f64>,
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
    LeftOut(LeftOutReason),
}

/// An error that a pilot measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredError {
    /// Of the waveform [dB].
    pub waveform_db: f64,
    /// Over how long from the start [s].
    pub duration_seconds: f64,
    /// If runs part for good: mean difference of their third octaves over all that was compared [dB].
    pub third_octave_db: Option<f64>,
    /// The audible error, if the budget is one of pitch.
    pub audible: Option<Audible>,
}

impl MeasuredError {
    /// The audible error as a multiple of what a budget allows; 0 if it is not known.
    pub(in crate::plan) fn budget_excess(&self, budget: &Budget) -> f64 {
        self.audible.map_or(0.0, |audible| budget.excess_ratio(&audible))
    }

    /// Whether runs do not part, and the error is within a budget.
    pub(in crate::plan) fn is_regular_within(&self, budget: &Budget) -> bool {
        let is_within = match budget {
            Budget::Cents { .. } => self.budget_excess(budget) <= 1.0,
            Budget::Error(_) | Budget::Method(_) => self.waveform_db <= budget.waveform_error_db(),
        };
        self.third_octave_db.is_none() && is_within
    }

    /// Adds the doubt of an estimate, but not beyond `asked_db`: the budget has margins of its own.
    pub(in crate::plan) fn with_estimate_margin(self, asked_db: f64) -> Self {
        Self {
            waveform_db: self
                .waveform_db
                .max((self.waveform_db + ESTIMATE_MARGIN_DB).min(asked_db)),
            ..self
        }
    }
}

/// A row of a plan.
#[derive(Clone, Debug)]
pub struct PlanRow {
    /// The parts whose modules these are.
    pub parts: Vec<String>,
    /// MATs that move.
    pub n_mats: usize,
    /// LIAs.
    pub n_links: usize,
    /// How they are computed.
    pub computation: Computation,
    /// Seconds of work for a second of sound, by the table of costs.
    pub work_per_second: f64,
    /// Whether it can diverge; `None` where nothing is computed.
    pub stability: Option<StabilityGuarantee>,
    /// Steps taken in `frame_interval` frames.
    pub oversampling: u32,
    /// 1, except for what is only seen.
    pub frame_interval: u32,
    /// Contact substeps a step while contacts may be closed.
    pub contact_substeps: usize,
    /// The order of contacts between frames: 2 or 4.
    pub contact_order: u32,
    /// The error that a pilot measured; `None`: not measured, or exact but for what is left out.
    pub error: Option<MeasuredError>,
    /// Why it is not computed by a better method.
    pub modes_refusal: Option<String>,
    /// Largest magnitude of an eigenvalue of the map of slow parts and all that they touch, for one kick; `None` if no
    /// part is slow.
    pub kick_growth_factor: Option<f64>,
    /// Parts that ask for a rate of their own but are computed at every frame, and why.
    pub rate_refusal: Option<String>,
    /// It is slow by the choice of the plan, because its island then costs less.
    pub is_slow_by_plan: bool,
    /// Its discrete network is the reference: nothing but what is left out is an error.
    pub is_discrete_reference: bool,
    /// The allowance of trials was spent before all of them were played.
    pub trials_cut_short: bool,
    /// It is planned for a low cost, because no earlier plan has run its trials.
    pub is_drafted: bool,
    /// Its motion diverged in its trial.
    pub has_diverged: bool,
    /// When it is played harder than while `error` was measured [s].
    pub harder_event_time: Option<f64>,
    /// From when on its error was not checked, though it may grow [s].
    pub unchecked_from_seconds: Option<f64>,
}

impl PlanRow {
    /// Whether a slow part sounds as it would at every frame, as far as a pilot measured.
    pub fn is_preserved(&self) -> bool {
        let (Computation::Slow { macrostep, .. }, Some(pilot_error)) = (self.computation, self.error) else {
            return false;
        };
        let island_macrostep = macrostep / self.oversampling.max(1);
        PRESERVED_LIMITS
            .iter()
            .any(|&(macrostep_max, db)| island_macrostep <= macrostep_max && pilot_error.waveform_db <= db)
    }

    /// A row of parts, with their moving MATs and their LIAs; nothing else is filled in.
    fn new(parts: Vec<String>, [mats, links]: [usize; 2], computation: Computation) -> Self {
        Self {
            parts,
            n_mats: mats,
            n_links: links,
            computation,
            work_per_second: 0.0,
            stability: None,
            oversampling: 1,
            frame_interval: 1,
            contact_substeps: 1,
            contact_order: ContactOrder::default().number(),
            error: None,
            modes_refusal: None,
            kick_growth_factor: None,
            rate_refusal: None,
            is_slow_by_plan: false,
            is_discrete_reference: false,
            trials_cut_short: false,
            is_drafted: false,
            has_diverged: false,
            harder_event_time: None,
            unchecked_from_seconds: None,
        }
    }

    /// Fills in the cost of a second of sound, from nanoseconds a frame, and whether it can diverge.
    fn with_cost(self, ns: f64, timeline: &Timeline, guarantee: StabilityGuarantee) -> Self {
        Self {
            work_per_second: cost::work_per_second(ns, timeline),
            stability: Some(guarantee),
            ..self
        }
    }

    pub(in crate::plan) fn left_out(network: &Network, island: &IslandMembers, reason: LeftOutReason) -> Self {
        let mats = network.mats();
        let first_part = mats.part[island.mats[0] as usize] as usize;
        let is_moving = |mat: &&u32| mats.kind[**mat as usize].moves();
        let module_counts = [island.mats.iter().filter(is_moving).count(), island.links.len()];
        let part_names = vec![network.parts()[first_part].name.clone()];
        Self::new(part_names, module_counts, Computation::LeftOut(reason))
    }

    pub(in crate::plan) fn stepped(island_plan: &IslandPlan, certificate: Certificate) -> Self {
        let frame_cost = island_plan.hub_step_ns();
        let timeline = &island_plan.timeline;
        let steps = island_plan.step_numbers(island_plan.contact_substeps);
        Self {
            contact_substeps: steps.contact_substeps,
            contact_order: steps.contact_order.number(),
            ..Self::for_network(&island_plan.network, Computation::Stepped).with_cost(
                frame_cost,
                timeline,
                certificate.guarantee,
            )
        }
    }

    /// The row of a body inside an island.
    pub(in crate::plan) fn ported(ported_body: &PortedBody, timeline: &Timeline) -> Self {
        let computation = match &ported_body.plan {
            BodyPlan::Modal(modal) => match &modal.complex_responses {
                Some(complex_responses) => Computation::Modes {
                    kind: ModeKind::Complex,
                    n_modes: complex_responses.n_modes,
                    n_computed: complex_responses.n_modes,
                    left_out_db: None,
                },
                None => Computation::Modes {
                    kind: ModeKind::Normal,
                    n_modes: ported_body.n_modes,
                    n_computed: modal.modes.len(),
                    left_out_db: ported_body.left_out_db,
                },
            },
            BodyPlan::Mesh(mesh) => Computation::Mesh(mesh.method.properties().name, mesh.substeps),
            BodyPlan::Slow(slow) => Computation::Slow {
                macrostep: slow.macrostep,
                is_exact: slow.is_linear(),
            },
        };
        let frame_cost = cost::body_ns(&ported_body.plan);
        Self::new(
            ported_body.parts.clone(),
            [ported_body.n_mats, ported_body.n_links],
            computation,
        )
        .with_cost(frame_cost, timeline, guarantee(&ported_body.plan))
    }

    pub(in crate::plan) fn modal(subset: &Subset, body: &BankBody, timeline: &Timeline) -> Self {
        let computation = Computation::Modes {
            kind: body.kind,
            n_modes: body.n_modes,
            n_computed: body.computed_modes.modes.len(),
            left_out_db: body.computed_modes.left_out_db,
        };
        let frame_cost = cost::bank_ns(&body.bank);
        Self::for_network(&subset.network, computation).with_cost(frame_cost, timeline, StabilityGuarantee::Proved)
    }

    /// The row of a whole network.
    fn for_network(network: &Network, computation: Computation) -> Self {
        let module_counts = [network.n_moving(), network.n_lia()];
        Self::new(network.moving_parts(), module_counts, computation)
    }
}

/// A row for each part that has isolated CELs.
pub(in crate::plan) fn cells(network: &Network, banks: &[BankPlan], timeline: &Timeline) -> Vec<PlanRow> {
    let mut cell_counts = vec![0_usize; network.parts().len()];
    for (mat, _) in banks.iter().flat_map(|bank| &bank.mats_and_rests) {
        cell_counts[network.mats().part[*mat as usize] as usize] += 1;
    }
    let counted_parts = network.parts().iter().zip(cell_counts);
    counted_parts
        .filter(|(_, count)| *count > 0)
        .map(|(part, count)| {
            let frame_cost = Costs::nanoseconds("oscillator") * count as f64;
            PlanRow::new(vec![part.name.clone()], [count, 0], Computation::Oscillators).with_cost(
                frame_cost,
                timeline,
                StabilityGuarantee::Proved,
            )
        })
        .collect()
}

/// The certificate of a body alone: modes cannot diverge, but what pushes them may.
fn guarantee(body_plan: &BodyPlan) -> StabilityGuarantee {
    match body_plan {
        // For a slow body, the certificate of the whole island decides.
        BodyPlan::Modal(_) | BodyPlan::Slow(_) => StabilityGuarantee::Guarded,
        BodyPlan::Mesh(mesh) => {
            let certificate = certify(&mesh.network, mesh.rate, mesh.method, mesh.substeps);
            certificate.map_or(StabilityGuarantee::Tried, |certificate| certificate.guarantee)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubted_error_stays_within_the_limit() {
        let stated_error = |db: f64| {
            let measured = MeasuredError {
                waveform_db: db,
                duration_seconds: 0.3,
                third_octave_db: None,
                audible: None,
            };
            measured.with_estimate_margin(-60.0).waveform_db
        };
        assert_eq!(stated_error(-80.0), -76.5);
        assert_eq!(stated_error(-62.0), -60.0);
        assert_eq!(stated_error(-50.0), -50.0);
    }
}
