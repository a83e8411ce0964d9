//! Reference motions: known in closed form, or computed without code of the methods.

use nalgebra::{DMatrix, DVector};

use super::*;
use crate::network::{LinkKind, MatKind};

/// Motion of a linear network whose rest positions are all 0, by the matrix exponential.
pub(super) fn exactly(
    network: &Network,
    frames: usize,
    strikes: &[(usize, usize, f64)],
) -> Vec<Vec<f64>> {
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

/// Classical Runge-Kutta in small steps, link by link: a reference that shares no code with the methods.
pub(super) fn finely(
    network: &Network,
    frames: usize,
    strikes: &[(usize, usize, f64)],
) -> Vec<Vec<f64>> {
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
                let position: Vec<f64> = y.iter().zip(&k).map(|(y, k)| y + ahead * h * k).collect();
                k = slope(&position);
                sum.iter_mut()
                    .zip(&k)
                    .for_each(|(sum, k)| *sum += weight * k);
            }
            y.iter_mut()
                .zip(&sum)
                .for_each(|(y, sum)| *y += h / 6.0 * sum);
        }
        path.push(y[..n].to_vec());
    }
    path
}

/// The same with other rest positions: they only shift the equilibrium.
pub(super) fn exactly_hung(
    network: &Network,
    frames: usize,
    strikes: &[(usize, usize, f64)],
) -> Vec<Vec<f64>> {
    let (n, mats) = (network.n_mat(), network.mats());
    // At equilibrium, K·x equals the forces of the rest positions.
    let mut stiffness = DMatrix::<f64>::zeros(n, n);
    let mut pull = DVector::<f64>::zeros(n);
    for i in 0..n {
        match mats.kind[i] {
            MatKind::Cel => {
                stiffness[(i, i)] += mats.k[i];
                pull[i] += mats.k[i] * mats.rest[i];
            }
            MatKind::Sol | MatKind::Imposed => stiffness[(i, i)] = 1e30,
            MatKind::Mas | MatKind::Proxy => {}
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
        shifted
            .start(i, mats.x0[i] - still[i], mats.v0[i])
            .expect("a start");
    }
    let mut path = exactly(&shifted, frames, strikes);
    for x in path
        .iter_mut()
        .flat_map(|frame| frame.iter_mut().zip(&still))
    {
        *x.0 += x.1;
    }
    path
}
