//! Imposed positions and forces: ENX and ENF.

use super::delayed_port::DelayedPort;
use super::hand::{Hand, HandInterpolation};
use super::sound_in::SoundIn;
use crate::gesture::placed::PlacedPath;
use crate::state::{ImposedTarget, ModuleState};

/// Quantity that a drive imposes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriveKind {
    /// An imposed position (ENX).
    Position,
    /// An imposed force (ENF).
    Force,
}

/// A constant or a take that moves or pushes a MAT.
#[derive(Clone, Debug)]
pub struct Drive {
    pub(crate) mat: usize,
    pub(crate) kind: DriveKind,
    pub(crate) source: DriveSource,
    /// Whether the drive belongs to the MAT's own part. If so, it also acts on the free copy of a key (e.g. a weight).
    pub(crate) acts_on_free_key: bool,
}

/// Source of the values of a drive.
#[derive(Clone, Debug)]
pub enum DriveSource {
    /// A constant [m or N].
    Constant(f64),
    /// A placed take [m or N]; it holds its first value before its start and its last value after its end.
    Take(PlacedPath),
    /// A real hand.
    Hand(Hand),
    /// A key, whose port it is.
    Key(DelayedPort),
    /// Impulses that [`Simulation::strike`](crate::simulation::Simulation::strike) sends while it plays. Without an
    /// impulse the force is 0.
    Strikes {
        /// Number of the point.
        point: u32,
        /// How long each strike lasts, in 1/44,100 s; 1: it acts at one instant.
        n_parts: u32,
    },
    /// An input: its values times `scale`.
    SoundIn {
        /// The input.
        sound: SoundIn,
        /// Factor of its values.
        scale: f64,
        /// Steps in a frame of the score.
        steps: u32,
    },
}

impl Drive {
    /// Whether it is a force that may act at any time, that of a port on its key too; strikes are events.
    pub(crate) fn is_force(&self) -> bool {
        self.port().is_some() || self.kind == DriveKind::Force && !matches!(self.source, DriveSource::Strikes { .. })
    }

    /// Value at frame `n` [m or N].
    pub(crate) fn value(&self, n: u64, rate: f64) -> f64 {
        match &self.source {
            DriveSource::Constant(value) => *value,
            DriveSource::Take(path) => path.evaluate(n as f64 / rate).0,
            DriveSource::Hand(hand) => hand.position(n),
            DriveSource::Key(_) | DriveSource::Strikes { .. } => 0.0,
            DriveSource::SoundIn { sound, scale, steps } => {
                // A position in a frame is the input value of the frame before. A force is evaluated only at the start,
                // when the live input is not yet known.
                let sound_frame = (n / u64::from(*steps)).checked_sub(1);
                let sound_frame = sound_frame.filter(|_| self.kind == DriveKind::Position);
                sound_frame.map_or(0.0, |sound_frame| scale * sound.value(sound_frame))
            }
        }
    }

    /// Whether an input drives it.
    pub(crate) fn is_sound_in(&self) -> bool {
        matches!(self.source, DriveSource::SoundIn { .. })
    }

    /// The hand, if the source is one.
    pub(crate) fn hand(&self) -> Option<&Hand> {
        match &self.source {
            DriveSource::Hand(hand) => Some(hand),
            _ => None,
        }
    }

    /// The key that it follows, if it is a delayed port.
    pub(crate) fn port(&self) -> Option<&DelayedPort> {
        match &self.source {
            DriveSource::Key(port) => Some(port),
            _ => None,
        }
    }

    /// Whether it imposes a position that is known in advance: neither a hand's nor a key's.
    pub(crate) fn is_path(&self) -> bool {
        let is_known = self.hand().is_none() && self.port().is_none();
        self.kind == DriveKind::Position && is_known
    }

    /// The same event at `oversampling` times the rate.
    pub(super) fn with_higher_rate(&self, oversampling: u32) -> Self {
        let source = match &self.source {
            DriveSource::Hand(hand) => DriveSource::Hand(hand.with_higher_rate(oversampling)),
            DriveSource::SoundIn { sound, scale, steps } => DriveSource::SoundIn {
                sound: sound.clone(),
                scale: *scale,
                steps: steps * oversampling,
            },
            other => other.clone(),
        };
        Self { source, ..self.clone() }
    }

    /// Add the force at frame `n`, or impose the position at frame n + 1.
    pub(crate) fn apply(&self, n: u64, rate: f64, modules: &mut ModuleState, targets: &mut Vec<ImposedTarget>) {
        if self.is_sound_in() {
            return; // its island applies the live values
        }
        match self.kind {
            DriveKind::Force => modules.push(self.mat, self.value(n, rate)),
            DriveKind::Position => {
                let x = match &self.source {
                    // The best known value: a device's position arrives at the beginning of a frame.
                    DriveSource::Hand(Hand {
                        interpolation: mode, ..
                    }) => match mode {
                        HandInterpolation::Hold => modules.x[self.mat],
                        HandInterpolation::Line => modules.x[self.mat] + modules.d[self.mat],
                    },
                    // It continues with the last step of the key until the key has moved.
                    DriveSource::Key(_) => modules.x[self.mat] + modules.d[self.mat],
                    _ => self.value(n + 1, rate),
                };
                targets.push(ImposedTarget {
                    mat: self.mat,
                    x,
                    previous: 0.0,
                });
            }
        }
    }
}
