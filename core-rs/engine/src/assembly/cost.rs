//! The cost of a plan: amounts of work, multiplied by a table that ships as data.

use crate::assembly::constants::{LAW_INSTANTS, LAW_PARTS_SHARE, LAW_ROUNDS};
use crate::assembly::cost_table::Costs;
use crate::assembly::mesh::MESH_METHODS;
use crate::assembly::unit::{BankPlan, ComputationUnit, IslandPlan};
use crate::integrate::MeshMethod;
use crate::island::bodies::BodyPlan;
use crate::island::mesh::Mesh;
use crate::island::slow::{Slow, SpringMethod};
use crate::island::{FINE_SUBSTEPS_MIN, Island};
use crate::network::{Contact, LinkKind, Measure, Network, Pairwise, Run, SpaceLaw, SpaceLink};
use crate::scheme::{Scheme, are_lone};
use crate::timeline::Timeline;

impl IslandPlan {
    /// Nanoseconds a frame, by the table of costs.
    pub(crate) fn frame_ns(&self) -> f64 {
        let body_costs = self.bodies.iter().map(body_ns);
        f64::from(self.oversampling) * (self.hub_step_ns() + body_costs.sum::<f64>()) / f64::from(self.frame_interval)
    }

    /// Cost of all but its bodies [ns a step].
    pub(crate) fn hub_step_ns(&self) -> f64 {
        let motion_ns = match self.counted_cost {
            Some(ns) => f64::from(ns) / f64::from(self.oversampling),
            None => fine_laws_ns(self),
        };
        stepped_ns(&self.network, &self.timeline) + motion_ns
    }
}

impl ComputationUnit {
    /// Nanoseconds a frame, by the table of costs.
    pub(crate) fn cost(&self) -> f64 {
        match self {
            Self::IslandPlan(island_plan) => island_plan.frame_ns(),
            Self::Bank(bank) => bank_ns(bank),
        }
    }
}

/// Cost of the modules that are stepped [ns a frame].
pub(crate) fn stepped_ns(network: &Network, timeline: &Timeline) -> f64 {
    let total_cost = modules_ns(network);
    if timeline.gestures.is_empty() {
        return total_cost;
    }
    total_cost + Costs::nanoseconds("hand") * timeline.keys.len() as f64
}

/// Cost of modules that are stepped, without hands [ns a frame].
fn modules_ns(network: &Network) -> f64 {
    let mut total_cost = Costs::nanoseconds("frame") + network.n_moving() as f64 * Costs::nanoseconds("mat");
    let springs = || network.runs().iter().filter(|run| is_spring(&run.kind));
    let is_lone_mesh = are_lone(springs().map(|run| run.len));
    for run in network.runs() {
        let link_cost = match &run.kind {
            LinkKind::Space(SpaceLink {
                law: SpaceLaw::Lnl { .. },
                ..
            }) => Costs::nanoseconds("space_single") + Costs::nanoseconds("expression"),
            LinkKind::Space(_) if run.len > 1 => {
                total_cost += Costs::nanoseconds("space_run");
                Costs::nanoseconds("space_link")
            }
            LinkKind::Space(_) => Costs::nanoseconds("space_single"),
            LinkKind::Pairwise(pairs) if pairs.is_searched() => {
                // Of a large group only the points near the smaller one are pushed.
                let pushed_points = 2.0 * pairs.n_first.min(run.len) as f64;
                total_cost += pushed_points * Costs::nanoseconds("pairwise") * friction_factor(pairs);
                total_cost += pairs.n_first as f64 * Costs::nanoseconds("pairwise_point");
                Costs::nanoseconds("pairwise_point")
            }
            LinkKind::Pairwise(pairs) => pairs.n_first as f64 * wall_point_ns(pairs) * friction_factor(pairs),
            LinkKind::Ref if run.len > 1 => Costs::nanoseconds("link"),
            kind if run.len == 1 && is_lone_mesh && is_spring(kind) => Costs::nanoseconds("lone_link"),
            LinkKind::Lnl(law) if law.hardening_spring().is_none() && !law.is_shared() => {
                Costs::nanoseconds("expression")
            }
            LinkKind::Followed(_) => Costs::nanoseconds("expression"),
            LinkKind::Bristle(_) => Costs::nanoseconds("bristle"),
            LinkKind::Lnl(_) if run.len > 1 => Costs::nanoseconds("law"),
            LinkKind::Dry(_) => Costs::nanoseconds("contact"),
            LinkKind::But(but) if but.contact == Contact::Exact => Costs::nanoseconds("contact"),
            _ => Costs::nanoseconds("single"),
        };
        total_cost += link_cost * run.len as f64;
    }
    total_cost
}

/// Whether it is computed in the one pass over all springs of a mesh.
fn is_spring(kind: &LinkKind) -> bool {
    match kind {
        LinkKind::Ref => true,
        LinkKind::Lnl(law) => law.hardening_spring().is_some(),
        _ => false,
    }
}

/// Cost of a wall for each point [ns]; for a surface as if all points lay on it.
fn wall_point_ns(pairs: &Pairwise) -> f64 {
    match &pairs.link.measure {
        Measure::Surface(facets) => {
            Costs::nanoseconds("surface") + facets.crowding() * Costs::nanoseconds("surface_triangle")
        }
        _ => Costs::nanoseconds("pairwise_wall"),
    }
}

/// Factor by which friction makes contacts dearer: 1.9 in a heap of 1,000 grains.
fn friction_factor(pairs: &Pairwise) -> f64 {
    if pairs.friction > 0.0 { 1.9 } else { 1.0 }
}

/// Additional cost of laws that are computed finer than a frame [ns a frame].
pub(crate) fn fine_laws_ns(island_plan: &IslandPlan) -> f64 {
    let (network, body_plans) = (&*island_plan.network, &island_plan.bodies);
    let contact_substeps = island_plan.contact_substeps;
    if contact_substeps < FINE_SUBSTEPS_MIN {
        return 0.0;
    }
    let single_links = |is_kind: fn(&LinkKind) -> bool| -> Vec<&Run> {
        let network_runs = network.runs().iter();
        network_runs.filter(|run| run.len == 1 && is_kind(&run.kind)).collect()
    };
    let mut fine_laws = single_links(|kind| matches!(kind, LinkKind::Lnl(_) | LinkKind::Bristle(_)));
    if fine_laws.is_empty() && single_links(|kind| matches!(kind, LinkKind::But(_))).is_empty() {
        fine_laws = single_links(|kind| matches!(kind, LinkKind::Dry(_)));
    }
    if fine_laws.len() > Scheme::SUBSTEPPED_LAWS_MAX {
        return 0.0;
    }
    let parts_max = contact_substeps / FINE_SUBSTEPS_MIN;
    // If a frame may be divided, laws are computed in this many parts on average.
    let mean_parts = if parts_max > 1 {
        1.0 + LAW_PARTS_SHARE * parts_max as f64
    } else {
        1.0
    };
    let law_cost = |run: &&Run| match &run.kind {
        LinkKind::Dry(dry) => {
            let network_mats = network.mats();
            let moving_mats = [run.a, run.b].into_iter().filter(|&mat| network_mats.kind[mat].moves());
            let mobility: f64 = moving_mats.map(|mat| 1.0 / network_mats.m[mat]).sum();
            let friction_steps = dry.steps(mobility * island_plan.timeline.rate.step());
            (parts_max as f64 * friction_steps).ceil() * Costs::nanoseconds("located_friction")
        }
        LinkKind::Bristle(_) => {
            mean_parts * (Costs::nanoseconds("collocation") + Costs::nanoseconds("collocated_bristle"))
        }
        LinkKind::Lnl(law) => {
            let functions_cost = law.n_function_calls() as f64 * Costs::nanoseconds("collocated_function");
            mean_parts * (Costs::nanoseconds("collocation") + functions_cost)
        }
        _ => 0.0,
    };
    // Each law feels all others.
    let is_collocated = |run: &&&Run| !matches!(run.kind, LinkKind::Dry(_));
    let n_collocated = fine_laws.iter().filter(is_collocated).count() as f64;
    let law_pairs = n_collocated * (n_collocated - 1.0).max(0.0);
    let laws_total = fine_laws.iter().map(law_cost).sum::<f64>()
        + mean_parts * LAW_ROUNDS * law_pairs * Costs::nanoseconds("coupling");
    // At each instant of a frame, a port gives its position and takes its force, mode by mode.
    let has_law = |port: &&usize| {
        let touches_port = |run: &&Run| [run.a, run.b].contains(port);
        fine_laws.iter().any(touches_port)
    };
    let modes_at_ports = |body: &BodyPlan| {
        let body_ports = body.ports();
        (body_ports.iter().filter(has_law).count() * body.n_modes()) as f64
    };
    let port_modes: f64 = body_plans.iter().map(modes_at_ports).sum();
    laws_total + 2.0 * LAW_INSTANTS * port_modes * Costs::nanoseconds("port")
}

/// Work that depends on the motion, done so far [ns]: that of contacts and laws between frames, and that of exact
/// contacts beyond one solution a step. First their own, then that of the bodies that they touch.
pub(crate) fn counted_ns(island: &Island) -> [f64; 2] {
    let (fine_work, exact_work) = (island.fine_work(), island.exact_work());
    let amounts = [
        ("kick", fine_work.evaluations),
        ("coupling", fine_work.couplings),
        ("contact", exact_work.n_resolved),
        ("power_law", exact_work.evaluations),
    ];
    let costs = amounts.map(|(kind, amount)| Costs::nanoseconds(kind) * amount as f64);
    [
        costs.into_iter().sum(),
        Costs::nanoseconds("port") * fine_work.products as f64,
    ]
}

/// Cost of a body inside an island [ns a frame].
pub(crate) fn body_ns(body_plan: &BodyPlan) -> f64 {
    match body_plan {
        BodyPlan::Modal(modal) => {
            let row_count = modal.ports.len() + modal.outputs.len();
            modal.modes.len() as f64 * (Costs::nanoseconds("mode") + row_count as f64 * Costs::nanoseconds("port"))
        }
        BodyPlan::Mesh(mesh) => ca_cost_ratio(mesh) * modules_ns(&mesh.network),
        BodyPlan::Slow(slow) => slow_body_ns(slow),
    }
}

/// Cost of one step of a frame that the guard computes finer: a step of CA of what it guards [ns].
pub(crate) fn finer_step_ns(island_plan: &IslandPlan) -> f64 {
    let mesh_ns = |body: &BodyPlan| match body {
        BodyPlan::Mesh(mesh) => modules_ns(&mesh.network),
        BodyPlan::Modal(_) | BodyPlan::Slow(_) => 0.0,
    };
    modules_ns(&island_plan.network) + island_plan.bodies.iter().map(mesh_ns).sum::<f64>()
}

/// Cost of a mesh as a multiple of a step of CA a frame.
fn ca_cost_ratio(mesh: &Mesh) -> f64 {
    let matches_method =
        |&&(method, substeps, _): &&(MeshMethod, u32, f64)| (method, substeps) == (mesh.method, mesh.substeps);
    MESH_METHODS
        .iter()
        .find(matches_method)
        .map_or(1.0, |&(_, _, cost_factor)| cost_factor)
}

/// Additional cost of a body in a trial, beyond [`body_ns`] [ns a frame]: the rows of a small plate are shorter than
/// those that the table was measured with. A step of CA goes through the rows once, those of the other methods several
/// times.
pub(crate) fn short_rows_ns(body_plan: &BodyPlan) -> f64 {
    const ROW_NS: f64 = 2.5;
    const STAGED_ROW_NS: f64 = 6.0;
    match body_plan {
        BodyPlan::Mesh(mesh) => {
            let row_cost = match mesh.method {
                MeshMethod::Ca => ROW_NS,
                _ => STAGED_ROW_NS,
            };
            ca_cost_ratio(mesh) * (row_cost * mesh.network.runs().len() as f64 + lone_laws_ns(&mesh.network))
        }
        BodyPlan::Modal(_) | BodyPlan::Slow(_) => 0.0,
    }
}

/// Additional cost of laws on single links in a trial, beyond [`stepped_ns`] [ns a step]: the table was measured with
/// long runs.
pub(crate) fn lone_laws_ns(network: &Network) -> f64 {
    const LAW_NS: f64 = 20.0;
    let is_lone_law = |run: &&Run| run.len == 1 && matches!(run.kind, LinkKind::Lnl(_));
    LAW_NS * network.runs().iter().filter(is_lone_law).count() as f64
}

/// What a slow body saves compared with stepping it module by module [ns a frame].
pub(crate) fn saved_ns(slow: &Slow) -> f64 {
    let module_cost = modules_ns(&slow.network) - Costs::nanoseconds("frame");
    let port_cost = slow.ports.len() as f64 * Costs::nanoseconds("mat");
    module_cost - port_cost - slow_body_ns(slow)
}

/// Whether the slow body costs more than stepping its modules, by more than an empty frame costs.
pub(crate) fn costs_more_than_stepping(slow: &Slow) -> bool {
    slow.is_linear() && saved_ns(slow) < -Costs::nanoseconds("frame")
}

fn slow_body_ns(slow: &Slow) -> f64 {
    let kick_cost = match &slow.springs {
        SpringMethod::Exact(flow) => flow.n_products() * Costs::nanoseconds("port"),
        SpringMethod::Stepped(_) => modules_ns(&slow.network),
    };
    let frame_cost = Costs::nanoseconds("slow") + slow.ports.len() as f64 * Costs::nanoseconds("mat");
    kick_cost / f64::from(slow.kick_interval) + frame_cost
}

/// Cost of a bank [ns a frame].
pub(crate) fn bank_ns(bank: &BankPlan) -> f64 {
    let oscillators = bank.oscillators.iter();
    let tap_count: usize = oscillators.map(|oscillator| oscillator.outputs.len().max(1) - 1).sum();
    let oscillator_cost = bank.oscillators.len() as f64 * Costs::nanoseconds("oscillator");
    oscillator_cost + tap_count as f64 * Costs::nanoseconds("oscillator_tap")
}

pub(crate) fn work_per_second(ns: f64, timeline: &Timeline) -> f64 {
    ns * 1e-9 * timeline.rate.hertz()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::law::Law;
    use crate::network::Facets;
    use crate::units::Rate;

    #[test]
    fn lone_laws_cost_counts_each_law() {
        let mut network = Network::new();
        let law = Arc::new(Law::hardening(500.0, 1e8, 0.01).unwrap());
        for i in 0..4 {
            network.mas(&format!("m{i}"), 1e-3, 0.0, 0.0).unwrap();
        }
        network.spring("s", 0, 1, 500.0, 0.0, 0.0).unwrap();
        assert_eq!(lone_laws_ns(&network), 0.0);
        network.lnl("a", 1, 2, law.clone(), 0.0).unwrap();
        let lone_cost = lone_laws_ns(&network);
        network.lnl("b", 2, 3, law, 0.0).unwrap();
        assert!(lone_cost > 10.0 && lone_laws_ns(&network) == 2.0 * lone_cost);
    }

    /// Cost of stepping 50 points in front of a wall [ns].
    fn walled_cost(measure: Measure) -> f64 {
        use crate::network::{PairLaw, PointGroup, SpacePoint, SpacePoints};
        let mut network = Network::new();
        let mut points = |name: &str, n: usize| {
            let points = SpacePoints {
                n_axes: 3,
                masses: &vec![1e-3; n],
                x0: &vec![0.0; 3 * n],
                v0: &vec![0.0; 3 * n],
                z: 0.0,
            };
            let first_mat = network.points(name, n > 1, points).unwrap();
            PointGroup {
                first: SpacePoint::strided(first_mat, n),
                n,
            }
        };
        let wall_groups = [points("wall", 1), points("m", 50)];
        let (exponent, is_clamped) = (1.0, false);
        let wall_law = PairLaw::smooth(measure, SpaceLaw::Contact { exponent, is_clamped });
        let wall_constants = [500.0, 0.0, 0.01];
        network
            .pairwise("walls", wall_groups, 3, wall_law, wall_constants)
            .unwrap();
        stepped_ns(&network, &Timeline::new(Rate::new(44_100.0).unwrap()))
    }

    /// A mesh of which no two links are alike is dearer than one of a single run, and cheaper than its links alone.
    #[test]
    fn cost_of_a_mesh_of_lone_links() {
        let mesh_ns = |link_count: usize, stiffness: fn(usize) -> f64| {
            let mut network = Network::new();
            for mat in 0..=link_count {
                network.mas(&format!("m{mat}"), 1e-3, 0.0, 0.0).unwrap();
            }
            for link in 0..link_count {
                let name = format!("s{link}");
                network
                    .spring(&name, link, link + 1, stiffness(link), 0.0, 0.0)
                    .unwrap();
            }
            stepped_ns(&network, &Timeline::new(Rate::new(44_100.0).unwrap()))
        };
        let per_link = |stiffness| (mesh_ns(80, stiffness) - mesh_ns(40, stiffness)) / 40.0 - Costs::nanoseconds("mat");
        assert!((per_link(|link| 100.0 + link as f64) - Costs::nanoseconds("lone_link")).abs() < 1e-9);
        assert!(Costs::nanoseconds("lone_link") < Costs::nanoseconds("single"));
        assert!(Costs::nanoseconds("lone_link") > Costs::nanoseconds("link"));
    }

    #[test]
    fn cost_of_a_surface_rises_with_fineness() {
        // A square of 1 m², divided into `n` × `n` squares.
        let square_costs = |n: u32| {
            let grid_place = |i: u32| f64::from(i) / f64::from(n);
            let corners = (0..=n).flat_map(|y| (0..=n).map(move |x| [grid_place(x), grid_place(y), 0.0]));
            let corner_index = |x: u32, y: u32| y * (n + 1) + x;
            let half_squares = (0..n).flat_map(|y| (0..n).map(move |x| (x, y))).flat_map(|(x, y)| {
                let [a, b, c, d] = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, up)| corner_index(x + right, y + up));
                [[a, b, c], [b, c, d]]
            });
            let (corners, triangles): (Vec<_>, Vec<_>) = (corners.collect(), half_squares.collect());
            let square_facets = Facets::new(&corners, &triangles, 0.01).unwrap();
            (
                square_facets.crowding(),
                walled_cost(Measure::Surface(Arc::new(square_facets))),
            )
        };
        let plane_cost = walled_cost(Measure::Plane([0.0, 0.0, 1.0]));
        let (coarse_crowding, coarse_cost) = square_costs(1);
        let (fine_crowding, fine_cost) = square_costs(60);
        assert!(
            (1.0..1.2).contains(&coarse_crowding) && (7.0..40.0).contains(&fine_crowding),
            "{coarse_crowding} {fine_crowding}"
        );
        let extra_point_cost = Costs::nanoseconds("surface") - Costs::nanoseconds("pairwise_wall");
        let surface_cost =
            |crowding: f64| 50.0 * (extra_point_cost + crowding * Costs::nanoseconds("surface_triangle"));
        assert!((coarse_cost - plane_cost - surface_cost(coarse_crowding)).abs() < 1e-6);
        assert!((fine_cost - plane_cost - surface_cost(fine_crowding)).abs() < 1e-6);
    }
}
