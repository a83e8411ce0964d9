//! Points in space: comparison with closed forms, and inputs that are refused.

use std::sync::Arc;

use super::scene::options;
use ergon_engine::maths::{cos, sin};
use ergon_engine::network::{Network, SpaceLaw, SpacePoint, SpacePoints, Term};
use ergon_engine::simulation::{OnFault, Simulation};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

pub(crate) const RATE: f64 = 44_100.0;

/// A single point at x0 [m] with v0 [m/s].
pub(crate) fn point(network: &mut Network, name: &str, m: f64, x0: [f64; 3], v0: [f64; 3]) -> SpacePoint {
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

pub(crate) fn link(network: &mut Network, ends: (SpacePoint, SpacePoint), law: SpaceLaw, numbers: [f64; 3]) -> usize {
    let name = format!("link{}", network.n_lia());
    network.space_links(&name, ends, 1, 3, law, numbers).unwrap()
}

pub(crate) fn hear(network: &mut Network, name: &str, first: usize) {
    let (len, weight) = (1, 1.0);
    let term = Term::Position { first, len, weight };
    network.listen(name, vec![term]).unwrap();
}

pub(crate) fn start(network: Network, timeline: &Timeline) -> Simulation {
    Simulation::new(Arc::new(network), timeline, options(OnFault::Stop)).unwrap()
}

pub(crate) fn run(network: Network, rate: f64, n_frames: u64) -> Simulation {
    let timeline = Timeline::new(Rate::new(rate).unwrap());
    let mut simulation = start(network, &timeline);
    simulation.skip(n_frames).unwrap();
    simulation
}

pub(crate) fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Momentum and angular momentum [kg·m a frame] of points of these masses; the coordinates of a point are adjacent.
pub(crate) fn momenta(simulation: &Simulation, masses: &[f64]) -> [[f64; 3]; 2] {
    let (x, d) = (simulation.positions(), simulation.steps());
    let mut sums = [[0.0; 3]; 2];
    for (i, m) in masses.iter().enumerate() {
        let single = |all: &[f64]| -> [f64; 3] { std::array::from_fn(|axis| all[3 * i + axis]) };
        let turn = cross(single(&x), single(&d));
        for axis in 0..3 {
            sums[0][axis] += m * single(&d)[axis];
            sums[1][axis] += m * turn[axis];
        }
    }
    sums
}

pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    })
}

#[test]
fn thrown_point_flies_a_parabola() {
    let mut network = Network::new();
    network.part("ball", None);
    let ball = point(&mut network, "m", 0.2, [0.1, 0.0, 2.0], [1.0, -2.0, 3.0]);
    network.weigh(ball.first + 2..ball.first + 3, -9.81).unwrap();
    // Gravity does not act on a point that is added later.
    let later = point(&mut network, "later", 0.1, [0.0; 3], [0.0; 3]);
    let simulation = run(network, RATE, 22_050);
    let t = 0.5;
    let exact = [0.1 + t, -2.0 * t, 2.0 + 3.0 * t - 0.5 * 9.81 * t * t];
    for (x, exact) in simulation.positions().iter().zip(exact) {
        assert!((x - exact).abs() < 1e-11, "{x} is not {exact}");
    }
    assert_eq!(&simulation.positions()[later.first..], [0.0; 3]);
}

/// A spring without length pulls along each axis independently: an ellipse around its fixed end.
#[test]
fn spring_without_length_moves_on_an_ellipse() {
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
    // Order 2: half the step, a quarter of the error.
    assert!((3.8..4.2).contains(&(coarse / fine)), "{coarse} {fine}");
}

/// A row of springs under tension T: transverse modes depend on T, longitudinal ones on K.
#[test]
fn stretched_row_has_modes_of_the_lattice() {
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
            // Small enough for a constant tension, and large enough for the digits.
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
        let position = first + axis * (n + 2) + 1;
        let moved = simulation.positions()[position] - x0[axis * (n + 2) + 1];
        let size = 1e-4 * shape(1) / omega;
        assert!(
            (moved - exact).abs() < 1e-4 * size,
            "axis {axis}: {moved} is not {exact}"
        );
    }
}

#[test]
fn collision_conserves_momenta_and_energy() {
    let masses = [0.05, 0.02];
    let mut network = Network::new();
    network.part("balls", None);
    // Not head-on: they rotate about each other.
    let a = point(&mut network, "a", masses[0], [0.0; 3], [2.0, 0.1, -0.3]);
    let b = point(&mut network, "b", masses[1], [0.05, 0.006, -0.004], [-1.0, 0.0, 0.2]);
    let law = SpaceLaw::Contact {
        exponent: 1.5,
        is_clamped: false,
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
    // After the collision the first is slower, and its loss in momentum is the gain of the second.
    let speed = |at: usize| norm(&simulation.steps()[at..at + 3]) * RATE;
    assert!(speed(a.first) < 1.6 && speed(b.first) > 1.5, "link {contact}");
}

#[test]
fn space_links_with_wrong_values_are_refused() {
    let mut network = Network::new();
    network.part("rope", None);
    let a = point(&mut network, "a", 1e-3, [0.0; 3], [0.0; 3]);
    let b = point(&mut network, "b", 1e-3, [0.1, 0.0, 0.0], [0.0; 3]);
    let mut refused = |ends, law, numbers, text: &str| {
        let error = network.space_links("s", ends, 1, 3, law, numbers);
        assert_eq!(error.unwrap_err().to_string(), text);
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
        is_clamped: false,
    };
    refused(
        (a, b),
        law,
        [1.0, 0.0, 0.1],
        "rope.s: the exponent of a contact must be from 1 to 8",
    );
    // With its stiffness along its line, the steps would diverge.
    link(&mut network, (a, b), spring, [5e6, 0.0, 0.1]);
    let timeline = Timeline::new(Rate::new(RATE).unwrap());
    let error = Simulation::new(Arc::new(network), &timeline, options(OnFault::Stop));
    let text = error.unwrap_err().to_string();
    assert!(text.contains("rope."), "{text}");
}

/// A row at its rest length: its spring forces are rounding errors, which do not count as created energy.
#[test]
fn row_at_rest_creates_no_energy() {
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

/// Three paths of computation: all springs in one pass; springs with an infinite yield force, computed operation by
/// operation; and springs one by one.
#[test]
fn space_springs_in_runs_equal_single_springs() {
    const N: usize = 131;
    let endless = SpaceLaw::Yielding {
        yields: f64::INFINITY,
        breaks: f64::INFINITY,
    };
    for n_axes in [2, 3] {
        // Ends that overlap, ends that do not, and ends in reverse order; at most two springs pull on a point.
        for (a, b, n) in [(0, 1, 100), (0, 40, 40), (50, 0, 50), (60, 10, 70), (3, 90, 9)] {
            let paths = [(SpaceLaw::Spring, n), (endless.clone(), n), (SpaceLaw::Spring, 1)].map(|(law, len)| {
                let mut network = Network::new();
                network.part("p", None);
                let position = |axis: usize, i: usize| match axis {
                    0 => 1e-2 * i as f64,
                    _ => 1e-3 * sin((axis * N + i) as f64),
                };
                let x0 = (0..n_axes * N).map(|mat| position(mat / N, mat % N));
                let x0: Vec<f64> = x0.collect();
                let points = SpacePoints {
                    n_axes,
                    masses: &[1e-3; N],
                    x0: &x0,
                    v0: &x0.iter().map(|x| 0.3 * x).collect::<Vec<f64>>(),
                    z: 0.0,
                };
                let first = network.points("m", true, points).unwrap();
                let numbers = [300.0, 0.02, 8e-3];
                for i in (0..n).step_by(len) {
                    let ends = [a, b].map(|end| SpacePoint::strided(first + end + i, N));
                    let name = format!("l{i}");
                    network
                        .space_links(&name, ends.into(), len, n_axes, law.clone(), numbers)
                        .unwrap();
                }
                run(network, RATE, 200).positions()
            });
            let [fused, passes, single] = paths.map(|path| path.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
            assert!(fused == passes, "{n_axes} axes, {a} {b} {n}: passes");
            assert!(fused == single, "{n_axes} axes, {a} {b} {n}: one by one");
        }
    }
}
