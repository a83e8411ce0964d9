//! A surface of triangles that points touch; it finds the point of the surface that is nearest to any place.
//!
//! The distance from the nearest point is continuous across triangles: a point that rolls over an edge is pushed by one
//! contact all the way, and its energy is a function of its position.

use super::{AXES_MAX, line};

type Vector = [f64; AXES_MAX];

/// Most cells of the grid, and most triangles in all cells together.
const CELLS_MAX: usize = 1 << 18;
const MEMBERS_MAX: usize = 1 << 22;
/// Factor by which cells are widened if there are too many.
const WIDENING: f64 = 1.3;

/// Triangles, sorted into cells by the places from which a point may touch them.
#[derive(Clone, Debug, PartialEq)]
pub struct Facets {
    triangles: Vec<[Vector; 3]>,
    /// Largest distance from the surface at which a point is detected [m].
    reach: f64,
    /// Lowest and highest corner of the region in which points are detected, width of a cell [m], and number of cells
    /// along each axis.
    bounds: [Vector; 2],
    wide: f64,
    counts: [usize; AXES_MAX],
    /// Index in `members` at which the triangles of each cell begin   (n_cells + 1)
    begins: Vec<u32>,
    members: Vec<u32>,
}

impl Facets {
    /// Most triangles of a surface.
    pub const TRIANGLES_MAX: usize = 200_000;

    /// The surface of triangles, each given by the numbers of its corners [m]; points are detected up to the distance
    /// `reach` [m].
    ///
    /// # Errors
    /// A sentence, if a number is out of range or no triangle has an area.
    pub fn new(
        corners: &[Vector],
        triangles: &[[u32; 3]],
        reach: f64,
    ) -> Result<Self, &'static str> {
        if !corners.iter().flatten().all(|x| x.is_finite()) {
            return Err("the corners of its surface are finite numbers");
        }
        if !(reach > 0.0 && reach.is_finite()) {
            return Err(
                "points that touch a surface need a gap above 0: the distance at which they touch",
            );
        }
        if triangles.len() > Self::TRIANGLES_MAX {
            return Err("its surface has more than 200,000 triangles");
        }
        let mut valid = Vec::with_capacity(triangles.len());
        for triangle in triangles {
            let corner = |number: u32| corners.get(number as usize).copied();
            let [Some(a), Some(b), Some(c)] = triangle.map(corner) else {
                return Err("its surface names a corner that it does not have");
            };
            let normal = cross(difference(b, a), difference(c, a));
            if dot(normal, normal) > 0.0 {
                valid.push([a, b, c]);
            }
        }
        if valid.is_empty() {
            return Err("its surface has no triangle with an area");
        }
        let mut facets = Self {
            triangles: valid,
            reach,
            bounds: [[0.0; AXES_MAX]; 2],
            wide: 0.0,
            counts: [0; AXES_MAX],
            begins: Vec::new(),
            members: Vec::new(),
        };
        facets.divide();
        Ok(facets)
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
        let n_cells = self
            .begins
            .windows(2)
            .filter(|pair| pair[0] < pair[1])
            .count();
        self.members.len() as f64 / n_cells.max(1) as f64
    }

    /// Distance of a place from the surface, and the direction away from it. The distance is infinite if no triangle is
    /// near.
    pub(crate) fn nearest(&self, place: Vector) -> (f64, Vector) {
        let mut least = f64::INFINITY;
        let mut apart = [0.0; AXES_MAX];
        for &member in self.around(place) {
            let offset = difference(place, nearest(&self.triangles[member as usize], place));
            let square = dot(offset, offset);
            if square < least {
                (least, apart) = (square, offset);
            }
        }
        if least == f64::INFINITY {
            // NaN is passed on, and detected later.
            let is_number = place.iter().all(|x| !x.is_nan());
            let length = if is_number { least } else { f64::NAN };
            return (length, [0.0; AXES_MAX]);
        }
        line(apart)
    }

    /// The triangles that a place may touch, by rising number.
    fn around(&self, place: Vector) -> &[u32] {
        let mut index = 0;
        for axis in (0..AXES_MAX).rev() {
            let cell = ((place[axis] - self.bounds[0][axis]) / self.wide).floor();
            if !(cell >= 0.0 && cell < self.counts[axis] as f64) {
                return &[];
            }
            index = index * self.counts[axis] + cell as usize;
        }
        let range = self.begins[index] as usize..self.begins[index + 1] as usize;
        &self.members[range]
    }

    /// Sort the triangles into cells, as narrow as the limits on their numbers allow.
    fn divide(&mut self) {
        let [mut low, mut high] = [[f64::INFINITY; AXES_MAX], [f64::NEG_INFINITY; AXES_MAX]];
        for corner in self.triangles.iter().flatten() {
            for axis in 0..AXES_MAX {
                low[axis] = low[axis].min(corner[axis] - self.reach);
                high[axis] = high[axis].max(corner[axis] + self.reach);
            }
        }
        self.bounds = [low, high];
        self.wide = self.reach;
        loop {
            let cells = |axis: usize| ((high[axis] - low[axis]) / self.wide).floor() + 1.0;
            let counts: Vector = std::array::from_fn(cells);
            if counts.iter().product::<f64>() <= CELLS_MAX as f64 {
                self.counts = counts.map(|count| count as usize);
                let spans = self.triangles.iter().map(|own| self.span(own));
                let n_members = spans.map(|span| volume(&span)).sum::<usize>();
                if n_members <= MEMBERS_MAX.max(self.triangles.len()) {
                    break;
                }
            }
            self.wide *= WIDENING;
        }
        let n_cells = self.counts.iter().product::<usize>();
        let mut begins = vec![0_u32; n_cells + 1];
        self.each_member(|cell, _| begins[cell + 1] += 1);
        for cell in 0..n_cells {
            begins[cell + 1] += begins[cell];
        }
        let mut members = vec![0; begins[n_cells] as usize];
        let mut next = begins.clone();
        self.each_member(|cell, triangle| {
            members[next[cell] as usize] = triangle;
            next[cell] += 1;
        });
        (self.begins, self.members) = (begins, members);
    }

    /// Call `each` with the number of each cell and of each triangle that may be touched from it.
    fn each_member(&self, mut each: impl FnMut(usize, u32)) {
        let half = 0.5 * self.wide;
        // From the middle of a cell to its corner, plus the reach, with a small margin.
        let far = (self.reach + half * 3.0_f64.sqrt()) * (1.0 + 1e-9);
        for (number, triangle) in self.triangles.iter().enumerate() {
            let [across, along, up] = self.span(triangle);
            for z in up {
                for y in along.clone() {
                    for x in across.clone() {
                        let cell_at = [x, y, z];
                        let middle: Vector = std::array::from_fn(|axis| {
                            self.bounds[0][axis] + self.wide * cell_at[axis] as f64 + half
                        });
                        let apart = difference(middle, nearest(triangle, middle));
                        // A triangle so thin that the distance is NaN is kept.
                        if dot(apart, apart) > far * far {
                            continue;
                        }
                        let cell = (z * self.counts[1] + y) * self.counts[0] + x;
                        each(cell, number as u32);
                    }
                }
            }
        }
    }

    /// The range of cells around a triangle, along each axis.
    fn span(&self, triangle: &[Vector; 3]) -> [std::ops::Range<usize>; AXES_MAX] {
        std::array::from_fn(|axis| {
            let all = triangle.map(|corner| corner[axis]);
            let [least, greatest] = [all.into_iter().fold(f64::INFINITY, f64::min), {
                all.into_iter().fold(f64::NEG_INFINITY, f64::max)
            }];
            let cell = |x: f64| ((x - self.bounds[0][axis]) / self.wide).floor().max(0.0) as usize;
            let last = self.counts[axis] - 1;
            cell(least - self.reach).min(last)..cell(greatest + self.reach).min(last) + 1
        })
    }
}

fn volume(span: &[std::ops::Range<usize>; AXES_MAX]) -> usize {
    span.iter().map(std::ops::Range::len).product()
}

/// The point of a triangle that is nearest to a place (Ericson, Real-Time Collision Detection, 2005, 5.1.5).
fn nearest([a, b, c]: &[Vector; 3], place: Vector) -> Vector {
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
        return beside(*a, d1 / (d1 - d3), ab);
    }
    let from_c = difference(place, *c);
    let (d5, d6) = (dot(ab, from_c), dot(ac, from_c));
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let towards_b = d5 * d2 - d1 * d6;
    if towards_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return beside(*a, d2 / (d2 - d6), ac);
    }
    let towards_a = d3 * d6 - d5 * d4;
    if towards_a <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let share = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return beside(*b, share, difference(*c, *b));
    }
    let normaliser = 1.0 / (towards_a + towards_b + towards_c);
    let (v, w) = (towards_b * normaliser, towards_c * normaliser);
    std::array::from_fn(|axis| a[axis] + ab[axis] * v + ac[axis] * w)
}

fn beside(from: Vector, share: f64, way: Vector) -> Vector {
    std::array::from_fn(|axis| from[axis] + share * way[axis])
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
        let n = 200;
        let mut least = f64::INFINITY;
        for i in 0..=n {
            for j in 0..=n - i {
                let (v, w) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                let nearest_point: Vector = std::array::from_fn(|axis| {
                    a[axis] + v * (b[axis] - a[axis]) + w * (c[axis] - a[axis])
                });
                let apart = difference(place, nearest_point);
                least = least.min(dot(apart, apart));
            }
        }
        least.sqrt()
    }

    #[test]
    fn nearest_point_of_a_triangle() {
        let mut chance = Chance::new(7, "facets", "nearest", 0, 0);
        let mut vector =
            |size: f64| -> Vector { std::array::from_fn(|_| chance.uniform(-size, size)) };
        for _ in 0..200 {
            let triangle = [vector(1.0), vector(1.0), vector(1.0)];
            let place = vector(2.0);
            let apart = difference(place, nearest(&triangle, place));
            let (length, tried) = (dot(apart, apart).sqrt(), by_trying(&triangle, place));
            assert!(
                length <= tried + 1e-12 && tried - length < 0.02,
                "{length} {tried}"
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
        let facets = Facets::new(&corners, &triangles, 0.15).unwrap();
        let mut n_seen = 0;
        for _ in 0..3_000 {
            let place: Vector = std::array::from_fn(|_| chance.uniform(-1.3, 1.3));
            let all = facets.triangles.iter().map(|triangle| {
                let apart = difference(place, nearest(triangle, place));
                distance(apart[0], apart[1], apart[2])
            });
            let least = all.fold(f64::INFINITY, f64::min);
            let (length, along) = facets.nearest(place);
            if least < 0.15 {
                n_seen += 1;
                assert_eq!(length.to_bits(), least.to_bits());
                assert!((dot(along, along) - 1.0).abs() < 1e-12);
            } else {
                assert!(length >= 0.15);
            }
        }
        assert!(n_seen > 100, "{n_seen}");
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
            let error = Facets::new(&corners, &triangles, reach).unwrap_err();
            assert!(error.contains(message), "{error}");
        }
        // A very large surface with a very small gap.
        let wide = [[-1e6, -1e6, -1e6], [1e6, 1e6, 1e6], [1e6, -1e6, 1e6]];
        let facets = Facets::new(&wide, &[[0, 1, 2]], 1e-9).unwrap();
        assert!(facets.begins.len() <= CELLS_MAX + 1);
    }
}
