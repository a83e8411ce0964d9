//! Links in space: they measure the distance of two points, and act along the line between them.
//!
//! A point in space is two or three MATs, its coordinates. So whatever acts on one axis of motion acts on a coordinate
//! too: hands, ergons, springs, outputs.

use std::sync::Arc;

use super::checks::Rule;
use super::error::Error;
use super::{LinkKind, Network, Run};
use crate::law::Law;
use crate::maths::power_law;

/// Most axes of a space.
pub(crate) const AXES_MAX: usize = 3;

/// What a link in space does with the distance of its ends.
#[derive(Clone, Debug, PartialEq)]
pub enum SpaceLaw {
    /// Spring and damper, `rest` long without force.
    Spring,
    /// The same, whose rest length follows beyond a force, and which breaks where it is too long. Both are endless where
    /// it never does.
    Yielding {
        /// Greatest force of the spring, either way [N]: perfect plasticity (Prandtl 1928).
        yields: f64,
        /// How much longer than `rest` it breaks [m], whatever it has yielded.
        breaks: f64,
    },
    /// A mass that attracts by K·ℓ/(1 + (ℓ/core)²)^1.5 at distance − rest ℓ: a spring near by, and far away as 1/ℓ²
    /// (Plummer 1911).
    Attraction {
        /// Distance [m] beyond which the force falls.
        core: f64,
    },
    /// A contact, closed where the distance is below `rest`: it pushes by K·p^exponent + Z·dp/dt, p the depth.
    Contact {
        /// Power of the depth, from 1 on.
        exponent: f64,
        /// Whether it never pulls.
        clamp: bool,
    },
    /// A contact that sticks: beside its push it pulls by K·sink, and less and less until its ends are `reach` farther than
    /// where they touch. `rest` is where it lets go.
    Cohesive {
        /// Power of the depth, from 1 on.
        exponent: f64,
        /// Whether its damping never pulls.
        clamp: bool,
        /// Its pull over K [m^exponent]: for an exponent of 1 the depth at which it rests.
        sink: f64,
        /// How far beyond touching it pulls [m].
        reach: f64,
    },
    /// Nothing: it is there to be measured.
    Gauge,
    /// A law of distance − rest and its rate. K and Z of its run are what it is stiff and viscous where it begins, at most.
    Lnl {
        /// The law.
        law: Arc<Law>,
        /// Distance − rest from which its energy counts [m]: where it begins.
        from: f64,
        /// A step times this is the law's v: 1/T; 1 where steps are given in [m/s].
        rate: f64,
    },
}

/// What a link in space measures: a length, along a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measure {
    /// The distance of its ends.
    Distance,
    /// The distance of its ends, below 0: a contact is closed where the distance is above −`rest`.
    Within,
    /// How far the second end is from a plane through the first, along its unit normal.
    Plane([f64; AXES_MAX]),
}

/// Links between points in space. Of a run, `a` and `b` are the first coordinates of the ends of the first link.
#[derive(Clone, Debug, PartialEq)]
pub struct SpaceLink {
    /// What it does.
    pub law: SpaceLaw,
    /// What it measures.
    pub measure: Measure,
    /// How many axes: 2 or 3.
    pub n_axes: usize,
    /// How far behind the first coordinate of an end the second and the third are   (ends a and b)
    pub offsets: [[isize; AXES_MAX - 1]; 2],
}

/// A point in space, by its coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpacePoint {
    /// The MAT that is its first coordinate.
    pub first: usize,
    /// How far behind it the second and the third are. Points that move with the masses of a body have a coordinate
    /// there, which may come before the others.
    pub offsets: [isize; AXES_MAX - 1],
}

impl SpacePoint {
    /// A point whose coordinates are `stride` from each other: 1 for a single point, their number for points that are
    /// added at once.
    pub const fn strided(first: usize, stride: usize) -> Self {
        let stride = stride as isize;
        Self {
            first,
            offsets: [stride, 2 * stride],
        }
    }

    /// Its coordinate along an axis; `None` where there is no such MAT.
    pub(super) fn coordinate(self, axis: usize) -> Option<usize> {
        match axis {
            0 => Some(self.first),
            _ => self.first.checked_add_signed(self.offsets[axis - 1]),
        }
    }
}

/// Points that are added to a space at once.
#[derive(Clone, Copy, Debug)]
pub struct SpacePoints<'a> {
    /// How many axes: 1 to 3.
    pub n_axes: usize,
    /// Mass of each [kg]; 0 for a fixed point   (n)
    pub masses: &'a [f64],
    /// Where they are at the beginning [m]   (n_axes · n), axis by axis
    pub x0: &'a [f64],
    /// How fast they are at the beginning [m/s]   (n_axes · n)
    pub v0: &'a [f64],
    /// Viscosity against what surrounds each [N·s/m].
    pub z: f64,
}

/// Why a contact that sticks is refused.
pub(super) const SINKS: &str = "its attraction is stronger than K times the gap, so its two points would collapse \
     onto each other; reduce the attraction, or use a larger K or gap";

/// Distance − rest of a link that is broken.
const BROKEN: f64 = f64::NEG_INFINITY;

impl SpaceLaw {
    /// Whether its rest length changes for good.
    pub(crate) fn yields(&self) -> bool {
        matches!(self, Self::Yielding { .. })
    }

    /// Distance − rest at `e` [m] where the rest length had grown by `yielded` [m], once it has followed: what it grew is
    /// the difference.
    pub(crate) fn settled(&self, k: f64, e: f64, yielded: f64) -> f64 {
        let Self::Yielding { yields, breaks } = self else {
            return e;
        };
        if e > *breaks || yielded.is_infinite() {
            return BROKEN;
        }
        let e = e - yielded;
        if (k * e).abs() > *yields {
            (yields / k).copysign(e)
        } else {
            e
        }
    }

    /// Whether it is a contact.
    #[inline(always)]
    pub(crate) fn is_contact(&self) -> bool {
        matches!(self, Self::Contact { .. } | Self::Cohesive { .. })
    }

    /// How far beyond touching it acts [m].
    pub fn reach(&self) -> f64 {
        match self {
            Self::Cohesive { reach, .. } => *reach,
            _ => 0.0,
        }
    }

    /// Whether it rests deeper than its ends are apart where they touch [m]: then it is stiffer across than along its line.
    pub(super) fn sinks_beyond(&self, gap: f64) -> bool {
        matches!(self, Self::Cohesive { exponent: 1.0, sink, .. } if *sink > gap)
    }

    /// Whether it acts at distance − rest `e` [m].
    #[inline(always)]
    pub(crate) fn acts(&self, e: f64) -> bool {
        !self.is_contact() || e < 0.0
    }

    /// Of a contact at distance − rest `e` [m]: how stiffly it pushes for its depth [N/m], and what it pulls beside that
    /// [N], where its elastic force is `elastic` [N]. `None` where it does not touch.
    #[inline(always)]
    pub(crate) fn pressed(&self, k: f64, e: f64, elastic: f64) -> Option<[f64; 2]> {
        match self {
            Self::Cohesive { sink, reach, .. } => {
                let (deep, pull) = (e + reach, k * sink);
                (deep < 0.0).then(|| [(elastic - pull) / deep, pull])
            }
            _ => Some([elastic / e, 0.0]),
        }
    }

    /// Force that pulls the ends together [N], without damping, at distance − rest [m].
    pub(crate) fn elastic(&self, k: f64, e: f64) -> f64 {
        match self {
            // One that is broken is endlessly too short.
            Self::Yielding { .. } if e == BROKEN => 0.0,
            Self::Spring | Self::Yielding { .. } => k * e,
            Self::Attraction { core } => {
                let far = 1.0 + (e / core) * (e / core);
                k * e / (far * far.sqrt())
            }
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { exponent, .. } => -k * power_law(-e, *exponent),
            Self::Cohesive { .. } if e >= 0.0 => 0.0,
            Self::Cohesive { sink, reach, .. } if e + reach >= 0.0 => k * sink * (-e / reach),
            Self::Cohesive {
                exponent,
                sink,
                reach,
                ..
            } => k * (sink - power_law(-(e + reach), *exponent)),
            Self::Gauge => 0.0,
            Self::Lnl { law, .. } => spring_of(law, e),
        }
    }

    /// Force that pulls the ends together [N] at distance − rest `e` [m] that grows by `step` a frame.
    pub(crate) fn force(&self, [k, z]: [f64; 2], e: f64, step: f64) -> f64 {
        match self {
            Self::Yielding { .. } if e == BROKEN => 0.0,
            Self::Spring | Self::Yielding { .. } => k * e + z * step,
            Self::Attraction { .. } => self.elastic(k, e) + z * step,
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { .. } | Self::Cohesive { .. } => {
                self.damped([k, e], self.elastic(k, e), z * step)
            }
            Self::Gauge => 0.0,
            Self::Lnl { law, rate, .. } => force_of(law, e, step * rate),
        }
    }

    /// Force of a contact of stiffness `k` at distance − rest `e` [m] that pulls the ends together [N], from its elastic and
    /// its damping part.
    #[inline(always)]
    pub(crate) fn damped(&self, [k, e]: [f64; 2], elastic: f64, damping: f64) -> f64 {
        let pull = elastic + damping;
        match self {
            Self::Contact { clamp: true, .. } => pull.min(0.0),
            // What only pulls has no damper.
            Self::Cohesive { reach, .. } if e + reach >= 0.0 => elastic,
            Self::Cohesive {
                clamp: true, sink, ..
            } => pull.min(k * sink),
            _ => pull,
        }
    }

    /// Energy at distance − rest `e` [J].
    pub(crate) fn potential(&self, k: f64, e: f64) -> f64 {
        match self {
            Self::Yielding { .. } if e == BROKEN => 0.0,
            Self::Spring | Self::Yielding { .. } => 0.5 * k * e * e,
            // Of k·core²·(1 − 1/√far), without the difference of numbers that are nearly the same.
            Self::Attraction { core } => {
                let far = 1.0 + (e / core) * (e / core);
                k * e * e / (far + far.sqrt())
            }
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { exponent, .. } => k * power_law(-e, exponent + 1.0) / (exponent + 1.0),
            // 0 where it has let go, and below 0 where it holds.
            Self::Cohesive { .. } if e >= 0.0 => 0.0,
            Self::Cohesive { sink, reach, .. } if e + reach >= 0.0 => {
                -0.5 * k * sink * (e * e) / reach
            }
            Self::Cohesive {
                exponent,
                sink,
                reach,
                ..
            } => {
                let (deep, power) = (-(e + reach), exponent + 1.0);
                k * (power_law(deep, power) / power - sink * (0.5 * reach + deep))
            }
            Self::Gauge => 0.0,
            Self::Lnl { law, from, .. } => law.work(*from, e),
        }
    }
}

/// The elastic force of a law: cold, so that the loops of other links stay as short as without it.
#[cold]
#[inline(never)]
fn spring_of(law: &Law, e: f64) -> f64 {
    law.spring(e)
}

/// The force of a law, likewise.
#[cold]
#[inline(never)]
fn force_of(law: &Law, e: f64, v: f64) -> f64 {
    law.force(e, v)
}

impl SpaceLink {
    /// A link between points with these strides.
    pub(super) fn of(
        law: SpaceLaw,
        measure: Measure,
        n_axes: usize,
        ends: [SpacePoint; 2],
    ) -> Self {
        let offsets = ends.map(|end| end.offsets);
        Self {
            law,
            measure,
            n_axes,
            offsets,
        }
    }

    /// The same at so many frames a second [Hz].
    pub(crate) fn stepped(&self, at: f64) -> Self {
        let mut stepped = self.clone();
        if let SpaceLaw::Lnl { rate, .. } = &mut stepped.law {
            *rate = at;
        }
        stepped
    }

    /// The coordinates of an axis, from those of the first axis.
    pub(crate) fn pair(&self, (a, b): (usize, usize), axis: usize) -> (usize, usize) {
        match axis {
            0 => (a, b),
            _ => (
                a.wrapping_add_signed(self.offsets[0][axis - 1]),
                b.wrapping_add_signed(self.offsets[1][axis - 1]),
            ),
        }
    }

    /// The length that it measures at positions `x`, and components of the unit vector along which the length grows: 0
    /// where ends are at one place, and along axes that there are not.
    pub(crate) fn line(
        &self,
        ends: (usize, usize),
        x: impl Fn(usize) -> f64,
    ) -> (f64, [f64; AXES_MAX]) {
        self.measure.of(self.between(ends, x))
    }

    /// What `x` of the second end is beyond that of the first, axis by axis.
    pub(crate) fn between(
        &self,
        ends: (usize, usize),
        x: impl Fn(usize) -> f64,
    ) -> [f64; AXES_MAX] {
        let mut between = [0.0; AXES_MAX];
        for (axis, between) in between.iter_mut().enumerate().take(self.n_axes) {
            let (a, b) = self.pair(ends, axis);
            *between = x(b) - x(a);
        }
        between
    }

    /// How far the ends move away from each other along the line between them, where each MAT moves by `moved`.
    pub(crate) fn stretch(
        &self,
        ends: (usize, usize),
        direction: [f64; AXES_MAX],
        moved: impl Fn(usize) -> f64,
    ) -> f64 {
        let along = direction.into_iter().enumerate().take(self.n_axes);
        let along = along.map(|(axis, direction)| {
            let (a, b) = self.pair(ends, axis);
            direction * (moved(b) - moved(a))
        });
        along.sum()
    }
}

impl Measure {
    /// The length and the direction, from the vector between the ends.
    #[inline(always)]
    pub(crate) fn of(self, [x, y, z]: [f64; AXES_MAX]) -> (f64, [f64; AXES_MAX]) {
        if let Self::Plane(normal) = self {
            return (normal[0] * x + normal[1] * y + normal[2] * z, normal);
        }
        let length = distance(x, y, z);
        let inverse = inverse(length);
        if self == Self::Distance {
            (length, [x * inverse, y * inverse, z * inverse])
        } else {
            (-length, [-x * inverse, -y * inverse, -z * inverse])
        }
    }
}

/// Length of a vector. The order of the sum is that of the inner loops: the same bits.
#[inline(always)]
pub(crate) fn distance(x: f64, y: f64, z: f64) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// 1/length; 0 for points at one place, which have no line between them.
#[inline(always)]
pub(crate) fn inverse(length: f64) -> f64 {
    if length > 0.0 { 1.0 / length } else { 0.0 }
}

impl LinkKind {
    /// Whether its force depends on what was before.
    pub(crate) fn remembers(&self) -> bool {
        match self {
            Self::Bristle(_) => true,
            Self::Space(space) => space.law.yields(),
            _ => false,
        }
    }

    /// Whether it is seen between its ends: neither a contact nor an attraction.
    pub fn is_drawn(&self) -> bool {
        match self {
            Self::Space(SpaceLink {
                law: SpaceLaw::Attraction { .. } | SpaceLaw::Gauge,
                ..
            }) => false,
            Self::Pairwise(_) => false,
            _ => !self.is_contact(),
        }
    }

    /// Whether it may break for good.
    pub fn may_break(&self) -> bool {
        let Self::Space(SpaceLink {
            law: SpaceLaw::Yielding { breaks, .. },
            ..
        }) = self
        else {
            return false;
        };
        breaks.is_finite()
    }

    /// Whether it acts only while its ends meet.
    pub fn is_contact(&self) -> bool {
        match self {
            Self::But(_) => true,
            Self::Space(space) => space.law.is_contact(),
            Self::Pairwise(pairs) => pairs.link.law.is_contact(),
            _ => false,
        }
    }
}

impl Run {
    /// How many axes its links act along.
    pub(crate) fn n_axes(&self) -> usize {
        match &self.kind {
            LinkKind::Space(space) => space.n_axes,
            LinkKind::Pairwise(pairs) => pairs.link.n_axes,
            _ => 1,
        }
    }

    /// The MATs that its i-th link joins along an axis.
    pub fn pair(&self, i: usize, axis: usize) -> (usize, usize) {
        let ends = (self.a + i, self.b + i);
        match &self.kind {
            LinkKind::Space(space) => space.pair(ends, axis),
            LinkKind::Pairwise(pairs) => pairs.pair((self.a, self.b), i, axis),
            _ => ends,
        }
    }

    /// The MATs that its i-th link joins, axis by axis.
    pub fn pairs(&self, i: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.n_axes()).map(move |axis| self.pair(i, axis))
    }
}

impl Network {
    /// Add points in space; returns the index of the first coordinate of the first. Coordinates stand axis by axis: that of
    /// point i along the second axis is n behind that along the first. They are named `name.3.x`; of a single point that is
    /// not numbered `name.x`.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where a number is out of range or the network is full.
    pub fn points(
        &mut self,
        name: &str,
        is_numbered: bool,
        points: SpacePoints<'_>,
    ) -> Result<usize, Error> {
        let SpacePoints {
            n_axes,
            masses,
            x0,
            v0,
            z,
        } = points;
        let n = masses.len();
        if !(1..=AXES_MAX).contains(&n_axes) || [x0.len(), v0.len()] != [n_axes * n; 2] || n == 0 {
            let message = "points have one to three coordinates each";
            return Err(self.refused(name, message));
        }
        self.check(name, &[("Z", z, Rule::NotNegative)])?;
        for &m in masses {
            self.check(name, &[("M", m, Rule::NotNegative)])?;
        }
        for (x, v) in x0.iter().zip(v0) {
            self.check(name, &[("X0", *x, Rule::Finite), ("V0", *v, Rule::Finite)])?;
        }
        self.room(name, n_axes * n)?;
        let first = self.n_mat();
        for (i, (&x, &v)) in x0.iter().zip(v0).enumerate() {
            self.push_coordinate(masses[i % n], z, [x, v]);
        }
        for axis in 0..n_axes {
            self.name_coordinates(first + axis * n, n, is_numbered, name, axis);
        }
        Ok(first)
    }

    /// The distance of two points at the beginning [m].
    pub fn distance(&self, (a, b): (SpacePoint, SpacePoint), n_axes: usize) -> f64 {
        let apart = |axis: usize| {
            let at = |end: SpacePoint| end.coordinate(axis).map_or(0.0, |mat| self.mats.x0[mat]);
            if axis < n_axes { at(b) - at(a) } else { 0.0 }
        };
        distance(apart(0), apart(1), apart(2))
    }

    /// Add springs or contacts between `n` pairs of points in space that follow one another; returns the index of the first.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where a number is out of range or the ends cannot be joined.
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
        if law.sinks_beyond(rest - law.reach()) {
            return Err(self.refused(name, SINKS));
        }
        if n == 0 || !self.has_points(a, n, n_axes) || !self.has_points(b, n, n_axes) {
            return Err(self.refused(name, "joins a module that does not exist"));
        }
        if a.first == b.first {
            return Err(self.refused(name, "a link joins two different points"));
        }
        self.room(name, n)?;
        let first = self.n_lia;
        let space = SpaceLink::of(law, Measure::Distance, n_axes, [a, b]);
        self.add_run(LinkKind::Space(space), a.first, b.first, n, [k, z, rest]);
        let name = self.full_name(name);
        self.names.add_links(first, n, n > 1, name);
        Ok(first)
    }

    /// Add a law (LNL) of distance − `rest` and its rate between two points in space; returns its index.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where a number is out of range or the ends cannot be joined.
    pub fn space_lnl(
        &mut self,
        name: &str,
        ends: (SpacePoint, SpacePoint),
        n_axes: usize,
        law: Arc<Law>,
        rest: f64,
    ) -> Result<usize, Error> {
        let distance = self.distance(ends, n_axes);
        let from = distance - rest;
        // Stiffest where it begins, or where it rests: along its line its slope, across it f/ℓ.
        let at = |e: f64| {
            let across = inverse(rest + e) * law.spring(e);
            law.slope(e).max(across).max(0.0)
        };
        let [k, z] = if rest > 0.0 {
            let viscosity = |e| law.damping_slope(e);
            [at(from).max(at(0.0)), viscosity(from).max(viscosity(0.0))]
        } else {
            [at(from), law.damping_slope(from)]
        };
        if !law.spring(from).is_finite() {
            return Err(self.refused(
                name,
                "the force of its law is not a finite number where it begins",
            ));
        }
        let rate = 1.0;
        let law = SpaceLaw::Lnl { law, from, rate };
        self.space_links(name, ends, 1, n_axes, law, [k, z.max(0.0), rest])
    }

    /// Refuse the numbers of links in space that are out of range.
    pub(super) fn check_space(
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
        if let SpaceLaw::Yielding { yields, breaks } = law
            && !(*yields > 0.0 && *breaks > 0.0)
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
                let message =
                    "a contact that sticks needs a stiffness, an attraction and a reach above 0";
                return Err(self.refused(name, message));
            }
        }
        if !(2..=AXES_MAX).contains(&n_axes) {
            return Err(self.refused(name, "a link in space has two or three axes"));
        }
        Ok(())
    }

    /// Whether `n` points from one on are MATs of the network.
    pub(super) fn has_points(&self, end: SpacePoint, n: usize, n_axes: usize) -> bool {
        let is_here = |axis| {
            let last = end.coordinate(axis)?.checked_add(n)?;
            Some(last <= self.n_mat())
        };
        (0..n_axes.min(AXES_MAX)).all(|axis| is_here(axis) == Some(true))
    }
}
