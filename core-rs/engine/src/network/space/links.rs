//! Springs, contacts and laws between points in space.

use std::sync::Arc;

use super::super::checks::Rule;
use super::super::error::Error;
use super::law::COLLAPSE_MESSAGE;
use super::{AXES_MAX, LinkKind, Measure, Network, SpaceLaw, SpacePoint, inverse};
use crate::law::Law;

/// Links between points in space. In a run, `a` and `b` are the first coordinates of the ends of the first link.
#[derive(Clone, Debug, PartialEq)]
pub struct SpaceLink {
    /// How it acts.
    pub law: SpaceLaw,
    /// What it measures.
    pub measure: Measure,
    /// How many axes: 2 or 3.
    pub n_axes: usize,
    /// Index of the second and of the third coordinate of an end, relative to the first   (ends a and b)
    pub offsets: [[isize; AXES_MAX - 1]; 2],
}

impl SpaceLink {
    /// A link between points with the offsets of `ends`.
    pub(in crate::network) fn new(law: SpaceLaw, measure: Measure, n_axes: usize, ends: [SpacePoint; 2]) -> Self {
        let offsets = ends.map(|end| end.offsets);
        Self {
            law,
            measure,
            n_axes,
            offsets,
        }
    }

    /// The same link at the frame rate `new_rate` [Hz].
    pub(crate) fn resampled(&self, new_rate: f64) -> Self {
        let mut stepped = self.clone();
        if let SpaceLaw::Lnl { rate, .. } = &mut stepped.law {
            *rate = new_rate;
        }
        stepped
    }

    /// The coordinates of both ends along an axis, from those of the first axis.
    pub(crate) fn pair(&self, (a, b): (usize, usize), axis: usize) -> (usize, usize) {
        match axis {
            0 => (a, b),
            _ => (
                a.wrapping_add_signed(self.offsets[0][axis - 1]),
                b.wrapping_add_signed(self.offsets[1][axis - 1]),
            ),
        }
    }

    /// The length that it measures at positions `x`, and the unit vector along which this length grows. Components are
    /// 0 if both ends are at one place, and along axes that do not exist.
    pub(crate) fn length_and_direction(
        &self,
        ends: (usize, usize),
        x: impl Fn(usize) -> f64,
    ) -> (f64, [f64; AXES_MAX]) {
        self.measure.length_and_direction(self.offset_between(ends, x))
    }

    /// Position of the second end minus that of the first, axis by axis.
    pub(crate) fn offset_between(&self, ends: (usize, usize), x: impl Fn(usize) -> f64) -> [f64; AXES_MAX] {
        let mut offset = [0.0; AXES_MAX];
        for (axis, component) in offset.iter_mut().enumerate().take(self.n_axes) {
            let (first_mat, second_mat) = self.pair(ends, axis);
            *component = x(second_mat) - x(first_mat);
        }
        offset
    }

    /// Growth of the distance of the ends along `direction`, if each MAT moves by `mat_step`.
    pub(crate) fn length_step(
        &self,
        ends: (usize, usize),
        direction: [f64; AXES_MAX],
        mat_step: impl Fn(usize) -> f64,
    ) -> f64 {
        let axis_terms = direction.into_iter().enumerate().take(self.n_axes);
        let axis_terms = axis_terms.map(|(axis, direction)| {
            let (first_mat, second_mat) = self.pair(ends, axis);
            direction * (mat_step(second_mat) - mat_step(first_mat))
        });
        axis_terms.sum()
    }
}

impl Network {
    /// Add springs or contacts between `n` consecutive pairs of points in space; returns the index of the first.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range or the ends cannot be joined.
    pub fn space_links(
        &mut self,
        name: &str,
        (a, b): (SpacePoint, SpacePoint),
        n: usize,
        n_axes: usize,
        law: SpaceLaw,
        [k, z, rest]: [f64; 3],
    ) -> Result<usize, Error> {
        self.check_space(name, n_axes, &law, [k, z, rest])?;
        if law.rests_beyond_gap(rest - law.reach()) {
            return Err(self.refused(name, COLLAPSE_MESSAGE));
        }
        if n == 0 || !self.has_points(a, n, n_axes) || !self.has_points(b, n, n_axes) {
            return Err(self.refused(name, "joins a module that does not exist"));
        }
        if a.first == b.first {
            return Err(self.refused(name, "a link joins two different points"));
        }
        self.check_capacity(name, n)?;
        let first_link = self.n_lia;
        let space_link = SpaceLink::new(law, Measure::Distance, n_axes, [a, b]);
        self.add_run(LinkKind::Space(space_link), a.first, b.first, n, [k, z, rest]);
        let name = self.full_name(name);
        self.names.add_links(first_link, n, n > 1, name);
        Ok(first_link)
    }

    /// Add a law (LNL) of distance − `rest` and its rate between two points in space; returns its index.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range or the ends cannot be joined.
    pub fn space_lnl(
        &mut self,
        name: &str,
        ends: (SpacePoint, SpacePoint),
        n_axes: usize,
        law: Arc<Law>,
        rest: f64,
    ) -> Result<usize, Error> {
        let distance = self.distance(ends, n_axes);
        let initial_elongation = distance - rest;
        // Largest stiffness at the initial length and at rest: along its line the slope of the law, across it f/ℓ.
        let stiffest_slope = |e: f64| {
            let slope_across = inverse(rest + e) * law.spring(e);
            law.slope(e).max(slope_across).max(0.0)
        };
        let [k, z] = if rest > 0.0 {
            let viscosity = |e| law.damping_slope(e);
            [
                stiffest_slope(initial_elongation).max(stiffest_slope(0.0)),
                viscosity(initial_elongation).max(viscosity(0.0)),
            ]
        } else {
            [
                stiffest_slope(initial_elongation),
                law.damping_slope(initial_elongation),
            ]
        };
        if !law.spring(initial_elongation).is_finite() {
            return Err(self.refused(name, "the force of its law is not a finite number where it begins"));
        }
        let rate = 1.0;
        let law = SpaceLaw::Lnl {
            law,
            initial_elongation,
            rate,
        };
        self.space_links(name, ends, 1, n_axes, law, [k, z.max(0.0), rest])
    }

    /// Refuse links in space with numbers that are out of range.
    pub(in crate::network) fn check_space(
        &self,
        name: &str,
        n_axes: usize,
        law: &SpaceLaw,
        [k, z, rest]: [f64; 3],
    ) -> Result<(), Error> {
        self.check(
            name,
            &[
                ("K", k, Rule::NotNegative),
                ("Z", z, Rule::NotNegative),
                ("rest", rest, Rule::NotNegative),
            ],
        )?;
        if let SpaceLaw::Yielding {
            yield_force,
            break_elongation,
        } = law
            && !(*yield_force > 0.0 && *break_elongation > 0.0)
        {
            return Err(self.refused(
                name,
                "the force at which a link yields, and the length at which it breaks, are above 0",
            ));
        }
        if let SpaceLaw::Attraction { core } = law
            && !(*core > 0.0 && core.is_finite())
        {
            return Err(self.refused(name, "the core of an attraction must be above 0"));
        }
        if let SpaceLaw::Contact { exponent, .. } | SpaceLaw::Cohesive { exponent, .. } = law
            && !(1.0..=8.0).contains(exponent)
        {
            return Err(self.refused(name, "the exponent of a contact must be from 1 to 8"));
        }
        if let SpaceLaw::Cohesive { sink, reach, .. } = law {
            let is_number = |value: f64| value > 0.0 && value.is_finite();
            if !is_number(*sink) || !is_number(*reach) {
                let message = "a contact that sticks needs a stiffness, an attraction and a reach above 0";
                return Err(self.refused(name, message));
            }
        }
        if !(2..=AXES_MAX).contains(&n_axes) {
            return Err(self.refused(name, "a link in space has two or three axes"));
        }
        Ok(())
    }
}
