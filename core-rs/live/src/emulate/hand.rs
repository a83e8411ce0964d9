//! What is on a key.

use ergon_engine::units::Rate;

/// A hand on a key.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Hand {
    /// Nobody touches it.
    #[default]
    Free,
    /// A finger lies on it and pushes nothing.
    Resting,
    /// A hand goes a written path, and pulls the key to it by its own spring and damper.
    Going {
        /// Where it is at every period [m]; after the last it lets go.
        path: Vec<f64>,
        /// Its spring [N/m].
        stiffness: f64,
        /// Its damper [N·s/m].
        damping: f64,
    },
}

impl Hand {
    /// Whether there is a finger on the key.
    pub(super) fn touches(&self, period: u64) -> bool {
        match self {
            Self::Free => false,
            Self::Resting => true,
            Self::Going { path, .. } => period < path.len() as u64,
        }
    }

    /// The force on a key at `x` that moved `d` in the last period [N]; none: no force, not a force of zero.
    pub(super) fn pull(&self, period: u64, x: f64, d: f64, rate: Rate) -> Option<f64> {
        let Self::Going {
            path,
            stiffness,
            damping,
        } = self
        else {
            return None;
        };
        let at = usize::try_from(period).ok()?;
        let &to = path.get(at)?;
        let before = at.checked_sub(1).map_or(to, |before| path[before]);
        Some(stiffness * (to - x) + damping * rate.hertz() * ((to - before) - d))
    }
}
