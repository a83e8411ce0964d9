//! Bodies that are computed by modes or by methods of their own, seen mass by mass: the body of the new simulation
//! starts from the positions and steps of the masses of the old one, even if the method changes.

use std::collections::HashSet;
use std::ops::Range;

use super::side::{MatLocation, TakeoverSide, UnitIndex, unmatched};
use super::{RunningUnit, Simulation};
use crate::body_modes::complex_modes::ComplexPart;
use crate::body_modes::mode_shapes::{ModalTransform, ModeShapes};
use crate::body_modes::state_projection::StateProjection;
use crate::island::bodies::{self, BodyPlan};
use crate::network::Network;
use crate::units::Rate;

/// Where a body is computed: in a bank of its modes (`None`), or as a body of an island (its index).
#[derive(Clone, Copy, Debug)]
pub(super) struct BodyPlace {
    pub(super) unit: UnitIndex,
    body: Option<usize>,
}

/// A body, seen as its masses.
#[derive(Clone, Debug)]
pub(super) struct TransferredBody {
    pub(super) place: BodyPlace,
    /// Index in [`Workspace::mass_motions`] of the first of its masses.
    first_slot: usize,
    source: MassAccess,
}

#[derive(Clone, Debug)]
enum MassAccess {
    /// The masses follow from the modes of the body.
    Modes(Box<ModeShapes>),
    /// Its complex modes follow from the masses.
    Projection(Box<StateProjection>),
    /// The body computes its masses by another method: their indices in the body, and their motions (x, step).
    Masses(Vec<(usize, (f64, f64))>),
}

/// A body that may be transferred: the names of the masses, and the initial position and step of each [m].
struct BodyCandidate<'a> {
    place: BodyPlace,
    mass_names: Vec<String>,
    initial_motions: Vec<(f64, f64)>,
    source: MassSource<'a>,
}

enum MassSource<'a> {
    /// A body by modes: its network, which of its modes are computed, the MATs that modes of one frequency were turned
    /// towards, and the rate of its steps.
    Modes(&'a Network, (&'a [u32], Option<&'a [usize]>), Rate),
    /// A body by its complex modes: its network, which parts of them are computed, and the rate of its steps.
    ComplexModes(&'a Network, &'a [ComplexPart], Rate),
    Masses(Vec<usize>),
}

/// Working memory for masses and modes during a takeover. Of each mass: its position [m] and its step in a frame of the
/// scene [m].
#[derive(Clone, Debug, Default)]
pub(super) struct Workspace {
    pub(super) mass_motions: Vec<(f64, f64)>,
    amplitudes: Vec<f64>,
    previous_amplitudes: Vec<f64>,
}

impl Workspace {
    /// Makes room for the amplitudes of at least `n_modes`.
    fn reserve_modes(&mut self, n_modes: usize) {
        let mode_capacity = self.amplitudes.len().max(n_modes);
        self.amplitudes.resize(mode_capacity, 0.0);
        self.previous_amplitudes.resize(mode_capacity, 0.0);
    }

    /// Amplitudes of modes now and one frame before, which `transform` computes from masses with their steps scaled.
    fn amplitudes_by(
        &mut self,
        masses: Range<usize>,
        step_factor: f64,
        n_modes: usize,
        transform: impl FnOnce(&[(f64, f64)], &mut [f64], &mut [f64]),
    ) -> [&[f64]; 2] {
        let masses = &mut self.mass_motions[masses];
        masses.iter_mut().for_each(|mat| mat.1 *= step_factor);
        let (now, before) = (
            &mut self.amplitudes[..n_modes],
            &mut self.previous_amplitudes[..n_modes],
        );
        transform(masses, now, before);
        [now, before]
    }
}

impl<'a> BodyCandidate<'a> {
    /// Bodies of all units that are not the same on both sides, except those in `taken_bodies`.
    fn collect_unmatched(
        side: &'a TakeoverSide<'a>,
        [islands, banks]: [&[bool]; 2],
        taken_bodies: &HashSet<(UnitIndex, usize)>,
    ) -> Vec<Self> {
        let time_step = side.rate.step();
        let mut candidates = Vec::new();
        for (&(unit, _, island_plan), _) in unmatched(&side.islands, islands) {
            let indexed_bodies = island_plan.bodies.iter().enumerate();
            for (index, body) in indexed_bodies.filter(|(index, _)| !taken_bodies.contains(&(unit, *index))) {
                let body_place = BodyPlace {
                    unit,
                    body: Some(index),
                };
                let (network, body_mats, mass_source) = match body {
                    BodyPlan::Modal(modal) => {
                        let network = &*modal.network;
                        let mode_selection = (&modal.mode_numbers[..], modal.alignment_mats.as_deref());
                        let mass_source = match &modal.complex_responses {
                            Some(answers) => MassSource::ComplexModes(network, &answers.mode_parts, modal.rate),
                            None => MassSource::Modes(network, mode_selection, modal.rate),
                        };
                        (network, moving_mats(network), mass_source)
                    }
                    BodyPlan::Mesh(mesh) => {
                        let mats: Vec<usize> = (0..mesh.network.n_mat()).collect();
                        (&*mesh.network, mats.clone(), MassSource::Masses(mats))
                    }
                    BodyPlan::Slow(slow) => {
                        let mass_source = MassSource::Masses((0..slow.free_mats.len()).collect());
                        (&*slow.network, slow.free_mats.clone(), mass_source)
                    }
                };
                candidates.push(Self::new(body_place, network, &body_mats, mass_source, time_step));
            }
        }
        for (&(unit, bank), _) in unmatched(&side.banks, banks) {
            let Some(network) = &bank.body else { continue };
            let body_place = BodyPlace { unit, body: None };
            let mode_selection = (&bank.computed_modes[..], bank.rotation_mats.as_deref());
            let mass_source = MassSource::Modes(network, mode_selection, side.rate);
            candidates.push(Self::new(
                body_place,
                network,
                &moving_mats(network),
                mass_source,
                time_step,
            ));
        }
        candidates
    }

    fn new(place: BodyPlace, network: &Network, mats: &[usize], source: MassSource<'a>, step: f64) -> Self {
        let network_mats = network.mats();
        Self {
            place,
            mass_names: mats.iter().map(|&mat| network.mat_name(mat)).collect(),
            initial_motions: mats
                .iter()
                .map(|&mat| (network_mats.x0[mat], network_mats.v0[mat] * step))
                .collect(),
            source,
        }
    }

    /// The body, with a place in the workspace; `None` if its modes cannot be found.
    fn into_body(self, transform: ModalTransform, workspace: &mut Workspace) -> Option<TransferredBody> {
        let first_slot = workspace.mass_motions.len();
        let source = match self.source {
            MassSource::Modes(network, mode_selection, rate) => {
                let mode_shapes = ModeShapes::new(network, mode_selection, rate, transform)?;
                workspace.reserve_modes(mode_shapes.n_modes());
                MassAccess::Modes(Box::new(mode_shapes))
            }
            MassSource::ComplexModes(network, parts, rate) => {
                workspace.reserve_modes(parts.len());
                match transform {
                    ModalTransform::ToPositions => {
                        MassAccess::Modes(Box::new(ModeShapes::complex(network, parts, rate)?))
                    }
                    ModalTransform::ToAmplitudes => {
                        MassAccess::Projection(Box::new(StateProjection::new(network, parts, rate)?))
                    }
                }
            }
            MassSource::Masses(masses) => {
                MassAccess::Masses(masses.into_iter().map(|mass_index| (mass_index, (0.0, 0.0))).collect())
            }
        };
        workspace.mass_motions.extend(self.initial_motions);
        Some(TransferredBody {
            place: self.place,
            first_slot,
            source,
        })
    }
}

/// A motion (x, step) with its step converted to a step of another length.
fn with_step_scaled((x, step): (f64, f64), step_factor: f64) -> (f64, f64) {
    (x, step * step_factor)
}

fn moving_mats(network: &Network) -> Vec<usize> {
    let mat_kinds = network.mats().kind.iter().enumerate();
    let moving_mats = mat_kinds.filter(|(_, kind)| kind.moves());
    moving_mats.map(|(mat, _)| mat).collect()
}

/// The bodies of one side that hold at least one wanted mass: the names of all their masses with their places in the
/// workspace, and the bodies.
pub(super) fn wanted_bodies(
    side: &TakeoverSide<'_>,
    is_matched: [&[bool]; 2],
    taken_bodies: &HashSet<(UnitIndex, usize)>,
    is_wanted: impl Fn(&str) -> bool,
    transform: ModalTransform,
    workspace: &mut Workspace,
) -> (Vec<(String, MatLocation)>, Vec<TransferredBody>) {
    let (mut locations, mut bodies) = (Vec::new(), Vec::new());
    for candidate in BodyCandidate::collect_unmatched(side, is_matched, taken_bodies) {
        if !candidate.mass_names.iter().any(|name| is_wanted(name)) {
            continue;
        }
        let mass_names = candidate.mass_names.clone();
        let Some(body) = candidate.into_body(transform, workspace) else {
            continue;
        };
        let named_slots = mass_names.into_iter().zip(body.first_slot..);
        locations.extend(named_slots.map(|(name, slot)| (name, MatLocation::Workspace(slot))));
        bodies.push(body);
    }
    (locations, bodies)
}

/// Names of the masses of all bodies that `wanted_bodies` considers on one side.
pub(super) fn all_mass_names(
    side: &TakeoverSide<'_>,
    same: [&[bool]; 2],
    taken_bodies: &HashSet<(UnitIndex, usize)>,
) -> HashSet<String> {
    let candidates = BodyCandidate::collect_unmatched(side, same, taken_bodies).into_iter();
    candidates.flat_map(|candidate| candidate.mass_names).collect()
}

impl TransferredBody {
    /// Copies the positions and steps of the masses from the simulation into the workspace.
    pub(super) fn read_masses(&self, simulation: &mut Simulation, workspace: &mut Workspace) {
        let running_unit = simulation.unit_mut(self.place.unit);
        let frame_steps = running_unit.steps_per_frame();
        match &self.source {
            MassAccess::Modes(mode_shapes) => {
                let mode_count = mode_shapes.n_modes();
                let (amplitudes_now, amplitudes_before) = (
                    &mut workspace.amplitudes[..mode_count],
                    &mut workspace.previous_amplitudes[..mode_count],
                );
                match (running_unit, self.place.body) {
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
                let mats = &mut workspace.mass_motions[self.first_slot..self.first_slot + mode_shapes.mats.len()];
                mode_shapes.positions(amplitudes_now, amplitudes_before, mats);
                mats.iter_mut().for_each(|mat| mat.1 *= frame_steps);
            }
            // A projection only writes.
            MassAccess::Projection(_) => {}
            MassAccess::Masses(masses) => {
                let (RunningUnit::Island(island), Some(body)) = (running_unit, self.place.body) else {
                    return;
                };
                let mats = workspace.mass_motions[self.first_slot..].iter_mut().zip(masses);
                match island.body_mut(body) {
                    Some(bodies::RunningBody::Mesh(mesh)) => {
                        mats.for_each(|(mat, &(mass_index, _))| {
                            *mat = with_step_scaled(mesh.motion(mass_index), frame_steps)
                        });
                    }
                    Some(bodies::RunningBody::Slow(slow)) => {
                        let present = slow.present_state();
                        let mass_motion =
                            |mass_index: usize| with_step_scaled(slow.motion(&present, mass_index), frame_steps);
                        mats.for_each(|(mat, &(mass_index, _))| *mat = mass_motion(mass_index));
                    }
                    _ => {}
                }
            }
        }
    }

    /// Sets the motion of the body from its masses in the workspace.
    pub(super) fn write_masses(&mut self, simulation: &mut Simulation, workspace: &mut Workspace) {
        let running_unit = simulation.unit_mut(self.place.unit);
        let frames_per_step = 1.0 / running_unit.steps_per_frame();
        match &mut self.source {
            MassAccess::Modes(mode_shapes) => {
                let body_mats = self.first_slot..self.first_slot + mode_shapes.mats.len();
                let transform = |mats: &[(f64, f64)], now: &mut [f64], before: &mut [f64]| {
                    mode_shapes.amplitudes(mats, now, before);
                };
                let amplitudes = workspace.amplitudes_by(body_mats, frames_per_step, mode_shapes.n_modes(), transform);
                set_amplitudes(running_unit, self.place.body, amplitudes);
            }
            MassAccess::Projection(projection) => {
                let body_mats = self.first_slot..self.first_slot + projection.mats().len();
                let n_parts = projection.n_parts();
                let transform = |mats: &[(f64, f64)], now: &mut [f64], before: &mut [f64]| {
                    projection.amplitudes(mats, now, before);
                };
                let amplitudes = workspace.amplitudes_by(body_mats, frames_per_step, n_parts, transform);
                set_amplitudes(running_unit, self.place.body, amplitudes);
            }
            MassAccess::Masses(masses) => {
                let (RunningUnit::Island(island), Some(body)) = (running_unit, self.place.body) else {
                    return;
                };
                for ((_, motion), mat) in masses.iter_mut().zip(&workspace.mass_motions[self.first_slot..]) {
                    *motion = with_step_scaled(*mat, frames_per_step);
                }
                match island.body_mut(body) {
                    Some(bodies::RunningBody::Mesh(mesh)) => mesh.set_motions(masses),
                    Some(bodies::RunningBody::Slow(slow)) => slow.set_motions(masses),
                    _ => {}
                }
            }
        }
    }
}

/// Sets the modes of a bank or of a body: amplitudes now and one frame before.
fn set_amplitudes(running_unit: &mut RunningUnit, body: Option<usize>, [now, before]: [&[f64]; 2]) {
    match (running_unit, body) {
        (RunningUnit::Bank(bank), _) => {
            for (mode, motion) in now.iter().copied().zip(before.iter().copied()).enumerate() {
                bank.set_motion(mode, motion);
            }
        }
        (RunningUnit::Island(island), Some(body)) => {
            if let Some(bodies::RunningBody::Modal(modal_body)) = island.body_mut(body) {
                modal_body.set_amplitudes(now, before);
            }
        }
        (RunningUnit::Island(_), None) => {}
    }
}
