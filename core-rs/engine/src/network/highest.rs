//! The highest mode of a STRING or PLATE by itself.

use super::{LinkKind, Network};
use crate::spectrum;

impl Network {
    /// Frequency [Hz] of the highest mode of the STRING or PLATE that begins at index `first`, without losses, and
    /// without its links to other modules.
    pub fn highest_mode(&self, first: usize) -> f64 {
        let (mats, mass_count) = (self.mats(), self.count(first));
        let mats_range = first..first + mass_count;
        let mass_roots: Vec<f64> = mats.m[mats_range.clone()].iter().map(|m| m.sqrt()).collect();
        let is_outside_and_moving = |point: usize| !mats_range.contains(&point) && mats.kind[point].moves();
        let mut apply_stiffness = |v: &[f64], y: &mut [f64]| {
            y.fill(0.0);
            let displacement = |point: usize| match mats_range.contains(&point) {
                true => v[point - first] / mass_roots[point - first],
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
                        || is_outside_and_moving(a)
                        || is_outside_and_moving(b)
                    {
                        continue;
                    }
                    let link_pull = stiffness * (displacement(b) - displacement(a));
                    for (end, link_pull) in [(a, -link_pull), (b, link_pull)] {
                        if mats_range.contains(&end) {
                            y[end - first] += link_pull / mass_roots[end - first];
                        }
                    }
                }
            }
        };
        spectrum::largest_eigenvalue(mass_count, &mut apply_stiffness)
            .theta
            .max(0.0)
            .sqrt()
            / std::f64::consts::TAU
    }
}
