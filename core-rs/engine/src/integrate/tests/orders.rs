//! Orders of convergence, against motions that are known.

use super::references::{exactly, exactly_hung, finely};
use super::*;
use crate::network::Tie;

const STRIKES: [(usize, usize, f64); 2] = [(0, 2, 4e-4), (7, 5, -3e-4)];
const FRAMES: usize = 120;

/// Errors at 1, 2, 4 and 8 steps a frame [dB].
fn errors(network: &Network, method: MeshMethod, exact: &[Vec<f64>]) -> Vec<f64> {
    [1, 2, 4, 8]
        .map(|substeps| {
            decibels(
                &play(by(network, method, substeps), FRAMES, &STRIKES),
                exact,
            )
        })
        .to_vec()
}

fn close(slopes: &[f64], order: f64, off: f64) -> bool {
    slopes.iter().all(|slope| (slope - order).abs() < off)
}

/// Struck, moving from the start, and coupled to a CEL with rest positions; ωT up to 0.6.
#[test]
fn undamped_row_converges_by_order_of_method() {
    let mut network = row(8, 1.7e5, 0.0, 0.0);
    let tie = Tie::Physical { k: 4e4, z: 0.0 };
    let cell = network
        .cel("cell", 2e-3, tie, 1e-5, 0.0, 0.2)
        .expect("a cell");
    network
        .spring("end", 3, cell, 1e5, 0.0, 2e-5)
        .expect("a spring");
    let exact = exactly_hung(&network, FRAMES, &STRIKES);
    // Errors at one step a frame: -10.7, -51.0, -90.3, -10.7 and -5.5 dB.
    let limit = [-10.0, -50.0, -89.0, -10.0, -5.0];
    for (method, limit) in MeshMethod::ALL.into_iter().zip(limit) {
        let errors = errors(&network, method, &exact);
        assert!(errors[0] < limit, "{method:?} {errors:?}");
        let (slopes, order) = (slopes(&errors), f64::from(method.facts().order));
        assert!(close(&slopes, order, 0.15), "{method:?} {slopes:?}");
    }
}

/// Damped links: CA takes damping from the last step, an error of order 1 that shows once the error of the pitch is
/// small. CA2P falls from order 4 to 2. BM4 does too, because of its midpoint rule for losses, but only at smaller
/// steps.
#[test]
fn damped_links_reduce_orders_of_methods() {
    let network = row(8, 1.7e5, 0.0, 0.05);
    let exact = exactly(&network, FRAMES, &STRIKES);
    let all = |network: &Network, exact: &[Vec<f64>]| {
        MeshMethod::ALL.map(|method| {
            (
                errors(network, method, exact)[0],
                slopes(&errors(network, method, exact)),
            )
        })
    };
    let [ca, ca2p, bm4, ieq] = all(&network, &exact);
    assert!(ca.1[0] > 1.8 && ca.1[2] < 1.75, "{ca:?}");
    assert!(
        ca2p.0 < -51.0 && ca2p.1[0] > 3.7 && ca2p.1[2] < 3.4,
        "{ca2p:?}"
    );
    assert!(bm4.0 < -91.0 && bm4.1[0] > 3.5 && bm4.1[2] < 2.6, "{bm4:?}");
    assert!(close(&ieq.1, 2.0, 0.15), "{ieq:?}");
    // Ten times the damping: the slopes reach their lower limits.
    let network = row(8, 1.7e5, 0.0, 0.5);
    let exact = exactly(&network, FRAMES, &STRIKES);
    let [ca, ca2p, bm4, ..] = all(&network, &exact);
    assert!(ca.1[2] < 1.25 && ca2p.1[2] < 2.4, "{ca:?} {ca2p:?}");
    assert!(bm4.0 < -77.0 && close(&bm4.1, 2.0, 0.15), "{bm4:?}");
}

/// Cubic links, whose tangent stiffness doubles: CA2P is of order 2, and BM4 alone of order 4.
#[test]
fn cubic_links_converge_by_order_of_method() {
    let network = row(6, 8e4, 2e12, 0.0);
    let exact = finely(&network, FRAMES, &STRIKES);
    for method in [
        MeshMethod::Ca,
        MeshMethod::Ca2p,
        MeshMethod::Bm4,
        MeshMethod::Ieq,
    ] {
        let errors = errors(&network, method, &exact);
        let order = f64::from(method.facts().order_nonlinear);
        let slopes = slopes(&errors);
        assert!(
            close(&slopes, order, 0.1),
            "{method:?} {errors:?} {slopes:?}"
        );
    }
    let network = row(6, 8e4, 2e12, 0.02);
    let exact = finely(&network, FRAMES, &STRIKES);
    for (method, least) in [
        (MeshMethod::Ca, 1.7),
        (MeshMethod::Ca2p, 1.9),
        (MeshMethod::Bm4, 1.8),
        (MeshMethod::Ieq, 1.9),
    ] {
        let slopes = slopes(&errors(&network, method, &exact));
        assert!(
            slopes.iter().all(|slope| *slope > least),
            "{method:?} {slopes:?}"
        );
    }
}

/// Error of the pitch of one oscillator at 5 kHz, in cents.
#[test]
fn pitch_error_at_5_khz_by_method() {
    let expected = [38.440, -0.669, -0.0074, 38.440, -69.477];
    for (method, expected) in MeshMethod::ALL.into_iter().zip(expected) {
        let mut network = Network::new();
        let m = network.mas("m", 1e-3, 0.0, 0.0).expect("a mass");
        let ground = network.sol("s", 0.0).expect("a point");
        let omega = std::f64::consts::TAU * 5000.0;
        network
            .spring("l", ground, m, 1e-3 * omega * omega, 0.0, 0.0)
            .expect("a spring");
        let path = play(by(&network, method, 1), 2000, &[(0, m, 1e-4)]);
        // For a single sinusoid x[n+1] + x[n-1] is 2cosθ·x[n].
        let x: Vec<f64> = path.iter().map(|frame| frame[m]).collect();
        let (mut over, mut under) = (0.0, 0.0);
        for three in x.windows(3) {
            over += (three[0] + three[2]) * three[1];
            under += three[1] * three[1];
        }
        let theta = libm::acos(0.5 * over / under);
        let cents = 1200.0 * libm::log2(theta * HERTZ / omega);
        assert!((cents - expected).abs() < 1e-3, "{method:?} {cents}");
    }
}

/// Pitch error in cents and decay of one damped CEL, from the two-term recursion that its path obeys: CA has the CEL's
/// own poles, and BM4 its decay to rounding.
#[test]
fn poles_of_a_damped_cell_by_method() {
    for (method, limit) in [
        (MeshMethod::Ca, [1e-8, 1e-10]),
        (MeshMethod::Ca2p, [0.02, 1e-5]),
        (MeshMethod::Bm4, [2e-5, 1e-10]),
    ] {
        let mut network = Network::new();
        network.part("p", None);
        let (f, t60) = (1000.0, 0.05);
        let tie = Tie::Tuned { f, t60: Some(t60) };
        let m = network.cel("m", 1e-3, tie, 0.0, 0.0, 0.0).expect("a cell");
        let path = play(by(&network, method, 1), 200, &[(0, m, 1e-4)]);
        let x: Vec<f64> = path.iter().map(|frame| frame[m]).collect();
        // x[n+1] = a·x[n] − b·x[n−1], by least squares.
        let (mut aa, mut ab, mut bb, mut ya, mut yb) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for three in x.windows(3) {
            let (a, b, y) = (three[1], -three[0], three[2]);
            (aa, ab, bb) = (aa + a * a, ab + a * b, bb + b * b);
            (ya, yb) = (ya + y * a, yb + y * b);
        }
        let det = aa * bb - ab * ab;
        let (a, b) = ((ya * bb - yb * ab) / det, (yb * aa - ya * ab) / det);
        let theta = libm::acos(0.5 * a / libm::sqrt(b));
        let cents = 1200.0 * libm::log2(theta * HERTZ / (std::f64::consts::TAU * f));
        let decay = -0.5 * libm::log(b) * HERTZ * t60 / (3.0 * std::f64::consts::LN_10);
        assert!(cents.abs() < limit[0], "{method:?} {cents:e} cents");
        assert!((decay - 1.0).abs() < limit[1], "{method:?} {decay}");
    }
}

/// Velocities at a frame, compared with BM4 in small steps.
#[test]
fn velocities() {
    let network = row(8, 1.7e5, 0.0, 0.0);
    let mats: Vec<usize> = (0..8).collect();
    let result = |method: MeshMethod, substeps: u32| {
        let mut it = by(&network, method, substeps);
        for frame in 0..40 {
            let strikes = STRIKES.iter().filter(|strike| strike.0 == frame);
            let now: Vec<_> = strikes.map(|strike| (strike.1, strike.2)).collect();
            it.step(&now, &mut ThreadTeam::alone());
        }
        let mut v = vec![0.0; 8];
        it.velocities(&mats, &mut v);
        vec![v]
    };
    let truth = result(MeshMethod::Bm4, 64);
    for (method, order) in MeshMethod::ALL.into_iter().zip([2.0, 3.0, 4.0, 2.0, 2.0]) {
        let errors = [1, 2, 4, 8].map(|substeps| decibels(&result(method, substeps), &truth));
        let slopes = slopes(&errors);
        assert!(
            close(&slopes, order, 0.25),
            "{method:?} {errors:?} {slopes:?}"
        );
    }
}
