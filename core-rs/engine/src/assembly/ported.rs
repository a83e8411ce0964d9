//! Bodies cut out of an island: computed by their modes, by a method for meshes or at a slow rate, and coupled to the
//! rest at their ports.

use std::sync::Arc;

use crate::assembly::body::{impulses_by_mat, position_and_spring_sums, position_sums_only};
use crate::assembly::budget::Budget;
use crate::assembly::choice::{BodyChoice, MeshChoice, SteppedChoice};
use crate::assembly::complex_body::{self, ModeSequence};
use crate::assembly::constants::{COMPLEX_COST_RATIO_MAX, STEPPED_TIES_MAX};
use crate::assembly::cost;
use crate::assembly::mesh::{self, MethodChoice};
use crate::assembly::slow::slow_bodies;
use crate::assembly::solved_modes::ModeCache;
use crate::assembly::split::{LocalTimeline, split};
use crate::assembly::wiring::{BodyLinks, WantedBodies, WiredBody};
use crate::body_modes::complex_modes::Sum;
use crate::body_modes::linear::NoModes;
use crate::body_modes::normal_modes::{Modes, Row};
use crate::cell::Response;
use crate::island::bodies::BodyPlan;
use crate::island::modal::{ComplexResponses, Modal, Mode, Port, StruckPoint};
use crate::network::forest::link_ends;
use crate::network::{Error, Network, Subset, Term};
use crate::timeline::Timeline;
use crate::units::Rate;

/// An island divided into bodies and the rest, which is stepped.
pub(crate) struct IslandCut {
    /// The rest, which is stepped; ports of bodies are masses in it.
    pub(crate) hub: Subset,
    pub(crate) timeline: LocalTimeline,
    pub(crate) bodies: Vec<PortedBody>,
}

/// A body that is cut out of its island and computed by a method of its own.
#[derive(Clone)]
pub(crate) struct PortedBody {
    pub(crate) plan: BodyPlan,
    /// MATs and LIAs that are no longer stepped.
    pub(crate) n_mats: usize,
    pub(crate) n_links: usize,
    pub(crate) parts: Vec<String>,
    /// If it has modes: how many, which are computed, and how loud the others would be together [dB].
    pub(crate) n_modes: usize,
    pub(crate) computed_modes: Vec<u32>,
    pub(crate) left_out_db: Option<f64>,
    /// It is stepped as a mesh although it could go by modes.
    pub(crate) replaces_modes: bool,
}

/// Cuts bodies out of an island: linear ones by their modes, other meshes by a method of their own. Returns `None` if
/// no body is worth it, and why some bodies have no modes. `steps_max`: most contact substeps a step.
pub(crate) fn cut_bodies(
    island: &Subset,
    timeline: &Timeline,
    budget: &Budget,
    (pin, steps_max): (Option<&SteppedChoice>, usize),
    choice: MethodChoice<'_>,
    mode_cache: &ModeCache<'_>,
) -> (Option<IslandCut>, Option<NoModes>) {
    let network = &island.network;
    let mut wiring = BodyLinks::new(network, timeline);
    let (mut cut_bodies, mut modes_refusal) = (Vec::new(), None);
    let slow_bodies = slow_bodies(network, timeline).bodies;
    // If an earlier decision took out the slow bodies alone, no others are taken out.
    let may_cut = !matches!(choice, MethodChoice::Stepped);
    let has_bodies = may_cut && pin.is_none_or(|pin| pin.bodies.len() > slow_bodies.len());
    let prefers_meshes = match pin {
        Some(pin) => pin.bodies.iter().any(replaces_modes),
        None => matches!(choice, MethodChoice::Meshes(_)),
    };
    for (body, slow_plan) in slow_bodies {
        wiring.exclude_mats(&body.mats);
        cut_bodies.push((body, BodyPlan::Slow(slow_plan)));
    }
    // The certificate for slow parts covers normal modes only. In a session contacts between frames take up to twice
    // as long on complex modes as on steps, for no mode is left out.
    let has_slow_bodies = !cut_bodies.is_empty();
    let is_fine_session = timeline.is_open && steps_max > 1;
    let needs_normal_modes = |body: &WiredBody| has_slow_bodies || (is_fine_session && body.touches_contact());
    if budget.allows_modes() && has_bodies && !prefers_meshes {
        let wanted_bodies = match budget.contact_substeps() {
            1 => WantedBodies::Linear,
            _ => WantedBodies::Touched,
        };
        for body in wiring.bodies(network, wanted_bodies) {
            let modal_plan = match normal_mode_plan(network, timeline, &body, mode_cache) {
                Err(NoModes::Damping) if !needs_normal_modes(&body) => {
                    complex_mode_plan(network, timeline, &body, mode_cache)
                }
                modes_result => modes_result.map(BodyPlan::Modal),
            };
            match modal_plan {
                Ok(modal) => cut_bodies.push((body, modal)),
                Err(reason) => match plan_without_ties(network, timeline, &body, mode_cache) {
                    Some((body, modal)) => cut_bodies.push((body, BodyPlan::Modal(modal))),
                    None => modes_refusal = Some(reason),
                },
            }
        }
    }
    if budget.allows_mesh_methods() && has_bodies {
        for (body, _) in &cut_bodies {
            wiring.exclude_mats(&body.mats);
        }
        // If one method is asked for, it steps the smallest body too.
        let is_method_asked = prefers_meshes || matches!(budget, Budget::Method(_));
        let wanted_bodies = if is_method_asked {
            WantedBodies::All
        } else {
            WantedBodies::Meshes
        };
        for body in wiring.bodies(network, wanted_bodies) {
            let mesh_pin = match pin.map(|pin| pin.bodies.get(cut_bodies.len())) {
                None => None,
                Some(Some(BodyChoice::Mesh(mesh_choice))) => Some(*mesh_choice),
                Some(_) => continue,
            };
            if let Some(body_mesh) = mesh::mesh(network, timeline, &body, budget, mesh_pin, (choice, cut_bodies.len()))
            {
                cut_bodies.push((body, BodyPlan::Mesh(body_mesh)));
            }
        }
    }
    if cut_bodies.is_empty() {
        return (None, modes_refusal);
    }
    let mut island_cut = hub_and_bodies(island, timeline, cut_bodies);
    let ported_bodies = island_cut.bodies.iter_mut();
    ported_bodies.for_each(|body| body.replaces_modes = prefers_meshes);
    (Some(island_cut), modes_refusal)
}

/// Whether it was decided that a body is stepped although it could be computed by modes.
fn replaces_modes(body: &BodyChoice) -> bool {
    matches!(body, BodyChoice::Mesh(mesh) if mesh.replaces_modes)
}

/// Refuses meshes that the method asked for by name cannot step.
///
/// # Errors
/// With the name of a module of such a mesh.
pub(crate) fn check_supported(network: &Network, timeline: &Timeline, budget: &Budget) -> Result<(), Error> {
    let Budget::Method(method) = budget else {
        return Ok(());
    };
    let Some(mesh_method) = method.mesh_method() else {
        return Ok(());
    };
    let mut wiring = BodyLinks::new(network, timeline);
    for (body, _) in slow_bodies(network, timeline).bodies {
        wiring.exclude_mats(&body.mats);
    }
    let mesh_bodies = wiring.bodies(network, WantedBodies::All);
    let check_body = |body: &WiredBody| mesh::check_supported(network, timeline.rate, body, mesh_method);
    mesh_bodies.iter().try_for_each(check_body)
}

impl PortedBody {
    /// What was decided for the body.
    pub(crate) fn choice(&self) -> BodyChoice {
        match &self.plan {
            BodyPlan::Modal(_) => BodyChoice::Modes(self.computed_modes.clone()),
            BodyPlan::Mesh(mesh) => BodyChoice::Mesh(MeshChoice {
                method: mesh.method,
                substeps: mesh.substeps,
                replaces_modes: self.replaces_modes,
            }),
            BodyPlan::Slow(slow) => BodyChoice::Slow {
                macrostep: slow.macrostep,
            },
        }
    }
}

/// An island that no body is cut out of.
pub(crate) fn uncut_island(island: &Subset, island_timeline: &LocalTimeline, timeline: Timeline) -> IslandCut {
    let all_indices = |n: usize| (0..n as u32).collect::<Vec<u32>>();
    let hub = Subset {
        mats: all_indices(island.mats.len()),
        links: all_indices(island.links.len()),
        outputs: all_indices(island.outputs.len()),
        network: island.network.clone(),
    };
    let island_timeline = LocalTimeline {
        timeline,
        keys: all_indices(island_timeline.keys.len()),
        gestures: all_indices(island_timeline.gestures.len()),
    };
    IslandCut {
        hub,
        timeline: island_timeline,
        bodies: Vec::new(),
    }
}

/// A body by its modes; ports by their index in the island.
fn normal_mode_plan(
    network: &Network,
    timeline: &Timeline,
    body: &WiredBody,
    mode_cache: &ModeCache<'_>,
) -> Result<Modal, NoModes> {
    let rate = timeline.rate;
    let body_subset = network.subset(&body.mats, &body.foreign_held_mats, &body.links);
    let outputs = position_and_spring_sums(&body_subset.network)?;
    let local_mat = |mat: &u32| body_subset.mat(*mat as usize).unwrap_or(0);
    let row = |mat: usize| vec![(mat, 1.0)];
    let port_mats: Vec<usize> = body.ports.iter().map(local_mat).collect();
    let strikes = impulses_by_mat(
        timeline,
        |mat| body.mats.binary_search(&mat).is_ok(),
        is_discrete(network, body),
    );
    let struck_mats: Vec<usize> = strikes.keys().map(local_mat).collect();
    let (port_count, n_outputs) = (port_mats.len(), body_subset.outputs.len());
    let mut body_rows: Vec<Row> = port_mats.iter().copied().map(row).collect();
    body_rows.extend(outputs.position_rows);
    body_rows.extend(struck_mats.iter().copied().map(row));
    let mut body_modes = mode_cache.normal_modes(&body_subset.network, &body_rows, rate)?;
    let mode_count = body_modes.len();
    // What a session will strike is not known: any mode may move.
    let rotation_mats = (!timeline.is_open).then(|| [port_mats, struck_mats].concat());
    if rotation_mats.is_some() {
        let moved_rows: Vec<usize> = (0..port_count).chain(port_count + n_outputs..body_rows.len()).collect();
        body_modes.rotate(&moved_rows, rate);
    }
    if let Some(unfit_reason) = body_modes.unfit_reason(rate) {
        return Err(unfit_reason);
    }
    let rest_of_row = |row: usize| -> f64 {
        body_modes.shapes[row]
            .iter()
            .zip(&body_modes.rest)
            .map(|(a, b)| a * b)
            .sum()
    };
    let rest_outputs = (0..n_outputs)
        .map(|row| rest_of_row(port_count + row) + outputs.constant_sums[row])
        .collect();
    Ok(Modal {
        mode_numbers: (0..mode_count as u32).collect(),
        alignment_mats: rotation_mats,
        modes: (0..mode_count)
            .map(|mode| normal_mode(&body_modes, mode, rate))
            .collect(),
        ports: body
            .ports
            .iter()
            .enumerate()
            .map(|(row, &mat)| Port {
                mat: mat as usize,
                rest_position: rest_of_row(row),
                shape: body_modes.shapes[row].clone(),
            })
            .collect(),
        outputs: body_subset
            .outputs
            .iter()
            .enumerate()
            .map(|(row, &output)| (output, body_modes.shapes[port_count + row].clone()))
            .collect(),
        rest_outputs,
        struck_points: strikes
            .into_values()
            .enumerate()
            .map(|(row, blows)| StruckPoint {
                shape: body_modes.shapes[port_count + n_outputs + row].clone(),
                strikes: blows.frame_impulses,
            })
            .collect(),
        rate,
        network: Arc::new(body_subset.network),
        complex_responses: None,
    })
}

/// A body by its modes without its ties to fixed points, which are stepped as links at its ports: a gong hung by a
/// nail, whose tie has other losses than its metal.
fn plan_without_ties(
    network: &Network,
    timeline: &Timeline,
    body: &WiredBody,
    mode_cache: &ModeCache<'_>,
) -> Option<(WiredBody, Modal)> {
    let body = body.without_ties(network, STEPPED_TIES_MAX)?;
    let modal = normal_mode_plan(network, timeline, &body, mode_cache).ok()?;
    Some((body, modal))
}

/// A body by its complex modes; ports by their index in the island.
fn complex_mode_plan(
    network: &Network,
    timeline: &Timeline,
    body: &WiredBody,
    mode_cache: &ModeCache<'_>,
) -> Result<BodyPlan, NoModes> {
    let rate = timeline.rate;
    let body_subset = network.subset(&body.mats, &body.foreign_held_mats, &body.links);
    let outputs = position_sums_only(&body_subset.network)?;
    let local_mat = |mat: &u32| body_subset.mat(*mat as usize).unwrap_or(0);
    let port_mats: Vec<usize> = body.ports.iter().map(local_mat).collect();
    let is_body_mat = |mat| body.mats.binary_search(&mat).is_ok();
    let strikes = impulses_by_mat(timeline, is_body_mat, false);
    let force_points: Vec<usize> = port_mats.iter().copied().chain(strikes.keys().map(local_mat)).collect();
    let port_rows = port_mats.iter().map(|&mat| vec![(mat, 1.0)]);
    let output_sums: Vec<Sum> = port_rows
        .chain(outputs.position_rows)
        .map(Sum::from_positions)
        .collect();
    let body_modes = mode_cache.complex_modes(&body_subset.network, &output_sums, &force_points, rate)?;
    let all_modes: Vec<usize> = (0..body_modes.len()).collect();
    let (port_count, sequences) = (
        port_mats.len(),
        complex_body::audible_sequences(&body_modes, &all_modes, rate),
    );
    let shape_of_row = |row: usize| -> Vec<f64> {
        let parts = sequences.iter();
        parts
            .map(|part| part.sign * body_modes.output_shapes[row][part.mode][part.component])
            .collect()
    };
    let responses_at = |point: usize| -> Vec<Response> {
        let parts = sequences.iter();
        parts
            .map(|part| complex_body::impulse_response(&body_modes, part, point, rate))
            .collect()
    };
    let static_sums = body_modes.rest[port_count..].iter().zip(&outputs.constant_sums);
    let modal_plan = Modal {
        mode_numbers: (0..sequences.len() as u32).collect(),
        alignment_mats: None,
        modes: sequences.iter().map(sequence_mode).collect(),
        ports: (0..port_count)
            .map(|row| Port {
                mat: body.ports[row] as usize,
                rest_position: body_modes.rest[row],
                shape: shape_of_row(row),
            })
            .collect(),
        outputs: (0..)
            .zip(&body_subset.outputs)
            .map(|(row, &output): (usize, _)| (output, shape_of_row(port_count + row)))
            .collect(),
        rest_outputs: static_sums.map(|(rest, constant_part)| rest + constant_part).collect(),
        struck_points: strikes
            .into_values()
            .map(|blows| StruckPoint {
                shape: vec![1.0; sequences.len()],
                strikes: blows.frame_impulses,
            })
            .collect(),
        rate,
        network: Arc::new(body_subset.network),
        complex_responses: Some(ComplexResponses {
            n_modes: body_modes.len(),
            mode_parts: complex_body::complex_parts(&sequences),
            port_responses: (0..port_count).map(responses_at).collect(),
            struck_responses: (port_count..force_points.len()).map(responses_at).collect(),
        }),
    };
    // The largest cost allowed: the same masses stepped module by module, times `COMPLEX_COST_RATIO_MAX`. A few masses
    // that contacts touch would create energy if they were stepped.
    let cost_limit = COMPLEX_COST_RATIO_MAX * cost::stepped_ns(&modal_plan.network, &Timeline::new(rate));
    let modal_plan = BodyPlan::Modal(modal_plan);
    let is_cheap_enough = body.is_small() || cost::body_ns(&modal_plan) <= cost_limit;
    is_cheap_enough.then_some(modal_plan).ok_or(NoModes::TooManyPorts)
}

/// A part of a complex mode as a mode with a response of its own.
fn sequence_mode(sequence: &ModeSequence) -> Mode {
    let (a, b) = sequence.recurrence;
    Mode {
        a,
        b,
        displacement_per_newton: 0.0,
        start_amplitude: sequence.now,
        previous_amplitude: sequence.before,
        cell: None,
    }
}

fn is_discrete(network: &Network, body: &WiredBody) -> bool {
    let body_part = network.mats().part[body.mats[0] as usize] as usize;
    network.parts()[body_part].ca_rate.is_some()
}

fn normal_mode(modes: &Modes, mode: usize, rate: Rate) -> Mode {
    let (mode_ratios, mode_cell) = (modes.ratios(mode, rate), modes.resolvable_cell(mode, rate));
    Mode {
        a: 2.0 - mode_ratios.kappa - mode_ratios.zeta,
        b: 1.0 - mode_ratios.zeta,
        displacement_per_newton: if modes.is_discrete {
            1.0
        } else {
            rate.step() * mode_cell.response(rate.step())
        },
        start_amplitude: modes.x0[mode] - modes.rest[mode],
        previous_amplitude: modes.position_before(mode, rate),
        cell: (!modes.is_discrete).then_some(mode_cell),
    }
}

/// The rest of an island after the bodies are cut out: their ports stay, as masses that respond to a force at once as
/// in the body.
fn hub_and_bodies(island: &Subset, timeline: &Timeline, cut_bodies: Vec<(WiredBody, BodyPlan)>) -> IslandCut {
    let network = &island.network;
    let (mut is_in_body, mut is_cut_link) = (vec![false; network.n_mat()], vec![false; network.n_lia()]);
    let mut port_mats: Vec<u32> = Vec::new();
    let mut is_struck_in_body = vec![false; network.n_mat()];
    for (body, body_plan) in &cut_bodies {
        for &mat in &body.mats {
            is_in_body[mat as usize] = true;
            // A slow body is struck at its ports, in the rest of the island.
            is_struck_in_body[mat as usize] = !matches!(body_plan, BodyPlan::Slow(_));
        }
        body.links.iter().for_each(|&link| is_cut_link[link as usize] = true);
        port_mats.extend(&body.ports);
    }
    port_mats.sort_unstable();
    let all_indices = 0..network.n_lia() as u32;
    let hub_links: Vec<u32> = all_indices.filter(|&link| !is_cut_link[link as usize]).collect();
    let stays_in_hub = mats_of_hub(network, timeline, &is_cut_link);
    let all_indices = 0..network.n_mat() as u32;
    let hub_mats: Vec<u32> = all_indices
        .filter(|&mat| !is_in_body[mat as usize] && stays_in_hub[mat as usize])
        .collect();
    let mut hub = network.subset_with_all_outputs(&hub_mats, &port_mats, &hub_links);
    let mut timeline = timeline.clone();
    timeline
        .strikes
        .retain(|strike| !is_struck_in_body[strike.mat as usize]);
    let mut bodies = Vec::new();
    for (body, mut inner_plan) in cut_bodies {
        let local_mat = |mat: usize| hub.mat(mat).unwrap_or(0);
        let mode_count = match &mut inner_plan {
            BodyPlan::Modal(modal) => {
                for port in &mut modal.ports {
                    port.mat = local_mat(port.mat);
                }
                modal.modes.len()
            }
            BodyPlan::Mesh(mesh) => {
                for (_, mat) in &mut mesh.ports {
                    *mat = local_mat(*mat);
                }
                0
            }
            BodyPlan::Slow(slow) => {
                for (_, mat) in &mut slow.ports {
                    *mat = local_mat(*mat);
                }
                0
            }
        };
        set_port_masses(&mut hub.network, &inner_plan);
        bodies.push(PortedBody {
            n_mats: body.mats.len(),
            n_links: body.links.len(),
            parts: network.moving_parts_among(&body.mats),
            left_out_db: None,
            n_modes: mode_count,
            computed_modes: (0..mode_count as u32).collect(),
            replaces_modes: false,
            plan: inner_plan,
        });
    }
    let hub_split = split(vec![hub], &timeline).pop();
    let (hub, hub_timeline) = hub_split.unwrap_or_else(|| unreachable!("one subset in, one out"));
    IslandCut {
        hub,
        timeline: hub_timeline,
        bodies,
    }
}

/// MATs that stay in the rest: those that move, that are driven or heard, or that a remaining link ends on; not points
/// that only held bodies.
fn mats_of_hub(network: &Network, timeline: &Timeline, is_cut_link: &[bool]) -> Vec<bool> {
    let mat_kinds = network.mats().kind.iter();
    let mut is_used_mat: Vec<bool> = mat_kinds.map(|&kind| !kind.is_held()).collect();
    for proxy in network.proxies() {
        let proxy_mats = proxy.masses().chain(proxy.guide_mats());
        proxy_mats.for_each(|mat| is_used_mat[mat] = true);
    }
    for (_, guide) in network.follower_pairs() {
        is_used_mat[guide] = true;
    }
    for (_, a, b) in link_ends(network).filter(|&(link, _, _)| !is_cut_link[link]) {
        (is_used_mat[a], is_used_mat[b]) = (true, true);
    }
    timeline.driven_mats().for_each(|mat| is_used_mat[mat] = true);
    for term in network.outputs().iter().flat_map(|output| &output.terms) {
        if let Term::Position { first, len, .. } | Term::Ground { first, len, .. } = *term {
            is_used_mat[first..first + len].fill(true);
        }
    }
    is_used_mat
}

/// Sets the mass of each port to what responds to a force within a step as the body does.
pub(crate) fn set_port_masses(hub: &mut Network, body_plan: &BodyPlan) {
    match body_plan {
        BodyPlan::Modal(modal) => {
            let time_step = modal.rate.step();
            let mass_scale = if modal.is_discrete() {
                1.0
            } else {
                time_step * time_step
            };
            for (port_index, port) in modal.ports.iter().enumerate() {
                hub.set_free(port.mat, mass_scale / modal.port_compliance(port_index));
            }
        }
        BodyPlan::Mesh(mesh) => {
            for &(local, mat) in &mesh.ports {
                hub.set_free(mat, mesh.network.mats().m[local]);
            }
        }
        BodyPlan::Slow(slow) => {
            for &(local, mat) in &slow.ports {
                hub.set_free(mat, slow.network.mats().m[slow.free_mats[local]]);
                hub.set_weightless(mat);
            }
        }
    }
}
