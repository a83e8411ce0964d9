//! Which parts of an island may be slow, among those that ask for it and others (keys, what is only seen): whether the
//! island stays stable, and what error slow parts add.

use std::collections::BTreeSet;

use crate::island::inside::BodyPlan;
use crate::network::{Error, LinkKind, Network, Run, Subset, Term};
use crate::plan::IslandPlan;
use crate::plan::budget::Budget;
use crate::plan::constants::PHASE_MAX;
use crate::plan::cost;
use crate::plan::passes::assemble::{Assembled, How};
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::passes::slow::{RefusedSlow, slow_bodies};
use crate::plan::passes::solved_modes::Memo;
use crate::plan::passes::split::OwnTimeline;
use crate::plan::report::content::IslandContent;
use crate::plan::report::row::Measured;
use crate::plan::trial::allowance::{Allowance, unless_spent};
use crate::plan::trial::audible::Audible;
use crate::plan::trial::horizon;
use crate::plan::trial::macrostep::{self, Growth};
use crate::plan::trial::pilot_run::{find_excerpt, is_affordable, play};
use crate::plan::trial::record::{Series, TrialStore, measured};
use crate::plan::trial::waveform_error::{Spans, difference};
use crate::scheme::StabilityGuarantee;
use crate::timeline::Timeline;

/// The island with only those slow parts that may be slow as far as can be seen without playing, and the others with
/// reasons.
pub(in crate::plan) fn settle(
    subset: &Subset,
    island_timeline: &OwnTimeline,
    budget: &Budget,
) -> (Subset, Vec<RefusedSlow>) {
    let refused_slow = match budget {
        Budget::Method(_) => refuse_all(subset, "the score asks for one method for everything"),
        Budget::Error(_) | Budget::Cents { .. } => {
            slow_bodies(&subset.network, &island_timeline.timeline).refused_slow
        }
    };
    (without_slow(subset, &refused_slow), refused_slow)
}

/// All parts of the island that ask to be slow, each with the reason `why` not to be.
pub(in crate::plan) fn refuse_all(subset: &Subset, why: &str) -> Vec<RefusedSlow> {
    let mats = subset.network.mats();
    let parts = subset.network.parts().iter().enumerate();
    let is_ours = |at: usize| mats.part.contains(&(at as u32));
    parts
        .filter(|(at, part)| part.macrostep.is_some() && is_ours(*at))
        .map(|(_, part)| (part.name.clone(), why.to_owned()))
        .collect()
}

/// The same island with the parts in `refused_slow` computed at every frame.
pub(in crate::plan) fn without_slow(subset: &Subset, refused_slow: &[RefusedSlow]) -> Subset {
    let is_refused = |name: &str| refused_slow.iter().any(|(own, _)| own == name);
    Subset {
        network: subset
            .network
            .with_macrosteps(|name, every| every.filter(|_| !is_refused(name))),
        ..subset.clone()
    }
}

/// The island with further parts made slow that do not ask for it but may be; `None` if there are none, or if that
/// saves nothing. Nothing is offered where hands or a session play, as the effect of a slow part on the sound is then
/// unknown, nor where the discrete network is the reference: there a plan may change only rounding.
pub(in crate::plan) fn offer(
    subset: &Subset,
    island_timeline: &OwnTimeline,
    budget: &Budget,
    offered: Offered,
    every: u32,
) -> Option<Subset> {
    let timeline = &island_timeline.timeline;
    if matches!(budget, Budget::Method(_)) || timeline.is_open || timeline.hands().next().is_some()
    {
        return None;
    }
    let network = &subset.network;
    let mats = &network.mats().part;
    if mats
        .iter()
        .any(|&part| network.parts()[part as usize].ca_rate.is_some())
    {
        return None;
    }
    let names: BTreeSet<&str> = offered
        .parts(network, timeline)
        .into_iter()
        .map(|part| &network.parts()[part])
        .filter(|part| part.macrostep.is_none())
        .map(|part| part.name.as_str())
        .collect();
    if names.is_empty() {
        return None;
    }
    let is_offered = |name: &str| names.contains(name);
    let set = |name: &str, island_timeline: Option<u32>| {
        island_timeline.or(is_offered(name).then_some(every))
    };
    let slowed = network.with_macrosteps(set);
    let slowed_bodies = slow_bodies(&slowed, timeline);
    let fits: BTreeSet<usize> = slowed_bodies
        .bodies
        .iter()
        .filter(|(_, slow)| slow.turn <= offered.phase_max() && cost::saved(slow) > 0.0)
        .map(|(_, slow)| slow.part)
        .collect();
    let fits = |name: &str| {
        is_offered(name) && fits.iter().any(|&part| network.parts()[part].name == name)
    };
    let network = network
        .with_macrosteps(|name, island_timeline| island_timeline.or(fits(name).then_some(every)));
    is_more(&network, &subset.network).then(|| Subset {
        network,
        ..subset.clone()
    })
}

/// Parts that a plan may make slow without being asked.
#[derive(Clone, Copy, Debug)]
pub(in crate::plan) enum Offered {
    /// Keys.
    Keys,
    /// What is only seen: no output hears it, and nobody plays it.
    OnlySeen,
}

impl Offered {
    /// Largest turn of their modes from kick to kick [rad].
    fn phase_max(self) -> f64 {
        match self {
            Self::Keys => PHASE_MAX,
            // As much as any slow body may turn: its error is measured.
            Self::OnlySeen => f64::INFINITY,
        }
    }

    fn parts(self, network: &Network, timeline: &Timeline) -> BTreeSet<usize> {
        let part = |mat: usize| network.mats().part[mat] as usize;
        let keys: BTreeSet<usize> = timeline.keys.iter().map(|key| part(key.struck)).collect();
        match self {
            Self::Keys => keys,
            Self::OnlySeen => {
                let mut parts: BTreeSet<usize> = (0..network.n_mat()).map(part).collect();
                let driven = timeline.drives.iter().map(|drive| part(drive.mat));
                for played in keys.into_iter().chain(driven).chain(audible_parts(network)) {
                    parts.remove(&played);
                }
                parts
            }
        }
    }
}

/// Parts that outputs hear.
fn audible_parts(network: &Network) -> BTreeSet<usize> {
    let mut parts = BTreeSet::new();
    for term in network.outputs().iter().flat_map(|output| &output.terms) {
        match *term {
            Term::Position { first, len, .. } | Term::Ground { first, len, .. } => {
                let mats = &network.mats().part[first..first + len];
                parts.extend(mats.iter().map(|&part| part as usize));
            }
            Term::Force { first, len, .. } | Term::Length { first, len, .. } => {
                let links = first..first + len;
                let runs = network.runs().iter();
                let is_heard =
                    |run: &&Run| run.first < links.end && links.start < run.first + run.len;
                parts.extend(runs.filter(is_heard).map(|run| run.part));
            }
        }
    }
    parts
}

/// Whether more parts of `network` than of `than` are slow.
fn is_more(network: &Network, than: &Network) -> bool {
    let count = |network: &Network| {
        let parts = network.parts().iter();
        parts.filter(|part| part.macrostep.is_some()).count()
    };
    count(network) > count(than)
}

/// How much an island with slow parts grows from kick to kick; `None` if it has none. The error says why its parts
/// cannot be slow.
pub(in crate::plan) fn certify(
    island: &Assembled,
    allowance: &Allowance,
) -> Result<Option<Growth>, String> {
    let bodies = &island.island_plan.bodies;
    if !bodies.iter().any(|body| matches!(body, BodyPlan::Slow(_))) {
        return Ok(None);
    }
    let Some(growth) = macrostep::growth(&island.island_plan) else {
        return Err("its stability at its own rate is too expensive to test".to_owned());
    };
    allowance.spend(growth.work);
    if growth.is_stable() {
        return Ok(Some(growth));
    }
    Err(too_stiff(&island.island_plan, growth))
}

/// Why an island grows: the stiffest link at its slow parts, and by how much.
fn too_stiff(island_plan: &IslandPlan, growth: Growth) -> String {
    let network = &*island_plan.network;
    let bodies = island_plan.bodies.iter();
    let slow = bodies.filter(|body| matches!(body, BodyPlan::Slow(_)));
    let ports: BTreeSet<usize> = slow.flat_map(BodyPlan::ports).collect();
    let is_cause = |run: &&Run| matches!(run.kind, LinkKind::But(_)) == growth.is_by_contacts;
    let links = network.runs().iter().filter(is_cause).flat_map(|run| {
        let touches = |i: &usize| [run.a + i, run.b + i].iter().any(|mat| ports.contains(mat));
        let links = (0..run.len).filter(touches);
        links.map(|i| (run.k, run.first + i))
    });
    let stiffest = links.max_by(|(k, _), (other, _)| k.total_cmp(other));
    let (kind, others) = match growth.is_by_contacts {
        true => ("contact", "its contacts are"),
        false => ("link", "its links to other parts are"),
    };
    let cause = stiffest.map_or(others.to_owned(), |(k, link)| {
        format!("the {kind} {} (K {k} N/m) is", network.link_name(link))
    });
    let percent = 100.0 * (growth.radius - 1.0);
    format!(
        "{cause} too stiff for that rate: motion would grow by {percent:.2}% in each of its steps"
    )
}

/// What slow parts change in the sound: their error, and how long it holds. The island is compared with the same island
/// with kicks at every frame. `None` if that would take too long.
pub(in crate::plan) fn error(
    subset: &Subset,
    island_timeline: &OwnTimeline,
    budget: &Budget,
    island: &Assembled,
    (memo, allowance, store): (&Memo<'_>, &Allowance, Option<&dyn TrialStore>),
) -> Result<Option<Measured>, Error> {
    let methods = island.mesh_methods();
    let (oversampling, contact_substeps) = (
        island.island_plan.oversampling,
        island.island_plan.contact_substeps,
    );
    let how = How::fine(oversampling, MethodChoice::AsBefore(&methods));
    let slow = Assembled::new(subset, island_timeline, budget, how, None, memo)?;
    let single = Subset {
        network: subset.network.with_macrosteps(|_, every| every.map(|_| 1)),
        ..subset.clone()
    };
    let Ok(single) = Assembled::new(&single, island_timeline, budget, how, None, memo) else {
        return Ok(None);
    };
    let series = store.map(|store| {
        let also = format_args!("slow {budget:?} {oversampling} {contact_substeps} {methods:?}");
        Series::new(
            store,
            IslandContent::new(&subset.network, &island_timeline.timeline, also),
        )
    });
    let assembled = measured(series, allowance, || {
        compare_with_every_frame(&slow, &single, contact_substeps, (budget, allowance))
    })?;
    let Some(assembled) = assembled else {
        return Ok(None);
    };
    let played = [&slow, &single].map(|island| (&island.island_plan, contact_substeps));
    let known = (allowance, store);
    unless_spent(horizon::extend_error(assembled, budget, played, known))
}

/// The difference between an island and the same with kicks at every frame, over its beginning.
fn compare_with_every_frame(
    slow: &Assembled,
    single: &Assembled,
    contact_substeps: usize,
    (budget, allowance): (&Budget, &Allowance),
) -> Result<Option<Measured>, Error> {
    let excerpt = unless_spent(find_excerpt(&slow.island_plan, allowance))?;
    let excerpt = excerpt.filter(|excerpt| {
        excerpt.n_frames > 0 && is_affordable(&single.island_plan, excerpt.n_frames)
    });
    let Some(excerpt) = excerpt else {
        return Ok(None);
    };
    let spans = Spans::new(&slow.island_plan, excerpt.n_frames);
    let played = |island: &Assembled| {
        let run = play(&island.island_plan, contact_substeps, excerpt, allowance);
        unless_spent(run)
    };
    let (Some(slowly), Some(plainly)) = (played(slow)?, played(single)?) else {
        return Ok(None);
    };
    let db = difference(&slowly.sound, &plainly.sound, &spans);
    Ok(db.is_finite().then_some(Measured {
        db,
        over: excerpt.end() as f64 / spans.rate,
        spectral: None,
        audible: Audible::for_budget(budget, (&slowly.sound, &plainly.sound), &spans)
            .filter(|_| !slowly.is_lost),
    }))
}

/// The certificate of an island with slow parts; `others` is that of its other links.
pub(in crate::plan) fn guarantee(growth: Growth, others: StabilityGuarantee) -> StabilityGuarantee {
    if growth.is_tried {
        StabilityGuarantee::Tried
    } else {
        others
    }
}
