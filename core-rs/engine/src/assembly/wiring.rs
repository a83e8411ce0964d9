//! The bodies of an island: MATs joined by links that may lie inside a body, and their ports, where all other links
//! end.

use std::collections::BTreeMap;

use crate::assembly::constants::{MASSES_PER_PORT, MODAL_MASSES_MIN, PORTS_ALWAYS_ALLOWED};
use crate::interrupt;
use crate::network::forest::{Forest, link_ends};
use crate::network::{Contact, LinkKind, Network, Proxy, Run, Term};
use crate::timeline::Timeline;

/// A set of MATs that inner links join, and the ports where others end.
#[derive(Clone)]
pub(crate) struct WiredBody {
    pub(crate) mats: Vec<u32>,
    pub(crate) foreign_held_mats: Vec<u32>,
    pub(crate) links: Vec<u32>,
    pub(crate) ports: Vec<u32>,
    /// Whether a contact, a law or friction ends on one of its ports.
    touches_contact: bool,
}

/// Which links may lie inside a body, and which MATs.
pub(crate) struct BodyLinks {
    is_eligible: Vec<bool>,
    /// Springs that are not led; laws, and springs or laws that are led.
    is_spring: Vec<bool>,
    is_law: Vec<bool>,
    /// Contacts, laws and friction that a plan may follow between frames.
    may_be_followed: Vec<bool>,
    is_driven: Vec<bool>,
}

/// The bodies that are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum WantedBodies {
    /// All that have links, with laws inside.
    All,
    /// Meshes with laws inside, if large enough and with few enough ports.
    Meshes,
    /// Linear bodies, likewise.
    Linear,
    /// Linear bodies, and of these also small ones that contacts, laws or friction touch. Between frames such a link
    /// needs the motion of its ends then, which steps do not have: impulses between the steps of a mass that springs
    /// hold make energy, without bound.
    Touched,
}

impl BodyLinks {
    /// Marks MATs as belonging to a body already.
    pub(crate) fn exclude_mats(&mut self, mats: &[u32]) {
        mats.iter().for_each(|&mat| self.is_eligible[mat as usize] = false);
    }

    pub(crate) fn new(network: &Network, timeline: &Timeline) -> Self {
        let mats = network.mats();
        let mat_count = network.n_mat();
        let mut is_driven = vec![false; mat_count];
        timeline.driven_mats().for_each(|mat| is_driven[mat] = true);
        let mut part_has_key = vec![false; network.parts().len()];
        for key in &timeline.keys {
            part_has_key[mats.part[key.struck_mat] as usize] = true;
        }
        let mut is_eligible: Vec<bool> = (0..mat_count)
            .map(|i| {
                let is_free_mat = mats.kind[i].moves() && mats.weight_of(i) == 0.0;
                is_free_mat && !is_driven[i] && !part_has_key[mats.part[i] as usize]
            })
            .collect();
        timeline
            .ergons
            .iter()
            .for_each(|ergon| is_eligible[ergon.mat as usize] = false);
        timeline.glides.iter().for_each(|glide| is_eligible[glide.mat] = false);
        let following_masses = network.following_masses().iter();
        following_masses.for_each(|mass| is_eligible[mass.mat] = false);
        let (mut is_spring, mut is_law) = (vec![false; network.n_lia()], vec![false; network.n_lia()]);
        let mut is_followed = vec![false; network.n_lia()];
        for run in network.runs() {
            let run_links = run.first..run.first + run.len;
            is_spring[run_links.clone()].fill(matches!(run.kind, LinkKind::Ref));
            is_law[run_links.clone()].fill(matches!(run.kind, LinkKind::Lnl(_)));
            is_followed[run_links].fill(match run.kind {
                LinkKind::But(but) => but.contact != Contact::Magic,
                LinkKind::Lnl(_) | LinkKind::Bristle(_) | LinkKind::Dry(_) => true,
                _ => false,
            });
        }
        // A led link has no fixed modes; a method for meshes can step it.
        for lead in &timeline.leads {
            for link in lead.links() {
                (is_spring[link], is_law[link]) = (false, is_spring[link] || is_law[link]);
            }
        }
        let mut mark_outer = |link: usize| (is_spring[link], is_law[link]) = (false, false);
        let gated_links = timeline.gates.iter().flat_map(|gate| gate.links());
        gated_links.for_each(&mut mark_outer);
        // The force of an undamped spring is a sum of positions.
        let is_position_sum = |link: usize| {
            let mut leads = timeline.leads.iter();
            let is_led_link = leads.any(|lead| lead.links().contains(&link));
            !is_led_link && network.run_of(link).is_some_and(Run::is_undamped_spring)
        };
        for term in network.outputs().iter().flat_map(|output| &output.terms) {
            match *term {
                Term::Force { first, len, .. } => {
                    let force_links = (first..first + len).filter(|&link| !is_position_sum(link));
                    force_links.for_each(&mut mark_outer);
                }
                Term::Ground { first, len, .. } => is_eligible[first..first + len].fill(false),
                Term::Position { .. } | Term::Length { .. } => {}
            }
        }
        Self {
            is_eligible,
            is_spring,
            is_law,
            may_be_followed: is_followed,
            is_driven,
        }
    }

    /// Sets of MATs that inner links join.
    pub(crate) fn bodies(&self, network: &Network, wanted: WantedBodies) -> Vec<WiredBody> {
        let with_laws = matches!(wanted, WantedBodies::All | WantedBodies::Meshes);
        let is_inner = |link: usize| self.is_spring[link] || (with_laws && self.is_law[link]);
        let mut mat_forest = Forest::new(network.n_mat());
        for (link, a, b) in link_ends(network) {
            if is_inner(link) && self.is_eligible[a] && self.is_eligible[b] {
                mat_forest.join(a, b);
            }
        }
        let mut joined_bodies: BTreeMap<usize, WiredBody> = BTreeMap::new();
        for mat in (0..network.n_mat()).filter(|&mat| self.is_eligible[mat]) {
            let body = joined_bodies
                .entry(mat_forest.root(mat))
                .or_insert_with(WiredBody::empty);
            body.mats.push(mat as u32);
        }
        for (link, a, b) in link_ends(network) {
            for (near_end, far_end) in [(a, b), (b, a)] {
                if !self.is_eligible[near_end] {
                    continue;
                }
                let Some(body) = joined_bodies.get_mut(&mat_forest.root(near_end)) else {
                    continue;
                };
                let is_held_end = network.mats().kind[far_end].is_held() && !self.is_driven[far_end];
                if is_inner(link) && (self.is_eligible[far_end] || is_held_end) {
                    // A link between two MATs of the body is met from both ends, but noted once.
                    if near_end == a || !self.is_eligible[far_end] {
                        body.links.push(link as u32);
                    }
                    if is_held_end {
                        body.foreign_held_mats.push(far_end as u32);
                    }
                } else {
                    body.ports.push(near_end as u32);
                    body.touches_contact |= self.may_be_followed[link];
                }
            }
        }
        let proxied = network.proxies().iter().flat_map(Proxy::masses);
        for mat in proxied.chain(network.follower_pairs().map(|(_, guide)| guide)) {
            if self.is_eligible[mat]
                && let Some(body) = joined_bodies.get_mut(&mat_forest.root(mat))
            {
                body.ports.push(mat as u32);
            }
        }
        let is_worth_cut = |body: &WiredBody| {
            let is_large =
                !body.is_small() && body.ports.len() <= PORTS_ALWAYS_ALLOWED.max(body.mats.len() / MASSES_PER_PORT);
            let takes_small = match wanted {
                WantedBodies::All => true,
                WantedBodies::Touched => body.touches_contact,
                WantedBodies::Meshes | WantedBodies::Linear => false,
            };
            is_large || (takes_small && !body.links.is_empty())
        };
        joined_bodies
            .into_values()
            .map(WiredBody::sorted)
            .filter(is_worth_cut)
            .collect()
    }
}

impl WiredBody {
    /// The body without the single links that tie it to fixed points: they then end at ports. `None` if it has none, or
    /// more than `ties_max`.
    pub(crate) fn without_ties(&self, network: &Network, ties_max: usize) -> Option<Self> {
        let is_single = |link: usize| {
            let mut runs = interrupt::polled_items(network.runs());
            runs.any(|run| run.first == link && run.len == 1)
        };
        let is_guest = |mat: usize| self.foreign_held_mats.binary_search(&(mat as u32)).is_ok();
        let is_body_link = |link: usize| self.links.binary_search(&(link as u32)).is_ok();
        let (mut freed_body, mut tie_links) = (self.clone(), Vec::new());
        freed_body.foreign_held_mats.clear();
        for (link, a, b) in link_ends(network).filter(|&(link, ..)| is_body_link(link)) {
            let guest_pair = [(a, b), (b, a)].into_iter().find(|&(end, _)| is_guest(end));
            match guest_pair {
                Some((_, port)) if is_single(link) => {
                    tie_links.push(link as u32);
                    freed_body.ports.push(port as u32);
                }
                Some((guest, _)) => freed_body.foreign_held_mats.push(guest as u32),
                None => {}
            }
        }
        freed_body.links.retain(|link| {
            interrupt::poll();
            !tie_links.contains(link)
        });
        (1..=ties_max).contains(&tie_links.len()).then(|| freed_body.sorted())
    }

    /// Whether a contact, a law or friction ends on one of its ports.
    pub(crate) fn touches_contact(&self) -> bool {
        self.touches_contact
    }

    /// Whether it has so few masses that it is a body only for what touches it.
    pub(crate) fn is_small(&self) -> bool {
        self.mats.len() < MODAL_MASSES_MIN
    }

    /// Sorts the lists and removes duplicates.
    pub(crate) fn sorted(mut self) -> Self {
        for list in [&mut self.foreign_held_mats, &mut self.links, &mut self.ports] {
            list.sort_unstable();
            list.dedup();
        }
        self
    }

    pub(crate) fn empty() -> Self {
        Self {
            mats: Vec::new(),
            foreign_held_mats: Vec::new(),
            links: Vec::new(),
            ports: Vec::new(),
            touches_contact: false,
        }
    }
}
