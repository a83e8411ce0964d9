//! What can be seen of a simulation: the position of every mass, whatever method computes it.
//!
//! A [`MotionLook`] is made outside real time and lists where each number comes from; [`Simulation::write_tracks`] then
//! only copies. A free oscillator is described by its oscillation, which two frames determine; a body by the
//! oscillations of its modes; all other masses by their positions.

use std::sync::Arc;

use super::Simulation;
use super::group::RunningUnit;
use crate::assembly::unit::{ComputationUnit, to_network_index};
use crate::island::bodies::RunningBody;
use crate::island::{ErgonRecord, Island};
use crate::network::Network;
use crate::plan::Plan;
use crate::timeline::Timeline;
use crate::units::Rate;
use builder::LookBuilder;

mod builder;
mod oscillation;
mod snapshot;

pub use oscillation::Oscillation;
pub use snapshot::{ContactPush, MotionSnapshot};

/// How the motion of a point is described.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PointMotion {
    /// By a free oscillation.
    Free(Oscillation),
    /// By its positions, frame by frame.
    Sampled,
    /// By the modes of a body: its index in [`MotionLook::bodies`].
    Modal(usize),
    /// The point is not computed, because no output hears it or nothing moves it.
    NotComputed {
        /// Whether anything moves it; if so, it is not computed because no output hears it.
        is_moved: bool,
    },
}

/// A mass that can be seen.
#[derive(Clone, Debug, PartialEq)]
pub struct VisiblePoint {
    /// Its MAT in the network.
    pub mat: usize,
    /// Its part in the network.
    pub part: usize,
    /// The position from which its displacement counts [m].
    pub rest: f64,
    /// How it moves.
    pub motion: PointMotion,
}

/// A body that is computed by its modes.
#[derive(Clone, Debug, PartialEq)]
pub struct VisibleBody {
    /// The oscillation of each mode.
    pub modes: Vec<Oscillation>,
    /// Index of its first mode among the modes of all bodies.
    pub first_mode: usize,
    /// Number of its modes that the engine computes; `modes` holds the lowest of them.
    pub n_modes: usize,
    /// Its points: indices in [`MotionLook::points`], rising.
    pub points: Vec<usize>,
    /// Displacement of each point per unit of each mode   (n_points, n_modes)
    pub shapes: Vec<f64>,
}

/// A contact: a link that opens and closes.
#[derive(Clone, Debug, PartialEq)]
pub struct VisibleContact {
    /// Its name in the score.
    pub name: String,
    /// The LIA in the network.
    pub link: usize,
    /// Its two MATs; the same MAT twice if all pairs of two sets may touch.
    pub ends: (usize, usize),
}

/// What can be seen of a simulation, and where each number is found.
#[derive(Clone, Debug)]
pub struct MotionLook {
    /// Sorted by part, then by how they move, then by MAT.
    pub points: Vec<VisiblePoint>,
    /// Bodies that are computed by their modes.
    pub bodies: Vec<VisibleBody>,
    /// Contacts.
    pub contacts: Vec<VisibleContact>,
    /// LIAs of the network that may break, rising.
    pub breakable_links: Vec<usize>,
    plan: Arc<Plan>,
    n_modes: usize,
    sources: Vec<(usize, TrackSource)>,
    /// By unit: for each LIA of the island, its index in `contacts`, if it has one.
    contacts_by_unit: Vec<(usize, Vec<Option<u32>>)>,
    /// Units in which written gestures play, each with the map from its MATs to those of the network (`None`: the
    /// same).
    gestures_by_unit: Vec<(usize, Option<Vec<u32>>)>,
    /// By unit: the LIAs of the island that may break, each with its index in `breakable_links`.
    breakable_links_by_unit: Vec<(usize, Vec<(u32, u32)>)>,
}

/// Where numbers come from: index in the source, track, and rest position [m]; banks need no rest position.
#[derive(Clone, Debug)]
enum TrackSource {
    Masses(Vec<(u32, u32, f64)>),
    Mesh(usize, Vec<(u32, u32, f64)>),
    Slow(usize, Vec<(u32, u32, f64)>),
    /// The track of each mode of a body, if it is looked at.
    Modes(usize, Vec<Option<u32>>),
    Bank(Vec<(u32, u32)>),
}

impl MotionLook {
    /// What can be seen of a simulation. Takes as long as finding the modes of its bodies.
    fn new(simulation: &Simulation) -> Self {
        let plan = &simulation.plan;
        let mut builder = LookBuilder::new(&plan.network, plan.timeline_rate.hertz());
        for (unit_index, unit) in plan.units.iter().enumerate() {
            match unit {
                ComputationUnit::IslandPlan(island) => builder.add_island(unit_index, island),
                ComputationUnit::Bank(bank) => builder.add_bank(unit_index, bank),
            }
        }
        builder.finish(plan.clone())
    }

    /// Number of tracks: points, then modes.
    pub fn n_tracks(&self) -> usize {
        self.points.len() + self.n_modes
    }

    /// Whether it was made for the plan of this simulation.
    pub fn was_made_for(&self, simulation: &Simulation) -> bool {
        Arc::ptr_eq(&self.plan, &simulation.plan)
    }

    /// Number of modes that are looked at.
    pub fn n_modes(&self) -> usize {
        self.n_modes
    }

    /// The oscillation of a mode, by its track.
    fn oscillation(&self, track: usize) -> Oscillation {
        let mode_index = track - self.points.len();
        let body_index = self.bodies.partition_point(|body| body.first_mode <= mode_index) - 1;
        self.bodies[body_index].modes[mode_index - self.bodies[body_index].first_mode]
    }
}

impl Simulation {
    /// The ergons that a timeline holds, by rising instant. The speed of a strike, and the impulse of an ergon, are
    /// computed for a mass at rest. Gestures are not included: [`Self::take_sparks`] reports their ergons.
    /// Nor are real hands, which give forces.
    pub fn written_ergons(&self, timeline: &Timeline) -> Vec<ErgonRecord> {
        let network = &*self.plan.network;
        let mass_of = |struck_mat: u32| {
            let scaled_mass = network.mats().m[struck_mat as usize];
            let mat_part = network.parts().get(network.mats().part[struck_mat as usize] as usize);
            let part_rate = mat_part.and_then(|mat_part| mat_part.ca_rate).map_or(1.0, Rate::hertz);
            scaled_mass / (part_rate * part_rate)
        };
        let strikes = timeline.strikes.iter().map(|strike| {
            let (struck_mass, struck_mat) = (mass_of(strike.mat), strike.mat as usize);
            ErgonRecord::event(
                strike.instant,
                struck_mat,
                strike.source,
                struck_mass,
                0.0,
                strike.impulse,
            )
        });
        let ergon_records = timeline.ergons.iter().map(|ergon| ErgonRecord {
            time: ergon.instant,
            mat: ergon.mat,
            source: ergon.source,
            mass: ergon.mass,
            speed: ergon.speed,
            impulse: 2.0 * ergon.mass * mass_of(ergon.mat) / (ergon.mass + mass_of(ergon.mat)) * ergon.speed,
        });
        let mut all_records: Vec<ErgonRecord> = strikes.chain(ergon_records).collect();
        all_records.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.mat.cmp(&b.mat)));
        all_records
    }

    /// The network of the plan.
    pub fn network(&self) -> &Network {
        &self.plan.network
    }

    /// What can be seen of the simulation. Takes longer than finding the modes of its bodies.
    pub fn make_look(&self) -> MotionLook {
        MotionLook::new(self)
    }

    /// Displacements now and one frame before [m]   (2 · n_tracks): first all of now, then all of before. The value
    /// before is set only for free points and modes, not for points that are sampled or not computed. Only copies.
    pub fn write_tracks(&self, look: &MotionLook, out: &mut [f64]) {
        let (displacements, previous_displacements) = out.split_at_mut(look.n_tracks());
        for (unit, source) in &look.sources {
            match self.running_unit(*unit) {
                RunningUnit::Bank(bank) => {
                    let TrackSource::Bank(bank_tracks) = source else {
                        continue;
                    };
                    for &(index, track) in bank_tracks {
                        let motion = bank.motion(index as usize);
                        (displacements[track as usize], previous_displacements[track as usize]) = motion;
                    }
                }
                RunningUnit::Island(island) => {
                    source.read_tracks(
                        look,
                        (island, self.frame),
                        self.rate(),
                        displacements,
                        previous_displacements,
                    );
                }
            }
        }
    }

    /// From here on, record the strongest push of each contact and the strikes of written hands.
    pub fn start_watching(&mut self) {
        for running_unit in self.groups.iter_mut().flat_map(|group| &mut group.units) {
            if let RunningUnit::Island(island) = running_unit {
                island.start_watching();
            }
        }
    }

    /// Calls `report` for each contact of [`MotionLook::contacts`] that pushed since the last call: its index, the
    /// frame of its strongest push, and the force in that frame [N], above 0 if the contact pushes its first end up.
    pub fn take_contacts(&mut self, look: &MotionLook, mut report: impl FnMut(usize, u64, f64)) {
        for (unit, contacts) in &look.contacts_by_unit {
            if let RunningUnit::Island(island) = self.running_unit_mut(*unit) {
                island.take_contact_peaks(|link, frame, force| {
                    if let Some(contact) = contacts[link] {
                        report(contact as usize, frame, force);
                    }
                });
            }
        }
    }
}

impl Simulation {
    /// The running unit of this index in the plan.
    fn running_unit(&self, unit: usize) -> &RunningUnit {
        let group_index = self.groups.partition_point(|group| group.first_unit <= unit) - 1;
        &self.groups[group_index].units[unit - self.groups[group_index].first_unit]
    }

    fn running_unit_mut(&mut self, unit: usize) -> &mut RunningUnit {
        let group_index = self.groups.partition_point(|group| group.first_unit <= unit) - 1;
        let group = &mut self.groups[group_index];
        &mut group.units[unit - group.first_unit]
    }

    /// Largest number of sparks between two looks.
    pub(super) fn sparks_max(&self, look: &MotionLook) -> usize {
        let spark_counts = look
            .gestures_by_unit
            .iter()
            .map(|(unit, _)| match self.running_unit(*unit) {
                RunningUnit::Island(island) => island.sparks_max(),
                RunningUnit::Bank(_) => 0,
            });
        spark_counts.sum()
    }

    /// Calls `report` for the ergons of written gestures since the last call, as they are drawn. A throw or a grain is
    /// reported by itself; ergons that lead along a path are gathered by sign, and one is reported with the impulse of
    /// all. If too many strike to be reported one by one, the others are gathered as well.
    pub fn take_sparks(&mut self, look: &MotionLook, mut report: impl FnMut(ErgonRecord)) {
        for (unit, mats) in &look.gestures_by_unit {
            if let RunningUnit::Island(island) = self.running_unit_mut(*unit) {
                island.take_sparks(|spark| {
                    let mat = to_network_index(mats, spark.mat as usize) as u32;
                    report(ErgonRecord { mat, ..spark });
                });
            }
        }
    }

    /// Calls `report` for each computed link of [`MotionLook::breakable_links`]: its index, and whether it is broken.
    fn for_each_breakable(&self, look: &MotionLook, mut report: impl FnMut(usize, bool)) {
        for (unit, links) in &look.breakable_links_by_unit {
            if let RunningUnit::Island(island) = self.running_unit(*unit) {
                for &(island_link, link) in links {
                    report(link as usize, island.is_broken(island_link as usize));
                }
            }
        }
    }
}

impl TrackSource {
    /// Reads the numbers of this source from an island, in a scene of `rate` that has computed `frame` frames. If the
    /// island is ahead of the scene, its motion is followed back to the scene's frame.
    fn read_tracks(
        &self,
        look: &MotionLook,
        (island, frame): (&Island, u64),
        rate: f64,
        displacements: &mut [f64],
        previous_displacements: &mut [f64],
    ) {
        let frames_ahead = island.frames_ahead(frame);
        let steps_ahead = f64::from(frames_ahead) * island.steps_per_frame();
        let extrapolate_back = |x: f64, step: f64| {
            if frames_ahead == 0 { x } else { x - steps_ahead * step }
        };
        match self {
            Self::Masses(mat_tracks) => {
                let (x, step) = (island.positions(), island.backward_steps());
                for &(index, track, rest) in mat_tracks {
                    displacements[track as usize] = extrapolate_back(x[index as usize], step[index as usize]) - rest;
                }
            }
            Self::Mesh(body, mat_tracks) => {
                if let Some(RunningBody::Mesh(mesh)) = island.bodies().get(*body) {
                    for &(index, track, rest) in mat_tracks {
                        let (x, step) = mesh.motion(index as usize);
                        displacements[track as usize] = extrapolate_back(x, step) - rest;
                    }
                }
            }
            Self::Slow(body, mat_tracks) => {
                if let Some(RunningBody::Slow(slow)) = island.bodies().get(*body) {
                    let slow_state = slow.present_state();
                    for &(index, track, rest) in mat_tracks {
                        let (x, step) = slow.motion(&slow_state, index as usize);
                        displacements[track as usize] = extrapolate_back(x, step) - rest;
                    }
                }
            }
            Self::Modes(body, tracks) => {
                if let Some(RunningBody::Modal(modal)) = island.bodies().get(*body) {
                    let step_time = 1.0 / (rate * island.steps_per_frame());
                    let time_offset = -f64::from(frames_ahead) / rate;
                    modal.for_each_amplitude(|mode, x, x_before| {
                        let Some(Some(track)) = tracks.get(mode) else {
                            return;
                        };
                        let track = *track as usize;
                        (displacements[track], previous_displacements[track]) = if island.is_decimated() {
                            let oscillation = look.oscillation(track);
                            let phase = oscillation.coefficients(x, x_before, step_time);
                            let position = |t: f64| oscillation.coefficients_after(phase, t).0;
                            (position(time_offset), position(time_offset - 1.0 / rate))
                        } else {
                            (x, x_before)
                        };
                    });
                }
            }
            Self::Bank(_) => {}
        }
    }
}
