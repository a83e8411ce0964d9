//! Islands: modules that can move each other, found by union-find over the links. Fixed and imposed
//! points end an island: no force moves them.

use crate::interrupt;
use crate::network::forest::{Forest, ends, joined, links};
use crate::network::{MatKind, Network, Term};
use crate::start::forces;
use crate::timeline::{DriveKind, Source, Timeline};

/// The modules of an island, and the held points that they are tied to.
#[derive(Clone, Debug, Default)]
pub(in crate::plan) struct IslandMembers {
    /// Its own MATs, rising   (n_mat)
    pub(in crate::plan) mats: Vec<u32>,
    /// Held points of other islands that its links end on, rising.
    pub(in crate::plan) guests: Vec<u32>,
    /// Its own links   (n_lia)
    pub(in crate::plan) links: Vec<u32>,
    /// An output listens to it.
    pub(in crate::plan) is_heard: bool,
    /// Something can set it in motion.
    pub(in crate::plan) is_moved: bool,
    /// A hand, a path, a force or a glide acts on it, or something in it follows a MAT: not strikes alone.
    pub(in crate::plan) is_handled: bool,
}

/// All islands, in the order of their first MATs.
pub(in crate::plan) fn islands(network: &Network, timeline: &Timeline) -> Vec<IslandMembers> {
    let n = network.n_mat();
    let is_free = free(network, timeline);
    let mut forest = Forest::new(n);
    for (a, b) in joined(network) {
        // Two held points that a link joins stay together: the link belongs to their island.
        if is_free[a] == is_free[b] {
            forest.join(a, b);
        }
    }
    // A port moves with its key.
    timeline
        .ports()
        .for_each(|(port, key)| forest.join(port, key));
    // A written hand keeps a free copy of its key with all modules of the key's part, so these belong to one island.
    for key in &timeline.keys {
        let part = network.mats().part[key.struck];
        let is_ours = |mat: &usize| network.mats().part[*mat] == part && is_free[*mat];
        for mat in interrupt::steps(0..n).filter(is_ours) {
            forest.join(key.struck, mat);
        }
    }
    let (moved, listened) = (
        moved(network, timeline),
        ListenedMats::new(network, timeline),
    );
    let mut index = vec![u32::MAX; n];
    let mut members: Vec<IslandMembers> = Vec::new();
    for mat in interrupt::steps(0..n) {
        let root = forest.root(mat);
        if index[root] == u32::MAX {
            index[root] = members.len() as u32;
            members.push(IslandMembers::default());
        }
        let island = &mut members[index[root] as usize];
        island.mats.push(mat as u32);
        island.is_heard |= listened.mats[mat];
        island.is_moved |= moved[mat];
    }
    for (link, mats) in links(network) {
        let [.., last] = mats.all() else { continue };
        let first_free = mats.all().iter().copied().find(|&mat| is_free[mat]);
        let first_free = first_free.unwrap_or(*last);
        let island = &mut members[index[forest.root(first_free)] as usize];
        island.links.push(link as u32);
        island.is_heard |= listened.links[link];
        // A gated force changes even between two points that never move.
        island.is_moved |= listened.links[link]
            && timeline
                .gates
                .iter()
                .any(|gate| gate.links().contains(&link));
        let held = mats.all().iter().filter(|&&mat| !is_free[mat]);
        for &other in held.filter(|_| is_free[first_free]) {
            island.guests.push(other as u32);
            island.is_moved |= moved[other];
            island.is_handled |= moved[other];
        }
    }
    // Masses that a proxy follows, and fixed points that guide it.
    for proxy in network.proxies() {
        let island = &mut members[index[forest.root(proxy.mat)] as usize];
        let others = proxy.masses().chain(proxy.guides());
        for other in others.filter(|&mat| !is_free[mat]) {
            island.guests.push(other as u32);
            island.is_moved |= moved[other];
            island.is_handled |= moved[other];
        }
    }
    // MATs that laws and masses follow.
    for (mat, guide) in network.followed() {
        let island = &mut members[index[forest.root(mat)] as usize];
        island.is_handled = true;
        if !is_free[guide] {
            island.guests.push(guide as u32);
            island.is_moved |= moved[guide];
        }
    }
    let keys = timeline.keys.iter().map(|key| key.struck);
    let glides = timeline.glides.iter().map(|glide| glide.mat);
    for mat in keys.chain(timeline.driven()).chain(glides) {
        members[index[forest.root(mat)] as usize].is_handled = true;
    }
    for (link, a, b) in ends(network) {
        if timeline
            .leads
            .iter()
            .any(|lead| lead.links().contains(&link))
        {
            let first_free = if is_free[a] { a } else { b };
            members[index[forest.root(first_free)] as usize].is_handled = true;
        }
    }
    for island in &mut members {
        island.guests.sort_unstable();
        island.guests.dedup();
    }
    members
}

/// MATs that a force can move.
fn free(network: &Network, timeline: &Timeline) -> Vec<bool> {
    let kinds = network.mats().kind.iter();
    let mut is_free: Vec<bool> = kinds.map(|&kind| !kind.is_held()).collect();
    for drive in &timeline.drives {
        if drive.kind == DriveKind::Position {
            is_free[drive.mat] = drive.port().is_some();
        }
    }
    is_free
}

/// What outputs hear and hands feel.
struct ListenedMats {
    mats: Vec<bool>,
    links: Vec<bool>,
}

impl ListenedMats {
    fn new(network: &Network, timeline: &Timeline) -> Self {
        let mut listened = Self {
            mats: vec![false; network.n_mat()],
            links: vec![false; network.n_lia()],
        };
        for term in network.outputs().iter().flat_map(|output| &output.terms) {
            match *term {
                Term::Position { first, len, .. } | Term::Ground { first, len, .. } => {
                    listened.mats[first..first + len].fill(true);
                }
                Term::Force { first, len, .. } | Term::Length { first, len, .. } => {
                    listened.links[first..first + len].fill(true);
                }
            }
        }
        // What a hand feels counts as heard.
        let mut is_held = vec![false; network.n_mat()];
        let hands = timeline
            .drives
            .iter()
            .filter(|drive| drive.hand().is_some());
        hands.for_each(|hand| is_held[hand.mat] = true);
        for (link, a, b) in ends(network) {
            listened.links[link] |= is_held[a] || is_held[b];
        }
        listened
    }
}

/// MATs that something sets in motion: an event, a hand, or a motion or force at the beginning.
fn moved(network: &Network, timeline: &Timeline) -> Vec<bool> {
    let mats = network.mats();
    let mut moved: Vec<bool> = (0..network.n_mat())
        .map(|i| {
            let is_bent = mats.kind[i] == MatKind::Cel && mats.x0[i] != mats.rest[i];
            // A session may move whatever can move.
            mats.kind[i].moves() && (timeline.is_open || mats.v0[i] != 0.0 || is_bent)
        })
        .collect();
    for strike in &timeline.strikes {
        moved[strike.mat as usize] = true;
    }
    for ergon in &timeline.ergons {
        moved[ergon.mat as usize] = true;
    }
    for gesture in &timeline.gestures {
        moved[timeline.keys[gesture.key].struck] = true;
    }
    for drive in &timeline.drives {
        // A driven point that stays where it starts moves nothing, except by the forces of its links.
        let is_still = matches!(
            (drive.kind, &drive.source),
            (DriveKind::Position, Source::Constant(x)) if *x == mats.x0[drive.mat]
        );
        moved[drive.mat] |= !is_still;
    }
    // Forces at t = 0, as if all couplings were open.
    let open = Timeline::new(timeline.rate);
    let forces = forces(network, &open, &mats.x0, &[], &|_| true);
    for ((moved, force), kind) in moved.iter_mut().zip(forces).zip(&mats.kind) {
        *moved |= force != 0.0 && kind.moves();
    }
    moved
}
