//! Whether slow parts of an island may be slow, and which others could be (keys, what is only seen): they do not make it
//! grow, and what they cost in exactness.

use std::collections::BTreeSet;

use crate::island::inside::BodyPlan;
use crate::network::{Error, Network, Run, Subset, Term};
use crate::plan::budget::Budget;
use crate::plan::cost;
use crate::plan::passes::assemble::Assembled;
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::passes::slow::{Stays, slow};
use crate::plan::passes::solved_modes::Memo;
use crate::plan::passes::split::OwnTimeline;
use crate::plan::report::content::IslandContent;
use crate::plan::report::row::Measured;
use crate::plan::trial::allowance::{Allowance, unless_spent};
use crate::plan::trial::audible::Audible;
use crate::plan::trial::horizon;
use crate::plan::trial::macrostep::{self, Growth};
use crate::plan::trial::pilot_run::{is_worth, length, play};
use crate::plan::trial::record::{Series, TrialStore, measured};
use crate::plan::trial::waveform_error::{Spans, difference};
use crate::scheme::StabilityGuarantee;
use crate::timeline::Timeline;

/// A key is made slow where its modes turn by so much from kick to kick at most [rad]: R·√λ ≤ 1, R half of what its
/// own stability would bear. In undamped scans none such grew.
const TURN: f64 = 1.0;

/// An island with only those of its parts slow that may be, as far as one sees without playing; and the others.
pub(in crate::plan) fn settle(
    subset: &Subset,
    own: &OwnTimeline,
    budget: &Budget,
) -> (Subset, Vec<Stays>) {
    let stay = match budget {
        Budget::Method(_) => all(subset, "the score asks for one method for everything"),
        Budget::Error(_) | Budget::Cents { .. } => slow(&subset.network, &own.timeline).stay,
    };
    (without(subset, &stay), stay)
}

/// The parts here that are to be slow, with a reason for all of them.
pub(in crate::plan) fn all(subset: &Subset, why: &str) -> Vec<Stays> {
    let mats = subset.network.mats();
    let parts = subset.network.parts().iter().enumerate();
    let is_ours = |at: usize| mats.part.contains(&(at as u32));
    parts
        .filter(|(at, part)| part.macrostep.is_some() && is_ours(*at))
        .map(|(_, part)| (part.name.clone(), why.to_owned()))
        .collect()
}

/// The same island with some parts at every frame.
pub(in crate::plan) fn without(subset: &Subset, stay: &[Stays]) -> Subset {
    let stays = |name: &str| stay.iter().any(|(own, _)| own == name);
    Subset {
        network: subset
            .network
            .with_macrosteps(|name, every| every.filter(|_| !stays(name))),
        ..subset.clone()
    }
}

/// An island with some of its parts slow that have no rate of their own and may be; `None` where none is, or where that
/// costs no less. What a part does to the sound is not known where hands or a session play, and where the discrete network
/// is the truth a plan changes no more than rounding does.
pub(in crate::plan) fn offer(
    subset: &Subset,
    own: &OwnTimeline,
    budget: &Budget,
    offered: Offered,
    every: u32,
) -> Option<Subset> {
    let timeline = &own.timeline;
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
    let may = |name: &str| names.contains(name);
    let set = |name: &str, own: Option<u32>| own.or(may(name).then_some(every));
    let slowed = network.with_macrosteps(set);
    let found = slow(&slowed, timeline);
    let fits: BTreeSet<usize> = found
        .bodies
        .iter()
        .filter(|(_, slow)| slow.turn <= offered.most_turn() && cost::saved(slow) > 0.0)
        .map(|(_, slow)| slow.part)
        .collect();
    let fits =
        |name: &str| may(name) && fits.iter().any(|&part| network.parts()[part].name == name);
    let network = network.with_macrosteps(|name, own| own.or(fits(name).then_some(every)));
    is_more(&network, &subset.network).then(|| Subset {
        network,
        ..subset.clone()
    })
}

/// Parts that a plan may make slow where nobody asks for it by their names.
#[derive(Clone, Copy, Debug)]
pub(in crate::plan) enum Offered {
    /// Keys.
    Keys,
    /// What is only seen: no output hears it, and nobody plays it.
    OnlySeen,
}

impl Offered {
    /// How far a mode of them may turn from kick to kick [rad].
    fn most_turn(self) -> f64 {
        match self {
            Self::Keys => TURN,
            // As far as a slow body may at all: what it changes is measured.
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
                for played in keys.into_iter().chain(driven).chain(heard(network)) {
                    parts.remove(&played);
                }
                parts
            }
        }
    }
}

/// Parts that outputs hear.
fn heard(network: &Network) -> BTreeSet<usize> {
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

/// Whether more parts are slow.
fn is_more(network: &Network, than: &Network) -> bool {
    let count = |network: &Network| {
        let parts = network.parts().iter();
        parts.filter(|part| part.macrostep.is_some()).count()
    };
    count(network) > count(than)
}

/// How much an island with slow parts grows from kick to kick; `None`: it has none. Where it does grow, why they
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
    Err(format!(
        "its contacts are too stiff for that rate: motion would grow by a factor of {:.3} from step to step",
        growth.radius
    ))
}

/// What slow parts change of the sound [dB], and over how long [s]: an island is played beside the same with kicks at
/// every frame. `None` where that would take long.
pub(in crate::plan) fn error(
    subset: &Subset,
    own: &OwnTimeline,
    budget: &Budget,
    island: &Assembled,
    (memo, allowance, store): (&Memo<'_>, &Allowance, Option<&dyn TrialStore>),
) -> Result<Option<Measured>, Error> {
    let methods = island.mesh_methods();
    let (oversampling, contact_substeps) = (
        island.island_plan.oversampling,
        island.island_plan.contact_substeps,
    );
    let how = (oversampling, MethodChoice::AsBefore(&methods));
    let slow = Assembled::new(subset, own, budget, how, None, memo)?;
    let single = Subset {
        network: subset.network.with_macrosteps(|_, every| every.map(|_| 1)),
        ..subset.clone()
    };
    let Ok(single) = Assembled::new(&single, own, budget, how, None, memo) else {
        return Ok(None);
    };
    let series = store.map(|store| {
        let also = format_args!("slow {budget:?} {oversampling} {contact_substeps} {methods:?}");
        Series::new(
            store,
            IslandContent::of(&subset.network, &own.timeline, also),
        )
    });
    let found = measured(series, allowance, || {
        beside(&slow, &single, contact_substeps, (budget, allowance))
    })?;
    let Some(found) = found else {
        return Ok(None);
    };
    let ways = [&slow, &single].map(|island| (&island.island_plan, contact_substeps));
    let known = (allowance, store);
    unless_spent(horizon::held(found, budget.asked(), ways, known))
}

/// How far apart an island and the same with kicks at every frame are, over its beginning.
fn beside(
    slow: &Assembled,
    single: &Assembled,
    contact_substeps: usize,
    (budget, allowance): (&Budget, &Allowance),
) -> Result<Option<Measured>, Error> {
    let excerpt = unless_spent(length(&slow.island_plan, allowance))?;
    let excerpt = excerpt
        .filter(|excerpt| excerpt.n_frames > 0 && is_worth(&single.island_plan, excerpt.n_frames));
    let Some(excerpt) = excerpt else {
        return Ok(None);
    };
    let spans = Spans::of(&slow.island_plan, excerpt.n_frames);
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
        audible: Audible::of_budget(budget, (&slowly, &plainly.sound), &spans),
    }))
}

/// How sure a certificate is of an island whose other links say `word`.
pub(in crate::plan) fn word(growth: Growth, word: StabilityGuarantee) -> StabilityGuarantee {
    if growth.is_tried {
        StabilityGuarantee::Tried
    } else {
        word
    }
}
