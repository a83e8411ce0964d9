//! Which forces of links add up at each MAT, four MATs at a time.

use std::ops::Range;

/// Links whose forces are computed side by side: as many as the widest vectors hold.
pub(crate) const LINK_LANES: usize = 8;

/// MATs whose forces are summed side by side: a sum waits for each of its terms, four sums hardly wait.
pub(crate) const SUM_LANES: usize = 4;

/// Which forces of links add up at each MAT, in the order in which links are written.
#[derive(Clone, Debug, Default)]
pub(crate) struct ForceSums {
    pub(crate) blocks: Vec<SumBlock>,
    /// Indices in an array of the forces of a block of links, their negatives, those of the next block ..., and zeros: a
    /// row for each term.
    pub(crate) terms: Vec<[u32; SUM_LANES]>,
}

/// MATs with about as many links each. The last MAT may stand in it several times, with the same terms.
#[derive(Clone, Debug)]
pub(crate) struct SumBlock {
    pub(crate) mats: [u32; SUM_LANES],
    /// Its rows of `terms`.
    pub(crate) terms: Range<usize>,
}

impl ForceSums {
    /// From the forces in the order in which they are added: the MAT, the link, and whether its force is subtracted.
    pub(super) fn new(signed_forces: &[(usize, usize, bool)], n_blocks: usize) -> Self {
        let force_index = |block: usize, is_negative: bool| 2 * block + usize::from(is_negative);
        let mat_count = signed_forces.iter().map(|&(mat, ..)| mat + 1).max().unwrap_or(0);
        let mut terms_by_mat: Vec<(usize, Vec<u32>)> = (0..mat_count).map(|mat| (mat, Vec::new())).collect();
        for &(mat, link, is_negative) in signed_forces {
            let index = force_index(link / LINK_LANES, is_negative) * LINK_LANES + link % LINK_LANES;
            terms_by_mat[mat].1.push(index as u32);
        }
        terms_by_mat.retain(|(_, terms)| !terms.is_empty());
        terms_by_mat.sort_by_key(|(_, terms)| terms.len());
        let zero_index = (force_index(n_blocks, false) * LINK_LANES) as u32;
        let mut sums = Self {
            blocks: Vec::new(),
            terms: Vec::new(),
        };
        for side_by_side in terms_by_mat.chunks(SUM_LANES) {
            let lanes: [_; SUM_LANES] = std::array::from_fn(|lane| &side_by_side[lane.min(side_by_side.len() - 1)]);
            let first_term = sums.terms.len();
            let term_count = side_by_side.iter().map(|(_, terms)| terms.len()).max().unwrap_or(0);
            let term_row = |i: usize| lanes.map(|(_, terms)| terms.get(i).copied().unwrap_or(zero_index));
            sums.terms.extend((0..term_count).map(term_row));
            sums.blocks.push(SumBlock {
                mats: lanes.map(|&(mat, _)| mat as u32),
                terms: first_term..sums.terms.len(),
            });
        }
        sums
    }
}
