//! Points in space: closed forms, what no step may change, and links to one axis of motion.

use std::sync::Arc;

use super::blocks::play;
use super::scene::options;
use ergon_engine::chance::Chance;
use ergon_engine::law::{Law, LawText};
use ergon_engine::maths::{cos, sin};
use ergon_engine::network::{Network, SpaceLaw, SpacePoint, SpacePoints, Term, Tie};
use ergon_engine::plan::{Budget, Plan};
use ergon_engine::simulation::{Energy, OnFault, Options, Simulation, Takeover};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;
use proptest::prelude::*;

const RATE: f64 = 44_100.0;

/// A single point at x0 [m] with v0 [m/s].
fn point(network: &mut Network, name: &str, m: f64, x0: [f64; 3], v0: [f64; 3]) -> SpacePoint {
    let points = SpacePoints {
        n_axes: 3,
        masses: &[m],
        x0: &x0,
        v0: &v0,
        z: 0.0,
    };
    let first = network.points(name, false, points).unwrap();
    SpacePoint::strided(first, 1)
}

fn link(
    network: &mut Network,
    ends: (SpacePoint, SpacePoint),
    law: SpaceLaw,
    numbers: [f64; 3],
) -> usize {
    let name = format!("link{}", network.n_lia());
    network
        .space_links(&name, ends, 1, 3, law, numbers)
        .unwrap()
}

fn hear(network: &mut Network, name: &str, first: usize) {
    let (len, weight) = (1, 1.0);
    let term = Term::Position { first, len, weight };
    network.listen(name, vec![term]).unwrap();
}

fn start(network: Network, timeline: &Timeline) -> Simulation {
    Simulation::new(Arc::new(network), timeline, options(OnFault::Stop)).unwrap()
}

fn run(network: Network, rate: f64, n_frames: u64) -> Simulation {
    let timeline = Timeline::new(Rate::new(rate).unwrap());
    let mut simulation = start(network, &timeline);
    simulation.skip(n_frames).unwrap();
    simulation
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    })
}

/// Momentum and angular momentum, in kg·m a frame: that of points of mass m whose coordinates follow one another.
fn momenta(simulation: &Simulation, masses: &[f64]) -> [[f64; 3]; 2] {
    let (x, d) = (simulation.positions(), simulation.steps());
    let mut sums = [[0.0; 3]; 2];
    for (i, m) in masses.iter().enumerate() {
        let own = |all: &[f64]| -> [f64; 3] { std::array::from_fn(|axis| all[3 * i + axis]) };
        let turn = cross(own(&x), own(&d));
        for axis in 0..3 {
            sums[0][axis] += m * own(&d)[axis];
            sums[1][axis] += m * turn[axis];
        }
    }
    sums
}

#[test]
fn a_thrown_point_flies_its_parabola() {
    let mut network = Network::new();
    network.part("ball", None);
    let ball = point(&mut network, "m", 0.2, [0.1, 0.0, 2.0], [1.0, -2.0, 3.0]);
    network
        .weigh(ball.first + 2..ball.first + 3, -9.81)
        .unwrap();
    // What is added later has no weight.
    let later = point(&mut network, "later", 0.1, [0.0; 3], [0.0; 3]);
    let simulation = run(network, RATE, 22_050);
    let t = 0.5;
    let exact = [0.1 + t, -2.0 * t, 2.0 + 3.0 * t - 0.5 * 9.81 * t * t];
    for (x, exact) in simulation.positions().iter().zip(exact) {
        assert!((x - exact).abs() < 1e-11, "{x} is not {exact}");
    }
    assert_eq!(&simulation.positions()[later.first..], [0.0; 3]);
}

/// A spring without length pulls along each axis as if there were no other: an ellipse around its fixed end.
#[test]
fn a_spring_without_length_turns_its_end_on_an_ellipse() {
    let (k, m) = (40.0_f64, 0.01_f64);
    let error = |rate: f64| {
        let mut network = Network::new();
        network.part("pair", None);
        let centre = point(&mut network, "c", 0.0, [0.5, -0.5, 0.25], [0.0; 3]);
        let ball = point(&mut network, "m", m, [0.6, -0.5, 0.25], [0.0, 4.0, 2.0]);
        let ends = (centre, ball);
        link(&mut network, ends, SpaceLaw::Spring, [k, 0.0, 0.0]);
        let simulation = run(network, rate, rate as u64);
        let omega = (k / m).sqrt();
        let exact = [
            0.5 + 0.1 * cos(omega),
            -0.5 + 4.0 / omega * sin(omega),
            0.25 + 2.0 / omega * sin(omega),
        ];
        let apart: Vec<f64> = (0..3)
            .map(|axis| simulation.positions()[ball.first + axis] - exact[axis])
            .collect();
        norm(&apart)
    };
    let (coarse, fine) = (error(4_000.0), error(8_000.0));
    // The second order: half the step, a quarter of the error.
    assert!((3.8..4.2).contains(&(coarse / fine)), "{coarse} {fine}");
}

/// A row of springs under tension T: across it swings by T, along it by K.
#[test]
fn a_stretched_row_has_the_modes_of_the_lattice() {
    let (n, k, m, spacing, rest) = (5, 2_000.0, 1e-3, 0.02, 0.015);
    for (axis, stiffness) in [(0, k), (1, k * (spacing - rest) / spacing)] {
        let mut network = Network::new();
        network.part("row", None);
        let (mut x0, mut v0) = (vec![0.0; 3 * (n + 2)], vec![0.0; 3 * (n + 2)]);
        let mut masses = vec![m; n + 2];
        (masses[0], masses[n + 1]) = (0.0, 0.0);
        let mode = 2.0;
        let shape = |i: usize| sin(mode * std::f64::consts::PI * i as f64 / (n + 1) as f64);
        for i in 0..n + 2 {
            x0[i] = spacing * i as f64;
            // Small enough that the tension stays, and large enough for its digits.
            v0[axis * (n + 2) + i] = 1e-4 * shape(i);
        }
        let points = SpacePoints {
            n_axes: 3,
            masses: &masses,
            x0: &x0,
            v0: &v0,
            z: 0.0,
        };
        let first = network.points("m", true, points).unwrap();
        assert_eq!(network.mat_name(first + n + 2 + 3), "row.m.3.y");
        let ends = [first, first + 1].map(|first| SpacePoint::strided(first, n + 2));
        let numbers = [k, 0.0, rest];
        network
            .space_links("s", (ends[0], ends[1]), n + 1, 3, SpaceLaw::Spring, numbers)
            .unwrap();
        let half = sin(0.5 * mode * std::f64::consts::PI / (n + 1) as f64);
        let omega = 2.0 * (stiffness / m).sqrt() * half;
        let frames = 30_000_u64;
        let simulation = run(network, 1e6, frames);
        let exact = 1e-4 * shape(1) / omega * sin(omega * frames as f64 / 1e6);
        let at = first + axis * (n + 2) + 1;
        let moved = simulation.positions()[at] - x0[axis * (n + 2) + 1];
        let size = 1e-4 * shape(1) / omega;
        assert!(
            (moved - exact).abs() < 1e-4 * size,
            "axis {axis}: {moved} is not {exact}"
        );
    }
}

#[test]
fn a_collision_keeps_momenta_and_energy() {
    let masses = [0.05, 0.02];
    let mut network = Network::new();
    network.part("balls", None);
    // Not head-on: they turn about each other.
    let a = point(&mut network, "a", masses[0], [0.0; 3], [2.0, 0.1, -0.3]);
    let b = point(
        &mut network,
        "b",
        masses[1],
        [0.05, 0.006, -0.004],
        [-1.0, 0.0, 0.2],
    );
    let law = SpaceLaw::Contact {
        exponent: 1.5,
        clamp: false,
    };
    let contact = link(&mut network, (a, b), law, [1e7, 0.0, 0.03]);
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let mut simulation = start(network, &timeline);
    let before = momenta(&simulation, &masses);
    simulation.skip(4_000).unwrap();
    let after = momenta(&simulation, &masses);
    for (before, after) in before.iter().zip(&after) {
        for (before, after) in before.iter().zip(after) {
            assert!((before - after).abs() < 1e-13 * norm(&[*before, 1e-6]) + 1e-18);
        }
    }
    let energy = simulation.energy().unwrap();
    assert!(energy.residual.abs() < 1e-11 * energy.flow, "{energy:?}");
    assert!(energy.produced.abs() < 1e-3 * energy.start, "{energy:?}");
    // They met: the first is slower, and what it lost the other has.
    let speed = |at: usize| norm(&simulation.steps()[at..at + 3]) * RATE;
    assert!(
        speed(a.first) < 1.6 && speed(b.first) > 1.5,
        "link {contact}"
    );
}

/// Some points, tied to each other by springs and contacts, to a bell by a spring along one axis, and to the ground.
fn tangle(seed: u64) -> (Network, Timeline, Vec<f64>) {
    let mut chance = Chance::new(i128::from(seed), "space", "tangle", 0, 0);
    let mut draw = |low: f64, high: f64| chance.uniform(low, high);
    let mut network = Network::new();
    network.part("tangle", None);
    let n = 5;
    let masses: Vec<f64> = (0..n).map(|_| draw(2e-3, 2e-2)).collect();
    let points: Vec<SpacePoint> = (0..n)
        .map(|i| {
            let x0 = std::array::from_fn(|_| draw(-0.05, 0.05));
            let v0 = std::array::from_fn(|_| draw(-0.5, 0.5));
            point(&mut network, &format!("m{i}"), masses[i], x0, v0)
        })
        .collect();
    let length = |network: &Network, a: SpacePoint, b: SpacePoint| {
        let x0 = &network.mats().x0;
        let apart: Vec<f64> = (0..3)
            .map(|axis| x0[a.first + axis] - x0[b.first + axis])
            .collect();
        norm(&apart)
    };
    for i in 0..n {
        for j in 0..i {
            let ends = (points[j], points[i]);
            let rest = length(&network, ends.0, ends.1) * draw(0.7, 1.3);
            match (i + j) % 3 {
                0 => {
                    let numbers = [draw(50.0, 500.0), draw(0.0, 0.05), rest];
                    link(&mut network, ends, SpaceLaw::Spring, numbers)
                }
                1 => {
                    let (exponent, clamp) = (1.0 + 0.5 * f64::from(u8::from(i % 2 == 0)), true);
                    let law = SpaceLaw::Contact { exponent, clamp };
                    link(&mut network, ends, law, [2e3, 0.02, 0.6 * rest])
                }
                _ => {
                    let core = draw(0.01, 0.05);
                    let numbers = [draw(20.0, 200.0), 0.0, 0.0];
                    link(&mut network, ends, SpaceLaw::Attraction { core }, numbers)
                }
            };
        }
    }
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    let tie = Tie::Tuned {
        f: 210.0,
        t60: Some(0.3),
    };
    network.part("bell", None);
    let bell = network.cel("m", 0.01, tie, 0.0, 0.0, 0.0).unwrap();
    network
        .spring("thread", bell, points[0].first + 1, 300.0, 0.01, 0.0)
        .unwrap();
    hear(&mut network, "bell", bell);
    hear(&mut network, "z", points[n - 1].first + 2);
    let weighed = points[0].first..points[n - 1].first + 3;
    for at in weighed.skip(2).step_by(3) {
        network.weigh(at..at + 1, -9.81).unwrap();
    }
    timeline
        .strike(&network, points[2].first, 0.01, 2e-3, 0)
        .unwrap();
    timeline.strike(&network, bell, 0.02, 1e-3, 0).unwrap();
    (network, timeline, masses)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_ledger_closes(seed in any::<u64>()) {
        let (network, timeline, _) = tangle(seed);
        let mut simulation = start(network, &timeline);
        simulation.skip(8_000).unwrap();
        let energy: Energy = simulation.energy().unwrap();
        prop_assert!(energy.flow > 1e-4);
        prop_assert!(energy.residual.abs() <= 1e-11 * energy.flow, "{energy:?}");
    }

    #[test]
    fn blocks_plans_and_snapshots_change_no_byte(seed in any::<u64>()) {
        let (network, timeline, _) = tangle(seed);
        let n = 4_000;
        let mut whole = start(network.clone(), &timeline);
        let sound = play(&mut whole, n, &[n]);
        let mut split = start(network.clone(), &timeline);
        prop_assert!(sound == play(&mut split, n, &[17, 400, 1]));
        let network = Arc::new(network);
        let plan = Plan::new(network, &timeline, &Budget::Error(-20.0), None).unwrap();
        let plan = Arc::new(plan);
        let by = |threads| Options { threads, ledger: false, ..options(OnFault::Stop) };
        let mut one = Simulation::planned(plan.clone(), by(1)).unwrap();
        let mut three = Simulation::planned(plan, by(3)).unwrap();
        play(&mut one, n / 2, &[64]);
        let snapshot = one.snapshot();
        let rest = play(&mut one, n / 2, &[64]);
        play(&mut three, n / 2, &[33]);
        prop_assert!(rest == play(&mut three, n / 2, &[33]));
        one.restore(&snapshot);
        prop_assert!(rest == play(&mut one, n / 2, &[9]));
    }
}

/// Without what is outside, nothing pushes the whole and nothing turns it.
#[test]
fn a_free_tangle_keeps_its_momenta() {
    let mut network = Network::new();
    network.part("free", None);
    let masses = [0.01, 0.004, 0.02, 0.007];
    let points: Vec<SpacePoint> = (0..4)
        .map(|i| {
            let at = |axis: usize| 0.03 * sin((3 * i + axis * 7 + 1) as f64);
            let x0 = std::array::from_fn(at);
            let v0 = std::array::from_fn(|axis| 20.0 * at(axis + 2));
            point(&mut network, &format!("m{i}"), masses[i], x0, v0)
        })
        .collect();
    for i in 0..4 {
        for j in 0..i {
            let (law, numbers) = if j == 0 {
                (SpaceLaw::Attraction { core: 0.02 }, [800.0, 0.0, 0.0])
            } else {
                (SpaceLaw::Spring, [800.0, 0.03, 0.04])
            };
            link(&mut network, (points[i], points[j]), law, numbers);
        }
    }
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let mut simulation = start(network, &timeline);
    let before = momenta(&simulation, &masses);
    simulation.skip(40_000).unwrap();
    let after = momenta(&simulation, &masses);
    for (before, after) in before.iter().zip(&after) {
        let apart: Vec<f64> = before.iter().zip(after).map(|(a, b)| a - b).collect();
        assert!(
            norm(&apart) < 1e-12 * norm(before),
            "{before:?} became {after:?}"
        );
    }
}

/// A law that is endless where d is 0, and one that takes energy.
#[test]
fn laws_of_distances_keep_momenta_and_ledger() {
    let law = |law: &str, damping: Option<&str>| {
        let text = LawText {
            law: Some(law),
            damping,
            ..LawText::default()
        };
        Arc::new(Law::new(&text).unwrap())
    };
    let bond = law("0.04*((0.03/d)**2 - (0.03/d)**3)", None);
    let hard = law("20*d + 1e4*d**3", Some("0.01*v"));
    let mut network = Network::new();
    network.part("free", None);
    let masses = [0.01, 0.004, 0.02, 0.007];
    let points: Vec<SpacePoint> = (0..4)
        .map(|i| {
            let at = |axis: usize| 0.03 * sin((3 * i + axis * 7 + 1) as f64);
            let x0 = std::array::from_fn(at);
            let v0 = std::array::from_fn(|axis| 10.0 * at(axis + 2));
            point(&mut network, &format!("m{i}"), masses[i], x0, v0)
        })
        .collect();
    for i in 1..4 {
        let ends = (points[0], points[i]);
        let name = format!("bond{i}");
        network
            .space_lnl(&name, ends, 3, bond.clone(), 0.0)
            .unwrap();
        let ends = (points[i], points[i % 3 + 1]);
        let rest = network.distance(ends, 3);
        let name = format!("hard{i}");
        network
            .space_lnl(&name, ends, 3, hard.clone(), rest)
            .unwrap();
    }
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let mut simulation = start(network, &timeline);
    let before = momenta(&simulation, &masses);
    simulation.skip(40_000).unwrap();
    let after = momenta(&simulation, &masses);
    for (before, after) in before.iter().zip(&after) {
        let apart: Vec<f64> = before.iter().zip(after).map(|(a, b)| a - b).collect();
        assert!(norm(&apart) < 1e-11 * norm(before), "{apart:?}");
    }
    let energy = simulation.energy().unwrap();
    assert!(energy.lost > 1e-5, "{energy:?}");
    assert!(energy.residual.abs() < 1e-11 * energy.flow, "{energy:?}");
    assert!(energy.produced.abs() < 0.01 * energy.flow, "{energy:?}");
}

/// Where it begins a law is as stiff as its slope along its line, and as f/ℓ across it.
#[test]
fn a_law_too_stiff_where_it_begins_is_refused() {
    let scene = |expression: &str| {
        let text = LawText {
            law: Some(expression),
            ..LawText::default()
        };
        let law = Arc::new(Law::new(&text).unwrap());
        let mut network = Network::new();
        network.part("two", None);
        let a = point(&mut network, "a", 1e-3, [0.0; 3], [0.0; 3]);
        let b = point(&mut network, "b", 1e-3, [0.01, 0.0, 0.0], [0.0; 3]);
        network.space_lnl("s", (a, b), 3, law, 0.0).unwrap();
        let timeline = Timeline::new(Rate::new(RATE).unwrap());
        Simulation::new(Arc::new(network), &timeline, options(OnFault::Stop)).is_ok()
    };
    // 4M/T² over the two ends is 3.9 MN/m.
    let (near, beyond) = (1e-3 * RATE * RATE * 1.9, 1e-3 * RATE * RATE * 2.1);
    for is_across in [false, true] {
        let law = |k: f64| match is_across {
            true => format!("{k} * 0.01"),
            false => format!("{k} * (d - 0.01)"),
        };
        assert!(scene(&law(near)), "{is_across}");
        assert!(!scene(&law(beyond)), "{is_across}");
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let mut network = Network::new();
    network.part("rope", None);
    let a = point(&mut network, "a", 1e-3, [0.0; 3], [0.0; 3]);
    let b = point(&mut network, "b", 1e-3, [0.1, 0.0, 0.0], [0.0; 3]);
    let mut refused = |ends, law, numbers, said: &str| {
        let error = network.space_links("s", ends, 1, 3, law, numbers);
        assert_eq!(error.unwrap_err().to_string(), said);
    };
    let spring = SpaceLaw::Spring;
    refused(
        (a, a),
        spring.clone(),
        [1.0, 0.0, 0.1],
        "rope.s: a link joins two different points",
    );
    refused(
        (a, b),
        spring.clone(),
        [-1.0, 0.0, 0.1],
        "rope.s: K is -1: it must not be negative",
    );
    let far = SpacePoint::strided(5, 1);
    refused(
        (a, far),
        spring.clone(),
        [1.0, 0.0, 0.1],
        "rope.s: joins a module that does not exist",
    );
    let law = SpaceLaw::Contact {
        exponent: 0.5,
        clamp: false,
    };
    refused(
        (a, b),
        law,
        [1.0, 0.0, 0.1],
        "rope.s: the exponent of a contact must be from 1 to 8",
    );
    // As stiff as it is along its line, its steps would diverge.
    link(&mut network, (a, b), spring, [5e6, 0.0, 0.1]);
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let error = Simulation::new(Arc::new(network), &timeline, options(OnFault::Stop));
    let said = error.unwrap_err().to_string();
    assert!(said.contains("rope."), "{said}");
}

/// A row at its own length: its springs have no force but that of rounding, which is no energy that somebody made.
#[test]
fn a_row_at_rest_makes_no_energy() {
    let mut network = Network::new();
    network.part("row", None);
    let n = 7;
    let third = 1.0 / 3.0;
    let x0: Vec<f64> = (0..3 * n)
        .map(|at| 0.01 + 0.03 * third * (at % n) as f64 * (1.0 + (at / n) as f64))
        .collect();
    let points = SpacePoints {
        n_axes: 3,
        masses: &[1e-3; 7],
        x0: &x0,
        v0: &[0.0; 21],
        z: 0.0,
    };
    let first = network.points("m", true, points).unwrap();
    let ends = [first, first + 1].map(|first| SpacePoint::strided(first, n));
    let rest = network.distance((ends[0], ends[1]), 3);
    let numbers = [800.0, 1e-3, rest];
    network
        .space_links("s", (ends[0], ends[1]), n - 1, 3, SpaceLaw::Spring, numbers)
        .unwrap();
    let simulation = run(network, RATE, 100_000);
    assert!(simulation.gains().is_empty(), "{:?}", simulation.gains());
}

/// A point that is pulled away at a constant speed, from a fixed one: force of the link, frame by frame.
fn pulled(law: SpaceLaw, far: f64) -> (Simulation, Vec<f64>) {
    let (k, rest) = (1_000.0, 0.1);
    let mut network = Network::new();
    network.part("wire", None);
    let held = point(&mut network, "a", 0.0, [0.0; 3], [0.0; 3]);
    // Heavy enough that the link hardly slows it.
    let ball = point(&mut network, "b", 1e6, [rest, 0.0, 0.0], [far, 0.0, 0.0]);
    let wire = link(&mut network, (held, ball), law, [k, 0.0, rest]);
    let (len, weight) = (1, -1.0);
    let term = Term::Force {
        first: wire,
        len,
        weight,
    };
    network.listen("force", vec![term]).unwrap();
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let mut simulation = start(network, &timeline);
    let mut force = vec![0.0; 44_100];
    simulation.process(&mut force).unwrap();
    (simulation, force)
}

#[test]
fn a_wire_yields_and_breaks() {
    let endless = f64::INFINITY;
    // It grows by 20 mm a second: at 1 N/mm its force is 20 N at the end, if nothing yields.
    let (_, force) = pulled(SpaceLaw::Spring, 0.02);
    assert!((force[44_099] - 20.0).abs() < 1e-2);
    let (yields, breaks) = (5.0, endless);
    let (simulation, force) = pulled(SpaceLaw::Yielding { yields, breaks }, 0.02);
    let most = force.iter().copied().fold(0.0, f64::max);
    assert!((most - 5.0).abs() < 1e-9 && (force[44_099] - 5.0).abs() < 1e-9);
    let energy = simulation.energy().unwrap();
    // 5 N along 15 mm.
    assert!((energy.lost - 0.075).abs() < 1e-4, "{energy:?}");
    assert!(energy.residual.abs() < 1e-11 * energy.flow, "{energy:?}");
    let (yields, breaks) = (endless, 8e-3);
    let (simulation, force) = pulled(SpaceLaw::Yielding { yields, breaks }, 0.02);
    let broken = 1 + force.iter().rposition(|&force| force != 0.0).unwrap();
    assert!((broken as f64 / RATE - 0.4).abs() < 1e-3, "{broken}");
    assert!((force[broken - 1] - 8.0).abs() < 1e-3);
    let energy = simulation.energy().unwrap();
    // ½·8 N·8 mm are gone with it.
    assert!((energy.lost - 0.032).abs() < 1e-4, "{energy:?}");
    assert!(energy.residual.abs() < 1e-11 * energy.flow, "{energy:?}");
}

/// A row that is thrown apart, so that some of its links break; each is heard. With more: a weight hangs on it.
fn torn_row(is_more: bool) -> Network {
    let law = SpaceLaw::Yielding {
        yields: 0.8,
        breaks: 4e-3,
    };
    let mut network = Network::new();
    network.part("net", None);
    let n = 8;
    let x0: Vec<f64> = (0..3 * n)
        .map(|at| {
            if at < n {
                0.02 * at as f64
            } else {
                1e-3 * sin(at as f64)
            }
        })
        .collect();
    let mut v0 = vec![0.0; 3 * n];
    (v0[0], v0[n - 1], v0[2 * n + 4]) = (-4.0, 5.0, 2.0);
    let masses = vec![2e-3; n];
    let points = SpacePoints {
        n_axes: 3,
        masses: &masses,
        x0: &x0,
        v0: &v0,
        z: 0.0,
    };
    let first = network.points("m", true, points).unwrap();
    let ends = [first, first + 1].map(|first| SpacePoint::strided(first, n));
    network
        .space_links("s", (ends[0], ends[1]), n - 1, 3, law, [400.0, 0.01, 0.02])
        .unwrap();
    for link in 0..n - 1 {
        let (len, weight) = (1, 1.0);
        let term = Term::Force {
            first: link,
            len,
            weight,
        };
        network.listen(&format!("f{link}"), vec![term]).unwrap();
    }
    if is_more {
        let weight = point(&mut network, "w", 1e-3, [0.0, 0.1, 0.0], [0.0; 3]);
        let end = SpacePoint::strided(first, n);
        link(
            &mut network,
            (end, weight),
            SpaceLaw::Spring,
            [20.0, 0.0, 0.1],
        );
    }
    network
}

/// A net that is thrown against its own threads: the ledger closes, broken links never pull, and what is broken stays so.
#[test]
fn a_net_tears_and_its_ledger_closes() {
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let mut simulation = start(torn_row(false), &timeline);
    let n = 20_000;
    let sound = play(&mut simulation, n, &[64]);
    let energy = simulation.energy().unwrap();
    assert!(energy.lost > 1e-4, "{energy:?}");
    assert!(energy.residual.abs() < 1e-11 * energy.flow, "{energy:?}");
    let forces = |frame: usize| &sound[7 * frame..7 * (frame + 1)];
    let still = |frame: usize| forces(frame).iter().filter(|&&bits| bits << 1 == 0).count();
    assert!(still(n - 1) >= 1 && still(n - 1) < 7, "{}", still(n - 1));
    assert_eq!(still(n - 1), still(n - 5_000));
    // A snapshot knows what is broken.
    let mut other = start(torn_row(false), &timeline);
    play(&mut other, n / 2, &[100]);
    let snapshot = other.snapshot();
    let rest = play(&mut other, n / 2, &[64]);
    assert!(rest == sound[7 * (n / 2)..]);
    simulation.restore(&snapshot);
    assert!(rest == play(&mut simulation, n / 2, &[9]));
}

/// What is torn stays torn where an edit changes the rest.
#[test]
fn an_edit_mends_nothing() {
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let version = |is_more| {
        let network = Arc::new(torn_row(is_more));
        Arc::new(Plan::new(network, &timeline, &Budget::Error(-20.0), None).unwrap())
    };
    let options = Options {
        ledger: false,
        ..options(OnFault::Stop)
    };
    let n = 10_000;
    let mut old = Simulation::planned(version(false), options).unwrap();
    let before = play(&mut old, n, &[64]);
    let broken = |sound: &[u64], link: usize| {
        let end = &sound[sound.len() - 7 * 500..];
        end.iter().skip(link).step_by(7).all(|bits| bits << 1 == 0)
    };
    let torn: Vec<bool> = (0..7).map(|link| broken(&before, link)).collect();
    assert!(torn.contains(&true) && torn.contains(&false), "{torn:?}");
    let mut new = Simulation::planned_from(version(true), options, n as u64).unwrap();
    let mut takeover = Takeover::new(&old, &new);
    assert!(new.take_over(&mut old, &mut takeover));
    let after = play(&mut new, 500, &[64]);
    for (link, torn) in torn.into_iter().enumerate() {
        assert_eq!(broken(&after, link), torn, "link {link}");
    }
}
