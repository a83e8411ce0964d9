//! Why points make no gesture.

use super::profile::PathError;

/// Why points make no gesture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GestureError {
    /// A stretch of curves.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A gesture on a key that is not there.
    #[error("there is no key {0}")]
    NoKey(usize),
    /// Arrays of different lengths.
    #[error("a gesture has as many positions and curves as instants")]
    Shape,
    /// A throw with no frame between its ends.
    #[error(
        "point {index}: a throw needs time: from {from} s to {to} s there is not one audio sample"
    )]
    Short {
        /// The point thrown to, from 0.
        index: usize,
        /// When it is struck [s].
        from: f64,
        /// When it is to be there [s].
        to: f64,
    },
    /// Ergons that keep a key on its path cannot be launched before the path's forces are known.
    #[error(
        "tracked ergons are events: a particle flies before the force that it must give is known"
    )]
    TrackedParticle,
    /// A joining time, force limit or grain that is no positive number.
    #[error("{what} must be a positive number, not {value}")]
    Positive {
        /// Which.
        what: &'static str,
        /// What was given.
        value: f64,
    },
}
