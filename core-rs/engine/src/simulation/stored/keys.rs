//! Keys of units and outputs: hashes of all that their sound depends on, without names and places in the score.

use std::sync::{Arc, OnceLock};

use crate::assembly::unit::ComputationUnit;
use crate::content::bank::BankContent;
use crate::content::island::Content;
use crate::plan::Plan;
use crate::simulation::Simulation;
use crate::simulation::group::{GROUPS_MAX, RunningUnit};

/// What the units of a plan depend on, each computed when its first key is needed.
#[derive(Clone, Debug)]
pub(in crate::simulation) struct UnitContents(Arc<[OnceLock<UnitContent>]>);

#[derive(Clone, Debug)]
enum UnitContent {
    Island(Box<Content>),
    Bank(BankContent),
}

impl UnitContents {
    pub(in crate::simulation) fn new(plan: &Plan) -> Self {
        Self(plan.units.iter().map(|_| OnceLock::new()).collect())
    }
}

impl Simulation {
    /// A hash of everything that determines a unit up to the last of `frames` (64 hex digits); `previous_key` is the
    /// hash up to the first of `frames`, or empty if that is 0.
    pub(super) fn unit_key(&self, unit: usize, frames: (u64, u64), previous_key: &str) -> String {
        let unit_plan = &self.plan.units[unit];
        match (unit_plan, self.unit_content(unit)) {
            (ComputationUnit::IslandPlan(island_plan), UnitContent::Island(content)) => {
                content.hash_of_span(island_plan, frames, previous_key)
            }
            (ComputationUnit::Bank(bank), UnitContent::Bank(content)) => {
                content.hash_of_span(bank, frames, previous_key)
            }
            _ => String::new(),
        }
    }

    fn unit_content(&self, unit: usize) -> &UnitContent {
        self.unit_contents.0[unit].get_or_init(|| match &self.plan.units[unit] {
            ComputationUnit::IslandPlan(island_plan) => UnitContent::Island(Box::new(Content::new(island_plan))),
            ComputationUnit::Bank(bank) => UnitContent::Bank(BankContent::new(bank, self.plan.timeline_rate)),
        })
    }

    /// Hashes of everything that determines each output up to each of the rising frames `stop_frames` (n_stops; n_out).
    ///
    /// Outputs of two simulations with the same hash have the same samples up to there. Units that are silent up to
    /// there do not count, so notes that are not played change no hash; where nothing else is heard, the hash is empty.
    pub fn output_keys(&self, stop_frames: &[u64]) -> Vec<Vec<String>> {
        let plan = &*self.plan;
        let output_and_offset = plan.network.outputs().iter().zip(&plan.output_offsets);
        let start_keys: Vec<String> = output_and_offset
            .map(|(output, offset)| {
                format!(
                    "{:?} {} {:x}",
                    plan.timeline_rate.hertz(),
                    output.order,
                    offset.to_bits()
                )
            })
            .collect();
        let mut keys_by_stop = vec![start_keys; stop_frames.len()];
        let has_no_offset = plan.output_offsets.iter().map(|offset| *offset == 0.0).collect();
        let mut silent_outputs: Vec<Vec<bool>> = vec![has_no_offset; stop_frames.len()];
        // Sums are rounded group by group.
        let mut last_group = vec![vec![None; plan.output_offsets.len()]; stop_frames.len()];
        let running_units: Vec<&RunningUnit> = self.units().map(|(running, _)| running).collect();
        for (group, units) in plan.groups(GROUPS_MAX).into_iter().enumerate() {
            for unit in units.filter(|unit| *unit < plan.n_heard_units) {
                let outputs = self.outputs_of(unit);
                let silent_until = match (running_units[unit], &plan.units[unit]) {
                    (RunningUnit::Island(island), _) => island.silence_end_frame(),
                    (_, ComputationUnit::Bank(bank)) => bank.silent_until_frame(),
                    _ => 0,
                };
                let (mut start_frame, mut unit_key) = (0, String::new());
                for (stop_index, &stop) in stop_frames.iter().enumerate() {
                    unit_key = self.unit_key(unit, (start_frame, stop), &unit_key);
                    start_frame = stop;
                    if stop <= silent_until {
                        continue;
                    }
                    for (local, &output) in outputs.iter().enumerate() {
                        let last_group = &mut last_group[stop_index][output];
                        let separator = if *last_group == Some(group) { '+' } else { ',' };
                        *last_group = Some(group);
                        silent_outputs[stop_index][output] = false;
                        keys_by_stop[stop_index][output] += &format!("{separator}{unit_key}.{local}");
                    }
                }
            }
        }
        for (key, is_silent) in keys_by_stop.iter_mut().flatten().zip(silent_outputs.iter().flatten()) {
            *key = if *is_silent {
                String::new()
            } else {
                crate::content::hash_hex(format_args!("{key}"))
            };
        }
        keys_by_stop
    }

    /// Outputs of the scene that hear a unit, in its order.
    fn outputs_of(&self, unit: usize) -> Vec<usize> {
        match (&self.plan.units[unit], self.unit_content(unit)) {
            (ComputationUnit::IslandPlan(island_plan), _) => island_plan.scene_outputs().collect(),
            (ComputationUnit::Bank(_), UnitContent::Bank(content)) => {
                content.outputs.iter().map(|&output| output as usize).collect()
            }
            (ComputationUnit::Bank(_), UnitContent::Island(_)) => Vec::new(),
        }
    }
}
