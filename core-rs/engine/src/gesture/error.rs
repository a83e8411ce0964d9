//! The error of a gesture that is refused.

use super::profile::PathError;

/// Why points do not define a gesture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GestureError {
    /// A path that is refused.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A gesture on a key that does not exist.
    #[error("there is no key {0}")]
    NoKey(usize),
    /// Arrays of different lengths.
    #[error("positions, curves and instants of a gesture must be equally many")]
    LengthMismatch,
    /// A throw with no frame between its ends.
    #[error("point {index}: a throw must last at least one audio frame; from {from} s to {to} s there is none")]
    ThrowTooShort {
        /// Index of the point thrown to, from 0.
        index: usize,
        /// Instant of the strike [s].
        from: f64,
        /// Instant at which the key has to be there [s].
        to: f64,
    },
    /// Tracked ergons as particles: a particle would be launched before the force that it has to give is known.
    #[error("tracked ergons cannot be particles: a particle is launched before the force that it must give is known")]
    TrackedParticle,
    /// A joining time, force limit or grain that is not a positive number.
    #[error("{what} must be a positive number, not {value}")]
    NotPositive {
        /// Name of the number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
}

impl GestureError {
    /// Index of the point at fault, from 0; `None` if no single point is at fault.
    pub fn point(&self) -> Option<usize> {
        match self {
            Self::Path(
                PathError::NotFinite { index, .. }
                | PathError::NotRising { index, .. }
                | PathError::HoldMoves { index, .. },
            )
            | Self::ThrowTooShort { index, .. } => Some(*index),
            Self::Path(PathError::Empty | PathError::Placement { .. })
            | Self::NoKey(_)
            | Self::LengthMismatch
            | Self::TrackedParticle
            | Self::NotPositive { .. } => None,
        }
    }
}
