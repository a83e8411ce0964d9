//! Which modes of a body this score needs: modes are left out, those that its strikes excite least first, as long as what
//! is left out stays within the error budget.

use crate::maths::{expm1, log10, pow};
use crate::plan::budget::Budget;
use crate::plan::passes::modes::Modes;
use crate::units::Rate;

/// Energies are those of the first moments: there high modes, which fade first, count most [s].
pub(in crate::plan) const FIRST: f64 = 0.1;

/// The modes that stay.
pub(in crate::plan) struct KeptModes {
    /// Rising.
    pub(in crate::plan) modes: Vec<usize>,
    /// How loud the others would have been together, relative to all [dB]; `None`: silent, or none.
    pub(in crate::plan) left_out: Option<f64>,
}

impl KeptModes {
    /// Of a body that goes by none.
    pub(in crate::plan) fn none() -> Self {
        Self {
            modes: Vec::new(),
            left_out: None,
        }
    }

    /// As numbers of a plan.
    pub(in crate::plan) fn numbers(&self) -> Vec<u32> {
        self.modes.iter().map(|&mode| mode as u32).collect()
    }

    /// Those that a plan decided for; `None` where there are not so many.
    pub(in crate::plan) fn pinned(numbers: &[u32], of: usize) -> Option<Self> {
        let modes: Vec<usize> = numbers.iter().map(|&mode| mode as usize).collect();
        let rises = modes.windows(2).all(|pair| pair[0] < pair[1]);
        let fits = rises && modes.last().is_none_or(|&last| last < of);
        fits.then_some(Self {
            modes,
            left_out: None,
        })
    }
}

/// Keep the loudest modes, `blows` being impulses [N·s]: energies as if strikes added up by power, A²/2 over the
/// first moments, A the amplitude that an output hears.
pub(in crate::plan) fn keep(
    modes: &Modes,
    heard: &[Vec<f64>],
    felt: &[Vec<f64>],
    blows: &[Vec<f64>],
    allowed: Option<f64>,
    budget: &Budget,
    rate: Rate,
) -> KeptModes {
    let own: Vec<f64> = (0..modes.len())
        .map(|mode| energy(modes, felt, blows, mode, rate))
        .collect();
    let rows: Vec<&[f64]> = heard.iter().map(Vec::as_slice).collect();
    choose(&[own], &rows, allowed, budget, |mode| {
        modes.pitch(mode, rate).0
    })
}

/// Keep the loudest of modes, so that for every row that sees them those that fall stay together below what is
/// `allowed` [dB], whichever of some `ways` they get their energies   (n_ways, n_modes).
pub(in crate::plan) fn choose(
    ways: &[Vec<f64>],
    rows: &[&[f64]],
    allowed: Option<f64>,
    budget: &Budget,
    frequency: impl Fn(usize) -> f64,
) -> KeptModes {
    let n = ways.first().map_or(0, Vec::len);
    // A mode's loudness where it is loudest.
    let mut most = vec![0.0_f64; n];
    for (own, row) in ways
        .iter()
        .flat_map(|own| rows.iter().map(move |row| (own, row)))
    {
        let energy = |mode: usize| own[mode] * row[mode] * row[mode];
        let total: f64 = (0..n).map(energy).sum();
        if total > 0.0 {
            let loudness = most.iter_mut().enumerate();
            loudness.for_each(|(mode, most)| *most = most.max(energy(mode) / total));
        }
    }
    let mut by_loudness: Vec<(f64, usize)> = most.into_iter().zip(0..).collect();
    by_loudness.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let allowed = allowed.map(|db| pow(10.0, db / 10.0));
    let (mut stays, mut fallen) = (Vec::new(), 0.0);
    for (loudness, mode) in by_loudness {
        let is_unheard = frequency(mode) > budget.highest();
        let may_fall = allowed.is_some_and(|allowed| fallen + loudness <= allowed);
        if is_unheard || may_fall {
            // Above hearing a mode may be loud: it is not counted as an error.
            fallen += if is_unheard { 0.0 } else { loudness };
        } else {
            stays.push(mode);
        }
    }
    stays.sort_unstable();
    KeptModes {
        modes: stays,
        left_out: (fallen > 0.0).then(|| 10.0 * log10(fallen)),
    }
}

/// Energy of one mode's own motion.
fn energy(modes: &Modes, felt: &[Vec<f64>], blows: &[Vec<f64>], mode: usize, rate: Rate) -> f64 {
    let (f, sigma) = modes.pitch(mode, rate);
    let omega = (std::f64::consts::TAU * f)
        .max(sigma)
        .max(f64::MIN_POSITIVE);
    let (x, v) = (modes.x0[mode] - modes.rest[mode], modes.v0[mode]);
    let mut square = x * x + v * v / (omega * omega);
    for (shape, blows) in felt.iter().zip(blows) {
        // A unit impulse gives a mass of 1 the velocity 1; an algorithmic one T^-2 times as much.
        let unit = if modes.is_discrete {
            rate.step() * rate.step()
        } else {
            1.0
        };
        let size = shape[mode] / (omega * unit);
        square += blows.iter().map(|p| p * p * size * size).sum::<f64>();
    }
    // ∫ e^(-2σt) over that time.
    let time = if sigma * FIRST > 1e-9 {
        -expm1(-2.0 * sigma * FIRST) / (2.0 * sigma)
    } else {
        FIRST
    };
    square * time
}
