//! Contacts and attractions between all pairs of points of two groups: pairs that are near are found by cells, and kept
//! while nothing has moved far.
//!
//! Pairs are taken in the order of their points, whatever the cells: the same sums in the same order, however long a list
//! of neighbours was kept.

use std::ops::Range;

use crate::network::{AXES_MAX, Measure, PairRun, Pairwise, Sliding, difference, distance};
use crate::scheme::Run;
use crate::state::{Body, ContactHistory};

/// Beyond what touches, pairs are kept that are so far apart, as a share of the gap: a list lasts until a point has moved
/// half of this.
const SKIN: f64 = 0.3;
/// Pairs in reach a point on average for which there is room at once.
const ROOM: usize = 24;
/// And at most: spheres that push each other do not come so near. Where they do, forces are not a number any more, which
/// is a fault.
const MOST: usize = 512;

type Vector = [f64; AXES_MAX];

/// A pair of points: their first coordinates.
pub(crate) type Ends = (usize, usize);

/// Which points may meet, and the memory to find out.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbours {
    /// First coordinate of each point: the first group, and the second where it is another   (n)
    mats: Vec<u32>,
    /// Positions now and where the list was made, and last steps [m]; 0 along axes that there are not   (n each)
    x: Vec<Vector>,
    from: Vec<Vector>,
    d: Vec<Vector>,
    /// Forces on the points, and how strongly all others push each [N]   (n)
    force: Vec<[f64; AXES_MAX + 1]>,
    /// Where the points that each point may meet begin in `others`   (n + 1)
    starts: Vec<u32>,
    others: Vec<u32>,
    /// The grid, and the cell of each point in it   (n)
    grid: Grid,
    cells: Vec<[u32; AXES_MAX]>,
    /// Where the points of each cell begin in `members`, and where these points are [m]   (n_cells + 1, n, n)
    begins: Vec<u32>,
    members: Vec<u32>,
    places: Vec<Vector>,
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
        let room = || vec![[0.0; AXES_MAX]; n];
        let grid = Grid::new(n, pairs.link.n_axes);
        Self {
            x: room(),
            from: room(),
            d: room(),
            force: vec![[0.0; AXES_MAX + 1]; n],
            starts: vec![0; n + 1],
            others: Vec::with_capacity(if pairs.is_searched() { ROOM * n } else { 0 }),
            cells: vec![[0; AXES_MAX]; n],
            begins: vec![0; grid.n_cells() + 1],
            members: vec![0; n],
            places: room(),
            grid,
            mats,
            is_made: false,
            is_full: false,
        }
    }

    /// Every pair that touches, or attracts each other, at positions `x`: its first coordinates, distance − rest [m], and
    /// the direction from the one to the other. False where there are too many to be told of.
    pub(crate) fn touching(
        &mut self,
        run: &PairRun,
        x: impl Fn(usize) -> f64,
        mut each: impl FnMut(Ends, f64, [f64; AXES_MAX]),
    ) -> bool {
        let pairs = &run.pairs;
        if !pairs.is_searched() {
            for first in 0..pairs.n_first {
                for second in pairs.others(first, run.n) {
                    let ends = (run.a + first, run.b + second);
                    let (length, along) = pairs.link.line(ends, &x);
                    let e = length - run.rest;
                    if pairs.link.law.acts(e) {
                        each(ends, e, along);
                    }
                }
            }
            return true;
        }
        self.follow(run, x);
        for (i, range) in self.starts.windows(2).enumerate() {
            let here = self.x[i];
            for &j in &self.others[range[0] as usize..range[1] as usize] {
                if let Some((e, along)) = meeting(run.rest, here, self.x[j as usize]) {
                    let ends = (self.mats[i] as usize, self.mats[j as usize] as usize);
                    each(ends, e, along);
                }
            }
        }
        !self.is_full
    }

    /// Know which points may meet at positions `x`.
    fn follow(&mut self, run: &PairRun, x: impl Fn(usize) -> f64) {
        gather(&run.pairs, &self.mats, &mut self.x, x);
        if !self.is_made || self.has_moved(0.5 * SKIN * run.rest) {
            self.search(&run.pairs, run.rest * (1.0 + SKIN));
        }
    }

    /// Set `force` to those of all pairs by the law of a run, whose K and Z are `by`, and by its friction. False where there
    /// are too many pairs.
    fn push<const HAS_FRICTION: bool>(
        &mut self,
        run: &PairRun,
        by: [f64; 2],
        (x, d): (&[f64], &[f64]),
        history: &mut ContactHistory,
    ) -> bool {
        self.follow(run, |mat| x[mat]);
        gather(&run.pairs, &self.mats, &mut self.d, |mat| d[mat]);
        self.force.fill([0.0; AXES_MAX + 1]);
        let law = &run.pairs.link.law;
        // Of two groups only the second is told of: half the push to each of one, the whole to the other.
        let share = if run.pairs.is_within { 0.5 } else { 1.0 };
        for (i, range) in self.starts.windows(2).enumerate() {
            let (here, step_here) = (self.x[i], self.d[i]);
            let mut own = [0.0; AXES_MAX + 1];
            for &j in &self.others[range[0] as usize..range[1] as usize] {
                let j = j as usize;
                let Some((e, along)) = meeting(run.rest, here, self.x[j]) else {
                    continue;
                };
                let there = self.d[j];
                let step = along[0] * (there[0] - step_here[0])
                    + along[1] * (there[1] - step_here[1])
                    + along[2] * (there[2] - step_here[2]);
                let elastic = law.elastic(by[0], e);
                let f = law.damped([by[0], e], elastic, by[1] * step);
                let mut part = [f * along[0], f * along[1], f * along[2], -share * f];
                if HAS_FRICTION {
                    let contact = Contact {
                        e,
                        f,
                        elastic,
                        along,
                        apart: difference(self.x[j], here),
                        moved: difference(there, step_here),
                    };
                    let pull = contact.pull_across(&run.pairs, by, [i as u32, j as u32], history);
                    for axis in 0..AXES_MAX {
                        part[axis] += pull[axis];
                    }
                }
                let other = &mut self.force[j];
                for axis in 0..=AXES_MAX {
                    own[axis] += part[axis];
                    other[axis] -= part[axis];
                }
            }
            let force = &mut self.force[i];
            for axis in 0..AXES_MAX {
                force[axis] += own[axis];
            }
            force[AXES_MAX] -= own[AXES_MAX];
        }
        !self.is_full
    }

    /// Whether any point has moved farther than `most` [m] since the list was made, or is not a number.
    fn has_moved(&self, most: f64) -> bool {
        let most = most * most;
        let mut stay = true;
        for (now, from) in self.x.iter().zip(&self.from) {
            let [x, y, z] = [now[0] - from[0], now[1] - from[1], now[2] - from[2]];
            stay &= x * x + y * y + z * z <= most;
        }
        !stay
    }

    /// Find all pairs within `reach` [m], in the order of their points.
    #[cold]
    fn search(&mut self, pairs: &Pairwise, reach: f64) {
        let n = self.mats.len();
        self.from.copy_from_slice(&self.x);
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
                    let row = [cy.wrapping_add_signed(dy), cz.wrapping_add_signed(dz)];
                    for cells in self.grid.three(cx, row) {
                        self.near(i, cells, least, reach);
                    }
                }
            }
            self.others[begin..].sort_unstable();
        }
        self.starts[n] = self.others.len() as u32;
        self.is_made = true;
    }

    /// Note the points of some cells, from point `least` on, that are within `reach` of point `i`.
    #[inline(always)]
    fn near(&mut self, i: usize, cells: Range<usize>, least: usize, reach: f64) {
        let here = self.x[i];
        let range = self.begins[cells.start] as usize..self.begins[cells.end] as usize;
        let points = self.members[range.clone()].iter().zip(&self.places[range]);
        for (&member, there) in points {
            let [x, y, z] = [there[0] - here[0], there[1] - here[1], there[2] - here[2]];
            if member as usize >= least && distance(x, y, z) <= reach {
                self.others.push(member);
            }
        }
    }

    /// Sort the points into cells as wide as `reach` [m].
    fn fill_cells(&mut self, reach: f64) {
        let wide = 1.0 / reach;
        self.begins.fill(0);
        for (cell, x) in self.cells.iter_mut().zip(&self.x) {
            // Far away, and where a position is not a number, cells are one: `as` saturates.
            *cell = x.map(|x| (x * wide).floor() as i32 as u32);
            self.begins[self.grid.index(*cell) + 1] += 1;
        }
        for i in 1..self.begins.len() {
            self.begins[i] += self.begins[i - 1];
        }
        // From the last on, so that where each cell ends becomes where it begins.
        for (i, &cell) in self.cells.iter().enumerate().rev() {
            let end = &mut self.begins[self.grid.index(cell) + 1];
            *end -= 1;
            self.members[*end as usize] = i as u32;
            self.places[*end as usize] = self.x[i];
        }
        self.begins.copy_within(1.., 0);
        if let Some(last) = self.begins.last_mut() {
            *last = self.cells.len() as u32;
        }
    }
}

/// A grid of cells that repeats itself: what lies beyond it shares cells with what lies in it.
#[derive(Clone, Copy, Debug, Default)]
struct Grid {
    /// Powers of two of which there are so many cells along each axis.
    bits: [u32; AXES_MAX],
}

impl Grid {
    /// Least power of two along an axis: the three cells around a point are three.
    const LEAST: u32 = 2;

    /// With twice as many cells as points, or more.
    fn new(n: usize, n_axes: usize) -> Self {
        let all = (2 * n.max(1)).next_power_of_two().ilog2();
        let each = all.div_ceil(n_axes as u32).max(Self::LEAST);
        let bits = [each, each, if n_axes == AXES_MAX { each } else { 0 }];
        Self { bits }
    }

    fn n_cells(self) -> usize {
        1 << self.bits.iter().sum::<u32>()
    }

    #[inline(always)]
    fn index(self, [x, y, z]: [u32; AXES_MAX]) -> usize {
        let [of_x, of_y, of_z] = self.bits;
        let within = |cell: u32, bits: u32| (cell & ((1 << bits) - 1)) as usize;
        (((within(z, of_z) << of_y) | within(y, of_y)) << of_x) | within(x, of_x)
    }

    /// The cells at `x` and beside it in a row (y, z): one range, or two where the row ends between them.
    #[inline(always)]
    fn three(self, x: u32, [y, z]: [u32; 2]) -> impl Iterator<Item = Range<usize>> {
        let row = self.index([0, y, z]);
        let n = 1 << self.bits[0];
        let x = x as usize & (n - 1);
        let (before, after) = (x.wrapping_sub(1) & (n - 1), (x + 1) & (n - 1));
        let (main, other) = if before > x {
            (x..x + 2, Some(before))
        } else if after < x {
            (before..x + 1, Some(after))
        } else {
            (before..after + 1, None)
        };
        let other = other.map(|cell| row + cell..row + cell + 1);
        std::iter::once(row + main.start..row + main.end).chain(other)
    }
}

/// Distance − rest and direction of a pair that touches. What is not a number goes on, and is found later.
#[inline(always)]
fn meeting(rest: f64, here: Vector, there: Vector) -> Option<(f64, Vector)> {
    let apart = [there[0] - here[0], there[1] - here[1], there[2] - here[2]];
    let square = apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2];
    if square >= rest * rest {
        return None;
    }
    let (length, along) = Measure::Distance.of(apart);
    let e = length - rest;
    // A length whose square is less than that of `rest` may be rounded to `rest`: nothing is pressed then.
    if e >= 0.0 { None } else { Some((e, along)) }
}

/// A pair that touches.
pub(crate) struct Contact {
    /// Distance − rest [m].
    pub(crate) e: f64,
    /// Force that pulls its ends together [N], and its elastic part.
    pub(crate) f: f64,
    pub(crate) elastic: f64,
    /// Direction from the one to the other, of length 1.
    pub(crate) along: Vector,
    /// What lies between them, and by how much that grew in the last step [m].
    pub(crate) apart: Vector,
    pub(crate) moved: Vector,
}

impl Contact {
    /// Its friction, where K and Z of the contact are these: none where it only pulls.
    #[inline(always)]
    pub(crate) fn sliding(&self, pairs: &Pairwise, [k, z]: [f64; 2]) -> Sliding {
        let pressed = pairs.link.law.pressed(k, self.e, self.elastic);
        let (limit, k) = pressed.map_or((0.0, 1.0), |[k, pull]| ((pull - self.f).max(0.0), k));
        Sliding {
            limit: pairs.friction * limit,
            by: [k, z],
            apart: self.apart,
            along: self.along,
            moved: self.moved,
        }
    }

    /// Force of friction that pulls the first point [N], which is remembered.
    fn pull_across(
        &self,
        pairs: &Pairwise,
        by: [f64; 2],
        points: [u32; 2],
        history: &mut ContactHistory,
    ) -> Vector {
        let (force, anchor) = self.sliding(pairs, by).force(history.anchor(points));
        history.keep(points, anchor);
        force
    }
}

/// Copy what each coordinate has to where the coordinates of a point lie together.
fn gather(pairs: &Pairwise, mats: &[u32], into: &mut [Vector], of: impl Fn(usize) -> f64) {
    let (first, second) = into.split_at_mut(pairs.n_first);
    let (first_mats, second_mats) = mats.split_at(pairs.n_first);
    for (end, own, mats) in [(0, first, first_mats), (1, second, second_mats)] {
        let offsets = pairs.link.offsets[end];
        for (own, &mat) in own.iter_mut().zip(mats) {
            own[0] = of(mat as usize);
            for axis in 1..pairs.link.n_axes {
                own[axis] = of((mat as usize).wrapping_add_signed(offsets[axis - 1]));
            }
        }
    }
}

/// Add the forces of all pairs to the coordinates of the points, and note how strongly each point of the second group is
/// pushed [N].
pub(super) fn forces(
    run: &Run,
    pairs: &PairRun,
    gates: &[f64],
    body: &mut Body,
    (room, neighbours): (usize, &mut Neighbours),
) {
    let open = run.gate.map_or(1.0, |gate| gates[gate]);
    let by = [open * run.k, open * run.z];
    let Body {
        x,
        d,
        pair_force,
        link,
        histories,
        ..
    } = body;
    let own = &mut link[run.first..run.first + run.len];
    let (n_first, history) = (pairs.pairs.n_first, &mut histories[room]);
    let has_friction = pairs.pairs.friction > 0.0;
    history.begin();
    let Pairwise {
        link, is_within, ..
    } = &pairs.pairs;
    if !pairs.pairs.is_searched() {
        own.fill(0.0);
        neighbours.touching(
            pairs,
            |mat| x[mat],
            |ends, e, along| {
                let step = link.stretch(ends, along, |mat| d[mat]);
                let elastic = link.law.elastic(by[0], e);
                let f = link.law.damped([by[0], e], elastic, by[1] * step);
                let mut pull = along.map(|along| f * along);
                if has_friction {
                    let contact = Contact {
                        e,
                        f,
                        elastic,
                        along,
                        apart: link.between(ends, |mat| x[mat]),
                        moved: link.between(ends, |mat| d[mat]),
                    };
                    let across = contact.pull_across(&pairs.pairs, by, pairs.points(ends), history);
                    pull = std::array::from_fn(|axis| pull[axis] + across[axis]);
                }
                for (axis, pull) in pull.into_iter().enumerate().take(link.n_axes) {
                    let (a, b) = link.pair(ends, axis);
                    pair_force[a] += pull;
                    pair_force[b] -= pull;
                }
                // Of one group each point is told of: half the force of each pair.
                if *is_within {
                    own[ends.0 - run.a] += 0.5 * f;
                    own[ends.1 - run.b] += 0.5 * f;
                } else {
                    own[ends.1 - run.b] += f;
                }
            },
        );
        history.end();
        return;
    }
    let push = if has_friction {
        Neighbours::push::<true>
    } else {
        Neighbours::push::<false>
    };
    let is_found = push(neighbours, pairs, by, (x, d), history);
    history.end();
    for (i, (&mat, force)) in neighbours.mats.iter().zip(&neighbours.force).enumerate() {
        let end = usize::from(i >= n_first);
        for (axis, part) in force.iter().enumerate().take(link.n_axes) {
            let at = match axis {
                0 => mat as usize,
                _ => (mat as usize).wrapping_add_signed(link.offsets[end][axis - 1]),
            };
            pair_force[at] += part;
        }
    }
    let told = if *is_within { 0 } else { n_first };
    for (own, force) in own.iter_mut().zip(&neighbours.force[told..]) {
        *own = force[AXES_MAX];
    }
    if !is_found {
        own.fill(f64::NAN);
        pair_force[run.a] = f64::NAN;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Friction divides by the depth, which rounding may make 0.
    #[test]
    fn what_touches_is_pressed() {
        let mut n_rounded = 0;
        for i in 1..20_000 {
            let rest = 1e-6 * f64::from(i);
            let (x, y) = (0.6 * rest, 0.8 * rest);
            let is_near = x * x + y * y < rest * rest;
            n_rounded += u32::from(is_near && distance(x, y, 0.0) >= rest);
            if let Some((e, _)) = meeting(rest, [0.0; AXES_MAX], [x, y, 0.0]) {
                assert!(e < 0.0, "{x} {y}");
            }
        }
        assert!(n_rounded > 0, "the loop has no such length");
    }
}
