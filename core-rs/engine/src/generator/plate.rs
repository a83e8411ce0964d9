//! PLATE: masses in a plane mesh.

use std::f64::consts::FRAC_PI_2;

use super::rectangle::rectangle;
use super::{GeneratorError, Links, MAX_MASSES, Topology, count};
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
        let side = (2 * radius + 1) as f64;
        let string = |gaps: f64| 4.0 * sin(FRAC_PI_2 / gaps) * sin(FRAC_PI_2 / gaps);
        match (self, rim) {
            (Self::Square, Rim::Free) if radius > 0 => Some(string(side)),
            (Self::Square, Rim::Fixed) => Some(2.0 * string(side + 1.0)),
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
    count("`radius`", radius, 0, radius_max)?;
    let fixed = rim == Rim::Fixed;
    let outer = radius + usize::from(fixed);
    let side = 2 * outer + 1;
    let site = |cell: usize| {
        let coordinate = |i: usize| i as isize - outer as isize;
        (coordinate(cell % side), coordinate(cell / side))
    };
    let ring = |cell: &usize| shape.ring(site(*cell), outer, fixed);
    let is_mat = |cell: &usize| ring(cell).is_some_and(|ring| ring <= radius);
    let is_sol = |cell: &usize| fixed && ring(cell) == Some(outer);
    let mats = (0..side * side).filter(is_mat);
    let points: Vec<usize> = mats.chain((0..side * side).filter(is_sol)).collect();
    // Nothing at a site without a point.
    let mut index = vec![None; side * side];
    for (i, cell) in points.iter().enumerate() {
        index[*cell] = Some(i);
    }
    let n_mat = shape.masses(radius);
    let mut links = Links::new();
    // One direction after the other, so that the links of a row form one run.
    for (right, up) in shape.directions() {
        for cell in 0..side * side {
            let (x, y) = site(cell);
            let inside = |i: isize| i.unsigned_abs() <= outer;
            if !(inside(x + right) && inside(y + up)) {
                continue;
            }
            let other = cell as isize + right + up * side as isize;
            if let (Some(a), Some(b)) = (index[cell], index[other as usize])
                && a.min(b) < n_mat
            {
                links.join(a, b, 1.0);
            }
        }
    }
    let width = (2 * outer).max(1) as f64;
    let place = |cell: &usize| shape.place(site(*cell)).map(|at| at / width);
    Ok(Topology {
        lowest_lambda: shape.lowest_lambda(radius, rim),
        ..Topology::new(n_mat, links.runs, points.iter().map(place).collect())
    })
}
