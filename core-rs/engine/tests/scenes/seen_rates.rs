//! Parts that are only seen are computed once in several frames, as a score at that lower rate would be.

use std::sync::Arc;

use super::scene::options;
use super::space::{RATE, hear, link, point};
use ergon_engine::network::{Network, SpaceLaw, Term, Tie};
use ergon_engine::plan::{Budget, Method, Plan, PlanContext};
use ergon_engine::simulation::{OnFault, PointMotion, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

const EVERY: u32 = 21;
const N: u64 = 4_410;
/// A weight that springs hold, and one that it meets.
const MASSES: [f64; 2] = [0.02, 0.05];

/// A bell that is heard.
fn bell() -> Network {
    let mut network = Network::new();
    network.part("bell", None);
    let tie = Tie::Tuned {
        f: 440.0,
        t60: Some(1.0),
    };
    let bell = network.cel("m", 0.002, tie, 0.0, 0.0, 0.0).unwrap();
    hear(&mut network, "bell", bell);
    network
}

/// A bell that is heard, and a pendulum that meets a ball; `is_heard`: whether an output hears these two.
fn network(is_heard: bool) -> Arc<Network> {
    let mut network = bell();
    network.part("swing", None);
    let nail = point(&mut network, "nail", 0.0, [0.0; 3], [0.0; 3]);
    let bob = point(&mut network, "bob", MASSES[0], [0.3, 0.0, -0.1], [0.0; 3]);
    network.set_gravity(bob.first + 2..bob.first + 3, -9.81).unwrap();
    let ball = point(&mut network, "ball", MASSES[1], [0.24, 0.0, -0.22], [0.0; 3]);
    let push = SpaceLaw::Contact {
        exponent: 1.0,
        is_clamped: true,
    };
    link(&mut network, (nail, bob), SpaceLaw::Spring, [400.0, 0.02, 0.31]);
    link(&mut network, (bob, ball), push, [3_000.0, 0.05, 0.08]);
    if is_heard {
        let (first, len, weight) = (bob.first, 1, 1.0);
        network
            .listen("bob", vec![Term::Position { first, len, weight }])
            .unwrap();
    }
    Arc::new(network)
}

fn timeline_at(rate: f64, network: &Network) -> Timeline {
    let mut timeline = Timeline::new(Rate::new(rate).unwrap());
    timeline.strike(network, 0, 0.01, 1e-3, Some(0.0), 0).unwrap();
    // The bob of the pendulum, along z, between two steps.
    timeline.strike(network, 6, 0.051_3, 2e-3, Some(0.0), 0).unwrap();
    timeline
}

fn plan(network: &Arc<Network>, timeline: &Timeline, every: u32, budget: &Budget) -> Arc<Plan> {
    let seen = ["swing".to_owned()];
    let known = PlanContext {
        displayed_parts: &seen,
        displayed_frame_interval: every,
        ..PlanContext::default()
    };
    Arc::new(Plan::in_context(network.clone(), timeline, budget, None, known).unwrap())
}

fn plain() -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    }
}

fn playing(plan: &Arc<Plan>, threads: usize) -> Simulation {
    Simulation::from_plan(plan.clone(), SimulationOptions { threads, ..plain() }).unwrap()
}

/// Positions of the pendulum and the ball, as bits.
fn swing(simulation: &Simulation) -> Vec<u64> {
    let x = simulation.positions();
    x[4..].iter().map(|x| x.to_bits()).collect()
}

#[test]
fn seen_part_moves_as_a_slower_score() {
    let network = network(false);
    let plan = plan(&network, &timeline_at(RATE, &network), EVERY, &Budget::Error(-60.0));
    let mut simulation = playing(&plan, 1);
    let slow = RATE / f64::from(EVERY);
    let mut alone = Simulation::new(network.clone(), &timeline_at(slow, &network), plain()).unwrap();
    let (mut moved, start) = (0, swing(&simulation));
    for step in 0..N / u64::from(EVERY) {
        assert_eq!(swing(&simulation), swing(&alone), "step {step}");
        moved += usize::from(swing(&simulation) != start);
        simulation.skip(u64::from(EVERY)).unwrap();
        alone.skip(1).unwrap();
    }
    assert!(moved > 200, "{moved}");
}

#[test]
fn seen_part_is_interpolated_between_its_steps() {
    let network = network(false);
    let plan = plan(&network, &timeline_at(RATE, &network), EVERY, &Budget::Error(-60.0));
    let mut simulation = playing(&plan, 1);
    let look = simulation.make_look();
    let mut tracks = vec![0.0; 2 * look.n_tracks()];
    simulation.skip(40 * u64::from(EVERY)).unwrap();
    let (before, step) = (simulation.positions(), simulation.steps());
    for frame in 1..=EVERY {
        simulation.skip(1).unwrap();
        let part = f64::from(frame) / f64::from(EVERY);
        let (x, mut after) = (simulation.positions(), simulation.clone());
        after.skip(u64::from(EVERY - frame)).unwrap();
        simulation.write_tracks(&look, &mut tracks);
        let after = after.positions();
        for mat in 4..network.n_mat() {
            let expected = before[mat] + part * (after[mat] - before[mat]);
            assert!((x[mat] - expected).abs() < 1e-15, "{frame} {mat}");
        }
        for (point, x_seen) in look.points.iter().zip(&tracks) {
            if point.mat >= 4 {
                assert_eq!(point.motion, PointMotion::Sampled);
                assert!((x_seen + point.rest - x[point.mat]).abs() < 1e-15);
            }
        }
    }
    // A step is given as the step of one frame.
    let next = simulation.positions();
    for mat in 4..network.n_mat() {
        let single = (next[mat] - before[mat]) / f64::from(EVERY);
        assert!((simulation.steps()[mat] - single).abs() < 1e-15);
        assert!(step[mat].abs() < 1e-3);
    }
}

/// Everything that is heard and seen, in blocks of this size.
fn all(plan: &Arc<Plan>, threads: usize, block: usize) -> (Vec<u64>, Vec<Vec<u64>>) {
    let mut simulation = playing(plan, threads);
    let (mut listened, mut seen) = (Vec::new(), Vec::new());
    let mut out = vec![0.0; N as usize];
    for second in out.chunks_mut(735) {
        for block in second.chunks_mut(block) {
            simulation.process(block).unwrap();
        }
        listened.extend(second.iter().map(|x| x.to_bits()));
        seen.push(swing(&simulation));
    }
    (listened, seen)
}

#[test]
fn seen_part_agrees_bitwise_for_threads_and_blocks() {
    let network = network(false);
    let timeline = timeline_at(RATE, &network);
    let budget = Budget::Error(-60.0);
    let slow = plan(&network, &timeline, EVERY, &budget);
    let (listened, seen) = all(&slow, 1, 735);
    for (threads, block) in [(1, 1), (1, 64), (3, 735), (4, 17)] {
        assert!(all(&slow, threads, block) == (listened.clone(), seen.clone()));
    }
    let full = plan(&network, &timeline, 1, &budget);
    assert_eq!(slow.hash(), full.hash());
    let each = all(&full, 1, 735);
    assert!(each.0 == listened && each.1 != seen);
    let mut simulation = playing(&slow, 1);
    simulation.skip(1_000).unwrap();
    let there = simulation.snapshot();
    simulation.skip(1_003).unwrap();
    let then = swing(&simulation);
    simulation.restore(&there);
    simulation.skip(1_003).unwrap();
    assert_eq!(swing(&simulation), then);
}

#[test]
fn seen_part_cost_and_error_by_rate() {
    let network = network(false);
    let timeline = timeline_at(RATE, &network);
    let mut last = (f64::INFINITY, -400.0);
    for every in [1, 7, EVERY] {
        let plan = plan(&network, &timeline, every, &Budget::Error(-60.0));
        let [row] = plan.displayed_rows() else {
            panic!("{:?}", plan.displayed_rows());
        };
        assert_eq!((row.frame_interval, row.oversampling), (every, 1));
        let all: f64 = row.work_per_second * f64::from(every);
        if every == 1 {
            last.0 = all;
            assert!(row.error.is_none());
            continue;
        }
        assert!((all - last.0).abs() < 1e-12 * all, "{every}: {all} of {last:?}");
        // The pilot finds the error of a run of the same beginning: of order 2, or of order 1 when contacts close.
        let error = row.error.unwrap();
        assert!(
            error.waveform_db > last.1 && error.waveform_db < -20.0,
            "{every}: {error:?}"
        );
        assert!(error.duration_seconds >= 0.3);
        last.1 = error.waveform_db;
    }
}

#[test]
fn take_over_of_a_seen_part_mid_step() {
    let quiet = network(false);
    let timeline = timeline_at(RATE, &quiet);
    let budget = Budget::Method(Method::Ca);
    let slow = plan(&quiet, &timeline, EVERY, &budget);
    for from in [EVERY.into(), 1_000_u64, 2_001] {
        let mut complete = playing(&slow, 1);
        complete.skip(N).unwrap();
        let taken_over_by = |plan: &Arc<Plan>| {
            let mut before = playing(&slow, 1);
            before.skip(from).unwrap();
            let mut next = Simulation::from_plan_at_frame(plan.clone(), plain(), from).unwrap();
            let mut takeover = Takeover::new(&before, &next);
            assert!(next.take_over(&mut before, &mut takeover));
            next
        };
        let mut next = taken_over_by(&plan(&quiet, &timeline, EVERY, &budget));
        next.skip(N - from).unwrap();
        assert_eq!(swing(&next), swing(&complete));
        // If an output hears it from then on, it continues at every frame.
        let listened = network(true);
        let plan = plan(&listened, &timeline, EVERY, &budget);
        assert!(plan.displayed_rows().is_empty());
        let mut next = taken_over_by(&plan);
        let mut before = playing(&slow, 1);
        before.skip(from).unwrap();
        let (x, y) = (before.positions(), next.positions());
        let (dx, dy) = (before.steps(), next.steps());
        for mat in 4..quiet.n_mat() {
            // The difference is at most one of its own steps.
            let limit = f64::from(EVERY) * dx[mat].abs() + 1e-12;
            assert!((x[mat] - y[mat]).abs() <= limit, "{from} {mat}");
            assert!((dx[mat] - dy[mat]).abs() <= 1e-12 + 1e-9 * dx[mat].abs());
        }
        next.skip(100).unwrap();
        assert!(next.positions().iter().all(|x| x.is_finite()));
    }
}

#[test]
fn seen_part_too_stiff_is_oversampled() {
    let mut network = bell();
    let mut rows = Vec::new();
    for (part, k) in [("soft", 4e2), ("stiff", 4e5), ("stiffest", 7e7)] {
        network.part(part, None);
        let a = point(&mut network, "a", 0.02, [0.0; 3], [0.0, 0.1, 0.0]);
        let b = point(&mut network, "b", 0.02, [0.1, 0.0, 0.0], [0.0; 3]);
        link(&mut network, (a, b), SpaceLaw::Spring, [k, 0.0, 0.1]);
        rows.push(part.to_owned());
    }
    let network = Arc::new(network);
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.strike(&network, 0, 0.01, 1e-3, Some(0.0), 0).unwrap();
    let known = PlanContext {
        displayed_parts: &rows,
        displayed_frame_interval: EVERY,
        ..PlanContext::default()
    };
    let budget = Budget::Error(-60.0);
    let plan = Plan::in_context(network.clone(), &timeline, &budget, None, known).unwrap();
    let mut paces = Vec::new();
    for row in plan.displayed_rows() {
        paces.push((row.frame_interval, row.oversampling));
        assert_eq!(row.rate_refusal.is_some(), row.frame_interval == 1, "{row:?}");
    }
    // Stability: λh² is at most 4.
    let steps = |(every, oversampling): (u32, u32)| RATE * f64::from(oversampling) / f64::from(every);
    for (pace, k) in paces.iter().zip([4e2, 4e5, 7e7]) {
        let lambda: f64 = 2.0 * k / 0.02;
        assert!(steps(*pace) >= 0.5 * lambda.sqrt(), "{pace:?}");
    }
    assert_eq!(paces[0], (EVERY, 1));
    assert!(paces[1].1 > 1 && steps(paces[1]) < RATE);
    assert_eq!(paces[2], (1, 1));
    let plan = Arc::new(plan);
    let mut simulation = Simulation::from_plan(plan, plain()).unwrap();
    simulation.skip(10_000).unwrap();
    assert!(simulation.positions().iter().all(|x| x.abs() < 1.0));
}
