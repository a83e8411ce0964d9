//! PLATE: masses in a plane mesh.

use std::f64::consts::FRAC_PI_2;

use super::rectangle::rectangle;
use super::{GeneratorError, Links, MAX_MASSES, Topology, check_count};
use crate::maths::{sin, sqrt};

/// The shape of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Six neighbours, `radius` rings round the centre: 1 + 3r(r+1) masses.
    Hex,
    /// Four neighbours, 2r + 1 masses a side.
    Square,
    /// Four neighbours, with this many masses a side; `radius` is ignored.
    Rectangle {
        /// Masses of a row.
        across: usize,
        /// Rows.
        up: usize,
    },
    /// Rings of 6, 12, 18 … masses: see [`round_membrane`](super::round_membrane) and
    /// [`bent_plate`](super::bent_plate).
    Disc,
}

/// How the edge is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rim {
    /// Not at all.
    Free,
    /// By one more ring, of SOLs.
    Fixed,
}

impl Shape {
    fn masses(self, radius: usize) -> usize {
        match self {
            Self::Hex => 1 + 3 * radius * (radius + 1),
            Self::Square => (2 * radius + 1) * (2 * radius + 1),
            Self::Rectangle { across, up } => across.saturating_mul(up),
            Self::Disc => Self::Hex.masses(radius),
        }
    }

    /// Half of the directions in which a site has neighbours; the other half are their opposites.
    fn directions(self) -> &'static [(isize, isize)] {
        match self {
            // Two axes of the mesh at 60°, and the one between.
            Self::Hex => &[(1, 0), (0, 1), (-1, 1)],
            _ => &[(1, 0), (0, 1)],
        }
    }

    /// The ring of a site; `None` for the corners of a fixed square, which have no neighbour inside.
    fn ring(self, (x, y): (isize, isize), outer: usize, fixed: bool) -> Option<usize> {
        let (x, y, z) = (x.unsigned_abs(), y.unsigned_abs(), (x + y).unsigned_abs());
        match self {
            Self::Hex => Some(x.max(y).max(z)),
            _ => (!(fixed && x == outer && y == outer)).then_some(x.max(y)),
        }
    }

    /// Position of a site, in lengths of a link.
    fn place(self, (x, y): (isize, isize)) -> [f64; 2] {
        let (x, y) = (x as f64, y as f64);
        match self {
            // Rows of triangles lie √3/2 apart, each shifted by a half.
            Self::Hex => [x + 0.5 * y, 0.5 * sqrt(3.0) * y],
            _ => [x, y],
        }
    }

    /// The lowest non-rigid λ of a square, from those of two strings; `None` for other shapes.
    fn lowest_lambda(self, radius: usize, rim: Rim) -> Option<f64> {
        let side_masses = (2 * radius + 1) as f64;
        let string_lambda = |gaps: f64| 4.0 * sin(FRAC_PI_2 / gaps) * sin(FRAC_PI_2 / gaps);
        match (self, rim) {
            (Self::Square, Rim::Free) if radius > 0 => Some(string_lambda(side_masses)),
            (Self::Square, Rim::Fixed) => Some(2.0 * string_lambda(side_masses + 1.0)),
            _ => None,
        }
    }
}

/// A mesh of `radius` rings round its centre.
///
/// ```
/// use ergon_engine::generator::{Rim, Shape, plate};
///
/// let topology = plate(Shape::Hex, 3, Rim::Free)?;
/// assert_eq!(topology.n_mat, 1 + 6 + 12 + 18);
/// assert!(topology.is_rigid());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// More than [`MAX_MASSES`].
pub fn plate(shape: Shape, radius: usize, rim: Rim) -> Result<Topology, GeneratorError> {
    match shape {
        Shape::Rectangle { across, up } => return rectangle(across, up, rim == Rim::Fixed),
        Shape::Disc => return Err(GeneratorError::Rings),
        Shape::Hex | Shape::Square => {}
    }
    let radius_max = (0..)
        .take_while(|radius| shape.masses(radius + 1) <= MAX_MASSES)
        .count();
    check_count("`radius`", radius, 0, radius_max)?;
    let is_fixed = rim == Rim::Fixed;
    let outer_ring = radius + usize::from(is_fixed);
    let side_sites = 2 * outer_ring + 1;
    let site_of_cell = |cell: usize| {
        let coordinate = |i: usize| i as isize - outer_ring as isize;
        (coordinate(cell % side_sites), coordinate(cell / side_sites))
    };
    let ring = |cell: &usize| shape.ring(site_of_cell(*cell), outer_ring, is_fixed);
    let is_mat = |cell: &usize| ring(cell).is_some_and(|ring| ring <= radius);
    let is_sol = |cell: &usize| is_fixed && ring(cell) == Some(outer_ring);
    let mat_cells = (0..side_sites * side_sites).filter(is_mat);
    let point_cells: Vec<usize> = mat_cells.chain((0..side_sites * side_sites).filter(is_sol)).collect();
    // Nothing at a site without a point.
    let mut point_index = vec![None; side_sites * side_sites];
    for (i, cell) in point_cells.iter().enumerate() {
        point_index[*cell] = Some(i);
    }
    let n_mat = shape.masses(radius);
    let mut mesh_links = Links::new();
    // One direction after the other, so that the links of a row form one run.
    for (right, up) in shape.directions() {
        for cell in 0..side_sites * side_sites {
            let (site_x, site_y) = site_of_cell(cell);
            let is_inside = |i: isize| i.unsigned_abs() <= outer_ring;
            if !(is_inside(site_x + right) && is_inside(site_y + up)) {
                continue;
            }
            let other_cell = cell as isize + right + up * side_sites as isize;
            if let (Some(this_point), Some(other_point)) = (point_index[cell], point_index[other_cell as usize])
                && this_point.min(other_point) < n_mat
            {
                mesh_links.join(this_point, other_point, 1.0);
            }
        }
    }
    let mesh_width = (2 * outer_ring).max(1) as f64;
    let picture_place = |cell: &usize| {
        shape
            .place(site_of_cell(*cell))
            .map(|coordinate| coordinate / mesh_width)
    };
    Ok(Topology {
        lowest_lambda: shape.lowest_lambda(radius, rim),
        ..Topology::new(n_mat, mesh_links.runs, point_cells.iter().map(picture_place).collect())
    })
}
