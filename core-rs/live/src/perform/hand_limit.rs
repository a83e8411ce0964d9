//! The greatest stable force of a piece on the key under a real hand.

use super::{Guidance, Keyboard, LiveHand};
use crate::safety::margin::FrequencyResponse;
use crate::safety::stiffness;

/// Mass [kg] and damping [N·s/m] assumed for a device that does not report them: light, with little friction.
const DEFAULT_MASS_AND_DAMPING: (f64, f64) = (0.05, 0.3);
/// Smallest share of its force that a hand may get: a piece that needs a smaller one is not played.
pub const FORCE_SCALE_MIN: f64 = 0.02;

/// The share of the piece's force that a hand may get.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandLimit {
    /// Which hand.
    pub hand: usize,
    /// Factor of the force, 0 to 1.
    pub force_scale: f64,
    /// Greatest stiffness of piece and guidance [N/m].
    pub stiffness: f64,
    /// Greatest stable stiffness [N/m]: `force_scale` · `stiffness`.
    pub stable_stiffness: f64,
}

/// A key as measured by a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredKey {
    /// Moving mass [kg], without parts that swing on it.
    pub mass: f64,
    /// Its own damping [N·s/m].
    pub damping: f64,
    /// Delay from the tick of a force to the force [s], if it was measured.
    pub delay: Option<f64>,
}

/// The key under a real hand: the parameters of its device, and the hand's guidance.
#[derive(Clone, Copy, Debug)]
pub struct HandKey {
    /// Which hand.
    pub hand: usize,
    key: stiffness::HapticLoop,
    guidance: Option<Guidance>,
}

impl HandKey {
    /// The keys of all hands on a keyboard.
    pub(super) fn from_keyboard(keyboard: &Keyboard, hands: &[LiveHand]) -> Vec<Self> {
        let hand_key = |&(_, hand): &(usize, usize)| Self {
            hand,
            key: keyboard.haptic_loop(hands[hand].measured_key),
            guidance: hands[hand].guidance,
        };
        keyboard.axes().iter().map(hand_key).collect()
    }

    /// The limit for a piece with this response; see [`LiveHand::response`].
    pub fn limit(&self, response: &[f64]) -> HandLimit {
        let frequency_response = FrequencyResponse::new(response);
        let (mut scale, mut stiffness_max) = (1.0_f64, 0.0_f64);
        for &share in Guidance::shares(self.guidance) {
            let (k, z) = self
                .guidance
                .map_or((0.0, 0.0), |guidance| (share.k * guidance.k, share.z * guidance.z));
            scale = scale.min(stiffness::safe_scale(frequency_response.gain_margin(self.key, k, z)));
            let summed_response = Guidance::total_response(self.guidance, response, self.key.tick_period, share);
            stiffness_max = stiffness_max.max(stiffness::stiffness_max(&summed_response));
        }
        HandLimit {
            hand: self.hand,
            force_scale: scale,
            stiffness: stiffness_max,
            stable_stiffness: scale * stiffness_max,
        }
    }
}

/// Tolerance of a measured delay [ticks]: a delay that exceeds a whole number of ticks by less counts as that number.
const DELAY_TOLERANCE: f64 = 0.05;

/// The key of a device without hand or piece, in ticks of `period` [s].
///
/// If both the device and `measured_key` give a value, the less stable one counts (smaller mass and damping, longer
/// delay): a calibration cannot make a key look safer than its device reports.
pub(super) fn bare_key(
    spec: &crate::device::DeviceSpec,
    measured_key: Option<MeasuredKey>,
    lockstep: bool,
    period: f64,
) -> stiffness::HapticLoop {
    let least_stable_value = |reported: Option<f64>, measured_key: Option<f64>, default_value: f64| {
        let known_values = [reported, measured_key]
            .into_iter()
            .flatten()
            .filter(|value| *value > 0.0);
        known_values.reduce(f64::min).unwrap_or(default_value)
    };
    let reported_delay = spec.loop_delay_s.map(|delay_seconds| (delay_seconds / period).ceil());
    let measured_delay = measured_key.and_then(|key| key.delay);
    let measured_delay = measured_delay.map(|delay_seconds| (delay_seconds / period - DELAY_TOLERANCE).ceil());
    let delay_ticks = [reported_delay, measured_delay]
        .into_iter()
        .flatten()
        .fold(0.0, f64::max) as usize;
    stiffness::HapticLoop {
        mass: least_stable_value(
            spec.inertia,
            measured_key.map(|key| key.mass),
            DEFAULT_MASS_AND_DAMPING.0,
        ),
        damping: least_stable_value(
            spec.damping,
            measured_key.map(|key| key.damping),
            DEFAULT_MASS_AND_DAMPING.1,
        ),
        tick_period: period,
        // Outside lockstep the force of a tick is sent in the next one.
        delay_ticks: delay_ticks + usize::from(!lockstep),
    }
}
