//! Forces that have passed every stage.

use crate::wire::MAX_AXES;

/// Forces that may be sent to a device: zero, or the result of the stages of this module.
///
/// ```compile_fail
/// let force = ergon_live::safety::SafeForce { newtons: [1.0; 16], n_axes: 1 };
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafeForce {
    newtons: [f64; MAX_AXES],
    n_axes: usize,
}

impl SafeForce {
    /// Zero force on each of `n_axes` axes.
    pub fn zero(n_axes: usize) -> Self {
        Self {
            newtons: [0.0; MAX_AXES],
            n_axes: n_axes.min(MAX_AXES),
        }
    }

    pub(super) fn new(newtons: [f64; MAX_AXES], n_axes: usize) -> Self {
        Self { newtons, n_axes }
    }

    /// Forces [N] or [N·m]   (n_axes)
    pub fn newtons(&self) -> &[f64] {
        &self.newtons[..self.n_axes]
    }

    /// The same forces times a gain for each axis, for motors that pull the other way or less strongly; gains are
    /// clamped to -1 to 1.
    #[must_use]
    pub fn with_gains(&self, gains: &[f64; MAX_AXES]) -> Self {
        let mut scaled_force = *self;
        for (force, gain) in scaled_force.newtons.iter_mut().zip(gains) {
            // A gain of 1 changes no bit; a gain of NaN gives no force.
            *force *= if gain.is_nan() { 0.0 } else { gain.clamp(-1.0, 1.0) };
        }
        scaled_force
    }
}
