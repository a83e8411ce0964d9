//! Sets of linked MATs, by union-find.

use super::{AXES_MAX, Network, Run};
use crate::interrupt;

/// A forest over the MATs.
pub(crate) struct Forest(Vec<u32>);

impl Forest {
    /// Each MAT in a set of its own.
    pub(crate) fn new(n_mat: usize) -> Self {
        Self((0..n_mat as u32).collect())
    }

    /// The representative of the set that holds a MAT.
    pub(crate) fn root(&mut self, mut i: usize) -> usize {
        while self.0[i] as usize != i {
            self.0[i] = self.0[self.0[i] as usize];
            i = self.0[i] as usize;
        }
        i
    }

    /// Join the sets of two MATs.
    pub(crate) fn join(&mut self, first_mat: usize, second_mat: usize) {
        let (first_mat, second_mat) = (self.root(first_mat), self.root(second_mat));
        // The lower index becomes the representative, so that sets come in the order of their first MATs.
        self.0[first_mat.max(second_mat)] = first_mat.min(second_mat) as u32;
    }
}

/// Each link with its two ends; a link in space appears once per axis.
pub(crate) fn link_ends(network: &Network) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
    let link_runs = network.runs().iter();
    link_runs.flat_map(|run| {
        interrupt::steps(0..run.len).flat_map(move |i| run.pairs(i).map(move |(a, b)| (run.first + i, a, b)))
    })
}

/// Pairs of MATs that influence each other: both ends of a link, the coordinates of each end, a proxy and its masses
/// and guides, and anything that follows a MAT and that MAT.
pub(crate) fn joined_pairs(network: &Network) -> impl Iterator<Item = (usize, usize)> + '_ {
    let space_runs = network.runs().iter().filter(|run| run.n_axes() > 1);
    let coordinates = space_runs.flat_map(|run| {
        interrupt::steps(0..run.len).flat_map(move |i| {
            let (first_mat, second_mat) = run.pair(i, 0);
            let other_mats = run.pairs(i).skip(1);
            other_mats.flat_map(move |(other_a, other_b)| [(first_mat, other_a), (second_mat, other_b)])
        })
    });
    // Points of a group influence each other through the points that they touch.
    let crowds = network.runs().iter().filter_map(Run::pairwise);
    let crowds = crowds.flat_map(|run| {
        let group_spans = [(run.a, run.pairs.n_first), (run.b, run.n_second)];
        group_spans
            .into_iter()
            .flat_map(|(first, n)| interrupt::steps(first + 1..first + n).map(move |mat| (first, mat)))
    });
    let proxies = network.proxies().iter().flat_map(|proxy| {
        let other_mats = proxy.masses().chain(proxy.guide_mats());
        other_mats.map(|mat| (proxy.mat, mat))
    });
    let ends = link_ends(network).map(|(_, first_mat, second_mat)| (first_mat, second_mat));
    ends.chain(coordinates)
        .chain(crowds)
        .chain(proxies)
        .chain(network.follower_pairs())
}

/// The MATs of each link, axis by axis: its first end, then its second.
pub(crate) fn link_mats(network: &Network) -> impl Iterator<Item = (usize, LinkMats)> + '_ {
    let link_runs = network.runs().iter();
    link_runs.flat_map(|run| {
        interrupt::steps(0..run.len).map(move |i| {
            let mut link_mats = LinkMats::default();
            run.pairs(i).for_each(|(a, b)| link_mats.extend([a, b]));
            (run.first + i, link_mats)
        })
    })
}

/// The MATs of one link.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LinkMats {
    mats: [usize; 2 * AXES_MAX],
    len: usize,
}

impl LinkMats {
    fn extend(&mut self, pair: [usize; 2]) {
        self.mats[self.len..self.len + 2].copy_from_slice(&pair);
        self.len += 2;
    }

    pub(crate) fn as_slice(&self) -> &[usize] {
        &self.mats[..self.len]
    }
}
