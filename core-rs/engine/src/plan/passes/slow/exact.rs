//! Linear springs of a slow body: the exact flow of its masses over R frames.

use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::DMatrix;

use super::{Solution, free, is_within};
use crate::integrate::flow::{Flow, frame};
use crate::integrate::square::Square;
use crate::interrupt;
use crate::island::slow::{Slow, Springs};
use crate::maths;
use crate::network::Subset;
use crate::plan::constants::{FLOW_EXACT_MAX, FLOW_MASSES_MAX, LOOSE};
use crate::plan::passes::wiring::Body;
use crate::scheme::Scheme;
use crate::units::Rate;

/// A body of linear springs, or why it has no flow; `is_struck`: whether a MAT of the island may be struck.
pub(super) fn slow(
    rate: Rate,
    (part, every): (usize, u32),
    body: &Body,
    subset: Subset,
    is_struck: impl Fn(usize) -> bool,
) -> Result<Slow, String> {
    let n = body.mats.len();
    if n > FLOW_MASSES_MAX {
        return Err(format!(
            "{n} of its masses are connected; above {FLOW_MASSES_MAX}, a slow rate costs more than the audio rate"
        ));
    }
    let is_discrete = subset.network.parts()[part].ca_rate.is_some();
    let scheme = if is_discrete {
        Scheme::new(&subset.network, rate)
    } else {
        Scheme::physical(&subset.network, rate)
    };
    let scheme = scheme.map_err(|error| error.to_string())?;
    let matrices = Matrices::new(&subset, &scheme, body);
    let modes = matrices.modes();
    let top = modes.eigenvalues.iter().fold(0.0_f64, |top, x| top.max(*x));
    let kick_every = if n <= FLOW_EXACT_MAX { 1 } else { every };
    let turn = f64::from(kick_every)
        * if is_discrete {
            2.0 * maths::asin((0.5 * top.sqrt()).min(1.0))
        } else {
            top.sqrt()
        };
    let too_fast = || {
        let hertz = turn / f64::from(kick_every) * rate.hertz() / (2.0 * PI);
        format!("its highest mode is at {hertz:.0} Hz, too high for that rate")
    };
    if !is_within(turn) {
        return Err(too_fast());
    }
    let frame = frame(&matrices.k, &matrices.z, is_discrete);
    let flow = Flow::new(&frame, kick_every).ok_or_else(too_fast)?;
    let solution = Solution {
        springs: Springs::Exact(Arc::new(flow.clone())),
        turn,
        kick_every,
        rest: matrices.rest(&modes.eigenvalues, &modes.eigenvectors),
        free: matrices.free,
        w: matrices.w,
        is_discrete,
    };
    let mut slow = solution.slow(rate, (part, every), body, subset)?;
    let missing = |&(local, mat): &(usize, usize)| {
        if is_struck(mat) {
            missing_response(&flow, &frame, local, is_discrete)
        } else {
            Vec::new()
        }
    };
    slow.missing = slow.ports.iter().map(missing).collect();
    Ok(slow)
}

/// For pushes at each frame between two kicks: the part of their effect that is still missing at the end.
fn missing_response(
    flow: &Flow,
    frame: &Square,
    port: usize,
    is_discrete: bool,
) -> Vec<[Vec<f64>; 2]> {
    let n = flow.keep.n;
    let mut moved = vec![0.0; 2 * n];
    moved[n + port] = 1.0;
    // State one frame after a push: in a CA network only the pushed mass has moved; continuous motion follows the flow
    // of a frame.
    if is_discrete {
        moved[port] = 1.0;
    } else {
        moved = frame.apply(&moved);
    }
    let mut responses = Vec::new();
    for frames in 1..=flow.macrostep {
        interrupt::poll();
        responses.push(flow.missing(port, frames, &moved));
        moved = frame.apply(&moved);
    }
    responses.reverse();
    responses
}

/// Springs and dampers of the body as matrices, in units of a frame.
struct Matrices {
    /// MATs that move, by their index in the subset.
    free: Vec<usize>,
    w: Vec<f64>,
    /// M⁻¹K and M⁻¹Z   (n, n)
    k: Square,
    z: Square,
    /// Force where all are at 0 [N]   (n)
    force: Vec<f64>,
}

impl Matrices {
    fn new(subset: &Subset, scheme: &Scheme, body: &Body) -> Self {
        let mats = subset.network.mats();
        let free = free(body, subset);
        let n = free.len();
        let slot = |mat: usize| free.binary_search(&mat).ok();
        let w: Vec<f64> = free.iter().map(|&i| scheme.w[i]).collect();
        let (mut k, mut z, mut force) = (Square::zero(n), Square::zero(n), vec![0.0; n]);
        for (local, &i) in free.iter().enumerate() {
            *k.entry(local, local) += scheme.kappa[i];
            *z.entry(local, local) += scheme.zeta[i];
            force[local] += scheme.kappa[i] / w[local] * scheme.rest[i];
        }
        for run in &scheme.runs {
            for i in 0..run.len {
                let pair = [(run.a + i, run.b + i, 1.0), (run.b + i, run.a + i, -1.0)];
                for (local, other, sign) in pair {
                    let Some(row) = slot(local) else { continue };
                    *k.entry(row, row) += w[row] * run.k;
                    *z.entry(row, row) += w[row] * run.z;
                    force[row] -= sign * run.k * run.rest;
                    match slot(other) {
                        Some(column) => {
                            *k.entry(row, column) -= w[row] * run.k;
                            *z.entry(row, column) -= w[row] * run.z;
                        }
                        None => force[row] += run.k * mats.x0[other],
                    }
                }
            }
        }
        Self {
            free,
            w,
            k,
            z,
            force,
        }
    }

    /// Modes of M^-½ K M^-½.
    fn modes(&self) -> nalgebra::SymmetricEigen<f64, nalgebra::Dyn> {
        let n = self.w.len();
        let root: Vec<f64> = self.w.iter().map(|w| w.sqrt()).collect();
        let entry = |row: usize, column: usize| self.k.get(row, column) * root[column] / root[row];
        // Rounding makes the matrix slightly unsymmetric.
        let even = |row, column| 0.5 * (entry(row, column) + entry(column, row));
        DMatrix::from_fn(n, n, even).symmetric_eigen()
    }

    /// The equilibrium of the springs: K·x = force, and x = 0 along modes that nothing holds.
    fn rest(&self, values: &nalgebra::DVector<f64>, vectors: &DMatrix<f64>) -> Vec<f64> {
        let n = self.w.len();
        let mut rest = vec![0.0; n];
        if self.force.iter().all(|force| *force == 0.0) {
            return rest;
        }
        let root: Vec<f64> = self.w.iter().map(|w| w.sqrt()).collect();
        let top = values.iter().fold(0.0_f64, |top, x| top.max(*x));
        for (mode, &value) in values
            .iter()
            .enumerate()
            .filter(|(_, value)| **value > LOOSE * top)
        {
            let share: f64 = (0..n)
                .map(|i| vectors[(i, mode)] * root[i] * self.force[i])
                .sum();
            for (i, rest) in rest.iter_mut().enumerate() {
                *rest += vectors[(i, mode)] * root[i] * (share / value);
            }
        }
        rest
    }
}
