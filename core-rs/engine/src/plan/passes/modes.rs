//! A linear body as its modes, seen from where it is struck and heard.

use crate::cell::{Cell, Ratios};
use crate::network::Network;
use crate::plan::constants::{ANGLE_MIN, PROBES, SAME};
use crate::plan::passes::linear::{Linear, NoModes};
use crate::plan::passes::viscosity::{Viscosity, probe};
use crate::spectrum::all_eigenvalues;
use crate::units::Rate;

/// A weighted sum of positions: (MAT, weight); MATs that do not move contribute nothing.
pub(crate) type Row = Vec<(usize, f64)>;

/// The modes of a body, each of mass 1.
#[derive(Debug)]
pub(crate) struct Modes {
    /// ω₀² [1/s²], or algorithmic   (n_modes), rising
    pub(crate) lambda: Vec<f64>,
    /// Z along the mode [1/s], or algorithmic   (n_modes)
    pub(crate) zeta: Vec<f64>,
    /// How much of each mode is in each row   (n_rows, n_modes)
    pub(crate) shapes: Vec<Vec<f64>>,
    /// Position of each mode at t = 0, its velocity, and its rest position   (n_modes)
    pub(crate) x0: Vec<f64>,
    pub(crate) v0: Vec<f64>,
    pub(crate) rest: Vec<f64>,
    pub(crate) is_discrete: bool,
}

impl Modes {
    /// The modes of a network that is one linear body; each row is a weighted sum of positions.
    pub(crate) fn new(network: &Network, rows: &[Row], rate: Rate) -> Result<Self, NoModes> {
        let linear = Linear::new(network, rate)?;
        if linear.proportion.is_none() && linear.viscosity.is_none() {
            return Err(NoModes::Damping);
        }
        let n = linear.free.len();
        let mats = network.mats();
        let slot = |mat: usize| linear.free.binary_search(&mat).ok();
        // A row becomes M^-½ e in modal coordinates, a motion M^½ x.
        let mut seen: Vec<Vec<f64>> = Vec::with_capacity(rows.len() + 3);
        for row in rows {
            let mut sum = vec![0.0; n];
            for &(mat, weight) in row {
                if let Some(local) = slot(mat) {
                    sum[local] += weight / linear.root[local];
                }
            }
            seen.push(sum);
        }
        let weighted = |value_of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            linear
                .free
                .iter()
                .enumerate()
                .map(|(local, &i)| value_of(local, i))
                .collect()
        };
        seen.push(weighted(&|local, i| linear.root[local] * mats.x0[i]));
        seen.push(weighted(&|local, i| linear.root[local] * mats.v0[i]));
        seen.push(weighted(&|local, _| {
            linear.force[local] / linear.root[local]
        }));
        if let Some(viscosity) = &linear.viscosity {
            let probes: Vec<Vec<f64>> = (0..PROBES).map(|which| probe(n, which)).collect();
            let images: Vec<Vec<f64>> = probes.iter().map(|probe| viscosity.times(probe)).collect();
            seen.extend(probes);
            seen.extend(images);
        }
        let (lambda, mut seen) =
            all_eigenvalues(linear.stiffness, &seen).ok_or(NoModes::NotFinite)?;
        let top = lambda.last().copied().unwrap_or(0.0);
        // A body that nothing holds has a mode at 0, up to rounding; a mode clearly below 0 grows.
        let least = 1e-13 * top * n as f64;
        if lambda.iter().any(|lambda| *lambda < -least) {
            return Err(NoModes::Diverges);
        }
        let loose = |lambda: f64| if lambda <= least { 0.0 } else { lambda };
        let lambda: Vec<f64> = lambda.into_iter().map(loose).collect();
        let zeta = match linear.proportion {
            Some([alpha, beta]) => lambda.iter().map(|lambda| alpha + beta * lambda).collect(),
            None => {
                let images = seen.split_off(seen.len() - PROBES);
                let probes = seen.split_off(seen.len() - PROBES);
                let mut zeta = Viscosity::mode_damping(&probes, &images).ok_or(NoModes::Damping)?;
                let zeta_max = zeta
                    .iter()
                    .fold(0.0_f64, |zeta_max, zeta| zeta_max.max(*zeta));
                for (zeta, lambda) in zeta.iter_mut().zip(&lambda) {
                    // A rigid mode that no damper acts on has no loss, up to rounding.
                    if *lambda == 0.0 && zeta.abs() <= SAME * zeta_max {
                        *zeta = 0.0;
                    }
                }
                zeta
            }
        };
        let force = seen.pop().unwrap_or_default();
        let v0 = seen.pop().unwrap_or_default();
        let x0 = seen.pop().unwrap_or_default();
        let rests = |(force, lambda): (f64, &f64)| if *lambda > 0.0 { force / lambda } else { 0.0 };
        let rest: Vec<f64> = force.into_iter().zip(&lambda).map(rests).collect();
        Ok(Self {
            lambda,
            zeta,
            shapes: seen,
            x0,
            v0,
            rest,
            is_discrete: linear.is_discrete,
        })
    }

    /// The same modes with some of the rows only.
    pub(in crate::plan) fn seen_by(&self, rows: &[usize]) -> Self {
        Self {
            lambda: self.lambda.clone(),
            zeta: self.zeta.clone(),
            shapes: rows.iter().map(|&row| self.shapes[row].clone()).collect(),
            x0: self.x0.clone(),
            v0: self.v0.clone(),
            rest: self.rest.clone(),
            is_discrete: self.is_discrete,
        }
    }

    /// Whether a mode is too slow for its recurrence, or diverges, as a mode of a discrete body may (Jury).
    pub(crate) fn unfit(&self, rate: Rate) -> Option<NoModes> {
        let ratios = (0..self.len()).map(|mode| self.ratios(mode, rate));
        for (Ratios { kappa, zeta }, lambda) in ratios.zip(&self.lambda) {
            // A rigid mode has no frequency that rounding could change.
            if kappa < ANGLE_MIN * ANGLE_MIN && *lambda != 0.0 {
                return Some(NoModes::Slow);
            }
            if self.is_discrete && kappa + 2.0 * zeta >= 4.0 {
                return Some(NoModes::Diverges);
            }
        }
        None
    }

    pub(crate) fn len(&self) -> usize {
        self.lambda.len()
    }

    /// Whether the body has a rigid mode that no spring holds.
    pub(crate) fn is_free(&self) -> bool {
        self.lambda.first() == Some(&0.0)
    }

    /// The continuous motion of a mode.
    pub(crate) fn cell(&self, mode: usize) -> Cell {
        Cell::new(1.0, self.lambda[mode], self.zeta[mode])
    }

    /// κ and ζ of a mode in discrete time.
    pub(crate) fn ratios(&self, mode: usize, rate: Rate) -> Ratios {
        if self.is_discrete {
            Ratios {
                kappa: self.lambda[mode],
                zeta: self.zeta[mode],
            }
        } else {
            self.cell(mode).ratios(rate)
        }
    }

    /// x[−1] of a mode relative to its rest position, from x[0] and its velocity.
    pub(crate) fn before(&self, mode: usize, rate: Rate) -> f64 {
        let (x, v) = (self.x0[mode] - self.rest[mode], self.v0[mode]);
        if self.is_discrete {
            x - v * rate.step()
        } else {
            x - self.cell(mode).last_step(x, v, 0.0, rate)
        }
    }

    /// Damped frequency [Hz] and decay rate [1/s] of a mode.
    pub(crate) fn pitch(&self, mode: usize, rate: Rate) -> (f64, f64) {
        if self.is_discrete {
            let ratios = self.ratios(mode, rate);
            let sigma = -0.5 * crate::maths::log(1.0 - ratios.zeta) * rate.hertz();
            (ratios.pitch(rate).map_or(0.0, |(f, _)| f), sigma)
        } else {
            (self.cell(mode).frequency(), 0.5 * self.zeta[mode])
        }
    }
}
