//! Parameters that change while they are heard: the sound does not jump, whatever methods compute the body before and
//! after.

use std::sync::Arc;

use ergon_engine::network::{But, Network, Term, Tie};
use ergon_engine::plan::{Budget, Computation, Method, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

use super::scene::options;

const RATE: f64 = 44_100.0;
/// First frame of the change, and its duration [frames].
const BORDER: u64 = 6_400;
const OVER: u64 = 64;

fn plain() -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    }
}

fn begin() -> Timeline {
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.open();
    timeline
}

fn instant(frame: u64) -> f64 {
    frame as f64 / RATE
}

fn span() -> (f64, f64) {
    (instant(BORDER), instant(BORDER + OVER))
}

fn point(first: usize) -> Vec<Term> {
    let (len, weight) = (1, 1.0);
    vec![Term::Position { first, len, weight }]
}

fn listen_to_all(network: &mut Network) {
    for mat in 0..network.n_mat() {
        network.listen(&format!("o{mat}"), point(mat)).unwrap();
    }
}

/// The old version up to frame `border`, the new one from then on: (n_frames · n_out).
fn joined(old: &Arc<Plan>, new: &Arc<Plan>, border: u64, n_frames: u64) -> Vec<f64> {
    let mut old = Simulation::from_plan(old.clone(), plain()).unwrap();
    let n_out = old.n_out();
    let mut sound = vec![0.0; n_frames as usize * n_out];
    let (before, after) = sound.split_at_mut(border as usize * n_out);
    old.process(before).unwrap();
    let mut new = Simulation::from_plan_at_frame(new.clone(), plain(), border).unwrap();
    let mut takeover = Takeover::new(&old, &new);
    assert!(new.take_over(&mut old, &mut takeover));
    new.process(after).unwrap();
    sound
}

/// Largest third difference over some frames, of all outputs together.
fn third(sound: &[f64], n_out: usize, frames: std::ops::Range<usize>) -> f64 {
    let x = |frame: usize, output: usize| sound[frame * n_out + output];
    let source = |n: usize, o: usize| (x(n + 3, o) - 3.0 * x(n + 2, o) + 3.0 * x(n + 1, o) - x(n, o)).abs();
    let all = frames.flat_map(|n| (0..n_out).map(move |o| (n, o)));
    all.map(|(n, o)| source(n, o)).fold(0.0, f64::max)
}

/// Ratio of the largest third difference during the change to that before and after it.
fn roughness(sound: &[f64], n_out: usize) -> f64 {
    let (position, over, long) = (BORDER as usize, OVER as usize, 1_500);
    let before = third(sound, n_out, position - long..position - 4);
    let after = third(sound, n_out, position + over + 4..position + over + long);
    third(sound, n_out, position - 4..position + over + 4) / before.max(after)
}

fn plan(network: Network, timeline: &Timeline, budget: &Budget) -> Arc<Plan> {
    Arc::new(Plan::new(Arc::new(network), timeline, budget, None).unwrap())
}

/// A cell of 2 g at 220 Hz whose K grows by a factor of 1.5: from a bank into an island, in which it glides, and back
/// into a bank.
#[test]
fn cell_glides_to_another_stiffness() {
    let omega = std::f64::consts::TAU * 220.0;
    let (m, k) = (2e-3, 2e-3 * omega * omega);
    let network = |k: f64| {
        let mut network = Network::new();
        network.part("bell", None);
        let tie = Tie::Physical { k, z: 1e-3 };
        network.cel("m", m, tie, 0.0, 1e-3, 0.0).unwrap();
        listen_to_all(&mut network);
        network
    };
    let (old, new) = (network(k), network(1.5 * k));
    let mut gliding = begin();
    gliding.glide(&new, 0, [k, 1e-3, m], span()).unwrap();
    let budget = Budget::default();
    let old = plan(old, &begin(), &budget);
    let jumps = joined(&old, &plan(new.clone(), &begin(), &budget), BORDER, 12_800);
    let gliding = plan(new.clone(), &gliding, &budget);
    let glides = joined(&old, &gliding, BORDER, 12_800);
    assert!(roughness(&jumps, 1) > 4.0, "{}", roughness(&jumps, 1));
    assert!(roughness(&glides, 1) < 1.5, "{}", roughness(&glides, 1));
    // After the glide it continues as the new cell, in a bank as well.
    let after = plan(new, &begin(), &budget);
    let mut simulation = Simulation::from_plan_at_frame(gliding, plain(), BORDER).unwrap();
    let end = BORDER + OVER;
    simulation.skip(end - BORDER).unwrap();
    let mut saved = simulation.fork();
    let mut next = Simulation::from_plan_at_frame(after, plain(), end).unwrap();
    let mut takeover = Takeover::new(&simulation, &next);
    assert!(next.take_over(&mut simulation, &mut takeover));
    let (mut a, mut b) = (vec![0.0; 5_000], vec![0.0; 5_000]);
    saved.process(&mut a).unwrap();
    next.process(&mut b).unwrap();
    let apart = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 1e-12, "{apart}");
}

/// A spring between two stepped masses that are struck in turn. A factor on one link, and two links of which one opens
/// as the other closes, give the same glide.
#[test]
fn spring_glides_to_another_stiffness() {
    let network = |springs: &[f64]| {
        let mut network = Network::new();
        network.part("pair", None);
        for i in 0..2 {
            let tie = Tie::Physical { k: 900.0, z: 1e-3 };
            let x0 = 1e-3 * f64::from(1 - 2 * i);
            network.cel(&format!("m{i}"), 2e-3, tie, 0.0, x0, 0.0).unwrap();
        }
        for (i, &k) in springs.iter().enumerate() {
            network.spring(&format!("l{i}"), 0, 1, k, 1e-6 * k, 0.0).unwrap();
        }
        listen_to_all(&mut network);
        network
    };
    let budget = Budget::Method(Method::Ca);
    let old = plan(network(&[3e3]), &begin(), &budget);
    let by_factor = network(&[4.5e3]);
    let mut factor = begin();
    factor
        .glide_force(&by_factor, (0, 1), (1.0 / 1.5, 1.0), span())
        .unwrap();
    let twice = network(&[4.5e3, 3e3]);
    let mut cross = begin();
    cross.glide_force(&twice, (0, 1), (0.0, 1.0), span()).unwrap();
    cross.glide_force(&twice, (1, 1), (1.0, 0.0), span()).unwrap();
    let jumps = joined(&old, &plan(by_factor.clone(), &begin(), &budget), BORDER, 12_800);
    let factor = joined(&old, &plan(by_factor, &factor, &budget), BORDER, 12_800);
    let cross = joined(&old, &plan(twice, &cross, &budget), BORDER, 12_800);
    assert!(roughness(&jumps, 2) > 2.0, "{}", roughness(&jumps, 2));
    assert!(roughness(&factor, 2) < 1.5, "{}", roughness(&factor, 2));
    let apart = factor
        .iter()
        .zip(&cross)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    assert!(apart < 1e-12, "{apart}");
}

/// A string of `n` masses, with or without a key at one of them; `k` is a factor of its stiffness; each mass is heard.
fn string_with(k: f64, n: usize, has_key: bool) -> Network {
    let mut network = Network::new();
    network.part("string", None);
    for i in 0..n {
        let ends = if i == 0 || i + 1 == n { 1.0 } else { 0.0 };
        let tie = Tie::Physical {
            k: 2e4 * k * ends,
            z: 4e-3 * k * ends,
        };
        network.cel(&format!("s{i}"), 2e-3, tie, 0.0, 0.0, 0.0).unwrap();
    }
    for i in 1..n {
        let name = format!("l{i}");
        network.spring(&name, i - 1, i, 2e4 * k, 4e-3 * k, 0.0).unwrap();
    }
    if has_key {
        network.part("key", None);
        let tie = Tie::Physical { k: 200.0, z: 0.4 };
        let key = network.cel("m", 0.08, tie, 0.0, 0.0, 0.0).unwrap();
        network.spring("felt", key, 5, 500.0, 0.01, 0.0).unwrap();
    }
    listen_to_all(&mut network);
    network
}

fn string(k: f64, n: usize) -> Network {
    string_with(k, n, false)
}

fn struck(network: &Network) -> Timeline {
    let mut timeline = begin();
    timeline.strike(network, 3, 0.01, 1e-3, Some(0.0), 0).unwrap();
    timeline
}

/// A string computed by modes becomes a stepped one, whose pitch glides by 1 %.
#[test]
fn string_glides_to_another_pitch() {
    let n = 12;
    let ratio = 1.01 * 1.01;
    let (old, new) = (string(1.0, n), string(ratio, n));
    let budget = Budget::default();
    let mut gliding = struck(&new);
    for link in 0..n - 1 {
        gliding
            .glide_force(&new, (link, 1), (1.0 / ratio, 1.0), span())
            .unwrap();
    }
    for end in [0, n - 1] {
        gliding.glide(&new, end, [2e4, 4e-3, 2e-3], span()).unwrap();
    }
    let timeline = struck(&old);
    let old = plan(old, &timeline, &budget);
    let sound = joined(&old, &plan(new, &gliding, &budget), BORDER, 12_800);
    assert!(roughness(&sound, n) < 1.5, "{}", roughness(&sound, n));
}

/// Whatever methods compute a body before and after, all its masses keep their positions and steps.
#[test]
fn take_over_keeps_positions_of_all_masses() {
    mass_by_mass(false);
    mass_by_mass(true);
}

fn mass_by_mass(has_key: bool) {
    // A change too small to be heard or measured, but enough to make another network.
    let (old, new) = (string_with(1.0, 12, has_key), string_with(1.0 + 1e-13, 12, has_key));
    let n = old.n_mat();
    let budgets = [
        Budget::default(),
        Budget::Method(Method::Ca),
        Budget::Method(Method::Ca2p),
        Budget::Method(Method::Bm4),
        Budget::Method(Method::Ieq),
    ];
    let timeline = struck(&old);
    let plans = |network: &Network| -> Vec<Arc<Plan>> {
        budgets
            .iter()
            .map(|budget| plan(network.clone(), &timeline, budget))
            .collect()
    };
    let (before, after) = (plans(&old), plans(&new));
    let n_frames = BORDER + 500;
    for (i, old) in before.iter().enumerate() {
        let mut alone = Simulation::from_plan(old.clone(), plain()).unwrap();
        let mut unchanged = vec![0.0; n_frames as usize * n];
        alone.process(&mut unchanged).unwrap();
        let peak = unchanged.iter().fold(0.0_f64, |peak, x| peak.max(x.abs()));
        for (j, new) in after.iter().enumerate() {
            let sound = joined(old, new, BORDER, n_frames);
            let now = BORDER as usize * n..(BORDER as usize + 1) * n;
            let apart = |range: std::ops::Range<usize>| {
                let pairs = sound[range.clone()].iter().zip(&unchanged[range]);
                pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / peak
            };
            assert!(apart(now.clone()) < 1e-9, "{has_key} {i} {j}: {}", apart(now.clone()));
            let next = (BORDER as usize + 1) * n..(BORDER as usize + 2) * n;
            // One frame later, the methods differ by their errors in one frame.
            assert!(apart(next.clone()) < 2e-2, "{has_key} {i} {j}: {}", apart(next));
            if i == j {
                assert!(apart(0..sound.len()) < 1e-6, "{has_key} {i}: {}", apart(0..sound.len()));
            }
        }
    }
}

/// A slow key continues as well, up to the difference that its kicks at each macrostep make.
#[test]
fn take_over_of_a_slow_key() {
    let network = |k: f64| {
        let mut network = Network::new();
        network.part("key", None);
        network.macrostep(8);
        let tie = Tie::Physical { k: 200.0, z: 0.4 };
        network.cel("m", 0.08, tie, 0.0, 2e-3, 0.0).unwrap();
        network.mas("n", 0.03, 0.0, 0.0).unwrap();
        network.spring("r", 0, 1, k, 0.2, 0.0).unwrap();
        listen_to_all(&mut network);
        network
    };
    let budgets = [Budget::default(), Budget::Method(Method::Ca)];
    let plans = |k: f64| budgets.each_ref().map(|budget| plan(network(k), &key(), budget));
    let (before, after) = (plans(150.0), plans(150.0 * (1.0 + 1e-13)));
    assert!(before[0].rows().iter().any(|row| row.computation
        == Computation::Slow {
            macrostep: 8,
            is_exact: true
        }));
    let mut alone = Simulation::from_plan(before[0].clone(), plain()).unwrap();
    let mut unchanged = vec![0.0; 2 * 9_000];
    alone.process(&mut unchanged).unwrap();
    for (old, new, limit) in [(0, 0, 1e-9), (0, 1, 2e-6), (1, 0, 2e-6)] {
        for position in [1_024, 4_413, 4_415] {
            let sound = joined(&before[old], &after[new], position, 9_000);
            let apart = sound.iter().zip(&unchanged).map(|(a, b)| (a - b).abs());
            let apart = apart.fold(0.0, f64::max);
            assert!(apart < limit, "{old} {new} {position}: {apart} m of 2 mm");
        }
    }
}

/// A key without gestures.
fn key() -> Timeline {
    let mut timeline = begin();
    timeline.add_key("key", 0);
    timeline
}

/// A path through two points is a glide, to the last bit; with more points it continues after the first.
#[test]
fn path_continues_after_its_glide() {
    let ties = [[790.0, 0.02, 0.002], [1_600.0, 0.04, 0.002], [300.0, 0.01, 0.003]];
    let [k, z, m] = ties[1];
    let mut network = Network::new();
    network.part("bell", None);
    let tie = Tie::Physical { k, z };
    network.cel("m", m, tie, 0.0, 0.001, 0.0).unwrap();
    listen_to_all(&mut network);
    let position = |frame: u64| instant(frame);
    let budget = Budget::default();
    let listened = |timeline: &Timeline| {
        let plan = plan(network.clone(), timeline, &budget);
        let mut sound = vec![0.0; 16_000];
        let mut simulation = Simulation::from_plan(plan, plain()).unwrap();
        simulation.process(&mut sound).unwrap();
        sound
    };
    let mut glide = begin();
    glide
        .glide(&network, 0, ties[0], (position(640), position(6_400)))
        .unwrap();
    let mut short = begin();
    let points = [(position(640), ties[0]), (position(6_400), ties[1])];
    short.glide_through(&network, 0, &points).unwrap();
    let mut long = begin();
    let points = [
        points[0],
        points[1],
        (position(9_600), ties[1]),
        (position(9_664), ties[2]),
    ];
    long.glide_through(&network, 0, &points).unwrap();
    let (glide, short, longer) = (listened(&glide), listened(&short), listened(&long));
    assert!(glide == short);
    assert!(glide[..9_600] == longer[..9_600]);
    assert!(glide[9_600..] != longer[9_600..]);
    assert!(long.glide_through(&network, 0, &points).is_err(), "it glides already");
    let refused = |points: &[(f64, [f64; 3])]| begin().glide_through(&network, 0, points).is_err();
    assert!(refused(&[(1.0, ties[0]), (0.5, ties[1])]));
    assert!(refused(&[]));
    assert!(refused(&[(0.0, [1.0, 0.0, 0.0])]));
}

/// Two cells, joined by a spring and a contact; the arguments are factors of K and Z.
fn joined_cells(from_spring: [f64; 2], from_contact: [f64; 2]) -> Network {
    let mut network = Network::new();
    network.part("pair", None);
    for i in 0..3 {
        let tie = Tie::Physical { k: 900.0, z: 1e-3 };
        let x0 = [1e-3, -1e-3, 3e-3][i];
        let name = format!("m{i}");
        network.cel(&name, 2e-3, tie, 0.0, x0, 0.0).unwrap();
    }
    let [k, z] = from_spring;
    network.spring("l", 0, 1, 3e3 * k, 3e-3 * z, 0.0).unwrap();
    let [k, z] = from_contact;
    let contact = But::plain(2e4 * k, 1e-2 * z, 1e-4);
    network.but("c", 2, 1, contact).unwrap();
    listen_to_all(&mut network);
    network
}

fn played(network: &Network, timeline: &Timeline, budget: &Budget, blocks: usize) -> Vec<f64> {
    let plan = plan(network.clone(), timeline, budget);
    let mut simulation = Simulation::from_plan(plan, plain()).unwrap();
    let n = simulation.n_out();
    let mut sound = vec![0.0; 8_000 * n];
    for block in sound.chunks_mut(blocks * n) {
        simulation.process(block).unwrap();
    }
    sound
}

/// Links that are led to other values from the beginning equal links with these values, to the last bit, where both are
/// stepped: by ear a plan computes by its modes what is not led. In blocks of any size they sound the same.
#[test]
fn lead_of_links_equals_links_with_those_values() {
    let (spring, contact) = ([4.0, 0.5], [2.0, 4.0]);
    let single = joined_cells([1.0; 2], [1.0; 2]);
    let written = joined_cells(spring, contact);
    let mut timeline = begin();
    timeline.lead(&single, (0, 1), &[(0.0, spring)]).unwrap();
    timeline.lead(&single, (1, 1), &[(0.0, contact)]).unwrap();
    let by_ear = played(&single, &timeline, &Budget::default(), 8_000);
    assert!(by_ear == played(&single, &timeline, &Budget::default(), 37));
    let stepped = Budget::Method(Method::Ca);
    let led = played(&single, &timeline, &stepped, 8_000);
    assert!(led == played(&single, &timeline, &stepped, 37));
    let expected = played(&written, &begin(), &stepped, 8_000);
    let apart = led.iter().zip(&expected);
    let apart = apart.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 1e-12, "{apart}");
}

/// A string that is led to another pitch continues as the string of that pitch.
#[test]
fn lead_of_a_string_equals_a_retuned_string() {
    let n = 12;
    let (single, written) = (string(1.0, n), string(4.0, n));
    let mut timeline = struck(&single);
    let all = (0, n - 1);
    timeline.lead(&single, all, &[(0.0, [4.0, 4.0])]).unwrap();
    for end in [0, n - 1] {
        let ties = [4.0 * 2e4, 4.0 * 4e-3, 2e-3];
        timeline.glide_through(&single, end, &[(0.0, ties)]).unwrap();
    }
    let ca = Budget::Method(Method::Ca);
    let (led, expected) = (
        played(&single, &timeline, &ca, 64),
        played(&written, &struck(&written), &ca, 64),
    );
    let peak = expected.iter().fold(0.0_f64, |peak, x| peak.max(x.abs()));
    let apart = led.iter().zip(&expected).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 1e-9 * peak);
}

/// Leads that cannot be applied to links are refused.
#[test]
fn lead_with_wrong_values_is_refused() {
    let network = joined_cells([1.0; 2], [1.0; 2]);
    let refused =
        |link: usize, n: usize, points: &[(f64, [f64; 2])]| begin().lead(&network, (link, n), points).is_err();
    assert!(!refused(0, 2, &[(0.0, [1.0; 2]), (1.0, [2.0; 2])]));
    assert!(refused(0, 0, &[(0.0, [1.0; 2])]));
    assert!(refused(7, 1, &[(0.0, [1.0; 2])]));
    assert!(refused(0, 1, &[]));
    assert!(refused(0, 1, &[(1.0, [1.0; 2]), (0.5, [1.0; 2])]));
    assert!(refused(0, 1, &[(0.0, [-1.0, 1.0])]));
    assert!(refused(0, 1, &[(f64::NAN, [1.0; 2])]));
    let mut twice = begin();
    twice.lead(&network, (0, 1), &[(0.0, [1.0; 2])]).unwrap();
    assert!(twice.lead(&network, (0, 2), &[(0.0, [1.0; 2])]).is_err());
    // So stiff at the end of the lead that CA would diverge.
    let mut stiff = begin();
    stiff
        .lead(&network, (0, 1), &[(0.0, [1.0; 2]), (1.0, [1e6, 1.0])])
        .unwrap();
    let ca = Budget::Method(Method::Ca);
    assert!(Plan::new(Arc::new(network.clone()), &stiff, &ca, None).is_err());
}
