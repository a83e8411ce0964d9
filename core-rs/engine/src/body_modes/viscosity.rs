//! Damping of a linear body that is not proportional to mass and stiffness but still has the undamped modes: Z·M⁻¹·K =
//! K·M⁻¹·Z.
//!
//! Each mode then has a loss ζ of its own. It follows without the shapes of the modes: if a vector r contains φ·r of a
//! mode, then Z·r contains ζ times that.

use crate::body_modes::constants::{MIXED_MODES_TOLERANCE, RELATIVE_TOLERANCE};
use crate::network::{LinkKind, MatKind, Network};

/// One end and its M^-½, the other end (`None` if held) and its M^-½, and z.
type Damper = (usize, f64, Option<(usize, f64)>, f64);

/// M^-½ Z M^-½ of a body.
pub(crate) struct Viscosity {
    /// Of the tie of each mass to the ground   (n)
    ties: Vec<f64>,
    links: Vec<Damper>,
}

impl Viscosity {
    /// `None` if a link is not linear, or a damper is not finite.
    pub(crate) fn new(network: &Network, free: &[usize], sqrt_masses: &[f64]) -> Option<Self> {
        let mats = network.mats();
        let slot_of_mat = |mat: usize| free.binary_search(&mat).ok();
        let tie_damping = |(free_end, &i): (usize, &usize)| match mats.kind[i] {
            MatKind::Cel => mats.z[i] / (sqrt_masses[free_end] * sqrt_masses[free_end]),
            _ => 0.0,
        };
        let ties: Vec<f64> = free.iter().enumerate().map(tie_damping).collect();
        let mut links = Vec::new();
        for run in network.runs() {
            if !matches!(run.kind, LinkKind::Ref) || !run.z.is_finite() {
                return None;
            }
            for i in (0..run.len).filter(|_| run.z != 0.0) {
                let end_slots = [slot_of_mat(run.a + i), slot_of_mat(run.b + i)];
                let end_and_factor = |end: usize| (end, 1.0 / sqrt_masses[end]);
                let (free_end, far_end) = match end_slots {
                    [Some(a), b] => (end_and_factor(a), b.map(end_and_factor)),
                    [None, Some(b)] => (end_and_factor(b), None),
                    [None, None] => continue,
                };
                links.push((free_end.0, free_end.1, far_end, run.z));
            }
        }
        Some(Self { ties, links })
    }

    /// Z·v.
    pub(crate) fn multiply(&self, v: &[f64]) -> Vec<f64> {
        let mut y: Vec<f64> = self.ties.iter().zip(v).map(|(tie, v)| tie * v).collect();
        for &(a, inverse_sqrt_mass, other, z) in &self.links {
            let far_velocity = other.map_or(0.0, |(b, inverse_sqrt_mass)| inverse_sqrt_mass * v[b]);
            let damper_force = z * (inverse_sqrt_mass * v[a] - far_velocity);
            y[a] += inverse_sqrt_mass * damper_force;
            if let Some((b, inverse_sqrt_mass)) = other {
                y[b] -= inverse_sqrt_mass * damper_force;
            }
        }
        y
    }

    /// Whether it has the modes of a stiffness (n, n), as far as one test vector shows.
    pub(crate) fn shares_modes(&self, stiffness: &[f64]) -> bool {
        let mass_count = self.ties.len();
        let product = |v: &[f64]| -> Vec<f64> {
            let row = |row: &[f64]| row.iter().zip(v).map(|(a, v)| a * v).sum();
            stiffness.chunks_exact(mass_count).map(row).collect()
        };
        let v = probe(mass_count, 0);
        let (damping_first, stiffness_first) = (product(&self.multiply(&v)), self.multiply(&product(&v)));
        let norm_square: f64 = damping_first.iter().map(|value| value * value).sum();
        let square_errors = damping_first
            .iter()
            .zip(&stiffness_first)
            .map(|(damping_first, stiffness_first)| {
                (damping_first - stiffness_first) * (damping_first - stiffness_first)
            });
        square_errors.sum::<f64>() <= RELATIVE_TOLERANCE * RELATIVE_TOLERANCE * norm_square
    }

    /// ζ of each mode, from the mode's part in each [`probe`] and in Z times the probe; `None` if the probes disagree.
    pub(crate) fn mode_damping(probes: &[Vec<f64>], images: &[Vec<f64>]) -> Option<Vec<f64>> {
        let mode_count = probes.first()?.len();
        let mut zeta = vec![0.0; mode_count];
        let largest = images
            .iter()
            .flatten()
            .fold(0.0, |largest_yet: f64, value| largest_yet.max(value.abs()));
        for (mode, zeta) in zeta.iter_mut().enumerate() {
            let probe_pairs = || probes.iter().zip(images).map(|(p, i)| (p[mode], i[mode]));
            let probe_square: f64 = probe_pairs().map(|(probe, _)| probe * probe).sum();
            *zeta = probe_pairs().map(|(probe, image)| probe * image).sum::<f64>() / probe_square;
            let probes_agree =
                probe_pairs().all(|(probe, image)| (image - *zeta * probe).abs() <= MIXED_MODES_TOLERANCE * largest);
            if !(probes_agree && *zeta >= 0.0) {
                return None;
            }
        }
        Some(zeta)
    }
}

/// Pseudo-random numbers between -1 and 1 (n,).
pub(crate) fn probe(n: usize, probe_index: usize) -> Vec<f64> {
    let mut random_state = 0x9E37_79B9_7F4A_7C15_u64.wrapping_mul(probe_index as u64 + 1);
    let mut next_random = || {
        random_state = random_state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (random_state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    (0..n).map(|_| next_random()).collect()
}
