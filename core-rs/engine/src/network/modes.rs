//! Modes of one part by itself, as one would measure them to tune it.

use super::{LinkKind, MatKind, Network};
use crate::spectrum;
use crate::units::LN_1000;

/// A mode of the continuous network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Damped frequency [Hz]; 0 where damping is beyond critical.
    pub f: f64,
    /// Time to fall by 60 dB [s]; infinite without loss.
    pub t60: f64,
}

impl Network {
    /// The lowest modes of a part, without its links to other parts, contacts open and laws at their slope at rest.
    ///
    /// Damping is taken mode by mode, φᵀZφ: exact where it is proportional, of second order where it is light.
    ///
    /// ```
    /// use ergon_engine::Network;
    /// use ergon_engine::generator::{Ends, string};
    ///
    /// let mut network = Network::new();
    /// network.part("string", None);
    /// network.mesh("s", &string(40, Ends::Fixed, 0.0)?, 0.01, 220.0, Some(3.0), 0.0)?;
    /// let tones = network.tones(0, 2);
    /// assert!((tones[0].f - 220.0).abs() < 1e-6 && (tones[1].f / 440.0 - 1.0).abs() < 0.01);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn tones(&self, part: usize, n_tones: usize) -> Vec<Tone> {
        let alone = self.part_alone(part, &[]).network;
        let mats = alone.mats();
        let moving: Vec<usize> = (0..alone.n_mat())
            .filter(|&i| mats.kind[i].moves())
            .collect();
        if moving.is_empty() {
            return Vec::new();
        }
        let root: Vec<f64> = moving.iter().map(|&i| mats.m[i].sqrt()).collect();
        let mut full = vec![0.0; alone.n_mat()];
        // y = M^-½ A M^-½ v, for A of stiffness or of damping.
        let mut apply = |v: &[f64], y: &mut [f64], damping: bool| {
            full.fill(0.0);
            for ((&i, v), root) in moving.iter().zip(v).zip(&root) {
                full[i] = v / root;
            }
            for (slot, &i) in moving.iter().enumerate() {
                let tie = if mats.kind[i] != MatKind::Cel {
                    0.0
                } else if damping {
                    mats.z[i]
                } else {
                    mats.k[i]
                };
                y[slot] = tie * full[i] / root[slot];
            }
            for run in alone.runs() {
                let a = match (&run.kind, damping) {
                    (LinkKind::Ref, false) => run.k,
                    (LinkKind::Ref, true) => run.z,
                    (LinkKind::Lnl(law), false) => law.slope(0.0),
                    (LinkKind::Lnl(law), true) => law.damping_slope(0.0),
                    (LinkKind::But(_), _) => 0.0,
                };
                for i in 0..run.len {
                    let pull = a * (full[run.b + i] - full[run.a + i]);
                    for (end, pull) in [(run.a + i, -pull), (run.b + i, pull)] {
                        if let Ok(slot) = moving.binary_search(&end) {
                            y[slot] += pull / root[slot];
                        }
                    }
                }
            }
        };
        let n = moving.len();
        let modes = spectrum::lowest_modes(n, &mut |v, y| apply(v, y, false), &[], n_tones);
        let mut image = vec![0.0; n];
        let tone = |mode: spectrum::Mode| {
            apply(&mode.vector, &mut image, true);
            let z: f64 = mode
                .vector
                .iter()
                .zip(&image)
                .map(|(v, image)| v * image)
                .sum();
            let sigma = 0.5 * z;
            let squared = mode.lambda - sigma * sigma;
            Tone {
                f: squared.max(0.0).sqrt() / std::f64::consts::TAU,
                t60: if sigma > 0.0 {
                    LN_1000 / sigma
                } else {
                    f64::INFINITY
                },
            }
        };
        modes.into_iter().map(tone).collect()
    }

    /// Frequency [Hz] of the highest mode of the STRING or PLATE that begins at index `first`, without losses, and
    /// without its links to other modules.
    pub fn highest_mode(&self, first: usize) -> f64 {
        let (mats, n) = (self.mats(), self.count(first));
        let own = first..first + n;
        let root: Vec<f64> = mats.m[own.clone()].iter().map(|m| m.sqrt()).collect();
        let outside = |point: usize| !own.contains(&point) && mats.kind[point].moves();
        let mut apply = |v: &[f64], y: &mut [f64]| {
            y.fill(0.0);
            let at = |point: usize| match own.contains(&point) {
                true => v[point - first] / root[point - first],
                false => 0.0,
            };
            for run in self.runs() {
                let stiffness = match &run.kind {
                    LinkKind::Ref => run.k,
                    LinkKind::Lnl(law) => law.slope(0.0),
                    LinkKind::But(_) => continue,
                };
                for (a, b) in (0..run.len).map(|i| (run.a + i, run.b + i)) {
                    if !(own.contains(&a) || own.contains(&b)) || outside(a) || outside(b) {
                        continue;
                    }
                    let pull = stiffness * (at(b) - at(a));
                    for (end, pull) in [(a, -pull), (b, pull)] {
                        if own.contains(&end) {
                            y[end - first] += pull / root[end - first];
                        }
                    }
                }
            }
        };
        spectrum::largest(n, &mut apply).theta.max(0.0).sqrt() / std::f64::consts::TAU
    }
}
