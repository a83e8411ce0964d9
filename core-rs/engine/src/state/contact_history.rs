//! What touching points remember of how they slid: an anchor for each pair.

/// Two points that touch, by their numbers, and what lies between them where friction has no force [m].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Anchored {
    first: u32,
    second: u32,
    anchor: [f64; 3],
}

crate::archive::state!(Anchored {
    first,
    second,
    anchor
});

/// The pairs that touch now, in the order in which they are gone through.
#[derive(Clone, Debug, Default)]
pub(crate) struct ContactHistory {
    pairs: Vec<Anchored>,
    /// Those of the pass that goes on.
    next: Vec<Anchored>,
    /// The first pair that the pass has not passed.
    cursor: usize,
}

/// Room at once for so many touching pairs a point: spheres of one size touch 12 others.
const ROOM: usize = 8;

impl ContactHistory {
    /// Of so many points.
    pub(crate) fn new(n_points: usize) -> Self {
        Self {
            pairs: Vec::with_capacity(ROOM * n_points),
            next: Vec::with_capacity(ROOM * n_points),
            cursor: 0,
        }
    }

    /// The pairs (first point, second point) and their anchors [m], in order.
    pub(crate) fn pairs(&self) -> impl Iterator<Item = ([u32; 2], [f64; 3])> + '_ {
        let of = |pair: &Anchored| ([pair.first, pair.second], pair.anchor);
        self.pairs.iter().map(of)
    }

    /// The anchor of a pair [m], if it touches.
    pub(crate) fn find(&self, [first, second]: [u32; 2]) -> Option<[f64; 3]> {
        let found = self
            .pairs
            .binary_search_by_key(&(first, second), |pair| (pair.first, pair.second));
        found.ok().map(|at| self.pairs[at].anchor)
    }

    /// Begin a pass over all pairs that touch, in the order of their numbers.
    pub(crate) fn begin(&mut self) {
        self.next.clear();
        self.cursor = 0;
    }

    /// The anchor of a pair, if it touched when the last pass ended.
    pub(crate) fn anchor(&mut self, [first, second]: [u32; 2]) -> Option<[f64; 3]> {
        let is_before = |pair: &&Anchored| (pair.first, pair.second) < (first, second);
        let passed = self.pairs[self.cursor..].iter().take_while(is_before);
        self.cursor += passed.count();
        let found = self.pairs.get(self.cursor)?;
        (found.first == first && found.second == second).then_some(found.anchor)
    }

    /// Note the anchor of a pair that touches.
    pub(crate) fn keep(&mut self, [first, second]: [u32; 2], anchor: [f64; 3]) {
        self.next.push(Anchored {
            first,
            second,
            anchor,
        });
    }

    /// End a pass: pairs that did not touch in it are forgotten.
    pub(crate) fn end(&mut self) {
        std::mem::swap(&mut self.pairs, &mut self.next);
    }

    /// Take over what another of the same points remembers, without allocating where there is room.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.pairs.clone_from(&other.pairs);
    }
}

impl crate::archive::State for ContactHistory {
    fn archive(
        &mut self,
        archive: &mut crate::archive::Archive<'_>,
    ) -> Result<(), crate::archive::Damaged> {
        archive.list(&mut self.pairs)
    }
}
