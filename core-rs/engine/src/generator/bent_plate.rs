//! PLATE with `bending`: a thin plate after Kirchhoff, as masses and links that resist curvature.
//!
//! The energy of a plate is ½·D·∫ (w_xx + w_yy)² - 2·(1 - ν)·(w_xx·w_yy - w_xy²). For a free rim and for a disc, it is
//! evaluated at every mass: the curvature is that of a parabola fitted to the masses around it by least squares, and
//! the area is that of the mass. Each such quadratic form of differences is a set of links between these masses, some
//! of them negative. Together the links are passive, because each form is. For a rim that is held but free to turn, on
//! straight edges, the second part vanishes and the first is the square of the membrane's matrix.

use std::f64::consts::{PI, TAU};

use super::fit::least_squares;
use super::plate::{Rim, Shape, plate};
use super::sparse::Sparse;
use super::{GeneratorError, Topology, check_count};
use crate::interrupt;
use crate::maths::{cos, sin, sqrt};

/// Most rings: the lowest eigenvalue is r⁴ times smaller than the highest, and is found by iteration.
const MAX_RADIUS: usize = 60;
/// Fewest rings for which a curvature can be resolved.
const MIN_RADIUS: usize = 3;
/// Masses within this many spacings are neighbours, whose links harden.
const NEIGHBOUR: f64 = 1.3;
/// Masses within this many spacings form the first patch for a parabola; the patch grows until it has enough masses.
const PATCH: f64 = 1.35;
/// Coefficients of a parabola: w, w_x, w_y, w_xx, w_yy, w_xy.
const UNKNOWNS: usize = 6;

/// A plate of `radius` rings round its centre that resists bending, of Poisson's ratio `poisson`.
///
/// # Errors
/// Numbers out of range.
pub fn bent_plate(shape: Shape, radius: usize, rim: Rim, poisson: f64) -> Result<Topology, GeneratorError> {
    match shape {
        Shape::Rectangle { across, up } => {
            let sides_label = "`sides` of a plate that bends";
            for side in [across, up] {
                check_count(sides_label, side, 2 * MIN_RADIUS + 1, 2 * MAX_RADIUS + 1)?;
            }
        }
        _ => check_count("`radius` of a plate that bends", radius, MIN_RADIUS, MAX_RADIUS)?,
    }
    if !(0.0..=0.5).contains(&poisson) {
        return Err(GeneratorError::Range {
            what: "`poisson`",
            range: "from 0 to 0.5",
            got: poisson,
        });
    }
    match (shape, rim) {
        (Shape::Disc, _) => Ok(curved(disc(radius, rim), poisson)),
        (_, Rim::Fixed) => held(plate(shape, radius, rim)?),
        (_, Rim::Free) => {
            let flat_plate = plate(shape, radius, rim)?;
            Ok(curved(Sites::from_mesh(&flat_plate), poisson))
        }
    }
}

/// A rim that is held but free to turn, on straight edges: the square of the membrane's matrix.
fn held(membrane: Topology) -> Result<Topology, GeneratorError> {
    let membrane_lambda = membrane.lowest_lambda()?;
    let membrane_matrix = Sparse::stiffness(&membrane);
    let membrane_sites = Sites::from_mesh(&membrane);
    let runs = membrane_matrix
        .product(&membrane_matrix)
        .links(membrane.n_mat, |a, b| membrane_sites.are_neighbours(a, b));
    Ok(Topology {
        runs,
        lowest_lambda: Some(membrane_lambda * membrane_lambda),
        ..membrane
    })
}

/// Where masses lie, and the area of the plate that each represents.
pub(super) struct Sites {
    /// Masses, then fixed points [spacings]   (n_mat + n_fixed,)
    pub(super) places: Vec<[f64; 2]>,
    pub(super) n_mat: usize,
    /// Area [spacings²]   (n_mat + n_fixed,)
    pub(super) areas: Vec<f64>,
    /// Positions on the picture of the instrument [m]   (n_mat + n_fixed,)
    pub(super) positions: Vec<[f64; 2]>,
    pub(super) centre: usize,
}

impl Sites {
    /// The sites of a mesh whose links are all one spacing long; its outermost masses lie on the edge.
    fn from_mesh(mesh: &Topology) -> Self {
        let mesh_run = &mesh.runs[0];
        let spacing = distance(mesh.positions[mesh_run.a], mesh.positions[mesh_run.b]);
        let places: Vec<[f64; 2]> = mesh
            .positions
            .iter()
            .map(|place| place.map(|coordinate| coordinate / spacing))
            .collect();
        let mut link_counts = vec![0_usize; places.len()];
        for mesh_run in &mesh.runs {
            for i in 0..mesh_run.len {
                link_counts[mesh_run.a + i] += 1;
                link_counts[mesh_run.b + i] += 1;
            }
        }
        let degree_max = link_counts.iter().copied().max().unwrap_or(0);
        // Between two successive neighbours lies a triangle or a quarter of a square; at an edge there is one fewer
        // than links.
        let area_share = |links: &usize| match *links {
            links if links == degree_max => 1.0,
            links => links.saturating_sub(1) as f64 / degree_max as f64,
        };
        Self {
            areas: link_counts.iter().map(area_share).collect(),
            places,
            n_mat: mesh.n_mat,
            positions: mesh.positions.clone(),
            centre: mesh.centre,
        }
    }

    fn are_neighbours(&self, a: usize, b: usize) -> bool {
        distance(self.places[a], self.places[b]) <= NEIGHBOUR
    }
}

/// Rings of 6, 12, 18 … masses round the middle, the outermost on the edge.
pub(super) fn disc(radius: usize, rim: Rim) -> Sites {
    let mut places = vec![[0.0, 0.0]];
    let mut areas = vec![PI / 4.0];
    for ring in 1..=radius {
        let (members, ring_radius) = (6 * ring, ring as f64);
        let outer_radius = if ring == radius { ring_radius } else { ring_radius + 0.5 };
        let member_area =
            PI * (outer_radius * outer_radius - (ring_radius - 0.5) * (ring_radius - 0.5)) / members as f64;
        for i in 0..members {
            let angle = TAU * i as f64 / members as f64;
            places.push([ring_radius * cos(angle), ring_radius * sin(angle)]);
            areas.push(member_area);
        }
    }
    let held_count = match rim {
        Rim::Free => 0,
        Rim::Fixed => 6 * radius,
    };
    let disc_width = 2.0 * radius as f64;
    Sites {
        n_mat: places.len() - held_count,
        positions: places
            .iter()
            .map(|place| place.map(|coordinate| coordinate / disc_width))
            .collect(),
        places,
        areas,
        centre: 0,
    }
}

/// The links of the curvatures at all masses.
fn curved(sites: Sites, poisson: f64) -> Topology {
    let n_places = sites.places.len();
    let mut bending_matrix = Sparse::zero(sites.n_mat);
    for middle in 0..n_places {
        if middle.is_multiple_of(64) {
            interrupt::poll();
        }
        let patch = patch(&sites, middle);
        let [xx, yy, xy] = curvatures(&sites, middle, &patch);
        let site_area = sites.areas[middle];
        for (i, &a) in patch.iter().enumerate() {
            for (j, &b) in patch.iter().enumerate() {
                if a < sites.n_mat && b < sites.n_mat {
                    let square_terms = xx[i] * xx[j] + yy[i] * yy[j];
                    let cross_term = xx[i] * yy[j] + yy[i] * xx[j];
                    let twist_term = 2.0 * (1.0 - poisson) * xy[i] * xy[j];
                    bending_matrix.add(a, b, site_area * (square_terms + poisson * cross_term + twist_term));
                }
            }
        }
    }
    let link_runs = bending_matrix.links(sites.n_mat, |a, b| sites.are_neighbours(a, b));
    let mat_areas = &sites.areas[..sites.n_mat];
    let mean_area = mat_areas.iter().sum::<f64>() / sites.n_mat as f64;
    Topology {
        centre: sites.centre,
        shares: mat_areas.iter().map(|site_area| site_area / mean_area).collect(),
        has_tilt_modes: n_places == sites.n_mat,
        ..Topology::new(sites.n_mat, link_runs, sites.positions)
    }
}

/// The masses around `middle`, enough for a parabola.
fn patch(sites: &Sites, middle: usize) -> Vec<usize> {
    let mut patch_reach = PATCH;
    loop {
        let is_near = |other: &usize| distance(sites.places[*other], sites.places[middle]) < patch_reach;
        let neighbours: Vec<usize> = (0..sites.places.len()).filter(is_near).collect();
        if neighbours.len() > UNKNOWNS {
            return neighbours;
        }
        patch_reach *= 1.1;
    }
}

/// w_xx, w_yy and w_xy at a mass as sums over its patch, by weighted least squares.
fn curvatures(sites: &Sites, middle: usize, patch: &[usize]) -> [Vec<f64>; 3] {
    let [middle_x, middle_y] = sites.places[middle];
    let middle_offset = |mass: &usize| [sites.places[*mass][0] - middle_x, sites.places[*mass][1] - middle_y];
    let fit_weight = |[x, y]: [f64; 2]| 1.0 / (0.3 + x * x + y * y);
    let parabola_terms: [fn([f64; 2]) -> f64; UNKNOWNS] = [
        |_| 1.0,
        |[x, _]| x,
        |[_, y]| y,
        |[x, _]| 0.5 * x * x,
        |[_, y]| 0.5 * y * y,
        |[x, y]| x * y,
    ];
    let columns = parabola_terms.map(|term| {
        let weighted_term = |mass| fit_weight(middle_offset(mass)) * term(middle_offset(mass));
        patch.iter().map(weighted_term).collect::<Vec<f64>>()
    });
    let mut derivatives = [(); 3].map(|()| vec![0.0; patch.len()]);
    for (i, mass) in patch.iter().enumerate() {
        let mut unit_column = vec![0.0; patch.len()];
        unit_column[i] = fit_weight(middle_offset(mass));
        let coefficients = least_squares(&columns, &unit_column);
        for (sum, coefficient) in derivatives.iter_mut().zip(&coefficients[3..]) {
            sum[i] = *coefficient;
        }
    }
    derivatives
}

fn distance([ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> f64 {
    sqrt((ax - bx) * (ax - bx) + (ay - by) * (ay - by))
}
