//! Slow parts of an island: which of their masses are computed once every R frames, and how their springs pull.

mod exact;
pub(crate) mod growth;
mod in_space;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::assembly::body::position_sums_only;
use crate::assembly::constants::KICK_TURN_RADIANS_MAX;
use crate::assembly::cost;
use crate::assembly::wiring::WiredBody;
use crate::gesture::script::Touch;
use crate::island::slow::{Slow, SpringMethod, Weights};
use crate::network::forest::{Forest, link_ends};
use crate::network::{LinkKind, MatKind, Network, Proxy, Run, SpaceLaw, Subset, Term};
use crate::timeline::{DriveKind, Timeline};
use crate::units::Rate;

/// Why a body with many ports keeps the audio rate in a session, where each of its masses is a port.
const MANY_PORTS_REASON: &str = "computing it once in several frames would cost more than at every frame: \
                      in a session each of its masses may be struck";

/// A part that asks to be slow but cannot be: its name, and why.
pub(crate) type RefusedSlowPart = (String, String);

/// The slow bodies of a network, and the parts that cannot be slow.
#[derive(Default)]
pub(crate) struct SlowBodies {
    pub(crate) bodies: Vec<(WiredBody, Slow)>,
    pub(crate) refused_parts: Vec<RefusedSlowPart>,
}

/// The slow bodies of all parts that have a macrostep, and the parts that cannot be slow.
pub(crate) fn slow_bodies(network: &Network, timeline: &Timeline) -> SlowBodies {
    let mut slow_bodies = SlowBodies::default();
    for (part, slow_part) in network.parts().iter().enumerate() {
        let is_in_network = || network.mats().part.contains(&(part as u32));
        let Some(macrostep) = slow_part.macrostep.filter(|_| is_in_network()) else {
            continue;
        };
        match needs_every_frame(network, timeline, part) {
            Some(refusal_reason) => slow_bodies
                .refused_parts
                .push((slow_part.name.clone(), refusal_reason.to_owned())),
            None => match slow_bodies_of_part(network, timeline, part, macrostep) {
                Ok(bodies) => slow_bodies.bodies.extend(bodies),
                Err(refusal_reason) => slow_bodies.refused_parts.push((slow_part.name.clone(), refusal_reason)),
            },
        }
    }
    slow_bodies
}

/// Why a gesture needs its key at every frame, if it does.
fn needs_every_frame(network: &Network, timeline: &Timeline, part: usize) -> Option<&'static str> {
    let part_of_key = |key: usize| network.mats().part[timeline.keys[key].struck_mat] as usize;
    let mut gestures = timeline
        .gestures
        .iter()
        .filter(|gesture| part_of_key(gesture.key) == part);
    gestures.find_map(|gesture| match gesture.manner.touch {
        Touch::Tracked => Some("a gesture with `touch: tracked` moves it at every frame"),
        Touch::Open if gesture.manner.force_max.is_some() => Some("its force limit is checked at every frame"),
        Touch::Open => None,
    })
}

/// The bodies of a part, or why it cannot be slow.
fn slow_bodies_of_part(
    network: &Network,
    timeline: &Timeline,
    part: usize,
    macrostep: u32,
) -> Result<Vec<(WiredBody, Slow)>, String> {
    let part_bodies = find_bodies(network, timeline, part);
    if part_bodies.is_empty() {
        return Err("no mass in it is held by linear springs or by links in space".to_owned());
    }
    let strikes = timeline.strikes.iter().map(|strike| strike.mat);
    let ergon_mats = timeline.ergons.iter().map(|ergon| ergon.mat);
    let struck_mats: BTreeSet<u32> = strikes.chain(ergon_mats).collect();
    // A session may strike any of it.
    let is_struck = |mat: usize| timeline.is_open || struck_mats.contains(&(mat as u32));
    let slow_body = |body: WiredBody| {
        let body_subset = network.subset(&body.mats, &body.foreign_held_mats, &body.links);
        let (rate, part_and_macrostep) = (timeline.rate, (part, macrostep));
        // The exact flow of linear springs does not include gravity.
        let has_weight = body_subset.network.mats().weight.iter().any(|weight| *weight != 0.0);
        let slow_body = if has_weight || links_in_space(&body_subset.network).next().is_some() {
            in_space::slow_body_in_space(rate, part_and_macrostep, &body, body_subset)?
        } else {
            exact::slow_body_of_springs(rate, part_and_macrostep, &body, body_subset, is_struck)?
        };
        // Where a session plays, no trial decides.
        if timeline.is_open && cost::costs_more_than_stepping(&slow_body) {
            return Err(MANY_PORTS_REASON.to_owned());
        }
        Ok((body, slow_body))
    };
    part_bodies.into_iter().map(slow_body).collect()
}

/// The bodies of a part: sets of masses that its own links join or tie to the ground. Their ports are the masses that
/// anything else touches.
fn find_bodies(network: &Network, timeline: &Timeline, part: usize) -> Vec<WiredBody> {
    let mats = network.mats();
    let mat_count = network.n_mat();
    let is_in_part = |mat: usize| mats.part[mat] as usize == part;
    let mut is_eligible: Vec<bool> = (0..mat_count).map(|i| is_in_part(i) && mats.kind[i].moves()).collect();
    let mut is_port = vec![false; mat_count];
    let mut is_link_inside = vec![false; network.n_lia()];
    for run in network.runs().iter().filter(|run| run.part == part) {
        is_link_inside[run.first..run.first + run.len].fill(may_be_slow(&run.kind));
    }
    for gate in &timeline.gates {
        is_link_inside[gate.links()].fill(false);
    }
    for lead in &timeline.leads {
        is_link_inside[lead.links()].fill(false);
    }
    for term in network.outputs().iter().flat_map(|output| &output.terms) {
        match *term {
            Term::Force { first, len, .. } => is_link_inside[first..first + len].fill(false),
            Term::Ground { first, len, .. } => is_eligible[first..first + len].fill(false),
            Term::Position { .. } | Term::Length { .. } => {}
        }
    }
    let mut is_driven = vec![false; mat_count];
    for drive in &timeline.drives {
        is_driven[drive.mat] = true;
        match drive.kind {
            DriveKind::Position => is_eligible[drive.mat] = false,
            DriveKind::Force => is_port[drive.mat] = true,
        }
    }
    timeline.delayed_ports().for_each(|(_, key)| is_port[key] = true);
    timeline.glides.iter().for_each(|glide| is_eligible[glide.mat] = false);
    let following_masses = network.following_masses().iter();
    following_masses.for_each(|mass| is_eligible[mass.mat] = false);
    let strikes = timeline.strikes.iter().map(|strike| strike.mat as usize);
    let ergon_mats = timeline.ergons.iter().map(|ergon| ergon.mat as usize);
    let struck_mats = timeline.keys.iter().map(|key| key.struck_mat);
    for mat in strikes.chain(ergon_mats).chain(struck_mats) {
        is_port[mat] = true;
    }
    if timeline.is_open {
        is_port.fill(true);
    }
    let proxy_masses = network.proxies().iter().flat_map(Proxy::masses);
    let guide_mats = network.follower_pairs().map(|(_, guide)| guide);
    proxy_masses.chain(guide_mats).for_each(|mat| is_port[mat] = true);
    let is_held_mat = |mat: usize| is_in_part(mat) && mats.kind[mat].is_held() && !is_driven[mat];
    let mut mat_forest = Forest::new(mat_count);
    for (run, i) in links_in_space(network) {
        let is_inner_pair = |&(first_end, second_end): &(usize, usize)| {
            [first_end, second_end]
                .iter()
                .all(|&mat| is_eligible[mat] || is_held_mat(mat))
        };
        is_link_inside[run.first + i] &= run.pairs(i).all(|pair| is_inner_pair(&pair));
        if is_link_inside[run.first + i] {
            // A link in space measures a distance: all coordinates of an end stay in one body.
            let (first_end, second_end) = run.pair(i, 0);
            for (other_a, other_b) in run.pairs(i).skip(1) {
                for (near, other) in [(first_end, other_a), (second_end, other_b)] {
                    if is_eligible[near] && is_eligible[other] {
                        mat_forest.join(near, other);
                    }
                }
            }
        }
    }
    for (link, first_end, second_end) in link_ends(network) {
        if is_link_inside[link] && is_eligible[first_end] && is_eligible[second_end] {
            mat_forest.join(first_end, second_end);
        }
    }
    let mut part_bodies: BTreeMap<usize, WiredBody> = BTreeMap::new();
    for mat in (0..mat_count).filter(|&mat| is_eligible[mat]) {
        let body = part_bodies.entry(mat_forest.root(mat)).or_insert_with(WiredBody::empty);
        body.mats.push(mat as u32);
        if is_port[mat] {
            body.ports.push(mat as u32);
        }
    }
    for (link, first_end, second_end) in link_ends(network) {
        for (near, other) in [(first_end, second_end), (second_end, first_end)]
            .into_iter()
            .filter(|&(near, _)| is_eligible[near])
        {
            let Some(body) = part_bodies.get_mut(&mat_forest.root(near)) else {
                continue;
            };
            if is_link_inside[link] && (is_eligible[other] || is_held_mat(other)) {
                body.links.push(link as u32);
                if is_held_mat(other) {
                    body.foreign_held_mats.push(other as u32);
                }
            } else {
                body.ports.push(near as u32);
            }
        }
    }
    let is_tied_cell = |&mat: &u32| mats.kind[mat as usize] == MatKind::Cel;
    let has_springs = |body: &WiredBody| !body.links.is_empty() || body.mats.iter().any(is_tied_cell);
    part_bodies
        .into_values()
        .map(WiredBody::sorted)
        .filter(has_springs)
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
    let space_runs = network.runs().iter().filter(in_space);
    space_runs.flat_map(|run| (0..run.len).map(move |i| (run, i)))
}

/// Whether kicks resolve a mode that turns by `phase` between two of them [rad]; false for NaN.
fn resolves_phase(phase: f64) -> bool {
    phase < KICK_TURN_RADIANS_MAX
}

/// MATs of a body that move, by their index in the subset.
fn moving_mats(body: &WiredBody, subset: &Subset) -> Vec<usize> {
    let body_mats = body.mats.iter();
    body_mats.filter_map(|&mat| subset.mat(mat as usize)).collect()
}

/// What a method of slow bodies has computed.
struct Solution {
    /// Phase of the fastest mode from kick to kick [rad].
    kick_phase: f64,
    /// Frames from one kick to the next.
    kick_interval: u32,
    /// Positions at which linear springs balance [m]   (n)
    rest_positions: Vec<f64>,
    /// MATs that move, by their index in the subset, and 1/M of each at the rate of the island.
    moving_mats: Vec<usize>,
    inverse_masses: Vec<f64>,
    is_discrete: bool,
}

impl Solution {
    /// The body, or why an output cannot hear it; `springs` makes its springs for its ports and outputs.
    fn into_slow_body(
        self,
        rate: Rate,
        (part, macrostep): (usize, u32),
        body: &WiredBody,
        subset: Subset,
        springs: impl FnOnce(&[(usize, usize)], &[Weights]) -> SpringMethod,
    ) -> Result<Slow, String> {
        let Self {
            moving_mats: free_mats, ..
        } = self;
        let free_count = free_mats.len();
        let outputs = position_sums_only(&subset.network).map_err(|no_modes| no_modes.as_str().to_owned())?;
        let slot_of_mat = |mat: usize| free_mats.binary_search(&mat).ok();
        let output_rows = outputs.position_rows.into_iter().map(|row| {
            let weights = row
                .into_iter()
                .filter_map(|(mat, weight)| Some((slot_of_mat(mat)?, weight)));
            weights.collect()
        });
        let output_rows: Vec<Weights> = output_rows.collect();
        let ports: Vec<(usize, usize)> = body
            .ports
            .iter()
            .filter_map(|&mat| Some((slot_of_mat(subset.mat(mat as usize)?)?, mat as usize)))
            .collect();
        let is_port_slot = |slot: usize| ports.iter().any(|port| port.0 == slot);
        let mats = subset.network.mats();
        Ok(Slow {
            part,
            macrostep,
            kick_interval: self.kick_interval,
            kick_phase: self.kick_phase,
            rest_positions: self.rest_positions,
            x0: free_mats.iter().map(|&i| mats.x0[i]).collect(),
            v0: free_mats.iter().map(|&i| mats.v0[i] * rate.step()).collect(),
            inner_mats: (0..free_count).filter(|&slot| !is_port_slot(slot)).collect(),
            inner_mask: (0..free_count)
                .map(|weights| f64::from(u8::from(!is_port_slot(weights))))
                .collect(),
            springs: springs(&ports, &output_rows),
            outputs: subset.outputs.iter().copied().zip(output_rows).collect(),
            w: self.inverse_masses,
            is_discrete: self.is_discrete,
            ports,
            network: Arc::new(subset.network),
            free_mats,
        })
    }
}
