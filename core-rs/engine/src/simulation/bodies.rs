//! Bodies that are computed by modes or by methods of their own, seen mass by mass: the body of the new simulation
//! starts from the positions and steps of the masses of the old one, even if the method changes.

use std::collections::HashSet;

use super::side::{MatLocation, Side, UnitIndex, unmatched};
use super::{RunningUnit, Simulation};
use crate::body_modes::mode_shapes::{ModalTransform, ModeShapes};
use crate::island::bodies::{self, BodyPlan};
use crate::network::Network;
use crate::units::Rate;

/// Where a body is computed: in a bank of its modes (`None`), or as a body of an island (its index).
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) unit: UnitIndex,
    body: Option<usize>,
}

/// A body, seen as its masses.
#[derive(Clone, Debug)]
pub(super) struct Body {
    pub(super) place: Place,
    /// Index in [`Workspace::mats`] of the first of its masses.
    first: usize,
    source: Source,
}

#[derive(Clone, Debug)]
enum Source {
    /// The masses follow from the modes of the body.
    Modes(Box<ModeShapes>),
    /// The body computes its masses by another method: their indices in the body, and their motions (x, step).
    Masses(Vec<(usize, (f64, f64))>),
}

/// A body whose masses may be asked for: the names of the masses, and the initial position and step of each [m].
struct BodyCandidate<'a> {
    place: Place,
    names: Vec<String>,
    start: Vec<(f64, f64)>,
    source: MassSource<'a>,
}

enum MassSource<'a> {
    /// A body by modes: its network, which of its modes are computed, the MATs that modes of one frequency were turned
    /// towards, and the rate of its steps.
    Modes(&'a Network, (&'a [u32], Option<&'a [usize]>), Rate),
    Masses(Vec<usize>),
}

/// Working memory for masses and modes during a takeover. Of each mass: its position [m] and its step in a frame of the
/// scene [m].
#[derive(Clone, Debug, Default)]
pub(super) struct Workspace {
    pub(super) mats: Vec<(f64, f64)>,
    now: Vec<f64>,
    before: Vec<f64>,
}

impl<'a> BodyCandidate<'a> {
    /// Bodies of all units that are not the same on both sides, except those in `taken_bodies`.
    fn all(
        side: &'a Side<'a>,
        [islands, banks]: [&[bool]; 2],
        taken_bodies: &HashSet<(UnitIndex, usize)>,
    ) -> Vec<Self> {
        let time_step = side.rate.step();
        let mut candidates = Vec::new();
        for (&(unit, _, island_plan), _) in unmatched(&side.islands, islands) {
            let indexed_bodies = island_plan.bodies.iter().enumerate();
            for (index, body) in indexed_bodies.filter(|(index, _)| !taken_bodies.contains(&(unit, *index))) {
                let body_place = Place {
                    unit,
                    body: Some(index),
                };
                let (network, modes_and_rate, local_mats): (&Network, Option<_>, Vec<usize>) = match body {
                    BodyPlan::Modal(modal) => {
                        let modes_kept = (&modal.mode_numbers[..], modal.alignment_mats.as_deref());
                        (&modal.network, Some((modes_kept, modal.rate)), Vec::new())
                    }
                    BodyPlan::Mesh(mesh) => (&mesh.network, None, (0..mesh.network.n_mat()).collect()),
                    BodyPlan::Slow(slow) => (&slow.network, None, (0..slow.free_mats.len()).collect()),
                };
                let body_mats: Vec<usize> = match body {
                    BodyPlan::Slow(slow) => slow.free_mats.clone(),
                    BodyPlan::Mesh(_) => local_mats.clone(),
                    BodyPlan::Modal(_) => moving(network),
                };
                let mass_source = modes_and_rate.map_or(MassSource::Masses(local_mats), |(modes_kept, rate)| {
                    MassSource::Modes(network, modes_kept, rate)
                });
                candidates.push(Self::new(body_place, network, &body_mats, mass_source, time_step));
            }
        }
        for (&(unit, bank), _) in unmatched(&side.banks, banks) {
            let Some(network) = &bank.body else { continue };
            let body_place = Place { unit, body: None };
            let modes_kept = (&bank.computed_modes[..], bank.rotation_mats.as_deref());
            let mass_source = MassSource::Modes(network, modes_kept, side.rate);
            candidates.push(Self::new(body_place, network, &moving(network), mass_source, time_step));
        }
        candidates
    }

    fn new(place: Place, network: &Network, mats: &[usize], source: MassSource<'a>, step: f64) -> Self {
        let network_mats = network.mats();
        Self {
            place,
            names: mats.iter().map(|&mat| network.mat_name(mat)).collect(),
            start: mats
                .iter()
                .map(|&mat| (network_mats.x0[mat], network_mats.v0[mat] * step))
                .collect(),
            source,
        }
    }

    /// The body, with a place in the workspace; `None` if its modes cannot be found.
    fn body(self, transform: ModalTransform, workspace: &mut Workspace) -> Option<Body> {
        let first = workspace.mats.len();
        let source = match self.source {
            MassSource::Modes(network, modes_kept, rate) => {
                let mode_shapes = ModeShapes::new(network, modes_kept, rate, transform)?;
                let mode_room = workspace.now.len().max(mode_shapes.n_modes());
                workspace.now.resize(mode_room, 0.0);
                workspace.before.resize(mode_room, 0.0);
                Source::Modes(Box::new(mode_shapes))
            }
            MassSource::Masses(masses) => {
                Source::Masses(masses.into_iter().map(|mass_index| (mass_index, (0.0, 0.0))).collect())
            }
        };
        workspace.mats.extend(self.start);
        Some(Body {
            place: self.place,
            first,
            source,
        })
    }
}

/// A motion (x, step) with its step converted to a step of another length.
fn scaled((x, step): (f64, f64), step_factor: f64) -> (f64, f64) {
    (x, step * step_factor)
}

fn moving(network: &Network) -> Vec<usize> {
    let mat_kinds = network.mats().kind.iter().enumerate();
    let moving_mats = mat_kinds.filter(|(_, kind)| kind.moves());
    moving_mats.map(|(mat, _)| mat).collect()
}

/// The bodies of one side that hold at least one wanted mass: the names of all their masses with their places in the
/// workspace, and the bodies.
pub(super) fn bodies(
    side: &Side<'_>,
    is_matched: [&[bool]; 2],
    taken_bodies: &HashSet<(UnitIndex, usize)>,
    is_wanted: impl Fn(&str) -> bool,
    transform: ModalTransform,
    workspace: &mut Workspace,
) -> (Vec<(String, MatLocation)>, Vec<Body>) {
    let (mut locations, mut bodies) = (Vec::new(), Vec::new());
    for candidate in BodyCandidate::all(side, is_matched, taken_bodies) {
        if !candidate.names.iter().any(|name| is_wanted(name)) {
            continue;
        }
        let mass_names = candidate.names.clone();
        let Some(body) = candidate.body(transform, workspace) else {
            continue;
        };
        let named_slots = mass_names.into_iter().zip(body.first..);
        locations.extend(named_slots.map(|(name, slot)| (name, MatLocation::Workspace(slot))));
        bodies.push(body);
    }
    (locations, bodies)
}

/// Names of the masses of all bodies that `bodies` considers on one side.
pub(super) fn names(
    side: &Side<'_>,
    same: [&[bool]; 2],
    taken_bodies: &HashSet<(UnitIndex, usize)>,
) -> HashSet<String> {
    let candidates = BodyCandidate::all(side, same, taken_bodies).into_iter();
    candidates.flat_map(|candidate| candidate.names).collect()
}

impl Body {
    /// Copies the positions and steps of the masses from the simulation into the workspace.
    pub(super) fn read_masses(&self, simulation: &mut Simulation, workspace: &mut Workspace) {
        let playing = simulation.playing(self.place.unit);
        let frame_steps = playing.steps_per_frame();
        match &self.source {
            Source::Modes(mode_shapes) => {
                let mode_count = mode_shapes.n_modes();
                let (amplitudes_now, amplitudes_before) =
                    (&mut workspace.now[..mode_count], &mut workspace.before[..mode_count]);
                match (playing, self.place.body) {
                    (RunningUnit::Bank(bank), _) => {
                        for mode in 0..mode_count {
                            (amplitudes_now[mode], amplitudes_before[mode]) = bank.motion(mode);
                        }
                    }
                    (RunningUnit::Island(island), Some(body)) => {
                        let Some(bodies::RunningBody::Modal(modal_body)) = island.body_mut(body) else {
                            return;
                        };
                        modal_body.write_amplitudes(amplitudes_now, amplitudes_before);
                    }
                    (RunningUnit::Island(_), None) => return,
                }
                let mats = &mut workspace.mats[self.first..self.first + mode_shapes.mats.len()];
                mode_shapes.positions(amplitudes_now, amplitudes_before, mats);
                mats.iter_mut().for_each(|mat| mat.1 *= frame_steps);
            }
            Source::Masses(all) => {
                let (RunningUnit::Island(island), Some(body)) = (playing, self.place.body) else {
                    return;
                };
                let mats = workspace.mats[self.first..].iter_mut().zip(all);
                match island.body_mut(body) {
                    Some(bodies::RunningBody::Mesh(mesh)) => {
                        mats.for_each(|(mat, &(mass_index, _))| *mat = scaled(mesh.motion(mass_index), frame_steps));
                    }
                    Some(bodies::RunningBody::Slow(slow)) => {
                        let present = slow.present_state();
                        let mass_motion = |mass_index: usize| scaled(slow.motion(&present, mass_index), frame_steps);
                        mats.for_each(|(mat, &(mass_index, _))| *mat = mass_motion(mass_index));
                    }
                    _ => {}
                }
            }
        }
    }

    /// Sets the motion of the body from its masses in the workspace.
    pub(super) fn write_masses(&mut self, simulation: &mut Simulation, workspace: &mut Workspace) {
        let playing = simulation.playing(self.place.unit);
        let frames_per_step = 1.0 / playing.steps_per_frame();
        match &mut self.source {
            Source::Modes(mode_shapes) => {
                let mode_count = mode_shapes.n_modes();
                let (amplitudes_now, amplitudes_before) =
                    (&mut workspace.now[..mode_count], &mut workspace.before[..mode_count]);
                let body_mats = &mut workspace.mats[self.first..self.first + mode_shapes.mats.len()];
                body_mats.iter_mut().for_each(|mat| mat.1 *= frames_per_step);
                mode_shapes.amplitudes(body_mats, amplitudes_now, amplitudes_before);
                match (playing, self.place.body) {
                    (RunningUnit::Bank(bank), _) => {
                        for mode in 0..mode_count {
                            bank.set_motion(mode, (amplitudes_now[mode], amplitudes_before[mode]));
                        }
                    }
                    (RunningUnit::Island(island), Some(body)) => {
                        if let Some(bodies::RunningBody::Modal(modal_body)) = island.body_mut(body) {
                            modal_body.set_amplitudes(amplitudes_now, amplitudes_before);
                        }
                    }
                    (RunningUnit::Island(_), None) => {}
                }
            }
            Source::Masses(all) => {
                let (RunningUnit::Island(island), Some(body)) = (playing, self.place.body) else {
                    return;
                };
                for ((_, motion), mat) in all.iter_mut().zip(&workspace.mats[self.first..]) {
                    *motion = scaled(*mat, frames_per_step);
                }
                match island.body_mut(body) {
                    Some(bodies::RunningBody::Mesh(mesh)) => mesh.set_motions(all),
                    Some(bodies::RunningBody::Slow(slow)) => slow.set_motions(all),
                    _ => {}
                }
            }
        }
    }
}
