//! Contacts between all pairs of points give the motion of one link for each pair, whatever the neighbour lists are.

use std::sync::Arc;

use super::blocks::play;
use super::scene::options;
use ergon_engine::chance::Chance;
use ergon_engine::maths::{cos, sin};
use ergon_engine::network::{Measure, Network, PairLaw, PointGroup, SpaceLaw, SpacePoint, SpacePoints, Term};
use ergon_engine::plan::{Budget, Plan};
use ergon_engine::simulation::{Energy, OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;
use proptest::prelude::*;

pub(crate) const RATE: f64 = 44_100.0;
pub(crate) const GAP: f64 = 0.01;
pub(crate) const HERTZ: SpaceLaw = SpaceLaw::Contact {
    exponent: 1.5,
    is_clamped: true,
};
pub(crate) const LINEAR: SpaceLaw = SpaceLaw::Contact {
    exponent: 1.0,
    is_clamped: false,
};

/// Points with positions x0 and velocities v0, axis by axis.
pub(crate) fn points(
    network: &mut Network,
    name: &str,
    n_axes: usize,
    masses: &[f64],
    [x0, v0]: [&[f64]; 2],
) -> PointGroup {
    let n = masses.len();
    let points = SpacePoints {
        n_axes,
        masses,
        x0,
        v0,
        z: 0.0,
    };
    let first = network.points(name, true, points).unwrap();
    PointGroup {
        first: SpacePoint::strided(first, n),
        n,
    }
}

/// A group of points with random positions and velocities, some of which touch.
pub(crate) fn crowd(network: &mut Network, name: &str, n_axes: usize, n: usize, seed: u64) -> PointGroup {
    let mut chance = Chance::new(i128::from(seed), "crowd", name, 0, 0);
    let masses: Vec<f64> = (0..n).map(|_| chance.uniform(1e-3, 4e-3)).collect();
    let x0: Vec<f64> = (0..n * n_axes).map(|_| chance.uniform(-0.02, 0.02)).collect();
    let v0: Vec<f64> = (0..n * n_axes).map(|_| chance.uniform(-0.6, 0.6)).collect();
    points(network, name, n_axes, &masses, [&x0, &v0])
}

/// Points in a wide row at rest, of which a crowd meets few at a time.
fn skin(network: &mut Network, n_axes: usize) -> PointGroup {
    let n = 120;
    let mut x0 = vec![0.0; n * n_axes];
    for (i, x) in x0[..n].iter_mut().enumerate() {
        *x = 0.004 * (i as f64 - 60.0);
    }
    points(network, "skin", n_axes, &vec![2e-3; n], [&x0, &vec![0.0; n * n_axes]])
}

pub(crate) fn alone(group: PointGroup, i: usize) -> SpacePoint {
    SpacePoint {
        first: group.first.first + i,
        ..group.first
    }
}

fn meet(network: &mut Network, groups: [PointGroup; 2], n_axes: usize, law: SpaceLaw, numbers: [f64; 3]) {
    rub(network, groups, n_axes, (law, 0.0), numbers);
}

/// The contacts of [`meet`] with friction.
pub(crate) fn rub(
    network: &mut Network,
    groups: [PointGroup; 2],
    n_axes: usize,
    (law, friction): (SpaceLaw, f64),
    numbers: [f64; 3],
) {
    let what = PairLaw {
        friction,
        ..PairLaw::smooth(Measure::Distance, law)
    };
    let name = format!("meet{}", network.n_lia());
    network.pairwise(&name, groups, n_axes, what, numbers).unwrap();
}

pub(crate) fn start(network: Network) -> Simulation {
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    Simulation::new(Arc::new(network), &timeline, options(OnFault::Stop)).unwrap()
}

fn largest(x: &[f64]) -> f64 {
    x.iter().map(|x| x.abs()).fold(0.0, f64::max)
}

/// Motion of two groups whose points meet in all pairs, after a number of frames; `is_listed`: by one link for each
/// pair.
fn motion(seed: u64, n_axes: usize, is_listed: bool, n_frames: u64) -> Simulation {
    let mut network = Network::new();
    network.part("sand", None);
    let a = crowd(&mut network, "a", n_axes, 12, seed);
    let b = crowd(&mut network, "b", n_axes, 17, seed ^ 1);
    let skin = skin(&mut network, n_axes);
    let numbers = [400.0, 0.02, GAP];
    if is_listed {
        let mut link = |a: SpacePoint, b: SpacePoint| {
            let name = format!("l{}", network.n_lia());
            network.space_links(&name, (a, b), 1, n_axes, HERTZ, numbers).unwrap();
        };
        for i in 0..a.n {
            (i + 1..a.n).for_each(|j| link(alone(a, i), alone(a, j)));
        }
        for i in 0..a.n {
            (0..b.n).for_each(|j| link(alone(a, i), alone(b, j)));
        }
        for i in 0..a.n {
            (0..skin.n).for_each(|j| link(alone(a, i), alone(skin, j)));
        }
    } else {
        meet(&mut network, [a, a], n_axes, HERTZ, numbers);
        meet(&mut network, [a, b], n_axes, HERTZ, numbers);
        meet(&mut network, [a, skin], n_axes, HERTZ, numbers);
    }
    let mut simulation = start(network);
    simulation.skip(n_frames).unwrap();
    simulation
}

#[test]
fn pairwise_contacts_equal_single_links() {
    for (seed, n_axes) in [(1, 2), (2, 3), (3, 2), (4, 3)] {
        // Long enough for points to move by several gaps; afterwards rounding errors have grown.
        let n_frames = 2_000;
        let single = motion(seed, n_axes, false, n_frames);
        let listed = motion(seed, n_axes, true, n_frames);
        let apart: Vec<f64> = (single.positions().iter().zip(listed.positions()))
            .map(|(single, listed)| single - listed)
            .collect();
        assert!(largest(&apart) < 1e-9, "{seed}: {}", largest(&apart));
        let [single, listed] = [single, listed].map(|one| one.energy().unwrap());
        for (single, listed) in [
            (single.start, listed.start),
            (single.stored, listed.stored),
            (single.lost, listed.lost),
            (single.produced, listed.produced),
        ] {
            assert!((single - listed).abs() < 1e-7 * listed.abs().max(1e-6));
        }
        assert!(listed.lost > 1e-5, "nothing met");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn pairwise_contacts_keep_ledger_and_momentum(
        seed in any::<u64>(),
        n_axes in 2_usize..=3,
        friction in prop_oneof![Just(0.0), 0.01..1.5_f64],
    ) {
        let mut network = Network::new();
        network.part("sand", None);
        let n = 40;
        let own = crowd(&mut network, "m", n_axes, n, seed);
        let masses = network.mats().m.clone();
        rub(&mut network, [own, own], n_axes, (LINEAR, friction), [500.0, 0.03, GAP]);
        let mut simulation = start(network);
        let sum = |simulation: &Simulation| -> Vec<f64> {
            let d = simulation.steps();
            let along = |axis: usize| (axis * n..(axis + 1) * n).map(|i| masses[i] * d[i]).sum();
            (0..n_axes).map(along).collect()
        };
        let before = sum(&simulation);
        simulation.skip(6_000).unwrap();
        let energy: Energy = simulation.energy().unwrap();
        prop_assert!(energy.lost > 1e-5);
        prop_assert!(energy.residual.abs() <= 1e-11 * energy.flow, "{energy:?}");
        for (before, after) in before.iter().zip(sum(&simulation)) {
            prop_assert!((before - after).abs() < 1e-18, "{before} became {after}");
        }
    }

    /// A neighbour list that was built at other positions gives the same sums in the same order.
    #[test]
    fn neighbour_lists_change_no_byte(
        seed in any::<u64>(),
        n_axes in 2_usize..=3,
        friction in prop_oneof![Just(0.0), 0.01..1.5_f64],
    ) {
        let mut network = Network::new();
        network.part("sand", None);
        let sand = crowd(&mut network, "m", n_axes, 30, seed);
        let stones = crowd(&mut network, "s", n_axes, 6, seed ^ 3);
        rub(&mut network, [sand, sand], n_axes, (HERTZ, friction), [400.0, 0.02, GAP]);
        let law = (LINEAR, 0.5 * friction);
        rub(&mut network, [stones, sand], n_axes, law, [300.0, 0.01, 1.5 * GAP]);
        let (len, weight) = (30, 1.0);
        network.listen("force", vec![Term::Force { first: 0, len, weight }]).unwrap();
        let term = Term::Position { first: 3, len: 1, weight };
        network.listen("x", vec![term]).unwrap();
        let timeline = Timeline::new(Rate::new(RATE).unwrap());
        let plan = Plan::new(Arc::new(network), &timeline, &Budget::Error(-20.0), None).unwrap();
        let plan = Arc::new(plan);
        let by = |threads| SimulationOptions { threads, keeps_ledger: false, ..options(OnFault::Stop) };
        let mut one = Simulation::from_plan(plan.clone(), by(1)).unwrap();
        let mut other = Simulation::from_plan(plan, by(3)).unwrap();
        let n = 3_000;
        let begin = play(&mut one, n, &[64]);
        let heard: Vec<f64> = begin.iter().map(|&bits| f64::from_bits(bits)).collect();
        let force = heard.iter().step_by(2).copied().fold(0.0, f64::max);
        prop_assert!(force > 0.01, "{force}");
        prop_assert!(begin == play(&mut other, n, &[33]));
        let snapshot = one.snapshot();
        let rest = play(&mut one, n, &[64]);
        // The neighbour list of `other` was built at other positions.
        let mut late = other;
        play(&mut late, 2 * n, &[500]);
        late.restore(&snapshot);
        prop_assert!(rest == play(&mut late, n, &[100]));
    }
}

/// One ball against a wall: half an oscillation of M on K.
#[test]
fn ball_leaves_a_plane_at_its_incoming_speed() {
    let (m, k, v) = (2e-3, 2e4, 1.5);
    let tilt = 0.3;
    let normal = [sin(tilt), 0.0, cos(tilt)];
    let mut network = Network::new();
    network.part("wall", None);
    let still = [0.0; 3];
    let wall = points(&mut network, "w", 3, &[0.0], [&[0.1, -0.2, 0.3], &still]);
    // The ball starts where it touches the wall.
    let position = [0.1 + GAP * normal[0], 5.0, 0.3 + GAP * normal[2]];
    let speed = [-v * normal[0], 0.4, -v * normal[2]];
    let ball = points(&mut network, "m", 3, &[m], [&position, &speed]);
    let what = PairLaw::smooth(Measure::Plane(normal), LINEAR);
    network.pairwise("touch", [wall, ball], 3, what, [k, 0.0, GAP]).unwrap();
    let mut simulation = start(network);
    let half = std::f64::consts::PI * (m / k).sqrt();
    let depth = v * (m / k).sqrt();
    let n_mid = (0.5 * half * RATE).round() as u64;
    simulation.skip(n_mid).unwrap();
    let x = simulation.positions();
    let along = |x: &[f64]| (0..3).map(|i| (x[3 + i] - x[i]) * normal[i]).sum::<f64>();
    assert!((along(&x) - (GAP - depth)).abs() < 1e-2 * depth);
    simulation.skip(500).unwrap();
    let d = simulation.steps();
    let away: f64 = (0..3).map(|i| d[3 + i] * normal[i] * RATE).sum();
    assert!((away - v).abs() < 1e-2 * v, "{away}");
    // Nothing pushes along the plane.
    assert!((d[4] * RATE - 0.4).abs() < 1e-12);
}

#[test]
fn ball_stays_within_a_sphere() {
    let mut network = Network::new();
    network.part("drum", None);
    let still = [0.0; 3];
    let drum = points(&mut network, "d", 3, &[0.0], [&[1.0, 1.0, 1.0], &still]);
    let position = [1.02, 1.0, 1.0];
    let ball = points(&mut network, "m", 3, &[1e-3], [&position, &[0.3, 2.0, -1.0]]);
    let what = PairLaw::smooth(Measure::Within, HERTZ);
    network
        .pairwise("skin", [drum, ball], 3, what, [3e5, 0.0, 0.1])
        .unwrap();
    let mut simulation = start(network);
    let mut farthest: f64 = 0.0;
    for _ in 0..2_000 {
        simulation.skip(20).unwrap();
        let x = simulation.positions();
        let apart: Vec<f64> = (0..3).map(|i| x[3 + i] - x[i]).collect();
        let far = apart.iter().map(|x| x * x).sum::<f64>().sqrt();
        farthest = farthest.max(far);
    }
    assert!((0.1..0.104).contains(&farthest), "{farthest}");
    let energy = simulation.energy().unwrap();
    assert!((energy.stored - energy.start).abs() < 0.05 * energy.start, "{energy:?}");
}

#[test]
fn pairwise_with_wrong_groups_is_refused() {
    let mut network = Network::new();
    network.part("sand", None);
    let single = crowd(&mut network, "m", 3, 5, 1);
    let few = crowd(&mut network, "s", 3, 2, 2);
    let part = PointGroup { n: 3, ..single };
    let far = PointGroup {
        first: SpacePoint::strided(20, 5),
        n: 5,
    };
    let mut refused = |groups, measure, law, numbers, text: &str| {
        let error = network.pairwise("c", groups, 3, PairLaw::smooth(measure, law), numbers);
        assert_eq!(error.unwrap_err().to_string(), format!("sand.c: {text}"));
    };
    let (near, numbers) = (Measure::Distance, [1.0, 0.0, GAP]);
    refused(
        [single, few],
        near.clone(),
        LINEAR,
        numbers,
        "needs two groups of points, the second not smaller than the first",
    );
    refused(
        [part, single],
        near.clone(),
        LINEAR,
        numbers,
        "its two groups have points in common",
    );
    refused(
        [single, far],
        near.clone(),
        LINEAR,
        numbers,
        "joins a module that does not exist",
    );
    refused(
        [single, single],
        near.clone(),
        SpaceLaw::Spring,
        numbers,
        "only contacts and attractions act between all pairs of points",
    );
    refused(
        [single, single],
        near.clone(),
        LINEAR,
        [1.0, 0.0, 0.0],
        "points that meet need a gap above 0: the distance at which they touch",
    );
    refused(
        [few, single],
        Measure::Plane([1.0, 1.0, 0.0]),
        LINEAR,
        numbers,
        "the normal of a plane has a length of 1",
    );
    refused(
        [single, single],
        Measure::Within,
        LINEAR,
        numbers,
        "points of one group meet by their distance",
    );
    // Twelve such contacts at once on one grain would diverge.
    meet(&mut network, [single, single], 3, LINEAR, [5e5, 0.0, GAP]);
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let error = Simulation::new(Arc::new(network), &timeline, options(OnFault::Stop));
    assert!(error.unwrap_err().to_string().contains("sand."));
}

/// Contacts that are too stiff for their steps create energy, which stops a render.
#[test]
fn pairwise_created_energy_is_reported() {
    let mut network = Network::new();
    network.part("drum", None);
    let still = [0.0; 3];
    let drum = points(&mut network, "d", 3, &[0.0], [&still, &still]);
    let single = crowd(&mut network, "m", 3, 20, 7);
    meet(&mut network, [single, single], 3, HERTZ, [300.0, 0.0, GAP]);
    let law = SpaceLaw::Contact {
        exponent: 1.5,
        is_clamped: false,
    };
    network
        .pairwise(
            "skin",
            [drum, single],
            3,
            PairLaw::smooth(Measure::Within, law),
            [3e9, 0.0, 0.04],
        )
        .unwrap();
    let error = start(network).skip(44_100).unwrap_err().to_string();
    assert!(error.contains("drum.meet0.0 created energy"), "{error}");
}

/// The crowd of [`motion`] by itself; `is_reversed`: its third coordinates come before the others.
fn apart(is_reversed: bool) -> Vec<f64> {
    let (n, n_axes) = (20, 3);
    let mut alone = Network::new();
    alone.part("sand", None);
    crowd(&mut alone, "a", n_axes, n, 5);
    let mats = alone.mats();
    let source = |axes: std::ops::Range<usize>| {
        let part = axes.start * n..axes.end * n;
        [&mats.m[..n], &mats.x0[part.clone()], &mats.v0[part]].map(<[f64]>::to_vec)
    };
    let mut network = Network::new();
    network.part("sand", None);
    let mut add = |axes: std::ops::Range<usize>| {
        let [masses, x0, v0] = source(axes.clone());
        let group = points(&mut network, "a", axes.len(), &masses, [&x0, &v0]);
        group.first.first
    };
    let (first, third) = if is_reversed {
        let third = add(2..3);
        (add(0..2), third)
    } else {
        (add(0..2), add(2..3))
    };
    let behind = |mat: usize| mat as isize - first as isize;
    let group = PointGroup {
        first: SpacePoint {
            first,
            offsets: [n as isize, behind(third)],
        },
        n,
    };
    meet(&mut network, [group, group], n_axes, HERTZ, [4e3, 0.02, GAP]);
    let mut simulation = start(network);
    simulation.skip(2_000).unwrap();
    let x = simulation.positions();
    [first, first + n, third]
        .into_iter()
        .flat_map(|mat| x[mat..mat + n].to_vec())
        .collect()
}

#[test]
fn space_points_with_coordinates_in_any_order() {
    let [first, other] = [false, true].map(apart);
    assert!(largest(&first) > 0.02, "they fly apart");
    assert!(
        first.iter().zip(&other).all(|(a, b)| a.to_bits() == b.to_bits()),
        "the same bits"
    );
}
