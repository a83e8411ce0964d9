//! Orders of convergence, against motions that are known.

use super::references::{exactly, exactly_hung, finely};
use super::*;
use crate::network::Tie;

const STRIKES: [(usize, usize, f64); 2] = [(0, 2, 4e-4), (7, 5, -3e-4)];
const FRAMES: usize = 120;

/// Errors at 1, 2, 4 and 8 steps a frame [dB].
fn errors(network: &Network, method: MeshMethod, exact: &[Vec<f64>]) -> Vec<f64> {
    [1, 2, 4, 8]
        .map(|substeps| error_db(&play(by(network, method, substeps), FRAMES, &STRIKES), exact))
        .to_vec()
}

fn close(slopes: &[f64], order: f64, off: f64) -> bool {
    slopes.iter().all(|slope| (slope - order).abs() < off)
}

/// Struck, moving from the start, and coupled to a CEL with rest positions; ωT up to 0.6.
#[test]
fn undamped_row_converges_by_order_of_method() {
    let mut network = row(8, 1.7e5, 0.0, 0.0);
    let ground_tie = Tie::Physical { k: 4e4, z: 0.0 };
    let hung_cell = network.cel("cell", 2e-3, ground_tie, 1e-5, 0.0, 0.2).expect("a cell");
    network.spring("end", 3, hung_cell, 1e5, 0.0, 2e-5).expect("a spring");
    let exact_path = exactly_hung(&network, FRAMES, &STRIKES);
    // Errors at one step a frame: -10.7, -51.0, -90.3, -10.7 and -5.5 dB.
    let error_limit = [-10.0, -50.0, -89.0, -10.0, -5.0];
    for (method, error_limit) in MeshMethod::ALL.into_iter().zip(error_limit) {
        let errors = errors(&network, method, &exact_path);
        assert!(errors[0] < error_limit, "{method:?} {errors:?}");
        let (slopes, method_order) = (slopes(&errors), f64::from(method.properties().order));
        assert!(close(&slopes, method_order, 0.15), "{method:?} {slopes:?}");
    }
}

/// Damped links: CA takes damping from the last step, an error of order 1 that shows once the error of the pitch is
/// small. CA2P falls from order 4 to 2. BM4 does too, because of its midpoint rule for losses, but only at smaller
/// steps.
#[test]
fn damped_links_reduce_orders_of_methods() {
    let network = row(8, 1.7e5, 0.0, 0.05);
    let exact_path = exactly(&network, FRAMES, &STRIKES);
    let errors_by_method = |network: &Network, exact_path: &[Vec<f64>]| {
        MeshMethod::ALL.map(|method| {
            (
                errors(network, method, exact_path)[0],
                slopes(&errors(network, method, exact_path)),
            )
        })
    };
    let [ca, ca2p, bm4, ieq] = errors_by_method(&network, &exact_path);
    assert!(ca.1[0] > 1.8 && ca.1[2] < 1.75, "{ca:?}");
    assert!(ca2p.0 < -51.0 && ca2p.1[0] > 3.7 && ca2p.1[2] < 3.4, "{ca2p:?}");
    assert!(bm4.0 < -91.0 && bm4.1[0] > 3.5 && bm4.1[2] < 2.6, "{bm4:?}");
    assert!(close(&ieq.1, 2.0, 0.15), "{ieq:?}");
    // Ten times the damping: the slopes reach their lower limits.
    let network = row(8, 1.7e5, 0.0, 0.5);
    let exact_path = exactly(&network, FRAMES, &STRIKES);
    let [ca, ca2p, bm4, ..] = errors_by_method(&network, &exact_path);
    assert!(ca.1[2] < 1.25 && ca2p.1[2] < 2.4, "{ca:?} {ca2p:?}");
    assert!(bm4.0 < -77.0 && close(&bm4.1, 2.0, 0.15), "{bm4:?}");
}

/// Cubic links, whose tangent stiffness doubles: CA2P is of order 2, and BM4 alone of order 4.
#[test]
fn cubic_links_converge_by_order_of_method() {
    let network = row(6, 8e4, 2e12, 0.0);
    let exact_path = finely(&network, FRAMES, &STRIKES);
    for method in [MeshMethod::Ca, MeshMethod::Ca2p, MeshMethod::Bm4, MeshMethod::Ieq] {
        let errors = errors(&network, method, &exact_path);
        let method_order = f64::from(method.properties().order_nonlinear);
        let slopes = slopes(&errors);
        assert!(close(&slopes, method_order, 0.1), "{method:?} {errors:?} {slopes:?}");
    }
    let network = row(6, 8e4, 2e12, 0.02);
    let exact_path = finely(&network, FRAMES, &STRIKES);
    for (method, least) in [
        (MeshMethod::Ca, 1.7),
        (MeshMethod::Ca2p, 1.9),
        (MeshMethod::Bm4, 1.8),
        (MeshMethod::Ieq, 1.9),
    ] {
        let slopes = slopes(&errors(&network, method, &exact_path));
        assert!(slopes.iter().all(|slope| *slope > least), "{method:?} {slopes:?}");
    }
}

/// Error of the pitch of one oscillator at 5 kHz, in cents.
#[test]
fn pitch_error_at_5_khz_by_method() {
    let expected = [38.440, -0.669, -0.0074, 38.440, -69.477];
    for (method, expected) in MeshMethod::ALL.into_iter().zip(expected) {
        let mut network = Network::new();
        let mass_index = network.mas("m", 1e-3, 0.0, 0.0).expect("a mass");
        let fixed_point = network.sol("s", 0.0).expect("a point");
        let cell_omega = std::f64::consts::TAU * 5000.0;
        network
            .spring("l", fixed_point, mass_index, 1e-3 * cell_omega * cell_omega, 0.0, 0.0)
            .expect("a spring");
        let mass_path = play(by(&network, method, 1), 2000, &[(0, mass_index, 1e-4)]);
        // For a single sinusoid x[n+1] + x[n-1] is 2cosθ·x[n].
        let x: Vec<f64> = mass_path.iter().map(|frame| frame[mass_index]).collect();
        let (mut cross_sum, mut square_sum) = (0.0, 0.0);
        for three in x.windows(3) {
            cross_sum += (three[0] + three[2]) * three[1];
            square_sum += three[1] * three[1];
        }
        let step_angle = libm::acos(0.5 * cross_sum / square_sum);
        let pitch_cents = 1200.0 * libm::log2(step_angle * HERTZ / cell_omega);
        assert!((pitch_cents - expected).abs() < 1e-3, "{method:?} {pitch_cents}");
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
        let tuned_tie = Tie::Tuned { f, t60: Some(t60) };
        let cell_index = network.cel("m", 1e-3, tuned_tie, 0.0, 0.0, 0.0).expect("a cell");
        let cell_path = play(by(&network, method, 1), 200, &[(0, cell_index, 1e-4)]);
        let x: Vec<f64> = cell_path.iter().map(|frame| frame[cell_index]).collect();
        // x[n+1] = a·x[n] − b·x[n−1], by least squares.
        let (mut aa, mut ab, mut bb, mut ya, mut yb) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for three in x.windows(3) {
            let (a, b, y) = (three[1], -three[0], three[2]);
            (aa, ab, bb) = (aa + a * a, ab + a * b, bb + b * b);
            (ya, yb) = (ya + y * a, yb + y * b);
        }
        let determinant = aa * bb - ab * ab;
        let (a, b) = ((ya * bb - yb * ab) / determinant, (yb * aa - ya * ab) / determinant);
        let step_angle = libm::acos(0.5 * a / libm::sqrt(b));
        let pitch_cents = 1200.0 * libm::log2(step_angle * HERTZ / (std::f64::consts::TAU * f));
        let decay_ratio = -0.5 * libm::log(b) * HERTZ * t60 / (3.0 * std::f64::consts::LN_10);
        assert!(pitch_cents.abs() < limit[0], "{method:?} {pitch_cents:e} cents");
        assert!((decay_ratio - 1.0).abs() < limit[1], "{method:?} {decay_ratio}");
    }
}

/// Velocities at a frame, compared with BM4 in small steps.
#[test]
fn velocities() {
    let network = row(8, 1.7e5, 0.0, 0.0);
    let row_mats: Vec<usize> = (0..8).collect();
    let final_velocities = |method: MeshMethod, substeps: u32| {
        let mut integrator = by(&network, method, substeps);
        for frame in 0..40 {
            let strikes = STRIKES.iter().filter(|strike| strike.0 == frame);
            let frame_strikes: Vec<_> = strikes.map(|strike| (strike.1, strike.2)).collect();
            integrator.step(&frame_strikes, &mut ThreadTeam::alone());
        }
        let mut velocity_row = vec![0.0; 8];
        integrator.velocities(&row_mats, &mut velocity_row);
        vec![velocity_row]
    };
    let fine_velocities = final_velocities(MeshMethod::Bm4, 64);
    for (method, order) in MeshMethod::ALL.into_iter().zip([2.0, 3.0, 4.0, 2.0, 2.0]) {
        let errors = [1, 2, 4, 8].map(|substeps| error_db(&final_velocities(method, substeps), &fine_velocities));
        let slopes = slopes(&errors);
        assert!(close(&slopes, order, 0.25), "{method:?} {errors:?} {slopes:?}");
    }
}
