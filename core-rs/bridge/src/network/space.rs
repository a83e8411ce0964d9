//! Links between points in space.

use std::sync::Arc;

use ergon_engine::network::{Facets, Measure, PairLaw, PointGroup, SpaceLaw, SpacePoint};
use pyo3::prelude::*;

use super::Network;
use crate::error::{from_engine, module_error};
use crate::law::Law;

/// Checks two points in space, each given by the MATs of its axes; returns them and the number of axes.
fn space_points(name: &str, ends: [&[usize]; 2]) -> PyResult<([SpacePoint; 2], usize)> {
    let n_axes = ends[0].len();
    if !(2..=3).contains(&n_axes) || ends[1].len() != n_axes {
        let message = "a link in space joins points with two or three coordinates each";
        return Err(module_error(name, message));
    }
    let axis_offset = |end: &[usize], axis: usize| {
        let axis_mat = end.get(axis).unwrap_or(&end[0]);
        (*axis_mat as isize).wrapping_sub(end[0] as isize)
    };
    let ends = ends.map(|end| SpacePoint {
        first: end[0],
        offsets: [axis_offset(end, 1), axis_offset(end, 2)],
    });
    Ok((ends, n_axes))
}

/// A contact with exponent `exponent` and stiffness `k`; with `cohesion` [N], a contact that also pulls, up to `reach`
/// [m] apart.
fn contact([exponent, k]: [f64; 2], is_clamped: bool, cohesion: Option<f64>, reach: f64) -> SpaceLaw {
    match cohesion {
        None => SpaceLaw::Contact { exponent, is_clamped },
        Some(cohesion_force) => SpaceLaw::Cohesive {
            exponent,
            is_clamped,
            sink: cohesion_force / k,
            reach,
        },
    }
}

/// Corners [m], and the three corners of each triangle.
type Triangles = (Vec<[f64; 3]>, Vec<[u32; 3]>);

#[pymethods]
impl Network {
    /// Distance [m] of two points in space at the beginning; each is the MATs of its axes.
    fn distance(&self, a: Vec<usize>, b: Vec<usize>) -> PyResult<f64> {
        for &mat in a.iter().chain(&b) {
            self.check_mat(mat)?;
        }
        let (end_points, n_axes) = space_points("distance", [&a, &b])?;
        Ok(self.0.distance((end_points[0], end_points[1]), n_axes))
    }

    /// Springs and dampers between `count` pairs of consecutive points in space; an end is the MATs of the axes of its
    /// first point.
    ///
    /// Beyond the force `yields` [N] the rest length follows; `breaks` [m] longer than `rest` a link breaks for good.
    /// Beyond the distance `core` [m] the force falls as that of masses that attract each other.
    #[pyo3(signature = (name, a, b, *, rest, count=1, K=0.0, Z=0.0, yields=None, breaks=None, core=None))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn space_ref(
        &mut self,
        name: &str,
        a: Vec<usize>,
        b: Vec<usize>,
        rest: f64,
        count: usize,
        K: f64,
        Z: f64,
        yields: Option<f64>,
        breaks: Option<f64>,
        core: Option<f64>,
    ) -> PyResult<usize> {
        let space_law = match (core, yields, breaks) {
            (Some(core), None, None) => SpaceLaw::Attraction { core },
            (Some(_), ..) => {
                return Err(module_error(name, "an attraction neither yields nor breaks"));
            }
            (None, None, None) => SpaceLaw::Spring,
            _ => SpaceLaw::Yielding {
                yield_force: yields.unwrap_or(f64::INFINITY),
                break_elongation: breaks.unwrap_or(f64::INFINITY),
            },
        };
        self.space(name, [&a, &b], count, space_law, [K, Z, rest])
    }

    /// A link between two points in space without force, to listen to its length; its index.
    fn gauge(&mut self, name: &str, a: Vec<usize>, b: Vec<usize>) -> PyResult<usize> {
        self.space(name, [&a, &b], 1, SpaceLaw::Gauge, [0.0; 3])
    }

    /// Contacts between `count` pairs of consecutive points in space, closed at distances below `gap` [m].
    ///
    /// With `cohesion` [N] they also pull, until the ends are `reach` [m] farther apart than `gap`.
    #[pyo3(signature = (name, a, b, *, gap, count=1, K=0.0, Z=0.0, exponent=1.0, clamp=false, cohesion=None, reach=0.0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn space_but(
        &mut self,
        name: &str,
        a: Vec<usize>,
        b: Vec<usize>,
        gap: f64,
        count: usize,
        K: f64,
        Z: f64,
        exponent: f64,
        clamp: bool,
        cohesion: Option<f64>,
        reach: f64,
    ) -> PyResult<usize> {
        let contact_law = contact([exponent, K], clamp, cohesion, reach);
        let rest_distance = gap + contact_law.reach();
        self.space(name, [&a, &b], count, contact_law, [K, Z, rest_distance])
    }

    /// A link between two points in space with a law of distance − `rest` [m]; the LIA's index.
    fn space_lnl(&mut self, name: &str, a: Vec<usize>, b: Vec<usize>, law: &Law, rest: f64) -> PyResult<usize> {
        let (end_points, n_axes) = space_points(name, [&a, &b])?;
        let law = Arc::new(law.0.clone());
        self.0
            .space_lnl(name, (end_points[0], end_points[1]), n_axes, law, rest)
            .map_err(from_engine)
    }

    /// Contacts between all points of two groups, each (MATs of the axes of its first point, count); with the same
    /// group twice, between all its points.
    ///
    /// The points of `b` touch planes through the points of `a` with `normal`, triangles with `surface` (corners [m]
    /// from the points of `a`, and the corners of each triangle), and are held in spheres around the points of `a` with
    /// `inside`. `friction` is the coefficient of dry friction across a contact. With `core` [m] the points attract
    /// each other. With `cohesion` [N] they also pull, until the ends are `reach` [m] farther apart than where they
    /// touch.
    #[pyo3(signature = (name, a, b, *, gap=0.0, K=0.0, Z=0.0, exponent=1.0, clamp=false, inside=false, normal=None, surface=None, friction=0.0, core=None, cohesion=None, reach=0.0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn pairwise(
        &mut self,
        name: &str,
        a: (Vec<usize>, usize),
        b: (Vec<usize>, usize),
        gap: f64,
        K: f64,
        Z: f64,
        exponent: f64,
        clamp: bool,
        inside: bool,
        normal: Option<[f64; 3]>,
        surface: Option<Triangles>,
        friction: f64,
        core: Option<f64>,
        cohesion: Option<f64>,
        reach: f64,
    ) -> PyResult<usize> {
        let law = match core {
            Some(core) => SpaceLaw::Attraction { core },
            None => contact([exponent, K], clamp, cohesion, reach),
        };
        let measure = match (normal, surface) {
            (_, Some((corners, triangles))) => {
                let surface_facets = Facets::new(&corners, &triangles, gap + law.reach())
                    .map_err(|message| module_error(name, message))?;
                Measure::Surface(Arc::new(surface_facets))
            }
            (Some(normal), None) => Measure::Plane(normal),
            (None, None) if inside => Measure::Within,
            (None, None) => Measure::Distance,
        };
        let pair_law = PairLaw { measure, law, friction };
        let (end_points, n_axes) = space_points(name, [&a.0, &b.0])?;
        let point_groups = [(end_points[0], a.1), (end_points[1], b.1)].map(|(first, n)| PointGroup { first, n });
        self.0
            .pairwise(name, point_groups, n_axes, pair_law, [K, Z, gap])
            .map_err(from_engine)
    }
}

impl Network {
    fn space(
        &mut self,
        name: &str,
        ends: [&[usize]; 2],
        count: usize,
        law: SpaceLaw,
        k_z_rest: [f64; 3],
    ) -> PyResult<usize> {
        let (ends, n_axes) = space_points(name, ends)?;
        self.0
            .space_links(name, (ends[0], ends[1]), count, n_axes, law, k_z_rest)
            .map_err(from_engine)
    }
}
