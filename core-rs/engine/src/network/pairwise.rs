//! Links between all pairs of points of two groups, or of one group.

use super::checks::Rule;
use super::error::Error;
use super::space::{AXES_MAX, COLLAPSE_MESSAGE, Measure, SpaceLaw, SpaceLink, SpacePoint};
use super::{LinkKind, Network, Run};

/// Contacts or attractions between all pairs of points of two groups. Link i belongs to the i-th point of the second
/// group: its force is the sum of all forces on that point.
#[derive(Clone, Debug, PartialEq)]
pub struct Pairwise {
    /// The link of each pair.
    pub link: SpaceLink,
    /// Number of points of the first group; the second has as many points as the run has links.
    pub n_first: usize,
    /// Whether both groups are the same, so that its points meet each other.
    pub is_within: bool,
    /// Coefficient of dry friction perpendicular to the line of a contact.
    pub friction: f64,
}

/// The law of a pair of points.
#[derive(Clone, Debug, PartialEq)]
pub struct PairLaw {
    /// What the pair measures.
    pub measure: Measure,
    /// The force for that measure: a contact or an attraction.
    pub law: SpaceLaw,
    /// Coefficient of dry friction perpendicular to the line of a contact; 0 for an attraction.
    pub friction: f64,
}

impl PairLaw {
    /// A pair law without friction.
    pub const fn smooth(measure: Measure, law: SpaceLaw) -> Self {
        Self {
            measure,
            law,
            friction: 0.0,
        }
    }
}

/// The numbers of a pairwise run that decide which pairs touch.
#[derive(Clone, Debug)]
pub(crate) struct PairRun {
    pub(crate) pairs: Pairwise,
    /// First coordinates of the first points of both groups.
    pub(crate) a: usize,
    pub(crate) b: usize,
    /// Number of points of the second group.
    pub(crate) n_second: usize,
    /// Length below which a pair touches [m].
    pub(crate) rest: f64,
}

impl PairRun {
    /// The numbers of two points from their first coordinates: points of the first group come first, then those of the
    /// second, if it is another group.
    pub(crate) fn points(&self, (a, b): (usize, usize)) -> [u32; 2] {
        [(a - self.a) as u32, (self.n_before_second() + b - self.b) as u32]
    }

    /// The first coordinates of two points from their numbers.
    pub(crate) fn ends(&self, [first, second]: [u32; 2]) -> (usize, usize) {
        let second = self.b + second as usize - self.n_before_second();
        (self.a + first as usize, second)
    }

    /// How many points are numbered before the second group.
    fn n_before_second(&self) -> usize {
        if self.pairs.is_within { 0 } else { self.pairs.n_first }
    }

    /// The MATs of its points: two ranges per axis.
    pub(crate) fn point_ranges(&self) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        let Self {
            pairs, a, b, n_second, ..
        } = self;
        let (a, b, n_second) = (*a, *b, *n_second);
        (0..pairs.link.n_axes).flat_map(move |axis| {
            let (a, b) = pairs.link.pair((a, b), axis);
            [a..a + pairs.n_first, b..b + n_second]
        })
    }
}

/// Consecutive points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointGroup {
    /// The first.
    pub first: SpacePoint,
    /// How many.
    pub n: usize,
}

impl Pairwise {
    /// Largest number of neighbours of a sphere among equal spheres: in a plane, and in space.
    const NEIGHBOURS_MAX: [f64; 2] = [6.0, 12.0];

    /// Coordinates along `axis` of two points that may meet, of link i in a run that begins at `ends`: a point of the
    /// first group, and the i-th point of the second group.
    pub(crate) fn pair(&self, ends: (usize, usize), i: usize, axis: usize) -> (usize, usize) {
        let first_index = if self.is_within { i + 1 } else { i };
        self.link.pair((ends.0 + first_index % self.n_first, ends.1 + i), axis)
    }

    /// Number of points of both groups together.
    pub(crate) fn n_points(&self, n_second: usize) -> usize {
        if self.is_within {
            n_second
        } else {
            self.n_first + n_second
        }
    }

    /// Largest number of points of the other group that push a point at once: for a point of the first group, and for
    /// one of the second.
    pub(crate) fn neighbours(&self, n_second: usize) -> [f64; 2] {
        if self.is_searched() {
            [Self::NEIGHBOURS_MAX[self.link.n_axes - 2]; 2]
        } else {
            [n_second as f64, self.n_first as f64]
        }
    }

    /// Whether touching pairs are searched by position. Otherwise all pairs are examined: there are few, or they do not
    /// touch by their distance.
    pub(crate) fn is_searched(&self) -> bool {
        self.link.law.is_contact() && self.link.measure == Measure::Distance && self.n_first > 1
    }

    /// Points of the second group that a point of the first may meet, when all pairs are examined.
    pub(crate) fn partners(&self, first: usize, n_second: usize) -> std::ops::Range<usize> {
        if self.is_within {
            first + 1..n_second
        } else {
            0..n_second
        }
    }
}

impl Run {
    /// The run as pairwise links; `None` for other kinds.
    pub(crate) fn pairwise(&self) -> Option<PairRun> {
        match &self.kind {
            LinkKind::Pairwise(pairs) => Some(PairRun {
                pairs: pairs.clone(),
                a: self.a,
                b: self.b,
                n_second: self.len,
                rest: self.rest,
            }),
            _ => None,
        }
    }
}

impl Network {
    /// Add contacts or attractions between every point of one group and every point of a second, which must not be
    /// smaller. If both groups are the same, all its points meet each other. Returns the index of the first link; there
    /// are as many links as points in the second group.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range or the groups cannot meet.
    pub fn pairwise(
        &mut self,
        name: &str,
        groups: [PointGroup; 2],
        n_axes: usize,
        law: PairLaw,
        [k, z, gap]: [f64; 3],
    ) -> Result<usize, Error> {
        let (measure, friction) = (law.measure.clone(), law.friction);
        self.check(name, &[("friction", friction, Rule::NotNegative)])?;
        // The gap to a plane may have either sign: the plane may lie beside the point that carries it.
        let checked_gap = match &measure {
            Measure::Plane(_) if gap.is_finite() => 0.0,
            _ => gap,
        };
        self.check_space(name, n_axes, &law.law, [k, z, checked_gap])?;
        let [first_group, second_group] = groups;
        let is_within = first_group == second_group;
        if let Some(message) = refusal(groups, n_axes, &law, gap) {
            return Err(self.refused(name, message));
        }
        if !groups.iter().all(|group| self.has_points(group.first, group.n, n_axes)) {
            return Err(self.refused(name, "joins a module that does not exist"));
        }
        self.check_capacity(name, second_group.n)?;
        let first_link = self.n_lia;
        let law_reach = law.law.reach();
        let rest_length = law_reach
            + match measure {
                Measure::Within => -gap,
                Measure::Distance | Measure::Plane(_) | Measure::Surface(_) => gap,
            };
        let link = SpaceLink::new(law.law, measure, n_axes, [first_group.first, second_group.first]);
        let point_pairs = Pairwise {
            link,
            n_first: first_group.n,
            is_within,
            friction,
        };
        let (link_kind, first_mats) = (
            LinkKind::Pairwise(point_pairs),
            (first_group.first.first, second_group.first.first),
        );
        self.add_run(
            link_kind,
            first_mats.0,
            first_mats.1,
            second_group.n,
            [k, z, rest_length],
        );
        let name = self.full_name(name);
        self.names
            .add_links(first_link, second_group.n, second_group.n > 1, name);
        Ok(first_link)
    }
}

/// Why two groups cannot meet; `None` if they can.
fn refusal([a, b]: [PointGroup; 2], n_axes: usize, pair_law: &PairLaw, gap: f64) -> Option<&'static str> {
    let (space_law, measure, friction) = (&pair_law.law, &pair_law.measure, pair_law.friction);
    let is_contact = space_law.is_contact();
    let attracts = matches!(space_law, SpaceLaw::Attraction { .. });
    let normal_length = |normal: &[f64; AXES_MAX]| super::distance(normal[0], normal[1], normal[2]);
    // No two axes share a MAT.
    let has_separate_axes = |group: PointGroup| {
        let mut axis_starts: Vec<usize> = (0..n_axes.min(AXES_MAX))
            .filter_map(|axis| group.first.coordinate(axis))
            .collect();
        axis_starts.sort_unstable();
        axis_starts
            .windows(2)
            .all(|axis_pair| axis_pair[1] - axis_pair[0] >= group.n)
    };
    let starts_inside = |group: PointGroup, other_group: PointGroup| {
        (group.first.first..group.first.first + group.n).contains(&other_group.first.first)
    };
    if a.n == 0 || b.n < a.n || (a == b && b.n < 2) {
        Some("needs two groups of points, the second not smaller than the first")
    } else if a != b && (starts_inside(a, b) || starts_inside(b, a)) {
        Some("its two groups have points in common")
    } else if !has_separate_axes(a) || !has_separate_axes(b) {
        Some("the coordinates of a group lie axis by axis")
    } else if a == b && *measure != Measure::Distance {
        Some("points of one group meet by their distance")
    } else if !is_contact && !attracts {
        Some("only contacts and attractions act between all pairs of points")
    } else if attracts && (*measure != Measure::Distance || gap != 0.0 || friction != 0.0) {
        Some("an attraction acts along a distance, without a gap and without friction")
    } else if is_contact && *measure == Measure::Distance && a.n > 1 && gap <= 0.0 {
        Some("points that meet need a gap above 0: the distance at which they touch")
    } else if matches!(measure, Measure::Distance | Measure::Surface(_)) && space_law.rests_beyond_gap(gap) {
        Some(COLLAPSE_MESSAGE)
    } else if matches!(measure, Measure::Plane(normal) if (normal_length(normal) - 1.0).abs() > 1e-9
        || (n_axes == 2 && normal[2] != 0.0))
    {
        Some("the normal of a plane has a length of 1")
    } else if matches!(measure, Measure::Surface(_) if n_axes != AXES_MAX) {
        Some("a surface of triangles is touched in three axes")
    } else if matches!(measure, Measure::Surface(facets) if facets.reach() < gap + space_law.reach()) {
        Some("the gap plus the reach of the contact must not exceed the search distance of the surface")
    } else {
        None
    }
}
