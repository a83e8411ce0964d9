//! Keys: masses tied to the ground by a spring and a damper, one step a period; or keys that move by a model or by the
//! network of a score.

use std::ops::RangeInclusive;

use ergon_engine::cell::Cell;
use ergon_engine::key_model::{KeyModel, Motion};
use ergon_engine::simulation::EmulatedKey;
use ergon_engine::units::Rate;

use super::EmulateError;
use super::hand::EmulatedHand;
use crate::wire::MAX_AXES;

/// The constants of a key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyConstants {
    /// Moving mass [kg].
    pub mass: f64,
    /// Spring to the ground [N/m].
    pub stiffness: f64,
    /// Damper to the ground [N·s/m].
    pub damping: f64,
    /// Its two ends [m].
    pub range: [f64; 2],
}

impl Default for KeyConstants {
    /// A light fader: damping and no spring.
    fn default() -> Self {
        Self {
            mass: 0.05,
            stiffness: 0.0,
            damping: 1.0,
            range: [-0.05, 0.05],
        }
    }
}

/// A device's keys and the hands on them.
///
/// ```
/// use ergon_live::emulate::{EmulatedHand, KeyConstants, EmulatedKeys};
///
/// let mut keys = EmulatedKeys::new(1, KeyConstants::default(), 1000.0, vec![EmulatedHand::Resting])?;
/// let mut force = [0.0; ergon_live::device::MAX_AXES];
/// force[0] = 1.0; // 1 N on a key under a resting finger
/// (0..100).for_each(|_| keys.step(&force));
/// assert!(keys.positions()[0] > 0.0 && keys.periods() == 100);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct EmulatedKeys {
    rate: Rate,
    range: [f64; 2],
    w: f64,
    kappa: f64,
    zeta: f64,
    n_keys: usize,
    x: [f64; MAX_AXES],
    d: [f64; MAX_AXES],
    hands: Vec<EmulatedHand>,
    /// The motion of each key, if the keys are not CELs.
    motions: Vec<KeyMotion>,
    periods: u64,
    hash: u64,
}

/// The motion of a key that is not a CEL.
#[derive(Clone, Debug)]
enum KeyMotion {
    /// By a key model.
    Model(Box<Motion>),
    /// By the network of a score.
    Network(Box<EmulatedKey>),
}

impl KeyMotion {
    /// Advance by one period under the motor's force and a hand's pull; returns the new position [m].
    fn step(&mut self, force: f64, pull: f64, range: RangeInclusive<f64>) -> f64 {
        let new_position = match self {
            Self::Model(motion) => {
                motion.tick(force, pull);
                motion.position()
            }
            Self::Network(key) => {
                key.step(force, pull);
                key.position()
            }
        };
        if range.contains(&new_position) {
            return new_position;
        }
        let travel_end = new_position.clamp(*range.start(), *range.end());
        match self {
            Self::Model(motion) => motion.stop_at(travel_end),
            Self::Network(key) => key.stop_at(travel_end),
        }
        travel_end
    }
}

impl EmulatedKeys {
    /// `n` equal keys, stepped `rate` times a second; keys beyond the end of `hands` are free.
    ///
    /// # Errors
    /// If the key or the rate is impossible.
    pub fn new(n: usize, key: KeyConstants, rate: f64, mut hands: Vec<EmulatedHand>) -> Result<Self, EmulateError> {
        let refusal = |reason| Err(EmulateError::Refused(reason));
        if n == 0 || n > MAX_AXES {
            return refusal("a device must have 1 to 16 keys");
        }
        let Ok(rate) = Rate::new(rate) else {
            return refusal("the rate must be a positive number of periods a second");
        };
        let is_at_least = |x: f64, least: f64| x.is_finite() && x >= least;
        let is_tie_valid = is_at_least(key.stiffness, 0.0) && is_at_least(key.damping, 0.0);
        if !is_at_least(key.mass, f64::MIN_POSITIVE) || !is_tie_valid {
            return refusal("the mass of a key must be above zero, its stiffness and damping at least zero");
        }
        let key_cell = Cell::new(key.mass, key.stiffness, key.damping);
        if key_cell.frequency() > 0.5 * rate.hertz() {
            return refusal("the resonance of this key is faster than half its rate");
        }
        let cell_ratios = key_cell.ratios(rate);
        hands.resize(n, EmulatedHand::Free);
        Ok(Self {
            rate,
            range: key.range,
            w: rate.step() * rate.step() / key.mass,
            kappa: cell_ratios.kappa,
            zeta: cell_ratios.zeta,
            n_keys: n,
            x: [0.0; MAX_AXES],
            d: [0.0; MAX_AXES],
            hands,
            motions: Vec::new(),
            periods: 0,
            hash: 0xcbf2_9ce4_8422_2325,
        })
    }

    /// The same keys, each moving by a model, from its start on.
    ///
    /// # Errors
    /// If the key cannot be computed at this rate.
    pub fn with_model(mut self, model: &KeyModel) -> Result<Self, EmulateError> {
        let model_motion = Motion::new(model, self.rate.hertz(), None)?;
        self.x[..self.n_keys].fill(model_motion.position());
        self.motions = vec![KeyMotion::Model(Box::new(model_motion)); self.n_keys];
        Ok(self)
    }

    /// The same keys, each moving like a key of a score, at the rate of the periods.
    pub fn with_network(mut self, key: EmulatedKey) -> Self {
        self.x[..self.n_keys].fill(key.position());
        self.motions = vec![KeyMotion::Network(Box::new(key)); self.n_keys];
        self
    }

    /// Advance by one period under forces [N]   (n)
    ///
    /// The operations and their order are those of a MAT in the engine: without a hand, a model and a network, a key
    /// moves like that CEL, to the last bit.
    pub fn step(&mut self, force: &[f64; MAX_AXES]) {
        if self.motions.is_empty() {
            self.step_cells(force);
        } else {
            self.step_motions(force);
        }
        self.periods += 1;
        for x in &self.x[..self.n_keys] {
            for byte in x.to_bits().to_le_bytes() {
                self.hash = (self.hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }

    fn step_motions(&mut self, force: &[f64; MAX_AXES]) {
        let [lower_limit, upper_limit] = self.range;
        for (axis, motion) in self.motions.iter_mut().enumerate() {
            let (x, d) = (self.x[axis], self.d[axis]);
            let hand_pull = self.hands[axis].pull(self.periods, x, d, self.rate);
            let new_position = motion.step(force[axis], hand_pull.unwrap_or(0.0), lower_limit..=upper_limit);
            (self.x[axis], self.d[axis]) = (new_position, new_position - x);
        }
    }

    fn step_cells(&mut self, force: &[f64; MAX_AXES]) {
        for (axis, hand) in self.hands.iter().enumerate() {
            let (x, d) = (self.x[axis], self.d[axis]);
            let hand_pull = hand.pull(self.periods, x, d, self.rate);
            let force = hand_pull.map_or(force[axis], |hand_pull| force[axis] + hand_pull);
            let second_difference = force * self.w - self.kappa * x - self.zeta * d;
            self.d[axis] += second_difference;
            self.x[axis] += self.d[axis];
            let [lower_limit, upper_limit] = self.range;
            if self.x[axis] < lower_limit || self.x[axis] > upper_limit {
                self.x[axis] = self.x[axis].clamp(lower_limit, upper_limit);
                self.d[axis] = 0.0;
            }
        }
    }

    /// Number of keys.
    pub fn n_keys(&self) -> usize {
        self.n_keys
    }

    /// Their positions [m]   (16, those of the keys first)
    pub fn positions(&self) -> &[f64; MAX_AXES] {
        &self.x
    }

    /// Whether a finger is on a key.
    pub fn is_touched(&self, axis: usize) -> bool {
        self.hands[axis].touches(self.periods)
    }

    /// Number of periods so far.
    pub fn periods(&self) -> u64 {
        self.periods
    }

    /// Rate of the periods.
    pub fn rate(&self) -> Rate {
        self.rate
    }

    /// The keys' own time [µs], wrapping.
    pub fn time_us(&self) -> u32 {
        (self.periods as f64 * self.rate.step() * 1e6) as u64 as u32
    }

    /// Hash of all positions so far (FNV-1a): equal paths have equal hashes.
    pub fn hash(&self) -> u64 {
        self.hash
    }
}

#[cfg(test)]
mod tests;
