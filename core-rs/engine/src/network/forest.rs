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
    pub(crate) fn join(&mut self, i: usize, j: usize) {
        let (i, j) = (self.root(i), self.root(j));
        // The lower index becomes the representative, so that sets come in the order of their first MATs.
        self.0[i.max(j)] = i.min(j) as u32;
    }
}

/// Each link with its two ends; a link in space appears once per axis.
pub(crate) fn ends(network: &Network) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
    let runs = network.runs().iter();
    runs.flat_map(|run| {
        interrupt::steps(0..run.len)
            .flat_map(move |i| run.pairs(i).map(move |(a, b)| (run.first + i, a, b)))
    })
}

/// Pairs of MATs that influence each other: both ends of a link, the coordinates of each end, a proxy and its masses
/// and guides, and anything that follows a MAT and that MAT.
pub(crate) fn joined(network: &Network) -> impl Iterator<Item = (usize, usize)> + '_ {
    let runs = network.runs().iter().filter(|run| run.n_axes() > 1);
    let coordinates = runs.flat_map(|run| {
        interrupt::steps(0..run.len).flat_map(move |i| {
            let (a, b) = run.pair(i, 0);
            let others = run.pairs(i).skip(1);
            others.flat_map(move |(other_a, other_b)| [(a, other_a), (b, other_b)])
        })
    });
    // Points of a group influence each other through the points that they meet.
    let crowds = network.runs().iter().filter_map(Run::pairwise);
    let crowds = crowds.flat_map(|run| {
        let groups = [(run.a, run.pairs.n_first), (run.b, run.n)];
        groups.into_iter().flat_map(|(first, n)| {
            interrupt::steps(first + 1..first + n).map(move |mat| (first, mat))
        })
    });
    let proxies = network.proxies().iter().flat_map(|proxy| {
        let others = proxy.masses().chain(proxy.guides());
        others.map(|mat| (proxy.mat, mat))
    });
    let ends = ends(network).map(|(_, a, b)| (a, b));
    ends.chain(coordinates)
        .chain(crowds)
        .chain(proxies)
        .chain(network.followed())
}

/// The MATs of each link, axis by axis: its first end, then its second.
pub(crate) fn links(network: &Network) -> impl Iterator<Item = (usize, LinkMats)> + '_ {
    let runs = network.runs().iter();
    runs.flat_map(|run| {
        interrupt::steps(0..run.len).map(move |i| {
            let mut mats = LinkMats::default();
            run.pairs(i).for_each(|(a, b)| mats.extend([a, b]));
            (run.first + i, mats)
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

    pub(crate) fn all(&self) -> &[usize] {
        &self.mats[..self.len]
    }
}
