//! Damping of a linear body that is no sum of its mass and stiffness, and yet has its modes: Z·M⁻¹·K = K·M⁻¹·Z.
//!
//! Each mode then loses by itself. How much is seen without the modes' shapes: where a vector r has the share φ·r of a
//! mode, Z·r has ζ times that share.

use crate::network::{LinkKind, MatKind, Network};

/// How many vectors tell the loss of each mode: one may have nothing of a mode.
pub(crate) const PROBES: usize = 3;
/// Relative difference at which two matrices commute: what the rounding of a fit leaves.
const SAME: f64 = 1e-9;
/// Likewise of the losses that several vectors tell; modes of nearly one frequency mix.
const AGREE: f64 = 1e-6;

/// One end and its share, the other (none where it is held) and its share, z.
type Damper = (usize, f64, Option<(usize, f64)>, f64);

/// M^-½ Z M^-½ of a body.
pub(crate) struct Viscosity {
    /// Of each mass by itself   (n)
    ties: Vec<f64>,
    links: Vec<Damper>,
}

impl Viscosity {
    /// `None` where a link is not linear, or a damper is no number.
    pub(crate) fn new(network: &Network, free: &[usize], root: &[f64]) -> Option<Self> {
        let mats = network.mats();
        let slot = |mat: usize| free.binary_search(&mat).ok();
        let tie = |(own, &i): (usize, &usize)| match mats.kind[i] {
            MatKind::Cel => mats.z[i] / (root[own] * root[own]),
            _ => 0.0,
        };
        let ties: Vec<f64> = free.iter().enumerate().map(tie).collect();
        let mut links = Vec::new();
        for run in network.runs() {
            if !matches!(run.kind, LinkKind::Ref) || !run.z.is_finite() {
                return None;
            }
            for i in (0..run.len).filter(|_| run.z != 0.0) {
                let ends = [slot(run.a + i), slot(run.b + i)];
                let share = |end: usize| (end, 1.0 / root[end]);
                let (own, other) = match ends {
                    [Some(a), b] => (share(a), b.map(share)),
                    [None, Some(b)] => (share(b), None),
                    [None, None] => continue,
                };
                links.push((own.0, own.1, other, run.z));
            }
        }
        Some(Self { ties, links })
    }

    /// Z·v.
    pub(crate) fn times(&self, v: &[f64]) -> Vec<f64> {
        let mut y: Vec<f64> = self.ties.iter().zip(v).map(|(tie, v)| tie * v).collect();
        for &(a, share, other, z) in &self.links {
            let there = other.map_or(0.0, |(b, share)| share * v[b]);
            let pull = z * (share * v[a] - there);
            y[a] += share * pull;
            if let Some((b, share)) = other {
                y[b] -= share * pull;
            }
        }
        y
    }

    /// Whether it has the modes of a stiffness (n, n), as far as one vector tells.
    pub(crate) fn shares_modes(&self, stiffness: &[f64]) -> bool {
        let n = self.ties.len();
        let product = |v: &[f64]| -> Vec<f64> {
            let row = |row: &[f64]| row.iter().zip(v).map(|(a, v)| a * v).sum();
            stiffness.chunks_exact(n).map(row).collect()
        };
        let v = probe(n, 0);
        let (one, two) = (product(&self.times(&v)), self.times(&product(&v)));
        let size: f64 = one.iter().map(|value| value * value).sum();
        let apart = one
            .iter()
            .zip(&two)
            .map(|(one, two)| (one - two) * (one - two));
        apart.sum::<f64>() <= SAME * SAME * size
    }

    /// ζ of each mode, from what each sees of [`probe`]s and of Z times these; `None` where they do not agree.
    pub(crate) fn of_modes(probes: &[Vec<f64>], images: &[Vec<f64>]) -> Option<Vec<f64>> {
        let n = probes.first()?.len();
        let mut zeta = vec![0.0; n];
        let largest = images
            .iter()
            .flatten()
            .fold(0.0, |most: f64, value| most.max(value.abs()));
        for (mode, zeta) in zeta.iter_mut().enumerate() {
            let pairs = || probes.iter().zip(images).map(|(p, i)| (p[mode], i[mode]));
            let square: f64 = pairs().map(|(probe, _)| probe * probe).sum();
            *zeta = pairs().map(|(probe, image)| probe * image).sum::<f64>() / square;
            let agree =
                pairs().all(|(probe, image)| (image - *zeta * probe).abs() <= AGREE * largest);
            if !(agree && *zeta >= 0.0) {
                return None;
            }
        }
        Some(zeta)
    }
}

/// Numbers between -1 and 1 without a pattern (n,).
pub(crate) fn probe(n: usize, which: usize) -> Vec<f64> {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64.wrapping_mul(which as u64 + 1);
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    (0..n).map(|_| next()).collect()
}
