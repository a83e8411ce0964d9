//! PLATE of shape disc without `bending`: a round membrane, as masses and springs between neighbours.
//!
//! Rings of 6, 12, 18 … masses are joined by triangles, over which the membrane is flat. The energy of a triangle is
//! that of a spring along each side, whose stiffness is half the cotangent of the opposite angle (R. Duffin, J. Math.
//! Mech. 8, 1959). A third of its area goes to each of its corners.

use super::bent_plate::{Sites, disc};
use super::plate::Rim;
use super::sparse::Sparse;
use super::{GeneratorError, Topology, count};

/// Most rings, as many as 2,000,000 masses have.
const MAX_RADIUS: usize = 815;

/// A membrane of `radius` rings round its centre, the outermost on its rim.
///
/// # Errors
/// Too few rings or too many.
pub fn round_membrane(radius: usize, rim: Rim) -> Result<Topology, GeneratorError> {
    count("`radius` of a disc", radius, 2, MAX_RADIUS)?;
    let Sites {
        places,
        n_mat,
        positions,
        centre,
        ..
    } = disc(radius, rim);
    let mut matrix = Sparse::zero(n_mat);
    let mut areas = vec![0.0; places.len()];
    let from = |a: usize, b: usize| [places[b][0] - places[a][0], places[b][1] - places[a][1]];
    for corners in triangles(radius) {
        let [a, b, c] = corners;
        let (to_b, to_c) = (from(a, b), from(a, c));
        let double_area = (to_b[0] * to_c[1] - to_b[1] * to_c[0]).abs();
        for (apex, first, two) in [(a, b, c), (b, c, a), (c, a, b)] {
            let (u, v) = (from(apex, first), from(apex, two));
            let half_cotangent = 0.5 * (u[0] * v[0] + u[1] * v[1]) / double_area;
            for (near, other) in [(first, two), (two, first)] {
                if near < n_mat {
                    matrix.add(near, near, half_cotangent);
                    if other < n_mat {
                        matrix.add(near, other, -half_cotangent);
                    }
                }
            }
            areas[apex] += double_area / 6.0;
        }
    }
    let shares = &areas[..n_mat];
    let mean = shares.iter().sum::<f64>() / n_mat as f64;
    Ok(Topology {
        centre,
        shares: shares.iter().map(|area| area / mean).collect(),
        ..Topology::new(n_mat, matrix.links(n_mat, |_, _| true), positions)
    })
}

/// Corners of all triangles: in each of six sectors those with a side on the outer ring, and those with a side on the
/// inner ring.
fn triangles(radius: usize) -> Vec<[usize; 3]> {
    let member = |ring: usize, place: usize| match ring {
        0 => 0,
        _ => 1 + 3 * ring * (ring - 1) + place % (6 * ring),
    };
    let mut faces = Vec::with_capacity(6 * radius * radius);
    for ring in 1..=radius {
        let inner = ring - 1;
        for sector in 0..6 {
            let out = |place: usize| member(ring, sector * ring + place);
            let inside = |place: usize| member(inner, sector * inner + place);
            faces.extend((0..ring).map(|i| [out(i), out(i + 1), inside(i)]));
            faces.extend((0..inner).map(|i| [inside(i), inside(i + 1), out(i + 1)]));
        }
    }
    faces
}
