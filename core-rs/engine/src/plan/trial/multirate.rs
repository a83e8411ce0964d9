//! Which parts of an island may be slow, among those that ask for it and others (keys, what is only seen): whether the
//! island stays stable, and what error slow parts add.

use std::collections::BTreeSet;

use crate::assembly::assemble::{Assembled, AssemblyOptions};
use crate::assembly::budget::Budget;
use crate::assembly::cost;
use crate::assembly::mesh::MethodChoice;
use crate::assembly::slow::growth::{self, Growth};
use crate::assembly::slow::{RefusedSlowPart, slow_bodies};
use crate::assembly::solved_modes::ModeCache;
use crate::assembly::split::LocalTimeline;
use crate::assembly::unit::IslandPlan;
use crate::content::island::IslandContent;
use crate::hearing::Scatter;
use crate::island::bodies::BodyPlan;
use crate::network::{Error, LinkKind, Network, Run, Subset, Term};
use crate::plan::constants::KEY_KICK_PHASE_MAX;
use crate::plan::row::MeasuredError;
use crate::plan::trial::allowance::{Allowance, none_if_spent};
use crate::plan::trial::horizon::{self, PlannedRun};
use crate::plan::trial::pilot_run::{is_affordable, pilot_excerpt, play};
use crate::plan::trial::record::{TrialSeries, TrialStore, measured_error};
use crate::plan::trial::waveform_error::{ComparedSpans, difference_db};
use crate::scheme::StabilityGuarantee;
use crate::timeline::Timeline;

/// The island with only those slow parts that may be slow as far as can be seen without playing, and the others with
/// reasons.
pub(in crate::plan) fn without_refused_slow(
    subset: &Subset,
    island_timeline: &LocalTimeline,
    budget: &Budget,
) -> (Subset, Vec<RefusedSlowPart>) {
    let refused_slow = match budget {
        Budget::Method(_) => refuse_all(subset, "the score asks for one method for everything"),
        Budget::Error(_) | Budget::Cents { .. } => {
            slow_bodies(&subset.network, &island_timeline.timeline).refused_parts
        }
    };
    (without_slow(subset, &refused_slow), refused_slow)
}

/// All parts of the island that ask to be slow, each with the `reason` not to be.
pub(in crate::plan) fn refuse_all(subset: &Subset, reason: &str) -> Vec<RefusedSlowPart> {
    let mats = subset.network.mats();
    let indexed_parts = subset.network.parts().iter().enumerate();
    let has_part_mats = |part_index: usize| mats.part.contains(&(part_index as u32));
    indexed_parts
        .filter(|(part_index, part)| part.macrostep.is_some() && has_part_mats(*part_index))
        .map(|(_, part)| (part.name.clone(), reason.to_owned()))
        .collect()
}

/// The same island with the parts in `refused_slow` computed at every frame.
pub(in crate::plan) fn without_slow(subset: &Subset, refused_slow: &[RefusedSlowPart]) -> Subset {
    let is_refused = |name: &str| refused_slow.iter().any(|(refused_name, _)| refused_name == name);
    Subset {
        network: subset
            .network
            .with_macrosteps(|name, macrostep| macrostep.filter(|_| !is_refused(name))),
        ..subset.clone()
    }
}

/// The island with further parts made slow that do not ask for it but may be; `None` if there are none, or if that
/// saves nothing. Nothing is offered where hands or a session play, as the effect of a slow part on the sound is then
/// unknown, nor where the discrete network is the reference: there a plan may change only rounding.
pub(in crate::plan) fn with_offered_slow(
    subset: &Subset,
    island_timeline: &LocalTimeline,
    budget: &Budget,
    offered: OfferedParts,
    macrostep: u32,
) -> Option<Subset> {
    let timeline = &island_timeline.timeline;
    if matches!(budget, Budget::Method(_)) || timeline.is_open || timeline.hands().next().is_some() {
        return None;
    }
    let network = &subset.network;
    let part_of_mats = &network.mats().part;
    if part_of_mats
        .iter()
        .any(|&part| network.parts()[part as usize].ca_rate.is_some())
    {
        return None;
    }
    let offered_names: BTreeSet<&str> = offered
        .part_indices(network, timeline)
        .into_iter()
        .map(|part| &network.parts()[part])
        .filter(|part| part.macrostep.is_none())
        .map(|part| part.name.as_str())
        .collect();
    if offered_names.is_empty() {
        return None;
    }
    let is_offered = |name: &str| offered_names.contains(name);
    let macrostep_of =
        |name: &str, asked_macrostep: Option<u32>| asked_macrostep.or(is_offered(name).then_some(macrostep));
    let slowed_network = network.with_macrosteps(macrostep_of);
    let slowed_bodies = slow_bodies(&slowed_network, timeline);
    let fitting_parts: BTreeSet<usize> = slowed_bodies
        .bodies
        .iter()
        .filter(|(_, slow)| slow.kick_phase <= offered.kick_phase_max() && cost::saved_ns(slow) > 0.0)
        .map(|(_, slow)| slow.part)
        .collect();
    let is_fitting =
        |name: &str| is_offered(name) && fitting_parts.iter().any(|&part| network.parts()[part].name == name);
    let network =
        network.with_macrosteps(|name, asked_macrostep| asked_macrostep.or(is_fitting(name).then_some(macrostep)));
    has_more_slow_parts(&network, &subset.network).then(|| Subset {
        network,
        ..subset.clone()
    })
}

/// Parts that a plan may make slow without being asked.
#[derive(Clone, Copy, Debug)]
pub(in crate::plan) enum OfferedParts {
    /// Keys.
    Keys,
    /// What is only seen: no output hears it, and nobody plays it.
    DisplayedOnly,
}

impl OfferedParts {
    /// Largest turn of their modes from kick to kick [rad].
    fn kick_phase_max(self) -> f64 {
        match self {
            Self::Keys => KEY_KICK_PHASE_MAX,
            // As much as any slow body may turn: its error is measured.
            Self::DisplayedOnly => f64::INFINITY,
        }
    }

    fn part_indices(self, network: &Network, timeline: &Timeline) -> BTreeSet<usize> {
        let part_of_mat = |mat: usize| network.mats().part[mat] as usize;
        let key_parts: BTreeSet<usize> = timeline.keys.iter().map(|key| part_of_mat(key.struck_mat)).collect();
        match self {
            Self::Keys => key_parts,
            Self::DisplayedOnly => {
                let mut unheard_parts: BTreeSet<usize> = (0..network.n_mat()).map(part_of_mat).collect();
                let driven_parts = timeline.drives.iter().map(|drive| part_of_mat(drive.mat));
                for audible_or_played in key_parts.into_iter().chain(driven_parts).chain(audible_parts(network)) {
                    unheard_parts.remove(&audible_or_played);
                }
                unheard_parts
            }
        }
    }
}

/// Parts that outputs hear.
fn audible_parts(network: &Network) -> BTreeSet<usize> {
    let mut parts_heard = BTreeSet::new();
    for term in network.outputs().iter().flat_map(|output| &output.terms) {
        match *term {
            Term::Position { first, len, .. } | Term::Ground { first, len, .. } => {
                let mat_parts = &network.mats().part[first..first + len];
                parts_heard.extend(mat_parts.iter().map(|&part| part as usize));
            }
            Term::Force { first, len, .. } | Term::Length { first, len, .. } => {
                let term_links = first..first + len;
                let link_runs = network.runs().iter();
                let is_heard = |run: &&Run| run.first < term_links.end && term_links.start < run.first + run.len;
                parts_heard.extend(link_runs.filter(is_heard).map(|run| run.part));
            }
        }
    }
    parts_heard
}

/// Whether more parts of `network` than of `compared_network` are slow.
fn has_more_slow_parts(network: &Network, compared_network: &Network) -> bool {
    let slow_part_count = |network: &Network| {
        let parts = network.parts().iter();
        parts.filter(|part| part.macrostep.is_some()).count()
    };
    slow_part_count(network) > slow_part_count(compared_network)
}

/// How much an island with slow parts grows from kick to kick; `None` if it has none. The error says why its parts
/// cannot be slow.
pub(in crate::plan) fn certify_growth(island: &Assembled, allowance: &Allowance) -> Result<Option<Growth>, String> {
    let body_plans = &island.island_plan.bodies;
    if !body_plans.iter().any(|body| matches!(body, BodyPlan::Slow(_))) {
        return Ok(None);
    }
    let Some(growth) = growth::growth(&island.island_plan) else {
        return Err("its stability at its own rate is too expensive to test".to_owned());
    };
    allowance.spend_unchecked(growth.test_seconds);
    if growth.is_stable() {
        return Ok(Some(growth));
    }
    Err(stiffness_refusal(&island.island_plan, growth))
}

/// Why an island grows: the stiffest link at its slow parts, and by how much.
fn stiffness_refusal(island_plan: &IslandPlan, growth: Growth) -> String {
    let network = &*island_plan.network;
    let body_plans = island_plan.bodies.iter();
    let slow_bodies = body_plans.filter(|body| matches!(body, BodyPlan::Slow(_)));
    let port_mats: BTreeSet<usize> = slow_bodies.flat_map(BodyPlan::ports).collect();
    let is_cause = |run: &&Run| matches!(run.kind, LinkKind::But(_)) == growth.is_from_contacts;
    let touching_links = network.runs().iter().filter(is_cause).flat_map(|run| {
        let touches = |i: &usize| [run.a + i, run.b + i].iter().any(|mat| port_mats.contains(mat));
        (0..run.len).filter(touches).map(|i| (run.k, run.first + i))
    });
    let stiffest = touching_links.max_by(|(k, _), (other_stiffness, _)| k.total_cmp(other_stiffness));
    let (link_kind, plural_cause) = match growth.is_from_contacts {
        true => ("contact", "its contacts are"),
        false => ("link", "its links to other parts are"),
    };
    let growth_cause = stiffest.map_or(plural_cause.to_owned(), |(k, link)| {
        format!("the {link_kind} {} (K {k} N/m) is", network.link_name(link))
    });
    let percent = 100.0 * (growth.growth_per_kick - 1.0);
    format!("{growth_cause} too stiff for that rate: motion would grow by {percent:.2}% in each of its steps")
}

/// What slow parts change in the sound: their error, and how long it holds. The island is compared with the same island
/// with kicks at every frame. `None` if that would take too long.
pub(in crate::plan) fn slow_error(
    subset: &Subset,
    island_timeline: &LocalTimeline,
    budget: &Budget,
    island: &Assembled,
    (mode_cache, allowance, store): (&ModeCache<'_>, &Allowance, Option<&dyn TrialStore>),
) -> Result<Option<MeasuredError>, Error> {
    let methods = island.mesh_methods();
    let (oversampling, contact_substeps) = (island.island_plan.oversampling, island.island_plan.contact_substeps);
    let assembly_options = AssemblyOptions::between_steps(oversampling, MethodChoice::Repeated(&methods));
    let slow_island = Assembled::new(subset, island_timeline, budget, assembly_options, None, mode_cache)?;
    let every_frame_subset = Subset {
        network: subset.network.with_macrosteps(|_, macrostep| macrostep.map(|_| 1)),
        ..subset.clone()
    };
    let Ok(every_frame_island) = Assembled::new(
        &every_frame_subset,
        island_timeline,
        budget,
        assembly_options,
        None,
        mode_cache,
    ) else {
        return Ok(None);
    };
    let trial_series = store.map(|store| {
        let also_hashed = format_args!("slow {budget:?} {oversampling} {contact_substeps} {methods:?}");
        TrialSeries::new(
            store,
            IslandContent::new(&subset.network, &island_timeline.timeline, also_hashed),
        )
    });
    let slow_error = measured_error(trial_series, allowance, || {
        compare_with_every_frame(&slow_island, &every_frame_island, contact_substeps, (budget, allowance))
    })?;
    let Some(slow_error) = slow_error else {
        return Ok(None);
    };
    let played_pair = [&slow_island, &every_frame_island].map(|island| PlannedRun {
        island_plan: &island.island_plan,
        contact_substeps,
    });
    none_if_spent(horizon::extend_error(
        slow_error,
        budget,
        played_pair,
        (allowance, store),
    ))
}

/// The difference between an island and the same with kicks at every frame, over its beginning.
fn compare_with_every_frame(
    slow_island: &Assembled,
    every_frame_island: &Assembled,
    contact_substeps: usize,
    (budget, allowance): (&Budget, &Allowance),
) -> Result<Option<MeasuredError>, Error> {
    let excerpt = none_if_spent(pilot_excerpt(&slow_island.island_plan, allowance))?;
    let excerpt = excerpt
        .filter(|excerpt| excerpt.n_frames > 0 && is_affordable(&every_frame_island.island_plan, excerpt.n_frames));
    let Some(excerpt) = excerpt else {
        return Ok(None);
    };
    let spans = ComparedSpans::new(&slow_island.island_plan, excerpt.n_frames);
    let play_island = |island: &Assembled| {
        let played_run = play(&island.island_plan, contact_substeps, excerpt, allowance);
        none_if_spent(played_run)
    };
    let (Some(slow_run), Some(every_frame_run)) = (play_island(slow_island)?, play_island(every_frame_island)?) else {
        return Ok(None);
    };
    let db = difference_db(&slow_run.sound, &every_frame_run.sound, &spans);
    Ok(db.is_finite().then_some(MeasuredError {
        waveform_db: db,
        duration_seconds: excerpt.end() as f64 / spans.rate,
        third_octave_db: None,
        audible: spans
            .audible_error(budget, (&slow_run.sound, &every_frame_run.sound), Scatter::Counted)
            .filter(|_| !slow_run.is_unusable),
    }))
}

/// The certificate of an island with slow parts; `other_guarantee` is that of its other links.
pub(in crate::plan) fn stability_with_growth(
    growth: Growth,
    other_guarantee: StabilityGuarantee,
) -> StabilityGuarantee {
    if growth.is_estimated {
        StabilityGuarantee::Tried
    } else {
        other_guarantee
    }
}
