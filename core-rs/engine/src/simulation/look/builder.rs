//! Makes a [`MotionLook`]: finds where the number of each mass and mode is computed. Done once, outside real time.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use super::{MotionLook, Oscillation, PointMotion, TrackSource, VisibleBody, VisibleContact, VisiblePoint};
use crate::assembly::unit::{BankPlan, IslandPlan, to_network_index};
use crate::bank::Oscillator;
use crate::body_modes::mode_shapes::{ModalTransform, ModeShapes};
use crate::island::bodies::BodyPlan;
use crate::network::{MatKind, Network};
use crate::plan::Plan;
use crate::units::Rate;

/// Largest number of modes of a body that are looked at: the lowest, whose displacements are large enough to be seen.
const MODES_MAX: usize = 256;

/// One MAT: how it moves, its rest position, its unit, and what in the unit computes it.
struct MatSource {
    motion: PointMotion,
    rest: f64,
    unit: usize,
    position_source: PositionSource,
}

/// What computes the position of a MAT, and the MAT's index there.
#[derive(Clone, Copy)]
enum PositionSource {
    Mass(usize),
    Mesh(usize, usize),
    Slow(usize, usize),
    Bank(usize),
    Body,
}

/// A body by its modes: pairs of a MAT and its row in the mode shapes, by rising MAT; and the modes.
struct ModalBody {
    mats: Vec<(usize, usize)>,
    modes: Vec<TrackedMode>,
}

/// A mode: its oscillation, where it is computed, and the share of each row in it.
struct TrackedMode {
    oscillation: Oscillation,
    /// Its unit, and the index of its body in that unit; `None` if the unit is a bank of modes.
    unit_and_body: (usize, Option<usize>),
    mode: usize,
    shape: Vec<f64>,
}

/// Goes through the units of a plan, and collects what each computes.
pub(super) struct LookBuilder<'a> {
    network: &'a Network,
    rate: f64,
    mats_by_name: HashMap<String, usize>,
    /// (n_mat)
    sources: Vec<Option<MatSource>>,
    bodies: Vec<ModalBody>,
    contacts: Vec<VisibleContact>,
    contacts_by_unit: Vec<(usize, Vec<Option<u32>>)>,
    gestures_by_unit: Vec<(usize, Option<Vec<u32>>)>,
    breakable_links: Vec<usize>,
    /// Index in `breakable_links` of the link between two MATs.
    breakable_by_ends: HashMap<NumberedEnds, u32>,
    breakable_links_by_unit: Vec<(usize, Vec<(u32, u32)>)>,
}

/// Two MATs of the whole network, and the number of breakable links between them that come before this one.
type NumberedEnds = (usize, usize, u32);

impl<'a> LookBuilder<'a> {
    pub(super) fn new(network: &'a Network, rate: f64) -> Self {
        let mat_count = network.n_mat();
        let contacts = network.runs().iter().filter(|run| run.kind.is_contact());
        let contacts = contacts.flat_map(|run| {
            (0..run.len).map(|i| {
                let (first_end, second_end) = run.pair(i, 0);
                // Where all pairs of two sets may touch, each contact belongs to a point of the second set, whichever
                // point touches it.
                let first_end = if run.pairwise().is_some() {
                    second_end
                } else {
                    first_end
                };
                VisibleContact {
                    name: network.link_name(run.first + i),
                    link: run.first + i,
                    ends: (first_end, second_end),
                }
            })
        });
        let (breakable_links, break_ends): (Vec<usize>, Vec<NumberedEnds>) =
            breakable_links(network, |mat| mat).unzip();
        Self {
            breakable_by_ends: break_ends.into_iter().zip(0..).collect(),
            breakable_links,
            breakable_links_by_unit: Vec::new(),
            network,
            rate,
            mats_by_name: (0..mat_count).map(|mat| (network.mat_name(mat), mat)).collect(),
            sources: (0..mat_count).map(|_| None).collect(),
            bodies: Vec::new(),
            contacts: contacts.collect(),
            contacts_by_unit: Vec::new(),
            gestures_by_unit: Vec::new(),
        }
    }

    fn network_index(&self, network: &Network, mat: usize) -> Option<usize> {
        self.mats_by_name.get(&network.mat_name(mat)).copied()
    }

    fn record_source(&mut self, mat: Option<usize>, source: MatSource) {
        if let Some(mat) = mat {
            self.sources[mat] = Some(source);
        }
    }

    fn rest_position(&self, mat: usize) -> f64 {
        let mats = self.network.mats();
        match mats.kind[mat] {
            MatKind::Cel => mats.rest[mat],
            _ => mats.x0[mat],
        }
    }

    fn record_sampled(&mut self, mat: Option<usize>, unit: usize, origin: PositionSource) {
        let rest = mat.map_or(0.0, |mat| self.rest_position(mat));
        let motion = PointMotion::Sampled;
        self.record_source(
            mat,
            MatSource {
                motion,
                rest,
                unit,
                position_source: origin,
            },
        );
    }

    pub(super) fn add_island(&mut self, unit: usize, island: &IslandPlan) {
        let network = &*island.network;
        for (mat, kind) in network.mats().kind.iter().enumerate() {
            // A held point may be a guest of several islands; the first of them gives its position.
            let network_mat = to_network_index(&island.network_indices.mats, mat);
            if !kind.is_held() || self.sources[network_mat].is_none() {
                self.record_sampled(Some(network_mat), unit, PositionSource::Mass(mat));
            }
        }
        for (body_index, body_plan) in island.bodies.iter().enumerate() {
            match body_plan {
                BodyPlan::Mesh(mesh) => {
                    for mesh_mat in moving_mats(&mesh.network) {
                        let mat = self.network_index(&mesh.network, mesh_mat);
                        self.record_sampled(mat, unit, PositionSource::Mesh(body_index, mesh_mat));
                    }
                }
                BodyPlan::Slow(slow) => {
                    for (slot, &mat) in slow.free_mats.iter().enumerate() {
                        let mat = self.network_index(&slow.network, mat);
                        self.record_sampled(mat, unit, PositionSource::Slow(body_index, slot));
                    }
                }
                BodyPlan::Modal(modal) => {
                    let mode_shapes = match &modal.complex_responses {
                        Some(responses) => ModeShapes::complex(&modal.network, &responses.mode_parts, modal.rate),
                        None => ModeShapes::new(
                            &modal.network,
                            (&modal.mode_numbers, modal.alignment_mats.as_deref()),
                            modal.rate,
                            ModalTransform::ToPositions,
                        ),
                    };
                    let modes = modal.modes.iter();
                    let modes = modes.map(|mode| Oscillation::from_recurrence(mode.a, mode.b, modal.rate.hertz()));
                    if let Some(mode_shapes) = mode_shapes {
                        self.add_body((unit, Some(body_index)), &modal.network, &mode_shapes, modes.collect());
                    }
                }
            }
        }
        let contact_by_name: HashMap<&str, usize> = (self.contacts.iter().enumerate())
            .map(|(contact_index, contact)| (contact.name.as_str(), contact_index))
            .collect();
        let mut contacts = vec![None; network.n_lia()];
        for run in network.runs().iter().filter(|run| run.kind.is_contact()) {
            let run_links = run.first..run.first + run.len;
            for (contact, link) in contacts[run_links.clone()].iter_mut().zip(run_links) {
                if let Some(&known_contact) = contact_by_name.get(network.link_name(link).as_str()) {
                    *contact = Some(known_contact as u32);
                }
            }
        }
        self.contacts_by_unit.push((unit, contacts));
        if !island.timeline.gestures.is_empty() {
            let island_mats = island.network_indices.mats.clone();
            self.gestures_by_unit.push((unit, island_mats));
        }
        let breakable_links: Vec<(u32, u32)> =
            breakable_links(network, |mat| to_network_index(&island.network_indices.mats, mat))
                .filter_map(|(link, ends)| Some((link as u32, *self.breakable_by_ends.get(&ends)?)))
                .collect();
        self.breakable_links_by_unit.push((unit, breakable_links));
    }

    pub(super) fn add_bank(&mut self, unit: usize, bank: &BankPlan) {
        let oscillation = |oscillator: &Oscillator| Oscillation::from_recurrence(oscillator.a, oscillator.b, self.rate);
        let oscillations: Vec<Oscillation> = bank.oscillators.iter().map(oscillation).collect();
        if bank.mats_and_rests.len() == oscillations.len() && !oscillations.is_empty() {
            for (cell, (&(mat, rest), &free_oscillation)) in bank.mats_and_rests.iter().zip(&oscillations).enumerate() {
                let origin = PositionSource::Bank(cell);
                let motion = PointMotion::Free(free_oscillation);
                self.record_source(
                    Some(mat as usize),
                    MatSource {
                        motion,
                        rest,
                        unit,
                        position_source: origin,
                    },
                );
            }
            return;
        }
        let rate = Rate::new(self.rate).ok();
        let (network, mode_shapes) = match (&bank.body, &bank.complex, rate) {
            (Some(bank_network), _, Some(rate)) => {
                let mode_selection = (&bank.computed_modes[..], bank.rotation_mats.as_deref());
                let mode_shapes = ModeShapes::new(bank_network, mode_selection, rate, ModalTransform::ToPositions);
                (bank_network.clone(), mode_shapes)
            }
            (_, Some((bank_network, parts)), Some(rate)) => {
                (bank_network.clone(), ModeShapes::complex(bank_network, parts, rate))
            }
            _ => return,
        };
        if let Some(mode_shapes) = mode_shapes {
            self.add_body((unit, None), &network, &mode_shapes, oscillations);
        }
    }

    /// Adds a body by its modes, or more modes of a body that was added before.
    fn add_body(
        &mut self,
        unit_and_body: (usize, Option<usize>),
        network: &Arc<Network>,
        mode_shapes: &ModeShapes,
        modes: Vec<Oscillation>,
    ) {
        let mats: Vec<Option<usize>> = mode_shapes
            .mats
            .iter()
            .map(|&mat| self.network_index(network, mat))
            .collect();
        let known_body = mats
            .iter()
            .flatten()
            .find_map(|&mat| match self.sources[mat].as_ref()?.motion {
                PointMotion::Modal(body) => Some(body),
                _ => None,
            });
        let body_index = known_body.unwrap_or(self.bodies.len());
        if known_body.is_none() {
            for (&mat, &rest) in mats.iter().zip(mode_shapes.rest()) {
                let (motion, origin) = (PointMotion::Modal(body_index), PositionSource::Body);
                self.record_source(
                    mat,
                    MatSource {
                        motion,
                        rest,
                        unit: unit_and_body.0,
                        position_source: origin,
                    },
                );
            }
            let mats = mats.iter().enumerate();
            let mut mats: Vec<(usize, usize)> = mats.filter_map(|(row, mat)| Some(((*mat)?, row))).collect();
            mats.sort_unstable();
            self.bodies.push(ModalBody {
                mats,
                modes: Vec::new(),
            });
        }
        let indexed_modes = modes.into_iter().enumerate().take(mode_shapes.n_modes());
        self.bodies[body_index]
            .modes
            .extend(indexed_modes.map(|(mode, oscillation)| TrackedMode {
                oscillation,
                unit_and_body,
                mode,
                shape: mode_shapes.shape(mode).to_vec(),
            }));
    }

    pub(super) fn finish(mut self, plan: Arc<Plan>) -> MotionLook {
        let mats = self.network.mats();
        let mut points: Vec<VisiblePoint> = Vec::new();
        for (mat, is_space_end) in space_link_ends(self.network).into_iter().enumerate() {
            if mats.kind[mat] == MatKind::Sol && !is_space_end {
                continue;
            }
            let (motion, rest) = match &self.sources[mat] {
                Some(source) => (source.motion, source.rest),
                None => {
                    let is_unmoved = plan.motionless_mats.binary_search(&(mat as u32)).is_ok();
                    let is_moved = mats.kind[mat] != MatKind::Sol && !is_unmoved;
                    (PointMotion::NotComputed { is_moved }, self.rest_position(mat))
                }
            };
            points.push(VisiblePoint {
                mat,
                part: mats.part[mat] as usize,
                rest,
                motion,
            });
        }
        points.sort_by_key(|point| (point.part, point_sort_key(point.motion), point.mat));
        let point_numbers: HashMap<usize, usize> = (points.iter().enumerate())
            .map(|(point_index, point)| (point.mat, point_index))
            .collect();
        let (mut bodies, mut n_modes) = (Vec::new(), 0);
        for body in &mut self.bodies {
            let mode_count = body.modes.len();
            let compare_pitch = |a: &TrackedMode, b: &TrackedMode| {
                (a.oscillation.omega.total_cmp(&b.oscillation.omega))
                    .then((a.unit_and_body, a.mode).cmp(&(b.unit_and_body, b.mode)))
            };
            body.modes.sort_by(compare_pitch);
            body.modes.truncate(MODES_MAX);
            let body_modes = &body.modes;
            let shape_rows = body.mats.iter();
            bodies.push(VisibleBody {
                n_modes: mode_count,
                modes: body_modes.iter().map(|mode| mode.oscillation).collect(),
                first_mode: n_modes,
                points: body.mats.iter().map(|(mat, _)| point_numbers[mat]).collect(),
                shapes: shape_rows
                    .flat_map(|&(_, row)| body_modes.iter().map(move |mode| mode.shape[row]))
                    .collect(),
            });
            n_modes += body_modes.len();
        }
        MotionLook {
            sources: self.sources(&points, &bodies),
            bodies,
            contacts: self.contacts,
            plan,
            n_modes,
            contacts_by_unit: self.contacts_by_unit,
            gestures_by_unit: self.gestures_by_unit,
            breakable_links: self.breakable_links,
            breakable_links_by_unit: self.breakable_links_by_unit,
            points,
        }
    }

    /// Where the numbers of points and modes come from, grouped by source.
    fn sources(&self, points: &[VisiblePoint], bodies: &[VisibleBody]) -> Vec<(usize, TrackSource)> {
        type SourceKey = (usize, u8, usize);
        let mut source_by_key: BTreeMap<SourceKey, TrackSource> = BTreeMap::new();
        for (point_index, point) in points.iter().enumerate() {
            let (Some(mat_source), track) = (&self.sources[point.mat], point_index as u32) else {
                continue;
            };
            let (source_key, index) = match mat_source.position_source {
                PositionSource::Mass(index) => ((mat_source.unit, 0, 0), index),
                PositionSource::Mesh(body, index) => ((mat_source.unit, 1, body), index),
                PositionSource::Slow(body, index) => ((mat_source.unit, 2, body), index),
                PositionSource::Bank(index) => ((mat_source.unit, 3, 0), index),
                PositionSource::Body => continue,
            };
            let source = source_by_key
                .entry(source_key)
                .or_insert_with(|| match mat_source.position_source {
                    PositionSource::Mass(_) => TrackSource::Masses(Vec::new()),
                    PositionSource::Mesh(body, _) => TrackSource::Mesh(body, Vec::new()),
                    PositionSource::Slow(body, _) => TrackSource::Slow(body, Vec::new()),
                    PositionSource::Bank(_) | PositionSource::Body => TrackSource::Bank(Vec::new()),
                });
            match source {
                TrackSource::Masses(mat_tracks)
                | TrackSource::Mesh(_, mat_tracks)
                | TrackSource::Slow(_, mat_tracks) => {
                    mat_tracks.push((index as u32, track, point.rest));
                }
                TrackSource::Bank(oscillator_tracks) => oscillator_tracks.push((index as u32, track)),
                TrackSource::Modes(..) => {}
            }
        }
        let mut sources: Vec<(usize, TrackSource)> = source_by_key
            .into_iter()
            .map(|((unit_index, _, _), source)| (unit_index, source))
            .collect();
        for (recorded, body) in self.bodies.iter().zip(bodies) {
            let mut tracks_by_body = BTreeMap::<_, Vec<(u32, u32)>>::new();
            for (mode, track) in recorded.modes.iter().zip(points.len() + body.first_mode..) {
                let body_tracks = tracks_by_body.entry(mode.unit_and_body).or_default();
                body_tracks.push((mode.mode as u32, track as u32));
            }
            for ((unit_index, body_index), mode_and_tracks) in tracks_by_body {
                let source = match body_index {
                    None => TrackSource::Bank(mode_and_tracks),
                    Some(body_index) => {
                        let last_mode = mode_and_tracks.iter().map(|(mode, _)| *mode as usize).max();
                        let mut mode_tracks = vec![None; last_mode.map_or(0, |last_mode| last_mode + 1)];
                        mode_and_tracks
                            .iter()
                            .for_each(|(mode, track)| mode_tracks[*mode as usize] = Some(*track));
                        TrackSource::Modes(body_index, mode_tracks)
                    }
                };
                sources.push((unit_index, source));
            }
        }
        sources
    }
}

/// Sort key of points within a part.
fn point_sort_key(motion: PointMotion) -> (u8, usize) {
    match motion {
        PointMotion::Free(_) => (0, 0),
        PointMotion::Sampled => (1, 0),
        PointMotion::Modal(body) => (2, body),
        PointMotion::NotComputed { is_moved } => (3, usize::from(is_moved)),
    }
}

/// LIAs that may break, each with its ends as MATs of the whole network.
fn breakable_links(
    network: &Network,
    to_network: impl Fn(usize) -> usize,
) -> impl Iterator<Item = (usize, NumberedEnds)> {
    let mut pair_counts: HashMap<(usize, usize), u32> = HashMap::new();
    let breakable_runs = network.runs().iter().filter(|run| run.kind.may_break());
    let links = breakable_runs.flat_map(|run| (0..run.len).map(move |i| (run.first + i, run.pair(i, 0))));
    links.map(move |(link, (first_end, second_end))| {
        let (first_end, second_end) = (to_network(first_end), to_network(second_end));
        let next_number = pair_counts.entry((first_end, second_end)).or_default();
        *next_number += 1;
        (link, (first_end, second_end, *next_number - 1))
    })
}

/// Whether a MAT belongs to a link in space: a fixed point is seen only if a link in space holds on to it   (n_mat)
fn space_link_ends(network: &Network) -> Vec<bool> {
    let mut is_space_end = vec![false; network.n_mat()];
    for run in network.runs().iter().filter(|run| run.n_axes() > 1) {
        for (a, b) in (0..run.len).flat_map(|i| run.pairs(i)) {
            (is_space_end[a], is_space_end[b]) = (true, true);
        }
    }
    is_space_end
}

fn moving_mats(network: &Network) -> Vec<usize> {
    let mat_kinds = network.mats().kind.iter().enumerate();
    mat_kinds.filter(|(_, kind)| kind.moves()).map(|(mat, _)| mat).collect()
}
