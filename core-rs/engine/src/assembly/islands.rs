//! Islands: modules that can move each other, found by union-find over the links. Fixed and imposed
//! points end an island: no force moves them.

use crate::interrupt;
use crate::network::forest::{Forest, joined_pairs, link_ends, link_mats};
use crate::network::{MatKind, Network, Term};
use crate::start::forces;
use crate::timeline::{DriveKind, DriveSource, Timeline};

/// The modules of an island, and the held points that they are tied to.
#[derive(Clone, Debug, Default)]
pub(crate) struct IslandMembers {
    /// Its own MATs, rising   (n_mat)
    pub(crate) mats: Vec<u32>,
    /// Held points of other islands that its links end on, rising.
    pub(crate) foreign_held_mats: Vec<u32>,
    /// Its own links   (n_lia)
    pub(crate) links: Vec<u32>,
    /// An output listens to it.
    pub(crate) is_heard: bool,
    /// Something can set it in motion.
    pub(crate) can_move: bool,
    /// A hand, a path, a force or a glide acts on it, or something in it follows a MAT: not strikes alone.
    pub(crate) is_driven: bool,
}

/// All islands, in the order of their first MATs.
pub(crate) fn islands(network: &Network, timeline: &Timeline) -> Vec<IslandMembers> {
    let mat_count = network.n_mat();
    let is_free = free_mats(network, timeline);
    let mut forest = Forest::new(mat_count);
    for (a, b) in joined_pairs(network) {
        // Two held points that a link joins stay together: the link belongs to their island.
        if is_free[a] == is_free[b] {
            forest.join(a, b);
        }
    }
    // A port moves with its key.
    timeline.delayed_ports().for_each(|(port, key)| forest.join(port, key));
    // A written hand keeps a free copy of its key with all modules of the key's part, so these belong to one island.
    for key in &timeline.keys {
        let key_part = network.mats().part[key.struck_mat];
        let is_free_in_part = |mat: &usize| network.mats().part[*mat] == key_part && is_free[*mat];
        for mat in interrupt::steps(0..mat_count).filter(is_free_in_part) {
            forest.join(key.struck_mat, mat);
        }
    }
    let (can_move, hearing) = (moving_mats(network, timeline), HeardModules::new(network, timeline));
    let mut island_of_root = vec![None; mat_count];
    let mut island_of_mat = Vec::with_capacity(mat_count);
    let mut members: Vec<IslandMembers> = Vec::new();
    for mat in interrupt::steps(0..mat_count) {
        let forest_root = forest.root(mat);
        let island_index = *island_of_root[forest_root].get_or_insert_with(|| {
            members.push(IslandMembers::default());
            members.len() - 1
        });
        island_of_mat.push(island_index);
        let island = &mut members[island_index];
        island.mats.push(mat as u32);
        island.is_heard |= hearing.hears_mat[mat];
        island.can_move |= can_move[mat];
    }
    for (link, mats) in link_mats(network) {
        let [.., last_mat] = mats.as_slice() else { continue };
        let first_free = mats.as_slice().iter().copied().find(|&mat| is_free[mat]);
        let first_free = first_free.unwrap_or(*last_mat);
        let island = &mut members[island_of_mat[first_free]];
        island.links.push(link as u32);
        island.is_heard |= hearing.hears_link[link];
        // A gated force changes even between two points that never move.
        island.can_move |= hearing.hears_link[link] && timeline.gates.iter().any(|gate| gate.links().contains(&link));
        let held_mats = mats.as_slice().iter().filter(|&&mat| !is_free[mat]);
        for &held_mat in held_mats.filter(|_| is_free[first_free]) {
            island.foreign_held_mats.push(held_mat as u32);
            island.can_move |= can_move[held_mat];
            island.is_driven |= can_move[held_mat];
        }
    }
    // Masses that a proxy follows, and fixed points that guide it.
    for proxy in network.proxies() {
        let island = &mut members[island_of_mat[proxy.mat]];
        let guest_mats = proxy.masses().chain(proxy.guide_mats());
        for other in guest_mats.filter(|&mat| !is_free[mat]) {
            island.foreign_held_mats.push(other as u32);
            island.can_move |= can_move[other];
            island.is_driven |= can_move[other];
        }
    }
    // MATs that laws and masses follow.
    for (mat, guide) in network.follower_pairs() {
        let island = &mut members[island_of_mat[mat]];
        island.is_driven = true;
        if !is_free[guide] {
            island.foreign_held_mats.push(guide as u32);
            island.can_move |= can_move[guide];
        }
    }
    let struck_mats = timeline.keys.iter().map(|key| key.struck_mat);
    let glided_mats = timeline.glides.iter().map(|glide| glide.mat);
    for mat in struck_mats.chain(timeline.driven_mats()).chain(glided_mats) {
        members[island_of_mat[mat]].is_driven = true;
    }
    for (link, a, b) in link_ends(network) {
        if timeline.leads.iter().any(|lead| lead.links().contains(&link)) {
            let first_free = if is_free[a] { a } else { b };
            members[island_of_mat[first_free]].is_driven = true;
        }
    }
    for island in &mut members {
        island.foreign_held_mats.sort_unstable();
        island.foreign_held_mats.dedup();
    }
    members
}

/// MATs that a force can move.
fn free_mats(network: &Network, timeline: &Timeline) -> Vec<bool> {
    let mat_kinds = network.mats().kind.iter();
    let mut is_free: Vec<bool> = mat_kinds.map(|&kind| !kind.is_held()).collect();
    for drive in &timeline.drives {
        if drive.kind == DriveKind::Position {
            is_free[drive.mat] = drive.port().is_some();
        }
    }
    is_free
}

/// What outputs hear and hands feel.
struct HeardModules {
    hears_mat: Vec<bool>,
    hears_link: Vec<bool>,
}

impl HeardModules {
    fn new(network: &Network, timeline: &Timeline) -> Self {
        let mut hearing = Self {
            hears_mat: vec![false; network.n_mat()],
            hears_link: vec![false; network.n_lia()],
        };
        for term in network.outputs().iter().flat_map(|output| &output.terms) {
            match *term {
                Term::Position { first, len, .. } | Term::Ground { first, len, .. } => {
                    hearing.hears_mat[first..first + len].fill(true);
                }
                Term::Force { first, len, .. } | Term::Length { first, len, .. } => {
                    hearing.hears_link[first..first + len].fill(true);
                }
            }
        }
        // What a hand feels counts as heard.
        let mut is_in_hand = vec![false; network.n_mat()];
        let hand_drives = timeline.drives.iter().filter(|drive| drive.hand().is_some());
        hand_drives.for_each(|hand| is_in_hand[hand.mat] = true);
        for (link, a, b) in link_ends(network) {
            hearing.hears_link[link] |= is_in_hand[a] || is_in_hand[b];
        }
        hearing
    }
}

/// MATs that something sets in motion: an event, a hand, or a motion or force at the beginning.
fn moving_mats(network: &Network, timeline: &Timeline) -> Vec<bool> {
    let mats = network.mats();
    let mut is_moved: Vec<bool> = (0..network.n_mat())
        .map(|i| {
            let is_displaced = mats.kind[i] == MatKind::Cel && mats.x0[i] != mats.rest[i];
            // A session may move whatever can move.
            mats.kind[i].moves() && (timeline.is_open || mats.v0[i] != 0.0 || is_displaced)
        })
        .collect();
    for strike in &timeline.strikes {
        is_moved[strike.mat as usize] = true;
    }
    for ergon in &timeline.ergons {
        is_moved[ergon.mat as usize] = true;
    }
    for gesture in &timeline.gestures {
        is_moved[timeline.keys[gesture.key].struck_mat] = true;
    }
    for drive in &timeline.drives {
        // A driven point that stays where it starts moves nothing, except by the forces of its links.
        let is_still = matches!(
            (drive.kind, &drive.source),
            (DriveKind::Position, DriveSource::Constant(x)) if *x == mats.x0[drive.mat]
        );
        is_moved[drive.mat] |= !is_still;
    }
    // Forces at t = 0, as if all couplings were open.
    let open_timeline = Timeline::new(timeline.rate);
    let forces = forces(network, &open_timeline, &mats.x0, &[], &|_| true);
    for ((is_moved, force), kind) in is_moved.iter_mut().zip(forces).zip(&mats.kind) {
        *is_moved |= force != 0.0 && kind.moves();
    }
    is_moved
}
