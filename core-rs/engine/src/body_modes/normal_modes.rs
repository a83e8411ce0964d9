//! A linear body as its modes, seen from where it is struck and heard.

use crate::body_modes::constants::{ANGLE_MIN, PROBE_VECTORS, RELATIVE_TOLERANCE};
use crate::body_modes::linear::{Linear, NoModes};
use crate::body_modes::viscosity::{Viscosity, probe};
use crate::cell::{Cell, CellRatios};
use crate::network::Network;
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
        let linear_body = Linear::new(network, rate)?;
        if linear_body.proportion.is_none() && linear_body.viscosity.is_none() {
            return Err(NoModes::Damping);
        }
        let free_count = linear_body.free.len();
        let mats = network.mats();
        let slot_of_mat = |mat: usize| linear_body.free.binary_search(&mat).ok();
        // A row becomes M^-½ e in modal coordinates, a motion M^½ x.
        let mut row_table: Vec<Vec<f64>> = Vec::with_capacity(rows.len() + 3);
        for row in rows {
            let mut weighted_row = vec![0.0; free_count];
            for &(mat, weight) in row {
                if let Some(free_slot) = slot_of_mat(mat) {
                    weighted_row[free_slot] += weight / linear_body.sqrt_masses[free_slot];
                }
            }
            row_table.push(weighted_row);
        }
        let per_free_mat = |value_of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            linear_body
                .free
                .iter()
                .enumerate()
                .map(|(free_slot, &i)| value_of(free_slot, i))
                .collect()
        };
        row_table.push(per_free_mat(&|slot, i| linear_body.sqrt_masses[slot] * mats.x0[i]));
        row_table.push(per_free_mat(&|slot, i| linear_body.sqrt_masses[slot] * mats.v0[i]));
        row_table.push(per_free_mat(&|slot, _| {
            linear_body.force[slot] / linear_body.sqrt_masses[slot]
        }));
        if let Some(viscosity) = &linear_body.viscosity {
            let probes: Vec<Vec<f64>> = (0..PROBE_VECTORS).map(|index| probe(free_count, index)).collect();
            let images: Vec<Vec<f64>> = probes.iter().map(|probe| viscosity.multiply(probe)).collect();
            row_table.extend(probes);
            row_table.extend(images);
        }
        let (lambda, mut row_table) = all_eigenvalues(linear_body.stiffness, &row_table).ok_or(NoModes::NotFinite)?;
        let lambda_max = lambda.last().copied().unwrap_or(0.0);
        // A body that nothing holds has a mode at 0, up to rounding; a mode clearly below 0 grows.
        let lambda_floor = 1e-13 * lambda_max * free_count as f64;
        if lambda.iter().any(|lambda| *lambda < -lambda_floor) {
            return Err(NoModes::Diverges);
        }
        let floor_lambda = |lambda: f64| if lambda <= lambda_floor { 0.0 } else { lambda };
        let lambda: Vec<f64> = lambda.into_iter().map(floor_lambda).collect();
        let zeta = match linear_body.proportion {
            Some([alpha, beta]) => lambda.iter().map(|lambda| alpha + beta * lambda).collect(),
            None => {
                let images = row_table.split_off(row_table.len() - PROBE_VECTORS);
                let probes = row_table.split_off(row_table.len() - PROBE_VECTORS);
                let mut zeta = Viscosity::mode_damping(&probes, &images).ok_or(NoModes::Damping)?;
                let zeta_max = zeta.iter().fold(0.0_f64, |zeta_max, zeta| zeta_max.max(*zeta));
                for (zeta, lambda) in zeta.iter_mut().zip(&lambda) {
                    // A rigid mode that no damper acts on has no loss, up to rounding.
                    if *lambda == 0.0 && zeta.abs() <= RELATIVE_TOLERANCE * zeta_max {
                        *zeta = 0.0;
                    }
                }
                zeta
            }
        };
        let modal_force = row_table.pop().unwrap_or_default();
        let v0 = row_table.pop().unwrap_or_default();
        let x0 = row_table.pop().unwrap_or_default();
        let rest_of_mode = |(modal_force, lambda): (f64, &f64)| {
            if *lambda > 0.0 { modal_force / lambda } else { 0.0 }
        };
        let rest: Vec<f64> = modal_force.into_iter().zip(&lambda).map(rest_of_mode).collect();
        Ok(Self {
            lambda,
            zeta,
            shapes: row_table,
            x0,
            v0,
            rest,
            is_discrete: linear_body.is_discrete,
        })
    }

    /// The same modes with some of the rows only.
    pub(crate) fn with_rows(&self, rows: &[usize]) -> Self {
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
    pub(crate) fn unfit_reason(&self, rate: Rate) -> Option<NoModes> {
        let mode_ratios = (0..self.len()).map(|mode| self.ratios(mode, rate));
        for (CellRatios { kappa, zeta }, lambda) in mode_ratios.zip(&self.lambda) {
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

    /// The same, such that its samples determine the motion between them.
    pub(crate) fn resolvable_cell(&self, mode: usize, rate: Rate) -> Cell {
        self.cell(mode).resolvable_at(rate)
    }

    /// κ and ζ of a mode in discrete time.
    pub(crate) fn ratios(&self, mode: usize, rate: Rate) -> CellRatios {
        if self.is_discrete {
            CellRatios {
                kappa: self.lambda[mode],
                zeta: self.zeta[mode],
            }
        } else {
            self.resolvable_cell(mode, rate).ratios(rate)
        }
    }

    /// x[−1] of a mode relative to its rest position, from x[0] and its velocity.
    pub(crate) fn position_before(&self, mode: usize, rate: Rate) -> f64 {
        let (x, v) = (self.x0[mode] - self.rest[mode], self.v0[mode]);
        if self.is_discrete {
            x - v * rate.step()
        } else {
            x - self.resolvable_cell(mode, rate).last_step(x, v, 0.0, rate)
        }
    }

    /// Damped frequency [Hz] and decay rate [1/s] of a mode.
    pub(crate) fn frequency_and_decay(&self, mode: usize, rate: Rate) -> (f64, f64) {
        if self.is_discrete {
            let mode_ratios = self.ratios(mode, rate);
            let decay_rate = -0.5 * crate::maths::log(1.0 - mode_ratios.zeta) * rate.hertz();
            (mode_ratios.pitch(rate).map_or(0.0, |(f, _)| f), decay_rate)
        } else {
            (self.cell(mode).frequency(), 0.5 * self.zeta[mode])
        }
    }
}
