//! Hands on emulated keys.

use ergon_engine::units::Rate;

/// A hand on a key.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum EmulatedHand {
    /// Nobody touches it.
    #[default]
    Free,
    /// A finger rests on it and exerts no force.
    Resting,
    /// A hand follows a written path and pulls the key along by its own spring and damper.
    OnPath {
        /// Position of the hand at every period [m]; after the last one it lets go.
        path: Vec<f64>,
        /// Spring of the hand [N/m].
        stiffness: f64,
        /// Damper of the hand [N·s/m].
        damping: f64,
    },
}

impl EmulatedHand {
    /// Whether there is a finger on the key.
    pub(super) fn touches(&self, period: u64) -> bool {
        match self {
            Self::Free => false,
            Self::Resting => true,
            Self::OnPath { path, .. } => period < path.len() as u64,
        }
    }

    /// The force on a key at `x` that moved by `d` in the last period [N]; `None` if no hand pulls, which is not a
    /// force of zero.
    pub(super) fn pull(&self, period: u64, x: f64, d: f64, rate: Rate) -> Option<f64> {
        let Self::OnPath {
            path,
            stiffness,
            damping,
        } = self
        else {
            return None;
        };
        let path_index = usize::try_from(period).ok()?;
        let &hand_target = path.get(path_index)?;
        let previous = path_index.checked_sub(1).map_or(hand_target, |previous| path[previous]);
        Some(stiffness * (hand_target - x) + damping * rate.hertz() * ((hand_target - previous) - d))
    }
}
