//! A path placed in the piece: shared, scaled, and stretched in time.

use std::sync::Arc;

use super::profile::{PathError, Profile};

/// A path placed in the piece: position x at time t of the path becomes x·scale at `instant` + t·stretch.
///
/// ```
/// use std::sync::Arc;
///
/// use ergon_engine::gesture::placed::PlacedPath;
/// use ergon_engine::gesture::profile::{Curve, Point, Profile};
///
/// let point = |t, x| Point { t, x, curve: Curve::Line };
/// let path = Arc::new(Profile::through_points(&[point(0.0, 0.0), point(1.0, 4e-3)])?);
/// let placed = PlacedPath::transformed(path, 10.0, 0.5, 2.0, false)?; // at 10 s, half as far, half as fast
/// assert_eq!((placed.start_time(), placed.end_time()), (10.0, 12.0));
/// assert!((placed.evaluate(11.0).0 - 1e-3).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedPath {
    profile: Arc<Profile>,
    instant: f64,
    scale: f64,
    stretch: f64,
    is_reversed: bool,
}

impl PlacedPath {
    /// The profile with its zero of time at `instant` [s] of the piece, neither scaled nor stretched.
    ///
    /// # Errors
    /// [`PathError::Placement`] if `instant` is not finite.
    pub fn new(profile: Arc<Profile>, instant: f64) -> Result<Self, PathError> {
        Self::transformed(profile, instant, 1.0, 1.0, false)
    }

    /// The profile as x·`scale` [m] at `start` + t·`stretch` [s]; with `is_reversed` it runs backwards within the same
    /// time.
    ///
    /// # Errors
    /// [`PathError::Placement`] if a number is not finite or `stretch` is not above 0.
    pub fn transformed(
        profile: Arc<Profile>,
        start: f64,
        scale: f64,
        stretch: f64,
        is_reversed: bool,
    ) -> Result<Self, PathError> {
        if start.is_finite() && scale.is_finite() && stretch.is_finite() && stretch > 0.0 {
            Ok(Self {
                profile,
                instant: start,
                scale,
                stretch,
                is_reversed,
            })
        } else {
            Err(PathError::Placement {
                instant: start,
                scale,
                stretch,
            })
        }
    }

    /// First instant [s] of the piece.
    pub fn start_time(&self) -> f64 {
        self.instant + self.profile.start_time() * self.stretch
    }

    /// Last instant [s] of the piece.
    pub fn end_time(&self) -> f64 {
        self.instant + self.profile.end_time() * self.stretch
    }

    /// Position [m], velocity [m/s] and acceleration [m/s²] at `t` [s] of the piece.
    pub fn evaluate(&self, t: f64) -> (f64, f64, f64) {
        self.scaled(self.profile.evaluate(self.profile_time(t)))
    }

    /// [`PlacedPath::evaluate`] with a cursor, as [`Profile::evaluate_from`].
    pub fn evaluate_from(&self, cursor: &mut usize, t: f64) -> (f64, f64, f64) {
        self.scaled(self.profile.evaluate_from(cursor, self.profile_time(t)))
    }

    /// Lowest and highest position [m] from `start_time` to `end_time` [s] of the piece.
    pub fn range(&self, start_time: f64, end_time: f64) -> (f64, f64) {
        let (from, to) = (self.profile_time(start_time), self.profile_time(end_time));
        let (range_low, range_high) = self.profile.range(from.min(to), from.max(to));
        let (range_low, range_high) = (range_low * self.scale, range_high * self.scale);
        (range_low.min(range_high), range_low.max(range_high))
    }

    /// The time of the profile at `t` [s] of the piece.
    fn profile_time(&self, t: f64) -> f64 {
        let t = (t - self.instant) / self.stretch;
        if self.is_reversed {
            self.profile.start_time() + (self.profile.end_time() - t)
        } else {
            t
        }
    }

    /// Position, velocity and acceleration of the profile, scaled and stretched.
    fn scaled(&self, (x, v, a): (f64, f64, f64)) -> (f64, f64, f64) {
        let signed_stretch = if self.is_reversed { -self.stretch } else { self.stretch };
        (
            x * self.scale,
            v * self.scale / signed_stretch,
            a * self.scale / (signed_stretch * signed_stretch),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::profile::{Curve, Point};
    use super::*;

    fn knock() -> Arc<Profile> {
        let path_points = [(1.0, 0.0), (1.25, 6.0), (1.75, -2.0), (3.0, 1.0)].map(|(t, x)| Point {
            t,
            x,
            curve: Curve::Smooth,
        });
        Arc::new(Profile::through_points(&path_points).unwrap())
    }

    #[test]
    fn transformed_path_stretches_scales_and_derives() {
        let placed_path = PlacedPath::transformed(knock(), 10.0, -0.5, 2.0, false).unwrap();
        assert_eq!((placed_path.start_time(), placed_path.end_time()), (12.0, 16.0));
        let (x, v, a) = placed_path.evaluate(13.0);
        let (x0, v0, a0) = knock().evaluate(1.5);
        assert!((x + 0.5 * x0).abs() < 1e-15);
        assert!((v + 0.25 * v0).abs() < 1e-14);
        assert!((a + 0.125 * a0).abs() < 1e-13);
    }

    #[test]
    fn transformed_path_reversed_takes_the_same_time() {
        let placed_path = PlacedPath::transformed(knock(), 10.0, 1.0, 1.0, true).unwrap();
        assert_eq!((placed_path.start_time(), placed_path.end_time()), (11.0, 13.0));
        let mut path_cursor = 0;
        for i in 0..=200 {
            let t = 11.0 + f64::from(i) / 100.0;
            let (x, v, a) = placed_path.evaluate_from(&mut path_cursor, t);
            let (x0, v0, a0) = knock().evaluate(14.0 - t);
            assert_eq!((x, v, a), (x0, -v0, a0));
        }
    }

    #[test]
    fn range_of_placed_path_by_sign_of_scale() {
        let (knock_low, knock_high) = knock().range(1.0, 3.0);
        let placed_path = PlacedPath::transformed(knock(), 0.0, -2.0, 3.0, true).unwrap();
        assert_eq!(placed_path.range(0.0, 100.0), (-2.0 * knock_high, -2.0 * knock_low));
        assert!(knock_low < -2.0 && knock_high > 6.0 - 1e-12);
    }

    #[test]
    fn transformed_path_without_positive_stretch_is_refused() {
        for stretch in [0.0, -1.0, f64::NAN] {
            assert!(PlacedPath::transformed(knock(), 0.0, 1.0, stretch, false).is_err());
        }
    }
}
