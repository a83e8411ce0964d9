//! MATs that links join, by union-find.

use super::Network;

/// A forest over the MATs.
pub(crate) struct Forest(Vec<u32>);

impl Forest {
    /// Every MAT by itself.
    pub(crate) fn new(n_mat: usize) -> Self {
        Self((0..n_mat as u32).collect())
    }

    /// The representative of the MATs that are joined with this one.
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
        // The lower index represents: sets come in the order of their first MATs.
        self.0[i.max(j)] = i.min(j) as u32;
    }
}

/// Every link with its two ends.
pub(crate) fn ends(network: &Network) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
    let runs = network.runs().iter();
    runs.flat_map(|run| (0..run.len).map(|i| (run.first + i, run.a + i, run.b + i)))
}
