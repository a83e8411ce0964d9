//! Points in space, by their coordinates.

use super::super::checks::Rule;
use super::super::error::Error;
use super::{AXES_MAX, Network, distance};

/// A point in space, by its coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpacePoint {
    /// The MAT that is its first coordinate.
    pub first: usize,
    /// Index of the second and of the third coordinate relative to `first`. If a coordinate moves with the masses of a
    /// body, its index may be lower than `first`.
    pub offsets: [isize; AXES_MAX - 1],
}

/// Points that are added to a space at once.
#[derive(Clone, Copy, Debug)]
pub struct SpacePoints<'a> {
    /// How many axes: 1 to 3.
    pub n_axes: usize,
    /// Mass of each [kg]; 0 for a fixed point   (n)
    pub masses: &'a [f64],
    /// Initial positions [m]   (n_axes · n), axis by axis
    pub x0: &'a [f64],
    /// Initial velocities [m/s]   (n_axes · n)
    pub v0: &'a [f64],
    /// Viscosity of the surroundings of each point [N·s/m].
    pub z: f64,
}

impl SpacePoint {
    /// A point whose coordinates are `stride` apart: 1 for a single point, the number of points if they are added at
    /// once.
    pub const fn strided(first: usize, stride: usize) -> Self {
        let stride = stride as isize;
        Self {
            first,
            offsets: [stride, 2 * stride],
        }
    }

    /// Its coordinate along an axis; `None` if there is no such MAT.
    pub(in crate::network) fn coordinate(self, axis: usize) -> Option<usize> {
        match axis {
            0 => Some(self.first),
            _ => self.first.checked_add_signed(self.offsets[axis - 1]),
        }
    }
}

impl Network {
    /// Add points in space; returns the index of the first coordinate of the first point. Coordinates are stored axis
    /// by axis: the second coordinate of a point is n MATs behind its first. They are named `name.3.x`, or `name.x` if
    /// points are not numbered.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range or the network is full.
    pub fn points(&mut self, name: &str, is_numbered: bool, points: SpacePoints<'_>) -> Result<usize, Error> {
        let SpacePoints {
            n_axes,
            masses,
            x0,
            v0,
            z,
        } = points;
        let point_count = masses.len();
        if !(1..=AXES_MAX).contains(&n_axes) || [x0.len(), v0.len()] != [n_axes * point_count; 2] || point_count == 0 {
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
        self.check_capacity(name, n_axes * point_count)?;
        let first_mat = self.n_mat();
        for (i, (&x, &v)) in x0.iter().zip(v0).enumerate() {
            self.push_coordinate(masses[i % point_count], z, [x, v]);
        }
        for axis in 0..n_axes {
            self.name_coordinates(first_mat + axis * point_count, point_count, is_numbered, name, axis);
        }
        Ok(first_mat)
    }

    /// The initial distance of two points [m].
    pub fn distance(&self, (a, b): (SpacePoint, SpacePoint), n_axes: usize) -> f64 {
        let offset_along = |axis: usize| {
            let coordinate = |end: SpacePoint| end.coordinate(axis).map_or(0.0, |mat| self.mats.x0[mat]);
            if axis < n_axes {
                coordinate(b) - coordinate(a)
            } else {
                0.0
            }
        };
        distance(offset_along(0), offset_along(1), offset_along(2))
    }

    /// Whether `n` consecutive points from `end` on are MATs of the network.
    pub(in crate::network) fn has_points(&self, end: SpacePoint, n: usize, n_axes: usize) -> bool {
        let is_present = |axis| {
            let range_end = end.coordinate(axis)?.checked_add(n)?;
            Some(range_end <= self.n_mat())
        };
        (0..n_axes.min(AXES_MAX)).all(|axis| is_present(axis) == Some(true))
    }
}
