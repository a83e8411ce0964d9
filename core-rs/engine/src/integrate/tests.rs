use std::sync::Arc;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};

use super::*;
use crate::generator::{Rim, Shape, plate};
use crate::law::Law;

mod bytes;
mod contacts;
mod energy;
mod gong;
mod guard;
mod loops;
mod orders;
mod references;
mod words;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const HERTZ: f64 = 44_100.0;

fn rate() -> Rate {
    Rate::new(HERTZ).expect("a rate")
}

/// An integrator of a network by method `way`, at 44.1 kHz.
fn by(network: &Network, way: MeshMethod, substeps: u32) -> Integrator {
    Integrator::new(network, rate(), way, substeps).expect("an integrator")
}

/// Masses of 1 g in a row between two fixed points, joined by k·e + q·e³ and z; they start displaced and moving.
fn row(n: usize, k: f64, q: f64, z: f64) -> Network {
    let mut network = Network::new();
    network.part("row", None);
    for i in 0..n {
        let (x0, v0) = (1e-4 * ((i * i) as f64 % 3.0 - 1.0), 0.3 * ((i % 4) as f64 - 1.0));
        network.mas(&format!("m{i}"), 1e-3, x0, v0).expect("a mass");
    }
    let left_end = network.sol("left", 0.0).expect("a point");
    let right_end = network.sol("right", 0.0).expect("a point");
    let hardening_law = Arc::new(Law::hardening(k, q, z).expect("a law"));
    let mut join_links = |name: String, a: usize, b: usize| {
        if q == 0.0 {
            network.spring(&name, a, b, k, z, 0.0).expect("a spring");
        } else {
            network.lnl(&name, a, b, hardening_law.clone(), 0.0).expect("a link");
        }
    };
    join_links("first".to_owned(), left_end, 0);
    for i in 1..n {
        join_links(format!("l{i}"), i - 1, i);
    }
    join_links("last".to_owned(), n - 1, right_end);
    network
}

/// A hexagonal gong of 331 masses, 1 kg, lowest mode at 500 Hz, with links that harden.
fn hex(hardening: f64, t60: Option<f64>) -> Network {
    hex_of(10, 500.0, hardening, t60)
}

/// The same with `radius` rings and its lowest mode at `f` [Hz].
fn hex_of(radius: usize, f: f64, hardening: f64, t60: Option<f64>) -> Network {
    let mut network = Network::new();
    network.part("gong", None);
    let topology = plate(Shape::Hex, radius, Rim::Fixed).expect("a plate");
    network.mesh("", &topology, 1.0, f, t60, hardening).expect("a mesh");
    network
}

/// Positions of all MATs over some frames; `strikes`: (frame, MAT, impulse). Ends early if positions leave the valid
/// range.
fn play(mut it: Integrator, frames: usize, strikes: &[(usize, usize, f64)]) -> Vec<Vec<f64>> {
    let mut position_frames = Vec::with_capacity(frames);
    for n in 0..frames {
        let frame_strikes: Vec<(usize, f64)> = strikes
            .iter()
            .filter(|strike| strike.0 == n)
            .map(|strike| (strike.1, strike.2))
            .collect();
        it.step(&frame_strikes, &mut ThreadTeam::alone());
        if !it.is_bounded() {
            break;
        }
        position_frames.push(it.positions().to_vec());
    }
    position_frames
}

/// 20·log10(‖y − x‖/‖x‖) over all MATs and the frames of `x`; +∞ if `y` ended early.
fn error_db(y: &[Vec<f64>], x: &[Vec<f64>]) -> f64 {
    if y.len() < x.len() {
        return f64::INFINITY;
    }
    let (mut error_energy, mut signal_energy) = (0.0, 0.0);
    for (y, x) in y.iter().zip(x) {
        for (y, x) in y.iter().zip(x) {
            error_energy += (y - x) * (y - x);
            signal_energy += x * x;
        }
    }
    10.0 * crate::maths::log10(error_energy / signal_energy)
}

/// Order of convergence between successive doublings of the rate, from errors in decibels.
fn slopes(errors: &[f64]) -> Vec<f64> {
    let doubling_db = 20.0 * crate::maths::log10(2.0);
    errors
        .windows(2)
        .map(|pair| (pair[0] - pair[1]) / doubling_db)
        .collect()
}
