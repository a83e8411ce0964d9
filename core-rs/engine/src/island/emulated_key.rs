//! A key on its own, stepped force by force: the mechanics of an emulated device.

use super::voices::free_key;
use super::written_hand::free::{FreeKey, FreeMotion};
use crate::kernel::Laws;
use crate::network::{Error, Network};
use crate::state::Target;
use crate::timeline::{Key, Timeline};
use crate::units::Rate;

/// A key on its own, stepped frame by frame.
///
/// It moves as the free copy of a key that gestures strike, and as the key in a scene does under the same forces.
///
/// ```
/// use ergon_engine::network::Tie;
/// use ergon_engine::simulation::EmulatedKey;
/// use ergon_engine::{Network, Rate};
///
/// let mut network = Network::new();
/// let tie = Tie::Physical { k: 60.0, z: 1.2 };
/// let key = network.cel("key", 0.4, tie, 0.0, 0.0, 0.0)?;
/// let mut key = EmulatedKey::new(&network, key, Rate::new(1000.0)?)?;
/// (0..5000).for_each(|_| key.step(0.6));
/// assert!((key.position() - 0.01).abs() < 1e-4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct EmulatedKey {
    free: FreeKey,
    motion: FreeMotion,
    laws: Laws,
    targets: Vec<Target>,
    frame: u64,
}

impl EmulatedKey {
    /// The part of a network whose MAT `struck` takes the forces, at its beginning.
    ///
    /// # Errors
    /// [`Error`] if that MAT is neither a MAS nor a CEL, or the key is unstable at this rate.
    pub fn new(network: &Network, struck: usize, rate: Rate) -> Result<Self, Error> {
        let key = Key {
            name: network.mat_name(struck),
            struck,
        };
        let (free, motion) = free_key(network, &Timeline::new(rate), &key, &[])?;
        free.scheme.certify(network)?;
        Ok(Self {
            laws: Laws::new(&free.scheme),
            targets: Vec::new(),
            frame: 0,
            free,
            motion,
        })
    }

    /// Position of the key [m].
    pub fn position(&self) -> f64 {
        self.motion.body.x[self.free.struck]
    }

    /// Put the key at `x` [m] with no velocity, as an end of its travel stops it.
    pub fn stop_at(&mut self, x: f64) {
        let (body, struck) = (&mut self.motion.body, self.free.struck);
        (body.x[struck], body.d[struck]) = (x, 0.0);
    }

    /// Compute one frame under a force [N].
    pub fn step(&mut self, force: f64) {
        let (free, motion, n) = (&self.free, &mut self.motion, self.frame);
        free.forces(motion, n, &mut self.laws, &mut self.targets);
        free.strike_and_move(motion, n, force, &mut self.targets);
        self.frame += 1;
    }
}
