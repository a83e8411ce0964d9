//! Springs and dampers for a pitch and a decay, by the lowest mode of the network.

use std::f64::consts::TAU;

use super::{GeneratorError, Topology, positive};
use crate::cell::{self, decay};
use crate::maths::sqrt;
use crate::spectrum;
use crate::units::Rate;

/// Stiffness and viscosity of every link of factor 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tuned {
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
    pub fn lowest(&self) -> Result<f64, GeneratorError> {
        if let Some(lambda) = self.lowest_lambda {
            return Ok(lambda);
        }
        // In coordinates √M·x the matrix stays symmetric even if masses differ.
        let root: Vec<f64> = (0..self.n_mat).map(|i| sqrt(self.share(i))).collect();
        let mut displacement = vec![0.0; self.n_mat];
        let mut apply = |x: &[f64], y: &mut [f64]| {
            if self.shares.is_empty() {
                return self.apply(x, y);
            }
            displacement
                .iter_mut()
                .zip(x.iter().zip(&root))
                .for_each(|(displacement, (x, root))| *displacement = x / root);
            self.apply(&displacement, y);
            y.iter_mut().zip(&root).for_each(|(y, root)| *y /= root);
        };
        let mut rigid: Vec<Vec<f64>> = Vec::new();
        if self.is_rigid() {
            rigid.push(root.clone());
        }
        if self.tilts {
            let along = |axis: usize| {
                let places = self.positions.iter().zip(&root);
                places.map(|(place, root)| place[axis] * root).collect()
            };
            rigid.extend([along(0), along(1)]);
        }
        spectrum::lowest(self.n_mat, &mut apply, &rigid)
            .map(|mode| mode.lambda)
            .filter(|lambda| *lambda > 0.0)
            .ok_or(GeneratorError::NoMode)
    }
}

/// Springs and dampers that give the lowest mode damped frequency `f` [Hz] and `t60` [s; none: no decay].
///
/// `mass` is each MAT's [kg]; with `discrete` it is the algorithmic M at that rate, and k and z are the
/// algorithmic K and Z whose discrete network has a pole of exactly `f` and `t60`. Otherwise
/// ω₁² = (2πf)² + σ₁² is the undamped frequency, k = m ω₁²/λ₁ and z = 2σ₁k/ω₁².
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
    discrete: Option<Rate>,
) -> Result<Tuned, GeneratorError> {
    positive("A mass", mass)?;
    positive("`f`", f)?;
    t60.map_or(Ok(()), |t60| positive("`t60`", t60))?;
    let unit = mass / topology.lowest()?;
    match discrete {
        Some(rate) if 2.0 * f >= rate.hertz() => Err(GeneratorError::Pitch {
            f,
            rate: rate.hertz(),
        }),
        Some(rate) => {
            let ratios = cell::tune(f, t60, rate);
            Ok(Tuned {
                k: ratios.kappa * unit,
                z: ratios.zeta * unit,
            })
        }
        None => {
            let (sigma, omega) = (decay(t60), TAU * f);
            Ok(Tuned {
                k: (omega * omega + sigma * sigma) * unit,
                z: 2.0 * sigma * unit,
            })
        }
    }
}
