//! Friction states of touching points: an anchor for each pair.

/// Two points that touch, by their indices, and the vector between them at which friction has no force [m].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct AnchoredPair {
    first: u32,
    second: u32,
    anchor: [f64; 3],
}

crate::archive::state!(AnchoredPair { first, second, anchor });

/// The pairs that touch, in the order in which the loops visit them.
#[derive(Clone, Debug, Default)]
pub(crate) struct ContactHistory {
    pairs: Vec<AnchoredPair>,
    /// Pairs found so far in the current pass.
    new_pairs: Vec<AnchoredPair>,
    /// Index of the first pair in `pairs` that the current pass has not yet passed.
    cursor: usize,
}

/// Number of touching pairs per point for which memory is reserved: equal spheres touch at most 12 others, and a pair
/// has two points.
const PAIRS_RESERVED: usize = 8;

impl ContactHistory {
    /// An empty history for contacts between `n_points` points.
    pub(crate) fn new(n_points: usize) -> Self {
        Self {
            pairs: Vec::with_capacity(PAIRS_RESERVED * n_points),
            new_pairs: Vec::with_capacity(PAIRS_RESERVED * n_points),
            cursor: 0,
        }
    }

    /// The pairs (first point, second point) and their anchors [m], in order.
    pub(crate) fn pairs(&self) -> impl Iterator<Item = ([u32; 2], [f64; 3])> + '_ {
        let anchored = |pair: &AnchoredPair| ([pair.first, pair.second], pair.anchor);
        self.pairs.iter().map(anchored)
    }

    /// The anchor of a pair [m], if it touches.
    pub(crate) fn anchor_of(&self, [first, second]: [u32; 2]) -> Option<[f64; 3]> {
        let pair_search = self
            .pairs
            .binary_search_by_key(&(first, second), |pair| (pair.first, pair.second));
        pair_search.ok().map(|index| self.pairs[index].anchor)
    }

    /// Begin a pass over all pairs that touch, in the order of their indices.
    pub(crate) fn begin_pass(&mut self) {
        self.new_pairs.clear();
        self.cursor = 0;
    }

    /// The anchor of a pair, if the pair touched in the last pass.
    pub(crate) fn next_anchor(&mut self, [first, second]: [u32; 2]) -> Option<[f64; 3]> {
        let is_before = |pair: &&AnchoredPair| (pair.first, pair.second) < (first, second);
        let passed_pairs = self.pairs[self.cursor..].iter().take_while(is_before);
        self.cursor += passed_pairs.count();
        let anchored = self.pairs.get(self.cursor)?;
        (anchored.first == first && anchored.second == second).then_some(anchored.anchor)
    }

    /// Store the anchor of a pair that touches.
    pub(crate) fn store(&mut self, [first, second]: [u32; 2], anchor: [f64; 3]) {
        self.new_pairs.push(AnchoredPair { first, second, anchor });
    }

    /// End a pass: pairs that did not touch in it are forgotten.
    pub(crate) fn end_pass(&mut self) {
        std::mem::swap(&mut self.pairs, &mut self.new_pairs);
    }

    /// Copy the history of another body with the same points, without allocating if there is enough memory.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.pairs.clone_from(&other.pairs);
    }
}

impl crate::archive::State for ContactHistory {
    fn archive(&mut self, archive: &mut crate::archive::Archive<'_>) -> Result<(), crate::archive::Damaged> {
        archive.list(&mut self.pairs)
    }
}
