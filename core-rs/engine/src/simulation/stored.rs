//! Stretches of islands that another run has computed: their sound, and the state at their end.
//!
//! Islands do not touch each other, so a render need not compute an island again if its events did not change: it
//! recalls the sound of one stretch after the other, and continues from the state at the end of the last known stretch.
//! The samples are those of a render from frame 0. Banks are always computed: reading them would cost more.

mod keys;

use super::Simulation;
use super::group::{Group, RunningUnit, SoundSource, UNIT_BLOCK_FRAMES};
use crate::archive::Damaged;
use crate::assembly::unit::ComputationUnit;
use crate::interrupt;
use crate::island::{Fault, Island};
use crate::kernel::thread_team::{ThreadTeam, with_denormals_flushed};
pub(super) use keys::UnitContents;

/// An island whose stretches can be stored.
#[derive(Clone, Debug)]
pub struct StorableIsland {
    unit: usize,
    /// Number of outputs that hear it.
    pub n_out: usize,
    /// Work by the table of costs [ns a frame].
    pub cost: f64,
}

impl Simulation {
    /// The islands that are heard and whose stretches can be stored; none if ledgers or streams of ergons are kept.
    pub fn storable(&self) -> Vec<StorableIsland> {
        let indexed_units = self.units().enumerate();
        let islands = indexed_units.filter_map(|(unit, unit_and_plan)| match unit_and_plan {
            (RunningUnit::Island(island), ComputationUnit::IslandPlan(_))
                if unit < self.plan.n_heard_units && island.is_storable() =>
            {
                Some(StorableIsland {
                    unit,
                    n_out: island.n_out(),
                    cost: unit_and_plan.1.cost(),
                })
            }
            _ => None,
        });
        islands.collect()
    }

    /// A hash of everything that determines an island up to the last of `frames` (64 hex digits); `previous_key` is the
    /// hash up to the first of `frames`, or empty if that is 0.
    pub fn island_key(&self, island: &StorableIsland, frames: (u64, u64), previous_key: &str) -> String {
        self.unit_key(island.unit, frames, previous_key)
    }

    /// From here on, take the sound of an island from `sound` (n_frames · its n_out) instead of computing it; the
    /// island's state does not change meanwhile.
    pub fn recall_sound(&mut self, island: &StorableIsland, sound: Vec<f64>) {
        *self.sound_source(island) = SoundSource::Recalled(sound, 0);
    }

    /// From here on, do not compute an island, which is silent, until [`Simulation::set_state`].
    pub fn silence(&mut self, island: &StorableIsland) {
        *self.sound_source(island) = SoundSource::Skipped;
    }

    /// From here on, compute an island and keep its sound.
    pub fn record_sound(&mut self, island: &StorableIsland) {
        *self.sound_source(island) = SoundSource::Recorded(Vec::new());
    }

    /// The sound of an island since [`Simulation::record_sound`] (n_frames · its n_out), and its state now.
    pub fn take_recording(&mut self, island: &StorableIsland) -> (Vec<f64>, Vec<u8>) {
        let sound_source = std::mem::replace(self.sound_source(island), SoundSource::Computed);
        let recorded_sound = match sound_source {
            SoundSource::Recorded(recorded_sound) => recorded_sound,
            SoundSource::Computed | SoundSource::Recalled(..) | SoundSource::Skipped => Vec::new(),
        };
        let island_state = self.island_mut(island).map_or_else(Vec::new, Island::write_state);
        (recorded_sound, island_state)
    }

    /// Put an island into the state that an equal one had at this frame, and compute it from here on.
    ///
    /// # Errors
    /// [`Damaged`] if the bytes are not a state of this island; the simulation must then be discarded.
    pub fn set_state(&mut self, island: &StorableIsland, state: &[u8]) -> Result<(), Damaged> {
        *self.sound_source(island) = SoundSource::Computed;
        self.island_mut(island).ok_or(Damaged)?.read_state(state)
    }

    /// Computes the next frames of one island alone (n_frames · its n_out), for a worker on another machine. Set the
    /// state before them by [`Simulation::set_state`], and read the state after them by [`Simulation::take_recording`].
    ///
    /// # Errors
    /// [`Fault`] with the part that becomes non-finite.
    pub fn advance_island(&mut self, island: &StorableIsland, n_frames: usize) -> Result<Vec<f64>, Fault> {
        let n_threads = self.threads;
        let Some(running_island) = self.island_mut(island) else {
            return Ok(Vec::new());
        };
        let n_outputs = running_island.n_out();
        let thread_count = if running_island.can_share_work() { n_threads } else { 1 };
        let mut island_sound = vec![0.0; n_outputs * n_frames];
        with_denormals_flushed(|| {
            ThreadTeam::with_threads(thread_count, |team| {
                (0..n_frames).step_by(UNIT_BLOCK_FRAMES).try_for_each(|first_frame| {
                    interrupt::poll();
                    let n_frames = UNIT_BLOCK_FRAMES.min(n_frames - first_frame);
                    let block_output = &mut island_sound[n_outputs * first_frame..n_outputs * (first_frame + n_frames)];
                    running_island.process(block_output, n_frames, team)
                })
            })
        })
        .map_err(|fault| fault.in_scene(running_island))?;
        Ok(island_sound)
    }

    fn group_and_index(&mut self, unit: usize) -> (&mut Group, usize) {
        let group_index = self.groups.partition_point(|group| group.first_unit <= unit) - 1;
        let group = &mut self.groups[group_index];
        let unit_index = unit - group.first_unit;
        (group, unit_index)
    }

    fn sound_source(&mut self, island: &StorableIsland) -> &mut SoundSource {
        let (group, unit_index) = self.group_and_index(island.unit);
        &mut group.sources[unit_index]
    }

    fn island_mut(&mut self, island: &StorableIsland) -> Option<&mut Island> {
        let (group, unit_index) = self.group_and_index(island.unit);
        match &mut group.units[unit_index] {
            RunningUnit::Island(island) => Some(island),
            RunningUnit::Bank(_) => None,
        }
    }
}
