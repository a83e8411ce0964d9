//! Links in space: they measure the distance of two points, and act along the line between them.
//!
//! A point in space is two or three MATs, its coordinates. So whatever acts on one axis of motion acts on a coordinate
//! too: hands, ergons, springs, outputs.

use super::checks::Rule;
use super::error::Error;
use super::{LinkKind, Network, Run};
use crate::maths::power_law;

/// Most axes of a space.
pub(crate) const AXES_MAX: usize = 3;

/// What a link in space does with the distance of its ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpaceLaw {
    /// Spring and damper, `rest` long without force.
    Spring,
    /// A contact, closed where the distance is below `rest`: it pushes by K·p^exponent + Z·dp/dt, p the depth.
    Contact {
        /// Power of the depth, from 1 on.
        exponent: f64,
        /// Whether it never pulls.
        clamp: bool,
    },
}

/// Links between points in space. Of a run, `a` and `b` are the first coordinates of the ends of the first link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpaceLink {
    /// What it does.
    pub law: SpaceLaw,
    /// How many axes: 2 or 3.
    pub n_axes: usize,
    /// How far behind the first coordinate of an end the second and the third are   (ends a and b)
    pub offsets: [[usize; AXES_MAX - 1]; 2],
}

/// A point in space, by its coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpacePoint {
    /// The MAT that is its first coordinate.
    pub first: usize,
    /// From one coordinate to the next: 1 for a single point, their number for points that are given at once.
    pub stride: usize,
}

/// Points that are added to a space at once.
#[derive(Clone, Copy, Debug)]
pub struct SpacePoints<'a> {
    /// How many axes: 2 or 3.
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

impl SpaceLaw {
    /// Force that pulls the ends together [N], without damping, at distance − rest [m].
    pub(crate) fn elastic(self, k: f64, e: f64) -> f64 {
        match self {
            Self::Spring => k * e,
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { exponent, .. } => -k * power_law(-e, exponent),
        }
    }

    /// Force that pulls the ends together [N] at distance − rest `e` [m] that grows by `step` a frame.
    pub(crate) fn force(self, [k, z]: [f64; 2], e: f64, step: f64) -> f64 {
        match self {
            Self::Spring => k * e + z * step,
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { clamp, .. } => {
                let pull = self.elastic(k, e) + z * step;
                if clamp { pull.min(0.0) } else { pull }
            }
        }
    }

    /// Energy at distance − rest `e` [J].
    pub(crate) fn potential(self, k: f64, e: f64) -> f64 {
        match self {
            Self::Spring => 0.5 * k * e * e,
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { exponent, .. } => k * power_law(-e, exponent + 1.0) / (exponent + 1.0),
        }
    }
}

impl SpaceLink {
    /// The coordinates of an axis, from those of the first axis.
    pub(crate) fn pair(&self, (a, b): (usize, usize), axis: usize) -> (usize, usize) {
        match axis {
            0 => (a, b),
            _ => (a + self.offsets[0][axis - 1], b + self.offsets[1][axis - 1]),
        }
    }

    /// What points are apart along each axis, and their distance, at positions `x`; 0 along axes that there are not.
    pub(crate) fn apart(
        &self,
        ends: (usize, usize),
        x: impl Fn(usize) -> f64,
    ) -> ([f64; AXES_MAX], f64) {
        let mut apart = [0.0; AXES_MAX];
        for (axis, apart) in apart.iter_mut().enumerate().take(self.n_axes) {
            let (a, b) = self.pair(ends, axis);
            *apart = x(b) - x(a);
        }
        let [x, y, z] = apart;
        (apart, distance(x, y, z))
    }

    /// Components of the unit vector from the first end to the second; 0 where they are at one place.
    pub(crate) fn direction(
        &self,
        ends: (usize, usize),
        x: impl Fn(usize) -> f64,
    ) -> [f64; AXES_MAX] {
        let (apart, length) = self.apart(ends, x);
        let inverse = inverse(length);
        apart.map(|apart| apart * inverse)
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
    /// Whether it acts only while its ends meet.
    pub fn is_contact(&self) -> bool {
        match self {
            Self::But(_) => true,
            Self::Space(space) => matches!(space.law, SpaceLaw::Contact { .. }),
            _ => false,
        }
    }
}

impl Run {
    /// How many axes its links act along.
    pub(crate) fn n_axes(&self) -> usize {
        match &self.kind {
            LinkKind::Space(space) => space.n_axes,
            _ => 1,
        }
    }

    /// The MATs that its i-th link joins along an axis.
    pub fn pair(&self, i: usize, axis: usize) -> (usize, usize) {
        let ends = (self.a + i, self.b + i);
        match &self.kind {
            LinkKind::Space(space) => space.pair(ends, axis),
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
        if !(2..=AXES_MAX).contains(&n_axes) || [x0.len(), v0.len()] != [n_axes * n; 2] || n == 0 {
            let message = "points in space have two or three coordinates each";
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
            let at = |end: SpacePoint| self.mats.x0[end.first + axis * end.stride];
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
        self.check(
            name,
            &[
                ("K", k, Rule::NotNegative),
                ("Z", z, Rule::NotNegative),
                ("rest", rest, Rule::NotNegative),
            ],
        )?;
        if let SpaceLaw::Contact { exponent, .. } = law
            && !(1.0..=8.0).contains(&exponent)
        {
            return Err(self.refused(name, "the exponent of a contact must be from 1 to 8"));
        }
        let is_there = |end: SpacePoint| {
            let offset = end.stride.checked_mul(n_axes.saturating_sub(1));
            let last = offset.and_then(|offset| offset.checked_add(end.first)?.checked_add(n));
            last.is_some_and(|last| last <= self.n_mat())
        };
        if !(2..=AXES_MAX).contains(&n_axes) || n == 0 || !is_there(a) || !is_there(b) {
            return Err(self.refused(name, "joins a module that does not exist"));
        }
        if a.first == b.first {
            return Err(self.refused(name, "a link joins two different points"));
        }
        self.room(name, n)?;
        let first = self.n_lia;
        let offsets = [a, b].map(|end| [end.stride, 2 * end.stride]);
        let space = SpaceLink {
            law,
            n_axes,
            offsets,
        };
        self.add_run(LinkKind::Space(space), a.first, b.first, n, [k, z, rest]);
        let name = self.full_name(name);
        self.names.add_links(first, n, n > 1, name);
        Ok(first)
    }
}
