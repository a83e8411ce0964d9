//! Links between points in space.

use std::sync::Arc;

use ergon_engine::network::{Facets, Measure, PairLaw, PointGroup, SpaceLaw, SpacePoint};
use pyo3::prelude::*;

use super::Network;
use crate::error::{from_engine, refused};
use crate::law::Law;

/// Two points in space by the MATs that are their coordinates, and how many axes they have.
fn points(name: &str, ends: [&[usize]; 2]) -> PyResult<([SpacePoint; 2], usize)> {
    let axes = ends[0].len();
    if !(2..=3).contains(&axes) || ends[1].len() != axes {
        let message = "a link in space joins points with two or three coordinates each";
        return Err(refused(name, message));
    }
    let behind = |end: &[usize], axis: usize| {
        let mat = end.get(axis).unwrap_or(&end[0]);
        (*mat as isize).wrapping_sub(end[0] as isize)
    };
    let ends = ends.map(|end| SpacePoint {
        first: end[0],
        offsets: [behind(end, 1), behind(end, 2)],
    });
    Ok((ends, axes))
}

/// A contact of power `exponent` and stiffness `k`; with a pull `cohesion` [N] one that sticks.
fn contact([exponent, k]: [f64; 2], clamp: bool, cohesion: Option<f64>, reach: f64) -> SpaceLaw {
    match cohesion {
        None => SpaceLaw::Contact { exponent, clamp },
        Some(pull) => SpaceLaw::Cohesive {
            exponent,
            clamp,
            sink: pull / k,
            reach,
        },
    }
}

/// Corners [m], and the corners of each triangle.
type Triangles = (Vec<[f64; 3]>, Vec<[u32; 3]>);

#[pymethods]
impl Network {
    /// The distance of two points in space at the beginning [m]; each is the MATs that are its coordinates.
    fn distance(&self, a: Vec<usize>, b: Vec<usize>) -> PyResult<f64> {
        for &mat in a.iter().chain(&b) {
            self.there(mat)?;
        }
        let (ends, axes) = points("distance", [&a, &b])?;
        Ok(self.0.distance((ends[0], ends[1]), axes))
    }

    /// Springs between `count` pairs of points in space that follow one another; an end is the MATs that are the
    /// coordinates of its first point.
    /// Beyond the force `yields` [N] their rest length follows, and `breaks` [m] longer than it was they break.
    /// Beyond the distance `core` [m] their force falls as that of masses that attract each other.
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
        let law = match (core, yields, breaks) {
            (Some(core), None, None) => SpaceLaw::Attraction { core },
            (Some(_), ..) => {
                return Err(refused(name, "an attraction neither yields nor breaks"));
            }
            (None, None, None) => SpaceLaw::Spring,
            _ => SpaceLaw::Yielding {
                yields: yields.unwrap_or(f64::INFINITY),
                breaks: breaks.unwrap_or(f64::INFINITY),
            },
        };
        self.space(name, [&a, &b], count, law, [K, Z, rest])
    }

    /// A link between two points in space that does nothing: its length can be listened to.
    fn gauge(&mut self, name: &str, a: Vec<usize>, b: Vec<usize>) -> PyResult<usize> {
        self.space(name, [&a, &b], 1, SpaceLaw::Gauge, [0.0; 3])
    }

    /// Contacts between `count` pairs of points in space that follow one another, closed where they are nearer than `gap`.
    /// With `cohesion` [N] they pull as well, until the ends are `reach` [m] farther apart than that.
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
        let law = contact([exponent, K], clamp, cohesion, reach);
        let rest = gap + law.reach();
        self.space(name, [&a, &b], count, law, [K, Z, rest])
    }

    /// A law of distance − `rest` between two points in space.
    fn space_lnl(
        &mut self,
        name: &str,
        a: Vec<usize>,
        b: Vec<usize>,
        law: &Law,
        rest: f64,
    ) -> PyResult<usize> {
        let (ends, axes) = points(name, [&a, &b])?;
        let law = Arc::new(law.0.clone());
        self.0
            .space_lnl(name, (ends[0], ends[1]), axes, law, rest)
            .map_err(from_engine)
    }

    /// Contacts between all points of two groups, each (coordinates of its first point, count); the same group twice: between
    /// all its points. With `normal` they touch planes through the points of the first group, with `surface` triangles (their
    /// corners [m] from these points, and corners of each), with `inside` they are held in spheres around these. `friction` is the coefficient of dry friction across a contact. With `core` [m] they attract
    /// each other. With `cohesion` [N] they pull as well, until the ends are `reach` [m] farther apart than where they touch.
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
                let facets = Facets::new(&corners, &triangles, gap + law.reach())
                    .map_err(|message| refused(name, message))?;
                Measure::Surface(Arc::new(facets))
            }
            (Some(normal), None) => Measure::Plane(normal),
            (None, None) if inside => Measure::Within,
            (None, None) => Measure::Distance,
        };
        let own = PairLaw {
            measure,
            law,
            friction,
        };
        let (ends, axes) = points(name, [&a.0, &b.0])?;
        let groups = [(ends[0], a.1), (ends[1], b.1)].map(|(first, n)| PointGroup { first, n });
        self.0
            .pairwise(name, groups, axes, own, [K, Z, gap])
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
        numbers: [f64; 3],
    ) -> PyResult<usize> {
        let (ends, axes) = points(name, ends)?;
        self.0
            .space_links(name, (ends[0], ends[1]), count, axes, law, numbers)
            .map_err(from_engine)
    }
}
