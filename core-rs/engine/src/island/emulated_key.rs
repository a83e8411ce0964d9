//! A key on its own, stepped force by force: the mechanics of an emulated device.

use super::voices::free_key;
use super::written_hand::free::{FreeKey, FreeMotion};
use crate::kernel::KernelScratch;
use crate::maths::floor;
use crate::network::{Error, Network};
use crate::state::ImposedTarget;
use crate::timeline::{Drive, DriveKind, DriveSource, Key, Timeline};
use crate::units::Rate;

/// A key on its own, stepped frame by frame.
///
/// Its motor's force acts after a delay, a hand's force at once, and a constant force always.
///
/// It moves as the free copy of a key that gestures strike, and as the key in a scene does under the same forces.
///
/// ```
/// use ergon_engine::network::Tie;
/// use ergon_engine::simulation::{EmulatedKey, KeyMotor};
/// use ergon_engine::{Network, Rate};
///
/// let mut network = Network::new();
/// let tie = Tie::Physical { k: 60.0, z: 1.2 };
/// let key = network.cel("key", 0.4, tie, 0.0, 0.0, 0.0)?;
/// let mut key = EmulatedKey::new(&network, key, Rate::new(1000.0)?, KeyMotor::default())?;
/// (0..5000).for_each(|_| key.step(0.6, 0.0));
/// assert!((key.position() - 0.01).abs() < 1e-4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct EmulatedKey {
    free_key: FreeKey,
    key_motion: FreeMotion,
    scratch: KernelScratch,
    targets: Vec<ImposedTarget>,
    frame: u64,
    /// The last forces of the motor, the newest last, and the share of the oldest in the force that acts.
    motor_forces: Vec<f64>,
    oldest_share: f64,
}

/// How the motor of an emulated key pushes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KeyMotor {
    /// Time until a force acts [s].
    pub delay: f64,
    /// Constant force on the key, without delay [N]: its weight is below zero.
    pub constant_force: f64,
}

impl EmulatedKey {
    /// The part of a network whose MAT `struck_mat` takes the forces, at its beginning.
    ///
    /// # Errors
    /// [`Error`] if that MAT is neither a MAS nor a CEL, or the key is unstable at this rate.
    pub fn new(network: &Network, struck_mat: usize, rate: Rate, motor: KeyMotor) -> Result<Self, Error> {
        let struck_key = Key {
            name: network.mat_name(struck_mat),
            struck_mat,
        };
        let mut timeline = Timeline::new(rate);
        if motor.constant_force != 0.0 {
            timeline.drives.push(Drive {
                mat: struck_mat,
                kind: DriveKind::Force,
                source: DriveSource::Constant(motor.constant_force),
                acts_on_free_key: true,
            });
        }
        let (free_key, key_motion) = free_key(network, &timeline, &struck_key, &[])?;
        free_key.scheme.certify(network)?;
        let delay_frames = motor.delay.max(0.0) * rate.hertz();
        let full_frames = floor(delay_frames);
        Ok(Self {
            motor_forces: vec![0.0; full_frames as usize + 2],
            oldest_share: delay_frames - full_frames,
            scratch: KernelScratch::new(&free_key.scheme),
            targets: Vec::new(),
            frame: 0,
            free_key,
            key_motion,
        })
    }

    /// Position of the key [m].
    pub fn position(&self) -> f64 {
        self.key_motion.modules.x[self.free_key.struck_mat]
    }

    /// Put the key at `x` [m] with no velocity, as an end of its travel stops it.
    pub fn stop_at(&mut self, x: f64) {
        let (modules, struck_mat) = (&mut self.key_motion.modules, self.free_key.struck_mat);
        (modules.x[struck_mat], modules.d[struck_mat]) = (x, 0.0);
    }

    /// Compute one frame under a force of the motor, which acts after its delay, and one of a hand [N].
    pub fn step(&mut self, motor_force: f64, hand_force: f64) {
        self.motor_forces.rotate_left(1);
        let newest_slot = self.motor_forces.len() - 1;
        self.motor_forces[newest_slot] = motor_force;
        // Without a fraction of a frame the force is what was sent, to the last bit.
        let delayed_force = if self.oldest_share > 0.0 {
            self.oldest_share * self.motor_forces[0] + (1.0 - self.oldest_share) * self.motor_forces[1]
        } else {
            self.motor_forces[1]
        };
        let force = delayed_force + hand_force;
        let (free_key, key_motion, frame_number) = (&self.free_key, &mut self.key_motion, self.frame);
        free_key.sum_forces(key_motion, frame_number, &mut self.scratch, &mut self.targets);
        free_key.strike_and_move(key_motion, frame_number, force, &mut self.targets);
        self.frame += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Tie;

    const RATE: f64 = 1000.0;

    fn key(motor: KeyMotor) -> EmulatedKey {
        let mut network = Network::new();
        let ground_tie = Tie::Physical { k: 0.0, z: 0.0 };
        let struck_mat = network.cel("key", 0.4, ground_tie, 0.0, 0.0, 0.0).unwrap();
        EmulatedKey::new(&network, struck_mat, Rate::new(RATE).unwrap(), motor).unwrap()
    }

    /// Positions under a force of the motor that changes at every frame.
    fn path(motor: KeyMotor) -> Vec<f64> {
        let mut key = key(motor);
        let frame_range = 0..60;
        frame_range
            .map(|n| {
                key.step(f64::from(n % 7) - 2.5, 0.0);
                key.position()
            })
            .collect()
    }

    #[test]
    fn motor_force_with_delay() {
        let undelayed = path(KeyMotor::default());
        let delayed_path = |frames: f64| {
            path(KeyMotor {
                delay: frames / RATE,
                constant_force: 0.0,
            })
        };
        assert_eq!(delayed_path(3.0)[3..], undelayed[..57]);
        let (two_frames_late, three_frames_late, between) = (delayed_path(2.0), delayed_path(3.0), delayed_path(2.25));
        for ((a, b), x) in two_frames_late.iter().zip(&three_frames_late).zip(&between) {
            assert!((0.75 * a + 0.25 * b - x).abs() < 1e-15);
        }
    }

    /// A hand acts at once, whatever the motor does.
    #[test]
    fn hand_force_beside_a_delayed_motor() {
        let mut delayed = key(KeyMotor {
            delay: 0.01,
            constant_force: 0.0,
        });
        let mut undelayed = key(KeyMotor::default());
        for _ in 0..20 {
            delayed.step(0.0, 0.3);
            undelayed.step(0.3, 0.0);
            assert_eq!(delayed.position(), undelayed.position());
        }
    }

    /// A free mass under a constant force from rest: x = F t²/2M.
    #[test]
    fn weight_of_key_without_spring() {
        let mut key = key(KeyMotor {
            delay: 0.005,
            constant_force: -0.2,
        });
        (0..200).for_each(|_| key.step(0.0, 0.0));
        let expected_fall = -0.2 * 200.0 * 200.0 / (2.0 * 0.4 * RATE * RATE);
        assert!((key.position() - expected_fall).abs() < 1e-12, "{}", key.position());
    }
}
