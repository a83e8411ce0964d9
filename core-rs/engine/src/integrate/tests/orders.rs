//! Orders of convergence, against motions that are known.

use super::*;
use crate::network::{LinkKind, MatKind, Tie};
use nalgebra::{DMatrix, DVector};

const STRIKES: [(usize, usize, f64); 2] = [(0, 2, 4e-4), (7, 5, -3e-4)];
const FRAMES: usize = 120;

/// Motion of a linear network by the matrix exponential.
fn exactly(network: &Network, frames: usize, strikes: &[(usize, usize, f64)]) -> Vec<Vec<f64>> {
    let (n, mats, t) = (network.n_mat(), network.mats(), rate().step());
    let mut a = DMatrix::zeros(2 * n, 2 * n);
    let moves = |i: usize| matches!(mats.kind[i], MatKind::Mas | MatKind::Cel);
    for i in (0..n).filter(|&i| moves(i)) {
        a[(i, n + i)] = 1.0;
        if mats.kind[i] == MatKind::Cel {
            a[(n + i, i)] -= mats.k[i] / mats.m[i];
            a[(n + i, n + i)] -= mats.z[i] / mats.m[i];
        }
    }
    for run in network.runs() {
        for i in 0..run.len {
            for (to, from) in [(run.a + i, run.b + i), (run.b + i, run.a + i)] {
                if moves(to) {
                    for (first, c) in [(0, run.k), (n, run.z)] {
                        a[(n + to, first + to)] -= c / mats.m[to];
                        a[(n + to, first + from)] += c / mats.m[to];
                    }
                }
            }
        }
    }
    let step = (a * t).exp();
    let mut y = DVector::zeros(2 * n);
    for i in 0..n {
        y[i] = mats.x0[i];
        y[n + i] = mats.v0[i];
    }
    (0..frames)
        .map(|frame| {
            for strike in strikes.iter().filter(|strike| strike.0 == frame) {
                y[n + strike.1] += strike.2 / mats.m[strike.1];
            }
            y = &step * &y;
            y.rows(0, n).iter().copied().collect()
        })
        .collect()
}

/// Classical Runge-Kutta in small steps, link by link: a reference that shares nothing with the methods.
fn finely(network: &Network, frames: usize, strikes: &[(usize, usize, f64)]) -> Vec<Vec<f64>> {
    const FINE: usize = 192;
    let (n, mats) = (network.n_mat(), network.mats());
    let h = rate().step() / FINE as f64;
    let slope = |y: &[f64]| -> Vec<f64> {
        let mut slope = vec![0.0; 2 * n];
        slope[..n].copy_from_slice(&y[n..]);
        for run in network.runs() {
            let LinkKind::Lnl(law) = &run.kind else {
                panic!("a row of laws");
            };
            for i in 0..run.len {
                let (a, b) = (run.a + i, run.b + i);
                let f = law.force(y[b] - y[a] - run.rest, y[n + b] - y[n + a]);
                for (end, f) in [(a, f), (b, -f)] {
                    if mats.kind[end] == MatKind::Mas {
                        slope[n + end] += f / mats.m[end];
                    }
                }
            }
        }
        slope
    };
    let mut y: Vec<f64> = mats.x0.iter().chain(&mats.v0).copied().collect();
    let mut path = Vec::new();
    for frame in 0..frames {
        for strike in strikes.iter().filter(|strike| strike.0 == frame) {
            y[n + strike.1] += strike.2 / mats.m[strike.1];
        }
        for _ in 0..FINE {
            let mut k = vec![0.0; 2 * n];
            let mut sum = vec![0.0; 2 * n];
            for (ahead, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
                let at: Vec<f64> = y.iter().zip(&k).map(|(y, k)| y + ahead * h * k).collect();
                k = slope(&at);
                sum.iter_mut().zip(&k).for_each(|(sum, k)| *sum += weight * k);
            }
            y.iter_mut().zip(&sum).for_each(|(y, sum)| *y += h / 6.0 * sum);
        }
        path.push(y[..n].to_vec());
    }
    path
}

fn errors(network: &Network, way: Way, exact: &[Vec<f64>]) -> Vec<f64> {
    [1, 2, 4, 8]
        .map(|substeps| decibels(&play(by(network, way, substeps), FRAMES, &STRIKES), exact))
        .to_vec()
}

fn close(slopes: &[f64], order: f64, off: f64) -> bool {
    slopes.iter().all(|slope| (slope - order).abs() < off)
}

/// Struck, moved from the start, undamped: ωT up to 0.6.
#[test]
fn an_undamped_row_converges_by_each_order() {
    let mut network = row(8, 1.7e5, 0.0, 0.0);
    let tie = Tie::Physical { k: 4e4, z: 0.0 };
    let cell = network.cel("cell", 2e-3, tie, 1e-5, 0.0, 0.2).expect("a cell");
    network.spring("end", 3, cell, 1e5, 0.0, 2e-5).expect("a spring");
    let exact = reference_with_rests(&network);
    for way in Way::ALL {
        let errors = errors(&network, way, &exact);
        let slopes = slopes(&errors);
        eprintln!("undamped {way:?} {errors:.1?} {slopes:.2?}");
        assert!(close(&slopes, f64::from(way.facts().order), 0.15), "{way:?} {slopes:?}");
    }
}

/// The exponential has no place for rests: they only shift where the masses hang.
fn reference_with_rests(network: &Network) -> Vec<Vec<f64>> {
    let (n, mats) = (network.n_mat(), network.mats());
    // Hanging still: K·x = forces at x = 0.
    let mut stiffness = DMatrix::<f64>::zeros(n, n);
    let mut pull = DVector::<f64>::zeros(n);
    for i in 0..n {
        match mats.kind[i] {
            MatKind::Cel => {
                stiffness[(i, i)] += mats.k[i];
                pull[i] += mats.k[i] * mats.rest[i];
            }
            MatKind::Sol | MatKind::Imposed => stiffness[(i, i)] = 1e30,
            MatKind::Mas => {}
        }
    }
    for run in network.runs() {
        for i in 0..run.len {
            let (a, b) = (run.a + i, run.b + i);
            for (end, other, sign) in [(a, b, -1.0), (b, a, 1.0)] {
                stiffness[(end, end)] += run.k;
                stiffness[(end, other)] -= run.k;
                pull[end] += sign * run.k * run.rest;
            }
        }
    }
    let still = stiffness.lu().solve(&pull).expect("a place to hang");
    let mut shifted = network.clone();
    for i in 0..n {
        shifted.start(i, mats.x0[i] - still[i], mats.v0[i]).expect("a start");
    }
    let mut path = exactly(&shifted, FRAMES, &STRIKES);
    for x in path.iter_mut().flat_map(|frame| frame.iter_mut().zip(&still)) {
        *x.0 += x.1;
    }
    path
}

/// Link damping (T60 of the lowest mode some 0.1 s): CA falls to order 1 by what it is, CA2P to 2.
#[test]
fn with_damped_links() {
    let network = row(8, 1.7e5, 0.0, 0.05);
    let exact = exactly(&network, FRAMES, &STRIKES);
    for way in Way::ALL {
        let errors = errors(&network, way, &exact);
        let slopes = slopes(&errors);
        eprintln!("damped {way:?} {errors:.1?} {slopes:.2?}");
    }
}

/// Cubic links, whose tangent stiffness more than doubles.
#[test]
fn cubic_links() {
    for z in [0.0, 0.02] {
        let network = row(6, 8e4, 2e12, z);
        let exact = finely(&network, FRAMES, &STRIKES);
        for way in [Way::Ca, Way::Ca2p, Way::Bm4, Way::Ieq] {
            let errors = errors(&network, way, &exact);
            let slopes = slopes(&errors);
            eprintln!("cubic z={z} {way:?} {errors:.1?} {slopes:.2?}");
        }
    }
}

/// One cell of 5 kHz: cents off by each way, from the phase after 2000 frames.
#[test]
fn pitch_at_5_khz() {
    for way in Way::ALL {
        let mut network = Network::new();
        let m = network.mas("m", 1e-3, 0.0, 0.0).expect("a mass");
        let ground = network.sol("s", 0.0).expect("a point");
        let omega = std::f64::consts::TAU * 5000.0;
        network
            .spring("l", ground, m, 1e-3 * omega * omega, 0.0, 0.0)
            .expect("a spring");
        let path = play(by(&network, way, 1), 2000, &[(0, m, 1e-4)]);
        // x[n+1] + x[n-1] = 2cosθ·x[n] for any one sinusoid.
        let x: Vec<f64> = path.iter().map(|frame| frame[m]).collect();
        let (mut over, mut under) = (0.0, 0.0);
        for three in x.windows(3) {
            over += (three[0] + three[2]) * three[1];
            under += three[1] * three[1];
        }
        let theta = libm::acos(0.5 * over / under);
        let cents = 1200.0 * libm::log2(theta * HERTZ / omega);
        eprintln!("pitch {way:?} {cents:.4} cents");
    }
}

/// Velocities at a frame are of the method's order.
#[test]
fn velocities() {
    for (z, what) in [(0.0, "undamped"), (0.05, "damped")] {
        let network = row(8, 1.7e5, 0.0, z);
        let (n, h) = (network.n_mat(), 1e-3);
        let exact = exactly(&network, FRAMES, &STRIKES);
        // The velocity of the exact motion: by the exponential of a start from the frame before.
        let _ = (n, h);
        for way in Way::ALL {
            let mut errors = Vec::new();
            for substeps in [1, 2, 4, 8] {
                let mut it = by(&network, way, substeps);
                for frame in 0..40 {
                    let now: Vec<_> = STRIKES
                        .iter()
                        .filter(|strike| strike.0 == frame)
                        .map(|strike| (strike.1, strike.2))
                        .collect();
                    it.step(&now);
                }
                let mats: Vec<usize> = (0..8).collect();
                let mut v = [0.0; 8];
                it.velocities(&mats, &mut v);
                // Sixth-order differences of the exact path are not exact enough; go by BM4 at 64.
                let mut fine = by(&network, Way::Bm4, 64);
                for frame in 0..40 {
                    let now: Vec<_> = STRIKES
                        .iter()
                        .filter(|strike| strike.0 == frame)
                        .map(|strike| (strike.1, strike.2))
                        .collect();
                    fine.step(&now);
                }
                let mut truth = [0.0; 8];
                fine.velocities(&mats, &mut truth);
                errors.push(decibels(&[v.to_vec()], &[truth.to_vec()]));
            }
            eprintln!("velocity {what} {way:?} {errors:.1?} {:.2?}", slopes(&errors));
        }
        let _ = exact;
    }
}
