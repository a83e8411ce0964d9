//! Points sorted into cells, to find pairs of points that are near each other.

use std::ops::Range;

use super::{Pair, Quad};
use crate::network::{AXES_MAX, distance};

/// Average number of points in reach of a point for which memory is reserved.
const NEIGHBOURS_RESERVED: usize = 24;
/// Largest such average: spheres that push each other apart do not come so near. Beyond it forces become NaN, which is
/// reported as a fault.
const NEIGHBOURS_MAX: usize = 512;

/// A set of points sorted into cells.
#[derive(Clone, Debug, Default)]
pub(super) struct Cells {
    grid: Grid,
    /// The cell of each point in the grid   (n)
    cells: Vec<[u32; AXES_MAX]>,
    /// Index in `members` at which the points of each cell begin, the points cell by cell, and their positions [m]
    /// (n_cells + 1, n, n)
    cell_starts: Vec<u32>,
    members: Vec<u32>,
    member_positions: Vec<Quad>,
}

/// Number of pairs for which memory is reserved, for `n` points.
pub(super) fn n_reserved_pairs(n: usize) -> usize {
    NEIGHBOURS_RESERVED * n
}

impl Cells {
    pub(super) fn new(n: usize, n_axes: usize) -> Self {
        let grid = Grid::new(n, n_axes);
        Self {
            cells: vec![[0; AXES_MAX]; n],
            cell_starts: vec![0; grid.n_cells() + 1],
            members: vec![0; n],
            member_positions: vec![Quad::default(); n],
            grid,
        }
    }

    /// Set `pairs` to all pairs within `search_radius` [m] of each other, ordered by their indices: pairs between the
    /// first `n_first` points and the others, or between all points if there are no others. Returns false if there are
    /// too many pairs.
    #[cold]
    pub(super) fn search(&mut self, x: &[Quad], n_first: usize, search_radius: f64, pairs: &mut Vec<Pair>) -> bool {
        self.sort(x, search_radius);
        pairs.clear();
        let layer_reach = if self.grid.log2_cells[2] > 0 { 1 } else { 0 };
        for i in 0..n_first {
            let first_pair = pairs.len();
            if first_pair > NEIGHBOURS_MAX * x.len() {
                return false;
            }
            let first_candidate = if n_first < x.len() { n_first } else { i + 1 };
            let [cell_x, cell_y, cell_z] = self.cells[i];
            for dz in -layer_reach..=layer_reach {
                for dy in -1..=1 {
                    let neighbour_row = [cell_y.wrapping_add_signed(dy), cell_z.wrapping_add_signed(dz)];
                    for cells in self.grid.three_cells(cell_x, neighbour_row) {
                        self.append_near((i, x[i]), cells, first_candidate, search_radius, pairs);
                    }
                }
            }
            pairs[first_pair..].sort_unstable_by_key(|pair| pair[1]);
        }
        true
    }

    /// Append the pairs of point `i` with those points of a range of cells, from point `first_candidate` on, that are
    /// within `search_radius`.
    #[inline(always)]
    fn append_near(
        &self,
        (i, point_position): (usize, Quad),
        cells: Range<usize>,
        first_candidate: usize,
        search_radius: f64,
        pairs: &mut Vec<Pair>,
    ) {
        let member_range = self.cell_starts[cells.start] as usize..self.cell_starts[cells.end] as usize;
        let cell_points = self.members[member_range.clone()]
            .iter()
            .zip(&self.member_positions[member_range]);
        for (&member, member_position) in cell_points {
            let [x, y, z] = [
                member_position[0] - point_position[0],
                member_position[1] - point_position[1],
                member_position[2] - point_position[2],
            ];
            if member as usize >= first_candidate && distance(x, y, z) <= search_radius {
                pairs.push([i as u32, member]);
            }
        }
    }

    /// Sort the points into cells as wide as `search_radius` [m].
    fn sort(&mut self, x: &[Quad], search_radius: f64) {
        let cells_per_metre = 1.0 / search_radius;
        self.cell_starts.fill(0);
        for (cell, x) in self.cells.iter_mut().zip(x) {
            // `as` saturates: all positions that are far away share a cell, and so do those that are NaN.
            *cell = std::array::from_fn(|axis| (x[axis] * cells_per_metre).floor() as i32 as u32);
            self.cell_starts[self.grid.index(*cell) + 1] += 1;
        }
        for i in 1..self.cell_starts.len() {
            self.cell_starts[i] += self.cell_starts[i - 1];
        }
        // In reverse order, so that the end of each cell turns into its beginning.
        for (i, &cell) in self.cells.iter().enumerate().rev() {
            let cell_end = &mut self.cell_starts[self.grid.index(cell) + 1];
            *cell_end -= 1;
            self.members[*cell_end as usize] = i as u32;
            self.member_positions[*cell_end as usize] = x[i];
        }
        self.cell_starts.copy_within(1.., 0);
        if let Some(members_end) = self.cell_starts.last_mut() {
            *members_end = self.cells.len() as u32;
        }
    }
}

/// A periodic grid of cells: points beyond it share the cells of points within it.
#[derive(Clone, Copy, Debug, Default)]
struct Grid {
    /// log2 of the number of cells along each axis.
    log2_cells: [u32; AXES_MAX],
}

impl Grid {
    /// Smallest value of `log2_cells`: four cells along an axis, so that a cell and its two neighbours are different.
    const LOG2_CELLS_MIN: u32 = 2;

    /// A grid with at least twice as many cells as points.
    fn new(n: usize, n_axes: usize) -> Self {
        let total_bits = (2 * n.max(1)).next_power_of_two().ilog2();
        let axis_bits = total_bits.div_ceil(n_axes as u32).max(Self::LOG2_CELLS_MIN);
        let log2_cells = [axis_bits, axis_bits, if n_axes == AXES_MAX { axis_bits } else { 0 }];
        Self { log2_cells }
    }

    fn n_cells(self) -> usize {
        1 << self.log2_cells.iter().sum::<u32>()
    }

    #[inline(always)]
    fn index(self, [x, y, z]: [u32; AXES_MAX]) -> usize {
        let [x_bits, y_bits, z_bits] = self.log2_cells;
        let wrap = |cell: u32, bits: u32| (cell & ((1 << bits) - 1)) as usize;
        (((wrap(z, z_bits) << y_bits) | wrap(y, y_bits)) << x_bits) | wrap(x, x_bits)
    }

    /// The cell at `x` and its two neighbours in a row (y, z): one range of cells, or two if the row wraps around
    /// between them.
    #[inline(always)]
    fn three_cells(self, x: u32, [y, z]: [u32; 2]) -> impl Iterator<Item = Range<usize>> {
        let row_start = self.index([0, y, z]);
        let row_length = 1 << self.log2_cells[0];
        let x = x as usize & (row_length - 1);
        let (cell_before, cell_after) = (x.wrapping_sub(1) & (row_length - 1), (x + 1) & (row_length - 1));
        let (main_range, wrapped_index) = if cell_before > x {
            (x..x + 2, Some(cell_before))
        } else if cell_after < x {
            (cell_before..x + 1, Some(cell_after))
        } else {
            (cell_before..cell_after + 1, None)
        };
        let wrapped_index = wrapped_index.map(|cell| row_start + cell..row_start + cell + 1);
        std::iter::once(row_start + main_range.start..row_start + main_range.end).chain(wrapped_index)
    }
}
