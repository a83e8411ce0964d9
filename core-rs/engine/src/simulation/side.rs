//! One of the two simulations of a takeover, as `Takeover::new` compares them.

use super::{RunningUnit, Simulation};
use crate::assembly::unit::{ComputationUnit, IslandPlan};
use crate::island::Island;
use crate::network::Network;

/// Index of a group in a simulation, and of a unit in the group.
pub(super) type UnitIndex = (usize, usize);

/// Where a MAT is computed.
#[derive(Clone, Copy, Debug)]
pub(super) enum MatLocation {
    /// Index of a MAT in an island.
    Island(UnitIndex, usize),
    /// Index of an oscillator in a bank, and the rest position of its MAT [m].
    Bank(UnitIndex, usize, f64),
    /// Index in the workspace of a mass of a body.
    Workspace(usize),
}

/// One of the two simulations of a takeover: its islands and banks, with their plans.
pub(super) struct TakeoverSide<'a> {
    pub(super) network: &'a Network,
    pub(super) rate: crate::units::Rate,
    pub(super) islands: Vec<(UnitIndex, &'a Island, &'a IslandPlan)>,
    pub(super) banks: Vec<(UnitIndex, &'a crate::assembly::unit::BankPlan)>,
}

impl<'a> TakeoverSide<'a> {
    pub(super) fn new(simulation: &'a Simulation) -> Self {
        let plan = &*simulation.plan;
        let mut side = Self {
            network: &plan.network,
            rate: plan.timeline_rate,
            islands: Vec::new(),
            banks: Vec::new(),
        };
        for (group_index, group) in simulation.groups.iter().enumerate() {
            let group_units = group.units.iter().zip(&plan.units[group.first_unit..]);
            for (unit_index, pair) in group_units.enumerate() {
                match pair {
                    (RunningUnit::Island(island), ComputationUnit::IslandPlan(island_plan)) => {
                        side.islands.push(((group_index, unit_index), island, island_plan));
                    }
                    (_, ComputationUnit::Bank(bank)) => side.banks.push(((group_index, unit_index), bank)),
                    (RunningUnit::Bank(_), ComputationUnit::IslandPlan(_)) => {}
                }
            }
        }
        side
    }
}

/// The items of a list that are not marked as the same, with their indices.
pub(super) fn unmatched<'a, T>(items: &'a [T], is_matched: &'a [bool]) -> impl Iterator<Item = (&'a T, usize)> {
    let marked_entries = items.iter().zip(is_matched).zip(0..);
    marked_entries.filter_map(|((item, is_matched), index)| (!is_matched).then_some((item, index)))
}

/// The moving MATs of units that are not the same on both sides, by name. Ports are left out: their bodies move them.
pub(super) fn mat_locations(
    side: &TakeoverSide<'_>,
    [same_islands, same_banks]: [&[bool]; 2],
) -> Vec<(String, MatLocation)> {
    let mut locations = Vec::new();
    for (&(unit, _, island_plan), _) in unmatched(&side.islands, same_islands) {
        let mut port_mats: Vec<usize> = island_plan.bodies.iter().flat_map(|body| body.ports()).collect();
        port_mats.sort_unstable();
        let mat_kinds = island_plan.network.mats().kind.iter().enumerate();
        let free_mats = mat_kinds.filter(|(mat, kind)| kind.moves() && port_mats.binary_search(mat).is_err());
        locations.extend(free_mats.map(|(mat, _)| (island_plan.network.mat_name(mat), MatLocation::Island(unit, mat))));
    }
    for (&(unit, bank), _) in unmatched(&side.banks, same_banks) {
        let bank_mats = bank.mats_and_rests.iter().enumerate();
        locations.extend(bank_mats.map(|(index, &(mat, rest))| {
            (
                side.network.mat_name(mat as usize),
                MatLocation::Bank(unit, index, rest),
            )
        }));
    }
    locations
}
