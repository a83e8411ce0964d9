//! Partition of a large mesh into ranges of MATs, each with all springs that pull on it: one thread computes a range.
//!
//! A spring between two ranges is computed in both. Every MAT thus sums the same forces in the same order as in a
//! single pass over the mesh, and the result has the same bits.

use std::mem::take;
use std::ops::Range;

use super::springs::{ForcePart, SpringPass};
use super::thread_team::ThreadTeam;
use crate::scheme::{ForceEnds, FusedSprings, Spring};

/// Largest number of ranges.
const RANGES_MAX: usize = 8;
/// Smallest number of MATs in a range. In a mesh of fewer than 1,000 MATs two threads gain nothing: they wait for each
/// other as long as they work (`python -m benches mesh_methods`). From 2,000 MATs on they always gain.
pub(crate) const RANGE_MATS_MIN: usize = 1_000;

/// The ranges of a mesh, in order.
#[derive(Clone, Debug)]
pub(crate) struct MeshPartition(Vec<MeshRange>);

/// A range of MATs, and its slices of the arrays that the pass changes.
type MatRange<'a, const N: usize> = (Range<usize>, [&'a mut [f64]; N]);

#[derive(Clone, Debug)]
struct MeshRange {
    /// The MATs of the range.
    mats: Range<usize>,
    /// Pieces of the runs that pull on these MATs; each adds to forces of this range only.
    springs: FusedSprings,
    pass: SpringPass,
}

impl MeshPartition {
    /// Whether a mesh is large enough for threads to save time.
    pub(crate) fn may_divide(n_mat: usize) -> bool {
        n_mat >= 2 * RANGE_MATS_MIN
    }

    /// The partition for a number of threads; `None` if the mesh is too small for threads to save time.
    pub(crate) fn for_threads(springs: &[Spring], n_mat: usize, threads: usize) -> Option<Self> {
        let range_count = threads.min(n_mat / RANGE_MATS_MIN).min(RANGES_MAX);
        (Self::may_divide(n_mat) && range_count > 1 && !springs.is_empty())
            .then(|| Self::new(springs, n_mat, range_count))
    }

    /// The partition into `parts` ranges with about equal work.
    pub(super) fn new(springs: &[Spring], n_mat: usize, parts: usize) -> Self {
        // Work of a MAT: 1, plus 1 for each end of a spring on it.
        let mut mat_work = vec![1_usize; n_mat];
        for run in springs {
            for first_mat in [run.a, run.b] {
                mat_work[first_mat..][..run.len].iter_mut().for_each(|n| *n += 1);
            }
        }
        let total_work: usize = mat_work.iter().sum();
        let (mut mesh_ranges, mut summed_work, mut first_mat) = (Vec::new(), 0, 0);
        for (mat, mat_work) in mat_work.iter().enumerate() {
            summed_work += mat_work;
            if summed_work * parts >= total_work * (mesh_ranges.len() + 1) || mat + 1 == n_mat {
                mesh_ranges.push(MeshRange::new(springs, first_mat..mat + 1));
                first_mat = mat + 1;
            }
        }
        Self(mesh_ranges)
    }

    /// Keep the ranges and use other springs.
    pub(crate) fn set_springs(&mut self, springs: &[Spring]) {
        for range in &mut self.0 {
            *range = MeshRange::new(springs, range.mats.clone());
        }
    }

    /// Set `force` to the sum of forces on each MAT [N], (n_mat), at positions and velocities (per step) `motion`.
    pub(crate) fn forces(
        &mut self,
        team: &mut ThreadTeam<'_>,
        part: ForcePart,
        motion: [&[f64]; 2],
        force: &mut [f64],
    ) {
        let mut range_parts: [Option<(&mut MeshRange, &mut [f64])>; RANGES_MAX] = [const { None }; RANGES_MAX];
        let (range_count, mut forces_left) = (self.0.len(), force);
        for (range_part, range) in range_parts.iter_mut().zip(&mut self.0) {
            let (range_forces, later_forces) = forces_left.split_at_mut(range.mats.len());
            (*range_part, forces_left) = (Some((range, range_forces)), later_forces);
        }
        team.for_each(&mut range_parts[..range_count], |range_part| {
            if let Some((MeshRange { springs, pass, .. }, force)) = range_part {
                pass.compute_forces(part, springs, motion, force);
            }
        });
    }

    /// Call `work` for every range of MATs, with its slice of each array in `changed`, (n_mat) each.
    pub(crate) fn for_each_range<const N: usize>(
        &self,
        team: &mut ThreadTeam<'_>,
        mut changed: [&mut [f64]; N],
        work: impl Fn(Range<usize>, [&mut [f64]; N]) + Sync,
    ) {
        let mut range_parts: [Option<MatRange<'_, N>>; RANGES_MAX] = [const { None }; RANGES_MAX];
        let range_count = self.0.len();
        for (part, range) in range_parts.iter_mut().zip(&self.0) {
            let range_slices = changed.each_mut().map(|array_left| {
                let (range_slices, later_mats) = take(array_left).split_at_mut(range.mats.len());
                *array_left = later_mats;
                range_slices
            });
            *part = Some((range.mats.clone(), range_slices));
        }
        team.for_each(&mut range_parts[..range_count], |part| {
            if let Some((mats, range_slices)) = part {
                work(
                    mats.clone(),
                    range_slices.each_mut().map(|range_slices| &mut **range_slices),
                );
            }
        });
    }
}

impl MeshRange {
    fn new(springs: &[Spring], mats: Range<usize>) -> Self {
        let mut run_ranges = Vec::new();
        for run in springs {
            // Links whose end lies in this range.
            let links_ending = |end: usize| {
                let link_index = |mat: usize| mat.saturating_sub(end).min(run.len);
                link_index(mats.start)..link_index(mats.end)
            };
            let (links_at_a, links_at_b) = (links_ending(run.a), links_ending(run.b));
            let links_at_both = links_at_a.start.max(links_at_b.start)..links_at_a.end.min(links_at_b.end);
            let [links_only_at_a, links_only_at_b] =
                [&links_at_a, &links_at_b].map(|links_at_end| range_without(links_at_end, &links_at_both));
            let local_mat = |end: usize, i: usize| end + i - mats.start;
            // A MAT that is an end a of one link and an end b of another adds its force as end a first, as in the
            // undivided run.
            run_ranges.extend(run.links_of_run(links_only_at_a, |i| ForceEnds::A(local_mat(run.a, i))));
            run_ranges.extend(run.links_of_run(links_at_both, |i| {
                ForceEnds::Both(local_mat(run.a, i), local_mat(run.b, i))
            }));
            run_ranges.extend(run.links_of_run(links_only_at_b, |i| ForceEnds::B(local_mat(run.b, i))));
        }
        Self {
            pass: SpringPass::new(&run_ranges, mats.len()),
            mats,
            springs: FusedSprings::new(run_ranges),
        }
    }
}

/// `full_range` without `removed_range`, which lies at one end of `full_range`.
fn range_without(full_range: &Range<usize>, removed_range: &Range<usize>) -> Range<usize> {
    if removed_range.is_empty() {
        full_range.clone()
    } else if removed_range.start == full_range.start {
        removed_range.end..full_range.end
    } else {
        full_range.start..removed_range.start
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chance::Chance;

    const N_MAT: usize = 90;

    /// Runs of all lengths: with ends that overlap, with ends that do not, and with end b before end a.
    fn springs(seed: i128) -> Vec<Spring> {
        let mut chance = Chance::new(seed, "halves", "", 0, 0);
        let mut random_below = |n: usize| chance.uniform(0.0, n as f64) as usize;
        (0..40)
            .map(|_| {
                let (a, b) = (random_below(N_MAT), random_below(N_MAT - 1));
                let b = b + usize::from(b >= a);
                Spring {
                    a,
                    b,
                    len: 1 + random_below(N_MAT - a.max(b)),
                    k: 1.0 / (1.0 + a as f64),
                    q: (a % 2) as f64,
                    z: 1.0 / (2.0 + b as f64),
                    rest: 0.1,
                    force_ends: ForceEnds::Both(a, b),
                }
            })
            .collect()
    }

    fn numbers(name: &str) -> Vec<f64> {
        let mut chance = Chance::new(1, "halves", name, 0, 0);
        (0..N_MAT).map(|_| chance.uniform(-1.0, 1.0)).collect()
    }

    /// The order of summation, and with it every bit, does not depend on the number of threads.
    #[test]
    fn partitioned_forces_have_the_same_bits() {
        let (x, v) = (numbers("x"), numbers("v"));
        for seed in 0..50 {
            let springs = FusedSprings::new(springs(seed));
            let mut full_force = vec![f64::NAN; N_MAT];
            SpringPass::new(&springs, N_MAT).compute_forces(ForcePart::Total, &springs, [&x, &v], &mut full_force);
            for (parts, threads) in [(2, 1), (2, 2), (3, 2), (5, 3), (RANGES_MAX, 1)] {
                let mut mesh_partition = MeshPartition::new(&springs, N_MAT, parts);
                assert!(mesh_partition.0.len() > 1);
                let mut range_force = vec![f64::NAN; N_MAT];
                ThreadTeam::with_threads(threads, |team| {
                    mesh_partition.forces(team, ForcePart::Total, [&x, &v], &mut range_force);
                });
                let force_bits = |force: &[f64]| force.iter().map(|f| f.to_bits()).collect::<Vec<_>>();
                assert_eq!(force_bits(&range_force), force_bits(&full_force), "{seed} {parts}");
            }
        }
    }

    #[test]
    fn partition_ranges_cover_all_mats_in_order() {
        for parts in 2..=RANGES_MAX {
            let mesh_partition = MeshPartition::new(&springs(3), N_MAT, parts);
            assert!(mesh_partition.0.len() <= parts);
            let (mut mat_number, mut visit_count) = (vec![0.0; N_MAT], vec![0.0; N_MAT]);
            mesh_partition.for_each_range(
                &mut ThreadTeam::alone(),
                [&mut mat_number, &mut visit_count],
                |mats, [mat_number, visit_count]| {
                    visit_count.iter_mut().for_each(|visit_count| *visit_count += 1.0);
                    mat_number
                        .iter_mut()
                        .zip(mats)
                        .for_each(|(mat_number, mat)| *mat_number = mat as f64);
                },
            );
            assert_eq!(visit_count, [1.0; N_MAT]);
            assert!((0..N_MAT).all(|mat| mat_number[mat] == mat as f64));
        }
    }
}
