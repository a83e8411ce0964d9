//! Which modes of a body this score needs: the modes that its strikes excite least are left out, as far as the error
//! budget allows.

use crate::assembly::budget::Budget;
use crate::assembly::constants::ENERGY_SECONDS;
use crate::body_modes::normal_modes::Modes;
use crate::maths::{expm1, log10, pow};
use crate::units::Rate;

/// The modes that are kept.
pub(crate) struct KeptModes {
    /// Rising.
    pub(crate) modes: Vec<usize>,
    /// How loud the others would have been together, relative to all [dB]; `None`: none are left out, or only silent
    /// ones.
    pub(crate) left_out_db: Option<f64>,
}

impl KeptModes {
    /// For a body without modes.
    pub(crate) fn empty() -> Self {
        Self {
            modes: Vec::new(),
            left_out_db: None,
        }
    }

    /// As numbers of a plan's choice.
    pub(crate) fn numbers(&self) -> Vec<u32> {
        self.modes.iter().map(|&mode| mode as u32).collect()
    }

    /// The modes that a plan decided for; `None` if the body does not have these.
    pub(crate) fn pinned(numbers: &[u32], n_total: usize) -> Option<Self> {
        let modes: Vec<usize> = numbers.iter().map(|&mode| mode as usize).collect();
        let is_rising = modes.windows(2).all(|pair| pair[0] < pair[1]);
        let fits_body = is_rising && modes.last().is_none_or(|&last| last < n_total);
        fits_body.then_some(Self {
            modes,
            left_out_db: None,
        })
    }
}

/// Keeps the loudest modes. Energies are A²/2 over the first `ENERGY_SECONDS` seconds, with A the amplitude that an
/// output hears, and add up over the impulses `impulses` [N·s].
pub(crate) fn loudest_modes(
    modes: &Modes,
    output_shapes: &[Vec<f64>],
    struck_shapes: &[Vec<f64>],
    impulses: &[Vec<f64>],
    left_out_db_max: Option<f64>,
    budget: &Budget,
    rate: Rate,
) -> KeptModes {
    let energies: Vec<f64> = (0..modes.len())
        .map(|mode| mode_energy(modes, struck_shapes, impulses, mode, rate))
        .collect();
    let output_rows: Vec<&[f64]> = output_shapes.iter().map(Vec::as_slice).collect();
    loudest_by_energy(&[energies], &output_rows, left_out_db_max, budget, |mode| {
        modes.frequency_and_decay(mode, rate).0
    })
}

/// Keeps the loudest modes, so that the others together stay below `level_max` [dB] in every row, for each of several
/// `excitations` in which modes may get their energies   (n_excitations, n_modes).
pub(crate) fn loudest_by_energy(
    excitations: &[Vec<f64>],
    rows: &[&[f64]],
    level_max: Option<f64>,
    budget: &Budget,
    frequency: impl Fn(usize) -> f64,
) -> KeptModes {
    let mode_count = excitations.first().map_or(0, Vec::len);
    // The largest relative loudness of each mode over all rows and excitations.
    let mut mode_loudness = vec![0.0_f64; mode_count];
    for (mode_energies, row) in excitations
        .iter()
        .flat_map(|excitation| rows.iter().map(move |row| (excitation, row)))
    {
        let energy = |mode: usize| mode_energies[mode] * row[mode] * row[mode];
        let total_energy: f64 = (0..mode_count).map(energy).sum();
        if total_energy > 0.0 {
            let loudness = mode_loudness.iter_mut().enumerate();
            loudness.for_each(|(mode, mode_loudness)| *mode_loudness = mode_loudness.max(energy(mode) / total_energy));
        }
    }
    let mut by_loudness: Vec<(f64, usize)> = mode_loudness.into_iter().zip(0..).collect();
    by_loudness.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let share_max = level_max.map(|db| pow(10.0, db / 10.0));
    let (mut modes_kept, mut dropped_share) = (Vec::new(), 0.0);
    for (loudness, mode) in by_loudness {
        let is_inaudible = frequency(mode) > budget.highest_audible_hz();
        let may_be_left_out = share_max.is_some_and(|share_allowed| dropped_share + loudness <= share_allowed);
        if is_inaudible || may_be_left_out {
            // A mode above hearing may be loud: it does not count as an error.
            dropped_share += if is_inaudible { 0.0 } else { loudness };
        } else {
            modes_kept.push(mode);
        }
    }
    modes_kept.sort_unstable();
    KeptModes {
        modes: modes_kept,
        left_out_db: (dropped_share > 0.0).then(|| 10.0 * log10(dropped_share)),
    }
}

/// Energy of a mode's own motion, before an output weights it.
fn mode_energy(modes: &Modes, struck_shapes: &[Vec<f64>], impulses: &[Vec<f64>], mode: usize, rate: Rate) -> f64 {
    let (frequency, decay_rate) = modes.frequency_and_decay(mode, rate);
    let omega = (std::f64::consts::TAU * frequency)
        .max(decay_rate)
        .max(f64::MIN_POSITIVE);
    let (x, v) = (modes.x0[mode] - modes.rest[mode], modes.v0[mode]);
    let mut amplitude_square = x * x + v * v / (omega * omega);
    for (shape, blows) in struck_shapes.iter().zip(impulses) {
        // A unit impulse gives a mass of 1 the velocity 1; an algorithmic mass of 1 gets T^-2 times as much.
        let mass_unit = if modes.is_discrete {
            rate.step() * rate.step()
        } else {
            1.0
        };
        let impulse_gain = shape[mode] / (omega * mass_unit);
        amplitude_square += blows.iter().map(|p| p * p * impulse_gain * impulse_gain).sum::<f64>();
    }
    // ∫ e^(-2σt) over that time.
    let decay_integral = if decay_rate * ENERGY_SECONDS > 1e-9 {
        -expm1(-2.0 * decay_rate * ENERGY_SECONDS) / (2.0 * decay_rate)
    } else {
        ENERGY_SECONDS
    };
    amplitude_square * decay_integral
}
