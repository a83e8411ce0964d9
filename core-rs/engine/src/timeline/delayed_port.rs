//! A point that moves with a key, and transfers the forces on it to the key after a delay, as a motor does.

use super::{Drive, DriveKind, DriveSource, StrikeError, Timeline};

/// Longest delay of a motor [s], as of [`KeyModel`](crate::key_model::KeyModel).
const DELAY_SECONDS_MAX: f64 = 1.0;

/// The key of a delayed port.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DelayedPort {
    /// The MAT that the port follows, and on which the forces act.
    pub(crate) key: usize,
    /// Time until a force on the port acts on the key [s]; at least a step.
    pub(crate) delay: f64,
}

impl Timeline {
    /// Let the fixed point `port` move with the MAT `key`, and transfer the sum of the forces on it to that MAT `delay`
    /// \[s\] later, or a step later if that is longer.
    ///
    /// Such a force is not passive: a spring K between port and ground acts on the key as a damper of −K·delay
    /// (J. E. Colgate and J. M. Brown, Factors affecting the Z-width of a haptic display, ICRA 1994).
    ///
    /// # Errors
    /// [`StrikeError`] if the delay is not from 0 to 1 s, or the position of the port is imposed already.
    pub fn delay_forces(&mut self, port: usize, key: usize, delay: f64) -> Result<(), StrikeError> {
        if !(0.0..=DELAY_SECONDS_MAX).contains(&delay) {
            return Err(StrikeError::Value("a delay", " from 0 to 1 s", delay));
        }
        let key_source = DriveSource::Key(DelayedPort { key, delay });
        self.drive(port, DriveKind::Position, key_source, false)
    }

    /// The ports of keys whose forces are delayed: each port with its key.
    pub(crate) fn delayed_ports(&self) -> impl Iterator<Item = (usize, usize)> {
        let port_pair = |drive: &Drive| Some((drive.mat, drive.port()?.key));
        self.drives.iter().filter_map(port_pair)
    }

    /// The MATs that drives move or push, with the keys that delayed ports push.
    pub(crate) fn driven_mats(&self) -> impl Iterator<Item = usize> {
        let driven_mats = self.drives.iter().map(|drive| drive.mat);
        driven_mats.chain(self.delayed_ports().map(|(_, key)| key))
    }
}
