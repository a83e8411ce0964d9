//! Finds the state that a simulation takes over from another, by comparing their plans. Units that both have continue
//! unchanged.
//!
//! The search is done beforehand; `take_over` then transfers the state without allocating. Here "there" is the old
//! simulation, and "here" the new one.

mod apply;
mod pieces;

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::Simulation;
use super::bodies::{TransferredBody, Workspace, all_mass_names, wanted_bodies};
use super::side::{MatLocation, TakeoverSide, UnitIndex, mat_locations, unmatched};
use crate::assembly::unit::IslandPlan;
use crate::bank::are_same;
use crate::body_modes::mode_shapes::ModalTransform;
use crate::island::ItemTakeover;
use crate::network::Network;
use crate::plan::Plan;
use crate::timeline::DriveKind;

/// The items that a simulation takes over from another.
#[derive(Clone, Debug, Default)]
pub struct Takeover {
    /// The plans that it was made for, old and new.
    pub(super) plans: Option<[Arc<Plan>; 2]>,
    /// Units that are the same in both: there, here.
    pub(super) same_units: Vec<(UnitIndex, UnitIndex)>,
    /// Banks of the same modes with other outputs: there, here, number of modes.
    pub(super) same_mode_banks: Vec<(UnitIndex, UnitIndex, usize)>,
    /// MATs of all other units: there, here.
    pub(super) mat_pairs: Vec<(MatLocation, MatLocation)>,
    /// Bodies there whose masses are read, and bodies here whose masses are set.
    pub(super) old_bodies: Vec<TransferredBody>,
    pub(super) new_bodies: Vec<TransferredBody>,
    pub(super) workspace: Workspace,
    /// Islands whose bodies took over a state: the ports of these islands must then be placed.
    pub(super) islands_to_place: Vec<UnitIndex>,
    pub(super) items: Vec<(UnitIndex, UnitIndex, ItemTakeover)>,
    /// For each output there, its index here; `None` if it is gone.
    pub(super) new_output_indices: Vec<Option<usize>>,
}

impl Takeover {
    /// What `new` takes over from `old`, by the names of modules. The two may be at any frame.
    pub fn new(old: &Simulation, new: &Simulation) -> Self {
        let (old_side, new_side) = (TakeoverSide::new(old), TakeoverSide::new(new));
        let mut takeover = Self {
            plans: Some([old.plan.clone(), new.plan.clone()]),
            ..Self::default()
        };
        let output_names = new.plan.network.outputs().iter().map(|output| &output.name);
        let output_by_name: HashMap<&String, usize> = output_names.zip(0..).collect();
        let outputs = old.plan.network.outputs().iter();
        takeover.new_output_indices = outputs
            .map(|output| output_by_name.get(&output.name).copied())
            .collect();
        let (same_islands, same_banks) = (
            takeover.match_islands(&old_side, &new_side),
            takeover.match_banks(&old_side, &new_side),
        );
        takeover.match_bodies(&old_side, &new_side, &same_islands);
        takeover.match_mats(&old_side, &new_side, &same_islands, &same_banks);
        takeover.match_link_memories(&old_side, &new_side, &same_islands);
        takeover.match_sliding_histories(&old_side, &new_side, &same_islands);
        takeover.match_voices(&old_side, &new_side, new.frame);
        takeover.match_gates_hands_and_parts(&old_side, &new_side);
        takeover
    }

    /// For each output of the old simulation, its index in the new one.
    pub fn outputs(&self) -> &[Option<usize>] {
        &self.new_output_indices
    }

    /// Finds islands that are the same in both; returns which those are, there and here.
    fn match_islands(&mut self, old_side: &TakeoverSide<'_>, new_side: &TakeoverSide<'_>) -> [Vec<bool>; 2] {
        let mut same_islands = [vec![false; old_side.islands.len()], vec![false; new_side.islands.len()]];
        let first_mat_name = |island_plan: &IslandPlan| island_plan.network.mat_name(0);
        // The first MAT of several islands may be the same imposed point, such as a hand's key: one name, several
        // candidates.
        let mut old_by_name: HashMap<String, Vec<usize>> = HashMap::new();
        for (island_index, (_, _, island_plan)) in old_side.islands.iter().enumerate() {
            old_by_name
                .entry(first_mat_name(island_plan))
                .or_default()
                .push(island_index);
        }
        for (island_index, &(new_unit, _, island_plan)) in new_side.islands.iter().enumerate() {
            let mut candidates = old_by_name.get(&first_mat_name(island_plan)).into_iter().flatten();
            let is_same_island = |&&old_index: &&usize| {
                !same_islands[0][old_index] && are_same_islands(island_plan, old_side.islands[old_index].2)
            };
            let Some(&old_index) = candidates.find(is_same_island) else {
                continue;
            };
            (same_islands[0][old_index], same_islands[1][island_index]) = (true, true);
            self.same_units.push((old_side.islands[old_index].0, new_unit));
        }
        same_islands
    }

    /// Finds banks that are the same in both; returns which those are, there and here.
    fn match_banks(&mut self, old_side: &TakeoverSide<'_>, new_side: &TakeoverSide<'_>) -> [Vec<bool>; 2] {
        let mut same_banks = [vec![false; old_side.banks.len()], vec![false; new_side.banks.len()]];
        let first_mat_name = |side: &TakeoverSide<'_>, bank: &crate::assembly::unit::BankPlan| match (
            &bank.body,
            bank.mats_and_rests.first(),
        ) {
            (Some(network), _) => network.mat_name(0),
            (None, Some(&(mat, _))) => side.network.mat_name(mat as usize),
            (None, None) => String::new(),
        };
        let indexed_banks = old_side.banks.iter().enumerate();
        let old_by_name: HashMap<String, usize> = indexed_banks
            .map(|(bank_index, (_, bank))| (first_mat_name(old_side, bank), bank_index))
            .collect();
        for (bank_index, &(new_unit, bank)) in new_side.banks.iter().enumerate() {
            let Some(&old_index) = old_by_name.get(&first_mat_name(new_side, bank)) else {
                continue;
            };
            let (old_unit, old_bank) = old_side.banks[old_index];
            let is_same_bank = match (&bank.body, &old_bank.body) {
                (Some(new_item), Some(old_item)) => new_item.is_same(old_item),
                (None, None) => {
                    let mat_identity =
                        |network: &Network, mat: &(u32, f64)| (network.mat_name(mat.0 as usize), mat.1.to_bits());
                    bank.mats_and_rests.len() == old_bank.mats_and_rests.len()
                        && bank
                            .mats_and_rests
                            .iter()
                            .zip(&old_bank.mats_and_rests)
                            .all(|(new_item, old_item)| {
                                mat_identity(new_side.network, new_item) == mat_identity(old_side.network, old_item)
                            })
                }
                _ => false,
            };
            if !is_same_bank {
                continue;
            }
            if are_same(&bank.oscillators, &old_bank.oscillators) {
                self.same_units.push((old_unit, new_unit));
            } else if bank.body.is_some() && have_same_poles(&bank.oscillators, &old_bank.oscillators) {
                self.same_mode_banks.push((old_unit, new_unit, bank.oscillators.len()));
            } else {
                continue;
            }
            (same_banks[0][old_index], same_banks[1][bank_index]) = (true, true);
        }
        same_banks
    }

    /// Finds bodies that are the same, in islands that are not.
    fn match_bodies(&mut self, old_side: &TakeoverSide<'_>, new_side: &TakeoverSide<'_>, same: &[Vec<bool>; 2]) {
        for (&(new_unit, _, island_plan), _) in unmatched(&new_side.islands, &same[1]) {
            let mut is_matched = false;
            for (body_index, body) in island_plan.bodies.iter().enumerate() {
                let old_body = unmatched(&old_side.islands, &same[0]).find_map(|(&(old_unit, _, old_plan), _)| {
                    let is_same_body = |old_body_plan: &crate::island::bodies::BodyPlan| {
                        let new_mat_name = |mat| island_plan.network.mat_name(mat);
                        body.is_same(old_body_plan, new_mat_name, |mat| old_plan.network.mat_name(mat))
                    };
                    Some((old_unit, old_plan.bodies.iter().position(is_same_body)?))
                });
                if let Some((old_unit, old_index)) = old_body {
                    self.items
                        .push((old_unit, new_unit, ItemTakeover::Body(old_index, body_index)));
                    is_matched = true;
                }
            }
            if is_matched {
                self.islands_to_place.push(new_unit);
            }
        }
    }

    /// Finds links with memory in islands that are not the same, by link name; links of one name are matched by their
    /// order.
    fn match_link_memories(
        &mut self,
        old_side: &TakeoverSide<'_>,
        new_side: &TakeoverSide<'_>,
        same_islands: &[Vec<bool>; 2],
    ) {
        let links_by_name = |side: &TakeoverSide<'_>, same: &[bool]| -> Vec<((String, usize), (UnitIndex, usize))> {
            let other_islands = side.islands.iter().zip(same).filter(|(_, same)| !**same);
            let links = other_islands.flat_map(|(&(unit, _, island_plan), _)| {
                let network = &island_plan.network;
                let link_runs = network.runs().iter();
                let remembering_runs = link_runs.filter(|run| run.kind.has_memory());
                let links = remembering_runs.flat_map(|run| run.first..run.first + run.len);
                links.map(move |link| (network.link_name(link), (unit, link)))
            });
            let mut link_name_counts: HashMap<String, usize> = HashMap::new();
            let numbered = links.map(|(name, link_location)| {
                let name_number = link_name_counts.entry(name.clone()).or_default();
                *name_number += 1;
                ((name, *name_number), link_location)
            });
            numbered.collect()
        };
        let old_by_name: HashMap<_, _> = links_by_name(old_side, &same_islands[0]).into_iter().collect();
        for (name, (new_unit, new_link)) in links_by_name(new_side, &same_islands[1]) {
            if let Some(&(old_unit, old_link)) = old_by_name.get(&name) {
                self.items
                    .push((old_unit, new_unit, ItemTakeover::LinkMemory(old_link, new_link)));
            }
        }
    }

    /// Finds contacts of all pairs, in islands that are not the same, whose history of sliding continues: matched by
    /// link name and by the numbers of points.
    fn match_sliding_histories(
        &mut self,
        old_side: &TakeoverSide<'_>,
        new_side: &TakeoverSide<'_>,
        same_islands: &[Vec<bool>; 2],
    ) {
        let contact_runs =
            |side: &TakeoverSide<'_>, same: &[bool]| -> HashMap<(String, [usize; 2]), (UnitIndex, usize)> {
                let other_islands = side.islands.iter().zip(same).filter(|(_, same)| !**same);
                let named_runs = other_islands.flat_map(|(&(unit, _, island_plan), _)| {
                    let network = &island_plan.network;
                    network.runs().iter().filter_map(move |run| {
                        let point_pairs = run.pairwise()?.pairs;
                        let point_counts = [point_pairs.n_first, run.len];
                        Some(((network.link_name(run.first), point_counts), (unit, run.first)))
                    })
                });
                named_runs.collect()
            };
        let old_runs = contact_runs(old_side, &same_islands[0]);
        for (name, (new_unit, first_link)) in contact_runs(new_side, &same_islands[1]) {
            if let Some(&(old_unit, old_link)) = old_runs.get(&name) {
                self.items
                    .push((old_unit, new_unit, ItemTakeover::PairHistory(old_link, first_link)));
            }
        }
    }

    /// Finds MATs of units that are not the same.
    fn match_mats(
        &mut self,
        old_side: &TakeoverSide<'_>,
        new_side: &TakeoverSide<'_>,
        same_islands: &[Vec<bool>; 2],
        same_banks: &[Vec<bool>; 2],
    ) {
        let matched_bodies = |in_new: bool| -> HashSet<(UnitIndex, usize)> {
            let bodies = self.items.iter().filter_map(|(old_unit, new_unit, item)| match item {
                ItemTakeover::Body(_, new_body) if in_new => Some((*new_unit, *new_body)),
                ItemTakeover::Body(old_body, _) => Some((*old_unit, *old_body)),
                _ => None,
            });
            bodies.collect()
        };
        let (old_matched, new_matched) = (matched_bodies(false), matched_bodies(true));
        let old_same: [&[bool]; 2] = [&same_islands[0], &same_banks[0]];
        let new_same: [&[bool]; 2] = [&same_islands[1], &same_banks[1]];
        let mats_outside_bodies = mat_locations(old_side, old_same);
        let old_names: HashSet<String> = {
            let bodies = all_mass_names(old_side, old_same, &old_matched).into_iter();
            bodies
                .chain(mats_outside_bodies.iter().map(|(name, _)| name.clone()))
                .collect()
        };
        let mut new_mats = mat_locations(new_side, new_same);
        let (body_locations, new_bodies) = wanted_bodies(
            new_side,
            new_same,
            &new_matched,
            |name| old_names.contains(name),
            ModalTransform::ToAmplitudes,
            &mut self.workspace,
        );
        new_mats.extend(body_locations);
        let new_names: HashSet<&str> = new_mats.iter().map(|(name, _)| name.as_str()).collect();
        let is_in_new = |name: &str| new_names.contains(name);
        let (body_locations, old_bodies) = wanted_bodies(
            old_side,
            old_same,
            &old_matched,
            is_in_new,
            ModalTransform::ToPositions,
            &mut self.workspace,
        );
        let old_by_name: HashMap<String, MatLocation> = mats_outside_bodies.into_iter().chain(body_locations).collect();
        for (name, new_location) in &new_mats {
            if let Some(&old_location) = old_by_name.get(name) {
                self.mat_pairs.push((old_location, *new_location));
            }
        }
        self.islands_to_place
            .extend(new_bodies.iter().map(|body| body.place.unit));
        (self.old_bodies, self.new_bodies) = (old_bodies, new_bodies);
    }
}

/// Whether one island can continue from the state of another, to the last bit.
fn are_same_islands(island_plan: &IslandPlan, other_plan: &IslandPlan) -> bool {
    let imposed_mats = |island_plan: &IslandPlan| -> Vec<usize> {
        let drives = island_plan.timeline.drives.iter();
        let path_drives = drives.filter(|drive| drive.kind == DriveKind::Position);
        path_drives.map(|drive| drive.mat).collect()
    };
    let name_of_mat = |mat| island_plan.network.mat_name(mat);
    let bodies = || island_plan.bodies.iter().zip(&other_plan.bodies);
    let step_numbers = |island_plan: &IslandPlan| island_plan.step_numbers(island_plan.contact_substeps);
    step_numbers(island_plan) == step_numbers(other_plan)
        && island_plan.bodies.len() == other_plan.bodies.len()
        && island_plan.network.is_same(&other_plan.network)
        && imposed_mats(island_plan) == imposed_mats(other_plan)
        && bodies().all(|(body, other_body)| body.is_same(other_body, name_of_mat, name_of_mat))
}

/// Whether two banks hold the same modes; their outputs may differ.
fn have_same_poles(oscillators: &[crate::bank::Oscillator], other: &[crate::bank::Oscillator]) -> bool {
    let coefficients = |oscillator: &crate::bank::Oscillator| (oscillator.a, oscillator.b);
    oscillators.iter().map(coefficients).eq(other.iter().map(coefficients))
}
