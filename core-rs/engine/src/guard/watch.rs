//! Links that stiffen: the largest elongation that each run may have, and how much λ rises by their stiffening.

use std::ops::Range;
use std::sync::Arc;

use crate::law::Law;
use crate::maths::wide::wide;
use crate::scheme::{LinkRun, LinkRunKind};

/// A run of links that stiffen.
#[derive(Clone, Debug)]
pub(super) struct WatchedRun {
    pub(super) a: usize,
    pub(super) b: usize,
    pub(super) len: usize,
    rest_length: f64,
    stiffening: Stiffening,
    /// Largest elongation [m]: while no link of any run exceeds its reach, λ is within the limit.
    reach: f64,
}

/// The law by which a link stiffens.
#[derive(Clone, Debug)]
enum Stiffening {
    /// The stiffness rises by this times the elongation squared [N/m³].
    Square(f64),
    /// Any law, and its stiffness at rest [N/m].
    Law(Arc<Law>, f64),
    /// Any of several laws, and the greatest of their stiffnesses at rest [N/m].
    AnyLaw(Vec<Law>, f64),
}

impl Stiffening {
    fn from_kind(kind: &LinkRunKind) -> Option<Self> {
        if let LinkRunKind::Followed { law: following, .. } = kind {
            let end_value_laws: Vec<Law> = following.end_value_laws().collect();
            let rest_slopes = end_value_laws.iter().map(|law| law.slope(0.0));
            let slope_at_rest = rest_slopes.fold(0.0, f64::max);
            return Some(Self::AnyLaw(end_value_laws, slope_at_rest));
        }
        let LinkRunKind::Lnl { law, .. } = kind else {
            return None;
        };
        match law.hardening_spring() {
            Some(spring) => (spring.q > 0.0).then_some(Self::Square(3.0 * spring.q)),
            None => Some(Self::Law(law.clone(), law.slope(0.0).max(0.0))),
        }
    }

    /// Stiffness at elongation `e` minus stiffness at rest [N/m].
    #[inline(always)]
    fn stiffness_rise(&self, e: f64) -> f64 {
        match self {
            Self::Square(square_coefficient) => square_coefficient * (e * e),
            Self::Law(law, rest_slope) => (law.slope(e) - rest_slope).max(0.0),
            Self::AnyLaw(laws, rest_slope) => {
                let law_slopes = laws.iter().map(|law| law.slope(e));
                law_slopes.fold(*rest_slope, f64::max) - rest_slope
            }
        }
    }

    /// The largest elongation [m], either way, at which the stiffness has risen by no more than `stiffness_rise` [N/m].
    fn reach(&self, stiffness_rise: f64) -> f64 {
        match self {
            Self::Square(square_coefficient) => (stiffness_rise / square_coefficient).sqrt(),
            Self::Law(law, rest_slope) => law.elongation_at_slope(rest_slope + stiffness_rise),
            Self::AnyLaw(laws, rest_slope) => {
                let reaches = laws
                    .iter()
                    .map(|law| law.elongation_at_slope(rest_slope + stiffness_rise));
                reaches.fold(f64::INFINITY, f64::min)
            }
        }
    }
}

/// Runs that stiffen and have an end that moves; runs with a gate are left out.
pub(super) fn watched_runs(runs: &[LinkRun], mat_moves: impl Fn(usize) -> bool) -> Vec<WatchedRun> {
    let watched_run = |run: &LinkRun| {
        let stiffening = Stiffening::from_kind(&run.kind).filter(|_| run.gate.is_none())?;
        let mut run_ends = (0..run.len).flat_map(|i| [run.a + i, run.b + i]);
        if !run_ends.any(&mat_moves) {
            return None;
        }
        Some(WatchedRun {
            a: run.a,
            b: run.b,
            len: run.len,
            rest_length: run.rest,
            stiffening,
            reach: 0.0,
        })
    };
    runs.iter().filter_map(watched_run).collect()
}

/// Set the reach of every run such that λ rises by no more than `lambda_rise_max`, and remove runs whose stiffening
/// never raises it so much.
pub(super) fn set_reaches(watched_runs: &mut Vec<WatchedRun>, lambda_rise_max: f64, inverse_masses: &[f64]) {
    let mut link_degree = vec![0.0; inverse_masses.len()];
    for run in &*watched_runs {
        for first_mat in [run.a, run.b] {
            link_degree[first_mat..][..run.len]
                .iter_mut()
                .for_each(|degree| *degree += 1.0);
        }
    }
    // If the stiffening of each link is at most half of `lambda_rise_max`, divided by degree times 1/M at either end,
    // no edge sum exceeds `lambda_rise_max`.
    let edge_weight = |mat: usize| link_degree[mat] * inverse_masses[mat];
    for run in &mut *watched_runs {
        let end_weights = (0..run.len).map(|i| edge_weight(run.a + i).max(edge_weight(run.b + i)));
        run.reach = run
            .stiffening
            .reach(0.5 * lambda_rise_max / end_weights.fold(0.0, f64::max));
    }
    watched_runs.retain(|run| run.reach < f64::INFINITY);
}

wide! {
    /// The largest magnitude of some numbers; NaN if one is NaN.
    pub(super) fn magnitude_max(numbers: &[f64]) -> f64 {
        // The bits of positive numbers, read as integers, have the order of the numbers; those of NaN are above all
        // others.
        f64::from_bits(numbers.iter().fold(0, |peak_bits, d| d.abs().to_bits().max(peak_bits)))
    }
}

wide! {
    /// How much more the link that is nearest to its reach may be stretched [m].
    pub(super) fn least_reach_left(watched_runs: &[WatchedRun], x: &[f64]) -> f64 {
        let mut least_left = f64::INFINITY;
        for run in watched_runs {
            let WatchedRun {
                a, b, len, rest_length, ..
            } = *run;
            let (xa, xb) = (&x[a..][..len], &x[b..][..len]);
            let mut peak_bits = 0_u64;
            for i in 0..len {
                peak_bits = peak_bits.max((xb[i] - xa[i] - rest_length).abs().to_bits());
            }
            let reach_left = run.reach - f64::from_bits(peak_bits);
            // A NaN elongation is beyond every reach.
            let reach_left = if reach_left.is_nan() {
                f64::NEG_INFINITY
            } else {
                reach_left
            };
            least_left = f64::min(least_left, reach_left);
        }
        least_left
    }
}

/// A bound on the rise of λ by stiffening, and a MAT of the link where it is reached.
///
/// The bound is the largest edge sum: stiffening over mass, summed at both ends of a link. `mats` are the MATs that
/// watched links join; `sums` (n_mat) and `rises` (longest run) are buffers.
pub(super) fn lambda_rise_bound(
    watched_runs: &[WatchedRun],
    mats: &Range<usize>,
    x: &[f64],
    inverse_masses: &[f64],
    sums: &mut [f64],
    rises: &mut [f64],
) -> (f64, usize) {
    sums[mats.clone()].fill(0.0);
    for run in watched_runs {
        let (first_a, first_b) = (run.a, run.b);
        let rises = &mut rises[..run.len];
        let (positions_a, positions_b) = (&x[first_a..][..run.len], &x[first_b..][..run.len]);
        for (i, rise) in rises.iter_mut().enumerate() {
            *rise = run
                .stiffening
                .stiffness_rise(positions_b[i] - positions_a[i] - run.rest_length);
        }
        for first_mat in [first_a, first_b] {
            let sums = &mut sums[first_mat..][..run.len];
            sums.iter_mut().zip(&*rises).for_each(|(sum, rise)| *sum += rise);
        }
    }
    let (mut greatest_sum, mut worst_mat) = (0.0, mats.start);
    for run in watched_runs {
        for i in 0..run.len {
            let (mat_a, mat_b) = (run.a + i, run.b + i);
            let edge_sum = sums[mat_a] * inverse_masses[mat_a] + sums[mat_b] * inverse_masses[mat_b];
            if edge_sum > greatest_sum || edge_sum.is_nan() {
                (greatest_sum, worst_mat) = (edge_sum, if inverse_masses[mat_a] > 0.0 { mat_a } else { mat_b });
            }
            if edge_sum.is_nan() {
                return (f64::INFINITY, worst_mat);
            }
        }
    }
    (greatest_sum, worst_mat)
}
