//! Contacts between all pairs of points of two groups: pairs that are near are found by cells, and kept while nothing has
//! moved far.
//!
//! Pairs are taken in the order of their points, whatever the cells: the same sums in the same order, however long a list
//! of neighbours was kept.

use crate::network::{AXES_MAX, PairRun, Pairwise, distance};
use crate::scheme::Run;
use crate::state::Body;

/// Beyond what touches, pairs are kept that are so far apart, as a share of the gap: a list lasts until a point has moved
/// half of this.
const SKIN: f64 = 0.3;
/// Pairs in reach a point on average for which there is room at once.
const ROOM: usize = 24;
/// And at most: spheres that push each other do not come so near. Where they do, forces are not a number any more, which
/// is a fault.
const MOST: usize = 512;

/// A pair of points: their first coordinates.
pub(crate) type Ends = (usize, usize);

/// Which points may meet, and the memory to find out.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbours {
    /// First coordinate of each point: the first group, and the second where it is another   (n)
    mats: Vec<u32>,
    /// Positions now and where the list was made [m]   (n each)
    x: [Vec<f64>; AXES_MAX],
    from: [Vec<f64>; AXES_MAX],
    /// Where the points that each point may meet begin in `others`   (n + 1)
    starts: Vec<u32>,
    others: Vec<u32>,
    /// Cell of each point   (n)
    cells: Vec<[i32; AXES_MAX]>,
    /// Where the points of each bucket begin in `members`   (n_buckets + 1)
    buckets: Vec<u32>,
    members: Vec<u32>,
    is_made: bool,
    /// More points are near each other than any pushing allows.
    is_full: bool,
}

impl Neighbours {
    pub(crate) fn new(run: &PairRun) -> Self {
        let pairs = &run.pairs;
        let first = run.a..run.a + pairs.n_first;
        let second = run.b..run.b + if pairs.is_within { 0 } else { run.n };
        let mats: Vec<u32> = first.chain(second).map(|mat| mat as u32).collect();
        let n = mats.len();
        let room = || std::array::from_fn(|_| vec![0.0; n]);
        let n_buckets = (2 * n).next_power_of_two();
        Self {
            x: room(),
            from: room(),
            starts: vec![0; n + 1],
            others: Vec::with_capacity(if pairs.is_searched() { ROOM * n } else { 0 }),
            cells: vec![[0; AXES_MAX]; n],
            buckets: vec![0; n_buckets + 1],
            members: vec![0; n],
            mats,
            is_made: false,
            is_full: false,
        }
    }

    /// Every pair that touches at positions `x`: its first coordinates, distance − rest [m], and the direction from the
    /// one to the other. False where there are too many to be told of.
    pub(crate) fn touching(
        &mut self,
        run: &PairRun,
        x: impl Fn(usize) -> f64,
        mut each: impl FnMut(Ends, f64, [f64; AXES_MAX]),
    ) -> bool {
        let pairs = &run.pairs;
        if !pairs.is_searched() {
            for first in 0..pairs.n_first {
                for second in 0..run.n {
                    let ends = (run.a + first, run.b + second);
                    let (length, along) = pairs.link.line(ends, &x);
                    let e = length - run.rest;
                    if e >= 0.0 {
                        continue;
                    }
                    each(ends, e, along);
                }
            }
            return true;
        }
        self.see(pairs, x);
        if !self.is_made || self.has_moved(0.5 * SKIN * run.rest) {
            self.search(pairs, run.rest * (1.0 + SKIN));
        }
        let reach = run.rest * run.rest;
        let [x, y, z] = &self.x;
        for (i, range) in self.starts.windows(2).enumerate() {
            let (xi, yi, zi) = (x[i], y[i], z[i]);
            for &j in &self.others[range[0] as usize..range[1] as usize] {
                let j = j as usize;
                let apart = [x[j] - xi, y[j] - yi, z[j] - zi];
                let square = apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2];
                // What is not a number goes on, and is found there.
                if square >= reach {
                    continue;
                }
                let (length, along) = pairs.link.measure.of(apart);
                let ends = (self.mats[i] as usize, self.mats[j] as usize);
                each(ends, length - run.rest, along);
            }
        }
        !self.is_full
    }

    /// Copy positions to where they lie together.
    fn see(&mut self, pairs: &Pairwise, x: impl Fn(usize) -> f64) {
        let n_first = pairs.n_first;
        for axis in 0..pairs.link.n_axes {
            let [a, b] = match axis {
                0 => [0, 0],
                _ => [0, 1].map(|end| pairs.link.offsets[end][axis - 1]),
            };
            let own = &mut self.x[axis];
            for (i, (own, &mat)) in own.iter_mut().zip(&self.mats).enumerate() {
                *own = x(mat as usize + if i < n_first { a } else { b });
            }
        }
    }

    /// Whether any point has moved farther than `most` [m] since the list was made, or is not a number.
    fn has_moved(&self, most: f64) -> bool {
        let [x, y, z] = &self.x;
        let [from_x, from_y, from_z] = &self.from;
        let most = most * most;
        let stays = |i: usize| {
            let (x, y, z) = (x[i] - from_x[i], y[i] - from_y[i], z[i] - from_z[i]);
            x * x + y * y + z * z <= most
        };
        let mut stay = true;
        for i in 0..x.len() {
            stay &= stays(i);
        }
        !stay
    }

    /// Find all pairs within `reach` [m], in the order of their points.
    #[cold]
    fn search(&mut self, pairs: &Pairwise, reach: f64) {
        let n = self.mats.len();
        for (from, x) in self.from.iter_mut().zip(&self.x) {
            from.copy_from_slice(x);
        }
        self.fill_cells(reach);
        self.others.clear();
        self.is_full = false;
        let last = if pairs.is_within { n } else { pairs.n_first };
        let depth = if pairs.link.n_axes == AXES_MAX { 1 } else { 0 };
        for i in 0..n {
            let begin = self.others.len();
            self.starts[i] = begin as u32;
            if i >= last || begin > MOST * n {
                self.is_full |= i < last;
                continue;
            }
            let least = if pairs.is_within { i + 1 } else { last };
            let [cx, cy, cz] = self.cells[i];
            for dz in -depth..=depth {
                for dy in -1..=1 {
                    for dx in -1..=1 {
                        let cell = [
                            cx.wrapping_add(dx),
                            cy.wrapping_add(dy),
                            cz.wrapping_add(dz),
                        ];
                        self.near(i, cell, least, reach);
                    }
                }
            }
            self.others[begin..].sort_unstable();
        }
        self.starts[n] = self.others.len() as u32;
        self.is_made = true;
    }

    /// Note the points of a cell, from point `least` on, that are within `reach` of point `i`.
    fn near(&mut self, i: usize, cell: [i32; AXES_MAX], least: usize, reach: f64) {
        let [x, y, z] = &self.x;
        let bucket = bucket(cell, self.buckets.len() - 1);
        let (begin, end) = (self.buckets[bucket], self.buckets[bucket + 1]);
        for &member in &self.members[begin as usize..end as usize] {
            let j = member as usize;
            // Other cells share the bucket.
            if j >= least && self.cells[j] == cell {
                let apart = distance(x[j] - x[i], y[j] - y[i], z[j] - z[i]);
                if apart <= reach {
                    self.others.push(member);
                }
            }
        }
    }

    /// Sort the points into cells as wide as `reach` [m], and these into buckets.
    fn fill_cells(&mut self, reach: f64) {
        let n_buckets = self.buckets.len() - 1;
        let [x, y, z] = &self.x;
        let wide = 1.0 / reach;
        for (i, cell) in self.cells.iter_mut().enumerate() {
            // Far away, and where a position is not a number, cells are one: `as` saturates.
            *cell = [x[i], y[i], z[i]].map(|x| (x * wide).floor() as i32);
        }
        self.buckets.fill(0);
        for &cell in &self.cells {
            self.buckets[bucket(cell, n_buckets) + 1] += 1;
        }
        for i in 0..n_buckets {
            self.buckets[i + 1] += self.buckets[i];
        }
        // From the last on, so that each bucket's end becomes its beginning.
        for (i, &cell) in self.cells.iter().enumerate().rev() {
            let end = &mut self.buckets[bucket(cell, n_buckets) + 1];
            *end -= 1;
            self.members[*end as usize] = i as u32;
        }
        self.buckets.copy_within(1.., 0);
        self.buckets[n_buckets] = self.cells.len() as u32;
    }
}

/// The bucket of a cell; a power of two of them.
fn bucket(cell: [i32; AXES_MAX], n_buckets: usize) -> usize {
    /// Large primes (Teschner et al. 2003, §4).
    const PRIMES: [u32; AXES_MAX] = [73_856_093, 19_349_663, 83_492_791];
    let mixed = cell.iter().zip(PRIMES).fold(0, |mixed, (&cell, prime)| {
        mixed ^ (cell as u32).wrapping_mul(prime)
    });
    mixed as usize & (n_buckets - 1)
}

/// Add the forces of all pairs to the coordinates of the points, and note how strongly each point of the second group is
/// pushed [N].
pub(super) fn forces(
    run: &Run,
    pairs: &PairRun,
    gates: &[f64],
    body: &mut Body,
    neighbours: &mut Neighbours,
) {
    let open = run.gate.map_or(1.0, |gate| gates[gate]);
    let Body {
        x,
        d,
        pair_force,
        link,
        ..
    } = body;
    let own = &mut link[run.first..run.first + run.len];
    own.fill(0.0);
    let Pairwise {
        link, is_within, ..
    } = &pairs.pairs;
    let push = |ends: Ends, e: f64, along: [f64; AXES_MAX]| {
        let step = link.stretch(ends, along, |mat| d[mat]);
        let f = open * link.law.force([run.k, run.z], e, step);
        for (axis, along) in along.into_iter().enumerate().take(link.n_axes) {
            let (a, b) = link.pair(ends, axis);
            pair_force[a] += f * along;
            pair_force[b] -= f * along;
        }
        if *is_within {
            own[ends.0 - run.b] += 0.5 * f;
            own[ends.1 - run.b] += 0.5 * f;
        } else {
            own[ends.1 - run.b] += f;
        }
    };
    if !neighbours.touching(pairs, |mat| x[mat], push) {
        own.fill(f64::NAN);
        pair_force[run.a] = f64::NAN;
    }
}
