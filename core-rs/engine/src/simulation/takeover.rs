//! Finds what a simulation takes over from another, by comparing their plans: whatever both have continues without a
//! change.
//!
//! The search is done beforehand; `take_over` then transfers the state without allocating. Here "there" is the old
//! simulation, and "here" the new one.

mod apply;
mod pieces;

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::Simulation;
use super::bodies::{Body, Workspace, bodies, names};
use super::side::{MatLocation, Side, UnitIndex, mat_locations, unmatched};
use crate::bank::are_same;
use crate::island::ItemTakeover;
use crate::network::Network;
use crate::plan::{IslandPlan, ModalTransform, Plan};
use crate::timeline::DriveKind;

/// What a simulation takes over from another, item by item.
#[derive(Clone, Debug, Default)]
pub struct Takeover {
    /// The plans that it was made for, old and new.
    pub(super) plans: Option<[Arc<Plan>; 2]>,
    /// Units that are the same in both: there, here.
    pub(super) units: Vec<(UnitIndex, UnitIndex)>,
    /// Banks of the same modes with other outputs: there, here, number of modes.
    pub(super) modes: Vec<(UnitIndex, UnitIndex, usize)>,
    /// MATs of all other units: there, here.
    pub(super) mats: Vec<(MatLocation, MatLocation)>,
    /// Bodies there whose masses are read, and bodies here whose masses are set.
    pub(super) from: Vec<Body>,
    pub(super) to: Vec<Body>,
    pub(super) workspace: Workspace,
    /// Islands whose bodies took over a state: the ports of these islands must then be placed.
    pub(super) placed: Vec<UnitIndex>,
    pub(super) items: Vec<(UnitIndex, UnitIndex, ItemTakeover)>,
    /// For each output there, its index here; `None` if it is gone.
    pub(super) outputs: Vec<Option<usize>>,
}

impl Takeover {
    /// What `new` takes over from `old`, by the names of modules. The two may be at any frame.
    pub fn new(old: &Simulation, new: &Simulation) -> Self {
        let (there, here) = (Side::new(old), Side::new(new));
        let mut takeover = Self {
            plans: Some([old.plan.clone(), new.plan.clone()]),
            ..Self::default()
        };
        let names = new.plan.network.outputs().iter().map(|output| &output.name);
        let by_name: HashMap<&String, usize> = names.zip(0..).collect();
        let outputs = old.plan.network.outputs().iter();
        takeover.outputs = outputs
            .map(|output| by_name.get(&output.name).copied())
            .collect();
        let (islands, banks) = (
            takeover.islands(&there, &here),
            takeover.banks(&there, &here),
        );
        takeover.bodies(&there, &here, &islands);
        takeover.mats(&there, &here, &islands, &banks);
        takeover.memory(&there, &here, &islands);
        takeover.histories(&there, &here, &islands);
        takeover.voices(&there, &here, new.frame);
        takeover.holds(&there, &here);
        takeover
    }

    /// For each output of the old simulation, its index in the new one.
    pub fn outputs(&self) -> &[Option<usize>] {
        &self.outputs
    }

    /// Finds islands that are the same in both; returns which those are, there and here.
    fn islands(&mut self, there: &Side<'_>, here: &Side<'_>) -> [Vec<bool>; 2] {
        let mut same = [
            vec![false; there.islands.len()],
            vec![false; here.islands.len()],
        ];
        let first = |island_plan: &IslandPlan| island_plan.network.mat_name(0);
        // The first MAT of several islands may be the same imposed point, such as a hand's key: one name, several
        // candidates.
        let mut by_name: HashMap<String, Vec<usize>> = HashMap::new();
        for (unit, (_, _, island_plan)) in there.islands.iter().enumerate() {
            by_name.entry(first(island_plan)).or_default().push(unit);
        }
        for (unit, &(to, _, island_plan)) in here.islands.iter().enumerate() {
            let mut candidates = by_name.get(&first(island_plan)).into_iter().flatten();
            let is_same = |&&before: &&usize| {
                !same[0][before] && are_same_islands(island_plan, there.islands[before].2)
            };
            let Some(&before) = candidates.find(is_same) else {
                continue;
            };
            (same[0][before], same[1][unit]) = (true, true);
            self.units.push((there.islands[before].0, to));
        }
        same
    }

    /// Finds banks that are the same in both; returns which those are, there and here.
    fn banks(&mut self, there: &Side<'_>, here: &Side<'_>) -> [Vec<bool>; 2] {
        let mut same = [
            vec![false; there.banks.len()],
            vec![false; here.banks.len()],
        ];
        let first =
            |side: &Side<'_>, bank: &crate::plan::BankPlan| match (&bank.body, bank.mats.first()) {
                (Some(network), _) => network.mat_name(0),
                (None, Some(&(mat, _))) => side.network.mat_name(mat as usize),
                (None, None) => String::new(),
            };
        let all = there.banks.iter().enumerate();
        let by_name: HashMap<String, usize> = all
            .map(|(unit, (_, bank))| (first(there, bank), unit))
            .collect();
        for (unit, &(to, bank)) in here.banks.iter().enumerate() {
            let Some(&before) = by_name.get(&first(here, bank)) else {
                continue;
            };
            let (from, other) = there.banks[before];
            let is_same = match (&bank.body, &other.body) {
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
            } else if bank.body.is_some() && have_same_poles(&bank.oscillators, &other.oscillators)
            {
                self.modes.push((from, to, bank.oscillators.len()));
            } else {
                continue;
            }
            (same[0][before], same[1][unit]) = (true, true);
        }
        same
    }

    /// Finds bodies that are the same, in islands that are not.
    fn bodies(&mut self, there: &Side<'_>, here: &Side<'_>, same: &[Vec<bool>; 2]) {
        for (&(to, _, island_plan), _) in unmatched(&here.islands, &same[1]) {
            let mut is_matched = false;
            for (body_index, body) in island_plan.bodies.iter().enumerate() {
                let before =
                    unmatched(&there.islands, &same[0]).find_map(|(&(from, _, other), _)| {
                        let same = |their: &crate::island::inside::BodyPlan| {
                            let name = |mat| island_plan.network.mat_name(mat);
                            body.is_same(their, name, |mat| other.network.mat_name(mat))
                        };
                        Some((from, other.bodies.iter().position(same)?))
                    });
                if let Some((from, their)) = before {
                    self.items
                        .push((from, to, ItemTakeover::Body(their, body_index)));
                    is_matched = true;
                }
            }
            if is_matched {
                self.placed.push(to);
            }
        }
    }

    /// Finds links with memory in islands that are not the same, by link name; links of one name are matched by their
    /// order.
    fn memory(&mut self, there: &Side<'_>, here: &Side<'_>, islands: &[Vec<bool>; 2]) {
        let links_by_name =
            |side: &Side<'_>, same: &[bool]| -> Vec<((String, usize), (UnitIndex, usize))> {
                let others = side.islands.iter().zip(same).filter(|(_, same)| !**same);
                let links = others.flat_map(|(&(unit, _, island_plan), _)| {
                    let network = &island_plan.network;
                    let runs = network.runs().iter();
                    let remembering = runs.filter(|run| run.kind.remembers());
                    let links = remembering.flat_map(|run| run.first..run.first + run.len);
                    links.map(move |link| (network.link_name(link), (unit, link)))
                });
                let mut known: HashMap<String, usize> = HashMap::new();
                let numbered = links.map(|(name, place)| {
                    let next = known.entry(name.clone()).or_default();
                    *next += 1;
                    ((name, *next), place)
                });
                numbered.collect()
            };
        let by_name: HashMap<_, _> = links_by_name(there, &islands[0]).into_iter().collect();
        for (name, (to, remembering)) in links_by_name(here, &islands[1]) {
            if let Some(&(from, their)) = by_name.get(&name) {
                self.items
                    .push((from, to, ItemTakeover::Memory(their, remembering)));
            }
        }
    }

    /// Finds contacts of all pairs, in islands that are not the same, whose history of sliding continues: matched by
    /// link name and by the numbers of points.
    fn histories(&mut self, there: &Side<'_>, here: &Side<'_>, islands: &[Vec<bool>; 2]) {
        let contact_runs =
            |side: &Side<'_>, same: &[bool]| -> HashMap<(String, [usize; 2]), (UnitIndex, usize)> {
                let others = side.islands.iter().zip(same).filter(|(_, same)| !**same);
                let runs = others.flat_map(|(&(unit, _, island_plan), _)| {
                    let network = &island_plan.network;
                    network.runs().iter().filter_map(move |run| {
                        let pairs = run.pairwise()?.pairs;
                        let counts = [pairs.n_first, run.len];
                        Some(((network.link_name(run.first), counts), (unit, run.first)))
                    })
                });
                runs.collect()
            };
        let before = contact_runs(there, &islands[0]);
        for (name, (to, run_index)) in contact_runs(here, &islands[1]) {
            if let Some(&(from, their)) = before.get(&name) {
                self.items
                    .push((from, to, ItemTakeover::History(their, run_index)));
            }
        }
    }

    /// Finds MATs of units that are not the same.
    fn mats(
        &mut self,
        there: &Side<'_>,
        here: &Side<'_>,
        islands: &[Vec<bool>; 2],
        banks: &[Vec<bool>; 2],
    ) {
        let taken = |here: bool| -> HashSet<(UnitIndex, usize)> {
            let bodies = self.items.iter().filter_map(|(from, to, item)| match item {
                ItemTakeover::Body(_, own) if here => Some((*to, *own)),
                ItemTakeover::Body(there, _) => Some((*from, *there)),
                _ => None,
            });
            bodies.collect()
        };
        let (gone, come) = (taken(false), taken(true));
        let before: [&[bool]; 2] = [&islands[0], &banks[0]];
        let after: [&[bool]; 2] = [&islands[1], &banks[1]];
        let singles = mat_locations(there, before);
        let known: HashSet<String> = {
            let bodies = names(there, before, &gone).into_iter();
            bodies
                .chain(singles.iter().map(|(name, _)| name.clone()))
                .collect()
        };
        let mut here_mats = mat_locations(here, after);
        let (more, to) = bodies(
            here,
            after,
            &come,
            |name| known.contains(name),
            ModalTransform::ToAmplitudes,
            &mut self.workspace,
        );
        here_mats.extend(more);
        let wanted: HashSet<&str> = here_mats.iter().map(|(name, _)| name.as_str()).collect();
        let is_wanted = |name: &str| wanted.contains(name);
        let (more, from) = bodies(
            there,
            before,
            &gone,
            is_wanted,
            ModalTransform::ToPositions,
            &mut self.workspace,
        );
        let by_name: HashMap<String, MatLocation> = singles.into_iter().chain(more).collect();
        for (name, to) in &here_mats {
            if let Some(&from) = by_name.get(name) {
                self.mats.push((from, *to));
            }
        }
        self.placed.extend(to.iter().map(|body| body.place.unit));
        (self.from, self.to) = (from, to);
    }
}

/// Whether one island can continue from the state of another, to the last bit.
fn are_same_islands(island_plan: &IslandPlan, other: &IslandPlan) -> bool {
    let imposed = |island_plan: &IslandPlan| -> Vec<usize> {
        let drives = island_plan.timeline.drives.iter();
        let paths = drives.filter(|drive| drive.kind == DriveKind::Position);
        paths.map(|drive| drive.mat).collect()
    };
    let name = |mat| island_plan.network.mat_name(mat);
    let bodies = || island_plan.bodies.iter().zip(&other.bodies);
    let often = |own: &IslandPlan| (own.contact_substeps, own.oversampling, own.every);
    often(island_plan) == often(other)
        && island_plan.bodies.len() == other.bodies.len()
        && island_plan.network.is_same(&other.network)
        && imposed(island_plan) == imposed(other)
        && bodies().all(|(own, their)| own.is_same(their, name, name))
}

/// Whether two banks hold the same modes; their outputs may differ.
fn have_same_poles(
    oscillators: &[crate::bank::Oscillator],
    other: &[crate::bank::Oscillator],
) -> bool {
    let numbers = |one: &crate::bank::Oscillator| (one.a, one.b);
    oscillators
        .iter()
        .map(numbers)
        .eq(other.iter().map(numbers))
}
