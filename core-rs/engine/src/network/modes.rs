//! Modes of one part without the rest of the network, e.g. for tuning it.

use nalgebra::Complex;

use super::Network;
use super::damped::{self, DampedMode};
use crate::interrupt;
use crate::spectrum::{self, CertifiedModes};
use crate::units::LN_1000;

/// Largest number of values in all shapes together.
const ENTRIES_MAX: usize = 100_000_000;

/// A mode of the network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Damped frequency [Hz]; 0 above critical damping.
    pub f: f64,
    /// Time to fall by 60 dB [s]; above critical damping that of the slower of two poles; infinite without loss.
    pub t60: f64,
}

/// Which modes are requested.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ModeRange {
    /// This many of the lowest modes.
    Lowest(usize),
    /// All up to a frequency [Hz].
    Below(f64),
    /// This many modes nearest to a frequency [Hz].
    Around(f64, usize),
}

/// More modes are requested than memory allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{count} modes of {n_masses} masses need too much memory; ask for at most {count_max} modes")]
pub struct TooManyModes {
    /// Number of requested modes.
    pub count: usize,
    /// Number of masses.
    pub n_masses: usize,
    /// Largest number of modes that can be kept.
    pub count_max: usize,
}

/// Modes of a part.
#[derive(Clone, Debug, PartialEq)]
pub struct PartModes {
    /// Frequency and decay   (n_modes), from low to high
    pub tones: Vec<Tone>,
    /// Complex pole s [1/s] of each: e^{st}   (n_modes)
    pub poles: Vec<Complex<f64>>,
    /// How each mass moves in each mode [kg^-½]   (n_modes, n)
    pub shapes: Vec<Vec<Complex<f64>>>,
    /// The masses, by their index in the network   (n)
    pub mats: Vec<usize>,
    /// Whether the inertia of the matrix proves that no undamped mode of the range is missing, and the residual of each
    /// damped mode proves it a mode distinct from all others.
    pub is_certified: bool,
    /// Number of links whose law was taken at its slope at rest.
    pub n_laws: usize,
    /// Number of contacts that were taken as open.
    pub n_contacts: usize,
}

impl Network {
    /// The lowest modes of a part without its links to other parts, with contacts open and laws at their slope at rest.
    ///
    /// ```
    /// use ergon_engine::Network;
    /// use ergon_engine::generator::{Ends, string};
    ///
    /// let mut network = Network::new();
    /// network.part("string", None);
    /// network.mesh("s", &string(40, Ends::Fixed, 0.0)?, 0.01, 220.0, Some(3.0), 0.0)?;
    /// let tones = network.tones(0, 2)?;
    /// assert!((tones[0].f - 220.0).abs() < 1e-6 && (tones[1].f / 440.0 - 1.0).abs() < 0.01);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn tones(&self, part: usize, n_tones: usize) -> Result<Vec<Tone>, TooManyModes> {
        let part_modes = self.part_modes(part, ModeRange::Lowest(n_tones))?;
        Ok(part_modes.tones)
    }

    /// Modes of a part and their shapes, without its links to other parts, with contacts open and laws at their slope
    /// at rest.
    ///
    /// They are complex modes, the eigenvectors of the state, for any damping. For a part under `units: ca` they are
    /// the modes of its discrete network.
    pub fn part_modes(&self, part: usize, range: ModeRange) -> Result<PartModes, TooManyModes> {
        let part_body = self.part_body(part);
        let mat_count = part_body.mats.len();
        // Damping couples each mode with others, so more undamped modes are needed than are requested.
        let coupled_search = |count: usize, find: &dyn Fn(usize) -> CertifiedModes| {
            let part_modes = find(count);
            let is_coupled = damped::is_coupled(&part_body, &part_modes.modes);
            match is_coupled {
                true => (find((2 * count + 20).min(mat_count)), is_coupled),
                false => (part_modes, is_coupled),
            }
        };
        let lowest_part_modes = |count| spectrum::lowest_modes(&part_body.springs, count);
        let frequency = |mode: &DampedMode| Tone::from_pole(part_body.continuous_pole(mode.pole)).f;
        let count_in_memory = |count: usize| -> Result<usize, TooManyModes> {
            let (count, count_max) = (count.min(mat_count), ENTRIES_MAX / mat_count);
            if count <= count_max {
                return Ok(count);
            }
            Err(TooManyModes {
                count,
                n_masses: mat_count,
                count_max,
            })
        };
        let (mut pole_modes, is_certified) = match range {
            _ if mat_count == 0 => (Vec::new(), true),
            ModeRange::Lowest(count) => {
                let count = count_in_memory(count)?;
                let (part_modes, is_coupled) = coupled_search(count, &lowest_part_modes);
                let lowest_part_modes = damped::damped_modes(&part_body, &part_modes.modes, is_coupled, count);
                let is_complete = lowest_part_modes.len() == count;
                (lowest_part_modes, part_modes.is_certified && is_complete)
            }
            ModeRange::Below(f) => {
                let count = count_in_memory(spectrum::n_below(&part_body.springs, part_body.mode_eigenvalue(f)))?;
                let (part_modes, is_coupled) = coupled_search(count, &lowest_part_modes);
                let mut all_modes =
                    damped::damped_modes(&part_body, &part_modes.modes, is_coupled, part_modes.modes.len());
                all_modes.retain(|mode| frequency(mode) <= f);
                (all_modes, part_modes.is_certified)
            }
            ModeRange::Around(f, count) => {
                let count = count_in_memory(count)?;
                let centre_lambda = part_body.mode_eigenvalue(f);
                let modes_near = |count| spectrum::modes_around(&part_body.springs, centre_lambda, count);
                let (part_modes, is_coupled) = coupled_search(count, &modes_near);
                let mut all_modes =
                    damped::damped_modes(&part_body, &part_modes.modes, is_coupled, part_modes.modes.len());
                let distance = |mode: &DampedMode| (frequency(mode) - f).abs();
                all_modes.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
                all_modes.truncate(count);
                (all_modes, part_modes.is_certified)
            }
        };
        let is_certified = is_certified && pole_modes.iter().all(|mode| mode.is_known);
        pole_modes.sort_by(|a, b| a.pole.norm_sqr().total_cmp(&b.pole.norm_sqr()));
        // The sign of a shape is such that its largest motion is positive.
        let signed_shape = |mode: &DampedMode| -> Vec<Complex<f64>> {
            interrupt::poll_for(mat_count);
            let compare_real = |x: &Complex<f64>, y: &Complex<f64>| x.re.abs().total_cmp(&y.re.abs());
            let largest_component = mode.shape.iter().copied().max_by(compare_real);
            let shape_sign = if largest_component.is_some_and(|x| x.re < 0.0) {
                -1.0
            } else {
                1.0
            };
            let mode_entries = mode.shape.iter().zip(&part_body.sqrt_masses);
            mode_entries.map(|(x, root)| x * (shape_sign / root)).collect()
        };
        let continuous_poles = pole_modes.iter().map(|mode| part_body.continuous_pole(mode.pole));
        let poles: Vec<Complex<f64>> = continuous_poles.collect();
        Ok(PartModes {
            tones: poles.iter().map(|&s| Tone::from_pole(s)).collect(),
            poles,
            shapes: pole_modes.iter().map(signed_shape).collect(),
            mats: part_body.mats,
            is_certified,
            n_laws: part_body.n_laws,
            n_contacts: part_body.n_contacts,
        })
    }
}

impl Tone {
    /// The tone of a pole s [1/s].
    fn from_pole(s: Complex<f64>) -> Self {
        Self {
            f: s.im / std::f64::consts::TAU,
            t60: if s.re < 0.0 { LN_1000 / -s.re } else { f64::INFINITY },
        }
    }
}
