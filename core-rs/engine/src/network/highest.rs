//! The highest mode of a STRING or PLATE by itself.

use super::{LinkKind, Network};
use crate::spectrum;

impl Network {
    /// Frequency [Hz] of the highest mode of the STRING or PLATE that begins at index `first`, without losses, and
    /// without its links to other modules.
    pub fn highest_mode(&self, first: usize) -> f64 {
        let (mats, n) = (self.mats(), self.count(first));
        let mats_range = first..first + n;
        let root: Vec<f64> = mats.m[mats_range.clone()]
            .iter()
            .map(|m| m.sqrt())
            .collect();
        let outside = |point: usize| !mats_range.contains(&point) && mats.kind[point].moves();
        let mut apply = |v: &[f64], y: &mut [f64]| {
            y.fill(0.0);
            let value = |point: usize| match mats_range.contains(&point) {
                true => v[point - first] / root[point - first],
                false => 0.0,
            };
            for run in self.runs() {
                let stiffness = match &run.kind {
                    LinkKind::Ref | LinkKind::Bristle(_) => run.k,
                    LinkKind::Lnl(law) => law.slope(0.0),
                    // A STRING or PLATE has none of these.
                    LinkKind::But(_)
                    | LinkKind::Followed(_)
                    | LinkKind::Dry(_)
                    | LinkKind::Space(_)
                    | LinkKind::Pairwise(_) => continue,
                };
                for (a, b) in (0..run.len).map(|i| (run.a + i, run.b + i)) {
                    if !(mats_range.contains(&a) || mats_range.contains(&b))
                        || outside(a)
                        || outside(b)
                    {
                        continue;
                    }
                    let pull = stiffness * (value(b) - value(a));
                    for (end, pull) in [(a, -pull), (b, pull)] {
                        if mats_range.contains(&end) {
                            y[end - first] += pull / root[end - first];
                        }
                    }
                }
            }
        };
        spectrum::largest(n, &mut apply).theta.max(0.0).sqrt() / std::f64::consts::TAU
    }
}
