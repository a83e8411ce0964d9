//! Modes of one part by itself, as one would measure them to tune it.

use super::{LinkKind, MatKind, Network};
use crate::spectrum::{self, general};
use crate::units::LN_1000;

/// Undamped modes that damping may couple: an eigenvalue problem of 240 states takes 0.05 s.
const COUPLED_MAX: usize = 120;
/// What damping makes of an undamped mode is the same mode, to this part of it: they are known to 1e-8.
const UNCOUPLED: f64 = 1e-6;
/// Relative to the strongest damping.
const ROUNDING: f64 = 1e-13;

/// A mode of the continuous network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Damped frequency [Hz]; 0 where damping is beyond critical.
    pub f: f64,
    /// Time to fall by 60 dB [s], beyond critical damping by the slower of two poles; infinite without loss.
    pub t60: f64,
}

impl Tone {
    /// Of a pole −`decay` ± i`omega` [1/s, rad/s].
    fn of(decay: f64, omega: f64) -> Self {
        Self {
            f: omega / std::f64::consts::TAU,
            t60: if decay > 0.0 {
                LN_1000 / decay
            } else {
                f64::INFINITY
            },
        }
    }

    /// Of s² + 2σs + λ = 0.
    fn alone(lambda: f64, sigma: f64) -> Self {
        let squared = lambda - sigma * sigma;
        if squared >= 0.0 {
            Self::of(sigma, squared.sqrt())
        } else {
            // Not the difference of two near numbers.
            Self::of(lambda / (sigma + (-squared).sqrt()), 0.0)
        }
    }
}

impl Network {
    /// The lowest modes of a part, without its links to other parts, contacts open and laws at their slope at rest.
    ///
    /// They are the complex modes, the eigenvectors of the state: exact whatever the damping, but in parts of more than
    /// 120 masses whose damping couples modes, where the 120 lowest undamped ones alone are taken.
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
                    (LinkKind::Bristle(_), false) => run.k,
                    (LinkKind::Bristle(bristle), true) => bristle.damping_at_rest(),
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
        let scattered: Vec<f64> = (0..n)
            .map(|i| if i % 2 == 0 { 1.0 } else { -1.0 })
            .collect();
        let mut image = vec![0.0; n];
        apply(&scattered, &mut image, true);
        let strongest = (dot(&image, &image) / n as f64).sqrt();
        let mut seen = |n_modes: usize| {
            let modes = spectrum::lowest_modes(n, &mut |v, y| apply(v, y, false), &[], n_modes);
            let mut damped = |mode: &spectrum::Mode| {
                apply(&mode.vector, &mut image, true);
                image.clone()
            };
            let images: Vec<Vec<f64>> = modes.iter().map(&mut damped).collect();
            (modes, images)
        };
        let (modes, images) = seen(n_tones);
        // What damping makes of a mode that it does not feel is rounding, of the size of what it makes of others.
        let least = ROUNDING * strongest;
        let mut pairs = modes.iter().zip(&images);
        if pairs.any(|(mode, image)| is_coupled(mode, image, least)) {
            let (modes, images) = seen(COUPLED_MAX.min(n).max(modes.len()));
            if let Some(mut tones) = coupled(&modes, &images) {
                tones.truncate(n_tones);
                return tones;
            }
        }
        let pairs = modes.iter().zip(&images);
        let tone = |(mode, image): (&spectrum::Mode, &Vec<f64>)| {
            Tone::alone(mode.lambda, 0.5 * dot(&mode.vector, image))
        };
        pairs.map(tone).collect()
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
                    LinkKind::Ref | LinkKind::Bristle(_) => run.k,
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

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Whether damping, of which `image` is what it makes of a mode, takes it to others by more than `least`.
fn is_coupled(mode: &spectrum::Mode, image: &[f64], least: f64) -> bool {
    let own = dot(&mode.vector, image);
    let rest = image.iter().zip(&mode.vector).map(|(z, v)| z - own * v);
    let rest: f64 = rest.map(|z| z * z).sum();
    rest > UNCOUPLED * UNCOUPLED * dot(image, image) && rest > least * least
}

/// Tones of undamped modes that damping couples, by rising |s|: of (p, v) with p = ω·q, ṗ = ω·v, v̇ = −ω·p − C·v.
fn coupled(modes: &[spectrum::Mode], images: &[Vec<f64>]) -> Option<Vec<Tone>> {
    let n = modes.len();
    let size = 2 * n;
    let mut matrix = vec![0.0; size * size];
    for (i, mode) in modes.iter().enumerate() {
        crate::interrupt::poll();
        let omega = mode.lambda.max(0.0).sqrt();
        matrix[i * size + n + i] = omega;
        matrix[(n + i) * size + i] = -omega;
        for (j, image) in images.iter().enumerate() {
            matrix[(n + i) * size + n + j] = -dot(&mode.vector, image);
        }
    }
    let values = general(matrix)?.values;
    // Of a pair that does not swing the slower pole is told: as many of them as there are modes left.
    let mut real: Vec<f64> = Vec::new();
    let mut poles: Vec<(f64, f64)> = Vec::new();
    for (re, im) in values {
        if im > 0.0 {
            poles.push((-re, im));
        } else if im == 0.0 {
            real.push(-re);
        }
    }
    real.sort_by(f64::total_cmp);
    real.truncate(n.saturating_sub(poles.len()));
    poles.extend(real.into_iter().map(|decay| (decay, 0.0)));
    let square = |(re, im): &(f64, f64)| re * re + im * im;
    poles.sort_by(|a, b| square(a).total_cmp(&square(b)));
    let tones = poles.into_iter();
    Some(tones.map(|(decay, omega)| Tone::of(decay, omega)).collect())
}
