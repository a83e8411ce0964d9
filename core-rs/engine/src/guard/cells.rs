//! CELs in finer frames: κ and ζ come from the poles at the rate of the steps, not of the frame.

use crate::network::{Error, Network};
use crate::scheme::Scheme;
use crate::units::Rate;

use super::STEPS_MAX;

/// Factors that turn κ and ζ of the frame into those of 2, 4 and 8 steps a frame, in units of the frame   (n_mat each).
#[derive(Clone, Debug)]
pub(super) struct TieFactors([[Vec<f64>; 2]; 3]);

impl TieFactors {
    /// Compute the factors; `None` if the network has no CEL, or the method does not use poles.
    pub(super) fn new(scheme: &Scheme, network: &Network, has_poles: bool) -> Result<Option<Self>, Error> {
        let has_ties = [&scheme.kappa, &scheme.zeta]
            .iter()
            .any(|coefficients| coefficients.iter().any(|coefficient| *coefficient != 0.0));
        if !has_poles || !has_ties {
            return Ok(None);
        }
        let factors_at = |step_count: u32| -> Result<[Vec<f64>; 2], Error> {
            let step_count = f64::from(step_count);
            let Ok(finer_rate) = Rate::new(scheme.rate * step_count) else {
                return Ok([&scheme.kappa, &scheme.zeta].map(|coefficients| vec![1.0; coefficients.len()]));
            };
            let finer_scheme = Scheme::new(network, finer_rate)?;
            let factors = |fine: &[f64], coarse: &[f64], scale_factor: f64| {
                let tie_pairs = fine.iter().zip(coarse);
                tie_pairs
                    .map(|(fine, coarse)| {
                        if *coarse == 0.0 {
                            1.0
                        } else {
                            scale_factor * fine / coarse
                        }
                    })
                    .collect()
            };
            Ok([
                factors(&finer_scheme.kappa, &scheme.kappa, step_count * step_count),
                factors(&finer_scheme.zeta, &scheme.zeta, step_count),
            ])
        };
        Ok(Some(Self([factors_at(2)?, factors_at(4)?, factors_at(STEPS_MAX)?])))
    }

    /// Write κ and ζ for `steps` steps a frame into `out`, from those of the frame.
    pub(super) fn write_ties(&self, steps: u32, [kappa, zeta]: [&[f64]; 2], out: [&mut [f64]; 2]) {
        let tie_factors = &self.0[steps.ilog2() as usize - 1];
        for ((out, coarse), factor) in out.into_iter().zip([kappa, zeta]).zip(tie_factors) {
            for ((out, coarse), factor) in out.iter_mut().zip(coarse).zip(factor) {
                *out = coarse * factor;
            }
        }
    }
}
