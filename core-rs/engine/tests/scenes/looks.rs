//! Every mass is seen, whatever method computes it and whether or not an output hears it; looking changes no sample.

use std::sync::Arc;

use ergon_engine::generator::{Rim, Shape, plate};
use ergon_engine::network::{But, Network, Term, Tie};
use ergon_engine::plan::{Budget, Plan, PlanContext};
use ergon_engine::simulation::{MotionLook, OnFault, PointMotion, Simulation, SimulationOptions};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

use super::scene::options;

const RATE: f64 = 44_100.0;
const N: usize = 4_410;
/// A mass in algorithmic units [kg] → M.
const M: f64 = RATE * RATE;

/// Bells, a linear plate, a gong that stiffens, a body with a damper of its own and a hammer: one of each is heard, and
/// one is not. For discrete parts, the plan gives the motion of the stepped network, up to rounding.
fn scene(discrete: bool) -> (Arc<Network>, Timeline) {
    let rate = Rate::new(RATE).unwrap();
    let (part_rate, m) = if discrete { (Some(rate), M) } else { (None, 1.0) };
    let z = if discrete { RATE } else { 1.0 };
    let mut network = Network::new();
    let mut timeline = Timeline::new(rate);
    let mut struck = Vec::new();
    for side in ["heard", "unheard"] {
        let first = network.n_mat();
        network.part(&format!("bells {side}"), part_rate);
        for f in [220.0, 1_310.0] {
            let tie = Tie::Tuned { f, t60: Some(0.8) };
            struck.push(network.cel(&format!("b{f}"), 2e-3 * m, tie, 0.0, 0.0, 0.0).unwrap());
        }
        network.part(&format!("plate {side}"), part_rate);
        let topology = plate(Shape::Hex, 3, Rim::Fixed).unwrap();
        let single = network.mesh("p", &topology, 0.3 * m, 180.0, Some(1.0), 0.0).unwrap();
        struck.push(single + 12);
        network.part(&format!("gong {side}"), part_rate);
        let single = network.mesh("g", &topology, 0.3 * m, 150.0, Some(1.0), 1e11).unwrap();
        struck.push(single + 14);
        network.part(&format!("frame {side}"), part_rate);
        let tie = |k: f64, zed: f64| Tie::Physical { k, z: zed * z };
        let a = network.cel("a", 0.01 * m, tie(4e3, 0.05), 0.0, 0.0, 0.0).unwrap();
        let b = network.cel("b", 0.02 * m, tie(5e3, 0.9), 0.0, 0.0, 0.0).unwrap();
        network.spring("s", a, b, 3e3, 0.2 * z, 0.0).unwrap();
        struck.push(a);
        network.part(&format!("hammer {side}"), part_rate);
        let topology = plate(Shape::Hex, 2, Rim::Fixed).unwrap();
        let skin = network.mesh("p", &topology, 0.1 * m, 200.0, Some(0.5), 0.0).unwrap();
        let hammer = network.mas("m", 5e-3 * m, -1e-3, 1.5).unwrap();
        let but = But::plain(4e4, 0.0, 0.0);
        network.but("hits", hammer, skin + 5, but).unwrap();
        if side == "heard" {
            let len = network.n_mat() - first;
            let weight = 1.0;
            let all = vec![Term::Position { first, len, weight }];
            network.listen("all", all).unwrap();
            let few = vec![Term::Position {
                first: first + 8,
                len: 1,
                weight,
            }];
            network.listen("few", few).unwrap();
        }
    }
    for (i, mat) in struck.into_iter().enumerate() {
        for k in 0..4_u32 {
            let position = 1e-3 + 0.013 * f64::from(k) + 1e-4 * i as f64;
            timeline
                .strike(&network, mat, position, 2e-3 * f64::from(k + 1), Some(0.0), 0)
                .unwrap();
        }
    }
    (Arc::new(network), timeline)
}

fn plan(network: &Arc<Network>, timeline: &Timeline, seen: &[String], budget: &Budget) -> Arc<Plan> {
    let known = PlanContext {
        displayed_parts: seen,
        ..PlanContext::default()
    };
    Arc::new(Plan::in_context(network.clone(), timeline, budget, None, known).unwrap())
}

fn all(network: &Network) -> Vec<String> {
    network.parts().iter().map(|part| part.name.clone()).collect()
}

fn running(plan: &Arc<Plan>, threads: usize) -> Simulation {
    let options = SimulationOptions {
        keeps_ledger: false,
        threads,
        ..options(OnFault::Stop)
    };
    Simulation::from_plan(plan.clone(), options).unwrap()
}

fn sound(plan: &Arc<Plan>, threads: usize) -> Vec<u64> {
    let mut simulation = running(plan, threads);
    let look = simulation.make_look();
    simulation.start_watching();
    let mut tracks = vec![0.0; 2 * look.n_tracks()];
    let mut out = vec![0.0; N * simulation.n_out()];
    for block in out.chunks_mut(735 * simulation.n_out()) {
        simulation.process(block).unwrap();
        simulation.write_tracks(&look, &mut tracks);
        simulation.take_contacts(&look, |_, _, _| ());
    }
    out.iter().map(|x| x.to_bits()).collect()
}

/// Positions of all points from what was seen of a simulation [m].
fn positions(look: &MotionLook, tracks: &[f64]) -> Vec<f64> {
    let n = look.points.len();
    let mut x: Vec<f64> = (0..n).map(|i| tracks[i] + look.points[i].rest).collect();
    for body in &look.bodies {
        for (row, &point) in body.shapes.chunks(body.modes.len()).zip(&body.points) {
            let modes = row.iter().zip(&tracks[n + body.first_mode..]);
            x[point] = look.points[point].rest + modes.map(|(share, q)| share * q).sum::<f64>();
        }
    }
    x
}

#[test]
fn look_sees_masses_at_their_positions() {
    let (network, timeline) = scene(true);
    let plain = SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    };
    let mut truth = Simulation::new(network.clone(), &timeline, plain).unwrap();
    let plan = plan(&network, &timeline, &all(&network), &Budget::Error(-120.0));
    let mut simulation = running(&plan, 1);
    let look = simulation.make_look();
    let kinds = |of: fn(&PointMotion) -> bool| look.points.iter().filter(|point| of(&point.motion)).count();
    assert_eq!(kinds(|how| matches!(how, PointMotion::NotComputed { .. })), 0);
    assert_eq!(kinds(|how| matches!(how, PointMotion::Free(_))), 4);
    assert!(kinds(|how| matches!(how, PointMotion::Sampled)) >= 2 * 37);
    assert!(kinds(|how| matches!(how, PointMotion::Modal(_))) >= 2 * 37);
    let (mut a, mut b) = (vec![0.0; 441 * 2], vec![0.0; 441 * 2]);
    let mut tracks = vec![0.0; 2 * look.n_tracks()];
    let mut limit = vec![0.0_f64; network.parts().len()];
    let mut worst = vec![0.0_f64; network.parts().len()];
    for _ in 0..10 {
        truth.process(&mut a).unwrap();
        simulation.process(&mut b).unwrap();
        simulation.write_tracks(&look, &mut tracks);
        let (seen, true_x) = (positions(&look, &tracks), truth.positions());
        for (point, x) in look.points.iter().zip(seen) {
            let is = true_x[point.mat];
            limit[point.part] = limit[point.part].max((is - point.rest).abs());
            worst[point.part] = worst[point.part].max((x - is).abs());
        }
    }
    for (part, (limit, worst)) in network.parts().iter().zip(limit.iter().zip(&worst)) {
        assert!(*limit > 1e-7, "{} stands still", part.name);
        assert!(worst < &(2e-3 * limit), "{}: {worst} of {limit}", part.name);
    }
}

#[test]
fn look_changes_no_sample() {
    for discrete in [true, false] {
        let (network, timeline) = scene(discrete);
        let budget = Budget::default();
        let listened = plan(&network, &timeline, &[], &budget);
        let mut blind = running(&listened, 1);
        let mut out = vec![0.0; N * blind.n_out()];
        blind.process(&mut out).unwrap();
        let out: Vec<u64> = out.iter().map(|x| x.to_bits()).collect();
        let seen = plan(&network, &timeline, &all(&network), &budget);
        assert_eq!(listened.hash(), seen.hash());
        assert_eq!(listened.rows().len(), seen.rows().len());
        assert!(!seen.displayed_rows().is_empty() && listened.displayed_rows().is_empty());
        for threads in [1, 3] {
            assert!(sound(&listened, threads) == out, "{discrete}, {threads} threads");
            assert!(sound(&seen, threads) == out, "{discrete}, {threads} threads, all seen");
        }
    }
}

#[test]
fn look_predicts_free_masses_from_two_frames() {
    for discrete in [true, false] {
        let (network, timeline) = scene(discrete);
        let plan = plan(&network, &timeline, &all(&network), &Budget::Error(-100.0));
        let mut simulation = running(&plan, 1);
        let look = simulation.make_look();
        let n = look.n_tracks();
        let mut now = vec![0.0; 2 * n];
        simulation.skip(3_000).unwrap();
        simulation.write_tracks(&look, &mut now);
        simulation.skip(1_000).unwrap();
        let mut then = vec![0.0; 2 * n];
        simulation.write_tracks(&look, &mut then);
        let step = 1.0 / RATE;
        let mut free = Vec::new();
        for (track, point) in look.points.iter().enumerate() {
            if let PointMotion::Free(single) = point.motion {
                free.push((track, single));
            }
        }
        // Bodies without contacts: the hammers bounce for a while.
        for body in &look.bodies {
            let part = look.points[body.points[0]].part;
            if !network.parts()[part].name.starts_with("hammer") {
                free.extend(
                    body.modes
                        .iter()
                        .enumerate()
                        .map(|(i, single)| (look.points.len() + body.first_mode + i, *single)),
                );
            }
        }
        assert!(free.len() > 30);
        for (track, single) in free {
            let begun = single.coefficients(now[track], now[n + track], step);
            let (x, y) = single.coefficients_after(begun, 1_000.0 * step);
            let size = libm::hypot(begun.0, begun.1) + 1e-12;
            assert!((x - then[track]).abs() < 1e-6 * size, "{track}: {x} {}", then[track]);
            let there = single.coefficients(then[track], then[n + track], step);
            assert!((y - there.1).abs() < 1e-5 * size);
        }
    }
}

#[test]
fn take_contacts_returns_strongest_forces() {
    let (network, timeline) = scene(true);
    let plan = plan(&network, &timeline, &all(&network), &Budget::default());
    let mut simulation = running(&plan, 1);
    let look = simulation.make_look();
    assert_eq!(look.contacts.len(), 2);
    assert_eq!(look.contacts[0].name, "hammer heard.hits");
    simulation.start_watching();
    let mut output = Vec::new();
    for _ in 0..10 {
        simulation.skip(441).unwrap();
        let until = simulation.frame();
        simulation.take_contacts(&look, |contact, frame, force| {
            assert!(frame < until && frame + 441 >= until);
            output.push((contact, frame, force));
        });
    }
    // The hammer comes from below at 1.5 m/s over 1 mm, and is pushed down.
    let first = output.iter().find(|touch| touch.0 == 0).unwrap();
    assert!((25..60).contains(&first.1), "{output:?}");
    // At most m v √(k/m); less because the skin gives way.
    let limit = 1.5 * (4e4_f64 * 5e-3).sqrt();
    assert!(
        first.2.abs() > 0.3 * limit && first.2.abs() < 1.05 * limit,
        "{output:?}"
    );
    assert!(first.2 < 0.0);
    assert_eq!(
        output.iter().filter(|touch| touch.0 == 0).count(),
        output.iter().filter(|touch| touch.0 == 1).count()
    );
}
