//! Cells in finer frames: their poles are those of the rate, at another rate they have other numbers.

use crate::network::{Error, Network};
use crate::scheme::Scheme;
use crate::units::Rate;

use super::MOST;

/// κ and ζ at a rate of 2, 4 and 8 steps a frame, each as a multiple of the frame's, in its own time   (n_mat each).
#[derive(Clone, Debug)]
pub(super) struct Cells([[Vec<f64>; 2]; 3]);

impl Cells {
    /// `None` where there are none.
    pub(super) fn new(
        scheme: &Scheme,
        network: &Network,
        has_poles: bool,
    ) -> Result<Option<Self>, Error> {
        let has_ties = [&scheme.kappa, &scheme.zeta]
            .iter()
            .any(|numbers| numbers.iter().any(|number| *number != 0.0));
        if !has_poles || !has_ties {
            return Ok(None);
        }
        let multiples = |steps: u32| -> Result<[Vec<f64>; 2], Error> {
            let steps = f64::from(steps);
            let Ok(rate) = Rate::new(scheme.rate * steps) else {
                return Ok([&scheme.kappa, &scheme.zeta].map(|all| vec![1.0; all.len()]));
            };
            let finer = Scheme::new(network, rate)?;
            let of = |fine: &[f64], whole: &[f64], by: f64| {
                let both = fine.iter().zip(whole);
                both.map(|(fine, whole)| {
                    if *whole == 0.0 {
                        1.0
                    } else {
                        by * fine / whole
                    }
                })
                .collect()
            };
            Ok([
                of(&finer.kappa, &scheme.kappa, steps * steps),
                of(&finer.zeta, &scheme.zeta, steps),
            ])
        };
        Ok(Some(Self([multiples(2)?, multiples(4)?, multiples(MOST)?])))
    }

    /// κ and ζ of so many steps a frame, from those of the frame.
    pub(super) fn ties(&self, steps: u32, [kappa, zeta]: [&[f64]; 2], out: [&mut [f64]; 2]) {
        let multiples = &self.0[steps.ilog2() as usize - 1];
        for ((out, whole), by) in out.into_iter().zip([kappa, zeta]).zip(multiples) {
            for ((out, whole), by) in out.iter_mut().zip(whole).zip(by) {
                *out = whole * by;
            }
        }
    }
}
