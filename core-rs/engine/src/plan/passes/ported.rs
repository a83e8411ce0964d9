//! Bodies cut out of an island: computed by their modes, by a method for meshes or at a slow rate, and coupled to the
//! rest at their ports.

use std::sync::Arc;

use crate::cell::Response;
use crate::island::inside::BodyPlan;
use crate::island::modal::{Answers, Modal, Mode, Port, Struck};
use crate::network::forest::ends;
use crate::network::{Error, Network, Subset, Term};
use crate::plan::budget::Budget;
use crate::plan::choice::{BodyChoice, MeshChoice, SteppedChoice};
use crate::plan::constants::{COST_RATIO_MAX, TIES_MAX};
use crate::plan::cost;
use crate::plan::passes::body::{blows, output_sums, position_sums};
use crate::plan::passes::complex_body::{self, Part};
use crate::plan::passes::complex_modes::Sum;
use crate::plan::passes::linear::NoModes;
use crate::plan::passes::mesh::{self, MethodChoice};
use crate::plan::passes::modes::{Modes, Row};
use crate::plan::passes::slow::slow_bodies;
use crate::plan::passes::solved_modes::Memo;
use crate::plan::passes::split::{OwnTimeline, split};
use crate::plan::passes::wiring::{Body, Wanted, Wiring};
use crate::timeline::Timeline;
use crate::units::Rate;

/// An island divided into bodies and the rest, which is stepped.
pub(in crate::plan) struct Cut {
    /// The rest, which is stepped; ports of bodies are masses in it.
    pub(in crate::plan) hub: Subset,
    pub(in crate::plan) timeline: OwnTimeline,
    pub(in crate::plan) bodies: Vec<PortedBody>,
}

/// A body that is cut out of its island and computed by a method of its own.
#[derive(Clone)]
pub(in crate::plan) struct PortedBody {
    pub(in crate::plan) inside: BodyPlan,
    /// MATs and LIAs that are no longer stepped.
    pub(in crate::plan) mats: usize,
    pub(in crate::plan) links: usize,
    pub(in crate::plan) parts: Vec<String>,
    /// If it has modes: how many, which are computed, and how loud the others would be together [dB].
    pub(in crate::plan) n_modes: usize,
    pub(in crate::plan) computed_modes: Vec<u32>,
    pub(in crate::plan) left_out: Option<f64>,
    /// It is stepped as a mesh although it could go by modes.
    pub(in crate::plan) replaces_modes: bool,
}

/// Cuts bodies out of an island: linear ones by their modes, other meshes by a method of their own. Returns `None` if
/// no body is worth it, and why some bodies have no modes.
pub(in crate::plan) fn cut(
    island: &Subset,
    timeline: &Timeline,
    budget: &Budget,
    pin: Option<&SteppedChoice>,
    choice: MethodChoice<'_>,
    memo: &Memo<'_>,
) -> (Option<Cut>, Option<NoModes>) {
    let network = &island.network;
    let mut wiring = Wiring::new(network, timeline);
    let (mut inside, mut why) = (Vec::new(), None);
    let slow_bodies = slow_bodies(network, timeline).bodies;
    // An island that was decided to have no bodies but its slow ones gets no others.
    let are_apart = !matches!(choice, MethodChoice::Stepped);
    let has_bodies = are_apart && pin.is_none_or(|pin| pin.bodies.len() > slow_bodies.len());
    let are_meshes = match pin {
        Some(pin) => pin.bodies.iter().any(replaces_modes),
        None => matches!(choice, MethodChoice::Meshes(_)),
    };
    for (body, slow) in slow_bodies {
        wiring.take(&body.mats);
        inside.push((body, BodyPlan::Slow(slow)));
    }
    // The certificate for slow parts covers normal modes only, and a takeover transfers the motion of a body mass by
    // mass through normal modes.
    let takes_complex = inside.is_empty() && !timeline.is_open;
    if budget.takes_modes() && has_bodies && !are_meshes {
        let wanted = match budget.contact_substeps() {
            1 => Wanted::Linear,
            _ => Wanted::Touched,
        };
        for body in wiring.bodies(network, wanted) {
            let modal_plan = match modal(network, timeline, &body, memo) {
                Err(NoModes::Damping) if takes_complex => complex(network, timeline, &body, memo),
                known => known.map(BodyPlan::Modal),
            };
            match modal_plan {
                Ok(modal) => inside.push((body, modal)),
                Err(reason) => match untied(network, timeline, &body, memo) {
                    Some((body, modal)) => inside.push((body, BodyPlan::Modal(modal))),
                    None => why = Some(reason),
                },
            }
        }
    }
    if budget.takes_meshes() && has_bodies {
        for (body, _) in &inside {
            wiring.take(&body.mats);
        }
        // If one method is asked for, it steps the smallest body too.
        let is_asked = are_meshes || matches!(budget, Budget::Method(_));
        let wanted = if is_asked {
            Wanted::All
        } else {
            Wanted::Meshes
        };
        for body in wiring.bodies(network, wanted) {
            let pin = match pin.map(|pin| pin.bodies.get(inside.len())) {
                None => None,
                Some(Some(BodyChoice::Mesh(pin))) => Some(*pin),
                Some(_) => continue,
            };
            if let Some(mesh) = mesh::mesh(
                network,
                timeline,
                &body,
                budget,
                pin,
                (choice, inside.len()),
            ) {
                inside.push((body, BodyPlan::Mesh(mesh)));
            }
        }
    }
    if inside.is_empty() {
        return (None, why);
    }
    let mut cut = hub(island, timeline, inside);
    let bodies = cut.bodies.iter_mut();
    bodies.for_each(|body| body.replaces_modes = are_meshes);
    (Some(cut), why)
}

/// Whether it was decided that a body is stepped although it could be computed by modes.
fn replaces_modes(body: &BodyChoice) -> bool {
    matches!(body, BodyChoice::Mesh(mesh) if mesh.replaces_modes)
}

/// Refuses meshes that the method asked for by name cannot step.
///
/// # Errors
/// With the name of a module of such a mesh.
pub(in crate::plan) fn check_supported(
    network: &Network,
    timeline: &Timeline,
    budget: &Budget,
) -> Result<(), Error> {
    let Budget::Method(method) = budget else {
        return Ok(());
    };
    let Some(mesh_method) = method.mesh_method() else {
        return Ok(());
    };
    let mut wiring = Wiring::new(network, timeline);
    for (body, _) in slow_bodies(network, timeline).bodies {
        wiring.take(&body.mats);
    }
    let bodies = wiring.bodies(network, Wanted::All);
    let check = |body: &Body| mesh::check_supported(network, timeline.rate, body, mesh_method);
    bodies.iter().try_for_each(check)
}

impl PortedBody {
    /// What was decided for the body.
    pub(in crate::plan) fn choice(&self) -> BodyChoice {
        match &self.inside {
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
pub(in crate::plan) fn uncut_island(
    island: &Subset,
    island_timeline: &OwnTimeline,
    timeline: Timeline,
) -> Cut {
    let all = |n: usize| (0..n as u32).collect::<Vec<u32>>();
    let hub = Subset {
        mats: all(island.mats.len()),
        links: all(island.links.len()),
        outputs: all(island.outputs.len()),
        network: island.network.clone(),
    };
    let island_timeline = OwnTimeline {
        timeline,
        keys: all(island_timeline.keys.len()),
        gestures: all(island_timeline.gestures.len()),
    };
    Cut {
        hub,
        timeline: island_timeline,
        bodies: Vec::new(),
    }
}

/// A body by its modes; ports by their index in the island.
fn modal(
    network: &Network,
    timeline: &Timeline,
    body: &Body,
    memo: &Memo<'_>,
) -> Result<Modal, NoModes> {
    let rate = timeline.rate;
    let subset = network.subset(&body.mats, &body.guests, &body.links);
    let outputs = position_sums(&subset.network)?;
    let local = |mat: &u32| subset.mat(*mat as usize).unwrap_or(0);
    let row = |mat: usize| vec![(mat, 1.0)];
    let ports: Vec<usize> = body.ports.iter().map(local).collect();
    let strikes = blows(
        timeline,
        |mat| body.mats.binary_search(&mat).is_ok(),
        is_discrete(network, body),
    );
    let struck: Vec<usize> = strikes.keys().map(local).collect();
    let (n_ports, n_out) = (ports.len(), subset.outputs.len());
    let mut rows: Vec<Row> = ports.iter().copied().map(row).collect();
    rows.extend(outputs.rows);
    rows.extend(struck.iter().copied().map(row));
    let mut modes = memo.modes(&subset.network, &rows, rate)?;
    let n = modes.len();
    // What a session will strike is not known: any mode may move.
    let turned = (!timeline.is_open).then(|| [ports, struck].concat());
    if turned.is_some() {
        let moved: Vec<usize> = (0..n_ports).chain(n_ports + n_out..rows.len()).collect();
        modes.rotate(&moved, rate);
    }
    if let Some(why) = modes.unfit(rate) {
        return Err(why);
    }
    let rest = |row: usize| -> f64 {
        modes.shapes[row]
            .iter()
            .zip(&modes.rest)
            .map(|(a, b)| a * b)
            .sum()
    };
    let still = (0..n_out)
        .map(|row| rest(n_ports + row) + outputs.held[row])
        .collect();
    Ok(Modal {
        computed: (0..n as u32).collect(),
        turned,
        modes: (0..n).map(|mode| mode_plan(&modes, mode, rate)).collect(),
        ports: body
            .ports
            .iter()
            .enumerate()
            .map(|(row, &mat)| Port {
                mat: mat as usize,
                rest: rest(row),
                shape: modes.shapes[row].clone(),
            })
            .collect(),
        outputs: subset
            .outputs
            .iter()
            .enumerate()
            .map(|(row, &output)| (output, modes.shapes[n_ports + row].clone()))
            .collect(),
        still,
        struck: strikes
            .into_values()
            .enumerate()
            .map(|(row, blows)| Struck {
                shape: modes.shapes[n_ports + n_out + row].clone(),
                blows: blows.parts,
            })
            .collect(),
        rate,
        network: Arc::new(subset.network),
        answers: None,
    })
}

/// A body by its modes without its ties to fixed points, which are stepped as links at its ports: a gong hung by a
/// nail, whose tie has other losses than its metal.
fn untied(
    network: &Network,
    timeline: &Timeline,
    body: &Body,
    memo: &Memo<'_>,
) -> Option<(Body, Modal)> {
    let body = body.untied(network, TIES_MAX)?;
    let modal = modal(network, timeline, &body, memo).ok()?;
    Some((body, modal))
}

/// A body by its complex modes; ports by their index in the island.
fn complex(
    network: &Network,
    timeline: &Timeline,
    body: &Body,
    memo: &Memo<'_>,
) -> Result<BodyPlan, NoModes> {
    let rate = timeline.rate;
    let subset = network.subset(&body.mats, &body.guests, &body.links);
    let outputs = output_sums(&subset.network)?;
    let local = |mat: &u32| subset.mat(*mat as usize).unwrap_or(0);
    let ports: Vec<usize> = body.ports.iter().map(local).collect();
    let is_ours = |mat| body.mats.binary_search(&mat).is_ok();
    let strikes = blows(timeline, is_ours, false);
    let points: Vec<usize> = ports
        .iter()
        .copied()
        .chain(strikes.keys().map(local))
        .collect();
    let rows = ports.iter().map(|&mat| vec![(mat, 1.0)]);
    let sums: Vec<Sum> = rows.chain(outputs.rows).map(Sum::from_positions).collect();
    let modes = memo.complex(&subset.network, &sums, &points, rate)?;
    let every: Vec<usize> = (0..modes.len()).collect();
    let (n_ports, all) = (ports.len(), complex_body::parts(&modes, &every, rate));
    let shape = |row: usize| -> Vec<f64> {
        let parts = all.iter();
        parts
            .map(|own| own.sign * modes.seen[row][own.mode][own.part])
            .collect()
    };
    let answers = |point: usize| -> Vec<Response> {
        let parts = all.iter();
        parts
            .map(|own| complex_body::response(&modes, own, point))
            .collect()
    };
    let still = modes.rest[n_ports..].iter().zip(&outputs.held);
    let modal = Modal {
        computed: (0..all.len() as u32).collect(),
        turned: None,
        modes: all.iter().map(part_plan).collect(),
        ports: (0..n_ports)
            .map(|row| Port {
                mat: body.ports[row] as usize,
                rest: modes.rest[row],
                shape: shape(row),
            })
            .collect(),
        outputs: (0..)
            .zip(&subset.outputs)
            .map(|(row, &output): (usize, _)| (output, shape(n_ports + row)))
            .collect(),
        still: still.map(|(rest, held)| rest + held).collect(),
        struck: strikes
            .into_values()
            .map(|blows| Struck {
                shape: vec![1.0; all.len()],
                blows: blows.parts,
            })
            .collect(),
        rate,
        network: Arc::new(subset.network),
        answers: Some(Answers {
            n_modes: modes.len(),
            places: complex_body::places(&all),
            ports: (0..n_ports).map(answers).collect(),
            struck: (n_ports..points.len()).map(answers).collect(),
        }),
    };
    // The largest cost allowed: the same masses stepped module by module, times `COST_RATIO_MAX`. A few masses that contacts touch
    // would create energy if they were stepped.
    let stepped = COST_RATIO_MAX * cost::stepped_cost(&modal.network, &Timeline::new(rate));
    let modal = BodyPlan::Modal(modal);
    let is_cheap = body.is_small() || cost::body_cost(&modal) <= stepped;
    is_cheap.then_some(modal).ok_or(NoModes::Ports)
}

/// A part of a complex mode as a mode with a response of its own.
fn part_plan(part: &Part) -> Mode {
    let (a, b) = part.recurrence;
    Mode {
        a,
        b,
        gain: 0.0,
        now: part.now,
        before: part.before,
        cell: None,
    }
}

fn is_discrete(network: &Network, body: &Body) -> bool {
    let part = network.mats().part[body.mats[0] as usize] as usize;
    network.parts()[part].ca_rate.is_some()
}

fn mode_plan(modes: &Modes, mode: usize, rate: Rate) -> Mode {
    let (ratios, cell) = (modes.ratios(mode, rate), modes.cell(mode));
    Mode {
        a: 2.0 - ratios.kappa - ratios.zeta,
        b: 1.0 - ratios.zeta,
        gain: if modes.is_discrete {
            1.0
        } else {
            rate.step() * cell.response(rate.step())
        },
        now: modes.x0[mode] - modes.rest[mode],
        before: modes.before(mode, rate),
        cell: (!modes.is_discrete).then_some(cell),
    }
}

/// The rest of an island after the bodies are cut out: their ports stay, as masses that respond to a force at once as
/// in the body.
fn hub(island: &Subset, timeline: &Timeline, bodies_inside: Vec<(Body, BodyPlan)>) -> Cut {
    let network = &island.network;
    let (mut is_gone, mut is_cut) = (vec![false; network.n_mat()], vec![false; network.n_lia()]);
    let mut ports: Vec<u32> = Vec::new();
    let mut is_struck_there = vec![false; network.n_mat()];
    for (body, inside) in &bodies_inside {
        for &mat in &body.mats {
            is_gone[mat as usize] = true;
            // A slow body is struck at its ports, in the rest of the island.
            is_struck_there[mat as usize] = !matches!(inside, BodyPlan::Slow(_));
        }
        body.links
            .iter()
            .for_each(|&link| is_cut[link as usize] = true);
        ports.extend(&body.ports);
    }
    ports.sort_unstable();
    let all = 0..network.n_lia() as u32;
    let links: Vec<u32> = all.filter(|&link| !is_cut[link as usize]).collect();
    let is_used = used(network, timeline, &is_cut);
    let all = 0..network.n_mat() as u32;
    let mats: Vec<u32> = all
        .filter(|&mat| !is_gone[mat as usize] && is_used[mat as usize])
        .collect();
    let mut hub = network.subset_for_all(&mats, &ports, &links);
    let mut timeline = timeline.clone();
    timeline
        .strikes
        .retain(|strike| !is_struck_there[strike.mat as usize]);
    let mut bodies = Vec::new();
    for (body, mut inside) in bodies_inside {
        let local = |mat: usize| hub.mat(mat).unwrap_or(0);
        let inner_network = match &mut inside {
            BodyPlan::Modal(modal) => {
                for port in &mut modal.ports {
                    port.mat = local(port.mat);
                }
                modal.modes.len()
            }
            BodyPlan::Mesh(mesh) => {
                for (_, mat) in &mut mesh.ports {
                    *mat = local(*mat);
                }
                0
            }
            BodyPlan::Slow(slow) => {
                for (_, mat) in &mut slow.ports {
                    *mat = local(*mat);
                }
                0
            }
        };
        set_free(&mut hub.network, &inside);
        bodies.push(PortedBody {
            mats: body.mats.len(),
            links: body.links.len(),
            parts: network.parts_of(&body.mats),
            left_out: None,
            n_modes: inner_network,
            computed_modes: (0..inner_network as u32).collect(),
            replaces_modes: false,
            inside,
        });
    }
    let hub_island = split(vec![hub], &timeline).pop();
    let (hub, hub_island) = hub_island.unwrap_or_else(|| unreachable!("one subset in, one out"));
    Cut {
        hub,
        timeline: hub_island,
        bodies,
    }
}

/// MATs that stay in the rest: those that move, that are driven or heard, or that a remaining link ends on; not points
/// that only held bodies.
fn used(network: &Network, timeline: &Timeline, is_cut: &[bool]) -> Vec<bool> {
    let kinds = network.mats().kind.iter();
    let mut used: Vec<bool> = kinds.map(|&kind| !kind.is_held()).collect();
    for proxy in network.proxies() {
        let others = proxy.masses().chain(proxy.guides());
        others.for_each(|mat| used[mat] = true);
    }
    for (_, guide) in network.followed() {
        used[guide] = true;
    }
    for (_, a, b) in ends(network).filter(|&(link, _, _)| !is_cut[link]) {
        (used[a], used[b]) = (true, true);
    }
    timeline.driven().for_each(|mat| used[mat] = true);
    for term in network.outputs().iter().flat_map(|output| &output.terms) {
        if let Term::Position { first, len, .. } | Term::Ground { first, len, .. } = *term {
            used[first..first + len].fill(true);
        }
    }
    used
}

/// Sets the mass of each port to what responds to a force within a step as the body does.
pub(in crate::plan) fn set_free(hub: &mut Network, inside: &BodyPlan) {
    match inside {
        BodyPlan::Modal(modal) => {
            let step = modal.rate.step();
            let unit = if modal.is_discrete() {
                1.0
            } else {
                step * step
            };
            for (at, port) in modal.ports.iter().enumerate() {
                hub.set_free(port.mat, unit / modal.port_compliance(at));
            }
        }
        BodyPlan::Mesh(mesh) => {
            for &(local, mat) in &mesh.ports {
                hub.set_free(mat, mesh.network.mats().m[local]);
            }
        }
        BodyPlan::Slow(slow) => {
            for &(local, mat) in &slow.ports {
                hub.set_free(mat, slow.network.mats().m[slow.free[local]]);
                hub.set_weightless(mat);
            }
        }
    }
}
