//! Simulation of a plan: its islands and banks, whose outputs are summed in a fixed order.
//!
//! In one thread a step does not allocate (but for a recorded stream of ergons), lock or panic. The bytes depend
//! neither on the number of threads nor on the size of blocks.

mod bodies;
mod group;
mod look;
mod reports;
mod response;
mod side;
mod sounds_in;
mod stored;
mod takeover;

use std::sync::Arc;

use crate::assembly::unit::{ComputationUnit, IslandPlan, to_network_index};
use crate::derivative::{self, Derivatives};
use crate::interrupt;
use crate::island::Island;
use crate::kernel::thread_team::with_denormals_flushed;
use crate::network::{Error, Network};
use crate::plan::Plan;
use crate::timeline::Timeline;

pub use crate::archive::Damaged;
pub use crate::island::{EmulatedKey, Energy, ErgonRecord, Fault, KeyMotor, OnFault, SimulationOptions};
pub use look::{
    ContactPush, MotionLook, MotionSnapshot, Oscillation, PointMotion, VisibleBody, VisibleContact, VisiblePoint,
};
pub use stored::StorableIsland;
pub use takeover::Takeover;

use group::{GROUPS_MAX, Group, RunningUnit, THREADED_BLOCK_FRAMES, UNIT_BLOCK_FRAMES};

/// Least work that a frame adds to the counter of interruptions; trials count work by the table of costs.
const INTERRUPT_STEPS_PER_FRAME: usize = 16;

/// A running simulation of a plan.
#[derive(Clone, Debug)]
pub struct Simulation {
    plan: Arc<Plan>,
    groups: Vec<Group>,
    unit_contents: stored::UnitContents,
    threads: usize,
    frame: u64,
    derivatives: Derivatives,
    sounds_in: sounds_in::SoundsIn,
    /// Room for the outputs of the last skipped frames, which differentiated outputs need.
    skipped_frame_outputs: Vec<f64>,
}

/// The complete state of a simulation at one frame; see [`Simulation::restore`].
///
/// ```
/// # use std::sync::Arc;
/// # use ergon_engine::network::{Term, Tie};
/// # use ergon_engine::{Network, Rate, Timeline};
/// # let mut network = Network::new();
/// # let bell = network.cel("bell", 0.002, Tie::Tuned { f: 440.0, t60: Some(1.0) }, 0.0, 0.0, 0.0)?;
/// # network.listen("bell", vec![Term::Position { first: bell, len: 1, weight: 1.0 }])?;
/// # let mut timeline = Timeline::new(Rate::new(44_100.0)?);
/// # timeline.strike(&network, bell, 0.0, 1e-3, None, 0)?;
/// # let network = Arc::new(network);
/// # use ergon_engine::{OnFault, SimulationOptions};
/// # let options = SimulationOptions { keeps_ledger: false, records_ergons: false,
/// # on_fault: OnFault::Stop, threads: 1, is_unchecked:
/// false }; use ergon_engine::Simulation;
///
/// let mut simulation = Simulation::new(network, &timeline, options)?;
/// let start = simulation.snapshot();
/// let (mut once, mut again) = (vec![0.0; 1000], vec![0.0; 1000]);
/// simulation.process(&mut once)?;
/// simulation.restore(&start);
/// simulation.process(&mut again)?;
/// assert_eq!(once, again);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Snapshot(Box<Simulation>);

impl Simulation {
    /// A simulation at frame 0 that steps every module by the CA scheme, without a plan.
    ///
    /// # Errors
    /// [`Error`] if a part of the network is unstable or a method cannot step it.
    pub fn new(network: Arc<Network>, timeline: &Timeline, options: SimulationOptions) -> Result<Self, Error> {
        let plain_plan = Plan::plain(network, timeline, options.is_unchecked)?;
        Self::from_plan(Arc::new(plain_plan), options)
    }

    /// A simulation of a plan, at frame 0.
    ///
    /// # Errors
    /// [`Error`] if a part of the network is unstable or a method cannot step it.
    pub fn from_plan(plan: Arc<Plan>, options: SimulationOptions) -> Result<Self, Error> {
        let n_outputs = plan.network.outputs().len();
        let block_frames = if options.threads > 1 {
            THREADED_BLOCK_FRAMES
        } else {
            UNIT_BLOCK_FRAMES
        };
        let mut groups = Vec::new();
        for range in plan.groups(GROUPS_MAX) {
            // A fault in a unit that no output hears does not stop the simulation.
            let on_fault = if range.start < plan.n_heard_units {
                options.on_fault
            } else {
                OnFault::Mute
            };
            let options = SimulationOptions { on_fault, ..options };
            groups.push(Group::new(&plan, range, block_frames, options)?);
        }
        let threads = options.threads.max(1);
        group::assign_teams(&mut groups, &plan, threads);
        let derivatives = Derivatives::new(&plan.network, plan.timeline_rate.hertz());
        let history_frames = if derivatives.is_empty() { 0 } else { derivative::SPAN };
        let sounds_in = sounds_in::SoundsIn::new(&plan);
        Ok(Self {
            unit_contents: stored::UnitContents::new(&plan),
            plan,
            groups,
            sounds_in,
            threads,
            frame: 0,
            derivatives,
            skipped_frame_outputs: vec![0.0; history_frames * n_outputs],
        })
    }

    /// A simulation of a plan, at frame `start_frame` of its timeline. Events before `start_frame` are skipped; modules
    /// have their initial state, unless a state is transferred by [`Simulation::take_over`].
    ///
    /// # Errors
    /// [`Error`] if a part of the network is unstable or a method cannot step it.
    pub fn from_plan_at_frame(plan: Arc<Plan>, options: SimulationOptions, start_frame: u64) -> Result<Self, Error> {
        let mut simulation = Self::from_plan(plan, options)?;
        if start_frame > 0 {
            simulation.frame = start_frame;
            for running_unit in simulation.groups.iter_mut().flat_map(|group| &mut group.units) {
                match running_unit {
                    RunningUnit::Island(island) => island.seek(start_frame),
                    RunningUnit::Bank(bank) => bank.seek(start_frame),
                }
            }
        }
        Ok(simulation)
    }

    /// All running units with their plans.
    fn units(&self) -> impl Iterator<Item = (&RunningUnit, &ComputationUnit)> {
        let running_units = self.groups.iter().flat_map(|group| &group.units);
        running_units.zip(&self.plan.units)
    }

    /// All islands with their plans.
    fn islands(&self) -> impl Iterator<Item = (&Island, &IslandPlan)> {
        self.units().filter_map(|pair| match pair {
            (RunningUnit::Island(island), ComputationUnit::IslandPlan(island_plan)) => {
                Some((&**island, &**island_plan))
            }
            _ => None,
        })
    }

    /// Number of outputs.
    pub fn n_out(&self) -> usize {
        self.plan.network.outputs().len()
    }

    /// Frames computed so far, counted from frame 0 of the timeline.
    pub fn frame(&self) -> u64 {
        self.frame
    }

    /// Frames a second [Hz].
    pub fn rate(&self) -> f64 {
        self.plan.timeline_rate.hertz()
    }

    /// Fill `out` with outputs [m or N], frame by frame, (n_frames · n_out).
    ///
    /// # Errors
    /// [`Fault`] with the first part that becomes non-finite, unless faults are muted.
    pub fn process(&mut self, out: &mut [f64]) -> Result<(), Fault> {
        let n_outputs = self.n_out().max(1);
        out.chunks_mut(self.block_limit() * n_outputs)
            .try_for_each(|out| self.advance_with_derivatives(out, out.len() / n_outputs))
    }

    /// [`Simulation::advance_groups`], followed by the differentiation of the outputs that hear rates of change.
    fn advance_with_derivatives(&mut self, out: &mut [f64], n_frames: usize) -> Result<(), Fault> {
        self.advance_groups(out, n_frames)?;
        let n_outputs = self.n_out();
        self.derivatives.process(out, n_outputs);
        Ok(())
    }

    /// Advance by `n_frames` frames without outputs.
    ///
    /// # Errors
    /// [`Fault`] with the first part that becomes non-finite, unless faults are muted.
    pub fn skip(&mut self, n_frames: u64) -> Result<(), Fault> {
        let n_outputs = self.n_out().max(1);
        let final_frames = n_frames.min((self.skipped_frame_outputs.len() / n_outputs) as u64);
        let mut frames_left = n_frames - final_frames;
        while frames_left > 0 {
            let block_frames = frames_left.min(self.block_limit() as u64);
            self.advance_groups(&mut [], block_frames as usize)?;
            frames_left -= block_frames;
        }
        let mut skipped_outputs = std::mem::take(&mut self.skipped_frame_outputs);
        let process_result = self.process(&mut skipped_outputs[..final_frames as usize * n_outputs]);
        self.skipped_frame_outputs = skipped_outputs;
        process_result
    }

    fn block_limit(&self) -> usize {
        if self.threads > 1 {
            THREADED_BLOCK_FRAMES
        } else {
            UNIT_BLOCK_FRAMES
        }
    }

    /// Advance every group by `n_frames` frames. Of several faults the one with the first frame is returned.
    fn advance_groups(&mut self, out: &mut [f64], n_frames: usize) -> Result<(), Fault> {
        interrupt::spend(INTERRUPT_STEPS_PER_FRAME * n_frames);
        let plan = &*self.plan;
        let n_outputs = plan.network.outputs().len();
        let frame_span = (self.frame, n_frames);
        let run_group = |group: &mut Group| with_denormals_flushed(|| group.run(plan, frame_span));
        let faults: Vec<Fault> = if self.threads == 1 {
            self.groups.iter_mut().filter_map(run_group).collect()
        } else {
            let (team_groups, single_groups): (Vec<_>, Vec<_>) =
                self.groups.iter_mut().partition(|group| group.team_size > 1);
            let mut faults: Vec<Fault> = team_groups.into_iter().filter_map(run_group).collect();
            faults.extend(group::run_on_threads(single_groups, self.threads, &run_group));
            faults
        };
        let fault = faults.into_iter().min_by_key(|fault| fault.frame);
        for frame in out.chunks_exact_mut(n_outputs.max(1)) {
            frame.copy_from_slice(&plan.output_offsets);
        }
        let groups = self.groups.iter();
        let sounding_groups = groups.filter(|group| group.first_unit < plan.n_heard_units);
        sounding_groups.for_each(|group| group.add_sums_to(out, n_outputs));
        self.frame = match &fault {
            Some(fault) => fault.frame,
            None => self.frame + n_frames as u64,
        };
        fault.map_or(Ok(()), Err)
    }

    /// Positions now [m], (n_mat); NaN for MATs that the plan does not compute.
    pub fn positions(&self) -> Vec<f64> {
        let mut x = self.mat_values(|x, _| x, Island::positions);
        for (island, island_plan) in self.islands() {
            let frames_ahead = island.frames_ahead(self.frame);
            let steps = f64::from(frames_ahead) * island.steps_per_frame();
            let steps = island.backward_steps().iter().map(|step| steps * step);
            for (local, step) in steps.enumerate().filter(|_| frames_ahead > 0) {
                x[to_network_index(&island_plan.network_indices.mats, local)] -= step;
            }
        }
        x
    }

    /// Displacements over the last frame, x[n] − x[n−1] [m], (n_mat); NaN for MATs that the plan does not compute. For
    /// an island whose step is not one frame: its last step times its number of steps a frame.
    pub fn steps(&self) -> Vec<f64> {
        let mut steps = self.mat_values(|x, previous_position| x - previous_position, Island::backward_steps);
        for (island, island_plan) in self.islands() {
            let frame_steps = island.steps_per_frame();
            for local in (0..island.backward_steps().len()).filter(|_| frame_steps != 1.0) {
                steps[to_network_index(&island_plan.network_indices.mats, local)] *= frame_steps;
            }
        }
        steps
    }

    fn mat_values(&self, bank_value: fn(f64, f64) -> f64, island_values: fn(&Island) -> &[f64]) -> Vec<f64> {
        let mut mat_values = vec![f64::NAN; self.plan.network.n_mat()];
        for (running_unit, unit) in self.units() {
            match (running_unit, unit) {
                (RunningUnit::Island(island), ComputationUnit::IslandPlan(island_plan)) => {
                    for (local, &value) in island_values(island).iter().enumerate() {
                        mat_values[to_network_index(&island_plan.network_indices.mats, local)] = value;
                    }
                }
                (RunningUnit::Bank(bank), ComputationUnit::Bank(plan)) => {
                    for (oscillator, &(mat, rest)) in plan.mats_and_rests.iter().enumerate() {
                        let (displacement, displacement_before) = bank.motion(oscillator);
                        mat_values[mat as usize] = bank_value(displacement + rest, displacement_before + rest);
                    }
                }
                _ => {}
            }
        }
        mat_values
    }

    /// Position that the gesture of each key requires now [m], (n_keys); NaN for keys without a running gesture.
    pub fn gesture_positions(&self) -> Vec<f64> {
        let mut requested_positions = vec![f64::NAN; self.plan.n_keys];
        self.write_gesture_positions(&mut requested_positions);
        requested_positions
    }

    /// [`Simulation::gesture_positions`] without allocating.
    fn write_gesture_positions(&self, positions: &mut [f64]) {
        positions.fill(f64::NAN);
        for (island, island_plan) in self.islands() {
            island.report_gesture_positions(|local, requested_position, is_layer| {
                let key_position = &mut positions[to_network_index(&island_plan.network_indices.keys, local)];
                *key_position = if is_layer {
                    *key_position + requested_position
                } else {
                    requested_position
                };
            });
        }
    }

    /// Set the position of a real hand from the next tick on [m]. Before the first call, the hand follows the timeline.
    ///
    /// `step`: the movement in the last frame of the tick [m], from a device that knows it exactly; `None`: the
    /// difference between the two ticks.
    pub fn set_hand_position(&mut self, hand: usize, x: f64, last_step: Option<f64>) {
        for running_unit in self.groups.iter_mut().flat_map(|group| &mut group.units) {
            if let RunningUnit::Island(island) = running_unit {
                island.set_hand_position(hand, x, last_step);
            }
        }
    }

    /// Strike a point of [`Timeline::add_strike_point`] by an impulse [N·s] at the next frame; false if there is no
    /// such point. Impulses of one frame add up.
    pub fn strike(&mut self, point: u32, impulse: f64) -> bool {
        let mut has_point = false;
        for running_unit in self.groups.iter_mut().flat_map(|group| &mut group.units) {
            if let RunningUnit::Island(island) = running_unit {
                has_point |= island.strike_point(point, impulse);
            }
        }
        has_point
    }

    /// Mean force of the scene on a real hand over the last complete tick [N]; positive towards +x.
    pub fn hand_force(&self, hand: usize) -> f64 {
        self.islands().map(|(island, _)| island.hand_force(hand)).sum()
    }

    /// From this frame on, damp everything with a decay time of `t60` [s] in addition to its own damping (the
    /// reciprocals of decay times add). `None`, or a time that is not above 0, ends the additional damping. The free
    /// copies of keys are not damped.
    ///
    /// ```
    /// # use std::sync::Arc;
    /// # use ergon_engine::network::{Term, Tie};
    /// # use ergon_engine::{Network, Rate, Timeline};
    /// # let mut network = Network::new();
    /// # let bell = network.cel("bell", 0.002, Tie::Tuned { f: 440.0, t60: Some(1.0) }, 0.0, 0.0, 0.0)?;
    /// # network.listen("bell", vec![Term::Position { first: bell, len: 1, weight: 1.0 }])?;
    /// # let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// # timeline.strike(&network, bell, 0.0, 1e-3, None, 0)?;
    /// # let network = Arc::new(network);
    /// # use ergon_engine::{OnFault, SimulationOptions};
    /// # let options = SimulationOptions { keeps_ledger: false, records_ergons: false,
    /// # on_fault: OnFault::Stop, threads: 1,
    /// is_unchecked: false }; use ergon_engine::Simulation;
    ///
    /// let mut simulation = Simulation::new(network, &timeline, options)?;
    /// simulation.damp(Some(0.05)); // everything fades by 60 dB in 50 ms
    /// let mut sound = vec![0.0; 44_100];
    /// simulation.process(&mut sound)?;
    /// let peak = |part: &[f64]| part.iter().fold(0.0_f64, |peak, x| peak.max(x.abs()));
    /// assert!(peak(&sound[22_050..]) < 1e-3 * peak(&sound[..441]));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn damp(&mut self, t60: Option<f64>) {
        let t60 = t60.filter(|t60| t60.is_finite() && *t60 > 0.0);
        let fall_per_frame = t60.map_or(0.0, |t60| crate::units::LN_1000 / (t60 * self.rate()));
        for running_unit in self.groups.iter_mut().flat_map(|group| &mut group.units) {
            match running_unit {
                RunningUnit::Island(island) => {
                    let step_factor = crate::maths::exp(-fall_per_frame / island.steps_per_frame());
                    island.damp(step_factor);
                }
                RunningUnit::Bank(bank) => bank.damp(crate::maths::exp(-fall_per_frame)),
            }
        }
    }

    /// Name of a MAT as the composer wrote it.
    pub fn mat_name(&self, mat: usize) -> String {
        self.plan.network.mat_name(mat)
    }

    /// The complete state at this frame.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot(Box::new(self.clone()))
    }

    /// Return to a state of this simulation.
    pub fn restore(&mut self, snapshot: &Snapshot) {
        *self = snapshot.0.fork();
    }

    /// An independent copy at the same frame, which steps without allocating.
    ///
    /// ```
    /// # use std::sync::Arc;
    /// # use ergon_engine::network::{Term, Tie};
    /// # use ergon_engine::{Network, Rate, Timeline};
    /// # let mut network = Network::new();
    /// # let bell = network.cel("bell", 0.002, Tie::Tuned { f: 440.0, t60: Some(1.0) }, 0.0, 0.0, 0.0)?;
    /// # network.listen("bell", vec![Term::Position { first: bell, len: 1, weight: 1.0 }])?;
    /// # let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// # timeline.strike(&network, bell, 0.0, 1e-3, None, 0)?;
    /// # let network = Arc::new(network);
    /// # use ergon_engine::{OnFault, SimulationOptions};
    /// # let options = SimulationOptions { keeps_ledger: false, records_ergons: false,
    /// # on_fault: OnFault::Stop, threads: 1,
    /// is_unchecked: false }; use ergon_engine::Simulation;
    ///
    /// let mut one = Simulation::new(network, &timeline, options)?;
    /// let mut other = one.fork();
    /// other.skip(100)?;
    /// assert_eq!((one.frame(), other.frame()), (0, 100));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn fork(&self) -> Self {
        let mut fork_copy = self.clone();
        for running_unit in fork_copy.groups.iter_mut().flat_map(|group| &mut group.units) {
            if let RunningUnit::Island(island) = running_unit {
                island.reserve();
            }
        }
        fork_copy
    }
}
