//! Slow parts of an island: which of their masses are computed once every R frames, and how their springs pull.

mod exact;
mod in_space;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::gesture::script::Touch;
use crate::island::slow::{Slow, Springs, Weights};
use crate::network::forest::{Forest, ends};
use crate::network::{LinkKind, MatKind, Network, Proxy, Run, SpaceLaw, Subset, Term};
use crate::plan::constants::TURN_MAX;
use crate::plan::cost;
use crate::plan::passes::body::output_sums;
use crate::plan::passes::wiring::Body;
use crate::timeline::{DriveKind, Timeline};
use crate::units::Rate;

/// Why a body with many ports keeps the audio rate in a session, where each of its masses is a port.
const DEARER: &str = "in a session, where each of its masses may be struck, it costs less so";

/// A part that asks to be slow but cannot be: its name, and why.
pub(in crate::plan) type RefusedSlow = (String, String);

/// The slow bodies of a network, and the parts that cannot be slow.
#[derive(Default)]
pub(in crate::plan) struct SlowBodies {
    pub(in crate::plan) bodies: Vec<(Body, Slow)>,
    pub(in crate::plan) refused_slow: Vec<RefusedSlow>,
}

/// The slow bodies of a network, for the parts that have a macrostep.
pub(in crate::plan) fn slow_bodies(network: &Network, timeline: &Timeline) -> SlowBodies {
    let mut slow_found = SlowBodies::default();
    for (part, slow_part) in network.parts().iter().enumerate() {
        let is_here = || network.mats().part.contains(&(part as u32));
        let Some(every) = slow_part.macrostep.filter(|_| is_here()) else {
            continue;
        };
        match needs_every_frame(network, timeline, part) {
            Some(why) => slow_found
                .refused_slow
                .push((slow_part.name.clone(), why.to_owned())),
            None => match bodies(network, timeline, part, every) {
                Ok(bodies) => slow_found.bodies.extend(bodies),
                Err(why) => slow_found.refused_slow.push((slow_part.name.clone(), why)),
            },
        }
    }
    slow_found
}

/// Why a gesture needs its key at every frame, if it does.
fn needs_every_frame(network: &Network, timeline: &Timeline, part: usize) -> Option<&'static str> {
    let part_of = |key: usize| network.mats().part[timeline.keys[key].struck] as usize;
    let mut gestures = timeline
        .gestures
        .iter()
        .filter(|gesture| part_of(gesture.key) == part);
    gestures.find_map(|gesture| match gesture.manner.touch {
        Touch::Tracked => Some("a gesture with `touch: tracked` moves it at every frame"),
        Touch::Open if gesture.manner.limit.is_some() => {
            Some("its force limit is checked at every frame")
        }
        Touch::Open => None,
    })
}

/// The bodies of a part, or why it cannot be slow.
fn bodies(
    network: &Network,
    timeline: &Timeline,
    part: usize,
    every: u32,
) -> Result<Vec<(Body, Slow)>, String> {
    let bodies = find_bodies(network, timeline, part);
    if bodies.is_empty() {
        return Err("no mass in it is held by linear springs or by links in space".to_owned());
    }
    let strikes = timeline.strikes.iter().map(|strike| strike.mat);
    let ergons = timeline.ergons.iter().map(|ergon| ergon.mat);
    let struck: BTreeSet<u32> = strikes.chain(ergons).collect();
    // A session may strike any of it.
    let is_struck = |mat: usize| timeline.is_open || struck.contains(&(mat as u32));
    let slow = |body: Body| {
        let subset = network.subset(&body.mats, &body.guests, &body.links);
        let (rate, part_and_macrostep) = (timeline.rate, (part, every));
        // The exact flow of linear springs does not include gravity.
        let has_weight = subset
            .network
            .mats()
            .weight
            .iter()
            .any(|weight| *weight != 0.0);
        let slow = if has_weight || links_in_space(&subset.network).next().is_some() {
            in_space::slow(rate, part_and_macrostep, &body, subset)?
        } else {
            exact::slow(rate, part_and_macrostep, &body, subset, is_struck)?
        };
        // Where a session plays, no trial decides.
        if timeline.is_open && cost::is_dearer(&slow) {
            return Err(DEARER.to_owned());
        }
        Ok((body, slow))
    };
    bodies.into_iter().map(slow).collect()
}

/// The bodies of a part: sets of masses that its own links join or tie to the ground. Their ports are the masses that
/// anything else touches.
fn find_bodies(network: &Network, timeline: &Timeline, part: usize) -> Vec<Body> {
    let mats = network.mats();
    let n = network.n_mat();
    let is_own = |mat: usize| mats.part[mat] as usize == part;
    let mut is_eligible: Vec<bool> = (0..n).map(|i| is_own(i) && mats.kind[i].moves()).collect();
    let mut is_port = vec![false; n];
    let mut is_inner = vec![false; network.n_lia()];
    for run in network.runs().iter().filter(|run| run.part == part) {
        is_inner[run.first..run.first + run.len].fill(may_be_slow(&run.kind));
    }
    timeline
        .gates
        .iter()
        .for_each(|gate| is_inner[gate.links()].fill(false));
    timeline
        .leads
        .iter()
        .for_each(|lead| is_inner[lead.links()].fill(false));
    for term in network.outputs().iter().flat_map(|output| &output.terms) {
        match *term {
            Term::Force { first, len, .. } => is_inner[first..first + len].fill(false),
            Term::Ground { first, len, .. } => is_eligible[first..first + len].fill(false),
            Term::Position { .. } | Term::Length { .. } => {}
        }
    }
    let mut is_driven = vec![false; n];
    for drive in &timeline.drives {
        is_driven[drive.mat] = true;
        match drive.kind {
            DriveKind::Position => is_eligible[drive.mat] = false,
            DriveKind::Force => is_port[drive.mat] = true,
        }
    }
    timeline.ports().for_each(|(_, key)| is_port[key] = true);
    timeline
        .glides
        .iter()
        .for_each(|glide| is_eligible[glide.mat] = false);
    let masses = network.following_masses().iter();
    masses.for_each(|mass| is_eligible[mass.mat] = false);
    let strikes = timeline.strikes.iter().map(|strike| strike.mat as usize);
    let ergons = timeline.ergons.iter().map(|ergon| ergon.mat as usize);
    let keys = timeline.keys.iter().map(|key| key.struck);
    strikes
        .chain(ergons)
        .chain(keys)
        .for_each(|mat| is_port[mat] = true);

    if timeline.is_open {
        is_port.fill(true);
    }
    let proxied = network.proxies().iter().flat_map(Proxy::masses);
    let guides = network.followed().map(|(_, guide)| guide);
    proxied.chain(guides).for_each(|mat| is_port[mat] = true);
    let is_held = |mat: usize| is_own(mat) && mats.kind[mat].is_held() && !is_driven[mat];
    let mut forest = Forest::new(n);
    for (run, i) in links_in_space(network) {
        let is_free =
            |&(a, b): &(usize, usize)| [a, b].iter().all(|&mat| is_eligible[mat] || is_held(mat));
        is_inner[run.first + i] &= run.pairs(i).all(|pair| is_free(&pair));
        if is_inner[run.first + i] {
            // A link in space measures a distance: all coordinates of an end stay in one body.
            let (a, b) = run.pair(i, 0);
            for (other_a, other_b) in run.pairs(i).skip(1) {
                for (near, other) in [(a, other_a), (b, other_b)] {
                    if is_eligible[near] && is_eligible[other] {
                        forest.join(near, other);
                    }
                }
            }
        }
    }
    for (link, a, b) in ends(network) {
        if is_inner[link] && is_eligible[a] && is_eligible[b] {
            forest.join(a, b);
        }
    }
    let mut bodies: BTreeMap<usize, Body> = BTreeMap::new();
    for mat in (0..n).filter(|&mat| is_eligible[mat]) {
        let body = bodies.entry(forest.root(mat)).or_insert_with(Body::empty);
        body.mats.push(mat as u32);
        if is_port[mat] {
            body.ports.push(mat as u32);
        }
    }
    for (link, a, b) in ends(network) {
        for (near, other) in [(a, b), (b, a)]
            .into_iter()
            .filter(|&(near, _)| is_eligible[near])
        {
            let Some(body) = bodies.get_mut(&forest.root(near)) else {
                continue;
            };
            if is_inner[link] && (is_eligible[other] || is_held(other)) {
                body.links.push(link as u32);
                if is_held(other) {
                    body.guests.push(other as u32);
                }
            } else {
                body.ports.push(near as u32);
            }
        }
    }
    let is_tied = |&mat: &u32| mats.kind[mat as usize] == MatKind::Cel;
    let is_slow = |body: &Body| !body.links.is_empty() || body.mats.iter().any(is_tied);
    bodies
        .into_values()
        .map(Body::tidy)
        .filter(is_slow)
        .collect()
}

/// Whether links of a kind may pull once in many frames: linear springs, and links in space without memory. A gauge is
/// not one of them, as an output reads it at every frame.
fn may_be_slow(kind: &LinkKind) -> bool {
    match kind {
        LinkKind::Ref => true,
        LinkKind::Space(space) => !space.law.yields() && space.law != SpaceLaw::Gauge,
        _ => false,
    }
}

/// Every single link in space: its run, and its index there.
fn links_in_space(network: &Network) -> impl Iterator<Item = (&Run, usize)> {
    let in_space = |run: &&Run| matches!(run.kind, LinkKind::Space(_));
    let runs = network.runs().iter().filter(in_space);
    runs.flat_map(|run| (0..run.len).map(move |i| (run, i)))
}

/// Whether kicks resolve a mode that turns by `turn` between two of them [rad]; false for NaN.
fn is_within(turn: f64) -> bool {
    turn < TURN_MAX
}

/// MATs of a body that move, by their index in the subset.
fn free(body: &Body, subset: &Subset) -> Vec<usize> {
    let mats = body.mats.iter();
    mats.filter_map(|&mat| subset.mat(mat as usize)).collect()
}

/// What follows from the springs of a body.
struct Solution {
    turn: f64,
    kick_every: u32,
    rest: Vec<f64>,
    /// MATs that move, by their index in the subset, and 1/M of each at the rate of the island.
    free: Vec<usize>,
    w: Vec<f64>,
    is_discrete: bool,
}

impl Solution {
    /// The body, or why an output cannot hear it; `springs` makes its springs for its ports and outputs.
    fn slow(
        self,
        rate: Rate,
        (part, macrostep): (usize, u32),
        body: &Body,
        subset: Subset,
        springs: impl FnOnce(&[(usize, usize)], &[Weights]) -> Springs,
    ) -> Result<Slow, String> {
        let Self { free, .. } = self;
        let n = free.len();
        let outputs = output_sums(&subset.network).map_err(|why| why.why().to_owned())?;
        let slot = |mat: usize| free.binary_search(&mat).ok();
        let rows = outputs.rows.into_iter().map(|row| {
            let weights = row
                .into_iter()
                .filter_map(|(mat, weight)| Some((slot(mat)?, weight)));
            weights.collect()
        });
        let rows: Vec<Weights> = rows.collect();
        let ports: Vec<(usize, usize)> = body
            .ports
            .iter()
            .filter_map(|&mat| Some((slot(subset.mat(mat as usize)?)?, mat as usize)))
            .collect();
        let is_port = |weights: usize| ports.iter().any(|port| port.0 == weights);
        let mats = subset.network.mats();
        Ok(Slow {
            part,
            macrostep,
            kick_every: self.kick_every,
            turn: self.turn,
            rest: self.rest,
            x0: free.iter().map(|&i| mats.x0[i]).collect(),
            v0: free.iter().map(|&i| mats.v0[i] * rate.step()).collect(),
            inner: (0..n).filter(|&weights| !is_port(weights)).collect(),
            is_inner: (0..n)
                .map(|weights| f64::from(u8::from(!is_port(weights))))
                .collect(),
            springs: springs(&ports, &rows),
            outputs: subset.outputs.iter().copied().zip(rows).collect(),
            w: self.w,
            is_discrete: self.is_discrete,
            ports,
            network: Arc::new(subset.network),
            free,
        })
    }
}
