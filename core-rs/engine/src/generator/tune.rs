//! Springs and dampers for a pitch and a decay, by the lowest mode of the network.

use std::f64::consts::TAU;

use super::{GeneratorError, Topology, positive};
use crate::cell::{self, decay};
use crate::maths::sqrt;
use crate::spectrum;
use crate::units::Rate;

/// Stiffness and viscosity of every link of factor 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TunedLinks {
    /// k [N/m], or the algorithmic K.
    pub k: f64,
    /// z [N·s/m], or the algorithmic Z.
    pub z: f64,
}

impl Topology {
    /// The lowest non-rigid λ of the network with masses and springs of 1 (and of `stiffness`).
    ///
    /// # Errors
    /// [`GeneratorError::NoMode`] if no two masses can move against each other.
    pub fn lowest_lambda(&self) -> Result<f64, GeneratorError> {
        if let Some(mode_lambda) = self.lowest_lambda {
            return Ok(mode_lambda);
        }
        // In coordinates √M·x the matrix stays symmetric even if masses differ.
        let mass_roots: Vec<f64> = (0..self.n_mat).map(|i| sqrt(self.mass_share(i))).collect();
        let mut displacement = vec![0.0; self.n_mat];
        let mut apply_scaled = |x: &[f64], y: &mut [f64]| {
            if self.shares.is_empty() {
                return self.apply(x, y);
            }
            displacement
                .iter_mut()
                .zip(x.iter().zip(&mass_roots))
                .for_each(|(displacement, (x, mass_root))| *displacement = x / mass_root);
            self.apply(&displacement, y);
            y.iter_mut().zip(&mass_roots).for_each(|(y, mass_root)| *y /= mass_root);
        };
        let mut rigid_modes: Vec<Vec<f64>> = Vec::new();
        if self.is_rigid() {
            rigid_modes.push(mass_roots.clone());
        }
        if self.has_tilt_modes {
            let tilt_along = |axis: usize| {
                let weighted_positions = self.positions.iter().zip(&mass_roots);
                weighted_positions
                    .map(|(position, mass_root)| position[axis] * mass_root)
                    .collect()
            };
            rigid_modes.extend([tilt_along(0), tilt_along(1)]);
        }
        spectrum::lowest_mode(self.n_mat, &mut apply_scaled, &rigid_modes)
            .map(|mode| mode.lambda)
            .filter(|mode_lambda| *mode_lambda > 0.0)
            .ok_or(GeneratorError::NoMode)
    }
}

/// Springs and dampers that give the lowest mode damped frequency `f` [Hz] and `t60` [s; none: no decay].
///
/// `mass` is each MAT's [kg]; with `discrete_rate` it is the algorithmic M at that rate, and k and z are the
/// algorithmic K and Z whose discrete network has a pole of exactly `f` and `t60`. Otherwise ω₁² = (2πf)² + σ₁² is the
/// undamped frequency, k = m ω₁²/λ₁ and z = 2σ₁k/ω₁².
///
/// ```
/// use ergon_engine::generator::{Ends, string, tune};
///
/// let topology = string(60, Ends::Fixed, 0.0)?;
/// let tuned = tune(&topology, 1e-3, 220.0, Some(3.0), None)?; // masses of 1 g, 220 Hz, 3 s
/// assert!(tuned.k > 0.0 && tuned.z > 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Numbers out of range, a body without modes, a pitch beyond half the discrete rate.
pub fn tune(
    topology: &Topology,
    mass: f64,
    f: f64,
    t60: Option<f64>,
    discrete_rate: Option<Rate>,
) -> Result<TunedLinks, GeneratorError> {
    positive("A mass", mass)?;
    positive("`f`", f)?;
    t60.map_or(Ok(()), |t60| positive("`t60`", t60))?;
    let mass_per_lambda = mass / topology.lowest_lambda()?;
    match discrete_rate {
        Some(rate) if 2.0 * f >= rate.hertz() => Err(GeneratorError::Pitch { f, rate: rate.hertz() }),
        Some(rate) => {
            let tuned_ratios = cell::tune(f, t60, rate);
            Ok(TunedLinks {
                k: tuned_ratios.kappa * mass_per_lambda,
                z: tuned_ratios.zeta * mass_per_lambda,
            })
        }
        None => {
            let (sigma, omega) = (decay(t60), TAU * f);
            Ok(TunedLinks {
                k: (omega * omega + sigma * sigma) * mass_per_lambda,
                z: 2.0 * sigma * mass_per_lambda,
            })
        }
    }
}
