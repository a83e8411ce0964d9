//! A large mesh cut into ranges of MATs, each with all springs that pull on it: a thread for each.
//!
//! A spring between two ranges is computed for both. So every MAT adds the same forces up in the same order as
//! in one pass over the whole, and the bits are the same.

use std::mem::take;
use std::ops::Range;

use super::thread_team::ThreadTeam;
use crate::scheme::{Pull, Spring};

/// Ranges at most.
const MOST: usize = 8;
/// MATs of a range at least. Two threads gain nothing below 1,000 MATs, where they wait for each other as long as they
/// work (`integrate::tests::cost::of_a_crew`); twice that is sure to gain.
pub(crate) const LEAST: usize = 1_000;

/// The ranges of a mesh, in order.
#[derive(Clone, Debug)]
pub(crate) struct MeshPartition(Vec<Half>);

/// MATs, and their part of what is changed.
type Part<'a, const N: usize> = (Range<usize>, [&'a mut [f64]; N]);

#[derive(Clone, Debug)]
struct Half {
    /// Its MATs.
    mats: Range<usize>,
    /// Pieces of the runs that pull on them, into forces of its own MATs alone.
    springs: Vec<Spring>,
    /// Forces of one run   (longest run)
    room: Vec<f64>,
}

impl MeshPartition {
    /// A mesh cut for so many threads; `None` where it is too small to gain by that.
    pub(crate) fn of(springs: &[Spring], n_mat: usize, threads: usize) -> Option<Self> {
        let parts = threads.min(n_mat / LEAST).min(MOST);
        (parts > 1 && !springs.is_empty()).then(|| Self::cut(springs, n_mat, parts))
    }

    /// In so many ranges, of about as much work each.
    pub(super) fn cut(springs: &[Spring], n_mat: usize, parts: usize) -> Self {
        // A MAT counts as one, each end of a spring at it as one.
        let mut work = vec![1_usize; n_mat];
        for run in springs {
            for first in [run.a, run.b] {
                work[first..][..run.len].iter_mut().for_each(|n| *n += 1);
            }
        }
        let all: usize = work.iter().sum();
        let (mut mesh_partition, mut done, mut first) = (Vec::new(), 0, 0);
        for (mat, work) in work.iter().enumerate() {
            done += work;
            if done * parts >= all * (mesh_partition.len() + 1) || mat + 1 == n_mat {
                mesh_partition.push(Half::of(springs, first..mat + 1));
                first = mat + 1;
            }
        }
        Self(mesh_partition)
    }

    /// The same ranges, with other springs.
    pub(crate) fn cut_again(&mut self, springs: &[Spring]) {
        for half in &mut self.0 {
            *half = Half::of(springs, half.mats.clone());
        }
    }

    /// `work` on the springs of every range, with room, into its part of the forces, which start from 0 (n_mat).
    pub(crate) fn forces(
        &mut self,
        team: &mut ThreadTeam<'_>,
        force: &mut [f64],
        work: impl Fn(&[Spring], &mut [f64], &mut [f64]) + Sync,
    ) {
        let mut parts: [Option<(&mut Half, &mut [f64])>; MOST] = [const { None }; MOST];
        let (n, mut rest) = (self.0.len(), force);
        for (part, half) in parts.iter_mut().zip(&mut self.0) {
            let (own, others) = rest.split_at_mut(half.mats.len());
            (*part, rest) = (Some((half, own)), others);
        }
        team.each(&mut parts[..n], |part| {
            if let Some((Half { springs, room, .. }, force)) = part {
                force.fill(0.0);
                work(springs, room, force);
            }
        });
    }

    /// `work` on every range of MATs and its part of what is changed   (n_mat each).
    pub(crate) fn ranges<const N: usize>(
        &self,
        team: &mut ThreadTeam<'_>,
        mut changed: [&mut [f64]; N],
        work: impl Fn(Range<usize>, [&mut [f64]; N]) + Sync,
    ) {
        let mut parts: [Option<Part<'_, N>>; MOST] = [const { None }; MOST];
        let n = self.0.len();
        for (part, half) in parts.iter_mut().zip(&self.0) {
            let own = changed.each_mut().map(|all| {
                let (own, others) = take(all).split_at_mut(half.mats.len());
                *all = others;
                own
            });
            *part = Some((half.mats.clone(), own));
        }
        team.each(&mut parts[..n], |part| {
            if let Some((mats, own)) = part {
                work(mats.clone(), own.each_mut().map(|own| &mut **own));
            }
        });
    }
}

impl Half {
    fn of(springs: &[Spring], mats: Range<usize>) -> Self {
        let mut own = Vec::new();
        for run in springs {
            // Links whose end lies here.
            let links = |end: usize| {
                let link = |mat: usize| mat.saturating_sub(end).min(run.len);
                link(mats.start)..link(mats.end)
            };
            let (a, b) = (links(run.a), links(run.b));
            let both = a.start.max(b.start)..a.end.min(b.end);
            let [only_a, only_b] = [&a, &b].map(|own| without(own, &both));
            let to = |end: usize, i: usize| end + i - mats.start;
            // A MAT that is at an end a and at an end b of a run feels its a first, as in the whole run.
            own.extend(run.piece(only_a, |i| Pull::A(to(run.a, i))));
            own.extend(run.piece(both, |i| Pull::Both(to(run.a, i), to(run.b, i))));
            own.extend(run.piece(only_b, |i| Pull::B(to(run.b, i))));
        }
        let longest = own.iter().map(|run| run.len).max();
        Self {
            mats,
            springs: own,
            room: vec![0.0; longest.unwrap_or(0)],
        }
    }
}

/// What of `all` is not in `part`, which lies at one of its ends.
fn without(all: &Range<usize>, part: &Range<usize>) -> Range<usize> {
    if part.is_empty() {
        all.clone()
    } else if part.start == all.start {
        part.end..all.end
    } else {
        all.start..part.start
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chance::Chance;
    use crate::kernel::springs::total;

    const N_MAT: usize = 90;

    /// Runs of all lengths that overlap themselves, that do not, and that go backwards.
    fn springs(seed: i128) -> Vec<Spring> {
        let mut chance = Chance::new(seed, "halves", "", 0, 0);
        let mut below = |n: usize| chance.uniform(0.0, n as f64) as usize;
        (0..40)
            .map(|_| {
                let (a, b) = (below(N_MAT), below(N_MAT - 1));
                let b = b + usize::from(b >= a);
                Spring {
                    a,
                    b,
                    len: 1 + below(N_MAT - a.max(b)),
                    k: 1.0 / (1.0 + a as f64),
                    q: (a % 2) as f64,
                    z: 1.0 / (2.0 + b as f64),
                    rest: 0.1,
                    pull: Pull::Both(a, b),
                }
            })
            .collect()
    }

    fn numbers(name: &str) -> Vec<f64> {
        let mut chance = Chance::new(1, "halves", name, 0, 0);
        (0..N_MAT).map(|_| chance.uniform(-1.0, 1.0)).collect()
    }

    /// A sum in another order is another sum: here it is the same one, whoever adds it up.
    #[test]
    fn every_mat_feels_the_same_bits() {
        let (x, v) = (numbers("x"), numbers("v"));
        for seed in 0..50 {
            let springs = springs(seed);
            let (mut whole, mut room) = (vec![0.0; N_MAT], vec![0.0; N_MAT]);
            total(&springs, &x, &v, &mut room, &mut whole);
            for (parts, threads) in [(2, 1), (2, 2), (3, 2), (5, 3), (MOST, 1)] {
                let mut mesh_partition = MeshPartition::cut(&springs, N_MAT, parts);
                assert!(mesh_partition.0.len() > 1);
                let mut found = vec![f64::NAN; N_MAT];
                ThreadTeam::with(threads, |team| {
                    mesh_partition.forces(team, &mut found, |springs, room, force| {
                        total(springs, &x, &v, room, force);
                    });
                });
                let bits = |force: &[f64]| force.iter().map(|f| f.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(&found), bits(&whole), "{seed} {parts}");
            }
        }
    }

    #[test]
    fn ranges_are_all_mats_in_order() {
        for parts in 2..=MOST {
            let mesh_partition = MeshPartition::cut(&springs(3), N_MAT, parts);
            assert!(mesh_partition.0.len() <= parts);
            let (mut x, mut seen) = (vec![0.0; N_MAT], vec![0.0; N_MAT]);
            mesh_partition.ranges(
                &mut ThreadTeam::alone(),
                [&mut x, &mut seen],
                |mats, [x, seen]| {
                    seen.iter_mut().for_each(|seen| *seen += 1.0);
                    x.iter_mut().zip(mats).for_each(|(x, mat)| *x = mat as f64);
                },
            );
            assert_eq!(seen, [1.0; N_MAT]);
            assert!((0..N_MAT).all(|mat| x[mat] == mat as f64));
        }
    }
}
