//! The bodies of an island: MATs joined by links that may lie inside a body, and their ports, where all other links
//! end.

use std::collections::BTreeMap;

use crate::interrupt;
use crate::network::forest::{Forest, ends};
use crate::network::{Contact, LinkKind, Network, Proxy, Run, Term};
use crate::plan::constants::{MASSES_A_PORT, MODAL_MASSES_MIN, PORTS_ANY};
use crate::timeline::Timeline;

/// A set of MATs that inner links join, and the ports where others end.
#[derive(Clone)]
pub(in crate::plan) struct Body {
    pub(in crate::plan) mats: Vec<u32>,
    pub(in crate::plan) guests: Vec<u32>,
    pub(in crate::plan) links: Vec<u32>,
    pub(in crate::plan) ports: Vec<u32>,
    /// Whether a contact, a law or friction ends on one of its ports.
    is_touched: bool,
}

/// Which links may lie inside a body, and which MATs.
pub(in crate::plan) struct Wiring {
    is_eligible: Vec<bool>,
    /// Springs that are not led; laws, and springs or laws that are led.
    is_spring: Vec<bool>,
    is_law: Vec<bool>,
    /// Contacts, laws and friction that a plan may follow between frames.
    is_followed: Vec<bool>,
    is_driven: Vec<bool>,
}

/// The bodies that are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::plan) enum Wanted {
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

impl Wiring {
    /// Marks MATs as belonging to a body already.
    pub(in crate::plan) fn take(&mut self, mats: &[u32]) {
        mats.iter()
            .for_each(|&mat| self.is_eligible[mat as usize] = false);
    }

    pub(in crate::plan) fn new(network: &Network, timeline: &Timeline) -> Self {
        let mats = network.mats();
        let n = network.n_mat();
        let mut is_driven = vec![false; n];
        timeline.driven().for_each(|mat| is_driven[mat] = true);
        let mut has_key = vec![false; network.parts().len()];
        for key in &timeline.keys {
            has_key[mats.part[key.struck] as usize] = true;
        }
        let mut is_eligible: Vec<bool> = (0..n)
            .map(|i| {
                let is_free = mats.kind[i].moves() && mats.weight_of(i) == 0.0;
                is_free && !is_driven[i] && !has_key[mats.part[i] as usize]
            })
            .collect();
        timeline
            .ergons
            .iter()
            .for_each(|ergon| is_eligible[ergon.mat as usize] = false);
        timeline
            .glides
            .iter()
            .for_each(|glide| is_eligible[glide.mat] = false);
        let masses = network.following_masses().iter();
        masses.for_each(|mass| is_eligible[mass.mat] = false);
        let (mut is_spring, mut is_law) =
            (vec![false; network.n_lia()], vec![false; network.n_lia()]);
        let mut is_followed = vec![false; network.n_lia()];
        for run in network.runs() {
            let links = run.first..run.first + run.len;
            is_spring[links.clone()].fill(matches!(run.kind, LinkKind::Ref));
            is_law[links.clone()].fill(matches!(run.kind, LinkKind::Lnl(_)));
            is_followed[links].fill(match run.kind {
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
        let mut outer = |link: usize| (is_spring[link], is_law[link]) = (false, false);
        let gated = timeline.gates.iter().flat_map(|gate| gate.links());
        gated.for_each(&mut outer);
        // The force of an undamped spring is a sum of positions.
        let is_sum = |link: usize| {
            let mut leads = timeline.leads.iter();
            let is_led = leads.any(|lead| lead.links().contains(&link));
            !is_led && network.run_of(link).is_some_and(Run::is_undamped_spring)
        };
        for term in network.outputs().iter().flat_map(|output| &output.terms) {
            match *term {
                Term::Force { first, len, .. } => {
                    let others = (first..first + len).filter(|&link| !is_sum(link));
                    others.for_each(&mut outer);
                }
                Term::Ground { first, len, .. } => is_eligible[first..first + len].fill(false),
                Term::Position { .. } | Term::Length { .. } => {}
            }
        }
        Self {
            is_eligible,
            is_spring,
            is_law,
            is_followed,
            is_driven,
        }
    }

    /// Sets of MATs that inner links join.
    pub(in crate::plan) fn bodies(&self, network: &Network, wanted: Wanted) -> Vec<Body> {
        let with_laws = matches!(wanted, Wanted::All | Wanted::Meshes);
        let is_inner = |link: usize| self.is_spring[link] || (with_laws && self.is_law[link]);
        let mut forest = Forest::new(network.n_mat());
        for (link, a, b) in ends(network) {
            if is_inner(link) && self.is_eligible[a] && self.is_eligible[b] {
                forest.join(a, b);
            }
        }
        let mut bodies: BTreeMap<usize, Body> = BTreeMap::new();
        for mat in (0..network.n_mat()).filter(|&mat| self.is_eligible[mat]) {
            let body = bodies.entry(forest.root(mat)).or_insert_with(Body::empty);
            body.mats.push(mat as u32);
        }
        for (link, a, b) in ends(network) {
            for (near, other) in [(a, b), (b, a)] {
                if !self.is_eligible[near] {
                    continue;
                }
                let Some(body) = bodies.get_mut(&forest.root(near)) else {
                    continue;
                };
                let is_held = network.mats().kind[other].is_held() && !self.is_driven[other];
                if is_inner(link) && (self.is_eligible[other] || is_held) {
                    // A link between two MATs of the body is met from both ends, but noted once.
                    if near == a || !self.is_eligible[other] {
                        body.links.push(link as u32);
                    }
                    if is_held {
                        body.guests.push(other as u32);
                    }
                } else {
                    body.ports.push(near as u32);
                    body.is_touched |= self.is_followed[link];
                }
            }
        }
        let proxied = network.proxies().iter().flat_map(Proxy::masses);
        for mat in proxied.chain(network.followed().map(|(_, guide)| guide)) {
            if self.is_eligible[mat]
                && let Some(body) = bodies.get_mut(&forest.root(mat))
            {
                body.ports.push(mat as u32);
            }
        }
        let worth = |body: &Body| {
            let is_large = !body.is_small()
                && body.ports.len() <= PORTS_ANY.max(body.mats.len() / MASSES_A_PORT);
            let takes_small = match wanted {
                Wanted::All => true,
                Wanted::Touched => body.is_touched,
                Wanted::Meshes | Wanted::Linear => false,
            };
            is_large || (takes_small && !body.links.is_empty())
        };
        bodies.into_values().map(Body::tidy).filter(worth).collect()
    }
}

impl Body {
    /// The body without the single links that tie it to fixed points: they then end at ports. `None` if it has none, or
    /// more than `ties_max`.
    pub(in crate::plan) fn untied(&self, network: &Network, ties_max: usize) -> Option<Self> {
        let is_single = |link: usize| {
            let mut runs = interrupt::each(network.runs());
            runs.any(|run| run.first == link && run.len == 1)
        };
        let is_guest = |mat: usize| self.guests.binary_search(&(mat as u32)).is_ok();
        let is_ours = |link: usize| self.links.binary_search(&(link as u32)).is_ok();
        let (mut freed, mut ties) = (self.clone(), Vec::new());
        freed.guests.clear();
        for (link, a, b) in ends(network).filter(|&(link, ..)| is_ours(link)) {
            let held = [(a, b), (b, a)].into_iter().find(|&(end, _)| is_guest(end));
            match held {
                Some((_, port)) if is_single(link) => {
                    ties.push(link as u32);
                    freed.ports.push(port as u32);
                }
                Some((guest, _)) => freed.guests.push(guest as u32),
                None => {}
            }
        }
        freed.links.retain(|link| {
            interrupt::poll();
            !ties.contains(link)
        });
        (1..=ties_max).contains(&ties.len()).then(|| freed.tidy())
    }

    /// Whether it has so few masses that it is a body only for what touches it.
    pub(in crate::plan) fn is_small(&self) -> bool {
        self.mats.len() < MODAL_MASSES_MIN
    }

    /// Sorts the lists and removes duplicates.
    pub(in crate::plan) fn tidy(mut self) -> Self {
        for list in [&mut self.guests, &mut self.links, &mut self.ports] {
            list.sort_unstable();
            list.dedup();
        }
        self
    }

    pub(in crate::plan) fn empty() -> Self {
        Self {
            mats: Vec::new(),
            guests: Vec::new(),
            links: Vec::new(),
            ports: Vec::new(),
            is_touched: false,
        }
    }
}
