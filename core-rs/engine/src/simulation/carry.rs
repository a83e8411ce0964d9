//! A simulation takes over from another: what both have goes on as if nothing had happened.
//!
//! What passes from which to which is found beforehand, from the two plans; then it is passed on without allocating.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::bodies::{Body, Room, bodies, names};
use super::{Playing, Simulation};
use crate::bank::are_same;
use crate::gesture::voice::{Heir, shared};
use crate::island::{Island, Through};
use crate::network::Network;
use crate::plan::{Isle, Plan, Unit};
use crate::scheme::moves;
use crate::timeline::DriveKind;

/// Group of a simulation, and unit in it.
pub(super) type At = (usize, usize);

/// Where a MAT is computed.
#[derive(Clone, Copy, Debug)]
pub(super) enum Spot {
    /// MAT of an island.
    Island(At, usize),
    /// Oscillator of a bank, and where its MAT rests [m].
    Bank(At, usize, f64),
    /// A mass of a body seen whole.
    Room(usize),
}

/// What a simulation takes over from another, piece by piece.
#[derive(Clone, Debug, Default)]
pub struct Carry {
    /// The plans that it was made for.
    plans: Option<[Arc<Plan>; 2]>,
    /// Whole units that are the same, there and here.
    units: Vec<(At, At)>,
    /// Banks of the same modes, otherwise heard.
    modes: Vec<(At, At, usize)>,
    /// MATs of all others.
    mats: Vec<(Spot, Spot)>,
    /// Bodies there whose masses go on, and bodies here that do.
    from: Vec<Body>,
    to: Vec<Body>,
    room: Room,
    /// Islands whose bodies came from elsewhere: their ports are to be placed.
    placed: Vec<At>,
    through: Vec<(At, At, Through)>,
    /// Here, an output of there.
    outputs: Vec<Option<usize>>,
}

/// A voice of an island that is known.
type Known<'a> = (At, &'a Island, &'a Isle, usize);

/// One side of it.
pub(super) struct Side<'a> {
    network: &'a Network,
    pub(super) rate: crate::units::Rate,
    pub(super) islands: Vec<(At, &'a Island, &'a Isle)>,
    pub(super) banks: Vec<(At, &'a crate::plan::BankPlan)>,
}

impl<'a> Side<'a> {
    fn new(simulation: &'a Simulation) -> Self {
        let plan = &*simulation.plan;
        let mut side = Self {
            network: &plan.network,
            rate: plan.timeline_rate,
            islands: Vec::new(),
            banks: Vec::new(),
        };
        for (g, group) in simulation.groups.iter().enumerate() {
            let units = group.units.iter().zip(&plan.units[group.first..]);
            for (u, pair) in units.enumerate() {
                match pair {
                    (Playing::Island(island), Unit::Isle(isle)) => {
                        side.islands.push(((g, u), island, isle));
                    }
                    (_, Unit::Bank(bank)) => side.banks.push(((g, u), bank)),
                    (Playing::Bank(_), Unit::Isle(_)) => {}
                }
            }
        }
        side
    }
}

impl Carry {
    /// What `new` takes over from `old`, by the names of modules; both at any moment.
    pub fn new(old: &Simulation, new: &Simulation) -> Self {
        let (there, here) = (Side::new(old), Side::new(new));
        let mut carry = Self {
            plans: Some([old.plan.clone(), new.plan.clone()]),
            ..Self::default()
        };
        let names = new.plan.network.outputs().iter().map(|output| &output.name);
        let by_name: HashMap<&String, usize> = names.zip(0..).collect();
        let outputs = old.plan.network.outputs().iter();
        carry.outputs = outputs
            .map(|output| by_name.get(&output.name).copied())
            .collect();
        let (islands, banks) = (carry.islands(&there, &here), carry.banks(&there, &here));
        carry.bodies(&there, &here, &islands);
        carry.mats(&there, &here, &islands, &banks);
        carry.voices(&there, &here, new.frame);
        carry.holds(&there, &here);
        carry
    }

    /// Which output here an output of there has become.
    pub fn outputs(&self) -> &[Option<usize>] {
        &self.outputs
    }

    /// Islands that are the same in both; which those are: there, here.
    fn islands(&mut self, there: &Side<'_>, here: &Side<'_>) -> [Vec<bool>; 2] {
        let mut same = [
            vec![false; there.islands.len()],
            vec![false; here.islands.len()],
        ];
        let first = |isle: &Isle| isle.network.mat_name(0);
        let by_name: HashMap<String, usize> = {
            let all = there.islands.iter().enumerate();
            all.map(|(at, (_, _, isle))| (first(isle), at)).collect()
        };
        for (at, &(to, _, isle)) in here.islands.iter().enumerate() {
            let Some(&before) = by_name.get(&first(isle)) else {
                continue;
            };
            let (from, _, other) = there.islands[before];
            if are_same_isles(isle, other) {
                (same[0][before], same[1][at]) = (true, true);
                self.units.push((from, to));
            }
        }
        same
    }

    /// Banks that are the same in both; which those are: there, here.
    fn banks(&mut self, there: &Side<'_>, here: &Side<'_>) -> [Vec<bool>; 2] {
        let mut same = [
            vec![false; there.banks.len()],
            vec![false; here.banks.len()],
        ];
        let first =
            |side: &Side<'_>, bank: &crate::plan::BankPlan| match (&bank.of, bank.mats.first()) {
                (Some(network), _) => network.mat_name(0),
                (None, Some(&(mat, _))) => side.network.mat_name(mat as usize),
                (None, None) => String::new(),
            };
        let all = there.banks.iter().enumerate();
        let by_name: HashMap<String, usize> = all
            .map(|(at, (_, bank))| (first(there, bank), at))
            .collect();
        for (at, &(to, bank)) in here.banks.iter().enumerate() {
            let Some(&before) = by_name.get(&first(here, bank)) else {
                continue;
            };
            let (from, other) = there.banks[before];
            let is_same = match (&bank.of, &other.of) {
                (Some(own), Some(their)) => own.is_same(their),
                (None, None) => {
                    let name = |network: &Network, mat: &(u32, f64)| {
                        (network.mat_name(mat.0 as usize), mat.1.to_bits())
                    };
                    bank.mats.len() == other.mats.len()
                        && bank.mats.iter().zip(&other.mats).all(|(own, their)| {
                            name(here.network, own) == name(there.network, their)
                        })
                }
                _ => false,
            };
            if !is_same {
                continue;
            }
            if are_same(&bank.oscillators, &other.oscillators) {
                self.units.push((from, to));
            } else if bank.of.is_some() && are_alike(&bank.oscillators, &other.oscillators) {
                self.modes.push((from, to, bank.oscillators.len()));
            } else {
                continue;
            }
            (same[0][before], same[1][at]) = (true, true);
        }
        same
    }

    /// Bodies of islands that are not the same, where the bodies are.
    fn bodies(&mut self, there: &Side<'_>, here: &Side<'_>, same: &[Vec<bool>; 2]) {
        for (&(to, _, isle), _) in others(&here.islands, &same[1]) {
            let mut found = false;
            for (own, body) in isle.bodies.iter().enumerate() {
                let before = others(&there.islands, &same[0]).find_map(|(&(from, _, other), _)| {
                    let same = |their: &crate::island::inside::Inside| {
                        let name = |mat| isle.network.mat_name(mat);
                        body.is_same(their, name, |mat| other.network.mat_name(mat))
                    };
                    Some((from, other.bodies.iter().position(same)?))
                });
                if let Some((from, their)) = before {
                    self.through.push((from, to, Through::Body(their, own)));
                    found = true;
                }
            }
            if found {
                self.placed.push(to);
            }
        }
    }

    /// MATs of units that are not the same.
    fn mats(
        &mut self,
        there: &Side<'_>,
        here: &Side<'_>,
        islands: &[Vec<bool>; 2],
        banks: &[Vec<bool>; 2],
    ) {
        let taken = |here: bool| -> HashSet<(At, usize)> {
            let bodies = self
                .through
                .iter()
                .filter_map(|(from, to, through)| match through {
                    Through::Body(_, own) if here => Some((*to, *own)),
                    Through::Body(there, _) => Some((*from, *there)),
                    _ => None,
                });
            bodies.collect()
        };
        let (gone, come) = (taken(false), taken(true));
        let before: [&[bool]; 2] = [&islands[0], &banks[0]];
        let after: [&[bool]; 2] = [&islands[1], &banks[1]];
        let singles = spots(there, before);
        let known: HashSet<String> = {
            let bodies = names(there, before, &gone).into_iter();
            bodies
                .chain(singles.iter().map(|(name, _)| name.clone()))
                .collect()
        };
        let mut here_spots = spots(here, after);
        let (more, to) = bodies(
            here,
            after,
            &come,
            |name| known.contains(name),
            &mut self.room,
        );
        here_spots.extend(more);
        let wanted: HashSet<&str> = here_spots.iter().map(|(name, _)| name.as_str()).collect();
        let is_wanted = |name: &str| wanted.contains(name);
        let (more, from) = bodies(there, before, &gone, is_wanted, &mut self.room);
        let by_name: HashMap<String, Spot> = singles.into_iter().chain(more).collect();
        for (name, to) in &here_spots {
            if let Some(&from) = by_name.get(name) {
                self.mats.push((from, *to));
            }
        }
        self.placed.extend(to.iter().map(|body| body.place.at));
        (self.from, self.to) = (from, to);
    }

    /// Voices by the MATs that they strike, with their gestures' reports.
    fn voices(&mut self, there: &Side<'_>, here: &Side<'_>, n: u64) {
        let mut by_name: HashMap<(String, bool), Vec<Known<'_>>> = HashMap::new();
        for &(from, island, isle) in &there.islands {
            for (voice, own) in island.script().voices.iter().enumerate() {
                let name = (isle.network.mat_name(own.struck), own.layer);
                by_name
                    .entry(name)
                    .or_default()
                    .push((from, island, isle, voice));
            }
        }
        for &(to, island, isle) in &here.islands {
            let script = island.script();
            let limit = n * u64::from(isle.times);
            for (voice, own) in script.voices.iter().enumerate() {
                let name = (isle.network.mat_name(own.struck), own.layer);
                let Some(candidates) = by_name.get_mut(&name) else {
                    continue;
                };
                // A layer is its one gesture; a key has one voice for the others.
                let mut heir = None;
                for (at, &(from, old, other, there)) in candidates.iter().enumerate() {
                    let their = &old.script().voices[there];
                    let gestures = shared((own, &script.gestures), (their, &old.script().gestures));
                    if own.layer && gestures.is_empty() {
                        continue;
                    }
                    heir = Some((at, from, other, there, gestures));
                    break;
                }
                let Some((at, from, other, there, gestures)) = heir else {
                    continue;
                };
                let old = candidates.remove(at).1.script();
                let their = &old.voices[there];
                let (name, other_name) = (
                    |mat| isle.network.mat_name(mat),
                    |mat| other.network.mat_name(mat),
                );
                let mats = if own.free.is_like(&their.free, name, other_name)
                    && isle.times == other.times
                {
                    None
                } else {
                    let known: HashMap<String, usize> = their
                        .free
                        .members
                        .iter()
                        .map(|&mat| other_name(mat))
                        .zip(0..)
                        .collect();
                    let members = own.free.members.iter().enumerate();
                    let pair = |(to, &mat): (usize, &usize)| Some((to, *known.get(&name(mat))?));
                    Some(members.filter_map(pair).collect())
                };
                let begun = gestures
                    .iter()
                    .filter(|pair| old.gestures[pair.0].join_from <= limit);
                for &(there, here) in begun {
                    let is_same = self.units.contains(&(from, to));
                    self.through
                        .push((from, to, Through::Report(there, here, is_same)));
                }
                let heir = Heir {
                    from: there,
                    to: voice,
                    mats,
                    gestures,
                };
                self.through.push((from, to, Through::Voice(heir)));
            }
        }
    }

    /// Gates by their links, hands by their MATs, parts that may be mute.
    fn holds(&mut self, there: &Side<'_>, here: &Side<'_>) {
        let mut gates = HashMap::new();
        let mut hands: HashMap<String, Vec<(At, usize)>> = HashMap::new();
        for &(from, island, isle) in &there.islands {
            for (gate, own) in island.script().gates.iter().enumerate() {
                gates.insert(isle.network.link_name(own.link), (from, gate));
            }
            // A hand that several islands touch has a part in each of them.
            for (hand, own) in island.script().grips.iter().enumerate() {
                let name = isle.network.mat_name(own.mat());
                hands.entry(name).or_default().push((from, hand));
            }
        }
        let has_link = |name: &str| {
            let of = |(at, isle): (At, &Isle)| {
                let runs = isle.network.runs().iter();
                let mut names = runs.map(|run| isle.network.link_name(run.first));
                names.any(|own| own == name).then_some(at)
            };
            let mut all = there.islands.iter().map(|&(at, _, isle)| (at, isle));
            all.find_map(of)
        };
        let same: HashMap<At, At> = self.units.iter().map(|&(from, to)| (to, from)).collect();
        for &(to, island, isle) in &here.islands {
            let script = island.script();
            for (gate, own) in script.gates.iter().enumerate() {
                let name = isle.network.link_name(own.link);
                if let Some(&(from, before)) = gates.get(&name) {
                    let through = Through::Gate(Some(before), gate);
                    self.through.push((from, to, through));
                } else if let Some(from) = has_link(&name) {
                    self.through.push((from, to, Through::Gate(None, gate)));
                }
            }
            for (hand, own) in script.grips.iter().enumerate() {
                let Some(known) = hands.get(&isle.network.mat_name(own.mat())) else {
                    continue;
                };
                let ours = known.iter().find(|(from, _)| same.get(&to) == Some(from));
                if let Some(&(from, before)) = ours.or(known.first()) {
                    self.through.push((from, to, Through::Hand(before, hand)));
                }
            }
        }
        for &(from, to) in &self.units.clone() {
            let island = |side: &Side<'_>, at: At| {
                let mut all = side.islands.iter();
                all.find(|island| island.0 == at)
                    .map(|island| island.2.network.clone())
            };
            let (Some(own), Some(their)) = (island(here, to), island(there, from)) else {
                continue;
            };
            let mut parts: Vec<(u32, u32)> = {
                let (own, their) = (&own.mats().part, &their.mats().part);
                their.iter().copied().zip(own.iter().copied()).collect()
            };
            parts.sort_unstable();
            parts.dedup();
            for (there, own) in parts {
                let through = Through::Part(there as usize, own as usize);
                self.through.push((from, to, through));
            }
        }
    }
}

/// Those of a list that are not marked.
pub(super) fn others<'a, T>(
    all: &'a [T],
    is_same: &'a [bool],
) -> impl Iterator<Item = (&'a T, usize)> {
    let pairs = all.iter().zip(is_same).zip(0..);
    pairs.filter_map(|((one, is_same), at)| (!is_same).then_some((one, at)))
}

/// Whether one island can go on as another stands, to the last bit.
fn are_same_isles(isle: &Isle, other: &Isle) -> bool {
    let imposed = |isle: &Isle| -> Vec<usize> {
        let drives = isle.timeline.drives.iter();
        let paths = drives.filter(|drive| drive.kind == DriveKind::Position);
        paths.map(|drive| drive.mat).collect()
    };
    let name = |mat| isle.network.mat_name(mat);
    let bodies = || isle.bodies.iter().zip(&other.bodies);
    (isle.steps, isle.times) == (other.steps, other.times)
        && isle.bodies.len() == other.bodies.len()
        && isle.network.is_same(&other.network)
        && imposed(isle) == imposed(other)
        && bodies().all(|(own, their)| own.is_same(their, name, name))
}

/// Whether two banks are of the same modes, whatever hears them.
fn are_alike(own: &[crate::bank::Oscillator], other: &[crate::bank::Oscillator]) -> bool {
    let numbers = |one: &crate::bank::Oscillator| (one.a, one.b);
    own.iter().map(numbers).eq(other.iter().map(numbers))
}

/// The MATs of units that are not the same, by name: those that move, and no port, which goes where its body has it.
fn spots(side: &Side<'_>, [islands, banks]: [&[bool]; 2]) -> Vec<(String, Spot)> {
    let mut found = Vec::new();
    for (&(at, _, isle), _) in others(&side.islands, islands) {
        let mut ports: Vec<usize> = isle.bodies.iter().flat_map(|body| body.ports()).collect();
        ports.sort_unstable();
        let kinds = isle.network.mats().kind.iter().enumerate();
        let free = kinds.filter(|(mat, kind)| moves(**kind) && ports.binary_search(mat).is_err());
        found.extend(free.map(|(mat, _)| (isle.network.mat_name(mat), Spot::Island(at, mat))));
    }
    for (&(at, bank), _) in others(&side.banks, banks) {
        let mats = bank.mats.iter().enumerate();
        found.extend(mats.map(|(own, &(mat, rest))| {
            (
                side.network.mat_name(mat as usize),
                Spot::Bank(at, own, rest),
            )
        }));
    }
    found
}

impl Simulation {
    /// Go on where `old` stands, by what was found of the two; `old` is of no use afterwards. False where they stand at
    /// different frames, or go by other plans than `carry` was made for: nothing is taken over then. Allocates nothing.
    pub fn take_over(&mut self, old: &mut Self, carry: &mut Carry) -> bool {
        let is_made_for = |[before, after]: &[Arc<Plan>; 2]| {
            Arc::ptr_eq(before, &old.plan) && Arc::ptr_eq(after, &self.plan)
        };
        if self.frame != old.frame || !carry.plans.as_ref().is_some_and(is_made_for) {
            return false;
        }
        for &(from, to) in &carry.units {
            match (self.playing(to), old.playing(from)) {
                (Playing::Island(own), Playing::Island(old)) => own.go_on(old),
                (Playing::Bank(own), Playing::Bank(old)) => own.go_on(old),
                _ => {}
            }
        }
        for &(from, to, n) in &carry.modes {
            if let (Playing::Bank(own), Playing::Bank(old)) = (self.playing(to), old.playing(from))
            {
                (0..n).for_each(|mode| own.copy_motion(mode, old, mode));
            }
        }
        let Carry {
            mats,
            from,
            to,
            room,
            ..
        } = carry;
        from.iter().for_each(|body| body.look(old, room));
        for &(from, to) in &*mats {
            self.pass(old, room, from, to);
        }
        to.iter_mut().for_each(|body| body.put(self, room));
        for (from, to, through) in &carry.through {
            if let (Playing::Island(own), Playing::Island(old)) =
                (self.playing(*to), old.playing(*from))
            {
                own.receive(through, old);
            }
        }
        for &at in &carry.placed {
            if let Playing::Island(island) = self.playing(at) {
                island.place();
            }
        }
        true
    }

    pub(super) fn playing(&mut self, (group, unit): At) -> &mut Playing {
        &mut self.groups[group].units[unit]
    }

    /// One MAT goes on.
    fn pass(&mut self, old: &mut Self, room: &mut Room, from: Spot, to: Spot) {
        let motion = match from {
            Spot::Room(slot) => room.mats[slot],
            Spot::Island(at, mat) => match old.playing(at) {
                Playing::Island(island) => island.motion(mat),
                Playing::Bank(_) => return,
            },
            Spot::Bank(at, there, rest) => match old.playing(at) {
                Playing::Bank(bank) => {
                    if let Spot::Bank(at, here, own) = to
                        && own == rest
                        && let Playing::Bank(new) = self.playing(at)
                    {
                        new.copy_motion(here, bank, there);
                        return;
                    }
                    let (now, before) = bank.motion(there);
                    (now + rest, now - before)
                }
                Playing::Island(_) => return,
            },
        };
        match to {
            Spot::Room(slot) => room.mats[slot] = motion,
            Spot::Island(at, mat) => {
                if let Playing::Island(island) = self.playing(at) {
                    island.set_motion(mat, motion);
                }
            }
            Spot::Bank(at, oscillator, rest) => {
                if let Playing::Bank(bank) = self.playing(at) {
                    let now = motion.0 - rest;
                    bank.set_motion(oscillator, (now, now - motion.1));
                }
            }
        }
    }
}
