//! A body seen whole: where every one of its MATs is, by the amplitudes of its modes, and the other way.

use super::modes::{Modes, Row};
use crate::network::Network;
use crate::scheme::moves;
use crate::units::Rate;

/// Every mass of a body and every mode that is computed of it.
#[derive(Clone, Debug)]
pub(crate) struct Seen {
    /// Its MATs that move, by their index in the body's network   (n)
    pub(crate) mats: Vec<usize>,
    /// How much each sees of each mode   (n, n_modes)
    shapes: Vec<f64>,
    n_modes: usize,
    mass: Vec<f64>,
    rest: Vec<f64>,
}

impl Seen {
    /// Of a body by itself, some of its modes. Takes as long as its whole spectrum, and longer. `None` where it has none.
    pub(crate) fn new(network: &Network, kept: &[u32], rate: Rate) -> Option<Self> {
        let kinds = network.mats().kind.iter().enumerate();
        let mats: Vec<usize> = kinds
            .filter(|(_, kind)| moves(**kind))
            .map(|(mat, _)| mat)
            .collect();
        let rows: Vec<Row> = mats.iter().map(|&mat| vec![(mat, 1.0)]).collect();
        let modes = Modes::new(network, &rows, rate).ok()?;
        let n = modes.len();
        if kept.iter().any(|&mode| mode as usize >= n) {
            return None;
        }
        let rest = |shape: &Vec<f64>| shape.iter().zip(&modes.rest).map(|(a, b)| a * b).sum();
        let some = |shape: &Vec<f64>| {
            kept.iter()
                .map(|&mode| shape[mode as usize])
                .collect::<Vec<_>>()
        };
        Some(Self {
            shapes: modes.shapes.iter().flat_map(some).collect(),
            rest: modes.shapes.iter().map(rest).collect(),
            mass: mats.iter().map(|&mat| network.mats().m[mat]).collect(),
            n_modes: kept.len(),
            mats,
        })
    }

    /// Where its MATs are and by what step they came there [m], from amplitudes now and one frame before.
    pub(crate) fn positions(&self, now: &[f64], before: &[f64], mats: &mut [(f64, f64)]) {
        let rows = self.shapes.chunks(self.n_modes.max(1)).zip(&self.rest);
        for (mat, (row, rest)) in mats.iter_mut().zip(rows) {
            let mut sum = [0.0; 2];
            for ((share, now), before) in row.iter().zip(now).zip(before) {
                sum[0] += share * now;
                sum[1] += share * (now - before);
            }
            *mat = (sum[0] + rest, sum[1]);
        }
    }

    /// The amplitudes now and one frame before, from where its MATs are and their steps [m].
    pub(crate) fn amplitudes(&self, mats: &[(f64, f64)], now: &mut [f64], before: &mut [f64]) {
        now.fill(0.0);
        before.fill(0.0);
        let rows = self
            .shapes
            .chunks(self.n_modes.max(1))
            .zip(self.rest.iter().zip(&self.mass));
        for (&(x, step), (row, (rest, mass))) in mats.iter().zip(rows) {
            let (x, was) = (mass * (x - rest), mass * (x - step - rest));
            for ((share, now), before) in row.iter().zip(&mut *now).zip(&mut *before) {
                *now += share * x;
                *before += share * was;
            }
        }
    }

    /// How many modes are computed.
    pub(crate) fn n_modes(&self) -> usize {
        self.n_modes
    }
}
