//! PLATE of shape disc without `bending`: a round membrane, as masses and springs between neighbours.
//!
//! Rings of 6, 12, 18 … masses are joined by triangles, over which the membrane is flat. The energy of a triangle is
//! that of a spring along each side, whose stiffness is half the cotangent of the opposite angle (R. Duffin, J. Math.
//! Mech. 8, 1959). A third of its area goes to each of its corners.

use super::bent_plate::{Sites, disc};
use super::plate::Rim;
use super::sparse::Sparse;
use super::{GeneratorError, Topology, check_count};

/// Most rings, as many as 2,000,000 masses have.
const MAX_RADIUS: usize = 815;

/// A membrane of `radius` rings round its centre, the outermost on its rim.
///
/// # Errors
/// Too few rings or too many.
pub fn round_membrane(radius: usize, rim: Rim) -> Result<Topology, GeneratorError> {
    check_count("`radius` of a disc", radius, 2, MAX_RADIUS)?;
    let Sites {
        places,
        n_mat,
        positions,
        centre,
        ..
    } = disc(radius, rim);
    let mut cotangent_matrix = Sparse::zero(n_mat);
    let mut point_areas = vec![0.0; places.len()];
    let edge_vector = |corner_a: usize, corner_b: usize| {
        [
            places[corner_b][0] - places[corner_a][0],
            places[corner_b][1] - places[corner_a][1],
        ]
    };
    for corners in triangles(radius) {
        let [corner_a, corner_b, corner_c] = corners;
        let (edge_to_b, edge_to_c) = (edge_vector(corner_a, corner_b), edge_vector(corner_a, corner_c));
        let double_area = (edge_to_b[0] * edge_to_c[1] - edge_to_b[1] * edge_to_c[0]).abs();
        for (apex, side_start, side_end) in [
            (corner_a, corner_b, corner_c),
            (corner_b, corner_c, corner_a),
            (corner_c, corner_a, corner_b),
        ] {
            let (first_edge, second_edge) = (edge_vector(apex, side_start), edge_vector(apex, side_end));
            let half_cotangent = 0.5 * (first_edge[0] * second_edge[0] + first_edge[1] * second_edge[1]) / double_area;
            for (near, other) in [(side_start, side_end), (side_end, side_start)] {
                if near < n_mat {
                    cotangent_matrix.add(near, near, half_cotangent);
                    if other < n_mat {
                        cotangent_matrix.add(near, other, -half_cotangent);
                    }
                }
            }
            point_areas[apex] += double_area / 6.0;
        }
    }
    let mass_areas = &point_areas[..n_mat];
    let mean_area = mass_areas.iter().sum::<f64>() / n_mat as f64;
    Ok(Topology {
        centre,
        shares: mass_areas.iter().map(|area| area / mean_area).collect(),
        ..Topology::new(n_mat, cotangent_matrix.links(n_mat, |_, _| true), positions)
    })
}

/// Corners of all triangles: in each of six sectors those with a side on the outer ring, and those with a side on the
/// inner ring.
fn triangles(radius: usize) -> Vec<[usize; 3]> {
    let ring_member = |ring: usize, place: usize| match ring {
        0 => 0,
        _ => 1 + 3 * ring * (ring - 1) + place % (6 * ring),
    };
    let mut face_corners = Vec::with_capacity(6 * radius * radius);
    for ring in 1..=radius {
        let inner_ring = ring - 1;
        for sector in 0..6 {
            let outer_member = |place: usize| ring_member(ring, sector * ring + place);
            let inner_member = |place: usize| ring_member(inner_ring, sector * inner_ring + place);
            face_corners.extend((0..ring).map(|i| [outer_member(i), outer_member(i + 1), inner_member(i)]));
            face_corners.extend((0..inner_ring).map(|i| [inner_member(i), inner_member(i + 1), outer_member(i + 1)]));
        }
    }
    face_corners
}
