//! An island assembled at some oversampling: what is stepped, its bodies, and its contact substeps.

use std::sync::Arc;

use crate::assembly::budget::Budget;
use crate::assembly::choice::SteppedChoice;
use crate::assembly::constants::SUBSTEPS_MAX;
use crate::assembly::cost;
use crate::assembly::mesh::MethodChoice;
use crate::assembly::ported::{self, PortedBody};
use crate::assembly::solved_modes::ModeCache;
use crate::assembly::split::LocalTimeline;
use crate::assembly::truncate::KeptModes;
use crate::assembly::unit::{IslandPlan, NetworkIndices};
use crate::body_modes::linear::NoModes;
use crate::integrate::MeshMethod;
use crate::island::bodies::BodyPlan;
use crate::island::{ContactOrder, FINE_SUBSTEPS_MIN};
use crate::network::{Error, LinkKind, Network, Subset};
use crate::scheme::{Certificate, RefusalDetail, Scheme};
use crate::timeline::{Timeline, with_greatest_factors};

/// An island that can be played.
#[derive(Clone)]
pub(crate) struct Assembled {
    pub(crate) island_plan: IslandPlan,
    pub(crate) bodies: Vec<PortedBody>,
    pub(crate) certificate: Certificate,
    /// Why a body does not go by modes.
    pub(crate) modes_refusal: Option<NoModes>,
    /// It has single laws that can be computed finer than a frame, as contacts are.
    pub(crate) can_solve_laws_between_steps: bool,
    pub(crate) cut_shape: CutShape,
    /// Contacts and laws are computed once a step, although they might be computed finer.
    pub(crate) is_single_step: bool,
    /// Cost of a step of the whole island without bodies [ns]; 0 where slow parts make it less.
    pub(crate) stepped_ns: f64,
}

/// How an island is to be assembled.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AssemblyOptions<'a> {
    /// Steps a frame.
    pub(crate) oversampling: u32,
    pub(crate) body_methods: MethodChoice<'a>,
    /// Contacts and laws are computed once a step.
    pub(crate) is_single_step: bool,
}

impl<'a> AssemblyOptions<'a> {
    /// With contacts and laws as finely as the budget asks.
    pub(crate) fn between_steps(oversampling: u32, body_methods: MethodChoice<'a>) -> Self {
        Self {
            oversampling,
            body_methods,
            is_single_step: false,
        }
    }
}

/// What an island is made of, at any rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CutShape {
    /// Bodies that are cut out, and the rest.
    Bodies,
    /// No bodies, although it might have some.
    Stepped,
    /// Meshes that might go by modes.
    Meshes,
}

/// How finely an island is computed, and its bodies by which methods, whatever moves it.
#[derive(Clone, Debug)]
pub(crate) struct Stepping {
    oversampling: u32,
    contact_substeps: usize,
    contact_order: ContactOrder,
    counted_cost: Option<u32>,
    cut_shape: CutShape,
    is_single_step: bool,
    mesh_methods: Vec<Option<(MeshMethod, u32)>>,
}

impl Stepping {
    /// How an island is to be assembled for it.
    pub(crate) fn options(&self) -> AssemblyOptions<'_> {
        AssemblyOptions {
            oversampling: self.oversampling,
            body_methods: self.cut_shape.with_methods(&self.mesh_methods),
            is_single_step: self.is_single_step,
        }
    }
}

impl CutShape {
    /// In the order of their numbers in records.
    pub(crate) const ALL: [Self; 3] = [Self::Bodies, Self::Stepped, Self::Meshes];

    /// The choice that gives this shape, with these methods of its meshes.
    fn with_methods(self, methods: &[Option<(MeshMethod, u32)>]) -> MethodChoice<'_> {
        match (self, methods.iter().flatten().next()) {
            (Self::Stepped, _) => MethodChoice::Stepped,
            (Self::Meshes, Some(&method_substeps)) => MethodChoice::Meshes(method_substeps),
            (Self::Bodies | Self::Meshes, _) => MethodChoice::Repeated(methods),
        }
    }

    fn from_choice(choice: MethodChoice<'_>) -> Self {
        match choice {
            MethodChoice::Stepped => Self::Stepped,
            MethodChoice::Meshes(_) => Self::Meshes,
            MethodChoice::ByBudget | MethodChoice::Unconditional | MethodChoice::Repeated(_) | MethodChoice::All(_) => {
                Self::Bodies
            }
        }
    }
}

impl Assembled {
    /// Assembles an island at some oversampling. Refused if that is not stable.
    pub(crate) fn new(
        subset: &Subset,
        island_timeline: &LocalTimeline,
        budget: &Budget,
        options: AssemblyOptions<'_>,
        pinned: Option<&SteppedChoice>,
        mode_cache: &ModeCache<'_>,
    ) -> Result<Self, Error> {
        let AssemblyOptions {
            oversampling,
            body_methods: choice,
            is_single_step,
        } = options;
        let timeline = if oversampling == 1 {
            island_timeline.timeline.clone()
        } else {
            oversampled_timeline(&island_timeline.timeline, oversampling, &subset.network)?
        };
        let faster_subset = scale_macrosteps(subset, oversampling);
        let subset = faster_subset.as_ref().unwrap_or(subset);
        let stepped_ns = match subset.network.has_slow_parts() {
            true => 0.0,
            false => cost::stepped_ns(&subset.network, &timeline),
        };
        // What was decided to be computed once a step stays so.
        let has_single_step = is_single_step || pinned.is_some_and(|pin| pin.contact_substeps == 1);
        let steps_max = if has_single_step { 1 } else { SUBSTEPS_MAX };
        let (cut, mut refusal) = ported::cut_bodies(subset, &timeline, budget, (pinned, steps_max), choice, mode_cache);
        let mut cut_with_hub = None;
        if let Some(island_cut) = cut {
            // A contact that is computed between frames treats a port as a free mass. With a mesh that holds the port
            // faster than a frame, that coupling would oscillate and grow.
            let steps_over_fast_motion = |ported_body: &PortedBody| match &ported_body.plan {
                BodyPlan::Mesh(mesh) => mesh.steps_over_fast_motion(),
                BodyPlan::Modal(_) | BodyPlan::Slow(_) => false,
            };
            let steps_limit = island_cut.bodies.iter().any(steps_over_fast_motion).then_some(1);
            let timeline = &island_cut.timeline.timeline;
            let (network, detail) = (&island_cut.hub.network, RefusalDetail::VerdictOnly);
            let certify_within = |steps_max| certified_hub(network, timeline, budget, steps_max, detail);
            match steps_limit
                .map_or_else(|| certify_within(steps_max), certify_within)
                .or_else(|_| certify_within(steps_max))
            {
                Ok(hub_substeps) => cut_with_hub = Some((island_cut, hub_substeps)),
                Err(_) => refusal = Some(NoModes::Stiff),
            }
        }
        let (island_cut, (contact_substeps, may_collocate, certificate)) = match cut_with_hub {
            Some(cut_with_hub) => cut_with_hub,
            None => {
                let detail = refusal_detail(oversampling);
                let hub_substeps = certified_hub(&subset.network, &timeline, budget, steps_max, detail)?;
                (ported::uncut_island(subset, island_timeline, timeline), hub_substeps)
            }
        };
        let (hub, hub_timeline, bodies) = (island_cut.hub, island_cut.timeline, island_cut.bodies);
        let island_plan = IslandPlan {
            network_indices: NetworkIndices {
                mats: Some(compose_maps(&subset.mats, &hub.mats)),
                outputs: Some(subset.outputs.clone()),
                keys: Some(compose_maps(&island_timeline.keys, &hub_timeline.keys)),
                gestures: Some(compose_maps(&island_timeline.gestures, &hub_timeline.gestures)),
            },
            network: Arc::new(hub.network),
            timeline: hub_timeline.timeline,
            bodies: bodies.iter().map(|ported_body| ported_body.plan.clone()).collect(),
            contact_substeps,
            contact_order: pinned.map_or_else(ContactOrder::default, |pin| pin.contact_order),
            counted_cost: None,
            oversampling,
            frame_interval: 1,
            stops_when_silent: matches!(budget, Budget::Cents { .. }),
        };
        Ok(Self {
            island_plan,
            bodies,
            certificate,
            modes_refusal: refusal,
            can_solve_laws_between_steps: may_collocate,
            cut_shape: CutShape::from_choice(choice),
            is_single_step,
            stepped_ns,
        })
    }

    /// Whether a discrete network is the reference, so that every step of it is exact.
    pub(crate) fn is_discrete_reference(&self) -> bool {
        let network = &self.island_plan.network;
        let mut mat_parts = network.mats().part.iter().map(|&part| part as usize);
        mat_parts.any(|part| network.parts()[part].ca_rate.is_some())
    }

    /// How the same island is assembled with all its modes, and at half its step where that is more exact.
    pub(crate) fn options_for_half_step<'a>(&self, methods: &'a [Option<(MeshMethod, u32)>]) -> AssemblyOptions<'a> {
        let factor = if self.is_discrete_reference() { 1 } else { 2 };
        self.options_at_rate(factor * self.island_plan.oversampling, methods)
    }

    /// How the same island is assembled at another rate; `methods`: those of its meshes.
    pub(crate) fn options_at_rate<'a>(
        &self,
        oversampling: u32,
        methods: &'a [Option<(MeshMethod, u32)>],
    ) -> AssemblyOptions<'a> {
        AssemblyOptions {
            oversampling,
            body_methods: self.cut_shape.with_methods(methods),
            is_single_step: self.is_single_step,
        }
    }

    /// How finely it is computed.
    pub(crate) fn stepping(&self) -> Stepping {
        Stepping {
            oversampling: self.island_plan.oversampling,
            contact_substeps: self.island_plan.contact_substeps,
            contact_order: self.island_plan.contact_order,
            counted_cost: self.island_plan.counted_cost,
            cut_shape: self.cut_shape,
            is_single_step: self.is_single_step,
            mesh_methods: self.mesh_methods(),
        }
    }

    /// The same island with its contacts computed as finely as `stepping` says, for which it was assembled.
    pub(crate) fn with_stepping(mut self, stepping: &Stepping) -> Self {
        self.island_plan.contact_substeps = stepping.contact_substeps;
        self.island_plan.contact_order = stepping.contact_order;
        self.island_plan.counted_cost = stepping.counted_cost;
        self
    }

    /// Whether something in it sticks and slips: two runs may then agree by chance, both slipping too late.
    pub(crate) fn has_sticking_friction(&self) -> bool {
        let mut link_runs = self.island_plan.network.runs().iter();
        link_runs.any(|run| matches!(run.kind, LinkKind::Bristle(_) | LinkKind::Dry(_)))
    }

    /// Whether it has dry friction, whose stops and turns are located between frames.
    pub(crate) fn has_dry_friction(&self) -> bool {
        let mut link_runs = self.island_plan.network.runs().iter();
        link_runs.any(|run| matches!(run.kind, LinkKind::Dry(_)))
    }

    /// Whether it computes a contact without losses once a step.
    pub(crate) fn has_lossless_steps(&self) -> bool {
        let mut link_runs = self.island_plan.network.runs().iter();
        let has_lossless_contact = link_runs.any(|run| matches!(run.kind, LinkKind::But(_)) && run.z == 0.0);
        has_lossless_contact && (self.is_single_step || self.island_plan.contact_substeps == 1)
    }

    /// The methods of its bodies that are meshes, in order.
    pub(crate) fn mesh_methods(&self) -> Vec<Option<(MeshMethod, u32)>> {
        let body_plans = self.island_plan.bodies.iter();
        body_plans.map(BodyPlan::mesh_method).collect()
    }

    /// The same island with only the modes `modes_kept`, and these contact substeps.
    pub(crate) fn with_modes(mut self, contact_substeps: usize, modes_kept: Vec<KeptModes>) -> Self {
        let mut hub_network = (*self.island_plan.network).clone();
        for (body, modes_kept) in self.bodies.iter_mut().zip(modes_kept) {
            if let BodyPlan::Modal(modal_body) = &body.plan {
                body.plan = BodyPlan::Modal(modal_body.with_modes(&modes_kept.modes));
                body.left_out_db = modes_kept.left_out_db;
                body.computed_modes = modes_kept.numbers();
                ported::set_port_masses(&mut hub_network, &body.plan);
            }
        }
        self.island_plan.network = Arc::new(hub_network);
        self.island_plan.bodies = self.bodies.iter().map(|ported_body| ported_body.plan.clone()).collect();
        self.island_plan.contact_substeps = contact_substeps;
        self
    }
}

/// An island whose slow parts keep the duration of their macrosteps at a higher rate; `None` without such parts.
fn scale_macrosteps(subset: &Subset, oversampling: u32) -> Option<Subset> {
    (oversampling > 1 && subset.network.has_slow_parts()).then(|| Subset {
        network: subset
            .network
            .with_macrosteps(|_, macrostep| macrostep?.checked_mul(oversampling)),
        ..subset.clone()
    })
}

/// Only at the score's own rate does the composer get an explanation.
fn refusal_detail(oversampling: u32) -> RefusalDetail {
    match oversampling {
        1 => RefusalDetail::Full,
        _ => RefusalDetail::VerdictOnly,
    }
}

fn oversampled_timeline(timeline: &Timeline, oversampling: u32, network: &Network) -> Result<Timeline, Error> {
    let mut mat_parts = network.mats().part.iter().map(|&part| part as usize);
    // A discrete network that is the reference has only one rate.
    let is_discrete = mat_parts.any(|part| network.parts()[part].ca_rate.is_some());
    let faster_timeline = (!is_discrete)
        .then(|| timeline.with_higher_rate(oversampling))
        .flatten();
    faster_timeline.ok_or_else(|| Error::Refused {
        module: network.mat_name(0),
        message: format!("its events cannot be computed {oversampling} times a frame"),
    })
}

/// Chooses the contact substeps a frame of a network, at most `steps_max`; also returns whether laws may be computed
/// between frames, and the certificate of the rest.
pub(crate) fn certified_hub(
    network: &Network,
    timeline: &Timeline,
    budget: &Budget,
    steps_max: usize,
    refusal: RefusalDetail,
) -> Result<(usize, bool, Certificate), Error> {
    let network = &with_greatest_factors(network, &timeline.leads)?;
    let mut hub_scheme = Scheme::new(network, timeline.rate)?;
    let mat_parts = network.mats().part.iter().map(|&part| part as usize);
    let mut ca_rates = mat_parts.map(|part| network.parts()[part].ca_rate);
    // If the discrete network is the reference, so are its contacts.
    let is_discrete = ca_rates.any(|reference_rate| reference_rate.is_some());
    let determined_mats = timeline.determined_mats();
    let (has_contacts, has_laws) = hub_scheme.has_substepped(&determined_mats);
    let mut contact_substeps = if has_contacts && !is_discrete {
        budget.contact_substeps().min(steps_max)
    } else {
        1
    };
    if contact_substeps > 1 {
        hub_scheme.take_substepped(&determined_mats);
    }
    let may_collocate = has_laws && !is_discrete && steps_max > 1;
    let laws_may_need_substeps = may_collocate && contact_substeps == 1 && !matches!(budget, Budget::Method(_));
    if timeline.is_unguarded {
        hub_scheme.drop_softening_laws();
    }
    let certificate = match hub_scheme.certify_with_detail(network, refusal) {
        // Between frames a law is solved implicitly, so no slope of its friction is too steep.
        Err(Error::Unstable { .. }) if laws_may_need_substeps && hub_scheme.is_stable_undamped(network) => {
            contact_substeps = FINE_SUBSTEPS_MIN.min(steps_max);
            hub_scheme.take_substepped(&determined_mats);
            hub_scheme.certify_with_detail(network, refusal)?
        }
        certificate => certificate?,
    };
    Ok((contact_substeps, may_collocate, certificate))
}

/// Composes two maps.
fn compose_maps(first: &[u32], second: &[u32]) -> Vec<u32> {
    second.iter().map(|&inner_index| first[inner_index as usize]).collect()
}
