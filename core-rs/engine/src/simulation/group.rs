//! Units of a plan whose sounds are added up together; which threads compute them.

use std::ops::Range;
use std::sync::Mutex;

use crate::bank::Bank;
use crate::island::{Fault, Island, Options};
use crate::kernel::thread_team::ThreadTeam;
use crate::network::Error;
use crate::plan::{IslandPlan, Plan, Unit, whole};
use crate::units::Rate;

/// Frames that a unit advances before its output is added: its state stays in the cache.
pub(super) const STRETCH: usize = 256;
/// Frames that a group advances where threads share the work: starting the threads costs little beside it.
pub(super) const LONG: usize = 4_096;
/// Largest number of groups, whatever the number of threads; banks of large parts may add some.
pub(super) const GROUPS: usize = 16;
/// Part of a helper's time that is gained where a team computes one mesh.
const HELP: f64 = 0.7;

/// Units whose sound is added up together, in the order of the plan.
#[derive(Clone, Debug)]
pub(super) struct Group {
    /// Index of the first in the plan.
    pub(super) first: usize,
    pub(super) units: Vec<RunningUnit>,
    /// Of each unit, whether its sound is kept or known   (n_units)
    pub(super) sources: Vec<SoundSource>,
    /// Threads that compute its large meshes together.
    pub(super) team: usize,
    /// (STRETCH or LONG · n_out)
    pub(super) sum: Vec<f64>,
    /// One island's   (STRETCH · its n_out)
    sound: Vec<f64>,
}

/// Where the sound of a unit comes from.
#[derive(Clone, Debug)]
pub(super) enum SoundSource {
    /// It is computed.
    Computed,
    /// It is computed, and kept here   (n_frames · its n_out)
    Recorded(Vec<f64>),
    /// It is known from an earlier run: these frames, from this sample on; nothing of the unit moves.
    Recalled(Vec<f64>, usize),
}

impl SoundSource {
    /// The next frames, where they are known and there are so many.
    fn recall(&mut self, sound: &mut [f64]) -> bool {
        let Self::Recalled(known, at) = self else {
            return false;
        };
        let Some(next) = known.get(*at..*at + sound.len()) else {
            return false;
        };
        sound.copy_from_slice(next);
        *at += sound.len();
        true
    }

    fn keep(&mut self, sound: &[f64]) {
        if let Self::Recorded(kept) = self {
            kept.extend_from_slice(sound);
        }
    }
}

/// A running unit of a plan.
#[derive(Clone, Debug)]
pub(super) enum RunningUnit {
    Island(Box<Island>),
    Bank(Bank),
}

impl Group {
    /// The units `range` of a plan, at frame 0, with room for `room` samples of their sum.
    pub(super) fn new(
        plan: &Plan,
        range: Range<usize>,
        room: usize,
        options: Options,
    ) -> Result<Self, Error> {
        let mut group = Self {
            first: range.start,
            team: 1,
            units: Vec::with_capacity(range.len()),
            sources: vec![SoundSource::Computed; range.len()],
            sum: vec![0.0; room],
            sound: Vec::new(),
        };
        for unit in &plan.units[range] {
            group.add(unit, plan.timeline_rate, options)?;
        }
        Ok(group)
    }

    fn add(&mut self, unit: &Unit, rate: Rate, options: Options) -> Result<(), Error> {
        self.units.push(match unit {
            Unit::IslandPlan(island_plan) => {
                let IslandPlan {
                    network,
                    timeline,
                    bodies,
                    contact_substeps,
                    oversampling,
                    every,
                    ..
                } = &**island_plan;
                let often = (*contact_substeps, *oversampling, *every);
                let island = Island::new(network.clone(), timeline, bodies, often, options)?;
                let room = island.n_out() * STRETCH;
                self.sound.resize(self.sound.len().max(room), 0.0);
                RunningUnit::Island(Box::new(island))
            }
            Unit::Bank(bank) => {
                let strikes = bank.strikes.clone();
                let (own, is_open) = (&bank.oscillators, bank.is_open);
                RunningUnit::Bank(Bank::new(own, strikes, rate, STRETCH, is_open))
            }
        });
        Ok(())
    }

    /// Whether a thread team can share the work of any of its units.
    fn has_shared(&self) -> bool {
        self.units.iter().any(RunningUnit::is_shared)
    }

    /// Every unit through `n_frames` frames after the first `done`, their sound into `sum`.
    pub(super) fn run(
        &mut self,
        plan: &Plan,
        n_out: usize,
        (done, n_frames): (u64, usize),
    ) -> Option<Fault> {
        let sum = &mut self.sum[..n_out * n_frames];
        sum.fill(0.0);
        let mut fault: Option<Fault> = None;
        let units = self.units.iter_mut().zip(&mut self.sources);
        for ((running, source), unit) in units.zip(&plan.units[self.first..]) {
            let team = if running.is_shared() { self.team } else { 1 };
            let found = ThreadTeam::with(team, |team| {
                (0..n_frames).step_by(STRETCH).find_map(|from| {
                    let n_frames = STRETCH.min(n_frames - from);
                    let out = &mut sum[n_out * from..n_out * (from + n_frames)];
                    running.process(
                        (unit, source),
                        &mut self.sound,
                        out,
                        (n_out, done + from as u64, n_frames),
                        team,
                    )
                })
            });
            let is_first = |new: &Fault| fault.as_ref().is_none_or(|old| new.frame < old.frame);
            fault = found.filter(is_first).or(fault);
        }
        fault
    }
}

impl RunningUnit {
    /// A few frames after the first `done`, added to `out` (n_frames · n_out); `sound` is room for its own.
    fn process(
        &mut self,
        (unit, source): (&Unit, &mut SoundSource),
        sound: &mut [f64],
        out: &mut [f64],
        (n_out, done, n_frames): (usize, u64, usize),
        team: &mut ThreadTeam<'_>,
    ) -> Option<Fault> {
        match (self, unit) {
            (Self::Bank(bank), _) => bank.process(out, n_out, n_frames),
            (Self::Island(island), Unit::IslandPlan(island_plan)) => {
                let own = island.n_out();
                let n_frames = island.due_frames(done, n_frames);
                let sound = &mut sound[..own * n_frames];
                if !source.recall(sound) {
                    if let Err(fault) = island.process(sound, n_frames, team) {
                        return Some(fault.in_scene(island));
                    }
                    source.keep(sound);
                }
                if !island.is_slow() {
                    add(sound, own, island_plan, out, n_out);
                }
            }
            (Self::Island(_), Unit::Bank(_)) => {}
        }
        None
    }

    /// Its steps in a frame of the scene.
    pub(super) fn steps_a_frame(&self) -> f64 {
        match self {
            Self::Island(island) => island.steps_a_frame(),
            Self::Bank(_) => 1.0,
        }
    }

    /// Whether a thread team can share its work.
    fn is_shared(&self) -> bool {
        matches!(self, Self::Island(island) if island.is_shared())
    }
}

/// Give groups with large meshes a thread team, where that is quicker than a thread for each group.
pub(super) fn assign_teams(groups: &mut [Group], plan: &Plan, threads: usize) {
    // Waiting for a helper without a processor takes long.
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let team = threads.min(processors);
    let costs = |group: &Group| -> f64 {
        let units = &plan.units[group.first..][..group.units.len()];
        units.iter().map(Unit::cost).sum()
    };
    // Time of groups in parallel: that of the dearest, or of all of them divided by the threads.
    let beside = |costs: &[f64]| {
        let longest = costs.iter().copied().fold(0.0, f64::max);
        longest.max(costs.iter().sum::<f64>() / team as f64)
    };
    let (mut all, mut large, mut small) = (Vec::new(), 0.0, Vec::new());
    for group in &*groups {
        let cost = costs(group);
        all.push(cost);
        if group.has_shared() {
            large += cost;
        } else {
            small.push(cost);
        }
    }
    let together = large / (1.0 + HELP * (team - 1) as f64) + beside(&small);
    if team > 1 && together < beside(&all) {
        for group in groups {
            if group.has_shared() {
                group.team = team;
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
    let waiting = Mutex::new(groups.into_iter());
    let faults = Mutex::new(Vec::new());
    let work = || {
        // A poisoned lock is a thread that panicked: the scope passes that on.
        while let Some(group) = waiting.lock().ok().and_then(|mut groups| groups.next()) {
            if let Some(fault) = run(group)
                && let Ok(mut faults) = faults.lock()
            {
                faults.push(fault);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work);
        }
        work();
    });
    faults.into_inner().unwrap_or_default()
}

/// Add an island's sound (n_frames · own) to the outputs that it is heard at (n_frames · n_out).
fn add(sound: &[f64], own: usize, island_plan: &IslandPlan, out: &mut [f64], n_out: usize) {
    if n_out == 0 || own == 0 {
        return;
    }
    for (frame, heard) in out.chunks_exact_mut(n_out).zip(sound.chunks_exact(own)) {
        for (local, heard) in heard.iter().enumerate() {
            frame[whole(&island_plan.to_whole.outputs, local)] += heard;
        }
    }
}
