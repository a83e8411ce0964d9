//! A surface of triangles that points touch; it finds the point of the surface that is nearest to any place.
//!
//! The distance from the nearest point is continuous across triangles: a point that rolls over an edge is pushed by one
//! contact all the way, and its energy is a function of its position.

use super::{AXES_MAX, length_and_unit_vector};

type Vector = [f64; AXES_MAX];

/// Largest number of cells of the grid.
const CELLS_MAX: usize = 1 << 18;
/// Largest number of triangles in all cells together.
const MEMBERS_MAX: usize = 1 << 22;
/// Factor by which cells are widened if there are too many.
const WIDENING: f64 = 1.3;

/// Triangles, sorted into cells by the places from which a point may touch them.
#[derive(Clone, Debug, PartialEq)]
pub struct Facets {
    triangles: Vec<[Vector; 3]>,
    /// Largest distance from the surface at which a point is detected [m].
    reach: f64,
    /// Lowest and highest corner of the region in which points are detected [m].
    bounds: [Vector; 2],
    /// Width of a cell [m].
    cell_width: f64,
    /// Number of cells along each axis.
    counts: [usize; AXES_MAX],
    /// Index in `members` at which the triangles of each cell begin   (n_cells + 1)
    cell_starts: Vec<u32>,
    members: Vec<u32>,
}

impl Facets {
    /// Largest number of triangles of a surface.
    pub const TRIANGLES_MAX: usize = 200_000;

    /// The surface of triangles, each given by the numbers of its corners [m]; points are detected up to the distance
    /// `reach` [m].
    ///
    /// # Errors
    /// A sentence, if a number is out of range or no triangle has an area.
    pub fn new(corners: &[Vector], triangles: &[[u32; 3]], reach: f64) -> Result<Self, &'static str> {
        if !corners.iter().flatten().all(|x| x.is_finite()) {
            return Err("the corners of its surface must be finite numbers");
        }
        if !(reach > 0.0 && reach.is_finite()) {
            return Err("points that touch a surface need a gap above 0: the distance at which they touch");
        }
        if triangles.len() > Self::TRIANGLES_MAX {
            return Err("its surface has more than 200,000 triangles");
        }
        let mut valid_triangles = Vec::with_capacity(triangles.len());
        for triangle in triangles {
            let corner_at = |number: u32| corners.get(number as usize).copied();
            let [Some(a), Some(b), Some(c)] = triangle.map(corner_at) else {
                return Err("its surface names a corner that it does not have");
            };
            let triangle_normal = cross(difference(b, a), difference(c, a));
            if dot(triangle_normal, triangle_normal) > 0.0 {
                valid_triangles.push([a, b, c]);
            }
        }
        if valid_triangles.is_empty() {
            return Err("its surface has no triangle with an area");
        }
        let mut surface = Self {
            triangles: valid_triangles,
            reach,
            bounds: [[0.0; AXES_MAX]; 2],
            cell_width: 0.0,
            counts: [0; AXES_MAX],
            cell_starts: Vec::new(),
            members: Vec::new(),
        };
        surface.sort_into_cells();
        Ok(surface)
    }

    /// Largest distance from the surface at which a point is detected [m].
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// Lowest and highest corner of the region in which points are detected [m].
    pub(crate) fn bounds(&self) -> [Vector; 2] {
        self.bounds
    }

    /// Average number of triangles near a place that may touch the surface.
    pub(crate) fn crowding(&self) -> f64 {
        let filled_cells = self.cell_starts.windows(2).filter(|pair| pair[0] < pair[1]).count();
        self.members.len() as f64 / filled_cells.max(1) as f64
    }

    /// Distance of a place from the surface, and the direction away from it. The distance is infinite if no triangle is
    /// near.
    pub(crate) fn nearest(&self, place: Vector) -> (f64, Vector) {
        let mut least_square = f64::INFINITY;
        let mut least_offset = [0.0; AXES_MAX];
        for &member in self.facets_near(place) {
            let offset = difference(place, nearest_point(&self.triangles[member as usize], place));
            let offset_square = dot(offset, offset);
            if offset_square < least_square {
                (least_square, least_offset) = (offset_square, offset);
            }
        }
        if least_square == f64::INFINITY {
            // NaN is passed on, and detected later.
            let is_number = place.iter().all(|x| !x.is_nan());
            let far_distance = if is_number { least_square } else { f64::NAN };
            return (far_distance, [0.0; AXES_MAX]);
        }
        length_and_unit_vector(least_offset)
    }

    /// The triangles that a place may touch, by rising number.
    fn facets_near(&self, place: Vector) -> &[u32] {
        let mut cell_index = 0;
        for axis in (0..AXES_MAX).rev() {
            let axis_cell = ((place[axis] - self.bounds[0][axis]) / self.cell_width).floor();
            if !(axis_cell >= 0.0 && axis_cell < self.counts[axis] as f64) {
                return &[];
            }
            cell_index = cell_index * self.counts[axis] + axis_cell as usize;
        }
        let member_range = self.cell_starts[cell_index] as usize..self.cell_starts[cell_index + 1] as usize;
        &self.members[member_range]
    }

    /// Sort the triangles into cells, as narrow as the limits on their numbers allow.
    fn sort_into_cells(&mut self) {
        let [mut lower_bound, mut upper_bound] = [[f64::INFINITY; AXES_MAX], [f64::NEG_INFINITY; AXES_MAX]];
        for corner in self.triangles.iter().flatten() {
            for axis in 0..AXES_MAX {
                lower_bound[axis] = lower_bound[axis].min(corner[axis] - self.reach);
                upper_bound[axis] = upper_bound[axis].max(corner[axis] + self.reach);
            }
        }
        self.bounds = [lower_bound, upper_bound];
        self.cell_width = self.reach;
        loop {
            let cells_along = |axis: usize| ((upper_bound[axis] - lower_bound[axis]) / self.cell_width).floor() + 1.0;
            let axis_counts: Vector = std::array::from_fn(cells_along);
            if axis_counts.iter().product::<f64>() <= CELLS_MAX as f64 {
                self.counts = axis_counts.map(|count| count as usize);
                let cell_spans = self.triangles.iter().map(|facet| self.span(facet));
                let n_members = cell_spans.map(|span| n_cells_in(&span)).sum::<usize>();
                if n_members <= MEMBERS_MAX.max(self.triangles.len()) {
                    break;
                }
            }
            self.cell_width *= WIDENING;
        }
        let cell_total = self.counts.iter().product::<usize>();
        let mut cell_starts = vec![0_u32; cell_total + 1];
        self.for_each_member(|cell, _| cell_starts[cell + 1] += 1);
        for cell in 0..cell_total {
            cell_starts[cell + 1] += cell_starts[cell];
        }
        let mut members = vec![0; cell_starts[cell_total] as usize];
        let mut next_member = cell_starts.clone();
        self.for_each_member(|cell, triangle| {
            members[next_member[cell] as usize] = triangle;
            next_member[cell] += 1;
        });
        (self.cell_starts, self.members) = (cell_starts, members);
    }

    /// Call `visit` with the number of each cell and of each triangle that may be touched from it.
    fn for_each_member(&self, mut visit: impl FnMut(usize, u32)) {
        let half_width = 0.5 * self.cell_width;
        // From the middle of a cell to its corner, plus the reach, with a small margin.
        let cell_reach = (self.reach + half_width * 3.0_f64.sqrt()) * (1.0 + 1e-9);
        for (number, triangle) in self.triangles.iter().enumerate() {
            let [cells_across, cells_along, cells_up] = self.span(triangle);
            for z in cells_up {
                for y in cells_along.clone() {
                    for x in cells_across.clone() {
                        let cell_indices = [x, y, z];
                        let cell_middle: Vector = std::array::from_fn(|axis| {
                            self.bounds[0][axis] + self.cell_width * cell_indices[axis] as f64 + half_width
                        });
                        let middle_offset = difference(cell_middle, nearest_point(triangle, cell_middle));
                        // A triangle so thin that the distance is NaN is kept.
                        if dot(middle_offset, middle_offset) > cell_reach * cell_reach {
                            continue;
                        }
                        let cell_index = (z * self.counts[1] + y) * self.counts[0] + x;
                        visit(cell_index, number as u32);
                    }
                }
            }
        }
    }

    /// The range of cells around a triangle, along each axis.
    fn span(&self, triangle: &[Vector; 3]) -> [std::ops::Range<usize>; AXES_MAX] {
        std::array::from_fn(|axis| {
            let corner_places = triangle.map(|corner| corner[axis]);
            let [least_place, greatest_place] = [corner_places.into_iter().fold(f64::INFINITY, f64::min), {
                corner_places.into_iter().fold(f64::NEG_INFINITY, f64::max)
            }];
            let clamped_cell = |x: f64| ((x - self.bounds[0][axis]) / self.cell_width).floor().max(0.0) as usize;
            let last_cell = self.counts[axis] - 1;
            clamped_cell(least_place - self.reach).min(last_cell)
                ..clamped_cell(greatest_place + self.reach).min(last_cell) + 1
        })
    }
}

fn n_cells_in(span: &[std::ops::Range<usize>; AXES_MAX]) -> usize {
    span.iter().map(std::ops::Range::len).product()
}

/// The point of a triangle that is nearest to a place (Ericson, Real-Time Collision Detection, 2005, 5.1.5).
fn nearest_point([a, b, c]: &[Vector; 3], place: Vector) -> Vector {
    let (ab, ac) = (difference(*b, *a), difference(*c, *a));
    let from_a = difference(place, *a);
    let (d1, d2) = (dot(ab, from_a), dot(ac, from_a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let from_b = difference(place, *b);
    let (d3, d4) = (dot(ab, from_b), dot(ac, from_b));
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let towards_c = d1 * d4 - d3 * d2;
    if towards_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return point_along(*a, d1 / (d1 - d3), ab);
    }
    let from_c = difference(place, *c);
    let (d5, d6) = (dot(ab, from_c), dot(ac, from_c));
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let towards_b = d5 * d2 - d1 * d6;
    if towards_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return point_along(*a, d2 / (d2 - d6), ac);
    }
    let towards_a = d3 * d6 - d5 * d4;
    if towards_a <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let edge_share = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return point_along(*b, edge_share, difference(*c, *b));
    }
    let normaliser = 1.0 / (towards_a + towards_b + towards_c);
    let (v, w) = (towards_b * normaliser, towards_c * normaliser);
    std::array::from_fn(|axis| a[axis] + ab[axis] * v + ac[axis] * w)
}

fn point_along(origin: Vector, share: f64, direction: Vector) -> Vector {
    std::array::from_fn(|axis| origin[axis] + share * direction[axis])
}

fn difference(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % AXES_MAX, (i + 2) % AXES_MAX);
        a[j] * b[k] - a[k] * b[j]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chance::Chance;
    use crate::network::distance;

    /// The distance from a triangle, by trying many of its points.
    fn by_trying([a, b, c]: &[Vector; 3], place: Vector) -> f64 {
        let step_count = 200;
        let mut least_square = f64::INFINITY;
        for i in 0..=step_count {
            for j in 0..=step_count - i {
                let (v, w) = (
                    f64::from(i) / f64::from(step_count),
                    f64::from(j) / f64::from(step_count),
                );
                let nearest_point: Vector =
                    std::array::from_fn(|axis| a[axis] + v * (b[axis] - a[axis]) + w * (c[axis] - a[axis]));
                let point_offset = difference(place, nearest_point);
                least_square = least_square.min(dot(point_offset, point_offset));
            }
        }
        least_square.sqrt()
    }

    #[test]
    fn nearest_point_of_a_triangle() {
        let mut chance = Chance::new(7, "facets", "nearest", 0, 0);
        let mut random_vector = |size: f64| -> Vector { std::array::from_fn(|_| chance.uniform(-size, size)) };
        for _ in 0..200 {
            let triangle = [random_vector(1.0), random_vector(1.0), random_vector(1.0)];
            let test_place = random_vector(2.0);
            let point_offset = difference(test_place, nearest_point(&triangle, test_place));
            let (exact_length, tried_length) =
                (dot(point_offset, point_offset).sqrt(), by_trying(&triangle, test_place));
            assert!(
                exact_length <= tried_length + 1e-12 && tried_length - exact_length < 0.02,
                "{exact_length} {tried_length}"
            );
        }
    }

    /// Cells omit no triangle that a place may touch.
    #[test]
    fn facets_in_cells_omit_no_triangle() {
        let mut chance = Chance::new(8, "facets", "cells", 0, 0);
        let corners: Vec<Vector> = (0..90)
            .map(|_| std::array::from_fn(|_| chance.uniform(-1.0, 1.0)))
            .collect();
        let triangles: Vec<[u32; 3]> = (0..30).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let surface = Facets::new(&corners, &triangles, 0.15).unwrap();
        let mut near_count = 0;
        for _ in 0..3_000 {
            let test_place: Vector = std::array::from_fn(|_| chance.uniform(-1.3, 1.3));
            let distances = surface.triangles.iter().map(|triangle| {
                let point_offset = difference(test_place, nearest_point(triangle, test_place));
                distance(point_offset[0], point_offset[1], point_offset[2])
            });
            let least_distance = distances.fold(f64::INFINITY, f64::min);
            let (nearest_length, direction) = surface.nearest(test_place);
            if least_distance < 0.15 {
                near_count += 1;
                assert_eq!(nearest_length.to_bits(), least_distance.to_bits());
                assert!((dot(direction, direction) - 1.0).abs() < 1e-12);
            } else {
                assert!(nearest_length >= 0.15);
            }
        }
        assert!(near_count > 100, "{near_count}");
    }

    #[test]
    fn facets_without_area_or_gap_are_refused() {
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        for (triangles, reach, message) in [
            (vec![[0, 1, 2]], 0.1, "no triangle with an area"),
            (vec![[0, 1, 3]], 0.1, "a corner that it does not have"),
            (vec![[0, 1, 2]], 0.0, "a gap above 0"),
            (vec![[0, 1, 2]; 200_001], 0.1, "more than 200,000"),
        ] {
            let facet_error = Facets::new(&corners, &triangles, reach).unwrap_err();
            assert!(facet_error.contains(message), "{facet_error}");
        }
        // A very large surface with a very small gap.
        let wide_corners = [[-1e6, -1e6, -1e6], [1e6, 1e6, 1e6], [1e6, -1e6, 1e6]];
        let wide_facets = Facets::new(&wide_corners, &[[0, 1, 2]], 1e-9).unwrap();
        assert!(wide_facets.cell_starts.len() <= CELLS_MAX + 1);
    }
}
