use std::sync::Arc;

use super::*;
use crate::assembly::unit::ComputationUnit;
use crate::generator::{Ends, Rim, Shape, plate, string};
use crate::gesture::profile::Curve;
use crate::gesture::script::{Gesture, Manner};
use crate::gesture::written::{Approach, WrittenPoints};
use crate::island::bodies::BodyPlan;
use crate::law::{Law, LawText};
use crate::network::{But, Dry, Network, Term, Tie};
use crate::plan::{Budget, Method, Plan};
use crate::timeline::Timeline;
use crate::units::Rate;

/// When the key begins to move [s].
const BEGINS: f64 = 0.3;

fn position_term(first: usize) -> Term {
    Term::Position {
        first,
        len: 1,
        weight: 1.0,
    }
}

/// The first island of the plan of a network.
fn only_island(network: Network, timeline: &Timeline, budget: &Budget) -> IslandPlan {
    let plan = Plan::new(Arc::new(network), timeline, budget, None).unwrap();
    let Some(ComputationUnit::IslandPlan(island_plan)) = plan.units.into_iter().next() else {
        panic!("no island");
    };
    *island_plan
}

/// A key beside a plate, which is also struck later; `rests`: the key begins where its spring holds it.
fn plan(budget: &Budget, rests: bool) -> Plan {
    let mut network = Network::new();
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    network.part("plate", None);
    let topology = plate(Shape::Square, 3, Rim::Fixed).unwrap();
    network.mesh("p", &topology, 0.1, 90.0, Some(0.3), 0.0).unwrap();
    network.listen("plate", vec![position_term(16)]).unwrap();
    network.part("key", None);
    let key_tie = Tie::Tuned { f: 2.0, t60: Some(0.6) };
    let key_start = if rests { 0.0 } else { -1e-3 };
    let key = network.cel("m", 0.3, key_tie, key_start, 0.0, 0.0).unwrap();
    let key_contact = But::plain(2e4, 0.2, 2e-3);
    network.but("to", key, 24, key_contact).unwrap();
    timeline.add_key("key", key);
    let manner = Manner::OPEN;
    let written = WrittenPoints {
        t: &[BEGINS, BEGINS + 0.06, BEGINS + 0.2],
        x: &[0.0, 4e-3, 0.0],
        approaches: &[Approach::Path(Curve::Smooth); 3],
        sources: &[],
    };
    let gesture = Gesture::from_points(0, &written, manner).unwrap();
    timeline.add_gesture(gesture).unwrap();
    timeline.strike(&network, 20, 0.45, 1e-2, Some(0.0), 0).unwrap();
    Plan::new(Arc::new(network), &timeline, budget, None).unwrap()
}

/// A string with modes up to half the rate, which a hammer strikes at `struck_at` [s].
fn string_plan(struck_at: f64) -> IslandPlan {
    let mut network = Network::new();
    network.part("s", None);
    let topology = string(24, Ends::Fixed, 0.0).unwrap();
    network.mesh("s", &topology, 5e-3, 900.0, Some(1.0), 0.0).unwrap();
    let hammer = network.mas("h", 5e-3, -1e-3, 0.0).unwrap();
    network.but("felt", hammer, 7, But::plain(2e5, 0.2, 0.0)).unwrap();
    network.listen("o", vec![position_term(12)]).unwrap();
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    timeline
        .strike(&network, hammer, struck_at, 1e-2, Some(0.0), 0)
        .unwrap();
    only_island(network, &timeline, &Budget::Error(-60.0))
}

#[test]
fn pilot_run_begins_late_for_modes_above_a_quarter_of_the_rate() {
    let island_plan = string_plan(20.0);
    let modes_at_rest = island_plan.bodies.iter().flat_map(|body| match body {
        BodyPlan::Modal(modal) => &modal.modes[..],
        _ => &[],
    });
    assert!(
        modes_at_rest.clone().any(|mode| mode.a < 0.0),
        "no mode above a quarter of the rate"
    );
    let rest_frames = resting_frames(&island_plan, &Allowance::with_seconds(1e9)).unwrap();
    assert!((44_100 * 19..44_100 * 20).contains(&rest_frames), "{rest_frames}");
}

/// Sound, state and work of an island, and how many of its frames were skipped.
fn played(island_plan: &IslandPlan, may_rest: bool) -> (Vec<u64>, Vec<u8>, [u64; 3], u64) {
    let mut island = started_island(island_plan, island_plan.contact_substeps).unwrap();
    let mut sample_bits = Vec::new();
    let mut block_sound = vec![0.0; BLOCK_FRAMES * island.n_out()];
    for _ in 0..(0.6 * 44_100.0) as usize / BLOCK_FRAMES {
        block_sound.fill(0.0);
        let lone_team = &mut ThreadTeam::alone();
        if may_rest {
            island.process(&mut block_sound, BLOCK_FRAMES, lone_team).unwrap();
        } else {
            island.compute(&mut block_sound, BLOCK_FRAMES, lone_team).unwrap();
        }
        sample_bits.extend(block_sound.iter().map(|x| x.to_bits()));
    }
    let work_counts = island.fine_work();
    let work_counts = [
        work_counts.evaluations,
        work_counts.products,
        island.finer_evaluations(),
    ];
    let frames_skipped = island.skipped_steps() / u64::from(island_plan.oversampling);
    (sample_bits, island.write_state(), work_counts, frames_skipped)
}

#[test]
fn pilot_run_skips_rest_with_the_same_bits() {
    for budget in [Budget::Error(-60.0), Budget::Method(Method::Ca)] {
        for rests in [true, false] {
            let plan = plan(&budget, rests);
            let mut n_islands = 0;
            for unit in &plan.units {
                let ComputationUnit::IslandPlan(island_plan) = unit else {
                    continue;
                };
                n_islands += 1;
                let (full_sound, full_state, full_work, _) = played(island_plan, false);
                let (rested_sound, rested_state, rested_work, frames_skipped) = played(island_plan, true);
                assert!(full_sound == rested_sound && full_state == rested_state && full_work == rested_work);
                // All frames before the gesture are skipped but the first and a few before it; none if a spring
                // moves the key.
                let rest_frames = (BEGINS * 44_100.0) as u64;
                let expected = if rests { rest_frames - 2_560..rest_frames } else { 0..1 };
                assert!(expected.contains(&frames_skipped), "{budget:?} {frames_skipped}");
            }
            assert_eq!(n_islands, 1);
        }
    }
}

/// Without guesses it takes 102 rounds a frame.
#[test]
fn friction_in_a_ring_takes_few_rounds() {
    let mut network = Network::new();
    network.part("ring", None);
    let ring_cells = [
        (4.4e-3, 771.0),
        (1.57e-2, 274.0),
        (1.09e-2, 437.0),
        (1.37e-2, 722.0),
        (3.7e-3, 84.0),
        (1.7e-2, 423.0),
    ];
    let mut ring_mats = Vec::new();
    for (index, (mass, f)) in ring_cells.into_iter().enumerate() {
        let cell_tie = Tie::Tuned { f, t60: Some(1.0) };
        let start_speed = if index == 0 { 0.05 } else { 0.0 };
        let cell_name = format!("m{index}");
        ring_mats.push(network.cel(&cell_name, mass, cell_tie, 0.0, start_speed, 0.0).unwrap());
    }
    let friction_levels = [0.272, 0.029, 0.027, 0.172, 0.283, 0.127, 0.223];
    let mat_pairs = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (1, 3)];
    for (index, ((a, b), level)) in mat_pairs.into_iter().zip(friction_levels).enumerate() {
        let dry_friction = Dry {
            level,
            static_level: level,
            speed: 0.02,
        };
        network
            .dry(&format!("d{index}"), ring_mats[a], ring_mats[b], dry_friction)
            .unwrap();
    }
    network.listen("o", vec![position_term(ring_mats[0])]).unwrap();
    let timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    let island_plan = only_island(network, &timeline, &Budget::Method(Method::Ca));
    let mut island = started_island(&island_plan, island_plan.contact_substeps).unwrap();
    let n_frames = 13_230;
    let mut ring_sound = vec![0.0; n_frames];
    island
        .compute(&mut ring_sound, n_frames, &mut ThreadTeam::alone())
        .unwrap();
    let solver_rounds = island.exact_work().n_resolved as f64 / (n_frames * friction_levels.len()) as f64;
    assert!(solver_rounds < 20.0, "{solver_rounds}");
}

/// A mass away from zero, which a law damps and a strike moves from `struck_at` on [s], computed between frames.
fn law_plan(struck_at: f64) -> IslandPlan {
    let mut network = Network::new();
    network.part("l", None);
    let mass = network.mas("m", 0.07, 0.01, 0.0).unwrap();
    let ground = network.sol("g", 0.0).unwrap();
    let law_text = LawText {
        damping: Some("v*(1 + abs(v))"),
        ..LawText::default()
    };
    let law = Arc::new(Law::new(&law_text).unwrap());
    network.lnl("law", ground, mass, law, 0.0).unwrap();
    network.listen("o", vec![position_term(mass)]).unwrap();
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    timeline.strike(&network, mass, struck_at, 1e-2, Some(0.0), 0).unwrap();
    only_island(network, &timeline, &Budget::Error(-60.0))
}

#[test]
fn pilot_run_skips_rest_of_a_law_with_any_substeps() {
    let island_plan = law_plan(1.0);
    for contact_substeps in [1, 2, 4, 256] {
        let mut island = started_island(&island_plan, contact_substeps).unwrap();
        let n_frames = 44_100;
        let mut sound = vec![0.0; n_frames];
        island.process(&mut sound, n_frames, &mut ThreadTeam::alone()).unwrap();
        assert!(sound.iter().all(|x| *x == sound[0]));
        assert!(
            island.computed_frames() < 4_000,
            "{contact_substeps} substeps: {}",
            island.computed_frames()
        );
    }
}

#[test]
fn pilot_run_counts_no_work_of_the_rest_before_it() {
    let runs = [0.5, 2.0].map(|struck_at| {
        let island_plan = law_plan(struck_at);
        let allowance = Allowance::with_seconds(1e9);
        let excerpt = Excerpt {
            first_frame: resting_frames(&island_plan, &allowance).unwrap(),
            n_frames: 8_192,
        };
        play(&island_plan, 4, excerpt, &allowance).unwrap()
    });
    let [early, late] = runs.each_ref().map(|run| run.counted_cost.contacts_ns);
    assert!(early > 0 && early.abs_diff(late) <= early / 10, "{early} {late}");
    assert!(
        runs[1].work_seconds < 1.2 * runs[0].work_seconds,
        "{} {}",
        runs[0].work_seconds,
        runs[1].work_seconds
    );
}
