//! Where each spring of a mesh writes its force, and which forces are summed at each MAT: made once for a mesh.
//!
//! One array holds the forces of all links, run after run, with zeros between the runs. A block is up to eight MATs;
//! where a run that pulls on some of them does not reach the others, the sum reads zeros. A row is a series of adjacent
//! blocks on which the same runs pull. It is summed in registers: a load for each run, and one store.

use std::ops::Range;

use crate::scheme::{ForceEnds, Spring};

/// Zeros before and behind the forces of each run. A row reads at most that far beyond them, and no vector is longer.
pub(super) const PADDING: usize = 8;
/// Links whose forces are computed before rows are summed. The forces and the motion of that many stay in the first
/// cache, and were written long enough ago to be read at another alignment.
const TILE_LINKS: usize = 1_024;
/// What a block of MATs costs beside its terms [terms].
const BLOCK_COST: usize = 3;
/// Largest number of links of a mesh. Beyond it the array of forces fills the second cache: springs in one pass are as
/// fast or, at 290,000 links, faster by 1.2.
const LINKS_MAX: usize = 65_536;

/// Forces of [`PADDING`] links, as one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(super) struct CacheLine(#[expect(dead_code, reason = "read by pointers")] [f64; PADDING]);

/// Where a run of springs reads and writes.
#[derive(Clone, Copy, Debug)]
pub(super) struct RunPlace {
    /// The MATs of its first link.
    pub(super) a: usize,
    pub(super) b: usize,
    pub(super) len: usize,
    /// Index of its first force, a multiple of [`PADDING`].
    pub(super) first_force: usize,
}

/// What one run adds to each MAT of a row.
#[derive(Clone, Copy, Debug)]
pub(super) struct RunTerm {
    /// 1 at ends a, −1 at ends b.
    pub(super) sign: f64,
    /// Index of the force of a link minus that of the MAT.
    pub(super) shift: isize,
}

/// Adjacent MATs on which the same runs pull.
#[derive(Clone, Debug)]
pub(super) struct Row {
    pub(super) mats: Range<usize>,
    pub(super) terms: Range<usize>,
    /// Number of runs after which all its forces are computed.
    run_count: usize,
}

/// A stage of the pass: runs whose forces are computed, then rows that are summed.
#[derive(Clone, Debug)]
pub(super) struct Tile {
    pub(super) runs: Range<usize>,
    pub(super) rows: Range<usize>,
}

/// The springs of a mesh in rows.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    pub(super) run_places: Vec<RunPlace>,
    pub(super) terms: Vec<RunTerm>,
    pub(super) rows: Vec<Row>,
    pub(super) tiles: Vec<Tile>,
    /// Length of the array of forces.
    pub(super) force_count: usize,
    /// Number of MATs that links join, and on which they pull.
    pub(super) motion_count: usize,
    pub(super) mat_count: usize,
}

impl Rows {
    /// The springs in rows; they pull on `mat_count` MATs. `None` where the rows are too short, or the mesh too large,
    /// to be faster than [`super::total`].
    pub(super) fn new(springs: &[Spring], mat_count: usize) -> Option<Self> {
        let link_count: usize = springs.iter().map(|spring| spring.len).sum();
        if springs.is_empty() || link_count > LINKS_MAX {
            return None;
        }
        let rows = Self::for_any_springs(springs, mat_count);
        // A vector of forces takes about as long to be summed as a link that is computed by itself.
        let vectors = |row: &Row| row.terms.len() * row.mats.len().div_ceil(PADDING);
        (rows.rows.iter().map(vectors).sum::<usize>() <= link_count).then_some(rows)
    }

    /// [`Self::new`] for any springs.
    pub(super) fn for_any_springs(springs: &[Spring], mat_count: usize) -> Self {
        let (mut run_places, mut force_count) = (Vec::with_capacity(springs.len()), PADDING);
        for &Spring { a, b, len, .. } in springs {
            run_places.push(RunPlace {
                a,
                b,
                len,
                first_force: force_count,
            });
            force_count += len.next_multiple_of(PADDING) + PADDING;
        }
        let mut spring_rows = Self {
            motion_count: springs.iter().map(|run| run.a.max(run.b) + run.len).max().unwrap_or(0),
            // The last vector of a row may reach beyond it.
            force_count: force_count + PADDING,
            mat_count,
            terms: Vec::new(),
            rows: Vec::new(),
            tiles: Vec::new(),
            run_places,
        };
        let pulling_ends = PullingEnds::new(springs, mat_count);
        let mut row: Option<(Range<usize>, Vec<usize>)> = None;
        for mats in pulling_ends.blocks() {
            let ends = pulling_ends.ends_on_any(&mats);
            match &mut row {
                Some((row_mats, row_ends)) if row_mats.len().is_multiple_of(PADDING) && *row_ends == ends => {
                    row_mats.end = mats.end;
                }
                _ => spring_rows.push_row(&pulling_ends, row.replace((mats, ends))),
            }
        }
        spring_rows.push_row(&pulling_ends, row);
        spring_rows.rows.sort_by_key(|row| row.run_count);
        spring_rows.tiles = tiles(springs, &spring_rows.rows);
        spring_rows
    }

    /// Room for the forces.
    pub(super) fn zeroed_forces(&self) -> Vec<CacheLine> {
        vec![CacheLine([0.0; PADDING]); self.force_count.div_ceil(PADDING)]
    }

    fn push_row(&mut self, pulls: &PullingEnds, row: Option<(Range<usize>, Vec<usize>)>) {
        let Some((mats, ends)) = row else {
            return;
        };
        let first_term = self.terms.len();
        self.terms.extend(ends.iter().map(|&end| RunTerm {
            sign: if end.is_multiple_of(2) { 1.0 } else { -1.0 },
            shift: self.run_places[end / 2].first_force as isize - pulls.mats[end].start as isize,
        }));
        self.rows.push(Row {
            mats,
            terms: first_term..self.terms.len(),
            run_count: ends.last().map_or(0, |end| end / 2 + 1),
        });
    }
}

/// Which ends of runs pull on each MAT. End 2·i is the end a of run i, end 2·i + 1 its end b: in rising order, forces
/// are added as in a pass over one run after the other.
struct PullingEnds {
    /// The MATs of each end; empty if it pulls on none.
    mats: Vec<Range<usize>>,
    /// The ends on each MAT, rising: those of MAT m are `ends[offsets[m]..offsets[m + 1]]`.
    offsets: Vec<usize>,
    ends: Vec<usize>,
}

impl PullingEnds {
    fn new(springs: &[Spring], mat_count: usize) -> Self {
        let end_mats = |run: &Spring| {
            let [first_a, first_b] = match run.force_ends {
                ForceEnds::Both(a, b) => [Some(a), Some(b)],
                ForceEnds::A(a) => [Some(a), None],
                ForceEnds::B(b) => [None, Some(b)],
            };
            [first_a, first_b].map(|first| first.map_or(0..0, |first| first..first + run.len))
        };
        let mats: Vec<Range<usize>> = springs.iter().flat_map(end_mats).collect();
        let mut offsets = vec![0; mat_count + 1];
        for mat in mats.iter().flat_map(Clone::clone) {
            offsets[mat + 1] += 1;
        }
        for mat in 0..mat_count {
            offsets[mat + 1] += offsets[mat];
        }
        let (mut ends, mut next) = (vec![0; offsets[mat_count]], offsets.clone());
        for (end, mats) in mats.iter().enumerate() {
            for mat in mats.clone() {
                ends[next[mat]] = end;
                next[mat] += 1;
            }
        }
        Self { mats, offsets, ends }
    }

    fn ends_of(&self, mat: usize) -> &[usize] {
        &self.ends[self.offsets[mat]..self.offsets[mat + 1]]
    }

    /// The ends on any of some MATs, rising.
    fn ends_on_any(&self, mats: &Range<usize>) -> Vec<usize> {
        let mut ends: Vec<usize> = mats.clone().flat_map(|mat| self.ends_of(mat)).copied().collect();
        ends.sort_unstable();
        ends.dedup();
        ends
    }

    /// All MATs in blocks of at most [`PADDING`], so that the ends on each block are as few as possible in all.
    fn blocks(&self) -> Vec<Range<usize>> {
        let mat_count = self.offsets.len() - 1;
        // The least cost of all MATs from each on, and the length of the block there.
        let mut best_blocks = vec![(0, 0); mat_count + 1];
        for first in (0..mat_count).rev() {
            let (mut end_count, mut least) = (0, (usize::MAX, 0));
            for mat in first..mat_count.min(first + PADDING) {
                // An end was counted already if it pulls on a MAT between.
                let is_new = |end: &&usize| mat == first || self.mats[**end].start == mat;
                end_count += self.ends_of(mat).iter().filter(is_new).count();
                let cost = best_blocks[mat + 1].0 + BLOCK_COST + end_count;
                if cost <= least.0 {
                    least = (cost, mat + 1 - first);
                }
            }
            best_blocks[first] = least;
        }
        let mut next = 0;
        std::iter::from_fn(|| {
            (next < mat_count).then(|| {
                let first = next;
                next += best_blocks[first].1;
                first..next
            })
        })
        .collect()
    }
}

/// Tiles of runs, each with the rows that the runs of the tile before completed; the last one with all that are left.
fn tiles(springs: &[Spring], rows: &[Row]) -> Vec<Tile> {
    let (mut tiles, mut first_run, mut first_row, mut link_count) = (Vec::new(), 0, 0, 0);
    for (i, spring) in springs.iter().enumerate() {
        link_count += spring.len;
        let is_last = i + 1 == springs.len();
        if link_count < TILE_LINKS && !is_last {
            continue;
        }
        let row_end = if is_last {
            rows.len()
        } else {
            rows.partition_point(|row| row.run_count <= first_run)
        };
        tiles.push(Tile {
            runs: first_run..i + 1,
            rows: first_row..row_end,
        });
        (first_run, first_row, link_count) = (i + 1, row_end, 0);
    }
    tiles
}
