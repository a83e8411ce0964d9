//! Emulated keys in this process: a device without a wire, always in lockstep.

use std::time::{Duration, Instant};

use super::{
    Device, DeviceError, DeviceKind, DeviceLoss, DeviceSample, DeviceSpec, DeviceUrl, InProcessPort, Unit, WireStats,
};
use crate::device::MAX_AXES;
use crate::emulate::{EmulatedHand, EmulatedKeys, EmulationOptions, Firmware, KeyConstants};
use crate::safety::SafeForce;

/// Rate of a tick of 44 samples at 44.1 kHz [Hz].
const KEY_RATE: f64 = 44_100.0 / 44.0;
/// Greatest force [N].
const FORCE_MAX: f64 = 20.0;

/// What keys without a wire are capable of: exact positions and forces, at `rate` ticks a second [Hz], of a key of a
/// mass
/// [kg] and a damping [N·s/m].
pub(super) fn exact_spec((dof, rate): (usize, f64), pos_range: [f64; 2], (mass, damping): (f64, f64)) -> DeviceSpec {
    DeviceSpec {
        dof,
        unit: Unit::Metre,
        pos_lsb: 0.0,
        pos_range,
        force_max_continuous: FORCE_MAX,
        force_max_peak: FORCE_MAX,
        force_lsb: 0.0,
        rate_nominal: Some(rate),
        loop_delay_s: Some(0.0),
        inertia: Some(mass),
        damping: Some(damping),
        is_touch_gated: false,
        can_lockstep: true,
        can_send_wide: true,
    }
}

/// Keys that advance by one step for every force sent.
pub struct EmulatedDevice {
    keys: EmulatedKeys,
    spec: DeviceSpec,
    stats: WireStats,
    has_answered: bool,
}

impl EmulatedDevice {
    pub(super) fn open(url: &DeviceUrl) -> Result<Self, DeviceError> {
        let default_key = KeyConstants::default();
        let key_model = KeyConstants {
            mass: url.option_number("mass", default_key.mass)?,
            stiffness: url.option_number("stiffness", default_key.stiffness)?,
            damping: url.option_number("damping", default_key.damping)?,
            ..default_key
        };
        let (axis_count, key_rate) = (
            url.option_number("axes", 1.0)? as usize,
            url.option_number("rate", KEY_RATE)?,
        );
        let resting_hands = vec![EmulatedHand::Resting; axis_count.min(MAX_AXES)];
        let emulated_keys =
            EmulatedKeys::new(axis_count, key_model, key_rate, resting_hands).map_err(|error| url.open_error(error))?;
        Ok(Self::new(emulated_keys, key_model))
    }

    /// Keys with the hands that are on them.
    pub fn new(keys: EmulatedKeys, key: KeyConstants) -> Self {
        let spec = exact_spec((keys.n_keys(), keys.rate().hertz()), key.range, (key.mass, key.damping));
        Self {
            keys,
            spec,
            stats: WireStats::default(),
            has_answered: false,
        }
    }

    /// The keys.
    pub fn keys(&self) -> &EmulatedKeys {
        &self.keys
    }
}

/// The driver of a board that is emulated inside this process, in lockstep. After `options.seconds` the board is gone.
///
/// # Errors
/// [`DeviceError`] if the options are impossible, or if this kind cannot be emulated inside the process.
pub fn open_board(options: &EmulationOptions) -> Result<Box<dyn Device>, DeviceError> {
    let device_kind = DeviceKind::from(options.board.protocol);
    let board_url = DeviceUrl::in_process(device_kind);
    let firmware = options.firmware().map_err(|error| board_url.open_error(error))?;
    let local_board = InProcessBoard {
        periods_left: options
            .seconds
            .map(|seconds| (seconds * firmware.keys().rate().hertz()) as u64),
        firmware,
        replies: Vec::new(),
    };
    super::open_in_process(device_kind, Box::new(local_board), true)
}

/// An emulated board, and its replies that were not read yet.
struct InProcessBoard {
    firmware: Firmware,
    /// Number of periods after which the board is gone.
    periods_left: Option<u64>,
    replies: Vec<u8>,
}

impl InProcessPort for InProcessBoard {
    fn write(&mut self, packet: &[u8]) -> Result<(), DeviceLoss> {
        if self
            .periods_left
            .is_some_and(|periods| self.firmware.keys().periods() >= periods)
        {
            return Err(DeviceLoss::Closed);
        }
        let Self { firmware, replies, .. } = self;
        firmware.receive(packet, Duration::ZERO, &mut |reply| replies.extend(reply));
        Ok(())
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, DeviceLoss> {
        let byte_count = self.replies.len().min(buffer.len());
        buffer[..byte_count].copy_from_slice(&self.replies[..byte_count]);
        self.replies.drain(..byte_count);
        Ok(byte_count)
    }
}

impl Device for EmulatedDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        let mut forces = [0.0; MAX_AXES];
        forces[..force.newtons().len()].copy_from_slice(force.newtons());
        self.keys.step(&forces);
        self.stats.packets_sent += 1;
        self.has_answered = false;
        Ok(())
    }

    fn receive(&mut self, sample: &mut DeviceSample, _: Instant) -> Result<bool, DeviceLoss> {
        sample.is_fresh = !self.has_answered;
        self.stats.replies_received += u64::from(sample.is_fresh);
        self.has_answered = true;
        sample.position = *self.keys.positions();
        for axis in 0..self.keys.n_keys() {
            sample.is_touched[axis] = self.keys.is_touched(axis);
            sample.is_force_enabled[axis] = true;
        }
        (sample.is_hot, sample.has_let_go) = (false, false);
        sample.seq = self.keys.periods() as u32;
        sample.t_dev_us = Some(self.keys.time_us());
        Ok(sample.is_fresh)
    }

    fn in_lockstep(&self) -> bool {
        true
    }

    /// The keys advance only when a force is sent, so there is no force to end.
    fn zero(&mut self) {}

    fn stats(&self) -> WireStats {
        self.stats
    }
}
