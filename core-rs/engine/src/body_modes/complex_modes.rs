//! The complex modes of a linear body: with any damping, each mode is a pole and its residues.
//!
//! In the coordinates of the undamped modes, p = ω·q and v = q̇, the body is ṗ = ω·v, v̇ = −ω·p − C·v + f. The length
//! of its state is √(2·energy), which only damping changes. The computed modes are exact for a matrix A + E instead of
//! A, so after t seconds the state is off by at most t·‖E‖ times its length. E is computed.

mod blocks;
mod decoupled;

use std::ops::Range;

use crate::body_modes::constants::{ANGLE_MIN, COUPLING_NONE, DAMPED_MASSES_MAX};
use crate::body_modes::linear::{Damper, Linear, NoModes};
use crate::body_modes::normal_modes::Row;
use crate::cell::resolvable_omega;
use crate::maths::{cos, exp, sin};
use crate::network::Network;
use crate::spectrum::all_eigenvalues;
use crate::units::Rate;

/// A complex number: real and imaginary part.
pub(crate) type Complex = [f64; 2];

/// Describes one oscillator of a complex mode: the mode, the oscillator's part in it, and the sign of its output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ComplexPart {
    pub(crate) mode: usize,
    /// Which of the mode's oscillators it is: 0 or 1.
    pub(crate) sequence: usize,
    pub(crate) sign: f64,
}

/// How a mode evolves by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Pole {
    /// −decay ± iω [1/s, rad/s].
    Pair { decay: f64, omega: f64 },
    /// −decay [1/s].
    Real { decay: f64 },
    /// 0, twice: a body that nothing holds moves at constant speed. Its number is position + i·velocity.
    Free,
}

impl Pole {
    /// This pole with a frequency whose samples at `rate` determine the motion between them.
    pub(crate) fn resolvable_at(self, rate: Rate) -> Self {
        match self {
            Self::Pair { decay, omega } => Self::Pair {
                decay,
                omega: resolvable_omega(omega, rate),
            },
            _ => self,
        }
    }

    /// The map from the number of a mode of this pole to that one step earlier.
    pub(crate) fn backward_step(self, time_step: f64) -> BackwardStep {
        match self {
            Self::Pair { decay, omega } => {
                let (step_decay, step_angle) = (decay * time_step, omega * time_step);
                BackwardStep::Turn {
                    // If b is 0, the recurrence does not use the frame before.
                    growth: if exp(-2.0 * step_decay) == 0.0 {
                        0.0
                    } else {
                        exp(step_decay)
                    },
                    cosine: cos(step_angle),
                    sine: sin(step_angle),
                }
            }
            // The recurrence does not use the frame before, but a port needs it for its velocity.
            Self::Real { decay } => {
                let step_decay = decay * time_step;
                BackwardStep::Turn {
                    growth: if step_decay < 1.0 {
                        exp(step_decay)
                    } else {
                        1.0 + step_decay
                    },
                    cosine: 1.0,
                    sine: 0.0,
                }
            }
            Self::Free => BackwardStep::Drift { time_step },
        }
    }
}

/// The motion of a mode by a step backwards.
#[derive(Clone, Copy, Debug)]
pub(crate) enum BackwardStep {
    Turn { growth: f64, cosine: f64, sine: f64 },
    Drift { time_step: f64 },
}

impl BackwardStep {
    /// The number of the mode one step earlier.
    pub(crate) fn apply(self, [x, y]: Complex) -> Complex {
        match self {
            Self::Turn { growth, cosine, sine } => [growth * (cosine * x + sine * y), growth * (cosine * y - sine * x)],
            Self::Drift { time_step } => [x - y * time_step, 0.0],
        }
    }
}

/// The weights with which an output sums the positions and velocities of masses.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Sum {
    pub(crate) positions: Row,
    pub(crate) velocities: Row,
}

impl Sum {
    /// A sum of positions alone.
    pub(crate) fn from_positions(positions: Row) -> Self {
        Self {
            positions,
            velocities: Row::new(),
        }
    }
}

/// The modes of a body.
#[derive(Debug, Default)]
pub(crate) struct ComplexModes {
    /// (n_modes)
    pub(crate) poles: Vec<Pole>,
    /// The number of each mode at t = 0   (n_modes)
    pub(crate) start: Vec<Complex>,
    /// What each output sees of each mode: the real part of the product with the mode's number; for a free mode,
    /// position and velocity each with their own factor   (n_out, n_modes)
    pub(crate) output_shapes: Vec<Vec<Complex>>,
    /// What 1 N·s at each struck point adds to each mode   (n_struck, n_modes)
    pub(crate) struck_shapes: Vec<Vec<Complex>>,
    /// What each output hears when the body is at rest   (n_out)
    pub(crate) rest: Vec<f64>,
}

/// The body in the coordinates of its undamped modes.
struct Coordinates {
    /// ω² [1/s²], rising; 0 where nothing holds the body   (n)
    lambda: Vec<f64>,
    /// (n_out, n)
    positions: Vec<Vec<f64>>,
    velocities: Vec<Vec<f64>>,
    /// (n_struck, n)
    struck: Vec<Vec<f64>>,
    /// Positions and velocities at t = 0, and rest positions   (n)
    x0: Vec<f64>,
    v0: Vec<f64>,
    rest: Vec<f64>,
    damping: Damping,
}

/// C, the damping in these coordinates.
enum Damping {
    /// Only its diagonal is not zero   (n)
    Decoupled(Vec<f64>),
    /// (n, n)
    Coupled(Vec<f64>),
}

impl ComplexModes {
    /// The modes of a network that is one linear body, heard by `outputs` and struck at some MATs.
    pub(crate) fn new(network: &Network, outputs: &[Sum], struck: &[usize], rate: Rate) -> Result<Self, NoModes> {
        let coordinates = Coordinates::new(network, outputs, struck, rate)?;
        let mut complex_modes = Self {
            output_shapes: vec![Vec::new(); outputs.len()],
            struck_shapes: vec![Vec::new(); struck.len()],
            rest: coordinates.rest_outputs(),
            ..Self::default()
        };
        match &coordinates.damping {
            Damping::Decoupled(damping) => {
                for (mode, &c) in damping.iter().enumerate() {
                    decoupled::add(&mut complex_modes, &coordinates, mode, c)?;
                }
            }
            Damping::Coupled(damping) => {
                let mode_count = coordinates.lambda.len();
                for block in blocks::coupled_sets(damping, mode_count) {
                    match block[..] {
                        [mode] => {
                            let diagonal = damping[mode * mode_count + mode];
                            decoupled::add(&mut complex_modes, &coordinates, mode, diagonal)?;
                        }
                        _ => blocks::add(&mut complex_modes, &coordinates, damping, &block)?,
                    }
                }
            }
        }
        complex_modes.sort();
        Ok(complex_modes)
    }

    pub(crate) fn len(&self) -> usize {
        self.poles.len()
    }

    /// Damped frequency [Hz] and decay rate [1/s] of a mode.
    pub(crate) fn frequency_and_decay(&self, mode: usize) -> (f64, f64) {
        match self.poles[mode] {
            Pole::Pair { decay, omega } => (omega / std::f64::consts::TAU, decay),
            Pole::Real { decay } => (0.0, decay),
            Pole::Free => (0.0, 0.0),
        }
    }

    /// By frequency, then by decay.
    fn sort(&mut self) {
        let mut mode_order: Vec<usize> = (0..self.len()).collect();
        mode_order.sort_by(|&i, &j| {
            let ((frequency, decay), (other_frequency, other_decay)) =
                (self.frequency_and_decay(i), self.frequency_and_decay(j));
            frequency
                .total_cmp(&other_frequency)
                .then(decay.total_cmp(&other_decay))
        });
        fn sorted<T: Copy>(all: &[T], mode_order: &[usize]) -> Vec<T> {
            mode_order.iter().map(|&mode| all[mode]).collect()
        }
        self.poles = sorted(&self.poles, &mode_order);
        self.start = sorted(&self.start, &mode_order);
        for row in self.output_shapes.iter_mut().chain(&mut self.struck_shapes) {
            *row = sorted(row, &mode_order);
        }
    }

    /// Whether a mode is too slow for its recurrence.
    pub(crate) fn unfit_reason(&self, rate: Rate) -> Option<NoModes> {
        let is_too_slow = |pole: &Pole| match *pole {
            Pole::Pair { decay, omega } => (decay * decay + omega * omega).sqrt() * rate.step() < ANGLE_MIN,
            Pole::Real { .. } | Pole::Free => false,
        };
        self.poles.iter().any(is_too_slow).then_some(NoModes::Slow)
    }

    /// Adds a mode with its shape at each output, and what it gets from 1 N·s at each struck point.
    fn add(
        &mut self,
        (pole, start): (Pole, Complex),
        output_shape_of: impl Fn(usize) -> Complex,
        struck_shape_of: impl Fn(usize) -> Complex,
    ) {
        self.poles.push(pole);
        self.start.push(start);
        for (output, row) in self.output_shapes.iter_mut().enumerate() {
            row.push(output_shape_of(output));
        }
        for (point, row) in self.struck_shapes.iter_mut().enumerate() {
            row.push(struck_shape_of(point));
        }
    }
}

impl Coordinates {
    fn new(network: &Network, outputs: &[Sum], struck: &[usize], rate: Rate) -> Result<Self, NoModes> {
        let linear_body = Linear::new(network, rate)?;
        let free_count = linear_body.free.len();
        // A discrete network that is the reference is stepped as it is.
        let has_coupled_damping = linear_body.proportion.is_none();
        if linear_body.is_discrete {
            return Err(if has_coupled_damping {
                NoModes::Damping
            } else {
                NoModes::ForceHeard
            });
        }
        if has_coupled_damping && free_count > DAMPED_MASSES_MAX {
            return Err(NoModes::TooLarge);
        }
        let (mats, sqrt_masses) = (network.mats(), &linear_body.sqrt_masses);
        let slot_of_mat = |mat: usize| linear_body.free.binary_search(&mat).ok();
        let mass_weighted_row = |weights: &Row| {
            let mut sum = vec![0.0; free_count];
            for &(mat, weight) in weights {
                if let Some(slot) = slot_of_mat(mat) {
                    sum[slot] += weight / sqrt_masses[slot];
                }
            }
            sum
        };
        let mut rows: Vec<Vec<f64>> = outputs.iter().map(|sum| mass_weighted_row(&sum.positions)).collect();
        rows.extend(outputs.iter().map(|sum| mass_weighted_row(&sum.velocities)));
        rows.extend(struck.iter().map(|&mat| mass_weighted_row(&vec![(mat, 1.0)])));
        let per_free_mat = |value_of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            let free_mats = linear_body.free.iter().enumerate();
            free_mats.map(|(slot, &mat)| value_of(slot, mat)).collect()
        };
        rows.push(per_free_mat(&|slot, mat| sqrt_masses[slot] * mats.x0[mat]));
        rows.push(per_free_mat(&|slot, mat| sqrt_masses[slot] * mats.v0[mat]));
        rows.push(per_free_mat(&|slot, _| linear_body.force[slot] / sqrt_masses[slot]));
        let first_damper = rows.len();
        if has_coupled_damping {
            rows.extend(linear_body.dampers.iter().map(|damper| damper_row(damper, sqrt_masses)));
        }
        let (mut lambda, mut rows) = all_eigenvalues(linear_body.stiffness, &rows).ok_or(NoModes::NotFinite)?;
        let lambda_max = lambda.last().copied().unwrap_or(0.0);
        let lambda_floor = 1e-13 * lambda_max * free_count as f64;
        if lambda.first().is_some_and(|lowest| *lowest < -lambda_floor) {
            return Err(NoModes::Diverges);
        }
        let free_lambdas = lambda.iter_mut().filter(|lambda| **lambda <= lambda_floor);
        free_lambdas.for_each(|lambda| *lambda = 0.0);
        let damping = match linear_body.proportion {
            Some([alpha, beta]) => Damping::Decoupled(lambda.iter().map(|lambda| alpha + beta * lambda).collect()),
            None => {
                let damper_signs: Vec<f64> = linear_body.dampers.iter().map(|damper| damper.z.signum()).collect();
                for group in equal_frequencies(&lambda) {
                    rotate_group(&mut rows, first_damper, group, &damper_signs).ok_or(NoModes::NotFinite)?;
                }
                Damping::Coupled(coupling(&rows[first_damper..], &damper_signs, free_count))
            }
        };
        rows.truncate(first_damper);
        let modal_force = rows.pop().unwrap_or_default();
        let v0 = rows.pop().unwrap_or_default();
        let x0 = rows.pop().unwrap_or_default();
        let struck = rows.split_off(2 * outputs.len());
        let velocities = rows.split_off(outputs.len());
        let rest_of_mode = |(modal_force, lambda): (f64, &f64)| {
            if *lambda > 0.0 { modal_force / lambda } else { 0.0 }
        };
        let rest = modal_force.into_iter().zip(&lambda).map(rest_of_mode).collect();
        Ok(Self {
            lambda,
            positions: rows,
            velocities,
            struck,
            x0,
            v0,
            rest,
            damping,
        })
    }

    fn rest_outputs(&self) -> Vec<f64> {
        let row_rest = |row: &Vec<f64>| row.iter().zip(&self.rest).map(|(a, b)| a * b).sum();
        self.positions.iter().map(row_rest).collect()
    }
}

/// The row of a damper, times the root of its |Z|: C is the sum of sign·row·rowᵀ.
fn damper_row(damper: &Damper, sqrt_masses: &[f64]) -> Vec<f64> {
    let mut weighted_row = vec![0.0; sqrt_masses.len()];
    for (end, sign) in damper.ends.iter().zip([1.0, -1.0]) {
        if let Some(free_slot) = *end {
            weighted_row[free_slot] += sign * damper.z.abs().sqrt() / sqrt_masses[free_slot];
        }
    }
    weighted_row
}

/// Ranges of undamped modes of the same frequency, first those that no spring holds: any rotation among them gives
/// equally valid modes.
fn equal_frequencies(lambda: &[f64]) -> Vec<Range<usize>> {
    let mut group_ranges = Vec::new();
    let mut group_start = 0;
    while group_start < lambda.len() {
        let lower_lambda = lambda[group_start];
        let is_same_frequency =
            |upper_lambda: &&f64| **upper_lambda - lower_lambda <= 2.0 * COUPLING_NONE * upper_lambda.sqrt();
        let group_size = lambda[group_start..]
            .iter()
            .take_while(is_same_frequency)
            .count()
            .max(1);
        if group_size > 1 || lower_lambda == 0.0 {
            group_ranges.push(group_start..group_start + group_size);
        }
        group_start += group_size;
    }
    group_ranges
}

/// Rotates modes of the same frequency so that dampers do not couple them with each other: equal poles are then
/// separate. A mode that no damper acts on gets zeros, exact to the last bit.
fn rotate_group(rows: &mut [Vec<f64>], first_damper: usize, modes: Range<usize>, signs: &[f64]) -> Option<()> {
    let group_part = |row: &Vec<f64>| row[modes.clone()].to_vec();
    let group_rows: Vec<Vec<f64>> = rows.iter().map(group_part).collect();
    let dampers = rows[first_damper..].iter().flatten();
    let largest_entry = dampers.fold(0.0_f64, |largest_yet, x| largest_yet.max(x.abs()));
    let (eigenvalues, rotated) =
        all_eigenvalues(coupling(&group_rows[first_damper..], signs, modes.len()), &group_rows)?;
    for (row, rotated) in rows.iter_mut().zip(rotated) {
        row[modes.clone()].copy_from_slice(&rotated);
    }
    let row_length = rows.first().map_or(0, Vec::len) as f64;
    for (mode, value) in modes.zip(eigenvalues) {
        // If all dampers are positive, they cannot cancel each other.
        let is_rounding = value.abs() <= 1e-15 * row_length * largest_entry * largest_entry;
        if is_rounding && signs.iter().all(|sign| *sign > 0.0) {
            rows[first_damper..].iter_mut().for_each(|row| row[mode] = 0.0);
        }
    }
    Some(())
}

/// Σ sign·row·rowᵀ   (n, n)
fn coupling(rows: &[Vec<f64>], signs: &[f64], n: usize) -> Vec<f64> {
    let mut coupling_sum = vec![0.0; n * n];
    for (row, sign) in rows.iter().zip(signs) {
        crate::interrupt::spend(row.iter().filter(|row_entry| **row_entry != 0.0).count() * n);
        for (i, row_entry) in row.iter().enumerate().filter(|(_, row_entry)| **row_entry != 0.0) {
            let target_row = &mut coupling_sum[i * n..(i + 1) * n];
            let row_entry = sign * row_entry;
            target_row
                .iter_mut()
                .zip(row)
                .for_each(|(coupling_sum, x)| *coupling_sum += row_entry * x);
        }
    }
    coupling_sum
}
