//! Groups of units of a plan: the sounds of a group are summed together. Also decides which threads compute which
//! group.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Mutex;

use crate::assembly::unit::{ComputationUnit, IslandPlan};
use crate::bank::Bank;
use crate::interrupt;
use crate::island::{Fault, Island, SimulationOptions};
use crate::kernel::thread_team::ThreadTeam;
use crate::network::Error;
use crate::plan::Plan;
use crate::units::Rate;

/// Frames that a unit advances before its output is added to the sum: few enough for its state to stay in the cache.
pub(super) const UNIT_BLOCK_FRAMES: usize = 256;
/// Frames that a group advances when threads share the work: enough to make the cost of starting threads small.
pub(super) const THREADED_BLOCK_FRAMES: usize = 4_096;
/// Largest number of groups, whatever the number of threads; banks of large parts may add some.
pub(super) const GROUPS_MAX: usize = 16;
/// Share of each additional thread's time that is gained when a team computes one mesh.
const TEAM_EFFICIENCY: f64 = 0.7;

/// Units whose sounds are summed together, in the order of the plan.
#[derive(Clone, Debug)]
pub(super) struct Group {
    /// Index in the plan of the first unit.
    pub(super) first_unit: usize,
    pub(super) units: Vec<RunningUnit>,
    /// Where the sound of each unit comes from   (n_units)
    pub(super) sources: Vec<SoundSource>,
    /// Number of threads that compute its large meshes together.
    pub(super) team_size: usize,
    /// The outputs that hear any of its units, rising: others cost nothing   (n_out)
    pub(super) outputs: Vec<u32>,
    /// Sum of the sounds of all units   (UNIT_BLOCK_FRAMES or THREADED_BLOCK_FRAMES · n_out)
    pub(super) output_sums: Vec<f64>,
    /// Sound of one island   (UNIT_BLOCK_FRAMES · its n_out)
    island_sound: Vec<f64>,
}

/// Where the sound of a unit comes from.
#[derive(Clone, Debug)]
pub(super) enum SoundSource {
    /// The unit is computed.
    Computed,
    /// The unit is computed, and its sound is kept here   (n_frames · its n_out)
    Recorded(Vec<f64>),
    /// The sound is known from an earlier run: its samples, and the index of the next one. The unit is not stepped.
    Recalled(Vec<f64>, usize),
    /// The unit is silent and not stepped, because these frames are not heard.
    Skipped,
}

impl SoundSource {
    /// Copies the next samples to `sound`; false if they are not known or too few are left.
    fn recall(&mut self, sound: &mut [f64]) -> bool {
        let Self::Recalled(known_samples, position) = self else {
            return false;
        };
        let Some(next_samples) = known_samples.get(*position..*position + sound.len()) else {
            return false;
        };
        sound.copy_from_slice(next_samples);
        *position += sound.len();
        true
    }

    fn record(&mut self, sound: &[f64]) {
        if let Self::Recorded(recorded_sound) = self {
            recorded_sound.extend_from_slice(sound);
        }
    }
}

/// A unit of a plan, in the state of the current frame.
#[derive(Clone, Debug)]
pub(super) enum RunningUnit {
    Island(Box<Island>),
    Bank(Bank),
}

impl Group {
    /// The units `range` of a plan, at frame 0; `block_frames`: frames of the buffer for their sum.
    pub(super) fn new(
        plan: &Plan,
        range: Range<usize>,
        block_frames: usize,
        options: SimulationOptions,
    ) -> Result<Self, Error> {
        let outputs: BTreeSet<u32> = plan.units[range.clone()].iter().flat_map(outputs_of).collect();
        let mut new_group = Self {
            first_unit: range.start,
            team_size: 1,
            units: Vec::with_capacity(range.len()),
            sources: vec![SoundSource::Computed; range.len()],
            output_sums: vec![0.0; outputs.len() * block_frames],
            outputs: Vec::from_iter(outputs),
            island_sound: Vec::new(),
        };
        for unit in &plan.units[range] {
            new_group.push_unit(unit, plan.timeline_rate, options)?;
        }
        Ok(new_group)
    }

    fn push_unit(&mut self, unit: &ComputationUnit, rate: Rate, options: SimulationOptions) -> Result<(), Error> {
        self.units.push(match unit {
            ComputationUnit::IslandPlan(island_plan) => {
                let IslandPlan {
                    network,
                    timeline,
                    bodies,
                    contact_substeps,
                    stops_when_silent,
                    ..
                } = &**island_plan;
                let step_numbers = island_plan.step_numbers(*contact_substeps);
                let mut island = Island::new(network.clone(), timeline, bodies, step_numbers, options)?;
                if *stops_when_silent {
                    island.sleep_when_quiet();
                }
                let block_samples = island.n_out() * UNIT_BLOCK_FRAMES;
                self.island_sound
                    .resize(self.island_sound.len().max(block_samples), 0.0);
                RunningUnit::Island(Box::new(island))
            }
            ComputationUnit::Bank(bank) => {
                let strikes = bank.strikes.clone();
                let (oscillators, is_open) = (&bank.oscillators, bank.is_open);
                RunningUnit::Bank(Bank::new(oscillators, strikes, rate, UNIT_BLOCK_FRAMES, is_open))
            }
        });
        Ok(())
    }

    /// Whether a thread team can share the work of any of its units.
    fn has_shared_unit(&self) -> bool {
        self.units.iter().any(RunningUnit::can_share_work)
    }

    /// Advances every unit by `n_frames` frames, after `frames_done` frames of the simulation, and leaves the sum of
    /// their sounds in `output_sums`.
    pub(super) fn run(&mut self, plan: &Plan, (frames_done, n_frames): (u64, usize)) -> Option<Fault> {
        let outputs = &self.outputs[..];
        let n_out = outputs.len();
        let group_sum = &mut self.output_sums[..n_out * n_frames];
        group_sum.fill(0.0);
        let mut first_fault: Option<Fault> = None;
        let sourced_units = self.units.iter_mut().zip(&mut self.sources);
        for ((running_unit, source), unit) in sourced_units.zip(&plan.units[self.first_unit..]) {
            let thread_count = if running_unit.can_share_work() {
                self.team_size
            } else {
                1
            };
            let new_fault = ThreadTeam::with_threads(thread_count, |team| {
                (0..n_frames).step_by(UNIT_BLOCK_FRAMES).find_map(|first_frame| {
                    interrupt::poll();
                    let n_frames = UNIT_BLOCK_FRAMES.min(n_frames - first_frame);
                    let unit_output = &mut group_sum[n_out * first_frame..n_out * (first_frame + n_frames)];
                    running_unit.process(
                        (unit, source),
                        &mut self.island_sound,
                        unit_output,
                        (outputs, frames_done + first_frame as u64, n_frames),
                        team,
                    )
                })
            });
            let is_first = |new: &Fault| first_fault.as_ref().is_none_or(|old| new.frame < old.frame);
            first_fault = new_fault.filter(is_first).or(first_fault);
        }
        first_fault
    }

    /// Adds the sum that `run` has left to all outputs of the scene (n_frames · n_out).
    pub(super) fn add_sums_to(&self, out: &mut [f64], n_out: usize) {
        if self.outputs.len() == n_out {
            out.iter_mut()
                .zip(&self.output_sums)
                .for_each(|(out, sound)| *out += sound);
        } else if !self.outputs.is_empty() {
            let frames = out.chunks_exact_mut(n_out);
            for (frame, sounds) in frames.zip(self.output_sums.chunks_exact(self.outputs.len())) {
                for (&output, sound) in self.outputs.iter().zip(sounds) {
                    frame[output as usize] += sound;
                }
            }
        }
    }
}

impl RunningUnit {
    /// Advances by at most UNIT_BLOCK_FRAMES frames, after `frames_done` frames of the simulation, and adds the sound
    /// to `out` (n_frames · n_out); `sound` is a buffer for the unit's own outputs.
    fn process(
        &mut self,
        (unit, source): (&ComputationUnit, &mut SoundSource),
        sound: &mut [f64],
        out: &mut [f64],
        (outputs, frames_done, n_frames): (&[u32], u64, usize),
        team: &mut ThreadTeam<'_>,
    ) -> Option<Fault> {
        match (self, unit) {
            (Self::Bank(bank), _) => {
                bank.process(out, (outputs.len(), n_frames), |output| output_column(outputs, output));
            }
            (Self::Island(_), _) if matches!(source, SoundSource::Skipped) => {}
            (Self::Island(island), ComputationUnit::IslandPlan(island_plan)) => {
                let n_island_out = island.n_out();
                let n_frames = island.due_frames(frames_done, n_frames);
                let sound = &mut sound[..n_island_out * n_frames];
                if !source.recall(sound) {
                    if let Err(fault) = island.process(sound, n_frames, team) {
                        return Some(fault.in_scene(island));
                    }
                    source.record(sound);
                }
                if !island.is_decimated() {
                    add_island_sound(sound, n_island_out, island_plan, out, outputs);
                }
            }
            (Self::Island(_), ComputationUnit::Bank(_)) => {}
        }
        None
    }

    /// Number of its steps in a frame of the scene.
    pub(super) fn steps_per_frame(&self) -> f64 {
        match self {
            Self::Island(island) => island.steps_per_frame(),
            Self::Bank(_) => 1.0,
        }
    }

    /// Whether a thread team can share its work.
    fn can_share_work(&self) -> bool {
        matches!(self, Self::Island(island) if island.can_share_work())
    }
}

/// Give groups with large meshes a thread team, if that is quicker than one thread for each group.
pub(super) fn assign_teams(groups: &mut [Group], plan: &Plan, threads: usize) {
    // A helper without a processor of its own would keep the others waiting: no more threads than processors.
    let processor_count = std::thread::available_parallelism().map_or(1, usize::from);
    let team_size = threads.min(processor_count);
    let cost_of_group = |group: &Group| -> f64 {
        let group_units = &plan.units[group.first_unit..][..group.units.len()];
        group_units.iter().map(ComputationUnit::cost).sum()
    };
    // Time of groups in parallel: that of the most expensive one, or the sum divided by the threads, if that is longer.
    let time_in_parallel = |costs: &[f64]| {
        let greatest_cost = costs.iter().copied().fold(0.0, f64::max);
        greatest_cost.max(costs.iter().sum::<f64>() / team_size as f64)
    };
    let (mut all_costs, mut shared_cost, mut single_costs) = (Vec::new(), 0.0, Vec::new());
    for group in &*groups {
        let group_cost = cost_of_group(group);
        all_costs.push(group_cost);
        if group.has_shared_unit() {
            shared_cost += group_cost;
        } else {
            single_costs.push(group_cost);
        }
    }
    let team_time = shared_cost / (1.0 + TEAM_EFFICIENCY * (team_size - 1) as f64) + time_in_parallel(&single_costs);
    if team_size > 1 && team_time < time_in_parallel(&all_costs) {
        for group in groups {
            if group.has_shared_unit() {
                group.team_size = team_size;
            }
        }
    }
}

/// Run every group, each by the next thread that is free.
pub(super) fn run_on_threads(
    groups: Vec<&mut Group>,
    threads: usize,
    run: &(impl Fn(&mut Group) -> Option<Fault> + Sync),
) -> Vec<Fault> {
    let remaining_groups = Mutex::new(groups.into_iter());
    let faults = Mutex::new(Vec::new());
    let run_remaining = || {
        // The lock is poisoned only if a thread panicked; the scope passes the panic on.
        while let Some(group) = remaining_groups.lock().ok().and_then(|mut groups| groups.next()) {
            if let Some(fault) = run(group)
                && let Ok(mut faults) = faults.lock()
            {
                faults.push(fault);
            }
        }
    };
    interrupt::on_threads(threads, run_remaining);
    faults.into_inner().unwrap_or_default()
}

/// The outputs that hear a unit.
fn outputs_of(unit: &ComputationUnit) -> Vec<u32> {
    match unit {
        ComputationUnit::Bank(bank) => {
            let weights = bank.oscillators.iter().flat_map(|oscillator| &oscillator.outputs);
            let outputs: BTreeSet<u32> = weights.map(|&(output, _)| output).collect();
            Vec::from_iter(outputs)
        }
        ComputationUnit::IslandPlan(island_plan) => island_plan.scene_outputs().map(|output| output as u32).collect(),
    }
}

/// The place of an output among those that hear a group.
fn output_column(outputs: &[u32], output: u32) -> usize {
    outputs.partition_point(|&other| other < output)
}

/// Add an island's sound (n_frames · own) to the outputs that hear it (n_frames · n_out).
fn add_island_sound(sound: &[f64], n_island_out: usize, island_plan: &IslandPlan, out: &mut [f64], outputs: &[u32]) {
    if outputs.is_empty() || n_island_out == 0 {
        return;
    }
    for (local, output) in island_plan.scene_outputs().enumerate() {
        let column = output_column(outputs, output as u32);
        let frames = out.chunks_exact_mut(outputs.len());
        for (frame, samples) in frames.zip(sound.chunks_exact(n_island_out)) {
            frame[column] += samples[local];
        }
    }
}
